//! Thesis experiment "lens choice": images with and without a lens.
//!
//! The simulated lens is the Fresnel lens of `radar::Beam`: 5.7 dB more on the axis, half the
//! amplitude at 11.75° instead of 30°. It has no side lobes; a real lens keeps a small response far
//! off the boresight.

use glam::DVec3;

use super::imaging_methods::{Quality, THESIS_VOXEL_M, chosen, locate_with_beam, seen_share, volume_with_beam};
use super::shape_accuracy::ShapeAccuracy;
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, mm, percent};
use crate::experiments::trial_recording::{TrialRecording, quantile};
use radar_chaperone::report::{Chart, Marks, Series, Table, cross_sections, points_above};
use radar_sar::Beam;
use radar_sar::math;
use radar_sar::{Selection, Statistic, Volume};
use radar_simulation::{Room, SceneError, scene};

/// Without and with lens, and their names.
const LENSES: [(Beam, &str); 2] = [(Beam::Lensless, "no lens"), (Beam::Fresnel, "Fresnel lens")];
/// Beam models used for imaging. The thesis used the first one everywhere: measured with a lens,
/// nothing beyond 45°.
const TEMPLATES: [(Beam, &str); 3] =
    [(Beam::Thesis, "the thesis'"), (Beam::Lensless, "lensless"), (Beam::Fresnel, "Fresnel")];
/// Objects: scene, name, and SNR at 1 m in dB; `None`: by the radar equation.
const OBJECTS: [(&str, &str, Option<f64>); 3] = [
    ("raised-reflector", "reflector", Some(SNR_DB)),
    ("chair", "chair, 40 dB", Some(SNR_DB)),
    ("chair", "chair, radar equation", None),
];
/// Angles of the reflector off the boresight, degrees. Choice: from the lens' beam to far outside
/// it; the number of sweeps is that of the thesis' job.
const ANGLES_DEG: [f64; 7] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
const SWEEPS: usize = 50;
/// Distance from the object beyond which the image counts as elsewhere, metres: two thesis voxels
/// plus the pulse.
const ELSEWHERE_M: f64 = 0.3;

/// Figures of one lens and one beam model; medians over the seeds.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    error_m: f64,
    /// Sweeps that the thesis' thinning keeps.
    kept: f64,
    footprint_l: f64,
    /// Greatest value at the object over the greatest one elsewhere, dB.
    contrast_db: f64,
    /// Precision and recall of the imaged voxels.
    precision: f64,
    recall: f64,
    refined_error_m: f64,
    seen: f64,
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "A corner reflector and a chair, 10 s from within a sphere of 50 cm with preset fine, without a lens and \
             with the Fresnel lens: 5.7 dB more on the axis, half the amplitude at 11.75° instead of 30°, no side \
             lobes. The thesis' image from {SWEEPS} sweeps chosen by its thinning, with each beam model; ours with the \
             true one, from as many sweeps by farthest point. {} seeds, medians.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let objects = images(trials, &mut outcome)?;
    let angles = error_off_boresight(trials, &mut outcome)?;
    findings(&mut outcome, &objects, &angles);
    Ok(outcome)
}

/// Suffix of the lens' name in a legend, and the value drawn.
type Curve = (&'static str, fn(&Figures) -> f64);

/// `[object][lens][template]`.
type ObjectFigures = Vec<[[Figures; 3]; 2]>;

fn images(trials: &Trials, outcome: &mut Outcome) -> Result<ObjectFigures, ExperimentError> {
    let (mut rows, mut figures) = (Vec::new(), Vec::new());
    for (name, words, snr_db) in OBJECTS {
        let mut of_object = [[Figures::default(); 3]; 2];
        for ((beam, lens), of_lens) in LENSES.iter().zip(&mut of_object) {
            let stage = scene(name, 1).map_err(scenario_error)?;
            // The thesis' ideal condition: the boresight points at the middle of the object.
            let middle = middle(&stage.room);
            let recorded = trials.recorded("fine", 10.0, |scenario| {
                scenario.scene = name.into();
                scenario.beam = beam.clone();
                scenario.snr_db = snr_db;
                scenario.look_at_m = Some(middle);
            })?;
            for ((template, model), figures) in TEMPLATES.iter().zip(of_lens) {
                let each: Vec<Figures> = recorded.iter().map(|recorded| figures_of(recorded, beam, template)).collect();
                *figures = medians(&each);
                rows.push(row(&[words, lens, model], figures));
            }
            if snr_db.is_some() {
                let first = &recorded[0];
                let image = thesis_image(first, &TEMPLATES[0].0);
                let points = points(first);
                let marks = Marks { truth_m: &points, found_m: &[], path_m: &[] };
                let title = format!("The thesis' image of a {}, {lens}", words.trim_end_matches(", 40 dB"));
                let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                let file = format!("image-{name}-{}", if *beam == Beam::Lensless { "bare" } else { "lens" });
                outcome.draw(file, picture, format!("{title}, as its figures 4.3 to 4.6."));
            }
        }
        figures.push(of_object);
    }
    outcome.tables.push(Table {
        head: head(&[
            "object",
            "sensor",
            "beam model",
            "kept by the thinning",
            "thesis: error (cm)",
            "footprint (l)",
            "contrast (dB)",
            "precision (%)",
            "recall (%)",
            "ours: error (mm)",
            "sweeps that see it (%)",
        ]),
        rows,
        caption: "The boresight points at the object at the start. Error: from the greatest voxel to the nearest \
            true point. Precision: share of the voxels of at least half of the greatest value within 10 cm of the \
            object; recall: share of its points with such a voxel within 10 cm. Contrast: greatest value at the object \
            over the greatest more than 30 cm away from it. A sweep sees the object with 10 dB over the noise at the \
            range of one of its points."
            .into(),
    });
    Ok(figures)
}

/// `[lens][angle]`.
fn error_off_boresight(trials: &Trials, outcome: &mut Outcome) -> Result<[Vec<Figures>; 2], ExperimentError> {
    let stage = scene("raised-reflector", 1).map_err(scenario_error)?;
    let reflector = middle(&stage.room);
    let (mut rows, mut curves) = (Vec::new(), [Vec::new(), Vec::new()]);
    for angle_deg in ANGLES_DEG {
        for ((beam, lens), curve) in LENSES.iter().zip(&mut curves) {
            let recorded = trials.recorded("fine", 10.0, |scenario| {
                scenario.scene = "raised-reflector".into();
                scenario.beam = beam.clone();
                scenario.snr_db = Some(SNR_DB);
                scenario.look_at_m = Some(off_axis_point(stage.start_m, reflector, angle_deg));
            })?;
            let each: Vec<Figures> =
                recorded.iter().map(|recorded| figures_of(recorded, beam, &TEMPLATES[0].0)).collect();
            let figures = medians(&each);
            rows.push(row(&[&format!("{angle_deg:.0}"), lens], &figures));
            curve.push(figures);
        }
    }
    outcome.tables.push(Table {
        head: head(&[
            "off boresight (°)",
            "sensor",
            "kept by the thinning",
            "thesis: error (cm)",
            "footprint (l)",
            "contrast (dB)",
            "precision (%)",
            "recall (%)",
            "ours: error (mm)",
            "sweeps that see it (%)",
        ]),
        rows,
        caption: "The reflector at this angle from the initial boresight; motion within the sphere changes the angle \
            by up to ±29°."
            .into(),
    });
    let chart = |title: &str, y_label: &str, y_log: bool, of: &[Curve]| {
        let series = LENSES.iter().zip(&curves).flat_map(|((_, lens), curve)| {
            of.iter().map(move |(name, value)| Series {
                name: format!("{lens}{name}"),
                points: ANGLES_DEG.iter().zip(curve).map(|(angle, figures)| [*angle, value(figures)]).collect(),
                joined: true,
            })
        });
        let x_label = "reflector off boresight (°)".into();
        Chart { title: title.into(), x_label, y_label: y_label.into(), x_log: false, y_log, series: series.collect() }
            .draw()
    };
    let seen = chart(
        "How often the reflector is in the beam",
        "sweeps that see it (%)",
        false,
        &[("", |figures| figures.seen * 100.0)],
    );
    outcome.draw("seen-off-gaze", seen, "Share of the sweeps with 10 dB over the noise at the reflector's range.");
    let errors = chart(
        "Error off boresight",
        "error (cm)",
        true,
        &[
            (", the thesis' sum", |figures| figures.error_m * 100.0),
            (", ours", |figures| figures.refined_error_m * 100.0),
        ],
    );
    outcome.draw("error-off-gaze", errors, "Median distance from the truth.");
    Ok(curves)
}

fn findings(outcome: &mut Outcome, objects: &ObjectFigures, angles: &[Vec<Figures>; 2]) {
    let [reflector, chair, weak] = [&objects[0], &objects[1], &objects[2]];
    let of = |object: &[[Figures; 3]; 2], lens: usize| object[lens][0];
    let (bare, lens) = (of(reflector, 0), of(reflector, 1));
    outcome.add_finding(
        "With and without the lens the reflector is located precisely.",
        bare.error_m < 0.15 && lens.error_m < 0.15,
        format!(
            "{} cm off without, {} cm with, from the {:.0} and {:.0} sweeps that the thinning keeps of {SWEEPS}: \
             voxels above half of the peak of a sum of amplitudes fill {:.0} and {:.0} l, and the greatest voxel can \
             lie anywhere within them; ours {} and {} mm off",
            cm(bare.error_m),
            cm(lens.error_m),
            bare.kept,
            lens.kept,
            bare.footprint_l,
            lens.footprint_l,
            mm(bare.refined_error_m),
            mm(lens.refined_error_m)
        ),
    );
    let footprints =
        format!("voxels above half of the peak fill {:.0} l without, {:.0} l with", bare.footprint_l, lens.footprint_l);
    outcome.add_finding(
        "The reflector's image without the lens is a little more concentrated (4.1.1).",
        bare.footprint_l < lens.footprint_l,
        format!("{footprints}: the narrower beam spreads the echo over fewer directions"),
    );
    outcome.add_finding(
        "With the lens the reflector's footprint is a lot smaller (5.2).",
        lens.footprint_l < 0.8 * bare.footprint_l,
        format!("{footprints}; the two sentences of the thesis contradict each other"),
    );
    let (bare_chair, lens_chair) = (of(chair, 0), of(chair, 1));
    outcome.add_finding(
        "The lens gives images of better SNR, of the chair by a lot.",
        lens.contrast_db > bare.contrast_db && lens_chair.contrast_db > bare_chair.contrast_db + 1.0,
        format!(
            "at the object over elsewhere: reflector {:.1} dB without, {:.1} dB with; chair {:.1} and {:.1} dB",
            bare.contrast_db, lens.contrast_db, bare_chair.contrast_db, lens_chair.contrast_db
        ),
    );
    let at = |lens: usize, angle_deg: f64| {
        let n = ANGLES_DEG.iter().position(|angle| *angle == angle_deg).unwrap_or(0);
        angles[lens][n]
    };
    outcome.add_finding(
        "A lens weakens objects at the beam's edge; without one an object is in the beam for longer.",
        at(1, 40.0).seen < at(0, 40.0).seen && of(weak, 1).seen < of(weak, 0).seen,
        format!(
            "sweeps that see the reflector 40° off boresight: {} % without, {} % with; the chair on boresight, at \
             the power of the radar equation: {} and {} %",
            percent(at(0, 40.0).seen),
            percent(at(1, 40.0).seen),
            percent(of(weak, 0).seen),
            percent(of(weak, 1).seen)
        ),
    );
    outcome.add_finding(
        "The lens impedes good images of common objects; so no lens.",
        lens_chair.recall < bare_chair.recall || lens_chair.error_m > bare_chair.error_m + 0.05,
        format!(
            "chair on boresight, within both beams: {} % of its points imaged without, {} % with, {} and {} cm off; \
             the lens costs accuracy off boresight: reflector at 40°: {} and {} cm off by the thesis' sum, {} and {} \
             mm by ours",
            percent(bare_chair.recall),
            percent(lens_chair.recall),
            cm(bare_chair.error_m),
            cm(lens_chair.error_m),
            cm(at(0, 40.0).error_m),
            cm(at(1, 40.0).error_m),
            mm(at(0, 40.0).refined_error_m),
            mm(at(1, 40.0).refined_error_m)
        ),
    );
    let spread = |lens: usize| {
        let errors = [&reflector[lens], &chair[lens]].map(|of| of.map(|figures| figures.error_m));
        errors.iter().map(|e| quantile(e, 1.0) - quantile(e, 0.0)).fold(0.0, f64::max)
    };
    outcome.add_finding(
        "One template suffices with and without a lens: the falloff over the angle need not be precise.",
        spread(0) < THESIS_VOXEL_M && spread(1) < THESIS_VOXEL_M,
        format!(
            "the errors by three beam models differ by at most {} cm without the lens, {} cm with it",
            cm(spread(0)),
            cm(spread(1))
        ),
    );
}

/// A point at the distance of another one, this many degrees to the right as seen from the sensor.
fn off_axis_point(from: DVec3, point: DVec3, angle_deg: f64) -> DVec3 {
    let to = point - from;
    let right = to.cross(DVec3::Y).normalize();
    let (sin, cos) = math::sin_cos(angle_deg.to_radians());
    from + to * cos + right * (to.length() * sin)
}

/// Mean position of the scatterers.
fn middle(room: &Room) -> DVec3 {
    let count = room.scatterers().count().max(1);
    room.scatterers().map(|scatterer| scatterer.position_m).sum::<DVec3>() / count as f64
}

fn points(recorded: &TrialRecording) -> Vec<DVec3> {
    recorded.truth.obstacles.iter().flat_map(|o| o.points_m.iter().copied()).collect()
}

fn thesis_image(recorded: &TrialRecording, template: &Beam) -> Volume {
    let sweeps = chosen(recorded, SWEEPS, Selection::ThesisHull);
    volume_with_beam(template, &sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed)
}

/// The thesis' image with a beam model; our position with the true beam.
fn figures_of(recorded: &TrialRecording, beam: &Beam, template: &Beam) -> Figures {
    let points = points(recorded);
    let nearest = |point: DVec3| points.iter().map(|p| p.distance(point)).fold(f64::INFINITY, f64::min);
    let image = thesis_image(recorded, template);
    let quality = Quality::of(&image, DVec3::ZERO);
    let accuracy = ShapeAccuracy::of(&points_above(&image, 0.5), image.voxel_m, &points);
    let (refined, _) = locate_with_beam(beam, &chosen(recorded, SWEEPS, Selection::FarthestPoint), recorded.seed);
    Figures {
        error_m: nearest(quality.off_m),
        kept: chosen(recorded, SWEEPS, Selection::ThesisHull).len() as f64,
        footprint_l: quality.footprint_l,
        contrast_db: contrast_db(&image, &nearest),
        precision: accuracy.precision,
        recall: accuracy.recall,
        refined_error_m: refined.map_or(f64::INFINITY, |refined| nearest(refined.position_m)),
        seen: seen_share(&recorded.observations, &points),
    }
}

/// Greatest value at the object over the greatest one elsewhere, dB of amplitude. The median voxel
/// is no reference: it lies outside the beam of most sweeps and would measure how steep the beam
/// model is.
fn contrast_db(image: &Volume, nearest_m: &impl Fn(DVec3) -> f64) -> f64 {
    let away = |index: &usize| nearest_m(image.center(image.voxel(*index))) > ELSEWHERE_M;
    let elsewhere = (0..image.values.len()).filter(away).map(|index| image.values[index]).fold(0.0, f32::max);
    let at_it = (0..image.values.len()).filter(|n| !away(n)).map(|index| image.values[index]).fold(0.0, f32::max);
    20.0 * math::log10(f64::from(at_it / elsewhere.max(f32::MIN_POSITIVE)))
}

fn medians(each: &[Figures]) -> Figures {
    let middle = |of: fn(&Figures) -> f64| quantile(&each.iter().map(of).collect::<Vec<_>>(), 0.5);
    Figures {
        error_m: middle(|f| f.error_m),
        kept: middle(|f| f.kept),
        footprint_l: middle(|f| f.footprint_l),
        contrast_db: middle(|f| f.contrast_db),
        precision: middle(|f| f.precision),
        recall: middle(|f| f.recall),
        refined_error_m: middle(|f| f.refined_error_m),
        seen: middle(|f| f.seen),
    }
}

fn row(names: &[&str], figures: &Figures) -> Vec<String> {
    let names = names.iter().map(|name| (*name).to_owned());
    let figures = [
        format!("{:.0}", figures.kept),
        cm(figures.error_m),
        format!("{:.0}", figures.footprint_l),
        format!("{:.1}", figures.contrast_db),
        percent(figures.precision),
        percent(figures.recall),
        mm(figures.refined_error_m),
        percent(figures.seen),
    ];
    names.chain(figures).collect()
}

fn scenario_error(error: SceneError) -> ExperimentError {
    ExperimentError::Scenario(error.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn off_axis_point_keeps_distance_and_angle() {
        let (from, point) = (DVec3::new(0.0, 1.5, 0.0), DVec3::new(-0.3, 1.7, -1.0));
        for angle_deg in ANGLES_DEG {
            let looked_at = off_axis_point(from, point, angle_deg);
            let angle = (looked_at - from).angle_between(point - from).to_degrees();
            assert!((angle - angle_deg).abs() < 1e-4 && (looked_at.distance(from) - point.distance(from)).abs() < 1e-9);
        }
        assert!(off_axis_point(from, point, 30.0).x > point.x);
    }
}
