//! Sub-apertures of the thesis' sweeps: coherent sums over a number of consecutive sweeps, powers
//! summed across them.
//!
//! This lies between least squares (each sweep alone) and the fully coherent sum. Longer
//! sub-apertures resolve more and need more accurate poses.

use glam::DVec3;

use super::{ExperimentError, Outcome, SNR_DB, Trials, head, mm};
use crate::experiments::trial_recording::{TrialRecording, quantile, region};
use a121::preset;
use radar_chaperone::report::Table;
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{Statistic, Volume};
use radar_simulation::{Scenario, TrackingErrors};

/// Two seconds of preset fine, 240 sweeps; numbers of sweeps per coherent sum. Choice: those of the
/// accuracy study.
const DURATION_S: f64 = 2.0;
const LENGTHS: [(usize, &str); 4] = [(1, "1: least squares"), (12, "12"), (40, "40"), (usize::MAX, "all: coherent")];
/// Half edge of the box around the truth that is searched for the peak, and its voxel edge, metres.
/// Choice: more than the errors; half the width of the narrowest peak.
const AROUND_M: f64 = 0.04;
const VOXEL_M: f64 = 2e-3;
/// Widths are measured up to this far on either side, metres. Choice: the widest, incoherent peak
/// is half a metre wide.
const REACH_M: f64 = 0.6;
const BEAM: Beam = Beam::Lensless;

/// Σ over the sub-apertures of |Σ z w e^(−j4πd/λ)|² / Σ w² over a box.
fn image(sweeps: &[Observation], length: usize, region: &Aabb) -> Volume {
    let grid = BrickGrid::covering(region, VOXEL_M);
    let mut sum = grid.volume();
    for part in sweeps.chunks(length.min(sweeps.len()).max(1)) {
        let (stack, _) = SweepStack::of(Statistic::Coherent, &BEAM, part, grid.middle_m());
        let values = dense_volume(&stack, &grid).volume.values;
        sum.values.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * value);
    }
    sum
}

/// Full width at half maximum through a point along an axis, metres; limited to twice the reach.
fn width_m(sweeps: &[Observation], length: usize, at: DVec3, axis: DVec3) -> f64 {
    let line = Aabb::from_corners(at - axis * REACH_M, at + axis * REACH_M);
    // One voxel thick, centred on the line.
    let thick = (DVec3::ONE - axis) * (0.5 * VOXEL_M);
    let values = image(sweeps, length, &Aabb { min: line.min - thick, max: line.max + thick }).values;
    let middle = values.len() / 2;
    let half =
        0.5 * values[middle.saturating_sub(2)..(middle + 3).min(values.len())].iter().fold(0.0f32, |a, b| a.max(*b));
    let above = |&value: &&f32| *value >= half;
    let right = values[middle..].iter().take_while(above).count();
    let left = values[..middle].iter().rev().take_while(above).count();
    (left + right) as f64 * VOXEL_M
}

/// Adds the sub-aperture part to the matched-filter experiment.
pub(super) fn add(trials: &Trials, outcome: &mut Outcome) -> Result<(), ExperimentError> {
    let config = preset("fine").ok_or(ExperimentError::Preset("fine"))?;
    let errors = [TrackingErrors::none(), TrackingErrors::default()];
    // `[length][exact, tracked]`.
    let mut off = vec![[Vec::new(), Vec::new()]; LENGTHS.len()];
    let mut widths = vec![[Vec::new(), Vec::new()]; LENGTHS.len()];
    for seed in 1..=trials.seeds {
        for (poses, errors) in errors.iter().enumerate() {
            let scenario = Scenario {
                snr_db: Some(SNR_DB),
                errors: *errors,
                ..Scenario::new("corner-reflector", "sphere-50cm", config.clone(), DURATION_S, seed)
            };
            let recorded = TrialRecording::of(&scenario)?;
            let truth = recorded.truth_m;
            // Each seed puts the truth at another position within a voxel.
            let shift = region(VOXEL_M, seed).center() - region(0.0, seed).center();
            let around = Aabb { min: truth + shift - AROUND_M, max: truth + shift + AROUND_M };
            for (n, &(length, _)) in LENGTHS.iter().enumerate() {
                let image = image(&recorded.observations, length, &around);
                let position = image.peak().map(|(index, _)| image.center(image.voxel(index)));
                off[n][poses].push(position.map_or(f64::INFINITY, |position| position.distance(truth)));
                if let (0, Some(position)) = (poses, position) {
                    widths[n][0].push(width_m(&recorded.observations, length, position, DVec3::X));
                    widths[n][1].push(width_m(&recorded.observations, length, position, DVec3::Z));
                }
            }
        }
    }
    let figures: Vec<[f64; 4]> = (0..LENGTHS.len())
        .map(|n| [&off[n][0], &off[n][1], &widths[n][0], &widths[n][1]].map(|values| quantile(values, 0.5)))
        .collect();
    let row = |(words, figures): (&str, &[f64; 4])| {
        let wide = |width: f64| if width > 1.9 * REACH_M { format!("over {}", mm(2.0 * REACH_M)) } else { mm(width) };
        vec![words.to_owned(), wide(figures[2]), wide(figures[3]), mm(figures[0]), mm(figures[1])]
    };
    let [single, short, .., whole] = figures[..] else { return Ok(()) };
    outcome.add_finding(
        "The choice of method depends on the application and on the data (5.8.1).",
        short[2] < single[2] / 3.0 && whole[2] < short[2] / 3.0 && whole[1] > 2.0 * whole[0],
        format!(
            "in phase over 1, 12 and all of 240 sweeps the image is {}, {} and {} mm wide in x; tracked poses put it \
             {}, {} and {} mm off, exact ones {}, {} and {} mm. Twelve in phase are the best compromise: more needs \
             better poses than tracking provides",
            mm(single[2]),
            mm(short[2]),
            mm(whole[2]),
            mm(single[1]),
            mm(short[1]),
            mm(whole[1]),
            mm(single[0]),
            mm(short[0]),
            mm(whole[0])
        ),
    );
    outcome.add_finding(
        "Polarimetric and interferometric images are candidates (5.8.1).",
        None,
        "an A121 has one antenna of one polarisation, so there is nothing to compare; coherent sums use the phases \
         between passes"
            .into(),
    );
    outcome.tables.push(Table {
        head: head(&[
            "sweeps in phase",
            "width in x (mm)",
            "width in z (mm)",
            "error, exact poses (mm)",
            "error, tracked poses (mm)",
        ]),
        rows: LENGTHS.iter().map(|length| length.1).zip(&figures).map(row).collect(),
        caption: format!(
            "Sub-apertures. {DURATION_S:.0} s of preset fine within a sphere of 50 cm. Width: at half of the \
             greatest power, with exact poses. Error: from the truth to the greatest voxel of {} mm within {:.0} cm of \
             it. Medians.",
            VOXEL_M * 1e3,
            AROUND_M * 100.0
        ),
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::Oracle;
    use radar_sar::subaperture::SubapertureSettings;

    #[test]
    fn one_sweep_per_part_is_least_squares_and_longer_parts_are_narrower() {
        let scenario = Scenario {
            snr_db: Some(SNR_DB),
            errors: TrackingErrors::none(),
            ..Scenario::new("corner-reflector", "sphere-50cm", preset("fine").unwrap(), 1.0, 2)
        };
        let recorded = TrialRecording::of(&scenario).unwrap();
        let at = recorded.truth_m;
        let around = Aabb { min: at - 0.5 * VOXEL_M, max: at + 0.5 * VOXEL_M };
        let value = f64::from(image(&recorded.observations, 1, &around).values[0]);
        let oracle =
            Oracle::new(&recorded.observations, &BEAM, &SubapertureSettings::default()).value(Statistic::Ls, at);
        assert!((value / oracle - 1.0).abs() < 0.01, "{value} {oracle}");
        let [one, twelve] = [1, 12].map(|length| width_m(&recorded.observations, length, at, DVec3::X));
        assert!(twelve < 0.5 * one, "{twelve} {one}");
    }
}
