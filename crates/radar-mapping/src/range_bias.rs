//! Range bias of the module: as set, or from a subsweep that loops the transmitter back to the receiver.

use std::ops::RangeInclusive;

use a121::{Frame, FrameLayout, Profile, SensorConfig, Subsweep};
use num_complex::Complex64;

/// Chip temperatures for which [`range_bias_m`] holds, °C. Source: there.
const TEMPERATURES_C: RangeInclusive<i16> = -25..=44;

/// By how much measured ranges are greater than true ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum RangeBias {
    /// Not set, and no usable loopback has come: nothing is corrected.
    Unknown,
    /// The same for all subsweeps, metres.
    Set(f64),
    /// By the peak of the loopback.
    Loopback { peak_m: f64 },
}

impl RangeBias {
    /// That of a subsweep, metres; `None` when it is not known.
    pub fn of(self, subsweep: &Subsweep) -> Option<f64> {
        match self {
            Self::Unknown => None,
            Self::Set(bias_m) => Some(bias_m),
            Self::Loopback { peak_m } => Some(range_bias_m(peak_m, subsweep)),
        }
    }
}

/// Where the peak of the loopback lies in a frame's mean over its sweeps, metres. `None` when no loopback subsweep was
/// recorded, its peak is not within its points (a single point beside echoes is a reference for the phase), or the chip is too
/// warm or too cold for [`range_bias_m`].
pub(crate) fn loopback_peak_m(config: &SensorConfig, layout: &FrameLayout, frame: &Frame) -> Option<f64> {
    let index = config.subsweeps.iter().position(|subsweep| subsweep.enable_loopback)?;
    if !TEMPERATURES_C.contains(&frame.temperature_c) {
        return None;
    }
    let subsweep = &config.subsweeps[index];
    let mut sums = vec![Complex64::default(); subsweep.num_points as usize];
    for sweep in layout.sweeps(frame)?.filter(|sweep| sweep.subsweep == index) {
        for (sum, sample) in sums.iter_mut().zip(sweep.samples) {
            *sum += Complex64::new(f64::from(sample.re), f64::from(sample.im));
        }
    }
    let amplitudes: Vec<f64> = sums.iter().map(Complex64::norm_sqr).map(f64::sqrt).collect();
    let peak = (0..amplitudes.len()).max_by(|a, b| amplitudes[*a].total_cmp(&amplitudes[*b]))?;
    let [before, at, after] = *amplitudes.get(peak.checked_sub(1)?..peak + 2)? else { return None };
    // The top of the parabola through three points.
    let off = 0.5 * (before - after) / (before - 2.0 * at + after);
    (off.abs() <= 0.5).then(|| subsweep.first_m() + (peak as f64 + off) * subsweep.step_m())
}

/// Measured minus true range of a subsweep, metres, for a loopback whose peak is there. Source: the vendor's offset compensation
/// (acconeer-python-exploration, `get_distance_offset`, −25 to 45 °C).
fn range_bias_m(peak_m: f64, subsweep: &Subsweep) -> f64 {
    let (slope, at_zero_m) = match subsweep.profile {
        Profile::P1 => (0.9188, 0.01782),
        Profile::P2 => (0.5946, 0.01930),
        Profile::P3 => (0.8504, 0.01478),
        Profile::P4 => (1.0035, 0.02307),
        Profile::P5 => (0.9818, 0.00795),
    };
    slope * peak_m + at_zero_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Event, Mapper, MappingSettings};
    use a121::preset;
    use radar_sar::geometry::Pose;
    use radar_simulation::{PlaySession, SensorEffects};

    /// A loopback of these points before the echoes of d16.
    fn with_loopback(start_point: i32, num_points: u32) -> SensorConfig {
        let mut config = preset("d16").unwrap();
        let loopback = Subsweep {
            start_point,
            num_points,
            step_length: 1,
            profile: Profile::P1,
            enable_loopback: true,
            hwaas: 8,
            ..config.subsweeps[0]
        };
        config.subsweeps.insert(0, loopback);
        config
    }

    #[test]
    fn bias_is_that_of_the_simulated_module() {
        for seed in 1..6 {
            let config = with_loopback(-30, 40);
            let play =
                PlaySession { duration_s: 1.0, effects: SensorEffects::MEASURED, ..PlaySession::new(config, seed) };
            let session = play.prepare().unwrap();
            let frame = &session.frames(0..1)[0];
            let config = &play.config;
            let hot = Frame { temperature_c: 60, ..frame.clone() };
            assert_eq!(loopback_peak_m(config, &FrameLayout::of(config), &hot), None);
            let peak_m = loopback_peak_m(config, &FrameLayout::of(config), frame).unwrap();
            let error_m = range_bias_m(peak_m, &config.subsweeps[1]) - session.range_bias_m(1);
            assert!(error_m.abs() < 0.5e-3, "{seed}: {error_m}");

            let mut mapper = Mapper::new(config, &Pose::IDENTITY, &MappingSettings::default());
            assert_eq!(mapper.calibration().range_bias_m, None);
            mapper.push(Event::Frame(frame.clone())).unwrap();
            let of_echoes = mapper.calibration().range_bias_m.unwrap();
            let expected: Vec<f64> = config.subsweeps[1..].iter().map(|it| range_bias_m(peak_m, it)).collect();
            assert_eq!(of_echoes, expected);
        }
    }

    #[test]
    fn bias_that_is_set_comes_before_the_loopback() {
        let config = with_loopback(-30, 40);
        let play = PlaySession { duration_s: 1.0, ..PlaySession::new(config, 1) };
        let frame = &play.prepare().unwrap().frames(0..1)[0];
        let mut settings = MappingSettings::default();
        settings.radar.range_bias_m = Some(4e-3);
        let mut mapper = Mapper::new(&play.config, &Pose::IDENTITY, &settings);
        assert!(loopback_peak_m(&play.config, &FrameLayout::of(&play.config), frame).is_some());
        mapper.push(Event::Frame(frame.clone())).unwrap();
        assert_eq!(mapper.calibration().range_bias_m, Some(vec![4e-3; play.config.subsweeps.len() - 1]));
    }

    #[test]
    fn single_point_and_no_loopback_give_no_bias() {
        for config in [with_loopback(0, 1), preset("d16").unwrap()] {
            let play = PlaySession { duration_s: 1.0, ..PlaySession::new(config, 1) };
            let frame = &play.prepare().unwrap().frames(0..1)[0];
            assert_eq!(loopback_peak_m(&play.config, &FrameLayout::of(&play.config), frame), None);
        }
    }
}
