//! One panel for one thing: obstacles that lie close together are drawn as one.
//!
//! A chair gives several strong reflections, each an obstacle of its own in the scene. In the order in which they were found,
//! each joins the first group whose box is near enough, as long as the group stays no wider than a piece of furniture. Evidence
//! goes up and down and plays no part, so that groups stay what they are.

use crate::geometry::Aabb;
use crate::obstacles::{Observed, Obstacle};

/// Boxes this near to each other join, metres.
const GAP_M: f64 = 0.3;
/// Widest that a group may become over the floor, metres.
const WIDEST_M: f64 = 1.2;

/// Groups in the order of their first members; each has its first member's id and place and the shapes of all. What is known by
/// its distance alone stays by itself.
pub(super) fn grouped(obstacles: &[Obstacle]) -> Vec<Obstacle> {
    let mut by_age: Vec<&Obstacle> = obstacles.iter().collect();
    by_age.sort_by_key(|obstacle| obstacle.id);
    let mut groups: Vec<(Obstacle, Aabb)> = Vec::new();
    for obstacle in by_age {
        let places = obstacle.shape.iter().map(|s| s.0).chain([obstacle.position_m]);
        let Some(around) = Aabb::around(places.filter(|p| p.is_finite())) else { continue };
        let joins = |(group, so_far): &&mut (Obstacle, Aabb)| {
            let both = union(so_far, &around);
            let gap = both.size() - so_far.size() - around.size();
            obstacle.observed == Observed::Position
                && group.observed == Observed::Position
                && gap.max_element() <= GAP_M
                && both.size().x.max(both.size().z) <= WIDEST_M
        };
        match groups.iter_mut().find(joins) {
            Some((group, so_far)) => {
                group.shape.extend_from_slice(&obstacle.shape);
                group.provisional &= obstacle.provisional;
                *so_far = union(so_far, &around);
                group.extent_m = so_far.size();
            }
            None => groups.push((obstacle.clone(), around)),
        }
    }
    groups.into_iter().map(|(group, _)| group).collect()
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
    fn legs_of_a_chair_are_one_and_a_row_of_furniture_is_not() {
        let at = |id, x| obstacle(id, x, Observed::Position);
        let chair = grouped(&[at(1, 0.0), at(2, 0.25), at(3, 0.5)]);
        assert_eq!((chair.len(), chair[0].id, chair[0].shape.len()), (1, 1, 3));
        assert_eq!(grouped(&[at(1, 0.0), at(2, 0.4)]).len(), 2);
        let row: Vec<_> = (0..10).map(|n| at(n, 0.25 * n as f64)).collect();
        assert!(grouped(&row).len() >= 2);
    }

    #[test]
    fn an_unknown_direction_stays_by_itself() {
        let both = [obstacle(1, 0.0, Observed::Position), obstacle(2, 0.1, Observed::RangeOnly)];
        assert_eq!(grouped(&both).len(), 2);
    }
}
