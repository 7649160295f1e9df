//! Raw frames of the sensor, and their sweeps.

use num_complex::Complex;

use super::{FrameTiming, SensorConfig, frame_timing};

/// One raw frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Sensor tick at the END of the measurement, unwrapped to 64 bits.
    pub tick: i64,
    /// The measurement's end on the host's monotonic clock, nanoseconds.
    pub host_time_ns: i64,
    /// Chip temperature, °C.
    pub temperature_c: i16,
    /// Whether a sample hit the limit of the converter.
    pub data_saturated: bool,
    /// Whether the sensor could not keep its rate.
    pub frame_delayed: bool,
    /// Whether the sensor requests a calibration.
    pub calibration_needed: bool,
    /// Complex samples in LSB, `[sweep][point]`, subsweeps concatenated inside each sweep.
    pub samples: Vec<Complex<i16>>,
}

/// One subsweep of one sweep of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sweep<'a> {
    /// Index of the subsweep in the configuration.
    pub subsweep: usize,
    /// When its first point was measured, host nanoseconds.
    pub first_point_time_ns: i64,
    /// Time between points, seconds.
    pub point_period_s: f64,
    /// Its samples, by rising range.
    pub samples: &'a [Complex<i16>],
}

/// Layout and timing of the frames of a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameLayout {
    timing: FrameTiming,
    sweeps_per_frame: usize,
    subsweep_points: Vec<usize>,
}

impl FrameLayout {
    /// The layout of a valid configuration.
    pub fn of(config: &SensorConfig) -> Self {
        Self {
            timing: frame_timing(config),
            sweeps_per_frame: config.sweeps_per_frame as usize,
            subsweep_points: config.subsweeps.iter().map(|s| s.num_points as usize).collect(),
        }
    }

    /// Timing of a frame.
    pub fn timing(&self) -> &FrameTiming {
        &self.timing
    }

    /// Samples in a whole frame.
    pub fn samples_per_frame(&self) -> usize {
        self.sweeps_per_frame * self.subsweep_points.iter().sum::<usize>()
    }

    /// The sweeps of a frame, oldest first, each with its own time; `None` if the frame's length
    /// differs from the configuration's.
    pub fn sweeps<'a>(&'a self, frame: &'a Frame) -> Option<impl Iterator<Item = Sweep<'a>>> {
        if frame.samples.len() != self.samples_per_frame() || frame.samples.is_empty() {
            return None;
        }
        let points: usize = self.subsweep_points.iter().sum();
        let start_s = |sweep: usize| sweep as f64 * self.timing.sweep_period_s - self.timing.frame_s;
        Some(frame.samples.chunks_exact(points).enumerate().flat_map(move |(index, sweep)| {
            let mut rest = sweep;
            self.subsweep_points.iter().zip(&self.timing.subsweeps).enumerate().map(
                move |(subsweep, (&count, &(offset_s, point_period_s)))| {
                    let (samples, later) = rest.split_at(count);
                    rest = later;
                    let first_ns = ((start_s(index) + offset_s) * 1e9).round() as i64;
                    Sweep {
                        subsweep,
                        first_point_time_ns: frame.host_time_ns.saturating_add(first_ns),
                        point_period_s,
                        samples,
                    }
                },
            )
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Subsweep, preset};
    use super::*;

    fn frame(samples: usize) -> Frame {
        Frame {
            tick: 0,
            host_time_ns: 1_000_000_000,
            temperature_c: 25,
            data_saturated: false,
            frame_delayed: false,
            calibration_needed: false,
            samples: (0..samples).map(|n| Complex::new(n as i16, 0)).collect(),
        }
    }

    #[test]
    fn subsweeps_are_split_in_order_and_end_near_the_tick() {
        let config = SensorConfig {
            sweeps_per_frame: 3,
            subsweeps: vec![
                Subsweep { num_points: 4, ..Default::default() },
                Subsweep { num_points: 2, ..Default::default() },
            ],
            ..Default::default()
        };
        let layout = FrameLayout::of(&config);
        let frame = frame(18);
        let sweeps: Vec<_> = layout.sweeps(&frame).unwrap().collect();
        assert_eq!(sweeps.len(), 6);
        assert_eq!(sweeps[3].subsweep, 1);
        assert_eq!(sweeps[3].samples[0].re, 10);
        let last = sweeps[5];
        let end_ns = last.first_point_time_ns + (last.point_period_s * 2e9) as i64;
        assert!((frame.host_time_ns - end_ns).abs() < 50_000);
        assert!(sweeps.windows(2).all(|w| w[0].first_point_time_ns < w[1].first_point_time_ns));
    }

    #[test]
    fn short_frame_gives_no_sweeps() {
        let layout = FrameLayout::of(&preset("d16").unwrap());
        assert!(layout.sweeps(&frame(799)).is_none());
        assert_eq!(layout.sweeps(&frame(800)).unwrap().count(), 16);
    }
}
