//! The sweeps of a rolling image: those in the window, and those removed last.

use std::ops::Range;
use std::sync::Arc;

use super::super::bounds::RangeMaxima;
use super::super::brick_geometry::{BrickShape, VOXELS};
use super::super::grid::BrickGrid;
use super::super::power::{AddPower, PowerSums};
use super::super::sweep_stack::{SweepRefusal, SweepStack, ls_step};
use super::RollingSettings;
use crate::simd::LANES;
use crate::{Beam, Observation, SweepGeometry};

/// Slots of the sweep that came and of the one that leaves, if the window was full.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    pub(super) new: usize,
    pub(super) old: Option<usize>,
}

/// The newest sweeps.
#[derive(Debug)]
pub(super) struct SweepWindow {
    /// Greatest number of sweeps.
    size: usize,
    /// Number of the newest sweep; the first has number 1.
    newest: u64,
    /// Sweep n in slot n modulo the number of slots.
    stack: SweepStack,
    maxima: RangeMaxima,
    /// Sweeps removed last, for bricks that still include them: the n-th removed one in slot n
    /// modulo the number of slots.
    departed: SweepStack,
    /// All groups of the window with all their lanes.
    every_slot: Vec<(usize, u16)>,
}

impl SweepWindow {
    /// An empty window. `geometries`: those of all sweeps to come.
    pub(super) fn new(
        settings: &RollingSettings,
        beam: &Beam,
        geometries: &[Arc<SweepGeometry>],
        grid: &BrickGrid,
    ) -> Self {
        let step = ls_step(settings.noise_rms_lsb, 0.0);
        // One slot more than the window: the new sweep is added before the old one is removed.
        let slots = settings.window + 1;
        let stack_of = |slots| SweepStack::new(settings.statistic, beam, geometries, grid.middle_m(), slots, step);
        let mut stack = stack_of(slots);
        // Sums of rounded-up bounds then still fit 32 bits.
        stack.limit_steps((f64::from(i32::MAX / slots as i32) * 0.9999) as i32 - 4);
        Self {
            size: settings.window,
            newest: 0,
            maxima: RangeMaxima::of(&stack),
            departed: stack_of(max_missed_sweeps(settings.window) as usize),
            every_slot: (0..stack.groups.len()).map(|group| (group, u16::MAX)).collect(),
            stack,
        }
    }

    /// Adds a sweep. The one that leaves stays in the stack until [`Self::remove`].
    pub(super) fn add(&mut self, observation: &Observation) -> Result<Change, SweepRefusal> {
        let number = self.newest + 1;
        let new = slot(number, self.slots());
        self.stack.fill(new, observation)?;
        self.maxima.fill(&self.stack, new);
        self.newest = number;
        let departed = self.departed_count(number);
        Ok(Change { new, old: (departed > 0).then(|| slot(departed, self.slots())) })
    }

    /// Removes the sweep that leaves.
    pub(super) fn remove(&mut self, old: usize) {
        let in_past = slot(self.departed_count(self.newest), self.max_missed() as usize);
        self.departed.copy_slot(in_past, &self.stack, old);
        self.stack.empty(old);
    }

    /// Number of sweeps in the window.
    pub(super) fn len(&self) -> usize {
        (self.newest - self.departed_count(self.newest)) as usize
    }

    /// Number of the newest sweep.
    pub(super) fn newest(&self) -> u64 {
        self.newest
    }

    pub(super) fn stack(&self) -> &SweepStack {
        &self.stack
    }

    pub(super) fn maxima(&self) -> &RangeMaxima {
        &self.maxima
    }

    /// Slots of the window's sweeps, in order.
    pub(super) fn all_slots(&self) -> Vec<usize> {
        let numbers = self.departed_count(self.newest) + 1..self.newest + 1;
        numbers.map(|number| slot(number, self.slots())).collect()
    }

    /// Whether a brick that last included this sweep can be caught up.
    pub(super) fn can_catch_up(&self, sweep: u64) -> bool {
        self.newest - sweep <= self.max_missed()
    }

    /// Sums of the sweeps that came and of those that left since a sweep, for a brick.
    pub(super) fn sums_since(&self, sweep: u64, center: [f32; 3], shape: BrickShape) -> [PowerSums; 2] {
        let came = lanes_of(sweep + 1..self.newest + 1, self.slots());
        let gone = self.departed_count(sweep) + 1..self.departed_count(self.newest) + 1;
        let went = lanes_of(gone, self.max_missed() as usize);
        let sum = |stack, slots: &[_]| AddPower { stack, shape, center, slots }.sums();
        [sum(&self.stack, &came), sum(&self.departed, &went)]
    }

    /// Sums of all sweeps, for a brick.
    pub(super) fn sums(&self, center: [f32; 3], shape: BrickShape) -> PowerSums {
        AddPower { stack: &self.stack, shape, center, slots: &self.every_slot }.sums()
    }

    /// Voxel updates that the sums of a brick over the whole window take.
    pub(super) fn updates_per_brick(&self) -> u64 {
        (self.len() * VOXELS) as u64
    }

    /// Number of sweeps removed by the time sweep `number` was added.
    fn departed_count(&self, number: u64) -> u64 {
        number.saturating_sub(self.size as u64)
    }

    fn slots(&self) -> usize {
        self.size + 1
    }

    fn max_missed(&self) -> u64 {
        max_missed_sweeps(self.size)
    }
}

/// Greatest number of sweeps that a brick may have missed to be caught up; beyond it, catching up
/// costs as much as the whole window.
fn max_missed_sweeps(window: usize) -> u64 {
    (window as u64 / 2).max(1)
}

/// Slot of a sweep, by its number.
fn slot(number: u64, slots: usize) -> usize {
    (number % slots as u64) as usize
}

/// Slots of the sweeps with these numbers, as groups with masks of their lanes.
fn lanes_of(numbers: Range<u64>, slots: usize) -> Vec<(usize, u16)> {
    let mut groups: Vec<(usize, u16)> = Vec::new();
    for slot in numbers.map(|number| slot(number, slots)) {
        match groups.last_mut() {
            Some((group, lanes)) if *group == slot / LANES => *lanes |= 1 << (slot % LANES),
            _ => groups.push((slot / LANES, 1 << (slot % LANES))),
        }
    }
    groups
}
