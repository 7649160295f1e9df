//! Thesis experiment "common objects": how clothes hanger, chair and two chairs are imaged.

use glam::DVec3;

use super::imaging_methods::{BEAM, Quality, THESIS_VOXEL_M, chosen, volume};
use super::peak_separation::{PeakSeparation, RAYLEIGH_DIP};
use super::shape_accuracy::ShapeAccuracy;
use super::shape_image::{FINE_VOXEL_M, subaperture_image};
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, percent};
use crate::experiments::trial_recording::{TrialRecording, quantile};
use radar_chaperone::report::{Chart, Marks, Series, Table, cross_sections, point_cloud, points_above};
use radar_sar::geometry::Aabb;
use radar_sar::math;
use radar_sar::{Selection, Statistic, Volume};
use radar_simulation::{Scatterer, scene};

/// The thesis' three scenes.
const SCENES: [(&str, &str); 3] =
    [("clothes-hanger", "clothes hanger"), ("chair", "chair"), ("two-chairs", "two chairs")];
/// Indices of the scenes.
const HANGER: usize = 0;
const CHAIR: usize = 1;
const CHAIRS: usize = 2;
/// Imaging methods: name, file, meaning of the values.
const METHODS: [(&str, &str, &str); 5] = [
    ("the thesis' sum", "plain", "correlation (amplitude)"),
    ("squared", "squared", "correlation² (power)"),
    ("squared, 4 cm voxels", "squared-4cm", "correlation² (power)"),
    ("sub-apertures", "sub-apertures", "amplitude over the noise's"),
    ("sub-apertures, squared", "sub-apertures-squared", "power over the noise's"),
];
/// Indices of the imaging methods.
const PLAIN: usize = 0;
const SQUARED: usize = 1;
const FINER: usize = 2;
const COHERENT: usize = 3;
const COHERENT_SQUARED: usize = 4;
/// Methods that are drawn, the thesis' and ours: as cross-sections, as a cloud, and the cloud's
/// threshold as a share of the greatest value.
const DRAWN: [(usize, usize, f64); 2] = [(SQUARED, SQUARED, 0.5), (COHERENT_SQUARED, COHERENT, 0.35)];
/// A voxel edge below the thesis' 10 cm, to test whether the voxel size hides detail, metres.
const FINER_VOXEL_M: f64 = 0.04;
const SWEEPS: usize = 50;
/// Duration of the coherent recording, seconds. Choice: long enough for views from all over the
/// sphere.
const COHERENT_S: f64 = 4.0;
/// Chair points below this height are the feet of the metal legs, the others seat and back, metres.
/// Choice: between the feet and the seat at 0.45 m.
const LEGS_BELOW_M: f64 = 0.2;
/// Tolerance of a size, metres: one thesis voxel on either side.
const SIZE_TOLERANCE_M: f64 = 2.0 * THESIS_VOXEL_M;

/// Lowest threshold of the precision–recall curves as a share of the greatest amplitude; from 95 %
/// downwards in steps of `SHARE_STEP`. Choice: below, noise fills the image.
const MIN_SHARE: f64 = 0.3;
const SHARE_STEP: f64 = 0.05;

/// Figures of one method and one object; medians over the seeds.
#[derive(Debug, Clone, Copy)]
struct Figures {
    accuracy: ShapeAccuracy,
    true_extent_m: DVec3,
    /// Chairs: greatest value at seat and back as a share of that at the legs.
    wood: f64,
    /// Chairs: received power of the strongest point of seat and back over that of the legs, dB.
    received_db: f64,
    legs_recall: f64,
    wood_recall: f64,
    /// Two chairs; `None` where most trials have no value at one of them.
    apart: Option<PeakSeparation>,
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "A clothes hanger, a chair, and a metal chair beside a plastic one (8 dB weaker), imaged from within a \
             sphere of 50 cm, 40 dB at 1 m for the strongest point; {} seeds, medians. The thesis' method: its sum \
             over {SWEEPS} sweeps chosen by its thinning (10 s, preset fine), plain, and squared as the thesis drew \
             it. Ours: {COHERENT_S:.0} s with preset d16, coherent within sub-apertures of 360 ms, power summed across \
             them, voxels of 1.25 cm. A voxel counts as imaged when it has at least half of the greatest value.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let (mut rows, mut all, mut curves) = (Vec::new(), Vec::new(), Vec::new());
    for (scene, words) in SCENES {
        let simulated = |preset, duration_s| {
            trials.recorded(preset, duration_s, |scenario| {
                scenario.scene = scene.into();
                scenario.snr_db = Some(SNR_DB);
            })
        };
        let (slow, fast) = (simulated("fine", 10.0)?, simulated("d16", COHERENT_S)?);
        let mut each: [Vec<Figures>; 5] = Default::default();
        let mut traded: [Vec<Vec<[f64; 2]>>; 2] = Default::default();
        for (slow, fast) in slow.iter().zip(&fast) {
            let images = images(slow, fast);
            let received_db = received_db(scene, slow)?;
            for (figures, image) in each.iter_mut().zip(&images) {
                figures.push(Figures { received_db, ..Figures::of(image, slow) });
            }
            for (traded, way) in traded.iter_mut().zip([PLAIN, COHERENT]) {
                traded.push(trade_off(&images[way], &points(slow)));
            }
            if slow.seed == 1 {
                draw(&mut outcome, scene, words, &images, slow);
            }
        }
        let medians = each.map(|each| Figures::medians(&each));
        for ((way, _, _), figures) in METHODS.iter().zip(&medians) {
            rows.push(figures.row(words, way));
        }
        for (traded, way) in traded.iter().zip([PLAIN, COHERENT]) {
            curves.push((
                format!("{words}, {}", if way == PLAIN { "the thesis' sum" } else { "sub-apertures" }),
                median_curve(traded),
            ));
        }
        all.push(medians);
    }
    tables(&mut outcome, rows, &all);
    let series = curves.into_iter().map(|(name, points)| Series { name, points, joined: true });
    let chart = Chart {
        title: "Precision over recall as the threshold falls from the peak".into(),
        x_label: "recall: object points with an imaged voxel within 10 cm (%)".into(),
        y_label: "precision: imaged voxels within 10 cm of the object (%)".into(),
        x_log: false,
        y_log: false,
        series: series.collect(),
    };
    outcome.draw(
        "precision-over-recall",
        chart.draw(),
        "Thresholds from 95 to 30 % of the greatest amplitude, medians. Squaring keeps the order of the voxels: it \
         moves along these curves and does not change them.",
    );
    findings(&mut outcome, &all, point_extent_m(trials)?);
    Ok(outcome)
}

/// One image per method.
fn images(slow: &TrialRecording, fast: &TrialRecording) -> [Volume; 5] {
    let sweeps = chosen(slow, SWEEPS, Selection::ThesisHull);
    let plain = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, slow.seed);
    let squared = squared(plain.clone());
    let finer = self::squared(volume(&sweeps, Statistic::Thesis, FINER_VOXEL_M, slow.seed));
    // An empty image where nothing is detected.
    let coherent = subaperture_image(fast)
        .unwrap_or_else(|| Volume::covering(&Aabb { min: DVec3::ZERO, max: DVec3::splat(FINE_VOXEL_M) }, FINE_VOXEL_M));
    let coherent_squared = self::squared(coherent.clone());
    [plain, squared, finer, coherent, coherent_squared]
}

fn squared(mut volume: Volume) -> Volume {
    volume.values.iter_mut().for_each(|value| *value *= *value);
    volume
}

fn points(recorded: &TrialRecording) -> Vec<DVec3> {
    recorded.truth.obstacles.iter().flat_map(|o| o.points_m.iter().copied()).collect()
}

impl Figures {
    fn of(image: &Volume, recorded: &TrialRecording) -> Self {
        let all = points(recorded);
        let imaged = points_above(image, 0.5);
        let (legs, wood): (Vec<DVec3>, Vec<DVec3>) = all.iter().partition(|point| point.y < LEGS_BELOW_M);
        let recall = |points: &[DVec3]| ShapeAccuracy::of(&imaged, image.voxel_m, points).recall;
        let greatest = |points: &[DVec3]| {
            let near = |at: DVec3| points.iter().any(|point| point.distance(at) <= THESIS_VOXEL_M);
            let lit = (0..image.values.len()).filter(|&n| image.values[n] > 0.0);
            lit.filter(|&n| near(image.center(image.voxel(n)))).map(|n| f64::from(image.values[n])).fold(0.0, f64::max)
        };
        let apart = match recorded.truth.obstacles.as_slice() {
            [a, b] => PeakSeparation::of(image, [&a.points_m, &b.points_m]),
            _ => None,
        };
        Self {
            accuracy: ShapeAccuracy::of(&imaged, image.voxel_m, &all),
            true_extent_m: Aabb::around(all.iter().copied()).map_or(DVec3::ZERO, |b| b.size()),
            wood: greatest(&wood) / greatest(&legs),
            received_db: 0.0,
            legs_recall: recall(&legs),
            wood_recall: recall(&wood),
            apart,
        }
    }

    fn medians(each: &[Self]) -> Self {
        let middle = |of: &dyn Fn(&Self) -> f64| quantile(&each.iter().map(of).collect::<Vec<_>>(), 0.5);
        let axes = |of: &dyn Fn(&Self) -> DVec3| DVec3::from_array([0, 1, 2].map(|axis| middle(&|f| of(f)[axis])));
        let apart: Vec<PeakSeparation> = each.iter().filter_map(|figures| figures.apart).collect();
        let of_apart = |of: fn(&PeakSeparation) -> f64| quantile(&apart.iter().map(of).collect::<Vec<_>>(), 0.5);
        Self {
            accuracy: ShapeAccuracy {
                off_m: middle(&|f| f.accuracy.off_m),
                precision: middle(&|f| f.accuracy.precision),
                recall: middle(&|f| f.accuracy.recall),
                extent_m: axes(&|f| f.accuracy.extent_m),
                shift_m: axes(&|f| f.accuracy.shift_m),
            },
            true_extent_m: axes(&|f| f.true_extent_m),
            wood: middle(&|f| f.wood),
            received_db: middle(&|f| f.received_db),
            legs_recall: middle(&|f| f.legs_recall),
            wood_recall: middle(&|f| f.wood_recall),
            apart: (2 * apart.len() > each.len())
                .then(|| PeakSeparation { weaker: of_apart(|a| a.weaker), dip: of_apart(|a| a.dip) }),
        }
    }

    fn row(&self, object: &str, way: &str) -> Vec<String> {
        let accuracy = &self.accuracy;
        vec![
            object.into(),
            way.into(),
            cm(accuracy.off_m),
            percent(accuracy.precision),
            percent(accuracy.recall),
            size(accuracy.extent_m),
            size(self.true_extent_m),
            cm(accuracy.shift_m.y),
        ]
    }

    fn size_matches(&self) -> bool {
        (self.accuracy.extent_m - self.true_extent_m).abs().max_element() <= SIZE_TOLERANCE_M
    }
}

/// Received power of a chair's strongest point of seat and back over that of its legs, dB.
fn received_db(name: &str, recorded: &TrialRecording) -> Result<f64, ExperimentError> {
    let room = scene(name, recorded.seed).map_err(|error| ExperimentError::Scenario(error.into()))?.room;
    let power = |scatterer: &Scatterer| {
        let each = recorded.observations.iter().step_by(10).map(|sweep| {
            let to = scatterer.position_m - sweep.tracking_from_sensor.translation;
            let rcs = math::powf(10f64, scatterer.rcs_towards_dbsm(-to.normalize_or_zero()) / 10.0);
            rcs * (BEAM.amplitude(sweep.cos_off_boresight(scatterer.position_m)) / to.length_squared()).powi(2)
        });
        each.sum::<f64>()
    };
    let strongest = |legs: bool| {
        let part = room.scatterers().filter(|scatterer| (scatterer.position_m.y < LEGS_BELOW_M) == legs);
        part.map(power).fold(0.0, f64::max)
    };
    Ok(10.0 * math::log10(strongest(false) / strongest(true)))
}

/// Extent of a point target (corner reflector) in the squared thesis sum, metres.
fn point_extent_m(trials: &Trials) -> Result<DVec3, ExperimentError> {
    let extents: Vec<DVec3> = trials
        .reflector("sphere-50cm", "fine", 10.0)?
        .iter()
        .map(|recorded| {
            let sweeps = chosen(recorded, SWEEPS, Selection::ThesisHull);
            let image = squared(volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed));
            Quality::of(&image, recorded.truth_m).extent_m
        })
        .collect();
    Ok(DVec3::from_array([0, 1, 2].map(|axis| quantile(&extents.iter().map(|e| e[axis]).collect::<Vec<_>>(), 0.5))))
}

/// Width, height and depth as text, centimetres.
fn size(metres: DVec3) -> String {
    let [x, y, z] = (metres * 100.0).to_array();
    format!("{x:.0} × {y:.0} × {z:.0}")
}

/// Recall and precision, per cent, at amplitude thresholds from high to low.
fn trade_off(image: &Volume, points: &[DVec3]) -> Vec<[f64; 2]> {
    let greatest = image.peak().map_or(f32::INFINITY, |peak| peak.1);
    let mut shown = vec![0.0f32; points.len()];
    let is_near: Vec<(f32, bool)> = points_above(image, MIN_SHARE)
        .into_iter()
        .map(|(at, value)| {
            let mut near = false;
            for (point, shown) in points.iter().zip(&mut shown) {
                if point.distance(at) <= THESIS_VOXEL_M {
                    (near, *shown) = (true, shown.max(value));
                }
            }
            (value, near)
        })
        .collect();
    let at = |n: i32| {
        let least = (f64::from(n) * SHARE_STEP) as f32 * greatest;
        let imaged = is_near.iter().filter(|voxel| voxel.0 >= least).count();
        let near = is_near.iter().filter(|voxel| voxel.0 >= least && voxel.1).count();
        let recall = shown.iter().filter(|value| **value >= least).count() as f64 / points.len().max(1) as f64;
        [recall * 100.0, near as f64 / imaged.max(1) as f64 * 100.0]
    };
    (6..20).rev().map(at).collect()
}

/// Median over the seeds at each threshold.
fn median_curve(each: &[Vec<[f64; 2]>]) -> Vec<[f64; 2]> {
    let at = |n: usize, axis: usize| quantile(&each.iter().map(|curve| curve[n][axis]).collect::<Vec<_>>(), 0.5);
    (0..each.first().map_or(0, Vec::len)).map(|n| [at(n, 0), at(n, 1)]).collect()
}

fn draw(outcome: &mut Outcome, scene: &str, words: &str, images: &[Volume; 5], recorded: &TrialRecording) {
    let points = points(recorded);
    let path: Vec<DVec3> = recorded.observations.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
    let marks = Marks { truth_m: &points, found_m: &[], path_m: &[] };
    let title_of = |way: usize| format!("{}{}: {}", words[..1].to_uppercase(), &words[1..], METHODS[way].0);
    for (flat, spatial, share) in DRAWN {
        let title = title_of(flat);
        let picture = cross_sections(&images[flat], &title, METHODS[flat].2, &marks);
        outcome.draw(
            format!("{scene}-{}", METHODS[flat].1),
            picture,
            format!("{title}. The thesis' figures 4.27, 4.29 and 4.31."),
        );
        let from = Marks { path_m: if flat == SQUARED { &path } else { &[] }, ..marks };
        let (title, file) = (title_of(spatial), format!("{scene}-{}-cloud", METHODS[spatial].1));
        let cloud = point_cloud(&images[spatial], &title, METHODS[spatial].2, share, &from);
        outcome.draw(
            &*file,
            cloud,
            format!("{title}, voxels above {} % of the greatest value, as figure 4.1b.", percent(share)),
        );
        outcome.keep_cloud(&file, &points_above(&images[spatial], share));
    }
}

fn tables(outcome: &mut Outcome, rows: Vec<Vec<String>>, all: &[[Figures; 5]]) {
    outcome.tables.push(Table {
        head: head(&[
            "object",
            "image",
            "median distance to the object (cm)",
            "precision (%)",
            "recall (%)",
            "width × height × depth (cm)",
            "true size (cm)",
            "too high by (cm)",
        ]),
        rows,
        caption: "For the voxels of at least half of the greatest value. Distance: to the nearest true point. \
            Precision: share of the voxels within 10 cm of one; recall: share of the points with a voxel within 10 cm."
            .into(),
    });
    let parts = METHODS.iter().zip(&all[CHAIR]).map(|((way, _, _), figures)| {
        let [legs, wood] = [figures.legs_recall, figures.wood_recall].map(percent);
        vec![(*way).to_owned(), format!("{:.2}", figures.wood), legs, wood]
    });
    outcome.tables.push(Table {
        head: head(&[
            "image of the chair",
            "seat and back over legs (ratio)",
            "legs imaged (%)",
            "seat and back imaged (%)",
        ]),
        rows: parts.collect(),
        caption: "Ratio: greatest value within 10 cm of seat and back over that at the legs' feet. Imaged: share of \
            the points with an imaged voxel within 10 cm."
            .into(),
    });
    let two = METHODS.iter().zip(&all[CHAIRS]).map(|((way, _, _), figures)| {
        let [weaker, dip] = figures.apart.map_or([f64::NAN; 2], |apart| [apart.weaker, apart.dip]);
        let is_apart = figures.apart.is_some_and(|apart| apart.is_resolved());
        vec![(*way).to_owned(), percent(weaker), percent(dip), if is_apart { "yes" } else { "no" }.into()]
    });
    outcome.tables.push(Table {
        head: head(&["image of the two chairs", "weaker peak (% of the stronger)", "dip between (%)", "resolved"]),
        rows: two.collect(),
        caption: format!(
            "Dip: how far the image falls below the weaker chair's peak on the highest path to the other peak. \
             Resolved: a dip of at least {:.1} %, Rayleigh's criterion.",
            RAYLEIGH_DIP * 100.0
        ),
    });
}

fn findings(outcome: &mut Outcome, all: &[[Figures; 5]], point_m: DVec3) {
    let described = |figures: &Figures| {
        format!(
            "{} cm against a true {} cm, median voxel {} cm off",
            size(figures.accuracy.extent_m),
            size(figures.true_extent_m),
            cm(figures.accuracy.off_m)
        )
    };
    let hanger = &all[HANGER];
    outcome.add_finding(
        "The hanger appears as a blob of about the right size and shape at the right position.",
        hanger[SQUARED].size_matches() && hanger[SQUARED].accuracy.off_m <= THESIS_VOXEL_M,
        format!(
            "squared: {}, where a single point appears as {} cm; by sub-apertures {}",
            described(&hanger[SQUARED]),
            size(point_m),
            described(&hanger[COHERENT_SQUARED])
        ),
    );
    outcome.add_finding(
        "The hanger's top is stronger, having more corners.",
        None,
        "the simulated hook has the greatest cross-section: an assumption of the simulation, not a result".into(),
    );
    let chair = &all[CHAIR];
    outcome.add_finding(
        "The chair has a clear outline, a little below its true position.",
        chair[SQUARED].accuracy.shift_m.y < -0.02,
        format!(
            "squared: {} cm too high, {} % of its points imaged; by sub-apertures {} cm and {} %. In the simulation \
             the legs are points at their feet that reflect outward and down, past a sensor one metre up",
            cm(chair[SQUARED].accuracy.shift_m.y),
            percent(chair[SQUARED].accuracy.recall),
            cm(chair[COHERENT_SQUARED].accuracy.shift_m.y),
            percent(chair[COHERENT_SQUARED].accuracy.recall)
        ),
    );
    outcome.add_finding(
        "The metal legs are stronger than the wooden seat and back, and squaring exaggerates the difference.",
        chair[PLAIN].wood < 1.0 && chair[SQUARED].wood_recall < chair[PLAIN].wood_recall,
        format!(
            "seat and back have {:.1} times the legs' value plain and {:.0} times squared. Their cross-section is 4 \
             to 6 dB lower, yet their strongest point returns {:.0} dB more to the sensor than the feet, which are \
             farther away and reflect outward and down; the sum also weights by 1/d² (by sub-apertures {:.1} times). \
             Squaring exaggerates whichever is stronger: of seat and back {} % are imaged plain and {} % squared, of \
             the legs {} and {} %",
            chair[PLAIN].wood,
            chair[SQUARED].wood,
            chair[PLAIN].received_db,
            chair[COHERENT].wood,
            percent(chair[PLAIN].wood_recall),
            percent(chair[SQUARED].wood_recall),
            percent(chair[PLAIN].legs_recall),
            percent(chair[SQUARED].legs_recall)
        ),
    );
    outcome.add_finding(
        "Flat surfaces turned away reflect past the sensor and are not imaged.",
        None,
        "not simulated: furniture consists of points with lobes, only walls are specular planes".into(),
    );
    let chairs = &all[CHAIRS];
    let weaker = |way: usize| chairs[way].apart.map_or(0.0, |apart| apart.weaker);
    let dip = |way: usize| chairs[way].apart.map_or(0.0, |apart| apart.dip);
    outcome.add_finding(
        "Of two chairs one is clear and the other barely visible: strong objects raise the threshold for weak ones.",
        weaker(SQUARED) > 0.0 && weaker(SQUARED) < 0.5,
        format!(
            "the plastic chair's peak has {} % of the metal one's squared, {} % plain, {} % by sub-apertures ({} % \
             squared); it is 8 dB weaker and farther away",
            percent(weaker(SQUARED)),
            percent(weaker(PLAIN)),
            percent(weaker(COHERENT)),
            percent(weaker(COHERENT_SQUARED))
        ),
    );
    outcome.add_finding(
        "Both chairs are in the image: several objects are resolved.",
        chairs[SQUARED].apart.is_some_and(|apart| apart.is_resolved()),
        format!(
            "between them the image falls by {} % of the weaker peak squared, {} % plain, {} % by sub-apertures ({} % squared)",
            percent(dip(SQUARED)),
            percent(dip(PLAIN)),
            percent(dip(COHERENT)),
            percent(dip(COHERENT_SQUARED))
        ),
    );
    outcome.add_finding(
        "No finer detail shows because the voxels are 10 cm.",
        chair[FINER].accuracy.off_m < 0.7 * chair[SQUARED].accuracy.off_m,
        format!(
            "chair with voxels of 10 and of 4 cm: median voxel {} and {} cm off, {} and {} cm in size; by \
             sub-apertures {} cm off. Not the voxel size limits the detail but the unused phase: the pulse is 14 cm \
             long",
            cm(chair[SQUARED].accuracy.off_m),
            cm(chair[FINER].accuracy.off_m),
            size(chair[SQUARED].accuracy.extent_m),
            size(chair[FINER].accuracy.extent_m),
            cm(chair[COHERENT_SQUARED].accuracy.off_m)
        ),
    );
}
