//! The vendor's obstacle detector beside this program's way, on the same sweeps: where it works, and what it leaves open.

use glam::DVec3;

use super::imaged::{chosen, observed, placed};
use super::{ExperimentError, Outcome, SNR_DB, Trials, head, mm};
use crate::experiments::recorded::{Recorded, quantile};
use crate::imaging::{PositionErrors, RangePower, Refined, Selection, eigen, split};
use crate::peers::{DetectorConfig, DetectorLook, Reflection, VendorDetector, cone_angle_rad};
use crate::radar::{Beam, Observation};
use crate::report::{Chart, HeatChart, Series, Table};
use crate::simulation::{Scenario, ScenarioError, TrackingErrors};
use crate::tracking::{HistorySettings, ObserverSettings, observe_all};

/// A robot's speed, m/s, and how long it goes until it is beside the reflector, seconds.
const ROBOT: (&str, f64) = ("straight-0.3", 0.3);
const ROBOT_S: f64 = 3.0;
/// Angles to the way at which figures are taken, degrees, and how far looks may lie from them.
const ANGLES_DEG: [f64; 3] = [35.0, 45.0, 55.0];
const ANGLE_HALF_DEG: f64 = 5.0;
/// Motions that are no robot's, with the words for them.
const FREE: [(&str, &str); 2] = [("sphere-50cm", "within a sphere of 50 cm"), ("natural", "natural play")];
const FREE_S: f64 = 10.0;
/// For them the detector sees farther and follows faster, with points as far apart as the pulse allows.
const FREE_CONFIG: DetectorConfig = DetectorConfig {
    range_m: [0.4, 1.8],
    step_length: 12,
    hwaas: 12,
    profile: crate::radar::Profile::P3,
    sweeps: 16,
    update_hz: 50.0,
    max_speed_m_per_s: 1.25,
};
/// Sweeps of ours.
const SWEEPS: usize = 200;
/// A reflection is a thing's when it is as near to its range, and for two things also to its speed, as this.
const SAME_M: f64 = 0.05;
const SAME_M_PER_S: f64 = 0.05;
/// Slower than this nothing is asked of the detector, m/s.
const LEAST_M_PER_S: f64 = 0.1;
/// Farther off the boresight than this a thing is not asked for: the echo has lost 24 dB, degrees.
const SEEN_DEG: f64 = 60.0;

/// One look beside the truth.
struct Sight {
    /// Since the recording's begin, seconds.
    time_s: f64,
    /// The sensor at the middle of the window as it was, without tracking errors.
    sensor: Observation,
    /// Its velocity as tracking tells it, m/s.
    tracked_m_per_s: DVec3,
    look: DetectorLook,
}

impl Sight {
    fn distance_m(&self, place: DVec3) -> f64 {
        place.distance(self.sensor.tracking_from_sensor.translation)
    }

    fn toward(&self, place: DVec3) -> DVec3 {
        (place - self.sensor.tracking_from_sensor.translation).normalize_or_zero()
    }

    /// At which the distance grows.
    fn velocity_m_per_s(&self, place: DVec3) -> f64 {
        -self.sensor.velocity_m_per_s.dot(self.toward(place))
    }

    fn speed_m_per_s(&self) -> f64 {
        self.sensor.velocity_m_per_s.length()
    }

    /// Between the way and a place.
    fn angle_deg(&self, place: DVec3) -> f64 {
        angle_deg(self.sensor.velocity_m_per_s, self.toward(place))
    }

    fn off_boresight_deg(&self, place: DVec3) -> f64 {
        angle_deg(self.sensor.tracking_from_sensor.forward(), self.toward(place))
    }

    /// The strongest reflection, if it is at the range of a place.
    fn found(&self, place: DVec3) -> Option<&Reflection> {
        self.look.reflections.first().filter(|found| (found.distance_m - self.distance_m(place)).abs() < SAME_M)
    }

    /// Whether a reflection is what a place should give.
    fn shows(&self, found: &Reflection, place: DVec3) -> bool {
        (found.distance_m - self.distance_m(place)).abs() < SAME_M
            && (found.velocity_m_per_s - self.velocity_m_per_s(place)).abs() < SAME_M_PER_S
    }
}

fn angle_deg(a: DVec3, b: DVec3) -> f64 {
    a.normalize_or_zero().dot(b).clamp(-1.0, 1.0).acos().to_degrees()
}

/// A recording as the detector sees it, and as ours does.
struct Watched {
    seed: u64,
    sights: Vec<Sight>,
    /// The sweeps with tracked poses.
    recorded: Recorded,
    things_m: Vec<DVec3>,
    begin_ns: i64,
}

impl Watched {
    fn of(
        scene: &str,
        motion: &str,
        config: &DetectorConfig,
        duration_s: f64,
        seed: u64,
    ) -> Result<Self, ScenarioError> {
        let sensor = config.sensor();
        let scenario =
            Scenario { snr_db: Some(SNR_DB), ..Scenario::new(scene, motion, sensor.clone(), duration_s, seed) };
        let simulated = scenario.run()?;
        let exact = Recorded::of(&Scenario { errors: TrackingErrors::none(), ..scenario.clone() })?.observations;
        let observer = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: scenario.head_from_sensor,
            time_offset_s: 0.0,
        };
        let (observations, _) = observe_all(&sensor, observer, &simulated.frames, &simulated.poses);
        let things_m: Vec<DVec3> = simulated.truth.obstacles.iter().flat_map(|o| o.points_m.clone()).collect();
        let begin_ns = observations.first().map_or(0, |first| first.mid_time_ns);
        let mut detector = VendorDetector::new(config.sampling(), &empty(&scenario)?);
        let back_ns = (0.5 * f64::from(config.sweeps) / config.sweep_rate_hz() * 1e9) as i64;
        let sight = |frame: &crate::radar::Frame| {
            let look = detector.push(&sweeps(frame, sensor.points_per_sweep()))?;
            let middle_ns = frame.host_time_ns - back_ns;
            let at = |all: &[Observation]| all.get(all.partition_point(|o| o.mid_time_ns < middle_ns)).cloned();
            let time_s = (middle_ns - begin_ns) as f64 * 1e-9;
            let tracked_m_per_s = at(&observations)?.velocity_m_per_s;
            Some(Sight { time_s, sensor: at(&exact)?, tracked_m_per_s, look })
        };
        let sights = simulated.frames.iter().filter_map(sight).collect();
        let truth_m = things_m.first().copied().unwrap_or(DVec3::NAN);
        Ok(Self {
            seed,
            sights,
            recorded: Recorded { seed, observations, truth_m, truth: simulated.truth },
            things_m,
            begin_ns,
        })
    }

    /// Looks at which a thing can be asked for: within the ranges, in the beam, the sensor moving.
    fn asked(&self, config: &DetectorConfig, place: DVec3) -> impl Iterator<Item = &Sight> {
        let [near_m, far_m] = config.range_m;
        self.sights.iter().filter(move |sight| {
            (near_m..=far_m).contains(&sight.distance_m(place))
                && sight.off_boresight_deg(place) < SEEN_DEG
                && sight.speed_m_per_s() > LEAST_M_PER_S
        })
    }

    /// Ours from the sweeps up to a time.
    fn placed_until(&self, time_s: f64) -> Option<Refined> {
        let until_ns = self.begin_ns + (time_s * 1e9) as i64;
        let before = self.recorded.observations.iter().filter(|o| o.mid_time_ns <= until_ns);
        let until = Recorded { observations: before.cloned().collect(), ..self.recorded.clone() };
        placed(&chosen(&until, SWEEPS, Selection::FarthestPoint), self.seed).0
    }
}

/// Sweeps of an empty space, as a calibration takes them.
fn empty(scenario: &Scenario) -> Result<Vec<Vec<num_complex::Complex<i16>>>, ScenarioError> {
    let empty = Scenario {
        scene: "nothing".into(),
        motion: "stationary".into(),
        duration_s: 0.5,
        seed: scenario.seed ^ 0xCA11_B8A7,
        ..scenario.clone()
    };
    let frames = empty.run()?.frames;
    Ok(frames.iter().flat_map(|frame| sweeps(frame, scenario.config.points_per_sweep())).collect())
}

fn sweeps(frame: &crate::radar::Frame, points: usize) -> Vec<Vec<num_complex::Complex<i16>>> {
    frame.samples.chunks_exact(points.max(1)).map(<[_]>::to_vec).collect()
}

/// How right the detector is on a straight way, one standard deviation.
#[derive(Clone, Copy)]
struct Right {
    distance_m: f64,
    velocity_m_per_s: f64,
}

/// What a look leaves open: a ring around the way, as far as it lies in the beam.
#[derive(Clone, Copy)]
struct Ring {
    /// Its length, metres.
    length_m: f64,
    /// Space within one standard deviation of range and speed, cm³.
    cm3: f64,
}

fn ring(sight: &Sight, place: DVec3, right: Right) -> Ring {
    let (distance_m, speed) = (sight.distance_m(place), sight.speed_m_per_s());
    let cos = sight.angle_deg(place).to_radians().cos();
    let half = right.velocity_m_per_s / speed;
    let band = (cos + half).min(1.0) - (cos - half).max(-1.0);
    let along = sight.sensor.velocity_m_per_s.normalize_or(DVec3::Z);
    let (a, b) = along.any_orthonormal_pair();
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    const PARTS: usize = 180;
    let on_ring = |n: usize| {
        let (y, x) = (n as f64 / PARTS as f64 * std::f64::consts::TAU).sin_cos();
        along * cos + (a * x + b * y) * sin
    };
    let forward = sight.sensor.tracking_from_sensor.forward();
    let in_beam = (0..PARTS).filter(|&n| angle_deg(forward, on_ring(n)) < SEEN_DEG).count().max(1);
    let steradians = std::f64::consts::TAU * band * in_beam as f64 / PARTS as f64;
    Ring {
        length_m: std::f64::consts::TAU * distance_m * sin * in_beam as f64 / PARTS as f64,
        cm3: distance_m * distance_m * 2.0 * right.distance_m * steradians * 1e6,
    }
}

/// Space within one standard deviation of a place along each of the covariance's axes, cm³.
fn box_cm3(refined: &Refined) -> f64 {
    8.0 * refined.covariance_m2.determinant().max(0.0).sqrt() * 1e6
}

/// Two standard deviations along the covariance's longest axis, metres.
fn longest_m(refined: &Refined) -> f64 {
    2.0 * eigen(&refined.covariance_m2).0.into_iter().fold(0.0, f64::max).sqrt()
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        done: format!(
            "The vendor's detector, written from its description, and ours on the same simulated sweeps; a corner reflector of {SNR_DB:.0} dB at 1 m, \
             {} seeds. As a robot goes: straight on at {} m/s with the vendor's own configuration (0.15 to 0.6 m, step 2, 12 averages, profile 3, \
             16 sweeps in a window, 50 looks a second), past a reflector 30 cm beside the way. As a head goes: the same algorithm reaching \
             from {} to {} m and following up to {} m/s, with the speed that tracking tells in place of a robot's. It is calibrated with half a second of an \
             empty room. Ours: {SWEEPS} of the sweeps by farthest point, least squares, the place refined.",
            trials.seeds, ROBOT.1, FREE_CONFIG.range_m[0], FREE_CONFIG.range_m[1], FREE_CONFIG.max_speed_m_per_s
        ),
        ..Outcome::default()
    };
    let right = straight(trials, &mut outcome)?;
    trials.done(1, 5);
    free(trials, &mut outcome, right)?;
    trials.done(3, 5);
    pair(trials, &mut outcome)?;
    Ok(outcome)
}

/// Past a reflector beside a straight way.
fn straight(trials: &Trials, outcome: &mut Outcome) -> Result<Right, ExperimentError> {
    let config = DetectorConfig::default();
    let watched = (1..=trials.seeds).map(|seed| Watched::of("corner-reflector", ROBOT.0, &config, ROBOT_S, seed));
    let watched: Vec<Watched> = watched.collect::<Result<_, _>>()?;
    let (mut rows, mut measured, mut by_ours) = (Vec::new(), Vec::new(), Vec::new());
    let (mut all_range, mut all_speed, mut worst_angle, mut least_seen) = (Vec::new(), Vec::new(), 0.0f64, 1.0f64);
    let (mut extra, mut all_looks) = (0, 0);
    for angle in ANGLES_DEG {
        let (mut looks, mut others, mut no_angle) = (0, 0, 0);
        let (mut range, mut speed, mut angles) = (Vec::new(), Vec::new(), Vec::new());
        let (mut own_range, mut own_angle, mut known) = (Vec::new(), Vec::new(), "range alone");
        for watched in &watched {
            let place = watched.recorded.truth_m;
            let mut last = None;
            for sight in watched.asked(&config, place) {
                let true_angle = sight.angle_deg(place);
                if (true_angle - angle).abs() > ANGLE_HALF_DEG {
                    continue;
                }
                (looks, last) = (looks + 1, Some(sight));
                others += sight.look.reflections.len().saturating_sub(1);
                let Some(found) = sight.found(place) else { continue };
                range.push((found.distance_m - sight.distance_m(place)).abs());
                speed.push((found.velocity_m_per_s - sight.velocity_m_per_s(place)).abs());
                match cone_angle_rad(found.velocity_m_per_s, ROBOT.1) {
                    Some(cone) => {
                        angles.push((cone.to_degrees() - true_angle).abs());
                        measured.push([true_angle, cone.to_degrees()]);
                    }
                    None => no_angle += 1,
                }
            }
            let Some(sight) = last else { continue };
            if let Some(refined) = watched.placed_until(sight.time_s) {
                let own = sight.angle_deg(refined.position_m);
                own_range.push((sight.distance_m(refined.position_m) - sight.distance_m(place)).abs());
                own_angle.push((own - sight.angle_deg(place)).abs());
                by_ours.push([sight.angle_deg(place), own]);
                known = observed(&[Some(refined)]);
            }
        }
        let [r, s, a, own_r, own_a] =
            [&range, &speed, &angles, &own_range, &own_angle].map(|values| quantile(values, 0.5));
        let seen = range.len() as f64 / f64::from(looks.max(1));
        rows.push(vec![
            format!("{angle:.0} ± {ANGLE_HALF_DEG:.0}"),
            looks.to_string(),
            format!("{:.0}", seen * 100.0),
            mm(r),
            mm(s),
            format!("{a:.1}"),
            format!("{:.1}", quantile(&angles, 0.95)),
            no_angle.to_string(),
            format!("{:.1}", others as f64 / f64::from(looks.max(1))),
            mm(own_r),
            format!("{own_a:.1}"),
            known.to_owned(),
        ]);
        (extra, all_looks) = (extra + others, all_looks + looks);
        (worst_angle, least_seen) = (worst_angle.max(a), least_seen.min(seen));
        all_range.extend(range);
        all_speed.extend(speed);
    }
    // Two in three of all errors lie below one standard deviation.
    let right = Right { distance_m: quantile(&all_range, 0.683), velocity_m_per_s: quantile(&all_speed, 0.683) };
    if let Some(first) = watched.first() {
        let place = first.recorded.truth_m;
        let near = |sight: &&Sight| (sight.angle_deg(place) - 45.0).abs();
        if let Some(sight) = first.asked(&config, place).min_by(|a, b| near(a).total_cmp(&near(b))) {
            draw_look(
                outcome,
                "range-and-speed",
                "What a window shows: one reflector, 45° off the way",
                sight,
                &[place],
            );
        }
    }
    let line = Series { name: "truth".into(), points: vec![[28.0, 28.0], [62.0, 62.0]], joined: true };
    let dots = |name: &str, points: Vec<[f64; 2]>| Series { name: name.into(), points, joined: false };
    let chart = Chart {
        title: "Straight on at 0.3 m/s: the angle between the way and the reflector".into(),
        x_label: "true angle (degrees)".into(),
        y_label: "measured angle (degrees)".into(),
        series: vec![
            line,
            dots("vendor's detector, look by look", measured),
            dots("ours, from all sweeps so far", by_ours),
        ],
        ..Chart::default()
    };
    outcome.draw("angle-straight", chart.draw(), "The cone's angle as a robot drives past: on the line it is right.");
    let (r, s) = (quantile(&all_range, 0.5), quantile(&all_speed, 0.5));
    outcome.finds(
        "The transform over the sweeps of an even motion shows each thing's range and its speed to the robot (2.5, figure 2.4).",
        least_seen >= 0.95 && r < 0.01 && s < 0.02,
        format!(
            "straight on at 0.3 m/s: seen in at least {:.0} % of the looks, {} mm and {} mm/s off in the median; besides it {extra} reflections of nothing in {all_looks} looks",
            least_seen * 100.0,
            mm(r),
            mm(s)
        ),
    );
    outcome.finds(
        "Simple trigonometry gives the angle to every thing from its speed and the robot's (2.5).",
        worst_angle < 5.0,
        format!("straight on: the cone is off by {worst_angle:.1}° or less in the median at 30° to 60°, and is open all around the way"),
    );
    outcome.tables.push(Table {
        head: head(&[
            "angle to the way (°)",
            "looks",
            "seen (%)",
            "vendor: range off (mm)",
            "speed off (mm/s)",
            "cone off (°)",
            "95 % (°)",
            "no angle",
            "others a look",
            "ours: range off (mm)",
            "cone off (°)",
            "observed",
        ]),
        rows,
        caption: "Straight on past one reflector. Medians. No angle: the measured speed is above the robot's. Others: \
            reflections where nothing is, feet of the range filter under a strong echo. Ours: once a seed, at the last of \
            those looks, from all sweeps so far."
            .into(),
    });
    Ok(right)
}

/// A window as a picture, with what is there and what was found.
fn draw_look(outcome: &mut Outcome, name: &str, title: &str, sight: &Sight, things_m: &[DVec3]) {
    let spectrum = &sight.look.spectrum;
    let count = spectrum.bins.len();
    let mut bins: Vec<usize> = (0..count).collect();
    bins.sort_by(|a, b| spectrum.velocity_m_per_s(*a as f64).total_cmp(&spectrum.velocity_m_per_s(*b as f64)));
    let greatest = spectrum.bins.iter().flatten().map(|z| z.norm()).fold(f64::MIN_POSITIVE, f64::max);
    let decibels =
        |bin: &usize| spectrum.bins[*bin].iter().map(|z| 20.0 * (z.norm() / greatest).log10()).collect::<Vec<_>>();
    let slowest = bins.first().map_or(0.0, |bin| spectrum.velocity_m_per_s(*bin as f64)) - 0.5 * spectrum.bin_m_per_s;
    let (axis, half_m) = (&spectrum.axis, 0.5 * spectrum.axis.step_m);
    let picture = HeatChart {
        title: title.into(),
        x_label: "range (m)".into(),
        y_label: "speed, away from the sensor (m/s)".into(),
        quantity: "magnitude against the greatest (dB)".into(),
        x: [axis.first_m - half_m, axis.last_m() + half_m],
        y: [slowest, slowest + count as f64 * spectrum.bin_m_per_s],
        columns: axis.points,
        values: bins.iter().flat_map(decibels).collect(),
        scale: [-50.0, 0.0],
        truth: things_m.iter().map(|&place| [sight.distance_m(place), sight.velocity_m_per_s(place)]).collect(),
        found: sight.look.reflections.iter().map(|found| [found.distance_m, found.velocity_m_per_s]).collect(),
    };
    outcome.draw(name, picture.draw(), format!("{title}: range and speed, as the thesis' figure 2.4."));
}

/// As a head goes.
fn free(trials: &Trials, outcome: &mut Outcome, right: Right) -> Result<(), ExperimentError> {
    let (mut rows, mut told) = (Vec::new(), Vec::new());
    let (mut as_it_is, mut with_way, mut rings, mut boxes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut as_is_off, mut own_off) = (Vec::new(), Vec::new());
    for (motion, words) in FREE {
        let (mut looks, mut seen, mut cones, mut ahead, mut along, mut space) =
            (0, 0, 0, Vec::new(), Vec::new(), Vec::new());
        let (mut own, mut own_space, mut own_long, mut known) = (Vec::new(), Vec::new(), Vec::new(), "range alone");
        let (mut lengths, mut too_fast) = (Vec::new(), 0);
        for seed in 1..=trials.seeds {
            let watched = Watched::of("corner-reflector", motion, &FREE_CONFIG, FREE_S, seed)?;
            let place = watched.recorded.truth_m;
            for sight in watched.asked(&FREE_CONFIG, place) {
                looks += 1;
                too_fast += usize::from(sight.velocity_m_per_s(place).abs() > FREE_CONFIG.max_speed_m_per_s);
                let Some(found) = sight.found(place) else { continue };
                seen += 1;
                let ring = ring(sight, place, right);
                space.push(ring.cm3);
                lengths.push(ring.length_m);
                if motion == FREE[0].0 && seed == 1 {
                    rings.push([sight.time_s, ring.cm3]);
                }
                let Some(cone) = cone_angle_rad(found.velocity_m_per_s, sight.tracked_m_per_s.length()) else {
                    continue;
                };
                cones += 1;
                let cone = cone.to_degrees();
                ahead.push((cone - sight.off_boresight_deg(place)).abs());
                let true_angle = angle_deg(sight.tracked_m_per_s, sight.toward(place));
                along.push((cone - true_angle).abs());
                // Every fourth is enough to see.
                if motion == FREE[0].0 && cones % 4 == 0 {
                    as_it_is.push([sight.off_boresight_deg(place), cone]);
                    with_way.push([true_angle, cone]);
                }
            }
            let refined = watched.placed_until(FREE_S);
            own.push(refined.as_ref().map_or(f64::INFINITY, |refined| refined.position_m.distance(place)));
            own_space.push(refined.as_ref().map_or(f64::INFINITY, box_cm3));
            own_long.push(refined.as_ref().map_or(f64::INFINITY, longest_m));
            known = observed(&[refined]);
            if motion == FREE[0].0 && seed == 1 {
                let times = [0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.5, FREE_S];
                boxes.extend(times.iter().filter_map(|&t| Some([t, box_cm3(&watched.placed_until(t)?)])));
            }
        }
        let share = |part: usize, of: usize| format!("{:.0}", 100.0 * part as f64 / of.max(1) as f64);
        let [ahead_off, along_off, ring, length, own_mid, own_box, own_length] =
            [&ahead, &along, &space, &lengths, &own, &own_space, &own_long].map(|values| quantile(values, 0.5));
        rows.push(vec![
            words.to_owned(),
            looks.to_string(),
            share(seen, looks),
            share(cones, seen),
            format!("{ahead_off:.0}"),
            format!("{along_off:.1}"),
            format!("{:.0}", quantile(&along, 0.95)),
            share(too_fast, looks),
            format!("{length:.2}"),
            format!("{ring:.1}"),
            mm(own_mid),
            mm(own_length),
            format!("{own_box:.3}"),
            known.to_owned(),
        ]);
        told.push(format!(
            "{words}: {ahead_off:.0}° off as it is, {along_off:.1}° about the way from tracking, which leaves a ring of {length:.1} m; ours is {} mm off \
             and leaves {} mm",
            mm(own_mid),
            mm(own_length)
        ));
        as_is_off.push(ahead_off);
        own_off.push(own_mid);
    }
    let dots = |name: &str, points: Vec<[f64; 2]>| Series { name: name.into(), points, joined: false };
    let line = Series { name: "truth".into(), points: vec![[0.0, 0.0], [180.0, 180.0]], joined: true };
    let chart = Chart {
        title: "The same algorithm on a head: within a sphere of 50 cm".into(),
        x_label: "true angle, to what the cone is taken about (degrees)".into(),
        y_label: "measured angle (degrees)".into(),
        series: vec![
            line,
            dots("as it is: about the boresight", as_it_is),
            dots("about the way that tracking tells", with_way),
        ],
        ..Chart::default()
    };
    outcome.draw(
        "angle-free",
        chart.draw(),
        "A head does not go where it looks: about the boresight the cone means nothing. Green far from the line: too fast, the speed is ambiguous.",
    );
    let chart = Chart {
        title: "How much space is left within one standard deviation, sensor within a sphere of 50 cm".into(),
        x_label: "time since the recording began (s)".into(),
        y_label: "space left (cm³)".into(),
        y_log: true,
        series: vec![
            dots("vendor's detector, look by look", rings),
            Series { name: "ours, from all sweeps so far".into(), points: boxes, joined: true },
        ],
        ..Chart::default()
    };
    outcome.draw(
        "space-left",
        chart.draw(),
        "The detector's cone stays a ring around the way; ours gathers what all ways tell.",
    );
    outcome.finds(
        "The detector is a simpler predecessor; where the motion is unpredictable more is needed (1, 2.5).",
        as_is_off.iter().all(|off| *off > 20.0) && own_off.iter().all(|off| *off < 0.05),
        told.join("; "),
    );
    outcome.tables.push(Table {
        head: head(&[
            "motion",
            "looks",
            "seen (%)",
            "with an angle (%)",
            "about the boresight: off (°)",
            "about the tracked way: off (°)",
            "95 % (°)",
            "too fast for it (%)",
            "its ring (m)",
            "of space (cm³)",
            "ours: off (mm)",
            "longest axis (mm)",
            "of space (cm³)",
            "observed",
        ]),
        rows,
        caption: format!(
            "As a head goes. Looks: those in which the reflector is within range and {SEEN_DEG:.0}° of the boresight and the sensor faster than \
             {LEAST_M_PER_S} m/s. Medians. About the boresight: as the algorithm takes it. Too fast: its speed is ambiguous. Ring: how long the circle is, within \
             the beam, on which the look leaves the thing; its space, and that of our covariance after {FREE_S:.0} s, is that within one standard \
             deviation either way (of the detector {} mm and {} mm/s, from the straight way).",
            mm(right.distance_m),
            mm(right.velocity_m_per_s)
        ),
    });
    Ok(())
}

/// Two things at the same range.
fn pair(trials: &Trials, outcome: &mut Outcome) -> Result<(), ExperimentError> {
    let trips = [
        (ROBOT.0, "straight on at 0.3 m/s", DetectorConfig::default(), ROBOT_S),
        (FREE[0].0, FREE[0].1, FREE_CONFIG, FREE_S),
    ];
    let (mut rows, mut told, mut both_shares, mut parted) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (motion, words, config, duration_s) in trips {
        let (mut looks, mut both, mut wrong) = (0usize, 0usize, 0usize);
        // Looks, and those that show both, by whether the speeds are at least two bins apart.
        let mut by_speed = [[0usize; 2]; 2];
        let (mut two, mut off) = (0usize, Vec::new());
        for seed in 1..=trials.seeds {
            let watched = Watched::of("pair", motion, &config, duration_s, seed)?;
            let [left, right] = watched.things_m[..] else { continue };
            let asked: Vec<&Sight> = watched
                .asked(&config, left)
                .filter(|sight| watched.asked(&config, right).any(|other| std::ptr::eq(*sight, other)))
                .collect();
            for sight in &asked {
                looks += 1;
                let shown = |place| sight.look.reflections.iter().position(|found| sight.shows(found, place));
                // Each by a reflection of its own.
                let are_both = matches!((shown(left), shown(right)), (Some(a), Some(b)) if a != b);
                both += usize::from(are_both);
                let apart = (sight.velocity_m_per_s(left) - sight.velocity_m_per_s(right)).abs();
                let of_speed = &mut by_speed[usize::from(apart >= 2.0 * sight.look.spectrum.bin_m_per_s)];
                of_speed[0] += 1;
                of_speed[1] += usize::from(are_both);
                let of_neither = |found: &&Reflection| !sight.shows(found, left) && !sight.shows(found, right);
                wrong += usize::from(sight.look.reflections.iter().filter(of_neither).count() > 0);
            }
            if seed == 1
                && motion == ROBOT.0
                && let Some(sight) = asked.get(asked.len() / 2)
            {
                let title = "Two reflectors 20 cm apart, as a robot comes near";
                draw_look(outcome, "pair-range-and-speed", title, sight, &watched.things_m);
            }
            if let Some(found) = watched.parted(duration_s) {
                two += 1;
                let apart = |a: DVec3, b: DVec3| a.distance(left).max(b.distance(right));
                off.push(apart(found[0], found[1]).min(apart(found[1], found[0])));
            }
        }
        let share = |part: usize| 100.0 * part as f64 / looks.max(1) as f64;
        let part = |[of, part]: [usize; 2]| {
            if of > 0 { format!("{:.0}", 100.0 * part as f64 / of as f64) } else { "–".into() }
        };
        let off_m = if off.is_empty() { f64::NAN } else { quantile(&off, 0.5) };
        rows.push(vec![
            words.to_owned(),
            looks.to_string(),
            format!("{:.0}", share(both)),
            part(by_speed[0]),
            part(by_speed[1]),
            format!("{:.0}", share(wrong)),
            format!("{two} of {}", trials.seeds),
            mm(off_m),
        ]);
        told.push(format!(
            "{words}: both in {:.0} % of the detector's looks ({}); ours parts them in {two} of {} recordings, {} mm off",
            share(both),
            match by_speed[1][0] {
                0 => "their speeds are nowhere two bins apart".to_owned(),
                _ => format!("{} % where their speeds are two bins apart", part(by_speed[1])),
            },
            trials.seeds,
            mm(off_m)
        ));
        both_shares.push(share(both));
        parted.push(two as u64 == trials.seeds && off_m < 0.05);
    }
    outcome.finds(
        "Each bin of the transform is another speed to the robot (2.5): so two things at one range are two by their speeds.",
        both_shares.iter().all(|share| *share > 50.0),
        told.join("; "),
    );
    outcome.tables.push(Table {
        head: head(&[
            "motion",
            "looks",
            "vendor: both seen (%)",
            "speeds alike (%)",
            "two bins apart (%)",
            "something that is neither (%)",
            "ours: parted",
            "farther one off (mm)",
        ]),
        rows,
        caption: "Two equal corner reflectors 20 cm apart across the first line of sight, looks in which both are within range and in the beam. \
            Seen: a reflection within 5 cm and 5 cm/s. Ours: the joint fit of two places, from all sweeps."
            .into(),
    });
    Ok(())
}

impl Watched {
    /// Ours of two: the place, split where the sweeps say that there are two.
    fn parted(&self, time_s: f64) -> Option<[DVec3; 2]> {
        let refined = self.placed_until(time_s)?;
        let sweeps = chosen(&self.recorded, SWEEPS, Selection::FarthestPoint);
        let power = RangePower::new(&sweeps, &Beam::Lensless, 0.15);
        let both = split(&power, &refined, &PositionErrors::default())?;
        Some(both.map(|one| one.position_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ring_is_the_shell_between_two_cones() {
        let config = DetectorConfig::default();
        let watched = Watched::of("corner-reflector", ROBOT.0, &config, 2.2, 1).unwrap();
        let place = watched.recorded.truth_m;
        let sight = watched.asked(&config, place).last().unwrap();
        let right = Right { distance_m: 0.01, velocity_m_per_s: 0.003 };
        // 0.3 m/s: the cosine is told to ±0.01; the whole ring is in the beam, since the robot looks where it goes.
        let cm3 = std::f64::consts::TAU * 0.02 * sight.distance_m(place).powi(2) * 0.02 * 1e6;
        let ring = ring(sight, place, right);
        assert!((ring.cm3 / cm3 - 1.0).abs() < 1e-6);
        // The reflector stands 30 cm beside the way.
        assert!((ring.length_m - std::f64::consts::TAU * 0.3).abs() < 0.01);
        assert!((sight.angle_deg(place) - sight.off_boresight_deg(place)).abs() < 0.1);
    }
}
