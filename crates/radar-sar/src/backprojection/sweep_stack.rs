//! Sweeps prepared for kernels: sixteen in lanes, positions relative to one origin, and tables over
//! range for each sweep.
//!
//! A table holds what the statistic needs as a function of range alone (fast time), in steps of at
//! most 5 mm and a sixteenth of the pulse, together with the slope to the next entry. Linear
//! interpolation of |z|² is then within 0.3 % of its peak (0.1 % for profiles 3 to 5). Integer
//! statistics (`ls`, `log`) are scaled so that a step of 1 is a small part of the noise; their tables
//! also hold parabolas over coarse entries, which are as close and fewer. A stack has slots that can
//! be refilled, so that a window of sweeps can roll.

mod group;
mod parabolas;
mod tables;

pub(super) use group::Group;
pub(super) use parabolas::{Parabolas, rounding_of_lookup};
use tables::TableMaker;

use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex32;
use rayon::prelude::*;

use super::beam_table::BeamTable;
use crate::compression::CompressionScratch;
use crate::math;
use crate::simd::{Kernel, LANES, Lanes, on_widest};
use crate::{Beam, Observation, SweepGeometry, distance_falloff};
use crate::{RangeCompressor, Statistic, sweep_noise_rms};

/// Numbers of table entries that a kernel looks up in at once, from one load to eight.
pub(super) const WINDOW: usize = 32;
pub(super) const HALF_WINDOW: usize = 64;
pub(super) const WIDE_WINDOW: usize = 128;
/// Widest step of the tables, metres. Choice: two of the sensor's base steps; a sweep of 3 m takes
/// 600 entries.
pub(super) const TABLE_STEP_M: f64 = 0.005;
/// Least number of table steps per pulse width. Choice: |z|² is as wide as the pulse, and over such
/// a step a Gaussian's chord lies at most (2.355 / 16)² / 8 of its height below it, 0.3 %.
const STEPS_PER_PULSE: f64 = 16.0;
/// Greatest sample accepted, LSB. Choice: the converter ends at 2¹⁵, and squares stay finite in f32
/// far beyond.
const MAX_SAMPLE_LSB: f32 = 1e9;
/// Step of `log`. Choice: far finer than the noise's spread of about 1; 4096 sweeps of the loudest
/// echo fit an i32.
const LOG_STEP: f64 = 1.0 / 4096.0;
/// Least number of coarse entries per pulse width. Choice: |z|² is as wide as the pulse, and a parabola
/// through three values of a Gaussian over such a step is within 0.05 % of its peak.
const COARSE_STEPS_PER_PULSE: f64 = 7.0;
/// Least number of sweeps whose tables one task computes. Choice: enough work for a task to pay.
const SWEEPS_AT_ONCE: usize = 4;
/// Choice: short axes get as much room as a window needs.
const MIN_STRIDE: usize = 96;
/// Greatest value of an entry, in steps. Choice: half of an i32, so that one sweep alone never
/// overflows.
const MAX_STEPS: f32 = (1 << 30) as f32;

/// Why a sweep is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SweepRefusal {
    /// A sample, the pose or the velocity is NaN or infinite.
    #[error("the sweep contains a value that is not finite")]
    NotFinite,
    /// A sample beyond any converter's range; its square could overflow f32.
    #[error("the sweep has a sample beyond {MAX_SAMPLE_LSB} LSB")]
    TooLarge,
    /// More or fewer samples than its axis has points.
    #[error("the sweep has {samples} samples, its axis {points} points")]
    WrongLength {
        /// Number of samples in the sweep.
        samples: usize,
        /// Number of points on its axis.
        points: usize,
    },
    /// The stack was not created for sweeps of this geometry.
    #[error("the sweep's range axis is not one of those for which the image was created")]
    UnknownGeometry,
}

/// N entries of a table from one on; `None` beyond it.
#[inline(always)]
pub(super) fn window<const N: usize>(table: &[f32], first: usize) -> Option<&[f32; N]> {
    table.get(first..)?.first_chunk()
}

/// A geometry with its filter and falloff table.
#[derive(Debug, Clone)]
struct Axis {
    geometry: Arc<SweepGeometry>,
    compressor: RangeCompressor,
    /// Binary logarithm of the number of table entries per coarse entry, at least 1.
    coarse_octaves: u32,
    /// D at each entry; held constant below one step, where it would diverge.
    falloff: Vec<f32>,
}

impl Axis {
    /// Number of values in all planes of its parabolas.
    fn coarse_len(&self) -> usize {
        parabolas::len(self.falloff.len(), self.coarse_octaves)
    }
}

/// Sweeps with their tables, for one statistic.
#[derive(Debug, Clone)]
pub struct SweepStack {
    statistic: Statistic,
    origin_m: DVec3,
    pub(super) beam: Arc<BeamTable>,
    axes: Vec<Axis>,
    /// Value of one step of an integer sum (`ls`, `log`).
    step: f64,
    /// Greatest value of a table's entry, in steps.
    most_steps: f32,
    pub(super) groups: Vec<Group>,
    filled: Vec<bool>,
    pub(super) planes: usize,
    pub(super) stride: usize,
    /// Number of values in all tables of a slot.
    slot_len: usize,
    tables: Vec<f32>,
    /// Number of values in all planes of a slot's parabolas, at least one. Apart from the tables: a brick
    /// looks into those of every sweep, and a processor's first level of address translation covers fewer
    /// than a hundred pages.
    coarse_len: usize,
    coarse: Vec<f32>,
    /// Greatest integer that each slot can add to a voxel.
    greatest: Vec<i64>,
}

/// Value of one step of `ls`, LSB²: a power of two, 1/128 to 1/64 of the noise power, or more if
/// samples of the given size would not fit otherwise.
pub fn ls_step(noise_rms_lsb: f64, greatest_sample_lsb: f64) -> f64 {
    let fine = math::exp2(math::log2((noise_rms_lsb * noise_rms_lsb / 64.0).max(1e-12)).floor());
    // |z|² is at most (Σ E)²/Σ E² times the greatest |x|²: 21 on a 10 mm axis, 84 on a 2.5 mm one.
    let coarse = math::exp2(
        math::log2((greatest_sample_lsb * greatest_sample_lsb * 100.0 / f64::from(MAX_STEPS)).max(1e-12)).ceil(),
    );
    fine.max(coarse)
}

impl SweepStack {
    /// Allocates `slots` empty slots for sweeps of the given geometries. `step`: value of one step
    /// of `ls` (see [`ls_step`]), ignored by the other statistics.
    pub fn new(
        statistic: Statistic,
        beam: &Beam,
        geometries: &[Arc<SweepGeometry>],
        origin_m: DVec3,
        slots: usize,
        step: f64,
    ) -> Self {
        Self::with_beam(statistic, BeamTable::of(beam), geometries, origin_m, slots, step)
    }

    fn with_beam(
        statistic: Statistic,
        beam: Arc<BeamTable>,
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
        let stride = (entries + WINDOW + LANES).max(MIN_STRIDE).next_multiple_of(LANES);
        let groups = slots.div_ceil(LANES);
        let coarse_len = match statistic {
            Statistic::Ls | Statistic::Log | Statistic::Subaperture => {
                axes.iter().map(Axis::coarse_len).max().unwrap_or(1)
            }
            _ => 1,
        };
        Self {
            statistic,
            origin_m,
            beam,
            axes,
            step: if statistic == Statistic::Log { LOG_STEP } else { step },
            most_steps: MAX_STEPS,
            groups: vec![Group::EMPTY; groups],
            filled: vec![false; groups * LANES],
            planes,
            stride,
            slot_len: planes * 2 * stride,
            tables: vec![0.0; groups * LANES * planes * 2 * stride],
            coarse_len,
            coarse: vec![0.0; groups * LANES * coarse_len],
            greatest: vec![0; groups * LANES],
        }
    }

    /// A stack of all usable sweeps, and the number of unusable ones. The step of `ls` follows from
    /// the median noise of up to nine of them.
    pub fn of(statistic: Statistic, beam: &Beam, observations: &[Observation], origin_m: DVec3) -> (Self, usize) {
        Self::of_beam(statistic, BeamTable::of(beam), observations, origin_m)
    }

    fn of_beam(
        statistic: Statistic,
        beam: Arc<BeamTable>,
        observations: &[Observation],
        origin_m: DVec3,
    ) -> (Self, usize) {
        let mut geometries: Vec<Arc<SweepGeometry>> = Vec::new();
        for observation in observations {
            if !geometries.iter().any(|g| Arc::ptr_eq(g, &observation.geometry)) {
                geometries.push(Arc::clone(&observation.geometry));
            }
        }
        let mut stack = Self::with_beam(statistic, beam, &geometries, origin_m, observations.len(), 1.0);
        let refused = stack.fill_all(observations);
        (stack, refused)
    }

    /// Like [`SweepStack::of`], with this stack's statistic and beam, in its memory: for as many
    /// sweeps of the same geometries only their tables are computed, and nothing is allocated.
    /// Returns the number of unusable sweeps.
    pub fn refill(&mut self, observations: &[Observation], origin_m: DVec3) -> usize {
        let known = |o: &Observation| self.axes.iter().any(|axis| Arc::ptr_eq(&axis.geometry, &o.geometry));
        if observations.len().div_ceil(LANES) != self.groups.len() || !observations.iter().all(known) {
            let refused;
            (*self, refused) = Self::of_beam(self.statistic, Arc::clone(&self.beam), observations, origin_m);
            return refused;
        }
        self.origin_m = origin_m;
        self.most_steps = MAX_STEPS;
        (0..self.slots()).for_each(|slot| self.empty(slot));
        self.fill_all(observations)
    }

    /// Limits the contribution of sweeps filled in from now on to so many steps per voxel.
    #[cfg(feature = "rolling")]
    pub(super) fn limit_steps(&mut self, most_steps: i32) {
        self.most_steps = ((f64::from(most_steps) / parabolas::OVERSHOOT) as f32).min(MAX_STEPS);
    }

    /// The statistic.
    pub fn statistic(&self) -> Statistic {
        self.statistic
    }

    /// Origin of kernel positions, tracking frame, metres.
    pub fn origin_m(&self) -> DVec3 {
        self.origin_m
    }

    /// Value of one step of an integer sum.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Whether its sums are integers in steps (`ls`, `log`).
    pub fn sums_whole_numbers(&self) -> bool {
        matches!(self.statistic, Statistic::Ls | Statistic::Log)
    }

    /// Converts a sum of steps to the statistic's value.
    pub(super) fn value_of(&self, sum: i64) -> f32 {
        // A parabola may pass below the values that it connects.
        (sum.max(0) as f64 * self.step) as f32
    }

    /// Total number of slots.
    pub fn slots(&self) -> usize {
        self.filled.len()
    }

    /// Whether a slot holds a sweep.
    pub(super) fn is_filled(&self, slot: usize) -> bool {
        self.filled[slot]
    }

    /// Number of sweeps in it.
    pub fn sweeps(&self) -> usize {
        self.filled.iter().filter(|filled| **filled).count()
    }

    /// Values of one plane of a slot's tables and, `stride` further on, their slopes.
    #[inline(always)]
    pub(super) fn table(&self, slot: usize, plane: usize) -> &[f32] {
        let at = slot * self.slot_len + plane * 2 * self.stride;
        &self.tables[at..at + 2 * self.stride]
    }

    /// The values of a slot's first table.
    #[inline(always)]
    pub(super) fn values(&self, slot: usize) -> &[f32] {
        &self.table(slot, 0)[..self.stride]
    }

    /// The parabolas of a slot's sweep, for integer statistics.
    #[inline(always)]
    pub(super) fn parabolas(&self, slot: usize) -> Parabolas<'_> {
        let per_entry = self.groups[slot / LANES].coarse_per_entry[slot % LANES];
        Parabolas::new(&self.coarse[slot * self.coarse_len..(slot + 1) * self.coarse_len], per_entry)
    }

    /// |x| of the points of a slot's sweep (`thesis`), zeros beyond.
    #[inline(always)]
    pub(super) fn points(&self, slot: usize) -> &[f32] {
        self.table(slot, 1)
    }

    /// Greatest integer that a slot can add to a voxel; 0 when empty.
    pub(super) fn greatest(&self, slot: usize) -> i64 {
        self.greatest[slot]
    }

    /// Puts a sweep into a slot.
    ///
    /// # Errors
    /// Numbers that are not finite, samples that are too large, a wrong length, or an unknown
    /// geometry. The slot is then empty.
    ///
    /// # Panics
    /// `slot >= self.slots()`.
    pub fn fill(&mut self, slot: usize, observation: &Observation) -> Result<(), SweepRefusal> {
        self.empty(slot);
        let axis = check(observation, extent(observation), &self.axes)?;
        let (maker, long, coarse_len) = (self.maker(), self.slot_len, self.coarse_len);
        let tables = &mut self.tables[slot * long..][..long];
        let coarse = &mut self.coarse[slot * coarse_len..][..coarse_len];
        let greatest = maker.write(&self.axes[axis], observation, [tables, coarse], &mut CompressionScratch::default());
        self.put(slot, observation, axis, greatest);
        Ok(())
    }

    /// Fills an empty stack on all cores; returns the number of refused sweeps. Neighbours in time
    /// go to different groups, so that each group of sixteen covers the whole motion. Bounds over
    /// the first groups are then tighter.
    fn fill_all(&mut self, observations: &[Observation]) -> usize {
        let extents: Vec<Extent> = observations.iter().map(extent).collect();
        let check = |(o, extent): (&Observation, &Extent)| check(o, *extent, &self.axes).ok();
        let axes: Vec<Option<usize>> = observations.iter().zip(&extents).map(check).collect();
        if self.statistic == Statistic::Ls {
            let sound = observations.iter().zip(&extents).zip(&axes).filter(|(_, axis)| axis.is_some());
            self.step = step_for(sound.map(|((sweep, _), _)| sweep));
        }
        let groups = self.groups.len();
        let of_slot = |slot: usize| {
            let n = slot / LANES + slot % LANES * groups;
            let axis = (*axes.get(n)?)?;
            Some((&observations[n], axis))
        };
        let (maker, of_axis) = (self.maker(), &self.axes);
        let write = |room: &mut CompressionScratch, (slot, ((tables, coarse), greatest)): (usize, Slot<'_>)| {
            if let Some((observation, axis)) = of_slot(slot) {
                *greatest = maker.write(&of_axis[axis], observation, [tables, coarse], room);
            }
        };
        let tables = self.tables.par_chunks_mut(self.slot_len.max(1)).zip(self.coarse.par_chunks_mut(self.coarse_len));
        let slots = tables.zip(&mut self.greatest).enumerate().with_min_len(SWEEPS_AT_ONCE);
        slots.for_each_init(CompressionScratch::default, write);
        for slot in 0..self.slots() {
            if let Some((observation, axis)) = of_slot(slot) {
                self.put(slot, observation, axis, self.greatest[slot]);
            }
        }
        axes.iter().filter(|axis| axis.is_none()).count()
    }

    fn maker(&self) -> TableMaker {
        TableMaker { statistic: self.statistic, step: self.step, most_steps: self.most_steps, stride: self.stride }
    }

    fn put(&mut self, slot: usize, observation: &Observation, axis: usize, greatest: i64) {
        self.groups[slot / LANES].put(slot % LANES, observation, &self.axes[axis], self.origin_m);
        self.greatest[slot] = greatest;
        self.filled[slot] = true;
    }

    /// Copies a slot of another stack, created for the same sweeps, into a slot of this one.
    #[cfg(feature = "rolling")]
    pub(super) fn copy_slot(&mut self, slot: usize, other: &Self, from: usize) {
        let long = self.slot_len;
        self.tables[slot * long..][..long].copy_from_slice(&other.tables[from * long..][..long]);
        let long = self.coarse_len;
        self.coarse[slot * long..][..long].copy_from_slice(&other.coarse[from * long..][..long]);
        self.groups[slot / LANES].copy_lane(slot % LANES, &other.groups[from / LANES], from % LANES);
        self.greatest[slot] = other.greatest[from];
        self.filled[slot] = other.filled[from];
    }

    /// Removes a sweep.
    ///
    /// # Panics
    /// `slot >= self.slots()`.
    pub fn empty(&mut self, slot: usize) {
        let (group, l) = (&mut self.groups[slot / LANES], slot % LANES);
        (group.first_m[l], group.last_m[l]) = (f32::MAX, f32::MIN);
        self.filled[slot] = false;
        self.greatest[slot] = 0;
    }
}

/// Tables, parabolas and greatest integer of a slot.
type Slot<'a> = ((&'a mut [f32], &'a mut [f32]), &'a mut i64);

/// Number of sweeps whose noise determines the step. Choice: odd, for a median that four bad sweeps
/// do not move.
const SWEEPS_FOR_STEP: usize = 9;

/// From the greatest sample and the median noise of sweeps spread over the whole time.
fn step_for<'a>(sweeps: impl Iterator<Item = &'a Observation> + Clone) -> f64 {
    let count = sweeps.clone().count();
    let some = sweeps.clone().step_by(count.div_ceil(SWEEPS_FOR_STEP).max(1));
    let mut noise: Vec<f64> = some.map(|sweep| sweep_noise_rms(&sweep.samples)).collect();
    noise.sort_by(f64::total_cmp);
    let median = noise.get(noise.len() / 2).copied().filter(|n| n.is_finite());
    let power = |sweep: &Observation| on_widest(GreatestPower { samples: &sweep.samples });
    ls_step(median.unwrap_or(1.0), f64::from(sweeps.map(power).fold(0.0, f32::max)).sqrt())
}

/// The greatest |x|² of accepted samples.
struct GreatestPower<'a> {
    samples: &'a [Complex32],
}

impl Kernel for GreatestPower<'_> {
    type Out = f32;

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> f32 {
        let mut most = 0;
        for sample in self.samples {
            most = most.max((sample.re * sample.re + sample.im * sample.im).to_bits());
        }
        f32::from_bits(most)
    }
}

/// The greatest absolute real or imaginary part of a sweep's samples; not finite if one of them is
/// not.
#[derive(Debug, Clone, Copy)]
struct Extent(f32);

fn extent(observation: &Observation) -> Extent {
    on_widest(FindExtent { samples: &observation.samples })
}

struct FindExtent<'a> {
    samples: &'a [Complex32],
}

impl Kernel for FindExtent<'_> {
    type Out = Extent;

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> Extent {
        // Without signs, floats are ordered like their bits, with infinity and NaN last.
        let mut most = 0;
        for sample in self.samples {
            most = most.max(sample.re.abs().to_bits()).max(sample.im.abs().to_bits());
        }
        Extent(f32::from_bits(most))
    }
}

fn axis(geometry: &Arc<SweepGeometry>, statistic: Statistic) -> Axis {
    let step_m = geometry.axis.step_m;
    let widest_m = TABLE_STEP_M.min(geometry.pulse_fwhm_m / STEPS_PER_PULSE);
    let least = |widest_m: f64| (step_m / widest_m - 1e-9).ceil().max(1.0);
    // `thesis` needs an entry halfway between points.
    let halves = statistic == Statistic::Thesis;
    let phases = if halves { 2.0 * least(2.0 * widest_m) } else { least(widest_m) };
    let compressor = RangeCompressor::with_step(geometry, step_m / phases * (1.0 + 1e-9));
    let falloff = (0..compressor.entries())
        .map(|n| compressor.first_m() + n as f64 * compressor.step_m())
        .map(|range_m| distance_falloff(range_m.max(compressor.step_m())) as f32);
    let coarse_octaves = match statistic {
        // Its dips are narrower than the pulse.
        Statistic::Log => 1,
        _ => math::log2(geometry.pulse_fwhm_m / COARSE_STEPS_PER_PULSE / compressor.step_m()).floor().max(1.0) as u32,
    };
    Axis { falloff: falloff.collect(), coarse_octaves, compressor, geometry: Arc::clone(geometry) }
}

fn check(observation: &Observation, extent: Extent, axes: &[Axis]) -> Result<usize, SweepRefusal> {
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
        && extent.0.is_finite();
    let small = extent.0 <= MAX_SAMPLE_LSB;
    match (finite, small) {
        (false, _) => Err(SweepRefusal::NotFinite),
        (true, false) => Err(SweepRefusal::TooLarge),
        (true, true) => Ok(axis),
    }
}
