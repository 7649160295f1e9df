//! Finds places for furniture: around the play area or along walls, without overlap.

use glam::{DVec2, DVec3};

use radar_sar::math;

use crate::furniture::Draw;

use super::floor_plan::FloorPlan;
use super::object::{Furniture, WorldObject};

/// Where a piece of furniture stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    /// Around the play area, its front towards the centre.
    Ring,
    /// Its back at a wall, with this gap, metres.
    AtWall(f64),
    /// Its centre this far before a wall, at any angle, metres.
    BeforeWall(f64),
}

/// Distance from the play area's centre to the near side of furniture in the ring, metres. Choice: it can be reached
/// from the play area and does not stand in it.
const RING_M: (f64, f64) = (0.95, 1.5);
/// No furniture stands nearer to the centre than this, metres. Choice: where the player begins.
const CLEAR_CENTER_M: f64 = 0.8;
/// Smallest gap between objects, metres. Choice: they do not touch.
const GAP_M: f64 = 0.03;
/// Trials for each object. Choice: what has not found a place by then hardly ever does.
const TRIALS: usize = 300;

/// A rectangle on the floor, at any angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Footprint {
    center: DVec2,
    /// Half the sides as vectors.
    u: DVec2,
    v: DVec2,
}

impl Footprint {
    /// Of an object with this extent in its own frame, in x and z.
    pub fn new(min: DVec3, max: DVec3, at_m: DVec3, yaw_rad: f64) -> Self {
        let (sin, cos) = math::sin_cos(yaw_rad);
        let turned = |x: f64, z: f64| DVec2::new(cos * x + sin * z, cos * z - sin * x);
        let (middle, half) = (0.5 * (min + max), 0.5 * (max - min));
        let center = DVec2::new(at_m.x, at_m.z) + turned(middle.x, middle.z);
        Self { center, u: turned(half.x, 0.0), v: turned(0.0, half.z) }
    }

    /// Points around its border, at most 10 cm apart.
    fn border(&self) -> Vec<DVec3> {
        let mut points = Vec::new();
        for (fixed, along) in [(self.u, self.v), (-self.u, self.v), (self.v, self.u), (-self.v, self.u)] {
            let steps = (2.0 * along.length() / 0.1).ceil().max(1.0) as usize;
            points.extend((0..=steps).map(|n| {
                let at = self.center + fixed + along * (2.0 * n as f64 / steps as f64 - 1.0);
                DVec3::new(at.x, 0.0, at.y)
            }));
        }
        points
    }

    /// Whether two rectangles overlap or nearly touch, by separating axes.
    fn overlaps(&self, other: &Self) -> bool {
        let between = other.center - self.center;
        ![self.u, self.v, other.u, other.v].into_iter().any(|axis| {
            let axis = axis.normalize_or(DVec2::X);
            let reach = [self.u, self.v, other.u, other.v].map(|side| side.dot(axis).abs()).iter().sum::<f64>();
            between.dot(axis).abs() > reach + GAP_M
        })
    }

    fn distance_from_center_m(&self) -> f64 {
        let [along, across] = [self.u, self.v].map(|side| {
            let half_m = side.length();
            (self.center.dot(side / half_m.max(1e-9)).abs() - half_m).max(0.0)
        });
        math::hypot(along, across)
    }
}

/// A room that is being furnished.
pub(crate) struct Furnisher<'p> {
    pub plan: &'p FloorPlan,
    pub taken: Vec<Footprint>,
}

impl Furnisher<'_> {
    /// Finds a place for a piece of furniture; `None` if there is none.
    pub fn place(&mut self, furniture: &Furniture, place: Place, draw: &mut Draw) -> Option<WorldObject> {
        let extent = furniture.extent();
        for _ in 0..TRIALS {
            let (at_m, yaw_rad) = match place {
                Place::Ring => ring(draw, -extent.min.z),
                Place::AtWall(gap_m) => self.at_wall(draw, gap_m + extent.max.z, 0.0),
                Place::BeforeWall(center_m) => self.at_wall(draw, center_m, 0.5),
            };
            let footprint = Footprint::new(extent.min, extent.max, at_m, yaw_rad);
            let border = footprint.border();
            let fits = footprint.distance_from_center_m() >= CLEAR_CENTER_M
                && border
                    .iter()
                    .all(|p| self.plan.clearance_m(*p) > 0.005 && self.plan.ceiling_m(p.x) > extent.max.y + 0.02)
                && !self.holds_a_pillar(&footprint)
                && !self.taken.iter().any(|taken| taken.overlaps(&footprint));
            if fits {
                self.taken.push(footprint);
                return Some(furniture.placed(at_m, yaw_rad));
            }
        }
        None
    }

    fn holds_a_pillar(&self, footprint: &Footprint) -> bool {
        self.plan.pillars.iter().any(|pillar| {
            let half = 0.5 * pillar.size();
            let square = Footprint { center: pillar.center(), u: DVec2::X * half.x, v: DVec2::Y * half.y };
            square.overlaps(footprint)
        })
    }

    /// A place with its front to the room, at a distance from a wall.
    fn at_wall(&self, draw: &mut Draw, from_wall_m: f64, turn_rad: f64) -> (DVec3, f64) {
        let walls = self.plan.walls();
        let wall = &walls[(draw.uniform(0.0, walls.len() as f64) as usize).min(walls.len() - 1)];
        let at = wall.from + wall.along() * draw.uniform(0.0, wall.length_m()) + wall.inward() * from_wall_m;
        let yaw_rad = math::atan2(-wall.inward().x, -wall.inward().y);
        let turn_rad = if turn_rad > 0.0 { draw.uniform(-turn_rad, turn_rad) } else { 0.0 };
        (DVec3::new(at.x, 0.0, at.y), yaw_rad + turn_rad)
    }
}

fn ring(draw: &mut Draw, front_m: f64) -> (DVec3, f64) {
    let angle_rad = draw.uniform(0.0, std::f64::consts::TAU);
    let (sin, cos) = math::sin_cos(angle_rad);
    let away_m = draw.uniform(RING_M.0, RING_M.1) + front_m;
    (DVec3::new(sin * away_m, 0.0, cos * away_m), angle_rad + draw.uniform(-0.4, 0.4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn footprints_overlap_only_where_they_do() {
        let half = DVec3::new(0.5, 0.5, 0.2);
        let at = |x: f64, z: f64, yaw: f64| Footprint::new(-half, half, DVec3::new(x, 0.0, z), yaw);
        let first = at(0.0, 0.0, 0.0);
        assert!(first.overlaps(&at(0.9, 0.0, 0.0)) && !first.overlaps(&at(1.1, 0.0, 0.0)));
        assert!(!first.overlaps(&at(0.0, 0.5, 0.0)) && first.overlaps(&at(0.0, 0.5, 1.57)));
        assert!((at(2.0, 0.0, 0.0).distance_from_center_m() - 1.5).abs() < 1e-9);
        assert!((at(2.0, 0.0, std::f64::consts::FRAC_PI_2).distance_from_center_m() - 1.8).abs() < 1e-9);
    }
}
