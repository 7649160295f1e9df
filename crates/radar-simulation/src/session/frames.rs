//! The frames of a session: what the sensor measures of the room, of those who move, and of itself.

use num_complex::{Complex, Complex64};
use rayon::prelude::*;

use super::super::echoes::EchoPath;
use super::super::receiver::MovingScatterer;
use super::super::sampler::{Sampler, Surroundings};
use super::super::scenario::host_ns;
use super::super::sensor::{SubsweepOfFrame, unit_amplitude_lsb};
use super::physical::{PathLimits, PhysicalRoom, frames_per_visibility};
use super::{PlaySession, Session};
use a121::{Frame, Subsweep, frame_timing, noise_rms_lsb};

impl Session {
    /// Number of frames of the session.
    pub fn frame_count(&self) -> u64 {
        let timing = frame_timing(&self.play.config);
        ((self.play.duration_s - timing.frame_s) / timing.frame_period_s).floor().max(0.0) as u64 + 1
    }

    /// Frames by number, computed in parallel; the result does not depend on the number of threads.
    pub fn frames(&self, numbers: std::ops::Range<u64>) -> Vec<Frame> {
        match &self.physical {
            Some(physical) => self.physical_frames(physical, numbers),
            None => numbers.into_par_iter().map(|number| self.point_frame(number)).collect(),
        }
    }

    /// A frame in a room of points.
    fn point_frame(&self, number: u64) -> Frame {
        let PlaySession { config, beam, .. } = &self.play;
        let sampler = Sampler { config, beam, sensor: &self.sensor, rcs_offset_db: 0.0 };
        let start_s = self.start_s(number);
        let mut samples: Vec<Complex<i16>> = Vec::with_capacity(config.points_per_frame());
        let surroundings = |first_s: f64, last_s: f64| self.surroundings(first_s, last_s);
        let data_saturated = sampler.frame(number, start_s, |t| self.sensor_in_room(t), surroundings, &mut samples);
        self.frame(start_s, data_saturated, samples)
    }

    /// Frames in a physical world. Neighbours share what is seen, by their numbers.
    fn physical_frames(&self, physical: &PhysicalRoom, numbers: std::ops::Range<u64>) -> Vec<Frame> {
        let timing = frame_timing(&self.play.config);
        let group = frames_per_visibility(timing.frame_period_s);
        let groups = numbers.start / group..numbers.end.div_ceil(group);
        let frames = groups.into_par_iter().flat_map_iter(|n| {
            let (first, beyond) = ((n * group).max(numbers.start), ((n + 1) * group).min(numbers.end));
            let middle_s = (n as f64 + 0.5) * group as f64 * timing.frame_period_s;
            let removed = middle_s >= self.removed_s;
            let sensor = self.sensor_in_room(middle_s);
            let seen = physical.visibility(removed, &sensor, &self.play.beam, self.path_limits());
            let frame = |number: u64| {
                let start_s = self.start_s(number);
                let times_s = [0.0, 0.5, 1.0].map(|share| start_s + share * timing.frame_s);
                let paths =
                    physical.paths(removed, &seen, &times_s.map(|t| self.sensor_in_room(t)), &self.movers(times_s));
                self.physical_frame(number, &paths)
            };
            (first..beyond).map(frame).collect::<Vec<_>>()
        });
        frames.collect()
    }

    fn physical_frame(&self, number: u64, paths: &[EchoPath]) -> Frame {
        let PlaySession { config, beam, .. } = &self.play;
        let timing = frame_timing(config);
        let start_s = self.start_s(number);
        let sums = config.subsweeps.iter().enumerate().map(|(index, subsweep)| {
            let bias_m = self.sensor.range_bias_m(index);
            let of_frame = SubsweepOfFrame {
                unit_lsb: unit_amplitude_lsb(subsweep, beam),
                ..SubsweepOfFrame::new(subsweep, index, config.sweeps_per_frame, &timing, bias_m)
            };
            of_frame.sum(if self.sensor.hears_echoes(index) { paths } else { &[] })
        });
        let mut sums: Vec<Vec<Vec<Complex64>>> = sums.collect();
        let mut state = self.sensor.frame(number, start_s);
        let mut samples = Vec::with_capacity(config.points_per_frame());
        let mut data_saturated = false;
        for sweep in 0..config.sweeps_per_frame as usize {
            for (index, sums) in sums.iter_mut().enumerate() {
                let time_s = start_s + sweep as f64 * timing.sweep_period_s + timing.subsweeps[index].0;
                data_saturated |= state.convert(index, time_s, std::mem::take(&mut sums[sweep]), &mut samples);
            }
        }
        self.frame(start_s, data_saturated, samples)
    }

    fn start_s(&self, number: u64) -> f64 {
        number as f64 * frame_timing(&self.play.config).frame_period_s
    }

    fn frame(&self, start_s: f64, data_saturated: bool, samples: Vec<Complex<i16>>) -> Frame {
        let end_s = start_s + frame_timing(&self.play.config).frame_s;
        Frame {
            tick: (end_s * 1e6).round() as i64,
            host_time_ns: host_ns(end_s),
            temperature_c: self.sensor.temperature_c(start_s).round() as i16,
            data_saturated,
            frame_delayed: false,
            calibration_needed: false,
            samples,
        }
    }

    /// Paths below a hundredth of the noise, or beyond the last point by the pulse's length, are left
    /// out.
    pub(super) fn path_limits(&self) -> PathLimits {
        let PlaySession { config, beam, .. } = &self.play;
        let weakest = |subsweep: &Subsweep| 0.01 * noise_rms_lsb(subsweep) / unit_amplitude_lsb(subsweep, beam);
        let farthest_m = |subsweep: &Subsweep| subsweep.last_m() + 1.6 * subsweep.profile.envelope_fwhm_m() + 0.05;
        PathLimits {
            min_amplitude: config.subsweeps.iter().map(weakest).fold(f64::INFINITY, f64::min),
            max_range_m: config.subsweeps.iter().map(farthest_m).fold(0.0, f64::max),
        }
    }

    fn surroundings(&self, first_s: f64, last_s: f64) -> Surroundings<'_> {
        let middle_s = 0.5 * (first_s + last_s);
        let room = if middle_s < self.removed_s { &self.before } else { &self.after };
        let [first, middle, last] = [first_s, middle_s, last_s].map(|t| self.moving_at(t));
        // A visitor who arrives or leaves during a sweep is not in it.
        let whole = first.len() == middle.len() && last.len() == middle.len();
        let ways = first.iter().zip(&last).map(|(a, b)| b.position_m - a.position_m);
        let moving = middle.iter().zip(ways).filter(|_| whole);
        Surroundings { room, moving: moving.map(|(&scatterer, way)| MovingScatterer { scatterer, way }).collect() }
    }
}
