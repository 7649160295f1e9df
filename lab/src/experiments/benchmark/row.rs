//! Measurements of one case, and what a table says of them.

use super::plan::{Case, Search};
use super::record::workload;
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::pareto_front;

/// One image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Distance from the truth, metres; infinite when nothing was found.
    pub error_m: f64,
    pub updates: u64,
    pub bounds: u64,
}

/// All images of a case.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Samples {
    pub errors_m: Vec<f64>,
    pub updates: Vec<f64>,
    pub bounds: Vec<f64>,
    /// More than there are errors: quick cases are repeated.
    pub times_s: Vec<f64>,
    pub selection_s: Vec<f64>,
}

impl Samples {
    pub fn push(&mut self, sample: Sample) {
        self.errors_m.push(sample.error_m);
        self.updates.push(sample.updates as f64);
        self.bounds.push(sample.bounds as f64);
    }
}

/// A case's figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// What it images, in words.
    pub workload: String,
    /// Images that the error is taken over.
    pub trials: usize,
    /// Median time of an image from its sweeps to the place, seconds,
    pub median_s: f64,
    /// and its 95th percentile.
    pub p95_s: f64,
    /// Median time of choosing the sweeps, seconds; not in the other times.
    pub selection_s: f64,
    /// Median (voxel, sweep) pairs summed,
    pub updates: u64,
    /// and (cube, sweep) pairs bounded to find which.
    pub bounds: u64,
    /// Median distance from the truth, metres; infinite when mostly nothing was found.
    pub error_m: f64,
    /// Its 95th percentile.
    pub error_p95_m: f64,
    /// No case of the same recordings is both faster and nearer.
    pub on_front: bool,
}

impl Row {
    pub(super) fn of(case: &Case, samples: &Samples) -> Self {
        Self {
            case: *case,
            workload: workload(case.motion),
            trials: samples.errors_m.len(),
            median_s: quantile(&samples.times_s, 0.5),
            p95_s: quantile(&samples.times_s, 0.95),
            selection_s: quantile(&samples.selection_s, 0.5),
            updates: quantile(&samples.updates, 0.5) as u64,
            bounds: quantile(&samples.bounds, 0.5) as u64,
            error_m: quantile(&samples.errors_m, 0.5),
            error_p95_m: quantile(&samples.errors_m, 0.95),
            on_front: false,
        }
    }

    /// Whether it is measured against others for the front: the wide motion, all of its 10 s to choose sweeps from, all
    /// seeds.
    pub fn competes(&self) -> bool {
        self.case.motion == "sphere-50cm" && !self.case.has_window() && self.case.search != Search::Oracle
    }
}

pub(super) fn mark_front(rows: &mut [Row]) {
    let competing: Vec<usize> = (0..rows.len()).filter(|&n| rows[n].competes()).collect();
    let points: Vec<[f64; 2]> = competing.iter().map(|&n| [rows[n].median_s, rows[n].error_m]).collect();
    for n in pareto_front(&points) {
        rows[competing[n]].on_front = true;
    }
}
