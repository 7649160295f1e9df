//! Finds where the tracking frame may have jumped: one pose is followed by a head that is elsewhere, or faces elsewhere, and
//! goes on as before. Whether it did, `frame_step` decides when more poses are known.

use glam::DVec3;

use crate::geometry::{Pose, rotation_vector};

/// Weight of the newest deviation in the usual one. Choice: a mean over a third of a second at 90 poses a second.
const USUAL_GAIN: f64 = 1.0 / 30.0;
/// A deviation counts at most this many times the usual one when that is updated. Choice: jumps do not hide the next.
const MAX_SHARE: f64 = 3.0;
/// A jump deviates by this many times the usual deviation. Choice: 4σ of the jitter, which finds jumps of seven times the
/// jitter; what is none is recognised later.
const JUMP_SHARE: f64 = 2.5;
/// Least deviations of a jump, metres and radians. Choice: a jump of 1.5 mm, which blurs no image, deviates by 3 mm; one of
/// 0.1°, which moves a sensor on a headset by 0.2 mm and an object at 2 m by 3 mm, by 0.2°.
const MIN_DEVIATION_M: f64 = 3e-3;
const MIN_DEVIATION_RAD: f64 = 3.5e-3;
/// The usual deviations at the beginning. Choice: those of a jitter of 0.3 mm and of 0.02°.
const FIRST_USUAL_M: f64 = 2e-3;
const FIRST_USUAL_RAD: f64 = 2e-3;
/// Poses whose distances in time differ by more than this factor are not judged. Choice: a lost pose doubles one, and stamps
/// that are wrong by 1 ms rms leave few pairs beyond.
const MAX_UNEVEN: f64 = 4.0;
/// By how much a deviation exceeds the error of a pose when the poses come evenly: √(1 + 3² + 3² + 1²).
const EVEN_GAIN: f64 = 4.472;

/// Watches poses in rising time.
///
/// The deviation of a pose is from the parabola through the three before it. A jump of J before pose n deviates by J at
/// pose n, by −2J at the next and by J at the one after: the middle one is the greatest and marks the place.
#[derive(Debug, Clone)]
pub(crate) struct JumpDetector {
    /// The newest poses and their times, seconds, newest last.
    poses: Vec<(f64, Pose)>,
    positions: Deviations,
    rotations: Deviations,
    first_ns: Option<i64>,
}

/// Deviations of one quantity.
#[derive(Debug, Clone)]
struct Deviations {
    /// Of the newest poses; `None` where they cannot be judged.
    newest: [Option<f64>; 3],
    usual: f64,
    least: f64,
}

impl Default for JumpDetector {
    fn default() -> Self {
        Self {
            poses: Vec::new(),
            positions: Deviations::new(FIRST_USUAL_M, MIN_DEVIATION_M),
            rotations: Deviations::new(FIRST_USUAL_RAD, MIN_DEVIATION_RAD),
            first_ns: None,
        }
    }
}

impl JumpDetector {
    /// Adds a pose. Whether the frame jumped between the third and the fourth newest pose, this one included.
    pub fn push(&mut self, time_ns: i64, pose: &Pose) -> bool {
        let first_ns = *self.first_ns.get_or_insert(time_ns);
        let time_s = time_ns.saturating_sub(first_ns) as f64 * 1e-9;
        let [position_m, rotation_rad] = self.deviations(time_s, pose).map_or([None; 2], |found| found.map(Some));
        let jumped = [self.positions.push(position_m), self.rotations.push(rotation_rad)];
        self.poses.push((time_s, *pose));
        if self.poses.len() > 3 {
            self.poses.remove(0);
        }
        jumped.contains(&true)
    }

    /// After a pose that is none: nothing is judged across it.
    pub fn interrupt(&mut self) {
        self.poses.clear();
        self.positions.newest = [None; 3];
        self.rotations.newest = [None; 3];
    }

    /// Distance and angle from the parabola through the three poses before; where the poses come unevenly, scaled to what
    /// their errors would give if they came evenly.
    fn deviations(&self, time_s: f64, pose: &Pose) -> Option<[f64; 2]> {
        let [(t0, p0), (t1, p1), (t2, p2)] = *self.poses.as_slice() else { return None };
        let steps = [t1 - t0, t2 - t1, time_s - t2];
        let longest = steps.iter().fold(0.0, |a: f64, b| a.max(*b));
        let shortest = steps.iter().fold(f64::INFINITY, |a: f64, b| a.min(*b));
        // Lagrange's weights of the three poses.
        let weight = |t: f64, u: f64, v: f64| (time_s - u) * (time_s - v) / ((t - u) * (t - v));
        let weights = [weight(t0, t1, t2), weight(t1, t0, t2), weight(t2, t0, t1)];
        let gain = EVEN_GAIN / (1.0 + weights.iter().map(|w| w * w).sum::<f64>()).sqrt();
        let from_expected = |of: &dyn Fn(&Pose) -> DVec3| {
            let expected = of(&p0) * weights[0] + of(&p1) * weights[1] + of(&p2) * weights[2];
            of(pose).distance(expected) * gain
        };
        let turned = |at: &Pose| rotation_vector(at.rotation * p2.rotation.conjugate());
        let found = [from_expected(&|at| at.translation), from_expected(&turned)];
        (longest <= MAX_UNEVEN * shortest && found.iter().all(|deviation| deviation.is_finite())).then_some(found)
    }
}

impl Deviations {
    fn new(usual: f64, least: f64) -> Self {
        Self { newest: [None; 3], usual, least }
    }

    /// Whether the middle one of the newest three marks a jump.
    fn push(&mut self, deviation: Option<f64>) -> bool {
        self.newest.rotate_left(1);
        self.newest[2] = deviation;
        let is_jump = self.is_jump();
        if let Some(deviation) = deviation {
            self.usual += USUAL_GAIN * (deviation.min(MAX_SHARE * self.usual) - self.usual);
        }
        is_jump
    }

    fn is_jump(&self) -> bool {
        let [Some(before), Some(middle), Some(after)] = self.newest else { return false };
        middle > (JUMP_SHARE * self.usual).max(self.least) && middle > before && middle > after
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const STEP_NS: i64 = 8_333_333;

    /// Numbers of the poses after which a jump was found, of 1200 poses of a moving head with jitter, whose stamps are wrong
    /// by this rms in seconds. `jump`: of the frame, metres and rotation vector.
    fn jumps(jitter_m: f64, stamp_s: f64, jump: impl Fn(i64) -> [DVec3; 2]) -> Vec<i64> {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut detector = JumpDetector::default();
        let found = (0..1200).filter(|&n| {
            let t = n as f64 * 8.333e-3;
            let path = DVec3::new((6.0 * t).sin(), 0.3 * (9.0 * t).cos(), (4.0 * t).sin()) * 0.12;
            let turn = DVec3::new(0.2 * (5.0 * t).sin(), 0.6 * (3.0 * t).cos(), 0.1 * (8.0 * t).sin());
            let noise = DVec3::new(normal(), normal(), normal()) * jitter_m;
            let stamp_error_ns = (normal() * stamp_s * 1e9).clamp(-3e6, 3e6) as i64;
            let [jump_m, jump_rad] = jump(n);
            let rotation = DQuat::from_scaled_axis(jump_rad) * DQuat::from_scaled_axis(turn);
            detector.push(n * STEP_NS + stamp_error_ns, &Pose::new(path + noise + jump_m, rotation))
        });
        found.collect()
    }

    #[test]
    fn wrong_stamps_hide_few_jumps() {
        let jump = |n: i64| [DVec3::new(0.6, -0.8, 0.0) * 20e-3 * (n / 100 % 2) as f64, DVec3::ZERO];
        let found = jumps(0.5e-3, 1e-3, jump);
        let right = found.iter().filter(|n| *n % 100 == 2).count();
        assert!(
            right >= 10 && found.len() <= 80,
            "eleven jumps, and a wrong stamp every {}th pose",
            1200 / found.len()
        );
    }

    #[test]
    fn a_jump_is_found_once_and_in_its_place() {
        for (jitter_m, size_m, size_rad) in
            [(0.1e-3, 4e-3, 0.0), (0.3e-3, 10e-3, 0.0), (0.3e-3, 0.0, 0.5f64.to_radians())]
        {
            let size = [DVec3::new(0.6, -0.8, 0.0) * size_m, DVec3::new(0.0, 0.8, 0.6) * size_rad];
            let jump = |n: i64| if n >= 700 { size } else { [DVec3::ZERO; 2] };
            let found = jumps(jitter_m, 0.0, jump);
            let here = found.iter().filter(|n| (690..710).contains(*n)).collect::<Vec<_>>();
            assert!(here == [&702] && found.len() <= 3, "{size_m} m {size_rad} rad: {found:?}");
        }
    }

    #[test]
    fn motion_is_no_jump_and_jitter_rarely() {
        let none = |_| [DVec3::ZERO; 2];
        assert!(jumps(0.0, 0.0, none).is_empty());
        assert!(jumps(0.3e-3, 0.0, none).len() <= 3);
    }

    #[test]
    fn nothing_is_judged_across_a_gap() {
        let mut detector = JumpDetector::default();
        let mut push = |n: i64, x: f64| detector.push(n * STEP_NS, &Pose::from_translation(DVec3::X * x));
        assert!((0..10).all(|n| !push(n, 0.0)) && (20..30).all(|n| !push(n, 0.5)), "a lost second");
        detector.interrupt();
        let at_origin = Pose::IDENTITY;
        assert!((30..40).all(|n| !detector.push(n * STEP_NS, &at_origin)));
    }
}
