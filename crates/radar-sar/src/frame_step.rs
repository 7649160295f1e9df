//! By how much the tracking frame jumped at some pose: the step that makes the head's motion smooth.
//!
//! The head moves as a polynomial of time over a tenth of a second; a jump adds a step to all poses after it, a single bad pose
//! adds to one. All of these are fitted to position and rotation by least squares, and what explains most is taken, if it
//! stands out from what is left.

use glam::{DQuat, DVec3};

use crate::geometry::{Pose, rotation_vector};

/// Poses from which on the motion is a cubic, otherwise a parabola. Choice: five unknowns with the step, and as many poses
/// left over.
const CUBIC_FROM: usize = 9;
/// What is taken explains this much of the squared deviations, in variances of a pose. Measured (`lab --example jumps`): half
/// of it makes false jumps where stamps are wrong.
const MIN_EXPLAINED: f64 = 80.0;
/// Least information on a step, in poses. Choice: 1σ of at most five times a pose's.
const MIN_INFORMATION: f64 = 0.04;
/// Least 1σ of a pose, metres and radians. Choice: a smooth motion is no cubic to the last micrometre.
const MIN_SIGMAS: [f64; 2] = [0.05e-3, 0.05e-3];
/// Poses on either side of the supposed place that may be the bad one, and places that the jump may be off. Choice: noise moves
/// the greatest deviation by one.
const SUSPECTS: usize = 2;
const OFF: usize = 1;
/// Least poses on either side of a jump. Choice: a jump is followed by a path.
const MIN_RUN: usize = 3;
/// How often the rotation is fitted. Choice: rotations do not add; with a step of 5° and a head that turns by 20° the first
/// fit is off by 1°, the third by less than 0.01°.
const FITS: usize = 3;

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum FrameStep {
    /// The frame jumped before the pose of this number.
    Jump { first_after: usize, before_from_after: Pose },
    /// The pose of this number is off; the frame stayed.
    BadPose(usize),
    /// Nothing that stands out from the noise of the poses.
    Nothing,
}

/// Looks for a jump of the frame before pose `near`, or one pose farther. `poses`: with their times in seconds, relative to
/// about the middle one.
pub(crate) fn frame_step(poses: &[(f64, Pose)], near: usize) -> FrameStep {
    let Some((_, reference)) = poses.get(near).copied() else { return FrameStep::Nothing };
    let motion = Motion::over(poses);
    let positions_m = poses.iter().map(|(_, pose)| pose.translation - reference.translation).collect();
    let turns_rad =
        poses.iter().map(|(_, pose)| rotation_vector(pose.rotation * reference.rotation.conjugate())).collect();
    let within = |first: usize, last: usize, least: usize| {
        first.max(least)..(last + 1).min((poses.len() + 1).saturating_sub(least))
    };
    let jumps = within(near.saturating_sub(OFF), near + OFF, MIN_RUN);
    let jumps = jumps.map(|n| (Cause::Jump(n), motion.residual_of(|at| at >= n)));
    let bad = within(near.saturating_sub(SUSPECTS), near + SUSPECTS - 1, 1);
    let bad = bad.map(|n| (Cause::BadPose(n), motion.residual_of(|at| at == n)));
    let causes: Vec<(Cause, Residual)> =
        jumps.chain(bad).filter(|(_, residual)| residual.power() >= MIN_INFORMATION).collect();
    let mut shares = vec![0.0; causes.len()];
    for (values, min_sigma) in [(positions_m, MIN_SIGMAS[0]), (turns_rad, MIN_SIGMAS[1])] {
        for (part, dimensions) in motion.along_and_across(values) {
            let explained: Vec<f64> = causes.iter().map(|(_, residual)| residual.explained(&part)).collect();
            // What the best of them leaves is the noise of the poses.
            let most = explained.iter().fold(0.0f64, |most, explained| most.max(*explained));
            let freedom = dimensions * (poses.len() as f64 - motion.0.len() as f64 - 1.0).max(1.0);
            let variance = ((motion.power_left(&part) - most) / freedom).max(min_sigma * min_sigma);
            shares.iter_mut().zip(explained).for_each(|(share, explained)| *share += explained / variance);
        }
    }
    let best = (0..causes.len()).max_by(|&a, &b| shares[a].total_cmp(&shares[b]));
    let Some(best) = best.filter(|&n| shares[n] >= MIN_EXPLAINED && shares[n].is_finite()) else {
        return FrameStep::Nothing;
    };
    match causes[best].0 {
        Cause::BadPose(n) => FrameStep::BadPose(n),
        Cause::Jump(first_after) => {
            FrameStep::Jump { first_after, before_from_after: before_from_after(poses, first_after, &causes[best].1) }
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Cause {
    Jump(usize),
    BadPose(usize),
}

/// The jump that makes the path smooth.
fn before_from_after(poses: &[(f64, Pose)], first_after: usize, step: &Residual) -> Pose {
    let reference = poses[first_after].1;
    let mut rotation = DQuat::IDENTITY;
    for _ in 0..FITS {
        let turn = |(n, (_, pose)): (usize, &(f64, Pose))| {
            let turned = if n < first_after { pose.rotation } else { rotation * pose.rotation };
            rotation_vector(turned * reference.rotation.conjugate())
        };
        let left_rad = step.size(&poses.iter().enumerate().map(turn).collect::<Vec<_>>());
        rotation = (DQuat::from_scaled_axis(-left_rad) * rotation).normalize();
    }
    let position = |(n, (_, pose)): (usize, &(f64, Pose))| {
        let from_reference_m = pose.translation - reference.translation;
        if n < first_after { from_reference_m } else { rotation * from_reference_m }
    };
    let off_m = step.size(&poses.iter().enumerate().map(position).collect::<Vec<_>>());
    Pose::new(reference.translation - off_m - rotation * reference.translation, rotation)
}

/// A tracker that loses its references goes on by acceleration alone: it strays by half the error of the acceleration times the
/// square of the time, and returns with a jump that ends the error of its speed as well. Such a jump is no jump of the frame. It has at
/// least this size, metres, and change of speed, metres a second, and ends an excursion of at most this length, seconds. Choices: less
/// hurts no map; what the speed is uncertain by is a third of that; longer, what was mapped meanwhile is displaced as well.
const MIN_RETURN_M: f64 = 0.05;
const MIN_RETURN_M_PER_S: f64 = 0.15;
const MAX_EXCURSION_S: f64 = 1.5;
/// Cosine of the angle between the jump and the change of speed, at least. Choice: 37°, a tenth of all directions by chance.
const MIN_RETURN_COS: f64 = 0.8;

/// For how long a tracker without references had strayed, seconds, if a jump by `jump_m` with this change of velocity is its return: it
/// strayed with constant acceleration, so that the jump ends twice the mean speed. `None` otherwise: less than 5 cm or 0.15 m/s,
/// longer than 1.5 s, or not along each other.
pub fn strayed_s(jump_m: DVec3, change_m_per_s: DVec3) -> Option<f64> {
    let size_m = jump_m.length();
    let along_m_per_s = change_m_per_s.dot(jump_m) / size_m;
    let passed_s = 2.0 * size_m / along_m_per_s;
    let is_return = size_m >= MIN_RETURN_M
        && along_m_per_s >= MIN_RETURN_M_PER_S
        && along_m_per_s >= MIN_RETURN_COS * change_m_per_s.length()
        && passed_s <= MAX_EXCURSION_S;
    is_return.then_some(passed_s)
}

/// By how much the velocity changes at pose `first_after`, metres a second, beside a step. `poses`: those after a jump as they are
/// without it, with their times in seconds.
pub(crate) fn velocity_step(poses: &[(f64, Pose)], first_after: usize) -> Option<DVec3> {
    let (since_s, reference) = poses.get(first_after).copied()?;
    let motion = Motion::over(poses);
    let step = motion.residual_of(|at| at >= first_after);
    let ramp = poses.iter().map(|(at_s, _)| (at_s - since_s).max(0.0)).collect();
    let mut ramp = motion.residual(ramp);
    let along = dot(&ramp.0, &step.0) / step.power();
    ramp.0.iter_mut().zip(&step.0).for_each(|(value, step)| *value -= along * step);
    let positions_m: Vec<DVec3> = poses.iter().map(|(_, pose)| pose.translation - reference.translation).collect();
    Some(ramp.size(&positions_m)).filter(|change| change.is_finite())
}

/// Polynomials over the times of poses, orthonormal.
struct Motion(Vec<Vec<f64>>);

/// What is left of a function of the poses' numbers when the motion is taken out.
struct Residual(Vec<f64>);

impl Motion {
    fn over(poses: &[(f64, Pose)]) -> Self {
        let longest_s = poses.iter().fold(f64::MIN_POSITIVE, |longest, (at_s, _)| longest.max(at_s.abs()));
        let terms = if poses.len() >= CUBIC_FROM { 4 } else { 3 };
        let mut motion = Self(Vec::new());
        let mut powers = vec![1.0; poses.len()];
        for _ in 0..terms {
            let Residual(mut term) = motion.residual(powers.clone());
            powers.iter_mut().zip(poses).for_each(|(power, (at_s, _))| *power *= at_s / longest_s);
            let length = dot(&term, &term).sqrt();
            // Times that coincide have no further term.
            if length > 1e-9 {
                term.iter_mut().for_each(|value| *value /= length);
                motion.0.push(term);
            }
        }
        motion
    }

    fn residual(&self, mut values: Vec<f64>) -> Residual {
        for term in &self.0 {
            let along = dot(term, &values);
            values.iter_mut().zip(term).for_each(|(value, basis)| *value -= along * basis);
        }
        Residual(values)
    }

    /// Of a function that is 1 where something is added to the pose of a number.
    fn residual_of(&self, is_added: impl Fn(usize) -> bool) -> Residual {
        let poses = self.0.first().map_or(0, Vec::len);
        self.residual((0..poses).map(|n| f64::from(u8::from(is_added(n)))).collect())
    }

    /// Values parted by the direction of the motion, along which wrong stamps make errors, and across it, with the number of
    /// dimensions of each.
    fn along_and_across(&self, values: Vec<DVec3>) -> [(Vec<DVec3>, f64); 2] {
        let speed =
            self.0.get(1).map_or(DVec3::ZERO, |linear| values.iter().zip(linear).map(|(v, basis)| *v * *basis).sum());
        let direction = speed.normalize_or(DVec3::X);
        let along: Vec<DVec3> = values.iter().map(|value| direction * direction.dot(*value)).collect();
        let across = values.iter().zip(&along).map(|(value, along)| *value - *along).collect();
        [(along, 1.0), (across, 2.0)]
    }

    /// Sum of the squares of what the motion does not explain.
    fn power_left(&self, values: &[DVec3]) -> f64 {
        let axis = |of: fn(&DVec3) -> f64| self.residual(values.iter().map(of).collect()).power();
        axis(|value| value.x) + axis(|value| value.y) + axis(|value| value.z)
    }
}

impl Residual {
    fn power(&self) -> f64 {
        dot(&self.0, &self.0)
    }

    /// Least-squares size of this function in values.
    fn size(&self, values: &[DVec3]) -> DVec3 {
        values.iter().zip(&self.0).map(|(value, residual)| *value * *residual).sum::<DVec3>() / self.power()
    }

    /// By how much it lowers the sum of the squares.
    fn explained(&self, values: &[DVec3]) -> f64 {
        self.size(values).length_squared() * self.power()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const STEP_S: f64 = 8.333e-3;
    const POSES: usize = 6;

    /// A head that moves and turns briskly.
    fn head(t: f64) -> Pose {
        let position =
            DVec3::new((6.0 * t).sin(), 0.3 * (9.0 * t).cos(), (4.0 * t).sin()) * 0.12 + DVec3::new(2.0, 1.6, -1.0);
        Pose::new(position, DQuat::from_scaled_axis(DVec3::new(0.2 * (5.0 * t).sin(), 2.0 * t, 0.1 * (8.0 * t).sin())))
    }

    /// Poses around a jump before pose `POSES`.
    fn path(start_s: f64, after_from_before: &Pose, mut noise_m: impl FnMut() -> DVec3) -> Vec<(f64, Pose)> {
        let mut noisy = |n: usize| {
            let frame = if n < POSES { Pose::IDENTITY } else { *after_from_before };
            let since_s = (n as f64 - POSES as f64) * STEP_S;
            let pose = frame * head(start_s + since_s);
            (since_s, Pose { translation: pose.translation + noise_m(), ..pose })
        };
        (0..2 * POSES).map(&mut noisy).collect()
    }

    #[test]
    fn a_jump_is_measured_within_the_noise_of_a_few_poses() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let sigma_m = 0.3e-3;
        let jump = Pose::new(DVec3::new(0.08, -0.03, 0.05), DQuat::from_scaled_axis(DVec3::new(0.03, 0.07, -0.04)));
        let mut off_m2 = 0.0;
        for n in 0..200 {
            let at_s = f64::from(n) * 0.137;
            let poses = path(at_s, &jump, || DVec3::new(normal(), normal(), normal()) * sigma_m);
            // The place may be off by one.
            let step = frame_step(&poses, POSES - 1 + n as usize % 3);
            let FrameStep::Jump { first_after: POSES, before_from_after } = step else {
                panic!("{step:?} at {at_s} s")
            };
            let followed = before_from_after * jump * head(at_s);
            off_m2 += followed.translation.distance_squared(head(at_s).translation) / 200.0;
            assert!(followed.rotation.angle_between(head(at_s).rotation) < 0.05f64.to_radians(), "{n}");
        }
        // √3 axes times 1.8 poses' noise of a step beside a cubic.
        assert!((0.5e-3..1.2e-3).contains(&off_m2.sqrt()), "{}", off_m2.sqrt());
    }

    #[test]
    fn a_bad_pose_and_a_smooth_path_are_no_jumps() {
        let mut poses = path(0.4, &Pose::IDENTITY, || DVec3::ZERO);
        assert_eq!(frame_step(&poses, POSES), FrameStep::Nothing);
        poses[POSES + 1].1.translation += DVec3::new(0.0, 0.02, 0.01);
        assert_eq!(frame_step(&poses, POSES), FrameStep::BadPose(POSES + 1));
        poses[POSES + 1].1.translation -= DVec3::new(0.0, 0.02, 0.01);
        poses[POSES - 1].1.rotation = DQuat::from_rotation_x(0.05) * poses[POSES - 1].1.rotation;
        assert_eq!(frame_step(&poses, POSES), FrameStep::BadPose(POSES - 1));
        for few in 0..3 {
            assert_eq!(frame_step(&poses[..few], 1), FrameStep::Nothing);
        }
    }

    #[test]
    fn a_change_of_velocity_is_measured_beside_a_step() {
        let change = DVec3::new(0.4, -0.2, 0.1);
        for n in 0..50 {
            let start_s = f64::from(n) * 0.137;
            let at = |n: i32| {
                let since_s = f64::from(n - 24) * STEP_S;
                let pose = head(start_s + since_s);
                let added = if n < 24 { DVec3::ZERO } else { DVec3::new(0.3, 0.1, 0.0) + change * since_s };
                (since_s, Pose { translation: pose.translation + added, ..pose })
            };
            let found = velocity_step(&(0..30).map(at).collect::<Vec<_>>(), 24).unwrap();
            assert!(found.distance(change) < 0.08, "{found} at {start_s} s");
        }
        assert_eq!(velocity_step(&[], 0), None);
    }

    #[test]
    fn numbers_that_are_none_give_nothing() {
        let mut poses = path(0.4, &Pose::IDENTITY, || DVec3::ZERO);
        poses[2].1.translation.x = f64::NAN;
        assert_eq!(frame_step(&poses, POSES), FrameStep::Nothing);
        let same: Vec<(f64, Pose)> = path(0.4, &Pose::IDENTITY, || DVec3::ZERO).iter().map(|at| (0.0, at.1)).collect();
        assert_ne!(frame_step(&same, POSES), FrameStep::BadPose(0));
    }
}
