//! The two ways to image a recording: the thesis' sum over voxels of 10 cm with its greatest voxel,
//! and this program's refined position with covariance.

use std::time::Instant;

use glam::DVec3;

use crate::experiments::trial_recording::{TrialRecording, region};
use radar_sar::backprojection::{BrickGrid, SweepStack, Threshold, dense_volume, search};
use radar_sar::geometry::Aabb;
use radar_sar::math;
use radar_sar::{Beam, Candidate, Observation};
use radar_sar::{PositionErrors, RangePower, Refined, Selection, Statistic, Volume, refine};

/// The thesis' voxel edge (section 5.6), metres.
pub(super) const THESIS_VOXEL_M: f64 = 0.1;
/// Voxel edge of our search before refinement, metres. Choice: below half the pulse's width, so
/// that refinement starts at the right peak.
const OWN_VOXEL_M: f64 = 0.05;
/// Minimum range, metres. Choice: nearer lies the antenna's own leakage.
pub(super) const MIN_RANGE_M: f64 = 0.15;
pub(super) const BEAM: Beam = Beam::Lensless;

/// Selects a number of a recording's sweeps; all where it has no more.
pub(super) fn chosen(recorded: &TrialRecording, count: usize, by: Selection) -> Vec<Observation> {
    let position = region(THESIS_VOXEL_M, recorded.seed).center();
    let candidates: Vec<Candidate> = recorded.observations.iter().map(Candidate::from).collect();
    let chosen = by.choose(&candidates, count, position, recorded.seed);
    chosen.into_iter().map(|n| recorded.observations[n].clone()).collect()
}

/// Image of the search cube.
pub(super) fn volume(sweeps: &[Observation], statistic: Statistic, voxel_m: f64, seed: u64) -> Volume {
    volume_with_beam(&BEAM, sweeps, statistic, voxel_m, seed)
}

/// Image of the search cube with another beam model.
pub(super) fn volume_with_beam(
    beam: &Beam,
    sweeps: &[Observation],
    statistic: Statistic,
    voxel_m: f64,
    seed: u64,
) -> Volume {
    volume_of(beam, sweeps, statistic, voxel_m, &region(voxel_m, seed))
}

/// Image of a cube of this edge around a point.
pub(super) fn volume_around(
    sweeps: &[Observation],
    statistic: Statistic,
    voxel_m: f64,
    around_m: DVec3,
    edge_m: f64,
) -> Volume {
    let cube = Aabb { min: around_m - 0.5 * edge_m, max: around_m + 0.5 * edge_m };
    volume_of(&BEAM, sweeps, statistic, voxel_m, &cube)
}

fn volume_of(beam: &Beam, sweeps: &[Observation], statistic: Statistic, voxel_m: f64, region: &Aabb) -> Volume {
    let grid = BrickGrid::covering(region, voxel_m);
    let (stack, _) = SweepStack::of(statistic, beam, sweeps, grid.middle_m());
    dense_volume(&stack, &grid).volume
}

/// Power over the noise from which on a sweep sees an object. Choice: 10 dB, which noise reaches
/// once in 20 000 times.
const SEEN_POWER: f64 = 10.0;

/// Share of the sweeps that see at least one of the points.
pub(super) fn seen_share(sweeps: &[Observation], points_m: &[DVec3]) -> f64 {
    let power = RangePower::new(sweeps, &Beam::Uniform, MIN_RANGE_M);
    let mut seen = vec![false; sweeps.len()];
    for reading in points_m.iter().flat_map(|&point| power.readings(point)) {
        seen[reading.sweep] |= reading.power >= SEEN_POWER;
    }
    seen.iter().filter(|seen| **seen).count() as f64 / sweeps.len().max(1) as f64
}

/// Quality of an image of one object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quality {
    /// From the truth to the greatest voxel, metres.
    pub off_m: DVec3,
    /// Size of the box around the voxels of at least half of the greatest value, metres.
    pub extent_m: DVec3,
    /// Volume of the voxels of at least half of the greatest value, litres.
    pub footprint_l: f64,
    /// Greatest value over the median one, dB of amplitude.
    pub contrast_db: f64,
}

impl Quality {
    /// Of an image with one true point.
    pub fn of(volume: &Volume, truth_m: DVec3) -> Self {
        let peak = volume.peak();
        let position = peak.map(|(index, _)| volume.center(volume.voxel(index)));
        let greatest = peak.map_or(0.0, |(_, value)| value);
        let is_strong = |value: f32| value >= 0.5 * greatest && value > 0.0;
        let strong = (0..volume.values.len()).filter(|&index| is_strong(volume.values[index]));
        let around = Aabb::around(strong.clone().map(|index| volume.center(volume.voxel(index))));
        let mut sorted: Vec<f32> = volume.values.iter().copied().filter(|value| *value > 0.0).collect();
        sorted.sort_by(f32::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(greatest);
        Self {
            off_m: position.map_or(DVec3::INFINITY, |position| position - truth_m),
            extent_m: around.map_or(DVec3::ZERO, |around| around.size() + volume.voxel_m),
            footprint_l: strong.count() as f64 * volume.voxel_m.powi(3) * 1e3,
            contrast_db: 20.0 * math::log10(f64::from(greatest / median.max(f32::MIN_POSITIVE))),
        }
    }

    pub fn error_m(&self) -> f64 {
        self.off_m.length()
    }
}

/// This program's method: `ls`, the greatest voxel by branch and bound, refinement; and the run
/// time, seconds.
pub(super) fn locate(sweeps: &[Observation], seed: u64) -> (Option<Refined>, f64) {
    locate_by(&BEAM, sweeps, seed, &PositionErrors::default())
}

/// The same with another beam model.
pub(super) fn locate_with_beam(beam: &Beam, sweeps: &[Observation], seed: u64) -> (Option<Refined>, f64) {
    locate_by(beam, sweeps, seed, &PositionErrors::default())
}

/// The same with stated position errors.
pub(super) fn locate_with_errors(sweeps: &[Observation], seed: u64, errors: &PositionErrors) -> (Option<Refined>, f64) {
    locate_by(&BEAM, sweeps, seed, errors)
}

fn locate_by(beam: &Beam, sweeps: &[Observation], seed: u64, errors: &PositionErrors) -> (Option<Refined>, f64) {
    let start = Instant::now();
    let grid = BrickGrid::covering(&region(OWN_VOXEL_M, seed), OWN_VOXEL_M);
    let (stack, _) = SweepStack::of(Statistic::Ls, beam, sweeps, grid.middle_m());
    let found = search(&stack, &grid, Threshold::ShareOfPeak(1.0));
    let refined = found.peak().and_then(|(index, _)| {
        let [nx, ny, _] = grid.size;
        let voxel = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64 + 0.5);
        let position = grid.origin_m + DVec3::from_array(voxel) * grid.voxel_m;
        refine(&RangePower::new(sweeps, beam, MIN_RANGE_M), position, None, errors)
    });
    (refined, start.elapsed().as_secs_f64())
}

/// Text for what the median trial observed of the position.
pub(super) fn observed(refined: &[Option<Refined>]) -> &'static str {
    let mut directions: Vec<usize> =
        refined.iter().map(|refined| refined.as_ref().map_or(0, Refined::observed_directions)).collect();
    directions.sort_unstable();
    match directions.get(directions.len().saturating_sub(1) / 2) {
        Some(2) => "position",
        Some(1) => "range and one direction",
        _ => "range alone",
    }
}

/// Spread over the sweeps of the range difference between two points, metres. Below the pulse
/// length, sums of amplitudes can hardly separate the two.
pub(super) fn range_difference_spread_m(sweeps: &[Observation], places_m: [DVec3; 2]) -> f64 {
    let misfits = || sweeps.iter().map(|sweep| sweep.distance_m(places_m[0]) - sweep.distance_m(places_m[1]));
    (misfits().fold(f64::NEG_INFINITY, f64::max) - misfits().fold(f64::INFINITY, f64::min)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_gives_distance_size_and_contrast() {
        let mut volume = Volume { origin_m: DVec3::ZERO, voxel_m: 0.1, size: [3, 3, 3], values: vec![1.0; 27] };
        (volume.values[13], volume.values[14]) = (10.0, 5.0);
        let quality = Quality::of(&volume, DVec3::new(0.15, 0.15, 0.05));
        assert!((quality.error_m() - 0.1).abs() < 1e-9 && (quality.off_m.z - 0.1).abs() < 1e-9);
        assert!(quality.extent_m.distance(DVec3::new(0.2, 0.1, 0.1)) < 1e-9);
        assert!((quality.footprint_l - 2.0).abs() < 1e-9 && (quality.contrast_db - 20.0).abs() < 1e-6);
        assert_eq!((observed(&[]), observed(&[None])), ("range alone", "range alone"));
        assert_eq!(range_difference_spread_m(&[], [DVec3::ZERO; 2]), 0.0);
        let nothing = Volume { values: vec![0.0; 27], ..volume };
        assert!(Quality::of(&nothing, DVec3::ZERO).error_m().is_infinite());
    }
}
