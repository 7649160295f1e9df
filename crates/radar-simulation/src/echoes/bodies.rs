//! Moving bodies: people and animals as chains of capsules, each with a cloud of points on its skin. The
//! points move with the limbs, so their sum fluctuates as a body's echo does.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use radar_sar::math;

/// A limb of a body's shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Limb {
    /// Indices of the joints at its ends.
    pub joints: [usize; 2],
    /// Its radius, metres.
    pub radius_m: f64,
    /// Mean radar cross-section of its visible side, dBsm.
    pub rcs_dbsm: f64,
    /// Number of points on its skin.
    pub points: usize,
    /// Whether it shadows what is behind it.
    pub shadows: bool,
}

/// A point on a limb.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SkinPoint {
    limb: usize,
    /// Share of the way from the first joint to the second one.
    along: f64,
    /// Angle about the limb, as a vector across it.
    across: DVec3,
    root_sigma_m: f64,
    phase_rad: f64,
}

/// A body's shape: its limbs and the points on them, without its posture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BodyShape {
    limbs: Vec<Limb>,
    points: Vec<SkinPoint>,
}

impl BodyShape {
    /// From limbs; the seed places the points.
    pub fn new(limbs: &[Limb], seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xB0D1_E5E5);
        let mut points = Vec::new();
        for (index, limb) in limbs.iter().enumerate() {
            // Of points evenly around, half are visible, with a mean cos² of ½: a quarter of their sum.
            let sigma_m2 = math::powf(10f64, limb.rcs_dbsm / 10.0) * 4.0 / limb.points as f64;
            for n in 0..limb.points {
                // The golden angle spreads them evenly over the surface.
                let angle_rad = 2.399_963 * n as f64 + rng.random_range(-0.3..0.3);
                let (sin, cos) = math::sin_cos(angle_rad);
                points.push(SkinPoint {
                    limb: index,
                    along: (n as f64 + rng.random_range(0.1..0.9)) / limb.points as f64,
                    across: DVec3::new(cos, 0.0, sin),
                    root_sigma_m: sigma_m2.sqrt(),
                    phase_rad: rng.random_range(0.0..TAU),
                });
            }
        }
        Self { limbs: limbs.to_vec(), points }
    }
}

/// Positions of a body's joints at one time, and the horizontal direction that it faces.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Posture {
    pub joints_m: Vec<DVec3>,
    pub facing: DVec3,
}

/// A limb at the first, middle and last time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MovingLimb {
    /// Both ends in the middle, metres.
    pub ends_m: [DVec3; 2],
    pub radius_m: f64,
    pub shadows: bool,
    pub max_root_sigma_m: f64,
    pub points: std::ops::Range<usize>,
}

/// A point that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MovingPoint {
    pub at_m: [DVec3; 3],
    /// Unit normal of the skin in the middle.
    pub normal: DVec3,
    pub root_sigma_m: f64,
    pub phase_rad: f64,
}

/// Bodies that move, at the first, middle and last time of a frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct MovingBodies {
    pub(super) limbs: Vec<MovingLimb>,
    pub(super) points: Vec<MovingPoint>,
}

impl MovingBodies {
    /// Adds a body in its postures at the three times.
    pub fn add(&mut self, shape: &BodyShape, postures: &[Posture; 3]) {
        let mut next = 0;
        for (index, limb) in shape.limbs.iter().enumerate() {
            let ends = postures.each_ref().map(|posture| limb.joints.map(|joint| posture.joints_m[joint]));
            let turns = [0, 1, 2].map(|time| across_from_limb(ends[time], postures[time].facing));
            let first = self.points.len();
            while let Some(skin) = shape.points.get(next).filter(|skin| skin.limb == index) {
                let at = |time: usize| {
                    let [from, to]: [DVec3; 2] = ends[time];
                    from.lerp(to, skin.along) + turns[time] * skin.across * limb.radius_m
                };
                self.points.push(MovingPoint {
                    at_m: [at(0), at(1), at(2)],
                    normal: turns[1] * skin.across,
                    root_sigma_m: skin.root_sigma_m,
                    phase_rad: skin.phase_rad,
                });
                next += 1;
            }
            self.limbs.push(MovingLimb {
                ends_m: ends[1],
                radius_m: limb.radius_m,
                shadows: limb.shadows,
                max_root_sigma_m: self.points[first..].iter().map(|p| p.root_sigma_m).fold(0.0, f64::max),
                points: first..self.points.len(),
            });
        }
    }

    /// Positions of all points in the middle, metres.
    #[cfg(test)]
    pub fn positions_m(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.points.iter().map(|point| point.at_m[1])
    }
}

/// Rotation from a limb that hangs down, with the body facing −z, to where it is. It does not turn about the
/// limb as the limb moves, except near straight up.
fn across_from_limb([from, to]: [DVec3; 2], facing: DVec3) -> DQuat {
    let turn = DQuat::from_rotation_y(math::atan2(-facing.x, -facing.z));
    let axis = turn.inverse() * (to - from).normalize_or(DVec3::NEG_Y);
    turn * DQuat::from_rotation_arc(DVec3::NEG_Y, axis)
}

#[cfg(test)]
mod tests {
    use super::super::postures::{Walk, cat_shape, person_shape, walking_person};
    use super::*;
    use num_complex::Complex64;

    fn power(bodies: &MovingBodies, points: impl Iterator<Item = usize>, sensor_m: DVec3) -> f64 {
        let field: Complex64 = points
            .map(|n| {
                let point = &bodies.points[n];
                let to = sensor_m - point.at_m[1];
                let amplitude = point.root_sigma_m * point.normal.dot(to.normalize()).max(0.0);
                math::from_polar(amplitude, radar_sar::PHASE_RAD_PER_M * to.length() + point.phase_rad)
            })
            .sum();
        field.norm_sqr()
    }

    fn standing(seed: u64) -> MovingBodies {
        let mut bodies = MovingBodies::default();
        let walk = Walk { at_m: DVec3::NEG_Z * 1.8, facing: DVec3::Z, stride_phase_rad: 0.3, stride: 0.0 };
        let posture = walking_person(&walk);
        bodies.add(&person_shape(seed), &[posture.clone(), posture.clone(), posture]);
        bodies
    }

    #[test]
    fn chest_has_the_measured_cross_section_and_fluctuates() {
        let mut powers = Vec::new();
        for seed in 0..20 {
            let bodies = standing(seed);
            // The chest is the first limb.
            let chest = bodies.limbs[0].points.clone();
            for n in 0..50 {
                let sensor = DVec3::new(0.01 * f64::from(n % 7), 1.35 + 0.003 * f64::from(n), 0.0);
                powers.push(10.0 * power(&bodies, chest.clone(), sensor).log10());
            }
        }
        powers.sort_by(f64::total_cmp);
        let quantile = |q: f64| powers[(q * powers.len() as f64) as usize];
        // Measured at 1.8 to 2.7 m: median −11 to −20 dBsm, 95 % −7.5 to −16.
        assert!((-20.0..-11.0).contains(&quantile(0.5)), "{}", quantile(0.5));
        assert!((-16.0..-7.5).contains(&quantile(0.95)), "{}", quantile(0.95));
        assert!(quantile(0.5) - quantile(0.05) > 6.0);
    }

    #[test]
    fn cat_is_small_and_weak() {
        let mut bodies = MovingBodies::default();
        let posture = super::super::postures::walking_cat(DVec3::NEG_Z, DVec3::X, 0.4);
        bodies.add(&cat_shape(3), &[posture.clone(), posture.clone(), posture]);
        let highest = bodies.positions_m().map(|p| p.y).fold(0.0, f64::max);
        assert!((0.2..0.4).contains(&highest), "{highest}");
        let mean = (0..50)
            .map(|n| power(&bodies, 0..bodies.points.len(), DVec3::Y * (1.0 + 0.01 * f64::from(n))))
            .sum::<f64>()
            / 50.0;
        assert!((-27.0..-14.0).contains(&(10.0 * mean.log10())), "{}", 10.0 * mean.log10());
    }

    #[test]
    fn points_move_smoothly_with_a_walk() {
        let shape = person_shape(1);
        let at = |t: f64| {
            let at_m = DVec3::new(0.0, 0.0, t);
            walking_person(&Walk { at_m, facing: DVec3::Z, stride_phase_rad: TAU * 0.9 * t, stride: 1.0 })
        };
        for n in 0..200 {
            let t = 0.011 * f64::from(n);
            let mut bodies = MovingBodies::default();
            bodies.add(&shape, &[at(t), at(t + 0.005), at(t + 0.01)]);
            for point in &bodies.points {
                let steps = [point.at_m[0].distance(point.at_m[1]), point.at_m[1].distance(point.at_m[2])];
                assert!(steps.iter().all(|s| *s < 0.03), "{steps:?} at {t}");
            }
        }
    }
}
