//! How many sweeps it takes.

use super::imaged::{Quality, THESIS_VOXEL_M, chosen, observed, placed, volume};
use super::{ExperimentError, Outcome, Trials, cm, head, mm};
use crate::experiments::recorded::quantile;
use crate::imaging::{Selection, Statistic};
use crate::report::{Chart, Marks, Series, Table, cross_sections};

/// The thesis' three, and on.
const COUNTS: [usize; 6] = [1, 5, 20, 50, 200, 1200];
/// Those of which the thesis has pictures.
const SHOWN: [usize; 3] = [1, 5, 50];

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let recorded = trials.reflector("sphere-50cm", "fine", 10.0)?;
    let mut outcome = Outcome {
        done: format!(
            "A corner reflector 1 m deep and 0.3 m to the left, seen for 10 s from within a sphere of 50 cm with preset fine at 40 dB; {} \
             seeds. The thesis' way: its sum over voxels of 10 cm, sweeps by its hull thinning. Ours: least squares, sweeps \
             by farthest point, the place refined.",
            recorded.len()
        ),
        ..Outcome::default()
    };
    let (mut rows, mut thesis_cm, mut worst_cm) = (Vec::new(), Vec::new(), Vec::new());
    let (mut ours_cm, mut footprints) = (Vec::new(), Vec::new());
    for (n, count) in COUNTS.into_iter().enumerate() {
        trials.done(n, COUNTS.len());
        let (mut errors, mut sizes, mut own, mut known) = (Vec::new(), Vec::new(), Vec::new(), "range alone");
        for recorded in &recorded {
            let sweeps = chosen(recorded, count, Selection::ThesisHull);
            let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
            let quality = Quality::of(&image, recorded.truth_m);
            errors.push(quality.error_m());
            sizes.push(quality.footprint_l);
            let (refined, _) = placed(&chosen(recorded, count, Selection::FarthestPoint), recorded.seed);
            own.push(refined.map_or(f64::INFINITY, |refined| refined.position_m.distance(recorded.truth_m)));
            known = observed(refined.as_ref());
            if recorded.seed == 1 && SHOWN.contains(&count) {
                let path: Vec<_> = sweeps.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
                let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &path };
                outcome.keep_volume(&format!("sweeps-{count}"), &image, Statistic::Thesis, sweeps.len())?;
                let title = format!("The thesis' image from {count} sweep{}", if count == 1 { "" } else { "s" });
                let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                outcome.draw(format!("sweeps-{count}"), picture, format!("{title}, as its figures 4.7 to 4.9."));
            }
        }
        let [error, size, own] = [&errors, &sizes, &own].map(|values| quantile(values, 0.5));
        let worst = quantile(&errors, 1.0);
        rows.push(vec![count.to_string(), cm(error), cm(worst), format!("{size:.0}"), mm(own), known.to_owned()]);
        thesis_cm.push([count as f64, error * 100.0]);
        worst_cm.push(worst * 100.0);
        ours_cm.push([count as f64, own * 100.0]);
        footprints.push(size);
    }
    let error = |n: usize| thesis_cm[n][1];
    outcome.finds(
        "One sweep tells the depth and not the direction.",
        worst_cm[0] > 15.0 && rows[0][5] == "range alone",
        format!(
            "one sweep: {:.0} cm off in the median and up to {:.0} cm by the thesis' sum; ours says that the {} was observed",
            error(0),
            worst_cm[0],
            rows[0][5]
        ),
    );
    outcome.finds(
        "Five sweeps place the reflector.",
        error(1) < 20.0,
        format!("five sweeps: {:.0} cm by the thesis' sum, {:.1} cm by ours", error(1), ours_cm[1][1]),
    );
    outcome.finds(
        "Fifty sharpen the image; the gain diminishes rapidly.",
        footprints[3] < 0.9 * footprints[1] && footprints[5] > 0.9 * footprints[3],
        format!(
            "half of the peak fills {:.0} l with 5 sweeps, {:.0} l with 50, {:.0} l with 1200",
            footprints[1], footprints[3], footprints[5]
        ),
    );
    outcome.tables.push(Table {
        head: head(&["sweeps", "thesis: error (cm)", "at most (cm)", "footprint (l)", "ours: error (mm)", "observed"]),
        rows,
        caption: "Medians over the seeds, and the greatest. Footprint: volume of the voxels of at least half of the greatest value.".into(),
    });
    let series = |name: &str, points| Series { name: name.into(), points, joined: true };
    let chart = Chart {
        title: "Error against the number of sweeps".into(),
        x_label: "sweeps".into(),
        y_label: "error (cm)".into(),
        x_log: true,
        y_log: true,
        series: vec![series("the thesis' sum, 10 cm voxels", thesis_cm), series("least squares, refined", ours_cm)],
    };
    outcome.draw("error-over-sweeps", chart.draw(), "Median distance from the truth.");
    Ok(outcome)
}
