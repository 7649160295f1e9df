//! Drift of an IMU alone, at rest and on the swinging arm.

use crate::inertial::{simulated_imu, true_state};
use glam::DVec3;

use super::super::{ExperimentError, Outcome, Trials, cm};
use super::dead_reckoning::{dead_reckon, drift_m, thesis_script};
use super::{DRIFT_TIMES_S, IMU_PARTS, REST_S, medians, scenario};
use crate::inertial::NavState;
use radar_chaperone::report::{Chart, Series, Table};
use radar_simulation::TruePath;

/// A method, and its median drift after each of [`DRIFT_TIMES_S`], metres.
pub(super) struct Drift {
    way: String,
    drift_m: Vec<f64>,
}

/// Drift at rest and on the arm, for each IMU.
pub(super) fn drifts(trials: &Trials) -> Result<Vec<Drift>, ExperimentError> {
    let duration_s = REST_S + DRIFT_TIMES_S[DRIFT_TIMES_S.len() - 1] + 0.1;
    let mut drifts = Vec::new();
    for (motion, words) in [("stationary", "at rest"), ("swinging-arm", "swinging")] {
        let paths = (1..=trials.seeds).map(|seed| Ok(scenario(motion, duration_s, seed)?.path()?));
        let paths = paths.collect::<Result<Vec<TruePath>, ExperimentError>>()?;
        for part in &IMU_PARTS {
            // Three methods: dead reckoning without calibration, with offsets removed, and the
            // thesis' script.
            let mut rows = [Vec::new(), Vec::new(), Vec::new()];
            for path in &paths {
                let samples = simulated_imu(path, part);
                let until_ns = samples[0].time_ns + (REST_S * 1e9) as i64;
                let truth = |time_ns: i64| true_state(path, time_ns).tracking_from_body.translation;
                let start_m = truth(until_ns);
                let after = |states: &[NavState], truth: &dyn Fn(i64) -> DVec3| -> Vec<f64> {
                    DRIFT_TIMES_S.iter().map(|&s| drift_m(states, until_ns, s, truth)).collect()
                };
                rows[0].push(after(&dead_reckon(&samples, path, until_ns, false), &truth));
                rows[1].push(after(&dead_reckon(&samples, path, until_ns, true), &truth));
                rows[2].push(after(&thesis_script(&samples, until_ns), &|ns| truth(ns) - start_m));
            }
            for (rows, way) in rows.iter().zip(["as it comes", "zeroed", "the script"]) {
                drifts.push(Drift { way: format!("{}, {words}, {way}", part.name), drift_m: medians(rows) });
            }
        }
    }
    Ok(drifts)
}

pub(super) fn drift_of<'a>(drifts: &'a [Drift], way: &str) -> &'a [f64] {
    drifts.iter().find(|drift| drift.way == way).map_or(&[f64::NAN; DRIFT_TIMES_S.len()], |drift| &drift.drift_m)
}

pub(super) fn drift_findings(outcome: &mut Outcome, drifts: &[Drift]) {
    let rest = drift_of(drifts, "MPU-6050, at rest, the script");
    let [two_s, five_s, ten_s] = [rest[2], rest[3], rest[4]];
    outcome.add_finding(
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
    outcome.add_finding(
        "Accurate poses by an IMU take calibration, initialisation and filtering.",
        zeroed < 0.5 * raw,
        format!(
            "MPU-6050 on the arm, 2 s of dead reckoning: {} cm off uncalibrated, {} cm with the offsets measured \
            at rest removed",
            cm(raw),
            cm(zeroed)
        ),
    );
    let names: Vec<String> = std::iter::once("unit and way".to_owned())
        .chain(DRIFT_TIMES_S.iter().map(|s| format!("after {s} s (cm)")))
        .collect();
    let row = |drift: &Drift| std::iter::once(drift.way.clone()).chain(drift.drift_m.iter().map(|m| cm(*m))).collect();
    outcome.tables.push(Table {
        head: names,
        rows: drifts.iter().map(row).collect(),
        caption: "Distance from the true position, without any other poses. Zeroed: offsets estimated during the \
            rest. The script ignores rotation."
            .into(),
    });
    let shown = [
        "MPU-6050, at rest, the script",
        "MPU-6050, swinging, zeroed",
        "ICM-42688-P, swinging, zeroed",
        "tactical grade, swinging, zeroed",
    ];
    let series = shown.map(|way| {
        let points = DRIFT_TIMES_S.iter().zip(drift_of(drifts, way)).map(|(s, m)| [*s, m * 100.0]).collect();
        Series { name: way.into(), points, joined: true }
    });
    let chart = Chart {
        title: "Drift of an IMU alone".into(),
        x_label: "time since the last known pose (s)".into(),
        y_label: "distance from the truth (cm)".into(),
        x_log: true,
        y_log: true,
        series: series.into(),
    };
    outcome.draw("drift", chart.draw(), "Medians. The thesis' script at rest, and dead reckoning on the swinging arm.");
}
