//! Radar range of one reflector: the strongest echo near its expected range, every few
//! milliseconds.

use glam::DVec3;
use num_complex::Complex32;

use crate::MappingSettings;
use radar_sar::math;
use radar_sar::{Beam, Observation};
use radar_sar::{RangeCompressor, sweep_noise_rms};

/// Sweeps within this time are combined, nanoseconds. Choice: several sweeps reduce the noise, and
/// at 1 m/s the range changes by 8 mm, far less than a pulse.
const GROUP_NS: i64 = 8_000_000;
/// Half width of the gate around the expected range, metres. Choice: a lag of one second at 0.5
/// m/s.
const GATE_M: f64 = 0.5;
/// Least mean power |z|²/σ² of an echo. Choice: noise reaches it with e⁻¹² a sample, so that gaps
/// are not filled by noise.
const MIN_POWER: f64 = 12.0;
/// Least two-way amplitude of the beam at the reflector. Choice: −20 dB on both ways; farther out
/// the sidelobes of other echoes are stronger.
const MIN_AMPLITUDE: f64 = 0.1;
/// Least range, metres: direct leakage of the antenna lies below. Measured: in the vendor's
/// recordings it reaches to 0.1 m, in profile 3 its tail to 0.2 m.
const MIN_RANGE_M: f64 = 0.2;
/// Least number of ranges to compare. Choice: 0.4 s of groups; fewer do not show whether the
/// streams agree.
pub(super) const MIN_RANGES: usize = 50;

/// Reads the ranges of a position.
pub(super) struct RangeReader<'a> {
    position_m: DVec3,
    beam: &'a Beam,
}

impl<'a> RangeReader<'a> {
    pub fn new(position_m: DVec3, settings: &'a MappingSettings) -> Self {
        Self { position_m, beam: &settings.radar.beam }
    }

    /// Times and ranges, metres, from the first subsweep whose range covers the position.
    pub fn read(&self, observations: &[Observation]) -> Vec<(i64, f64)> {
        let subsweep = observations.iter().filter(|o| self.sees(o)).map(|o| o.geometry.subsweep).min();
        let Some(subsweep) = subsweep else { return Vec::new() };
        let of_it: Vec<&Observation> = observations.iter().filter(|o| o.geometry.subsweep == subsweep).collect();
        let Some(first) = of_it.first() else { return Vec::new() };
        let compressor = RangeCompressor::new(&first.geometry);
        let mut ranges = Vec::new();
        let mut rest = of_it.as_slice();
        while let Some(first) = rest.first() {
            let end = rest.partition_point(|o| o.mid_time_ns < first.mid_time_ns.saturating_add(GROUP_NS)).max(1);
            let (group, later) = rest.split_at(end);
            ranges.extend(self.range(group, &compressor));
            rest = later;
        }
        ranges
    }

    fn sees(&self, observation: &Observation) -> bool {
        let range_m = observation.distance_m(self.position_m);
        observation.geometry.axis.contains(range_m)
            && self.beam.amplitude(observation.cos_off_boresight(self.position_m)) >= MIN_AMPLITUDE
    }

    /// Range of the strongest peak of a group's mean power in the gate, and the time when that
    /// point was measured.
    fn range(&self, group: &[&Observation], compressor: &RangeCompressor) -> Option<(i64, f64)> {
        let middle = group[group.len() / 2];
        if !self.sees(middle) {
            return None;
        }
        let mut power = vec![0.0f64; compressor.entries()];
        for observation in group {
            let scale = (1.0 / sweep_noise_rms(&observation.samples)) as f32;
            let z = compressor.compress(&observation.samples, scale).z;
            power.iter_mut().zip(&z).for_each(|(sum, z): (_, &Complex32)| *sum += f64::from(z.norm_sqr()));
        }
        let (first_m, step_m) = (compressor.first_m(), compressor.step_m());
        let expected_m = middle.distance_m(self.position_m);
        let in_gate = |entry: &usize| {
            let range_m = first_m + *entry as f64 * step_m;
            (range_m - expected_m).abs() <= GATE_M && range_m >= MIN_RANGE_M
        };
        let peaks = (1..power.len().saturating_sub(1)).filter(in_gate).filter(|&n| is_peak(&power[n - 1..=n + 1]));
        let best = peaks.max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
        if power[best] < MIN_POWER * group.len() as f64 {
            return None;
        }
        let range_m = first_m + (best as f64 + vertex(&power[best - 1..=best + 1])) * step_m;
        let first_ns = group[0].mid_time_ns;
        let mean_ns = first_ns + group.iter().map(|o| o.mid_time_ns - first_ns).sum::<i64>() / group.len() as i64;
        let point_s = middle.point_time_s(middle.geometry.axis.point_at(range_m));
        Some((mean_ns + (point_s * 1e9).round() as i64, range_m))
    }
}

fn is_peak(three: &[f64]) -> bool {
    three[1] > three[0] && three[1] >= three[2] && three[0] > 0.0 && three[2] > 0.0
}

/// Vertex of the parabola through three logarithms, relative to the middle one.
fn vertex(three: &[f64]) -> f64 {
    let [a, b, c] = [math::ln(three[0]), math::ln(three[1]), math::ln(three[2])];
    (0.5 * (c - a) / (2.0 * b - a - c)).clamp(-0.5, 0.5)
}

/// A range follows the position when its residual is this close to the median, metres. Choice:
/// tracking error and range noise at 20 dB; another echo is a pulse's width away.
const MAX_FOLLOWING_M: f64 = 0.03;

/// Number of ranges that follow the distances.
pub(super) fn count_following(radar: &[(i64, f64)], by_poses: &[(i64, f64)], offset_s: f64) -> usize {
    let residuals = residuals(radar, by_poses, offset_s);
    let middle = median(&residuals);
    residuals.iter().filter(|r| (*r - middle).abs() <= MAX_FOLLOWING_M).count()
}

/// Spread of range minus distance when poses are this much later than sweeps, as a standard
/// deviation: 1.48 times the median absolute deviation, so that other echoes do not count; NaN
/// without common times.
pub(super) fn spread_m(radar: &[(i64, f64)], by_poses: &[(i64, f64)], offset_s: f64) -> f64 {
    let residuals = residuals(radar, by_poses, offset_s);
    let middle = median(&residuals);
    1.4826 * median(&residuals.iter().map(|r| (r - middle).abs()).collect::<Vec<f64>>())
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

fn residuals(radar: &[(i64, f64)], by_poses: &[(i64, f64)], offset_s: f64) -> Vec<f64> {
    let offset_ns = (offset_s * 1e9).round() as i64;
    let residual =
        |(time_ns, range_m): &(i64, f64)| Some(range_m - value_at(by_poses, time_ns.saturating_add(offset_ns))?);
    radar.iter().filter_map(residual).collect()
}

/// Interpolates a series, but not across a gap.
pub(super) fn value_at(series: &[(i64, f64)], time_ns: i64) -> Option<f64> {
    /// Choice: between samples so far apart a path is off by a·t²/8, 3 mm at 10 m/s².
    const LONGEST_STEP_NS: i64 = 50_000_000;
    let later = series.partition_point(|(t, _)| *t < time_ns);
    let (&(t1, v1), &(t0, v0)) = (series.get(later)?, series.get(later.checked_sub(1)?)?);
    let share = (time_ns - t0) as f64 / (t1 - t0).max(1) as f64;
    (t1 - t0 <= LONGEST_STEP_NS).then_some(v0 + (v1 - v0) * share)
}
