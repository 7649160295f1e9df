//! One timed trial: from chosen sweeps to a position.

use std::time::Instant;

use glam::DVec3;

use super::plan::{Case, Search};
use super::row::{Sample, Samples};
use crate::experiments::trial_recording::{TrialRecording, region};
use radar_sar::backprojection::{BrickGrid, SweepStack, Threshold, dense_volume, search};
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::SubapertureSettings;
use radar_sar::{Beam, Candidate, Observation};
use radar_sar::{Oracle, PositionErrors, RangePower, oracle_volume, refine};

pub(super) const BEAM: Beam = Beam::Lensless;
/// Minimum range used by the refinement, metres: nearer lies the antenna's own leakage. Choice:
/// nearer lies the antenna's own leakage.
const MIN_RANGE_M: f64 = 0.15;
/// A case is repeated up to this many times per recording, until it has run for `MAX_REPEAT_S`
/// seconds. Choice: short cases need the minimum of several runs, long ones vary little.
const MAX_REPEATS: usize = 5;
const MAX_REPEAT_S: f64 = 0.05;

/// Images each recording in turn. The first one is imaged once more beforehand, unmeasured, as a
/// warm-up.
pub(super) fn samples(case: &Case, recorded: &[TrialRecording]) -> Samples {
    let mut samples = Samples::default();
    for (n, recorded) in recorded.iter().enumerate() {
        let region = region(case.voxel_m, recorded.seed);
        let start = Instant::now();
        let sweeps = choose(case, recorded, &region);
        samples.selection_s.push(start.elapsed().as_secs_f64());
        if n == 0 && case.search != Search::Oracle {
            image(case, &sweeps, &region);
        }
        let begin = Instant::now();
        for repeat in 0..MAX_REPEATS {
            let start = Instant::now();
            let imaged = image(case, &sweeps, &region);
            samples.times_s.push(start.elapsed().as_secs_f64());
            if repeat == 0 {
                samples.push(Sample {
                    error_m: imaged.position_m.map_or(f64::INFINITY, |position| position.distance(recorded.truth_m)),
                    updates: imaged.updates,
                    bounds: imaged.bounds,
                });
            }
            if begin.elapsed().as_secs_f64() > MAX_REPEAT_S {
                break;
            }
        }
    }
    samples
}

fn choose(case: &Case, recorded: &TrialRecording, region: &Aabb) -> Vec<Observation> {
    if case.sweeps == 0 {
        return recorded.observations.clone();
    }
    let candidates: Vec<Candidate> = recorded.observations.iter().map(Candidate::from).collect();
    let chosen = case.selection.choose(&candidates, case.sweeps, region.center(), recorded.seed);
    chosen.into_iter().map(|n| recorded.observations[n].clone()).collect()
}

/// Result of one trial.
struct TrialResult {
    /// `None`: nothing found.
    position_m: Option<DVec3>,
    updates: u64,
    bounds: u64,
}

/// The timed part: range tables, volume or search, peak, and refinement if the case has one.
fn image(case: &Case, sweeps: &[Observation], region: &Aabb) -> TrialResult {
    let mut imaged = search_position(case, sweeps, region);
    if case.refined {
        imaged.position_m = imaged.position_m.map(|position| {
            let power = RangePower::new(sweeps, &BEAM, MIN_RANGE_M);
            // Where too few sweeps see the point, the voxel's centre stays.
            refine(&power, position, None, &PositionErrors::default()).map_or(position, |refined| refined.position_m)
        });
    }
    imaged
}

fn search_position(case: &Case, sweeps: &[Observation], region: &Aabb) -> TrialResult {
    let grid = BrickGrid::covering(region, case.voxel_m);
    let dense_updates = (grid.voxels() * sweeps.len()) as u64;
    if case.search == Search::Oracle {
        let oracle = Oracle::new(sweeps, &BEAM, &SubapertureSettings::default());
        let volume = oracle_volume(&oracle, case.statistic, region, case.voxel_m);
        return TrialResult { position_m: peak(&volume.values, &grid), updates: dense_updates, bounds: 0 };
    }
    let (stack, _) = SweepStack::of(case.statistic, &BEAM, sweeps, grid.middle_m());
    if case.search == Search::Dense {
        let dense = dense_volume(&stack, &grid);
        return TrialResult { position_m: peak(&dense.volume.values, &grid), updates: dense.updates, bounds: 0 };
    }
    let share = if case.search == Search::Peak { 1.0 } else { 0.5 };
    let found = search(&stack, &grid, Threshold::ShareOfPeak(share));
    let position_m = found.peak().map(|(index, _)| center(&grid, index));
    TrialResult { position_m, updates: found.work.updates, bounds: found.work.bounds }
}

/// Centre of the greatest voxel; the first of equals, as in the adaptive search.
fn peak(values: &[f32], grid: &BrickGrid) -> Option<DVec3> {
    let first_best = |best: (usize, f32), v: (usize, f32)| if v.1 > best.1 { v } else { best };
    let (index, value) = values.iter().copied().enumerate().fold((0, 0.0), first_best);
    (value > 0.0).then(|| center(grid, index))
}

pub(super) fn center(grid: &BrickGrid, index: usize) -> DVec3 {
    let [nx, ny, _] = grid.size;
    let voxel = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64 + 0.5);
    grid.origin_m + DVec3::from_array(voxel) * grid.voxel_m
}
