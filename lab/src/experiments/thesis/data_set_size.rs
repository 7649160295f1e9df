//! Thesis experiment "data set size": error against the number of sweeps.

use super::imaging_methods::{Quality, THESIS_VOXEL_M, chosen, locate, observed, volume};
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, mm};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Chart, Marks, Series, Table, cross_sections};
use radar_sar::{Selection, Statistic};

/// The thesis' three numbers of sweeps, and further ones.
const COUNTS: [usize; 8] = [1, 2, 3, 5, 20, 50, 200, 1200];
/// SNR of a weak target, dB. Choice: a hundredth of the reflector's power.
const WEAK_DB: f64 = 20.0;
/// Numbers of sweeps with a picture in the thesis.
const SHOWN: [usize; 3] = [1, 5, 50];

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "A corner reflector 1 m deep, 0.3 m to the left and 0.2 m above the sensor, observed for 10 s from \
             within a sphere of 50 cm with preset fine at 40 and at 20 dB; {} seeds. The thesis' method: its sum over \
             voxels of 10 cm, sweeps chosen by its hull thinning. Ours: least squares, sweeps chosen by farthest \
             point, the position refined.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let strong = at_snr(trials, SNR_DB, &mut outcome)?;
    let weak = at_snr(trials, WEAK_DB, &mut outcome)?;
    findings(&mut outcome, &strong, &weak);
    let series = |name: &str, points: Vec<[f64; 2]>| Series { name: name.into(), points, joined: true };
    let of = |at: &ResultsAtSnr, error_m: fn(&SweepCountResult) -> f64| -> Vec<[f64; 2]> {
        COUNTS.iter().zip(at).map(|(count, counted)| [*count as f64, error_m(counted) * 100.0]).collect()
    };
    let chart = Chart {
        title: "Error against the number of sweeps".into(),
        x_label: "sweeps".into(),
        y_label: "error (cm)".into(),
        x_log: true,
        y_log: true,
        series: vec![
            series("the thesis' sum, 40 dB", of(&strong, |c| c.error_m)),
            series("least squares, refined, 40 dB", of(&strong, |c| c.refined_error_m)),
            series("the thesis' sum, 20 dB", of(&weak, |c| c.error_m)),
            series("least squares, refined, 20 dB", of(&weak, |c| c.refined_error_m)),
        ],
    };
    outcome.draw("error-over-sweeps", chart.draw(), "Median distance from the truth.");
    let rows = [(SNR_DB, &strong), (WEAK_DB, &weak)]
        .into_iter()
        .flat_map(|(snr_db, at)| COUNTS.iter().zip(at).map(move |(count, counted)| counted.row(snr_db, *count)));
    outcome.tables.push(Table {
        head: head(&[
            "sweeps",
            "SNR (dB)",
            "kept by the thinning",
            "thesis: error (cm)",
            "maximum (cm)",
            "footprint (l)",
            "ours: error (mm)",
            "observed",
        ]),
        rows: rows.collect(),
        caption: "Medians over the seeds, and the maximum. SNR: power, of one sweep, on the axis at 1 m. Footprint: \
            volume of the voxels of at least half of the greatest value."
            .into(),
    });
    Ok(outcome)
}

/// Results for one number of sweeps; medians over the seeds.
struct SweepCountResult {
    /// Sweeps that the thesis' thinning keeps of those requested.
    kept: f64,
    error_m: f64,
    worst_m: f64,
    footprint_l: f64,
    refined_error_m: f64,
    known: &'static str,
}

impl SweepCountResult {
    fn row(&self, snr_db: f64, count: usize) -> Vec<String> {
        let footprint = format!("{:.0}", self.footprint_l);
        let [error, worst, own] = [cm(self.error_m), cm(self.worst_m), mm(self.refined_error_m)];
        let kept = format!("{:.0}", self.kept);
        vec![count.to_string(), format!("{snr_db:.0}"), kept, error, worst, footprint, own, self.known.to_owned()]
    }
}

/// One entry for each of `COUNTS`.
type ResultsAtSnr = Vec<SweepCountResult>;

fn at_snr(trials: &Trials, snr_db: f64, outcome: &mut Outcome) -> Result<ResultsAtSnr, ExperimentError> {
    let recorded = trials.recorded("fine", 10.0, |scenario| {
        scenario.scene = "raised-reflector".into();
        scenario.snr_db = Some(snr_db);
    })?;
    let mut at = Vec::new();
    let before = if snr_db == SNR_DB { 0 } else { COUNTS.len() };
    for (n, count) in COUNTS.into_iter().enumerate() {
        trials.report_progress(before + n, 2 * COUNTS.len());
        let (mut errors, mut sizes, mut own, mut all) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut kept = Vec::new();
        for recorded in &recorded {
            let sweeps = chosen(recorded, count, Selection::ThesisHull);
            let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
            let quality = Quality::of(&image, recorded.truth_m);
            errors.push(quality.error_m());
            sizes.push(quality.footprint_l);
            kept.push(sweeps.len() as f64);
            let (refined, _) = locate(&chosen(recorded, count, Selection::FarthestPoint), recorded.seed);
            own.push(refined.as_ref().map_or(f64::INFINITY, |r| r.position_m.distance(recorded.truth_m)));
            all.push(refined);
            if recorded.seed == 1 && snr_db == SNR_DB && SHOWN.contains(&count) {
                let path: Vec<_> = sweeps.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
                let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &path };
                outcome.keep_volume(&format!("sweeps-{count}"), &image, Statistic::Thesis, sweeps.len())?;
                let title = format!("The thesis' image from {count} sweep{}", if count == 1 { "" } else { "s" });
                let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                outcome.draw(format!("sweeps-{count}"), picture, format!("{title}, as its figures 4.7 to 4.9."));
            }
        }
        let [error_m, footprint_l, refined_error_m] = [&errors, &sizes, &own].map(|values| quantile(values, 0.5));
        let (worst_m, kept, known) = (quantile(&errors, 1.0), quantile(&kept, 0.5), observed(&all));
        at.push(SweepCountResult { kept, error_m, worst_m, footprint_l, refined_error_m, known });
    }
    Ok(at)
}

fn findings(outcome: &mut Outcome, strong: &ResultsAtSnr, weak: &ResultsAtSnr) {
    outcome.add_finding(
        "One sweep gives the depth, not the direction.",
        strong[0].worst_m > 0.15 && strong[0].known == "range alone",
        format!(
            "one sweep: {} cm off in the median and up to {} cm by the thesis' sum; ours reports as observed: {}",
            cm(strong[0].error_m),
            cm(strong[0].worst_m),
            strong[0].known
        ),
    );
    outcome.add_finding(
        "Three points that span both axes should suffice (a theory of 5.1, left to be measured).",
        strong[2].refined_error_m < THESIS_VOXEL_M,
        format!(
            "two sweeps: {} cm off by the thesis' sum; three: {} cm, and {} cm by ours from the three farthest from \
             each other, observed: {}. Three ranges meet in two points, mirror images in the plane of the three sensor \
             positions; the data do not decide between them",
            cm(strong[1].error_m),
            cm(strong[2].error_m),
            cm(strong[2].refined_error_m),
            strong[2].known
        ),
    );
    outcome.add_finding(
        "Five sweeps locate the reflector.",
        strong[3].error_m < 0.2,
        format!(
            "five sweeps: {} cm by the thesis' sum, {} cm by ours; at 20 dB {} and {} cm",
            cm(strong[3].error_m),
            cm(strong[3].refined_error_m),
            cm(weak[3].error_m),
            cm(weak[3].refined_error_m)
        ),
    );
    outcome.add_finding(
        "Fifty sharpen the image; the gain diminishes rapidly.",
        strong[5].footprint_l < 0.9 * strong[3].footprint_l && strong[7].footprint_l > 0.9 * strong[5].footprint_l,
        format!(
            "voxels above half of the peak fill {:.0} l with 5 sweeps, {:.0} l with 50, {:.0} l with 1200: of 50 the \
             thinning, which keeps the hull within 6 dB of the strongest sweep, keeps {:.0}, of 1200 {:.0}",
            strong[3].footprint_l, strong[5].footprint_l, strong[7].footprint_l, strong[5].kept, strong[7].kept
        ),
    );
}
