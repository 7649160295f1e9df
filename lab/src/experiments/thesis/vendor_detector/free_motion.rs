//! Head motion: the detector, made for straight paths, with free motion.

use super::super::imaging_methods::observed;
use super::super::{ExperimentError, Outcome, Trials, head, mm};
use super::detector_run::{DetectorRun, angle_deg};
use super::uncertainty_ring::{DetectorAccuracy, box_cm3, longest_m, ring};
use super::{FREE_CONFIG, FREE_DURATION_S, FREE_MOTIONS, MAX_OFF_BORESIGHT_DEG, MIN_SPEED_M_PER_S};
use crate::baselines::cone_angle_rad;
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Chart, Series, Table};

/// Evaluates both head motions. `right`: the detector's accuracy on a straight path.
pub(super) fn free(trials: &Trials, outcome: &mut Outcome, right: DetectorAccuracy) -> Result<(), ExperimentError> {
    let (mut rows, mut findings) = (Vec::new(), Vec::new());
    let (mut as_it_is, mut with_way, mut rings, mut boxes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut as_is_off, mut own_off) = (Vec::new(), Vec::new());
    for (motion, words) in FREE_MOTIONS {
        let (mut windows, mut seen, mut cones, mut ahead, mut along, mut space) =
            (0, 0, 0, Vec::new(), Vec::new(), Vec::new());
        let (mut own, mut own_space, mut own_long, mut known) = (Vec::new(), Vec::new(), Vec::new(), "range alone");
        let (mut lengths, mut too_fast) = (Vec::new(), 0);
        for seed in 1..=trials.seeds {
            let watched = DetectorRun::of("corner-reflector", motion, &FREE_CONFIG, FREE_DURATION_S, seed)?;
            let point = watched.recorded.truth_m;
            for sight in watched.detectable(&FREE_CONFIG, point) {
                windows += 1;
                too_fast += usize::from(sight.velocity_m_per_s(point).abs() > FREE_CONFIG.max_speed_m_per_s);
                let Some(found) = sight.found(point) else { continue };
                seen += 1;
                let ring = ring(sight, point, right);
                space.push(ring.cm3);
                lengths.push(ring.length_m);
                if motion == FREE_MOTIONS[0].0 && seed == 1 {
                    rings.push([sight.time_s, ring.cm3]);
                }
                let Some(cone) = cone_angle_rad(found.velocity_m_per_s, sight.tracked_m_per_s.length()) else {
                    continue;
                };
                cones += 1;
                let cone = cone.to_degrees();
                ahead.push((cone - sight.off_boresight_deg(point)).abs());
                let true_angle = angle_deg(sight.tracked_m_per_s, sight.toward(point));
                along.push((cone - true_angle).abs());
                // Every fourth point is enough for the plot.
                if motion == FREE_MOTIONS[0].0 && cones % 4 == 0 {
                    as_it_is.push([sight.off_boresight_deg(point), cone]);
                    with_way.push([true_angle, cone]);
                }
            }
            let refined = watched.located_until(FREE_DURATION_S);
            own.push(refined.as_ref().map_or(f64::INFINITY, |refined| refined.position_m.distance(point)));
            own_space.push(refined.as_ref().map_or(f64::INFINITY, box_cm3));
            own_long.push(refined.as_ref().map_or(f64::INFINITY, longest_m));
            known = observed(&[refined]);
            if motion == FREE_MOTIONS[0].0 && seed == 1 {
                let times = [0.25, 0.5, 1.0, 2.0, 3.5, 5.0, 7.5, FREE_DURATION_S];
                boxes.extend(times.iter().filter_map(|&t| Some([t, box_cm3(&watched.located_until(t)?)])));
            }
        }
        let share = |part: usize, of: usize| format!("{:.0}", 100.0 * part as f64 / of.max(1) as f64);
        let [ahead_off, along_off, ring, length, own_mid, own_box, own_length] =
            [&ahead, &along, &space, &lengths, &own, &own_space, &own_long].map(|values| quantile(values, 0.5));
        rows.push(vec![
            words.to_owned(),
            windows.to_string(),
            share(seen, windows),
            share(cones, seen),
            format!("{ahead_off:.0}"),
            format!("{along_off:.1}"),
            format!("{:.0}", quantile(&along, 0.95)),
            share(too_fast, windows),
            format!("{length:.2}"),
            format!("{ring:.1}"),
            mm(own_mid),
            mm(own_length),
            format!("{own_box:.3}"),
            known.to_owned(),
        ]);
        findings.push(format!(
            "{words}: cone {ahead_off:.0}° off about the boresight, {along_off:.1}° off about the tracked path, \
             which leaves a ring of {length:.1} m; ours is {} mm off and leaves {} mm",
            mm(own_mid),
            mm(own_length)
        ));
        as_is_off.push(ahead_off);
        own_off.push(own_mid);
    }
    let dots = |name: &str, points: Vec<[f64; 2]>| Series { name: name.into(), points, joined: false };
    let line = Series { name: "truth".into(), points: vec![[0.0, 0.0], [180.0, 180.0]], joined: true };
    let chart = Chart {
        title: "The same algorithm with head motion: within a sphere of 50 cm".into(),
        x_label: "true angle to the cone's axis (degrees)".into(),
        y_label: "measured angle (degrees)".into(),
        series: vec![line, dots("unmodified: about the boresight", as_it_is), dots("about the tracked path", with_way)],
        ..Chart::default()
    };
    outcome.draw(
        "angle-free",
        chart.draw(),
        "A head does not move along its boresight: a cone about the boresight is meaningless. Green far from the \
         line: too fast, the speed is ambiguous.",
    );
    let chart = Chart {
        title: "Uncertainty volume within one standard deviation, sensor within a sphere of 50 cm".into(),
        x_label: "time since the recording began (s)".into(),
        y_label: "uncertainty volume (cm³)".into(),
        y_log: true,
        series: vec![
            dots("vendor's detector, each window", rings),
            Series { name: "ours, from all sweeps so far".into(), points: boxes, joined: true },
        ],
        ..Chart::default()
    };
    outcome.draw(
        "space-left",
        chart.draw(),
        "The detector's cone remains a ring around the path; ours combines the information of all sweeps.",
    );
    outcome.add_finding(
        "The detector is a simpler predecessor; where the motion is unpredictable more is needed (1, 2.5).",
        as_is_off.iter().all(|off| *off > 20.0) && own_off.iter().all(|off| *off < 0.05),
        findings.join("; "),
    );
    outcome.tables.push(Table {
        head: head(&[
            "motion",
            "windows",
            "seen (%)",
            "with an angle (%)",
            "about the boresight: off (°)",
            "about the tracked path: off (°)",
            "95 % (°)",
            "too fast (%)",
            "ring (m)",
            "volume (cm³)",
            "ours: off (mm)",
            "longest axis (mm)",
            "volume (cm³)",
            "observed",
        ]),
        rows,
        caption: format!(
            "Head motion. Windows: those in which the reflector is within range and {MAX_OFF_BORESIGHT_DEG:.0}° of the boresight \
             and the sensor faster than {MIN_SPEED_M_PER_S} m/s. Medians. About the boresight: the unmodified algorithm. \
             Too fast: its speed is ambiguous. Ring: length, within the beam, of the circle of possible positions; its \
             volume, and that of our covariance after {FREE_DURATION_S:.0} s, is that within ± one standard deviation (of the \
             detector {} mm and {} mm/s, from the straight path).",
            mm(right.distance_m),
            mm(right.velocity_m_per_s)
        ),
    });
    Ok(())
}
