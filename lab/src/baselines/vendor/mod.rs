//! The vendor's obstacle detector (thesis, section 2.5). A robot moves straight ahead at a known
//! speed. Each object appears at its range and its radial velocity, which together with the robot's
//! speed gives the angle to the direction of motion.
//!
//! Sweeps are smoothed over range (`range_filter`) and Fourier transformed over time (`spectrum`).
//! What exceeds the noise of calibration sweeps (`threshold`) is extracted peak by peak (`peaks`)
//! and tracked over updates (`tracks`). The detector needs no poses, and its limits follow from
//! that: one speed per window; only the angle to the direction of motion, not the direction around
//! it; nothing while at rest. Written from a description of the algorithm; comments state where the
//! description leaves a choice.

mod config;
mod peaks;
mod range_filter;
mod spectrum;
mod threshold;
mod tracks;

use std::collections::VecDeque;

use num_complex::{Complex, Complex64};

use range_filter::RangeFilter;
use threshold::Thresholds;
use tracks::Tracks;

use radar_sar::math;

pub use config::{DetectorConfig, Sampling};
pub use peaks::Reflection;
pub use spectrum::RangeVelocity;
pub use tracks::Track;

/// Result for the newest window.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorResult {
    /// Reflections, by falling excess over the threshold.
    pub reflections: Vec<Reflection>,
    /// Tracks, by rising distance.
    pub tracks: Vec<Track>,
    /// The spectrum in which they were found.
    pub spectrum: RangeVelocity,
}

/// The detector: takes sweeps, returns reflections and tracks.
#[derive(Debug, Clone)]
pub struct VendorDetector {
    sampling: Sampling,
    filter: RangeFilter,
    thresholds: Thresholds,
    window: VecDeque<Vec<Complex64>>,
    tracks: Tracks,
}

impl VendorDetector {
    /// Creates a detector, calibrated with sweeps without moving objects, `[sweep][point]`. Sweeps
    /// of another length than the axis are skipped, here and later. Without any valid calibration
    /// sweep, everything is a peak.
    pub fn new(sampling: Sampling, calibration: &[Vec<Complex<i16>>]) -> Self {
        let filter = RangeFilter::new(&sampling);
        let filtered: Vec<_> = calibration.iter().filter_map(|sweep| filter.filtered(sweep)).collect();
        let thresholds = Thresholds::of(&filtered, filter.axis().points, sampling.sweeps);
        Self { sampling, filter, thresholds, window: VecDeque::new(), tracks: Tracks::default() }
    }

    /// Takes the next sweeps, in order and without gaps; returns a result if there is a complete
    /// window.
    pub fn push(&mut self, sweeps: &[Vec<Complex<i16>>]) -> Option<DetectorResult> {
        self.window.extend(sweeps.iter().filter_map(|sweep| self.filter.filtered(sweep)));
        let beyond = self.window.len().saturating_sub(self.sampling.sweeps);
        self.window.drain(..beyond);
        if self.window.len() < self.sampling.sweeps {
            return None;
        }
        let spectrum = RangeVelocity::of(&self.window, self.filter.axis(), self.sampling.sweep_rate_hz);
        let reflections = peaks::merged(peaks::peaks(&spectrum, &self.thresholds, self.sampling.profile));
        let elapsed_s = sweeps.len() as f64 / self.sampling.sweep_rate_hz;
        let tracks = self.tracks.step(&reflections, elapsed_s);
        Some(DetectorResult { reflections, tracks, spectrum })
    }

    /// Nearest and farthest range of the result, metres: the axis without one pulse width at either
    /// end.
    pub fn range_m(&self) -> [f64; 2] {
        [self.filter.axis().first_m, self.filter.axis().last_m()]
    }
}

/// Angle between the robot's direction of motion and an object, from the object's radial velocity
/// and the robot's speed. It defines a cone around the direction of motion, since all directions on
/// it have the same radial velocity. `None` if the object is faster than the robot, or the robot
/// stands.
pub fn cone_angle_rad(velocity_m_per_s: f64, robot_m_per_s: f64) -> Option<f64> {
    let cos = -velocity_m_per_s / robot_m_per_s;
    (robot_m_per_s > 0.0 && cos.abs() <= 1.0).then(|| math::acos(cos))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use radar_sar::{PHASE_RAD_PER_M, envelope};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Rms of the noise in tests, LSB.
    pub const NOISE_RMS: f64 = 50.0;

    /// Sweeps of reflectors, from the signal model. Each has a range at the first sweep (m), a
    /// speed (m/s) and an amplitude (LSB).
    pub fn sweeps(sampling: &Sampling, count: usize, objects: &[(f64, f64, f64)], seed: u64) -> Vec<Vec<Complex<i16>>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = move || -> f64 { StandardNormal.sample(&mut rng) };
        let mut sample = |sweep: usize, point: usize| {
            let mut sum = Complex64::new(noise(), noise()) * (NOISE_RMS / 2f64.sqrt());
            for &(range_m, speed, amplitude) in objects {
                let at_m = range_m + speed * sweep as f64 / sampling.sweep_rate_hz;
                let pulse = envelope(sampling.profile.envelope_fwhm_m(), sampling.axis.range_m(point) - at_m);
                sum += math::from_polar(amplitude * pulse, PHASE_RAD_PER_M * at_m);
            }
            Complex::new(sum.re.round() as i16, sum.im.round() as i16)
        };
        (0..count).map(|sweep| (0..sampling.axis.points).map(|point| sample(sweep, point)).collect()).collect()
    }

    fn detector() -> (VendorDetector, Sampling) {
        let sampling = DetectorConfig::default().sampling();
        (VendorDetector::new(sampling, &sweeps(&sampling, 160, &[], 99)), sampling)
    }

    #[test]
    fn reflector_is_found_at_its_range_and_speed() {
        for (seed, (range_m, speed)) in [(0.3, -0.3), (0.4, 0.21), (0.5, -0.05), (0.35, -0.48)].into_iter().enumerate()
        {
            let (mut detector, sampling) = detector();
            let window = detector.push(&sweeps(&sampling, 16, &[(range_m, speed, 500.0)], seed as u64)).unwrap();
            assert_eq!(window.reflections.len(), 1, "{:?}", window.reflections);
            let found = window.reflections[0];
            let middle_m = range_m + speed * 7.5 / sampling.sweep_rate_hz;
            assert!((found.distance_m - middle_m).abs() < 3e-3, "{found:?} {middle_m}");
            assert!((found.velocity_m_per_s - speed).abs() < 2e-3, "{found:?} {speed}");
        }
    }

    #[test]
    fn noise_gives_few_false_alarms() {
        let (mut detector, sampling) = detector();
        let all = sweeps(&sampling, 16 * 200, &[], 5);
        let windows: Vec<_> = all.chunks(16).filter_map(|sweeps| detector.push(sweeps)).collect();
        let alarms: usize = windows.iter().map(|window| window.reflections.len()).sum();
        // Five standard deviations of complex noise: e^−25 in each of 16 bins at about 20
        // independent ranges.
        assert_eq!((windows.len(), alarms), (200, 0));
    }

    #[test]
    fn reflectors_at_one_range_separate_by_speed_only() {
        let (mut detector, sampling) = detector();
        let apart = sweeps(&sampling, 16, &[(0.4, -0.3, 500.0), (0.4, 0.2, 400.0)], 3);
        let window = detector.push(&apart).unwrap();
        let mut speeds: Vec<f64> = window.reflections.iter().map(|r| r.velocity_m_per_s).collect();
        speeds.sort_by(f64::total_cmp);
        assert!(speeds.len() == 2 && (speeds[0] + 0.3).abs() < 0.01 && (speeds[1] - 0.2).abs() < 0.01, "{speeds:?}");
        let (mut detector, _) = self::detector();
        let alike = sweeps(&sampling, 16, &[(0.4, -0.3, 500.0), (0.43, -0.29, 400.0)], 3);
        assert_eq!(detector.push(&alike).unwrap().reflections.len(), 1);
    }

    #[test]
    fn window_slides_and_skips_sweeps_of_wrong_length() {
        let (mut detector, sampling) = detector();
        let all = sweeps(&sampling, 32, &[(0.45, -0.3, 500.0)], 1);
        assert!(detector.push(&all[..8]).is_none());
        assert!(detector.push(&[vec![Complex::new(0, 0); 3]]).is_none());
        let windows: Vec<_> = all[8..].chunks(8).filter_map(|sweeps| detector.push(sweeps)).collect();
        assert_eq!(windows.len(), 3);
        let track = windows[2].tracks[0];
        assert!(track.detections == 3 && (track.velocity_m_per_s + 0.3).abs() < 0.01, "{track:?}");
    }

    #[test]
    fn cone_angle_is_measured_from_the_direction_of_motion() {
        assert!((cone_angle_rad(-0.15, 0.3).unwrap().to_degrees() - 60.0).abs() < 1e-9);
        assert!((cone_angle_rad(0.3, 0.3).unwrap().to_degrees() - 180.0).abs() < 1e-9);
        assert!(
            [(-0.31, 0.3), (0.0, 0.0), (f64::NAN, 0.3), (0.1, -0.3)]
                .iter()
                .all(|&(v, r)| cone_angle_rad(v, r).is_none())
        );
    }
}
