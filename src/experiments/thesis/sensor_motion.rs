//! What motion tells: at rest, within spheres, along a line.

use glam::DVec3;

use super::imaged::{Quality, THESIS_VOXEL_M, chosen, observed, placed, volume};
use super::{ExperimentError, Outcome, Trials, cm, head, mm};
use crate::experiments::recorded::quantile;
use crate::imaging::{Selection, Statistic};
use crate::radar::Observation;
use crate::report::{Marks, Table, cross_sections, motion_plot};

/// The thesis' motions, with the words for them.
const MOTIONS: [(&str, &str); 5] = [
    ("stationary", "at rest"),
    ("sphere-10cm", "within a sphere of 10 cm"),
    ("sphere-50cm", "within a sphere of 50 cm"),
    ("x-10cm", "along x by 10 cm"),
    ("x-50cm", "along x by 50 cm"),
];
/// Sweeps that the thesis images.
const SWEEPS: usize = 50;

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        done: format!(
            "The same reflector, 10 s with preset fine, 40 dB, {} seeds; the thesis' image from {SWEEPS} sweeps by its thinning, ours from \
             as many by farthest point. With 20 dB the thesis' sum is greatest near the sensor, where its weight 1/d² lifts the noise: 84 cm off \
             at rest and 80 cm with 10 cm of motion.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let (mut rows, mut thesis, mut told) = (Vec::new(), Vec::new(), Vec::new());
    for (n, (motion, words)) in MOTIONS.into_iter().enumerate() {
        trials.done(n, MOTIONS.len());
        let (mut off, mut extents, mut own, mut known) = (Vec::new(), Vec::new(), Vec::new(), "range alone");
        for recorded in &trials.reflector(motion, "fine", 10.0)? {
            let sweeps = chosen(recorded, SWEEPS, Selection::ThesisHull);
            let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
            let quality = Quality::of(&image, recorded.truth_m);
            off.push(quality.off_m);
            extents.push(quality.extent_m);
            let (refined, _) = placed(&chosen(recorded, SWEEPS, Selection::FarthestPoint), recorded.seed);
            own.push(refined.map_or(f64::INFINITY, |refined| refined.position_m.distance(recorded.truth_m)));
            known = observed(refined.as_ref());
            if recorded.seed == 1 {
                let path: Vec<DVec3> = sweeps.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
                let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &path };
                outcome.keep_volume(&format!("image-{motion}"), &image, Statistic::Thesis, sweeps.len())?;
                let title = format!("The thesis' image, sensor {words}");
                let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                outcome.draw(format!("image-{motion}"), picture, format!("{title}."));
                let before = motion_plot(&timed(&recorded.observations), &format!("The aperture, sensor {words}"));
                outcome.draw(format!("aperture-{motion}"), before, "Every sweep.");
                let after =
                    motion_plot(&timed(&sweeps), &format!("The same after thinning to {} sweeps", sweeps.len()));
                outcome.draw(
                    format!("thinned-{motion}"),
                    after,
                    "The thesis' thinning: those on the hull, strong enough.",
                );
            }
        }
        let middle = |all: &[DVec3], axis: fn(&DVec3) -> f64| {
            quantile(&all.iter().map(|v| axis(v).abs()).collect::<Vec<_>>(), 0.5)
        };
        let [x, y, z] = [|v: &DVec3| v.x, |v: &DVec3| v.y, |v: &DVec3| v.z].map(|axis| middle(&extents, axis));
        let off_x = middle(&off, |v| v.x);
        let error = quantile(&off.iter().map(|off| off.length()).collect::<Vec<_>>(), 0.5);
        let own = quantile(&own, 0.5);
        rows.push(vec![words.to_owned(), cm(error), cm(x), cm(y), cm(z), mm(own), known.to_owned()]);
        thesis.push([error, off_x, x, y]);
        told.push(format!("{} cm, ours {} mm ({known})", cm(error), mm(own)));
    }
    outcome.finds(
        "At rest the reflector is seen right in front, wherever it is.",
        (thesis[0][1] - 0.3).abs() < 0.1,
        format!("at rest {}; {} cm of it in x, and it stands 30 cm to the left", told[0], cm(thesis[0][1])),
    );
    outcome.finds(
        "Ten centimetres of motion place it, slightly blurred; fifty place it well.",
        thesis[1][0] < 0.25 && thesis[2][0] < 0.15,
        format!("10 cm: {}; 50 cm: {}", told[1], told[2]),
    );
    outcome.finds(
        "Motion along x tells x and leaves the height open.",
        // The reflector stands at the sensor's height here, where the beam alone puts it: the image would have to be drawn out.
        (thesis[4][1] < 0.15 && thesis[4][3] > 1.5 * thesis[4][2]).then_some(true),
        format!(
            "along x by 50 cm: {} cm off in x; ours says that {} was observed; half of the thesis' peak spans {} cm in x and {} cm in y, as the beam does",
            cm(thesis[4][1]),
            rows[4][6],
            cm(thesis[4][2]),
            cm(thesis[4][3])
        ),
    );
    outcome.tables.push(Table {
        head: head(&["sensor", "thesis: error (cm)", "spans x (cm)", "y (cm)", "z (cm)", "ours: error (mm)", "observed"]),
        rows,
        caption: "Medians. Spans: the box around the voxels of at least half of the greatest value. Observed: what our covariance says that the motion told.".into(),
    });
    Ok(outcome)
}

/// A path as it is drawn: seconds since the first sweep, and places.
fn timed(sweeps: &[Observation]) -> Vec<(f64, DVec3)> {
    let start_ns = sweeps.iter().map(|sweep| sweep.mid_time_ns).min().unwrap_or(0);
    let mut path: Vec<(f64, DVec3)> = sweeps
        .iter()
        .map(|sweep| ((sweep.mid_time_ns - start_ns) as f64 * 1e-9, sweep.tracking_from_sensor.translation))
        .collect();
    path.sort_by(|a, b| a.0.total_cmp(&b.0));
    path
}
