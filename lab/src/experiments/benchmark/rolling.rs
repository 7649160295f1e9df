//! Benchmark of a window over the newest sweeps: the rolling image against an image from scratch.

use std::sync::Arc;
use std::time::Instant;

use super::BenchmarkError;
use super::plan::{Case, Search};
use super::row::{Sample, Samples};
use super::trial::{BEAM, center};
use crate::experiments::trial_recording::{TrialRecording, region};
use radar_sar::backprojection::{BrickGrid, RollingImage, RollingSettings, SweepStack, Threshold, ls_step, search};

/// Number of sweeps between two comparisons with the truth. Fresh images are made only there.
/// Choice: run time.
const COMPARE_EVERY_SWEEPS: usize = 25;

/// Times, per window: for the rolling image one sweep in, one out and the peak; for the fresh one
/// tables, search and peak.
pub(super) fn samples(case: &Case, recorded: &[TrialRecording]) -> Result<Samples, BenchmarkError> {
    let mut samples = Samples::default();
    for recorded in recorded {
        match case.search {
            Search::Rolling => rolling(case, recorded, &mut samples)?,
            _ => fresh(case, recorded, &mut samples),
        }
    }
    Ok(samples)
}

fn rolling(case: &Case, recorded: &TrialRecording, samples: &mut Samples) -> Result<(), BenchmarkError> {
    let observations = &recorded.observations;
    let grid = BrickGrid::covering(&region(case.voxel_m, recorded.seed), case.voxel_m);
    let geometries: Vec<_> = observations.first().map(|o| Arc::clone(&o.geometry)).into_iter().collect();
    let settings = RollingSettings { statistic: case.statistic, window: case.sweeps, ..Default::default() };
    let mut image = RollingImage::new(settings, &BEAM, &geometries, &grid)?;
    for (n, observation) in observations.iter().enumerate() {
        let before = image.work();
        let start = Instant::now();
        // A refused sweep is counted by the image and does not change it.
        let taken = image.push(observation).is_ok();
        let position = image.peak().map(|peak| peak.0);
        let time_s = start.elapsed().as_secs_f64();
        if n < case.sweeps || !taken {
            continue;
        }
        samples.times_s.push(time_s);
        let work = image.work();
        let updates = work.updates - before.updates;
        let bounds = work.bounds - before.bounds;
        if n % COMPARE_EVERY_SWEEPS == 0 {
            let error_m = position.map_or(f64::INFINITY, |position| position.distance(recorded.truth_m));
            samples.push(Sample { error_m, updates, bounds });
        }
    }
    Ok(())
}

fn fresh(case: &Case, recorded: &TrialRecording, samples: &mut Samples) {
    let observations = &recorded.observations;
    let grid = BrickGrid::covering(&region(case.voxel_m, recorded.seed), case.voxel_m);
    // Same rounding as in the rolling image.
    let step = ls_step(RollingSettings::default().noise_rms_lsb, 0.0);
    for newest in (case.sweeps..observations.len()).filter(|n| n % COMPARE_EVERY_SWEEPS == 0) {
        let window = &observations[newest + 1 - case.sweeps..=newest];
        let start = Instant::now();
        let geometries = [Arc::clone(&window[0].geometry)];
        let mut stack = SweepStack::new(case.statistic, &BEAM, &geometries, grid.middle_m(), window.len(), step);
        let filled = window.iter().enumerate().filter(|(slot, o)| stack.fill(*slot, o).is_ok()).count();
        let found = search(&stack, &grid, Threshold::ShareOfPeak(RollingSettings::default().share_of_peak as f32));
        let position = found.peak().map(|(index, _)| center(&grid, index));
        samples.times_s.push(start.elapsed().as_secs_f64());
        if filled < window.len() {
            continue;
        }
        let error_m = position.map_or(f64::INFINITY, |position| position.distance(recorded.truth_m));
        samples.push(Sample { error_m, updates: found.work.updates, bounds: found.work.bounds });
    }
}
