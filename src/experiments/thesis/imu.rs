//! Poses by inertia: the thesis' prototype on a swinging arm, and inertia beside a tracker that goes away.

use glam::DVec3;

use super::imaged::{Quality, THESIS_VOXEL_M, chosen, placed, volume};
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, mm};
use crate::experiments::recorded::{Recorded, quantile};
use crate::geometry::Pose;
use crate::imaging::{Selection, Statistic};
use crate::radar::preset;
use crate::report::{Chart, Marks, Series, Table, cross_sections};
use crate::simulation::{ARM_M, ARM_REST_S, Scenario, Simulated, TruePath};
use crate::tracking::PoseSample;
use crate::tracking::inertial::{
    FusionSettings, GRAVITY_M_PER_S2, ICM_42688, ImuFigures, ImuSample, MPU_6050, NavState, PoseFusion, Strapdown,
    TACTICAL,
};

/// From what a prototype has to what costs a car.
const PARTS: [ImuFigures; 3] = [MPU_6050, ICM_42688, TACTICAL];
/// Time at rest that offsets are told from, seconds: the arm rests that long.
const REST_S: f64 = ARM_REST_S;
/// Drift is read after these times, seconds.
const DRIFTED_S: [f64; 5] = [0.5, 1.0, 2.0, 5.0, 10.0];
/// Images are of the first so many seconds of the swing.
const SWUNG_S: [f64; 4] = [1.0, 2.0, 4.0, 8.0];
/// The tracker goes away then, seconds, for so long; 0 is not at all.
const LOST_AT_S: f64 = 8.0;
const LOST_S: [f64; 8] = [0.0, 0.1, 0.3, 0.5, 1.0, 3.0, 5.0, 10.0];
/// Images are of so much before the tracker comes back, seconds: a swing there and back, so that all have the same aperture.
const WINDOW_S: f64 = 4.0;
const DURATION_S: f64 = LOST_AT_S + 10.0;
const SWEEPS: usize = 50;
/// Voxels in which a blur shows, metres.
const FINE_VOXEL_M: f64 = 0.04;
/// An image counts as sharp while the reflector is placed this well, metres, and half of the peak fills at most so much more than it did.
const SHARP_M: f64 = 0.02;
const SHARP_RATIO: f64 = 1.5;

/// One seed of the arm, with what is shared by all units.
struct Swung {
    scenario: Scenario,
    simulated: Simulated,
    path: TruePath,
    start_ns: i64,
}

impl Swung {
    fn new(seed: u64) -> Result<Self, ExperimentError> {
        let scenario = Scenario { snr_db: Some(SNR_DB), ..scenario("swinging-arm", DURATION_S, seed)? };
        let (simulated, path) = (scenario.run()?, scenario.path()?);
        let start_ns = simulated.frames.first().map_or(0, |frame| frame.host_time_ns);
        Ok(Self { scenario, simulated, path, start_ns })
    }

    fn ns(&self, since_s: f64) -> i64 {
        self.start_ns + (since_s * 1e9) as i64
    }

    /// The sweeps between two times, with poses of any source.
    fn seen(&self, poses: &[PoseSample], from_s: f64, to_s: f64) -> Recorded {
        Recorded::joined(&self.scenario, &self.simulated, poses).between(self.ns(from_s), self.ns(to_s))
    }
}

/// Radar and unit on one plate, as the prototype's: the unit's frame is the sensor's.
fn scenario(motion: &str, duration_s: f64, seed: u64) -> Result<Scenario, ExperimentError> {
    let config = preset("fine").ok_or(ExperimentError::Preset("fine"))?;
    let mut scenario = Scenario::new("corner-reflector", motion, config, duration_s, seed);
    scenario.head_from_sensor = Pose::IDENTITY;
    scenario.errors.mount_m = 0.0;
    Ok(scenario)
}

/// A sample less what the unit reported at rest, where its pose was known.
struct AtRest {
    rate: DVec3,
    force: DVec3,
}

impl AtRest {
    /// By the samples up to a time.
    fn of(samples: &[ImuSample], until_ns: i64, pose: &Pose) -> Self {
        let rest: Vec<&ImuSample> = samples.iter().take_while(|sample| sample.time_ns <= until_ns).collect();
        let mean = |of: fn(&ImuSample) -> DVec3| rest.iter().map(|s| of(s)).sum::<DVec3>() / rest.len().max(1) as f64;
        let up = pose.rotation.conjugate() * -GRAVITY_M_PER_S2;
        Self { rate: mean(|s| s.angular_rate_rad_per_s), force: mean(|s| s.specific_force_m_per_s2) - up }
    }

    fn corrected(&self, sample: &ImuSample) -> ImuSample {
        ImuSample {
            angular_rate_rad_per_s: sample.angular_rate_rad_per_s - self.rate,
            specific_force_m_per_s2: sample.specific_force_m_per_s2 - self.force,
            ..*sample
        }
    }
}

/// Dead reckoning from the end of the rest on, offsets told at rest or not.
fn reckoned(samples: &[ImuSample], path: &TruePath, until_ns: i64, is_zeroed: bool) -> Vec<NavState> {
    let start = path.at(until_ns);
    let none = AtRest { rate: DVec3::ZERO, force: DVec3::ZERO };
    let zero = if is_zeroed { AtRest::of(samples, until_ns, &start.tracking_from_body) } else { none };
    let mut strapdown = Strapdown::new(NavState::at_rest(until_ns, start.tracking_from_body));
    let later = samples.iter().filter(|sample| sample.time_ns > until_ns);
    later.map(|sample| *strapdown.push(&zero.corrected(sample))).collect()
}

/// The thesis' script: twice the integral of what the accelerometer reports less what it reported before, whatever its attitude.
fn script(samples: &[ImuSample], until_ns: i64) -> Vec<NavState> {
    let zero = AtRest::of(samples, until_ns, &Pose::IDENTITY);
    let mut state = NavState::at_rest(until_ns, Pose::IDENTITY);
    let step = |sample: &ImuSample| {
        let h = (sample.time_ns - state.time_ns) as f64 * 1e-9;
        let moved = zero.corrected(sample).specific_force_m_per_s2 + GRAVITY_M_PER_S2;
        state.velocity_m_per_s += moved * h;
        state.tracking_from_body.translation += state.velocity_m_per_s * h;
        state.time_ns = sample.time_ns;
        state
    };
    samples.iter().filter(|sample| sample.time_ns > until_ns).map(step).collect()
}

/// Distance from the truth so long after a time, metres.
fn drift_m(states: &[NavState], from_ns: i64, after_s: f64, truth: impl Fn(i64) -> DVec3) -> f64 {
    let at = states.partition_point(|state| state.time_ns < from_ns + (after_s * 1e9) as i64);
    let state = states.get(at.min(states.len().saturating_sub(1)));
    state.map_or(f64::NAN, |state| state.tracking_from_body.translation.distance(truth(state.time_ns)))
}

/// Median of each column.
fn medians(rows: &[Vec<f64>]) -> Vec<f64> {
    let columns = rows.first().map_or(0, Vec::len);
    (0..columns).map(|n| quantile(&rows.iter().map(|row| row[n]).collect::<Vec<_>>(), 0.5)).collect()
}

/// A way of reckoning, and the median drift after each of [`DRIFTED_S`], metres.
struct Drift {
    way: String,
    drift_m: Vec<f64>,
}

/// At rest and on the arm, for each part.
fn drifts(trials: &Trials) -> Result<Vec<Drift>, ExperimentError> {
    let duration_s = REST_S + DRIFTED_S[DRIFTED_S.len() - 1] + 0.1;
    let mut drifts = Vec::new();
    for (motion, words) in [("stationary", "at rest"), ("swinging-arm", "swinging")] {
        let paths = (1..=trials.seeds).map(|seed| Ok(scenario(motion, duration_s, seed)?.path()?));
        let paths = paths.collect::<Result<Vec<TruePath>, ExperimentError>>()?;
        for part in &PARTS {
            // Three ways: as it comes, zeroed, and the script.
            let mut rows = [Vec::new(), Vec::new(), Vec::new()];
            for path in &paths {
                let samples = path.imu(part);
                let until_ns = samples[0].time_ns + (REST_S * 1e9) as i64;
                let truth = |time_ns: i64| path.at(time_ns).tracking_from_body.translation;
                let start_m = truth(until_ns);
                let after = |states: &[NavState], truth: &dyn Fn(i64) -> DVec3| -> Vec<f64> {
                    DRIFTED_S.iter().map(|&s| drift_m(states, until_ns, s, truth)).collect()
                };
                rows[0].push(after(&reckoned(&samples, path, until_ns, false), &truth));
                rows[1].push(after(&reckoned(&samples, path, until_ns, true), &truth));
                rows[2].push(after(&script(&samples, until_ns), &|ns| truth(ns) - start_m));
            }
            for (rows, way) in rows.iter().zip(["as it comes", "zeroed", "the script"]) {
                drifts.push(Drift { way: format!("{}, {words}, {way}", part.name), drift_m: medians(rows) });
            }
        }
    }
    Ok(drifts)
}

/// Error of the thesis' image, footprint of the fine one in litres, and error of the refined place.
fn imaged(recorded: &Recorded) -> [f64; 3] {
    let sweeps = chosen(recorded, SWEEPS, Selection::FarthestPoint);
    if sweeps.is_empty() {
        return [f64::INFINITY; 3];
    }
    let thesis = Quality::of(&volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed), recorded.truth_m);
    let fine = Quality::of(&volume(&sweeps, Statistic::Ls, FINE_VOXEL_M, recorded.seed), recorded.truth_m);
    let (refined, _) = placed(&sweeps, recorded.seed);
    let own = refined.map_or(f64::INFINITY, |refined| refined.position_m.distance(recorded.truth_m));
    [thesis.error_m(), fine.footprint_l, own]
}

/// States as poses of a tracker, at half the unit's rate.
fn as_poses(states: &[NavState]) -> Vec<PoseSample> {
    states.iter().step_by(2).map(|state| PoseSample::valid(state.time_ns, &state.tracking_from_body)).collect()
}

/// All fused states, of poses that go away at a time.
fn fused(swung: &Swung, part: &ImuFigures) -> Vec<NavState> {
    let mut fusion = PoseFusion::new(FusionSettings::of(*part));
    let lost_ns = swung.ns(LOST_AT_S);
    let mut poses = swung.simulated.poses.iter().take_while(|pose| pose.time_ns < lost_ns).peekable();
    let mut states = Vec::new();
    for sample in &swung.path.imu(part) {
        while let Some(pose) = poses.next_if(|pose| pose.time_ns <= sample.time_ns) {
            // What is refused is no pose, and there are none such here.
            let _ = fusion.push_pose(pose);
        }
        let _ = fusion.push_imu(sample);
        states.extend(fusion.state().copied());
    }
    states
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        done: format!(
            "An arm of {:.0} cm swings the sensor by 60° to either side, facing the reflector; an inertial measurement unit (IMU) sits beside the sensor, \
             simulated by its part's Allan figures, offsets, scales and misalignments, 400 samples a second; {} seeds, medians. It rests for {REST_S:.0} s \
             first, which tells its offsets. The script integrates twice what the accelerometer reports; dead reckoning also turns with the gyroscope; \
             fusion is an error-state Kalman filter of inertia and optical poses, with offsets, scales, misalignments and the tracker's wander as unknowns.",
            ARM_M * 100.0,
            trials.seeds
        ),
        ..Outcome::default()
    };
    let drifts = drifts(trials)?;
    drift_findings(&mut outcome, &drifts);
    let swung = (1..=trials.seeds).map(Swung::new).collect::<Result<Vec<_>, _>>()?;
    let of_swing = swing_images(&mut outcome, &swung);
    swing_findings(&mut outcome, &drifts, &of_swing);
    outages(&mut outcome, &drifts, &swung);
    Ok(outcome)
}

fn drift_of<'a>(drifts: &'a [Drift], way: &str) -> &'a [f64] {
    drifts.iter().find(|drift| drift.way == way).map_or(&[f64::NAN; DRIFTED_S.len()], |drift| &drift.drift_m)
}

fn drift_findings(outcome: &mut Outcome, drifts: &[Drift]) {
    let rest = drift_of(drifts, "MPU-6050, at rest, the script");
    let [two_s, five_s, ten_s] = [rest[2], rest[3], rest[4]];
    outcome.finds(
        "At rest the IMU's position drifts by several centimetres within a few seconds, faster and faster.",
        five_s >= 0.03 && five_s > 2.5 * two_s && ten_s > 2.0 * five_s,
        format!(
            "MPU-6050 at rest by the script: {} cm after 2 s, {} cm after 5 s, {} cm after 10 s",
            cm(two_s),
            cm(five_s),
            cm(ten_s)
        ),
    );
    let [raw, zeroed] = ["as it comes", "zeroed"].map(|way| drift_of(drifts, &format!("MPU-6050, swinging, {way}"))[2]);
    outcome.finds(
        "Accurate poses by an IMU take calibration, initialisation and filtering.",
        zeroed < 0.5 * raw,
        format!("MPU-6050 on the arm, 2 s of dead reckoning: {} cm off as it comes, {} cm with the offsets it showed at rest taken off", cm(raw), cm(zeroed)),
    );
    let names: Vec<String> = std::iter::once("unit and way".to_owned())
        .chain(DRIFTED_S.iter().map(|s| format!("after {s} s (cm)")))
        .collect();
    let row = |drift: &Drift| std::iter::once(drift.way.clone()).chain(drift.drift_m.iter().map(|m| cm(*m))).collect();
    outcome.tables.push(Table {
        head: names,
        rows: drifts.iter().map(row).collect(),
        caption: "Distance from where it really is, without any other poses. Zeroed: offsets told during the rest. The script knows no turns.".into(),
    });
    let shown = [
        "MPU-6050, at rest, the script",
        "MPU-6050, swinging, zeroed",
        "ICM-42688-P, swinging, zeroed",
        "tactical grade, swinging, zeroed",
    ];
    let series = shown.map(|way| {
        let points = DRIFTED_S.iter().zip(drift_of(drifts, way)).map(|(s, m)| [*s, m * 100.0]).collect();
        Series { name: way.into(), points, joined: true }
    });
    let chart = Chart {
        title: "Drift of an IMU by itself".into(),
        x_label: "time since the last known pose (s)".into(),
        y_label: "distance from the truth (cm)".into(),
        x_log: true,
        y_log: true,
        series: series.into(),
    };
    outcome.draw("drift", chart.draw(), "Medians. The thesis' script at rest, and dead reckoning on the swinging arm.");
}

/// Medians of [`imaged`] for each source of poses and each of [`SWUNG_S`].
type SwingImages = Vec<(&'static str, Vec<Vec<f64>>)>;

fn swing_images(outcome: &mut Outcome, swung: &[Swung]) -> SwingImages {
    let sources =
        [("the arm's angle", None), (PARTS[0].name, Some(0)), (PARTS[1].name, Some(1)), (PARTS[2].name, Some(2))];
    let mut figures = Vec::new();
    for (name, part) in sources {
        let mut rows = vec![Vec::new(); SWUNG_S.len()];
        for one in swung {
            let until_ns = one.ns(REST_S);
            let poses = match part {
                None => one
                    .simulated
                    .poses
                    .iter()
                    .map(|pose| PoseSample::valid(pose.time_ns, &one.path.at(pose.time_ns).tracking_from_body))
                    .collect(),
                Some(part) => as_poses(&reckoned(&one.path.imu(&PARTS[part]), &one.path, until_ns, true)),
            };
            for (n, swung_s) in SWUNG_S.into_iter().enumerate() {
                let recorded = one.seen(&poses, REST_S, REST_S + swung_s);
                rows[n].push(imaged(&recorded).to_vec());
                if recorded.seed == 1 && swung_s == 4.0 && part != Some(2) {
                    let sweeps = chosen(&recorded, SWEEPS, Selection::FarthestPoint);
                    let path: Vec<DVec3> = sweeps.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
                    let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &path };
                    let title = format!("The thesis' image of 4 s on the arm, poses by {name}");
                    let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
                    let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                    outcome.draw(
                        format!("swing-{}", part.map_or("truth", |n| ["prototype", "phone", "tactical"][n])),
                        picture,
                        format!("{title}."),
                    );
                }
            }
        }
        figures.push((name, rows.iter().map(|rows| medians(rows)).collect::<Vec<_>>()));
    }
    let row = |(name, of_times): &(&str, Vec<Vec<f64>>)| -> Vec<Vec<String>> {
        let each = |(swung_s, f): (&f64, &Vec<f64>)| {
            vec![(*name).to_owned(), format!("{swung_s:.0}"), cm(f[0]), format!("{:.1}", f[1]), mm(f[2])]
        };
        SWUNG_S.iter().zip(of_times).map(each).collect()
    };
    outcome.tables.push(Table {
        head: head(&["poses by", "first seconds of the swing", "thesis: error (cm)", "footprint (l)", "ours: error (mm)"]),
        rows: figures.iter().flat_map(row).collect(),
        caption: format!("Images from {SWEEPS} sweeps, poses by dead reckoning alone since the rest. Footprint: what at least half of the greatest value of least squares fills, in voxels of 4 cm."),
    });
    figures
}

fn swing_findings(outcome: &mut Outcome, drifts: &[Drift], of_swing: &SwingImages) {
    let figure = |source: usize, time: usize, which: usize| of_swing[source].1[time][which];
    outcome.finds(
        "Noise and drift make the IMU impossible to use for imaging.",
        (figure(1, 3, 2) > 0.1).then_some(true).or((figure(1, 0, 2) < SHARP_M && figure(1, 3, 2) < SHARP_M).then_some(false)),
        format!(
            "MPU-6050 alone, the reflector's error: {} mm by the first second of the swing, {} mm by four, {} mm by eight; the arm's own angle gives {} mm",
            mm(figure(1, 0, 2)), mm(figure(1, 2, 2)), mm(figure(1, 3, 2)), mm(figure(0, 3, 2))
        ),
    );
    let after_5_s = PARTS.map(|part| drift_of(drifts, &format!("{}, swinging, zeroed", part.name))[3]);
    outcome.finds(
        "An improved IMU gives accurate positions for longer, and a second of sweeps suffices: it could still be feasible (5.7).",
        after_5_s[1] < 0.5 * after_5_s[0] && figure(2, 0, 2) < SHARP_M,
        format!(
            "after 5 s on the arm {} cm off with an MPU-6050, {} cm with an ICM-42688-P; by one second of sweeps the latter places the reflector {} mm off",
            cm(after_5_s[0]), cm(after_5_s[1]), mm(figure(2, 0, 2))
        ),
    );
    outcome.finds(
        "Accurate tracking by inertia alone takes sophisticated and expensive IMUs (2.6.1).",
        figure(3, 3, 2) < SHARP_M && figure(2, 3, 2) > SHARP_M,
        format!(
            "the reflector's error by four and by eight seconds of swing: MPU-6050 {} and {} mm, ICM-42688-P {} and {} mm, tactical grade {} and {} mm; enough would be {} mm by eight",
            mm(figure(1, 2, 2)), mm(figure(1, 3, 2)), mm(figure(2, 2, 2)), mm(figure(2, 3, 2)), mm(figure(3, 2, 2)), mm(figure(3, 3, 2)), mm(SHARP_M)
        ),
    );
}

/// Medians of a part for each of [`LOST_S`].
struct Lost {
    pose_m: Vec<f64>,
    worst_m: Vec<f64>,
    /// As [`imaged`] has them.
    images: Vec<Vec<f64>>,
}

impl Lost {
    fn of(part: &ImuFigures, swung: &[Swung]) -> Self {
        let mut off = vec![Vec::new(); LOST_S.len()];
        let mut images = vec![Vec::new(); LOST_S.len()];
        for one in swung {
            let states = fused(one, part);
            let truth = |time_ns: i64| one.path.at(time_ns).tracking_from_body.translation;
            let poses = as_poses(&states);
            for (n, lost_s) in LOST_S.into_iter().enumerate() {
                off[n].push(drift_m(&states, one.ns(LOST_AT_S), lost_s, truth));
                let until_s = LOST_AT_S + lost_s;
                images[n].push(imaged(&one.seen(&poses, until_s - WINDOW_S, until_s)).to_vec());
            }
        }
        let share = |share: f64| off.iter().map(|off| quantile(off, share)).collect();
        Self { pose_m: share(0.5), worst_m: share(1.0), images: images.iter().map(|rows| medians(rows)).collect() }
    }

    /// The longest outage up to which every image is sharp, seconds.
    fn sharp_s(&self) -> f64 {
        let is_sharp = |image: &&Vec<f64>| image[2] <= SHARP_M && image[1] <= SHARP_RATIO * self.images[0][1];
        let sharp = self.images.iter().take_while(is_sharp).count();
        sharp.checked_sub(1).map_or(0.0, |last| LOST_S[last])
    }
}

fn outages(outcome: &mut Outcome, drifts: &[Drift], swung: &[Swung]) {
    let lost: Vec<Lost> = PARTS.iter().map(|part| Lost::of(part, swung)).collect();
    let mut rows = Vec::new();
    for (part, lost) in PARTS.iter().zip(&lost) {
        for (n, lost_s) in LOST_S.iter().enumerate() {
            let image = &lost.images[n];
            rows.push(vec![
                part.name.to_owned(),
                format!("{lost_s}"),
                mm(lost.pose_m[n]),
                mm(lost.worst_m[n]),
                cm(image[0]),
                format!("{:.1}", image[1]),
                mm(image[2]),
            ]);
        }
    }
    let alone = tracker_alone(swung);
    for (lost_s, image) in LOST_S.iter().zip(&alone) {
        rows.push(vec![
            "none: the tracker alone".into(),
            format!("{lost_s}"),
            "–".into(),
            "–".into(),
            cm(image[0]),
            if image[1].is_finite() { format!("{:.1}", image[1]) } else { "–".into() },
            mm(image[2]),
        ]);
    }
    let sharp = lost.iter().map(Lost::sharp_s).collect::<Vec<_>>();
    let ((one_s, five_s), phone) = ((4, 6), &lost[1]);
    outcome.finds(
        "Combined with other sensors an IMU improves accuracy and robustness (2.6.1).",
        phone.images[one_s][2] <= SHARP_M && phone.images[one_s][2] < alone[one_s][2],
        format!(
            "the tracker gone for 1 s of the {WINDOW_S:.0} s that are imaged: the reflector {} mm off with an ICM-42688-P beside it and {} mm by the sweeps that are left without one; gone \
             for 3 s: {} mm with it and {} mm without; for 5 s {} mm with it, and without no sweep has a pose",
            mm(phone.images[one_s][2]), mm(alone[one_s][2]), mm(phone.images[one_s + 1][2]), mm(alone[one_s + 1][2]), mm(phone.images[five_s][2])
        ),
    );
    let by_itself_m = drift_of(drifts, "ICM-42688-P, swinging, zeroed")[3];
    outcome.finds(
        "More realistic than an IMU by itself is one together with another positioning system (5.7).",
        phone.pose_m[five_s] < 0.5 * by_itself_m,
        format!(
            "5 s without optical poses: {} cm off by an ICM-42688-P that knows its rest, {} cm by one that was fused with the tracker before; sharp for up to {} s with an MPU-6050, {} s with \
             an ICM-42688-P, {} s with tactical grade, of the outages tried",
            cm(by_itself_m), cm(phone.pose_m[five_s]), sharp[0], sharp[1], sharp[2]
        ),
    );
    outcome.tables.push(Table {
        head: head(&["unit beside the tracker", "tracker gone (s)", "pose error (mm)", "at most (mm)", "thesis: error (cm)", "footprint (l)", "ours: error (mm)"]),
        rows,
        caption: format!(
            "Pose: at the end of the outage, median and greatest. Images: of the last {WINDOW_S:.0} s before the tracker is back, {SWEEPS} sweeps, medians; – where no sweep has a pose. Sharp: the reflector within {:.0} cm \
             and the footprint at most {SHARP_RATIO} times what it is without an outage.",
            SHARP_M * 100.0
        ),
    });
    // On a logarithmic axis no outage has no place.
    let series = |name: &str, values: Vec<f64>| Series {
        name: name.into(),
        points: LOST_S.iter().zip(values).skip(1).map(|(s, v)| [*s, v]).collect(),
        joined: true,
    };
    let chart = |title: &str, y_label: &str, series: Vec<Series>| Chart {
        title: title.into(),
        x_label: "optical poses gone for (s)".into(),
        y_label: y_label.into(),
        x_log: true,
        y_log: true,
        series,
    };
    let each = |of: &dyn Fn(&Lost) -> Vec<f64>| {
        PARTS.iter().zip(&lost).map(|(part, lost)| series(part.name, of(lost))).collect::<Vec<_>>()
    };
    let scaled = |values: &[f64], by: f64| values.iter().map(|v| v * by).collect::<Vec<f64>>();
    let pose = chart(
        "Inertia while the tracker is gone: error of the pose",
        "pose error at the end (mm)",
        each(&|lost| scaled(&lost.pose_m, 1e3)),
    );
    outcome.draw("outage-pose", pose.draw(), "Fused poses at the end of the outage, medians.");
    let column =
        |images: &[Vec<f64>], n: usize, by: f64| images.iter().map(|image| image[n] * by).collect::<Vec<f64>>();
    let mut places = each(&|lost| column(&lost.images, 2, 1e3));
    places.push(series("the tracker alone", column(&alone, 2, 1e3)));
    let place =
        chart("Inertia while the tracker is gone: error of the reflector", "error of the reflector (mm)", places);
    outcome.draw("outage-reflector", place.draw(), "The reflector's place by the last four seconds before the tracker is back. The tracker alone has sweeps from before the outage only, and none when that lasts longer.");
    let mut sizes = each(&|lost| column(&lost.images, 1, 1.0));
    sizes.push(series("the tracker alone", column(&alone, 1, 1.0)));
    let size = Chart {
        y_log: false,
        ..chart("Inertia while the tracker is gone: footprint of the image", "footprint (l)", sizes)
    };
    outcome.draw("outage-footprint", size.draw(), "What at least half of the greatest value fills, least squares over voxels of 4 cm. A drift of centimetres shifts such an image; it hardly blurs it, since the pulse is 14 cm long.");
}

/// Medians of [`imaged`] for each of [`LOST_S`] without any unit.
fn tracker_alone(swung: &[Swung]) -> Vec<Vec<f64>> {
    let of = |lost_s: &f64| {
        let until_s = LOST_AT_S + lost_s;
        let images = swung.iter().map(|one| {
            let (gone_ns, back_ns) = (one.ns(LOST_AT_S), one.ns(until_s));
            let is_there = |pose: &&PoseSample| !(gone_ns..back_ns).contains(&pose.time_ns);
            let poses: Vec<PoseSample> = one.simulated.poses.iter().filter(is_there).copied().collect();
            imaged(&one.seen(&poses, until_s - WINDOW_S, until_s)).to_vec()
        });
        medians(&images.collect::<Vec<_>>())
    };
    LOST_S.iter().map(of).collect()
}
