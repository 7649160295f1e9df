//! Thesis experiment "matched filter": the full and the reduced filter and other statistics.

use std::time::Instant;

use super::imaging_methods::{Quality, THESIS_VOXEL_M, chosen, volume};
use super::{ExperimentError, Outcome, Trials, cm, false_alarms, head, subapertures};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Marks, Table, cross_sections};
use radar_sar::{Selection, Statistic};

/// All statistics that are one sum over sweeps.
const STATISTICS: [Statistic; 6] =
    [Statistic::ThesisFull, Statistic::Thesis, Statistic::Ls, Statistic::Log, Statistic::Glrt, Statistic::Coherent];
/// Number of sweeps per image. Choice: the thesis' job.
const SWEEPS: usize = 50;
/// Voxel edge below the thesis', to see more than the voxel size, metres.
const FINE_VOXEL_M: f64 = 0.04;

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let recorded = trials.reflector("sphere-50cm", "fine", 10.0)?;
    let mut outcome = Outcome {
        procedure: format!(
            "The same {SWEEPS} sweeps, chosen by farthest point, imaged by every statistic over voxels of 10 and of \
             4 cm; {} seeds, medians. Times are of a dense volume, tables included. Then sub-apertures (coherent sums \
             over consecutive sweeps) and thresholds that noise exceeds at a stated rate.",
            recorded.len()
        ),
        ..Outcome::default()
    };
    let (mut rows, mut figures) = (Vec::new(), Vec::new());
    // Sub-apertures and false alarms take about four times as long.
    for (n, statistic) in STATISTICS.into_iter().enumerate() {
        trials.report_progress(n, 5 * STATISTICS.len());
        let mut row = vec![statistic.name().to_owned()];
        let mut of_voxels = Vec::new();
        for voxel_m in [THESIS_VOXEL_M, FINE_VOXEL_M] {
            let (mut errors, mut sizes, mut contrasts, mut times_ms) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            for recorded in &recorded {
                let sweeps = chosen(recorded, SWEEPS, Selection::FarthestPoint);
                let start = Instant::now();
                let image = volume(&sweeps, statistic, voxel_m, recorded.seed);
                times_ms.push(start.elapsed().as_secs_f64() * 1e3);
                let quality = Quality::of(&image, recorded.truth_m);
                errors.push(quality.error_m());
                sizes.push(quality.footprint_l);
                contrasts.push(quality.contrast_db);
                if recorded.seed == 1 && voxel_m == FINE_VOXEL_M {
                    let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &[] };
                    let title = format!("{} over voxels of 4 cm", statistic.name());
                    let picture = cross_sections(&image, &title, "value of the sum", &marks);
                    outcome.draw(format!("image-{}", statistic.name()), picture, format!("{title}."));
                }
            }
            let [error, size, contrast, time] =
                [&errors, &sizes, &contrasts, &times_ms].map(|values| quantile(values, 0.5));
            row.extend([cm(error), format!("{size:.1}"), format!("{contrast:.1}"), format!("{time:.2}")]);
            of_voxels.push((error, time));
        }
        rows.push(row);
        figures.push(of_voxels);
    }
    let [full, reduced] = [0, 1].map(|n: usize| figures[n][0]);
    outcome.add_finding(
        "The reduced filter (eq. 3.2) gives the image of the full one (eq. 3.1) in less time.",
        (full.0 - reduced.0).abs() < 0.1 && reduced.1 < full.1,
        format!(
            "10 cm voxels: {} against {} cm off, {:.2} against {:.2} ms. Both look up one value per voxel and sweep, \
             since the full filter's sum over the pulse is tabulated by range; the full filter smooths by the pulse \
             once more, which widens its peak",
            cm(reduced.0),
            cm(full.0),
            reduced.1,
            full.1
        ),
    );
    let (reduced, ls) = (figures[1][1], figures[2][1]);
    outcome.add_finding(
        "Other filters are good candidates (5.8.1).",
        ls.0 < reduced.0,
        format!("4 cm voxels: {} cm off with least squares, {} cm with the thesis' sum", cm(ls.0), cm(reduced.0)),
    );
    let columns = ["error (cm)", "footprint (l)", "contrast (dB)", "time (ms)"];
    let of = |voxel: &str| columns.map(|column| format!("{voxel}: {column}")).to_vec();
    outcome.tables.push(Table {
        head: [head(&["statistic"]), of("10 cm"), of("4 cm")].concat(),
        rows,
        caption: "Contrast: the greatest value over the median one. The coherent sum over all sweeps needs poses \
            right to a fraction of a wavelength (5 mm), which tracking does not provide."
            .into(),
    });
    trials.report_progress(1, 5);
    subapertures::add(trials, &mut outcome)?;
    trials.report_progress(2, 5);
    false_alarms::add(trials, &mut outcome)?;
    Ok(outcome)
}
