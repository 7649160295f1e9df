//! Samples of a frame: each sweep and subsweep at its own time. The noise depends only on the
//! frame's number, so frames can be generated on any thread.

use num_complex::{Complex, Complex64};

use super::Room;
use super::receiver::{MovingScatterer, Receiver};
use super::sensor::SensorModel;
use a121::{SensorConfig, frame_timing};
use radar_sar::Beam;
use radar_sar::geometry::Pose;

/// Surroundings of the sensor during a sweep.
pub(super) struct Surroundings<'a> {
    pub room: &'a Room,
    pub moving: Vec<MovingScatterer>,
}

/// Generates the samples of frames.
pub(super) struct Sampler<'a> {
    pub config: &'a SensorConfig,
    pub beam: &'a Beam,
    /// The sensor behind the antenna, with the same configuration.
    pub sensor: &'a SensorModel,
    /// Offset added to every radar cross-section, dB.
    pub rcs_offset_db: f64,
}

impl Sampler<'_> {
    /// Appends the samples of a frame whose measurement starts at `start_s`; returns whether a
    /// sample saturated. `sensor_at` gives the pose at a time; the other callback gives the
    /// surroundings from the time of a sweep's first point to that of its last one.
    pub fn frame<'a>(
        &self,
        number: u64,
        start_s: f64,
        sensor_at: impl Fn(f64) -> Pose,
        surroundings: impl Fn(f64, f64) -> Surroundings<'a>,
        samples: &mut Vec<Complex<i16>>,
    ) -> bool {
        let mut state = self.sensor.frame(number, start_s);
        let timing = frame_timing(self.config);
        let mut data_saturated = false;
        for sweep in 0..self.config.sweeps_per_frame {
            let sweep_s = start_s + f64::from(sweep) * timing.sweep_period_s;
            for (index, subsweep) in self.config.subsweeps.iter().enumerate() {
                let (offset_s, period_s) = timing.subsweeps[index];
                let first_s = sweep_s + offset_s;
                let last_s = first_s + period_s * f64::from(subsweep.num_points.saturating_sub(1));
                let echoes = if self.sensor.hears_echoes(index) {
                    let Surroundings { room, moving } = surroundings(first_s, last_s);
                    let range_bias_m = self.sensor.range_bias_m(index);
                    let (beam, rcs_offset_db) = (self.beam, self.rcs_offset_db);
                    let receiver = Receiver { room, moving: &moving, subsweep, beam, rcs_offset_db, range_bias_m };
                    receiver.sweep(|t| sensor_at(first_s + t), period_s)
                } else {
                    vec![Complex64::ZERO; subsweep.num_points as usize]
                };
                data_saturated |= state.convert(index, first_s, echoes, samples);
            }
        }
        data_saturated
    }
}
