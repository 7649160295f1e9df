//! Groups obstacles that lie close together, so that one piece of furniture gets one panel.
//!
//! A chair gives several strong reflections, and each becomes an obstacle of the scene. At most
//! eight panels can be shown, so a panel for each chair leg would leave none for the sofa.
//! Obstacles are added in the order in which they were found. Each joins the first group that is
//! near enough seen from above, and groups that it connects merge, as long as none becomes wider
//! than a piece of furniture. Evidence varies and is not used, so the groups stay stable.

use radar_mapping::{Observed, Obstacle};
use radar_sar::geometry::Aabb;

/// Largest gap between boxes of one group, seen from above, metres. Choice: too narrow for a person
/// to pass.
const MAX_GAP_M: f64 = 0.45;
/// Largest horizontal extent of a group, metres. Choice: about a piece of furniture.
const MAX_WIDTH_M: f64 = 1.2;

/// A group of obstacles and its bounding box.
struct ObstacleGroup {
    /// The first member with the shapes of all members.
    merged: Obstacle,
    around: Aabb,
}

/// Groups in the order of their first members. Each has the id and position of its first member and
/// the shapes of all. Range-only obstacles are not grouped.
pub(super) fn group_obstacles(obstacles: &[Obstacle]) -> Vec<Obstacle> {
    let mut by_age: Vec<&Obstacle> = obstacles.iter().collect();
    by_age.sort_by_key(|obstacle| obstacle.id);
    let mut groups: Vec<ObstacleGroup> = Vec::new();
    for obstacle in by_age {
        groups.extend(ObstacleGroup::of(obstacle));
        merge_newest(&mut groups);
    }
    groups.into_iter().map(|group| group.merged).collect()
}

/// Merges the newest group with those near it, until nothing merges any more.
fn merge_newest(groups: &mut Vec<ObstacleGroup>) {
    let mut newest = groups.len().saturating_sub(1);
    while let Some(other) = (0..groups.len()).find(|&n| n != newest && groups[n].may_merge_with(&groups[newest])) {
        let (first, second) = (newest.min(other), newest.max(other));
        let joined = groups.remove(second);
        groups[first].merge(joined);
        newest = first;
    }
}

impl ObstacleGroup {
    /// A group of one obstacle; `None` when it has no finite position.
    fn of(obstacle: &Obstacle) -> Option<Self> {
        let points = obstacle.shape.iter().map(|s| s.0).chain([obstacle.position_m]);
        let around = Aabb::around(points.filter(|point| point.is_finite()))?;
        Some(Self { merged: obstacle.clone(), around })
    }

    fn may_merge_with(&self, other: &Self) -> bool {
        let both = union(&self.around, &other.around).size();
        let gap = both - self.around.size() - other.around.size();
        self.merged.observed == Observed::Position
            && other.merged.observed == Observed::Position
            && gap.x.max(gap.z) <= MAX_GAP_M
            && both.x.max(both.z) <= MAX_WIDTH_M
    }

    /// Merges a group that was found later into this one.
    fn merge(&mut self, other: Self) {
        self.merged.shape.extend(other.merged.shape);
        self.merged.provisional &= other.merged.provisional;
        self.around = union(&self.around, &other.around);
        self.merged.extent_m = self.around.size();
    }
}

fn union(a: &Aabb, b: &Aabb) -> Aabb {
    Aabb { min: a.min.min(b.min), max: a.max.max(b.max) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    fn obstacle(id: u64, x: f64, observed: Observed) -> Obstacle {
        let position_m = DVec3::new(x, 0.5, -1.0);
        Obstacle {
            id,
            position_m,
            covariance_m2: DMat3::IDENTITY * 1e-4,
            observed,
            extent_m: DVec3::ZERO,
            evidence: 10.0,
            shape: vec![(position_m, 1.0)],
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn chair_legs_group_and_furniture_rows_do_not() {
        let at = |id, x| obstacle(id, x, Observed::Position);
        let chair = group_obstacles(&[at(1, 0.0), at(2, 0.25), at(3, 0.5)]);
        assert_eq!((chair.len(), chair[0].id, chair[0].shape.len()), (1, 1, 3));
        assert_eq!(group_obstacles(&[at(1, 0.0), at(2, 0.4)]).len(), 1, "no way leads between them");
        assert_eq!(group_obstacles(&[at(1, 0.0), at(2, 0.5)]).len(), 2);
        let between = group_obstacles(&[at(1, 0.0), at(2, 0.5), at(3, 0.25)]);
        assert_eq!((between.len(), between[0].id), (1, 1), "the last joins the other two");
        let row: Vec<_> = (0..10).map(|n| at(n, 0.25 * n as f64)).collect();
        assert!(group_obstacles(&row).len() >= 2);
    }

    #[test]
    fn stacked_obstacles_group_at_any_height() {
        let pole = [0.05, 0.5, 1.0, 1.9].map(|height_m| {
            let position_m = DVec3::new(0.02 * height_m, height_m, -1.0);
            Obstacle { position_m, shape: vec![(position_m, 1.0)], ..obstacle(1, 0.0, Observed::Position) }
        });
        let numbered: Vec<_> = (1..).zip(pole).map(|(id, part)| Obstacle { id, ..part }).collect();
        let groups = group_obstacles(&numbered);
        assert_eq!((groups.len(), groups[0].shape.len()), (1, 4));
    }

    #[test]
    fn range_only_obstacles_are_not_grouped() {
        let both = [obstacle(1, 0.0, Observed::Position), obstacle(2, 0.1, Observed::RangeOnly)];
        assert_eq!(group_obstacles(&both).len(), 2);
    }
}
