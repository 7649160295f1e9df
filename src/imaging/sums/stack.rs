//! Sweeps as kernels want them: sixteen side by side, places relative to one origin, and for each sweep its tables over
//! range.
//!
//! A table holds what the statistic needs as a function of range alone (fast time), in steps of at most 5 mm and a sixteenth
//! of the pulse, with the slope to the next entry beside it: linear interpolation of |z|² is then within 0.3 % of its peak
//! (0.1 % for profiles 3 to 5). What sums whole numbers (`ls`, `log`) is scaled so that a step of 1 is a small part of the noise. A stack has slots that can be filled again, so that a
//! window of sweeps can roll.

use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex32;
use rayon::prelude::*;

use super::beam_table::BeamTable;
use super::lanes::{LANES, WINDOW};
use crate::imaging::{RangeCompressor, Statistic, sweep_noise_rms};
use crate::radar::{Beam, Observation, SweepGeometry, distance_falloff};

/// Widest step of the tables, metres.
const TABLE_STEP_M: f64 = 0.005;
/// Table steps in a pulse's width, at least: |z|² is as wide as the pulse, and a Gaussian's chord over such a step lies at
/// most (2.355 / 16)² / 8 of its height below it.
const STEPS_PER_PULSE: f64 = 16.0;
/// Greatest sample that is taken for one, LSB: the converter ends at 2¹⁵, and squares stay numbers in f32 far beyond.
const MAX_SAMPLE_LSB: f32 = 1e9;
/// `log` counts in parts of this size.
const LOG_STEP: f64 = 1.0 / 4096.0;
/// Sweeps whose tables one task makes, at least.
const SWEEPS_AT_ONCE: usize = 4;
/// Greatest value of an entry, in steps: one sweep alone never overflows.
const MAX_STEPS: f32 = (1 << 30) as f32;

/// A sweep that no sum takes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SweepRefusal {
    /// A sample, the pose or the velocity is NaN or infinite.
    #[error("the sweep has a number that is not finite")]
    NotFinite,
    /// A sample that no converter gives; its square would leave f32.
    #[error("the sweep has a sample beyond {MAX_SAMPLE_LSB} LSB")]
    TooLarge,
    /// More or fewer samples than its axis has points.
    #[error("the sweep has {samples} samples, its axis {points} points")]
    WrongLength {
        /// Samples given.
        samples: usize,
        /// Points expected.
        points: usize,
    },
    /// The stack was not made for sweeps of this geometry.
    #[error("the sweep's range axis is not one of those that the image was made for")]
    UnknownGeometry,
}

/// Sixteen sweeps; a lane without a sweep has an empty range.
#[derive(Debug, Clone)]
pub(super) struct Group {
    /// `[axis][lane]`, metres from the stack's origin.
    pub position_m: [[f32; LANES]; 3],
    pub velocity_m_per_s: [[f32; LANES]; 3],
    /// Unit vector of the boresight.
    pub forward: [[f32; LANES]; 3],
    /// First and last range, metres.
    pub first_m: [f32; LANES],
    pub last_m: [f32; LANES],
    /// Table entries per metre.
    pub entries_per_m: [f32; LANES],
    /// A point at range d is sampled `d · time_s_per_m + time_at_zero_s` after the pose's time.
    pub time_s_per_m: [f32; LANES],
    pub time_at_zero_s: [f32; LANES],
}

impl Group {
    const EMPTY: Self = Self {
        position_m: [[0.0; LANES]; 3],
        velocity_m_per_s: [[0.0; LANES]; 3],
        forward: [[0.0; LANES]; 3],
        first_m: [f32::MAX; LANES],
        last_m: [f32::MIN; LANES],
        entries_per_m: [1.0; LANES],
        time_s_per_m: [0.0; LANES],
        time_at_zero_s: [0.0; LANES],
    };
}

/// A geometry with its filter and falloff tables.
#[derive(Debug, Clone)]
struct Axis {
    geometry: Arc<SweepGeometry>,
    compressor: RangeCompressor,
    /// D at each entry; held below one step, where it would go to infinity.
    falloff: Vec<f32>,
}

/// Sweeps with their tables, for one statistic.
#[derive(Debug, Clone)]
pub struct SweepStack {
    statistic: Statistic,
    origin_m: DVec3,
    pub(super) beam: Arc<BeamTable>,
    axes: Vec<Axis>,
    /// What one step of a summed whole number is worth (`ls`, `log`).
    step: f64,
    /// Greatest value of a table's entry, in steps.
    most_steps: f32,
    pub(super) groups: Vec<Group>,
    filled: Vec<bool>,
    pub(super) planes: usize,
    pub(super) stride: usize,
    tables: Vec<f32>,
    /// Greatest whole number that each slot can add to a place.
    greatest: Vec<i64>,
}

/// What one step of `ls` is worth, LSB²: a power of two, a 64th to a 128th of the noise's power, unless samples of the
/// given size would not fit then.
pub fn ls_step(noise_rms_lsb: f64, greatest_sample_lsb: f64) -> f64 {
    let fine = (noise_rms_lsb * noise_rms_lsb / 64.0).max(1e-12).log2().floor().exp2();
    // |z|² is at most (Σ E)²/Σ E² times the greatest |x|²: 21 on a 10 mm axis, 84 on a 2.5 mm one.
    let coarse =
        (greatest_sample_lsb * greatest_sample_lsb * 100.0 / f64::from(MAX_STEPS)).max(1e-12).log2().ceil().exp2();
    fine.max(coarse)
}

impl SweepStack {
    /// Room for `slots` sweeps of the given geometries, none filled yet. `step`: of `ls` (see [`ls_step`]), ignored by the
    /// other statistics.
    pub fn new(
        statistic: Statistic,
        beam: &Beam,
        geometries: &[Arc<SweepGeometry>],
        origin_m: DVec3,
        slots: usize,
        step: f64,
    ) -> Self {
        let axes: Vec<Axis> = geometries.iter().map(|geometry| axis(geometry, statistic)).collect();
        let entries = axes.iter().map(|a| a.compressor.entries()).max().unwrap_or(0);
        let planes = match statistic {
            Statistic::Coherent => 3,
            Statistic::Glrt | Statistic::Thesis => 2,
            _ => 1,
        };
        let stride = (entries + WINDOW + LANES).next_multiple_of(LANES);
        let groups = slots.div_ceil(LANES);
        Self {
            statistic,
            origin_m,
            beam: BeamTable::of(beam),
            axes,
            step: if statistic == Statistic::Log { LOG_STEP } else { step },
            most_steps: MAX_STEPS,
            groups: vec![Group::EMPTY; groups],
            filled: vec![false; groups * LANES],
            planes,
            stride,
            tables: vec![0.0; groups * LANES * planes * 2 * stride],
            greatest: vec![0; groups * LANES],
        }
    }

    /// All the sweeps that can be used, and how many cannot. The step of `ls` follows their median noise.
    pub fn of(statistic: Statistic, beam: &Beam, observations: &[Observation], origin_m: DVec3) -> (Self, usize) {
        let mut geometries: Vec<Arc<SweepGeometry>> = Vec::new();
        for observation in observations {
            if !geometries.iter().any(|g| Arc::ptr_eq(g, &observation.geometry)) {
                geometries.push(Arc::clone(&observation.geometry));
            }
        }
        let step = if statistic == Statistic::Ls { step_for(observations) } else { 1.0 };
        let mut stack = Self::new(statistic, beam, &geometries, origin_m, observations.len(), step);
        let refused = stack.fill_all(observations);
        (stack, refused)
    }

    /// Holds sweeps filled in from now on to so many steps at a place.
    pub(super) fn hold_to(&mut self, most_steps: i32) {
        self.most_steps = (most_steps as f32).min(MAX_STEPS);
    }

    /// Which sum.
    pub fn statistic(&self) -> Statistic {
        self.statistic
    }

    /// What places are relative to, tracking frame, metres.
    pub fn origin_m(&self) -> DVec3 {
        self.origin_m
    }

    /// What one step of a summed whole number is worth.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Whether it sums whole numbers of steps (`ls`, `log`).
    pub fn sums_whole_numbers(&self) -> bool {
        matches!(self.statistic, Statistic::Ls | Statistic::Log)
    }

    /// A sum of steps as the statistic's value.
    pub(super) fn value_of(&self, sum: i64) -> f32 {
        (sum as f64 * self.step) as f32
    }

    /// Slots in all.
    pub fn slots(&self) -> usize {
        self.filled.len()
    }

    /// Whether a slot holds a sweep.
    pub(super) fn is_filled(&self, slot: usize) -> bool {
        self.filled[slot]
    }

    /// Sweeps in it.
    pub fn sweeps(&self) -> usize {
        self.filled.iter().filter(|filled| **filled).count()
    }

    /// Values of one plane of a slot's tables, then, `stride` further on, their slopes.
    #[inline(always)]
    pub(super) fn table(&self, slot: usize, plane: usize) -> &[f32] {
        let at = (slot * self.planes + plane) * 2 * self.stride;
        &self.tables[at..at + 2 * self.stride]
    }

    /// Greatest whole number that a slot can add to a place; 0 when empty.
    pub(super) fn greatest(&self, slot: usize) -> i64 {
        self.greatest[slot]
    }

    /// Puts a sweep into a slot.
    ///
    /// # Errors
    /// Numbers that are not finite, a wrong length, an unknown geometry: the slot is then empty.
    pub fn fill(&mut self, slot: usize, observation: &Observation) -> Result<(), SweepRefusal> {
        self.empty(slot);
        let axis = check(observation, &self.axes)?;
        let long = self.table_len();
        let greatest = self.maker().write(&self.axes[axis], observation, &mut self.tables[slot * long..][..long]);
        self.put(slot, observation, axis, greatest);
        Ok(())
    }

    /// Fills a new stack on all cores; how many sweeps are refused. Neighbours in time go to different groups, so that each
    /// group of sixteen has seen the whole motion: bounds over the first groups then say most.
    fn fill_all(&mut self, observations: &[Observation]) -> usize {
        let (long, maker, axes) = (self.table_len().max(1), self.maker(), &self.axes);
        let groups = self.groups.len();
        let of_slot = |slot: usize| observations.get(slot / LANES + slot % LANES * groups);
        let write = |(slot, table): (usize, &mut [f32])| {
            let observation = of_slot(slot)?;
            let axis = check(observation, axes).ok()?;
            Some((axis, maker.write(&axes[axis], observation, table)))
        };
        let tables = self.tables.par_chunks_mut(long).enumerate().with_min_len(SWEEPS_AT_ONCE);
        let written: Vec<Option<(usize, i64)>> = tables.map(write).collect();
        for (slot, written) in written.iter().enumerate() {
            if let (Some((axis, greatest)), Some(observation)) = (*written, of_slot(slot)) {
                self.put(slot, observation, axis, greatest);
            }
        }
        observations.len() - written.iter().flatten().count()
    }

    /// Numbers of all tables of a slot.
    fn table_len(&self) -> usize {
        self.planes * 2 * self.stride
    }

    fn maker(&self) -> TableMaker {
        TableMaker { statistic: self.statistic, step: self.step, most_steps: self.most_steps, stride: self.stride }
    }

    fn put(&mut self, slot: usize, observation: &Observation, axis: usize, greatest: i64) {
        self.groups[slot / LANES].put(slot % LANES, observation, &self.axes[axis].compressor, self.origin_m);
        self.greatest[slot] = greatest;
        self.filled[slot] = true;
    }

    /// Puts the sweep in another stack's slot, which is made for the same sweeps, into one of this one's.
    pub(super) fn take_over(&mut self, slot: usize, other: &Self, from: usize) {
        let long = self.table_len();
        self.tables[slot * long..][..long].copy_from_slice(&other.tables[from * long..][..long]);
        self.groups[slot / LANES].copy_lane(slot % LANES, &other.groups[from / LANES], from % LANES);
        self.greatest[slot] = other.greatest[from];
        self.filled[slot] = other.filled[from];
    }

    /// Takes a sweep out.
    pub fn empty(&mut self, slot: usize) {
        let (group, l) = (&mut self.groups[slot / LANES], slot % LANES);
        (group.first_m[l], group.last_m[l]) = (f32::MAX, f32::MIN);
        self.filled[slot] = false;
        self.greatest[slot] = 0;
    }
}

/// Makes the tables of one sweep.
#[derive(Debug, Clone, Copy)]
struct TableMaker {
    statistic: Statistic,
    step: f64,
    most_steps: f32,
    stride: usize,
}

impl TableMaker {
    /// The greatest entry where they are whole numbers.
    fn write(self, axis: &Axis, observation: &Observation, tables: &mut [f32]) -> i64 {
        let samples = &observation.samples;
        let compress = || axis.compressor.compress(samples, 1.0).z;
        let mut planes = tables.chunks_exact_mut(2 * self.stride);
        let (first, second, third) =
            (planes.next().unwrap_or_default(), planes.next().unwrap_or_default(), planes.next().unwrap_or_default());
        let d = &axis.falloff;
        match self.statistic {
            Statistic::Ls | Statistic::Blocks => {
                let per = (1.0 / self.step) as f32;
                return 1 + write(first, compress().iter().map(|z| (z.norm_sqr() * per).min(self.most_steps))) as i64;
            }
            Statistic::Log => {
                let noise = sweep_noise_rms(samples);
                let (per2, per) = ((1.0 / (noise * noise)) as f32, (1.0 / LOG_STEP) as f32);
                return 1 + write(
                    first,
                    compress().iter().map(|z| ((z.norm_sqr() * per2).ln_1p() * per).min(self.most_steps)),
                ) as i64;
            }
            Statistic::Glrt => {
                write(first, compress().iter().zip(d).map(|(z, d)| magnitude(z) * d));
                write(second, d.iter().map(|d| d * d));
            }
            Statistic::Coherent => {
                let z = compress();
                write(first, z.iter().zip(d).map(|(z, d)| z.re * d));
                write(second, z.iter().zip(d).map(|(z, d)| z.im * d));
                write(third, d.iter().map(|d| d * d));
            }
            Statistic::ThesisFull => {
                let magnitudes: Vec<f32> = samples.iter().map(magnitude).collect();
                write(first, axis.compressor.spread(&magnitudes).iter().zip(d).map(|(a, d)| a * d));
            }
            Statistic::Thesis => write_nearest(samples, axis, first, second),
        }
        0
    }
}

/// |x|, whose square need not fit f32.
fn magnitude(x: &Complex32) -> f32 {
    let (re, im) = (f64::from(x.re), f64::from(x.im));
    (re * re + im * im).sqrt() as f32
}

/// Writes a plane that is linear from entry to entry; its greatest value.
fn write(plane: &mut [f32], values: impl Iterator<Item = f32>) -> f32 {
    let (value, slope) = plane.split_at_mut(plane.len() / 2);
    let (mut entries, mut greatest) = (0, 0.0f32);
    for (to, from) in value.iter_mut().zip(values) {
        (*to, entries, greatest) = (from, entries + 1, greatest.max(from));
    }
    value[entries..].fill(0.0);
    for (to, two) in slope.iter_mut().zip(value[..entries].array_windows::<2>()) {
        *to = two[1] - two[0];
    }
    slope[entries.saturating_sub(1)..].fill(0.0);
    greatest
}

/// |x of the nearest point| · D: it jumps halfway between points, where the tables have entries. The second plane has the
/// same as pairs of value and slope.
fn write_nearest(samples: &[Complex32], axis: &Axis, plane: &mut [f32], pairs: &mut [f32]) {
    let (value, slope) = plane.split_at_mut(plane.len() / 2);
    let phases = (axis.geometry.axis.step_m / axis.compressor.step_m()).round() as usize;
    let falloff = &axis.falloff;
    let (mut sample, mut left) = (0, phases / 2);
    let last = falloff.len() - 1;
    for n in 0..=last {
        if left == 0 {
            (sample, left) = ((sample + 1).min(samples.len() - 1), phases);
        }
        left -= 1;
        let magnitude = magnitude(&samples[sample]);
        let (from, to) = (magnitude * falloff[n], magnitude * falloff[(n + 1).min(last)]);
        (value[n], slope[n]) = (from, to - from);
        (pairs[2 * n], pairs[2 * n + 1]) = (from, to - from);
    }
    value[last + 1..].fill(0.0);
    slope[last + 1..].fill(0.0);
    pairs[2 * last + 2..].fill(0.0);
}

/// From the median noise and the greatest sample, those that are refused left out.
fn step_for(observations: &[Observation]) -> f64 {
    let of_sweep = |o: &Observation| (sweep_noise_rms(&o.samples), greatest_power(&o.samples));
    let sweeps = observations.par_iter().with_min_len(SWEEPS_AT_ONCE).map(of_sweep);
    let (mut noise, powers): (Vec<f64>, Vec<f64>) = sweeps.collect::<Vec<_>>().into_iter().unzip();
    noise.sort_by(f64::total_cmp);
    let median = noise.get(noise.len() / 2).copied().filter(|n| n.is_finite());
    ls_step(median.unwrap_or(1.0), powers.into_iter().fold(0.0, f64::max).sqrt())
}

/// The greatest |x|², samples that are refused left out.
fn greatest_power(samples: &[Complex32]) -> f64 {
    let powers = samples.iter().map(|x| f64::from(x.re) * f64::from(x.re) + f64::from(x.im) * f64::from(x.im));
    powers.filter(|power| power.sqrt() <= 2.0 * f64::from(MAX_SAMPLE_LSB)).fold(0.0, f64::max)
}

fn axis(geometry: &Arc<SweepGeometry>, statistic: Statistic) -> Axis {
    let step_m = geometry.axis.step_m;
    let widest_m = TABLE_STEP_M.min(geometry.profile.envelope_fwhm_m() / STEPS_PER_PULSE);
    let least = |widest_m: f64| (step_m / widest_m - 1e-9).ceil().max(1.0);
    // Of `thesis` there must be an entry halfway between points.
    let halves = statistic == Statistic::Thesis;
    let phases = if halves { 2.0 * least(2.0 * widest_m) } else { least(widest_m) };
    let compressor = RangeCompressor::with_step(geometry, step_m / phases * (1.0 + 1e-9));
    let falloff = (0..compressor.entries())
        .map(|n| compressor.first_m() + n as f64 * compressor.step_m())
        .map(|range_m| distance_falloff(range_m.max(compressor.step_m())) as f32);
    Axis { falloff: falloff.collect(), compressor, geometry: Arc::clone(geometry) }
}

fn check(observation: &Observation, axes: &[Axis]) -> Result<usize, SweepRefusal> {
    let known = |a: &Axis| Arc::ptr_eq(&a.geometry, &observation.geometry) || a.geometry == observation.geometry;
    let axis = axes.iter().position(known).ok_or(SweepRefusal::UnknownGeometry)?;
    let (samples, points) = (observation.samples.len(), observation.geometry.axis.points);
    if samples != points || points == 0 {
        return Err(SweepRefusal::WrongLength { samples, points });
    }
    let pose = &observation.tracking_from_sensor;
    let finite = pose.translation.is_finite()
        && pose.rotation.is_finite()
        && observation.velocity_m_per_s.is_finite()
        && observation.samples.iter().all(|x| x.re.is_finite() && x.im.is_finite());
    let small = observation.samples.iter().all(|x| x.re.abs().max(x.im.abs()) <= MAX_SAMPLE_LSB);
    match (finite, small) {
        (false, _) => Err(SweepRefusal::NotFinite),
        (true, false) => Err(SweepRefusal::TooLarge),
        (true, true) => Ok(axis),
    }
}

impl Group {
    fn copy_lane(&mut self, to: usize, other: &Self, from: usize) {
        for axis in 0..3 {
            self.position_m[axis][to] = other.position_m[axis][from];
            self.velocity_m_per_s[axis][to] = other.velocity_m_per_s[axis][from];
            self.forward[axis][to] = other.forward[axis][from];
        }
        self.first_m[to] = other.first_m[from];
        self.last_m[to] = other.last_m[from];
        self.entries_per_m[to] = other.entries_per_m[from];
        self.time_s_per_m[to] = other.time_s_per_m[from];
        self.time_at_zero_s[to] = other.time_at_zero_s[from];
    }

    fn put(&mut self, l: usize, observation: &Observation, compressor: &RangeCompressor, origin_m: DVec3) {
        let pose = &observation.tracking_from_sensor;
        let vectors = [
            (&mut self.position_m, pose.translation - origin_m),
            (&mut self.velocity_m_per_s, observation.velocity_m_per_s),
            (&mut self.forward, pose.forward()),
        ];
        for (lanes, vector) in vectors {
            for (lane, value) in lanes.iter_mut().zip(vector.as_vec3().to_array()) {
                lane[l] = value;
            }
        }
        let axis = &observation.geometry.axis;
        self.first_m[l] = axis.first_m as f32;
        self.last_m[l] = axis.last_m() as f32;
        self.entries_per_m[l] = (1.0 / compressor.step_m()) as f32;
        self.time_s_per_m[l] = (observation.geometry.point_period_s / axis.step_m) as f32;
        self.time_at_zero_s[l] = observation.point_time_s(axis.point_at(0.0)) as f32;
    }
}
