//! Finds where the tracking frame jumps: one pose is followed by a head that is elsewhere and goes on as before.

use glam::DVec3;

/// Weight of the newest deviation in the usual one. Choice: a mean over a third of a second at 90 poses a second.
const USUAL_GAIN: f64 = 1.0 / 30.0;
/// The usual deviation at the beginning, metres. Choice: that of a jitter of 0.3 mm.
const FIRST_USUAL_M: f64 = 2e-3;
/// A deviation counts at most this many times the usual one when that is updated. Choice: jumps do not hide the next.
const MAX_SHARE: f64 = 3.0;
/// A jump deviates by this many times the usual deviation, and by this much, metres. Choice: 8σ of the jitter; a
/// jump of 1.5 mm, which blurs no image, deviates by 3 mm.
const JUMP_SHARE: f64 = 5.0;
const MIN_JUMP_DEVIATION_M: f64 = 3e-3;
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
    /// The newest poses, seconds and metres, newest last.
    poses: Vec<(f64, DVec3)>,
    /// Deviations of the newest poses; `None` where they cannot be judged.
    deviations_m: [Option<f64>; 3],
    usual_m: f64,
    first_ns: Option<i64>,
}

impl Default for JumpDetector {
    fn default() -> Self {
        Self { poses: Vec::new(), deviations_m: [None; 3], usual_m: FIRST_USUAL_M, first_ns: None }
    }
}

impl JumpDetector {
    /// Adds a pose. Whether the frame jumped between the third and the fourth newest pose, this one included.
    pub fn push(&mut self, time_ns: i64, position_m: DVec3) -> bool {
        let first_ns = *self.first_ns.get_or_insert(time_ns);
        let time_s = time_ns.saturating_sub(first_ns) as f64 * 1e-9;
        let deviation_m = self.deviation_m(time_s, position_m);
        self.deviations_m.rotate_left(1);
        self.deviations_m[2] = deviation_m;
        self.poses.push((time_s, position_m));
        if self.poses.len() > 3 {
            self.poses.remove(0);
        }
        let is_jump = self.is_jump();
        if let Some(deviation_m) = deviation_m {
            self.usual_m += USUAL_GAIN * (deviation_m.min(MAX_SHARE * self.usual_m) - self.usual_m);
        }
        is_jump
    }

    /// After a pose that is none: nothing is judged across it.
    pub fn interrupt(&mut self) {
        self.poses.clear();
        self.deviations_m = [None; 3];
    }

    fn is_jump(&self) -> bool {
        let [Some(before), Some(middle), Some(after)] = self.deviations_m else { return false };
        middle > (JUMP_SHARE * self.usual_m).max(MIN_JUMP_DEVIATION_M) && middle > before && middle > after
    }

    /// Distance from the parabola through the three poses before; where the poses come unevenly, scaled to what their
    /// errors would give if they came evenly.
    fn deviation_m(&self, time_s: f64, position_m: DVec3) -> Option<f64> {
        let [(t0, p0), (t1, p1), (t2, p2)] = *self.poses.as_slice() else { return None };
        let steps = [t1 - t0, t2 - t1, time_s - t2];
        let longest = steps.iter().fold(0.0, |a: f64, b| a.max(*b));
        let shortest = steps.iter().fold(f64::INFINITY, |a: f64, b| a.min(*b));
        // Lagrange's weights of the three poses.
        let weight = |t: f64, u: f64, v: f64| (time_s - u) * (time_s - v) / ((t - u) * (t - v));
        let weights = [weight(t0, t1, t2), weight(t1, t0, t2), weight(t2, t0, t1)];
        let expected_m = p0 * weights[0] + p1 * weights[1] + p2 * weights[2];
        let gain = (1.0 + weights.iter().map(|w| w * w).sum::<f64>()).sqrt();
        let deviation_m = position_m.distance(expected_m) * (EVEN_GAIN / gain);
        (longest <= MAX_UNEVEN * shortest && deviation_m.is_finite()).then_some(deviation_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const STEP_NS: i64 = 8_333_333;

    /// Numbers of the poses after which a jump was found, of 1200 poses of a moving head with jitter, whose stamps are wrong
    /// by this rms in seconds.
    fn jumps(jitter_m: f64, stamp_s: f64, jump: impl Fn(i64) -> DVec3) -> Vec<i64> {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut detector = JumpDetector::default();
        let found = (0..1200).filter(|&n| {
            let t = n as f64 * 8.333e-3;
            let path = DVec3::new((6.0 * t).sin(), 0.3 * (9.0 * t).cos(), (4.0 * t).sin()) * 0.12;
            let noise = DVec3::new(normal(), normal(), normal()) * jitter_m;
            let stamp_error_ns = (normal() * stamp_s * 1e9).clamp(-3e6, 3e6) as i64;
            detector.push(n * STEP_NS + stamp_error_ns, path + noise + jump(n))
        });
        found.collect()
    }

    #[test]
    fn wrong_stamps_hide_few_jumps_and_make_none() {
        let jump = |n: i64| DVec3::new(0.6, -0.8, 0.0) * 20e-3 * (n / 100 % 2) as f64;
        let found = jumps(0.5e-3, 1e-3, jump);
        let right = found.iter().filter(|n| *n % 100 == 2).count();
        assert!(right >= 10 && found.len() <= right + 1, "eleven jumps: {found:?}");
    }

    #[test]
    fn a_jump_is_found_once_and_in_its_place() {
        for (jitter_m, size_m) in [(0.1e-3, 4e-3), (0.3e-3, 10e-3)] {
            let jump = |n: i64| if n >= 700 { DVec3::new(0.6, -0.8, 0.0) * size_m } else { DVec3::ZERO };
            assert_eq!(jumps(jitter_m, 0.0, jump), [702], "{size_m}");
        }
    }

    #[test]
    fn motion_and_jitter_are_no_jumps() {
        assert!(jumps(0.3e-3, 0.0, |_| DVec3::ZERO).is_empty());
        assert!(jumps(0.0, 0.0, |_| DVec3::ZERO).is_empty());
        // One pose that is off is none either: the frame stays.
        let single = |n: i64| if n == 700 { DVec3::Y * 0.001 } else { DVec3::ZERO };
        assert!(jumps(0.3e-3, 0.0, single).is_empty());
    }

    #[test]
    fn nothing_is_judged_across_a_gap() {
        let mut detector = JumpDetector::default();
        let mut push = |n: i64, x: f64| detector.push(n * STEP_NS, DVec3::X * x);
        assert!((0..10).all(|n| !push(n, 0.0)) && (20..30).all(|n| !push(n, 0.5)), "a lost second");
        detector.interrupt();
        assert!((30..40).all(|n| !detector.push(n * STEP_NS, DVec3::ZERO)));
    }
}
