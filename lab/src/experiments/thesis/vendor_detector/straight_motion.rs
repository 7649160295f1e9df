//! Robot motion: past a reflector beside a straight path.

use super::super::imaging_methods::observed;
use super::super::{ExperimentError, Outcome, Trials, head, mm};
use super::detector_run::{DetectorRun, WindowWithTruth};
use super::picture::draw_look;
use super::uncertainty_ring::DetectorAccuracy;
use super::{ANGLE_HALF_DEG, ANGLES_DEG, ROBOT, ROBOT_DURATION_S};
use crate::baselines::{DetectorConfig, cone_angle_rad};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Chart, Series, Table};

/// Figures at each angle to the path; returns the detector's accuracy.
pub(super) fn straight(trials: &Trials, outcome: &mut Outcome) -> Result<DetectorAccuracy, ExperimentError> {
    let config = DetectorConfig::default();
    let watched =
        (1..=trials.seeds).map(|seed| DetectorRun::of("corner-reflector", ROBOT.0, &config, ROBOT_DURATION_S, seed));
    let watched: Vec<DetectorRun> = watched.collect::<Result<_, _>>()?;
    let (mut rows, mut measured, mut by_ours) = (Vec::new(), Vec::new(), Vec::new());
    let (mut all_range, mut all_speed, mut worst_angle, mut least_seen) = (Vec::new(), Vec::new(), 0.0f64, 1.0f64);
    let (mut extra, mut all_windows) = (0, 0);
    for angle in ANGLES_DEG {
        let (mut windows, mut others, mut no_angle) = (0, 0, 0);
        let (mut range, mut speed, mut angles) = (Vec::new(), Vec::new(), Vec::new());
        let (mut own_range, mut own_angle, mut known) = (Vec::new(), Vec::new(), "range alone");
        for watched in &watched {
            let point = watched.recorded.truth_m;
            let mut last = None;
            for sight in watched.detectable(&config, point) {
                let true_angle = sight.angle_deg(point);
                if (true_angle - angle).abs() > ANGLE_HALF_DEG {
                    continue;
                }
                (windows, last) = (windows + 1, Some(sight));
                others += sight.result.reflections.len().saturating_sub(1);
                let Some(found) = sight.found(point) else { continue };
                range.push((found.distance_m - sight.distance_m(point)).abs());
                speed.push((found.velocity_m_per_s - sight.velocity_m_per_s(point)).abs());
                match cone_angle_rad(found.velocity_m_per_s, ROBOT.1) {
                    Some(cone) => {
                        angles.push((cone.to_degrees() - true_angle).abs());
                        measured.push([true_angle, cone.to_degrees()]);
                    }
                    None => no_angle += 1,
                }
            }
            let Some(sight) = last else { continue };
            if let Some(refined) = watched.located_until(sight.time_s) {
                let own = sight.angle_deg(refined.position_m);
                own_range.push((sight.distance_m(refined.position_m) - sight.distance_m(point)).abs());
                own_angle.push((own - sight.angle_deg(point)).abs());
                by_ours.push([sight.angle_deg(point), own]);
                known = observed(&[Some(refined)]);
            }
        }
        let [r, s, a, own_r, own_a] =
            [&range, &speed, &angles, &own_range, &own_angle].map(|values| quantile(values, 0.5));
        let seen = range.len() as f64 / f64::from(windows.max(1));
        rows.push(vec![
            format!("{angle:.0} ± {ANGLE_HALF_DEG:.0}"),
            windows.to_string(),
            format!("{:.0}", seen * 100.0),
            mm(r),
            mm(s),
            format!("{a:.1}"),
            format!("{:.1}", quantile(&angles, 0.95)),
            no_angle.to_string(),
            format!("{:.1}", others as f64 / f64::from(windows.max(1))),
            mm(own_r),
            format!("{own_a:.1}"),
            known.to_owned(),
        ]);
        (extra, all_windows) = (extra + others, all_windows + windows);
        (worst_angle, least_seen) = (worst_angle.max(a), least_seen.min(seen));
        all_range.extend(range);
        all_speed.extend(speed);
    }
    // 68.3 % of the errors lie below one standard deviation.
    let right =
        DetectorAccuracy { distance_m: quantile(&all_range, 0.683), velocity_m_per_s: quantile(&all_speed, 0.683) };
    if let Some(first) = watched.first() {
        let point = first.recorded.truth_m;
        let near = |sight: &&WindowWithTruth| (sight.angle_deg(point) - 45.0).abs();
        if let Some(sight) = first.detectable(&config, point).min_by(|a, b| near(a).total_cmp(&near(b))) {
            draw_look(outcome, "range-and-speed", "One window: one reflector, 45° off the path", sight, &[point]);
        }
    }
    let line = Series { name: "truth".into(), points: vec![[28.0, 28.0], [62.0, 62.0]], joined: true };
    let dots = |name: &str, points: Vec<[f64; 2]>| Series { name: name.into(), points, joined: false };
    let chart = Chart {
        title: "Straight ahead at 0.3 m/s: the angle between the path and the reflector".into(),
        x_label: "true angle (degrees)".into(),
        y_label: "measured angle (degrees)".into(),
        series: vec![
            line,
            dots("vendor's detector, each window", measured),
            dots("ours, from all sweeps so far", by_ours),
        ],
        ..Chart::default()
    };
    outcome.draw("angle-straight", chart.draw(), "The cone's angle as a robot drives past: on the line it is right.");
    let (r, s) = (quantile(&all_range, 0.5), quantile(&all_speed, 0.5));
    outcome.add_finding(
        "The transform over the sweeps of a uniform motion shows each object's range and its speed relative to the \
         robot (2.5, figure 2.4).",
        least_seen >= 0.95 && r < 0.01 && s < 0.02,
        format!(
            "straight ahead at 0.3 m/s: seen in at least {:.0} % of the windows, {} mm and {} mm/s off in the \
             median; also {extra} spurious reflections in {all_windows} windows",
            least_seen * 100.0,
            mm(r),
            mm(s)
        ),
    );
    outcome.add_finding(
        "Simple trigonometry gives the angle to every object from its speed and the robot's (2.5).",
        worst_angle < 5.0,
        format!(
            "straight ahead: the cone is off by {worst_angle:.1}° or less in the median at 30° to 60°; the \
            direction around the path stays open"
        ),
    );
    outcome.tables.push(Table {
        head: head(&[
            "angle to the path (°)",
            "windows",
            "seen (%)",
            "vendor: range off (mm)",
            "speed off (mm/s)",
            "cone off (°)",
            "95 % (°)",
            "no angle",
            "others per window",
            "ours: range off (mm)",
            "cone off (°)",
            "observed",
        ]),
        rows,
        caption: "Straight ahead past one reflector. Medians. No angle: the measured speed is above the robot's. \
            Others: spurious reflections, sidelobes of the range filter under a strong echo. Ours: once per seed, at \
            the last of those windows, from all sweeps so far."
            .into(),
    });
    Ok(right)
}
