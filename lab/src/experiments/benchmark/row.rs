//! Measurements of one case and the statistics that the table shows.

use super::plan::{Case, Search};
use super::record::workload;
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::pareto_front;

/// Measurement of one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Distance from the truth, metres; infinite when nothing was found.
    pub error_m: f64,
    pub updates: u64,
    pub bounds: u64,
}

/// Measurements of all images of a case.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Samples {
    pub errors_m: Vec<f64>,
    pub updates: Vec<f64>,
    pub bounds: Vec<f64>,
    /// Run times, seconds. More entries than errors, since quick cases are repeated.
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

/// Results of one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The case.
    pub case: Case,
    /// Workload as text.
    pub workload: String,
    /// Number of images that the error is taken over.
    pub trials: usize,
    /// Median run time of an image from its sweeps to the position, seconds.
    pub median_s: f64,
    /// 95th percentile of the run time, seconds.
    pub p95_s: f64,
    /// Median time for choosing the sweeps, seconds; not part of the run time.
    pub selection_s: f64,
    /// Median number of (voxel, sweep) pairs summed.
    pub updates: u64,
    /// Median number of (cube, sweep) pairs bounded during the search.
    pub bounds: u64,
    /// Median distance from the truth, metres; infinite when most trials found nothing.
    pub error_m: f64,
    /// 95th percentile of the distance.
    pub error_p95_m: f64,
    /// Pareto optimal: no case of the same recordings is both faster and more accurate.
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

    /// Whether the case competes for the Pareto front: wide motion, sweeps chosen from all of the
    /// 10 s, all seeds.
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
