//! Thesis experiment "thinning the data set": which sweeps to keep.

use std::time::Instant;

use super::imaging_methods::{Quality, THESIS_VOXEL_M, chosen, locate, volume};
use super::{ExperimentError, Outcome, Trials, cm, head, mm};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Chart, Series, Table};
use radar_sar::{Selection, Statistic};

const COUNTS: [usize; 4] = [5, 10, 20, 50];
const SELECTIONS: [Selection; 5] =
    [Selection::Random, Selection::Threshold, Selection::ThesisHull, Selection::FarthestPoint, Selection::DOptimal];

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let recorded = trials.reflector("sphere-50cm", "fine", 10.0)?;
    let (mut rows, mut curves) = (Vec::new(), Vec::new());
    for (n, selection) in SELECTIONS.into_iter().enumerate() {
        trials.report_progress(n, SELECTIONS.len());
        let mut points = Vec::new();
        for count in COUNTS {
            let (mut thesis, mut own, mut times_ms) = (Vec::new(), Vec::new(), Vec::new());
            for recorded in &recorded {
                let start = Instant::now();
                let sweeps = chosen(recorded, count, selection);
                times_ms.push(start.elapsed().as_secs_f64() * 1e3);
                let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
                thesis.push(Quality::of(&image, recorded.truth_m).error_m());
                let (refined, _) = locate(&sweeps, recorded.seed);
                own.push(refined.map_or(f64::INFINITY, |refined| refined.position_m.distance(recorded.truth_m)));
            }
            let [thesis, own, time_ms] = [&thesis, &own, &times_ms].map(|values| quantile(values, 0.5));
            let time = format!("{time_ms:.2}");
            rows.push(vec![selection.name().to_owned(), count.to_string(), cm(thesis), mm(own), time]);
            points.push([count as f64, own * 1e3]);
        }
        curves.push((selection, points));
    }
    let at =
        |wanted: Selection, n: usize| curves.iter().find(|curve| curve.0 == wanted).map_or(f64::NAN, |c| c.1[n][1]);
    let random = at(Selection::Random, 1);
    let (hull, farthest, best) =
        (at(Selection::ThesisHull, 1), at(Selection::FarthestPoint, 1), at(Selection::DOptimal, 1));
    let mut outcome = Outcome {
        procedure: format!(
            "From the 1200 sweeps of a recording within a sphere of 50 cm a number is kept: at random, by the \
             thesis' threshold (eq. 3.6), by its hull (eq. 3.7), by farthest point and by the determinant of the \
             information matrix (D-optimal); {} seeds, medians.",
            recorded.len()
        ),
        ..Outcome::default()
    };
    outcome.add_finding(
        "Few sweeps suffice when they are chosen well; the hull's are.",
        hull < random,
        format!(
            "ten sweeps: random {random:.1} mm, hull {hull:.1} mm, farthest point {farthest:.1} mm, D-optimal \
             {best:.1} mm: few do suffice, but of the hull's many points ten are drawn at random, and they may lie \
             close together"
        ),
    );
    outcome.tables.push(Table {
        head: head(&["chosen by", "sweeps", "thesis: error (cm)", "ours: error (mm)", "choosing (ms)"]),
        rows,
        caption: String::new(),
    });
    let series =
        curves.into_iter().map(|(selection, points)| Series { name: selection.name().into(), points, joined: true });
    let chart = Chart {
        title: "Error of the refined position against the number of sweeps".into(),
        x_label: "sweeps kept".into(),
        y_label: "error (mm)".into(),
        x_log: true,
        y_log: true,
        series: series.collect(),
    };
    outcome.draw("error-over-kept", chart.draw(), "Median distance from the truth.");
    Ok(outcome)
}
