//! Two objects at the same range: the vendor's detector, and the joint fit of two positions.

use glam::DVec3;

use super::super::imaging_methods::chosen;
use super::super::{ExperimentError, Outcome, Trials, head, mm};
use super::detector_run::{DetectorRun, WindowWithTruth};
use super::picture::draw_look;
use super::{FREE_CONFIG, FREE_DURATION_S, FREE_MOTIONS, ROBOT, ROBOT_DURATION_S, SWEEPS};
use crate::baselines::{DetectorConfig, Reflection};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::Table;
use radar_sar::Beam;
use radar_sar::{PositionErrors, RangePower, Selection, split};

/// Evaluates robot and head motion.
pub(super) fn pair(trials: &Trials, outcome: &mut Outcome) -> Result<(), ExperimentError> {
    let trips = [
        (ROBOT.0, "straight ahead at 0.3 m/s", DetectorConfig::default(), ROBOT_DURATION_S),
        (FREE_MOTIONS[0].0, FREE_MOTIONS[0].1, FREE_CONFIG, FREE_DURATION_S),
    ];
    let (mut rows, mut findings, mut both_shares, mut split_pair) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (motion, words, config, duration_s) in trips {
        let (mut windows, mut both, mut wrong) = (0usize, 0usize, 0usize);
        // Number of windows, and of those that show both objects, by whether the speeds are at
        // least two bins apart.
        let mut by_speed = [[0usize; 2]; 2];
        let (mut two, mut off) = (0usize, Vec::new());
        for seed in 1..=trials.seeds {
            let watched = DetectorRun::of("pair", motion, &config, duration_s, seed)?;
            let [left, right] = watched.things_m[..] else { continue };
            let detectable: Vec<&WindowWithTruth> = watched
                .detectable(&config, left)
                .filter(|sight| watched.detectable(&config, right).any(|other| std::ptr::eq(*sight, other)))
                .collect();
            for sight in &detectable {
                windows += 1;
                let shown = |point| sight.result.reflections.iter().position(|found| sight.matches(found, point));
                // Each by a reflection of its own.
                let are_both = matches!((shown(left), shown(right)), (Some(a), Some(b)) if a != b);
                both += usize::from(are_both);
                let apart = (sight.velocity_m_per_s(left) - sight.velocity_m_per_s(right)).abs();
                let of_speed = &mut by_speed[usize::from(apart >= 2.0 * sight.result.spectrum.bin_m_per_s)];
                of_speed[0] += 1;
                of_speed[1] += usize::from(are_both);
                let of_neither = |found: &&Reflection| !sight.matches(found, left) && !sight.matches(found, right);
                wrong += usize::from(sight.result.reflections.iter().filter(of_neither).count() > 0);
            }
            if seed == 1
                && motion == ROBOT.0
                && let Some(sight) = detectable.get(detectable.len() / 2)
            {
                let title = "Two reflectors 20 cm apart, as a robot comes near";
                draw_look(outcome, "pair-range-and-speed", title, sight, &watched.things_m);
            }
            if let Some(found) = watched.split_pair(duration_s) {
                two += 1;
                let apart = |a: DVec3, b: DVec3| a.distance(left).max(b.distance(right));
                off.push(apart(found[0], found[1]).min(apart(found[1], found[0])));
            }
        }
        let share = |part: usize| 100.0 * part as f64 / windows.max(1) as f64;
        let part = |[of, part]: [usize; 2]| {
            if of > 0 { format!("{:.0}", 100.0 * part as f64 / of as f64) } else { "–".into() }
        };
        let off_m = if off.is_empty() { f64::NAN } else { quantile(&off, 0.5) };
        rows.push(vec![
            words.to_owned(),
            windows.to_string(),
            format!("{:.0}", share(both)),
            part(by_speed[0]),
            part(by_speed[1]),
            format!("{:.0}", share(wrong)),
            format!("{two} of {}", trials.seeds),
            mm(off_m),
        ]);
        findings.push(format!(
            "{words}: both in {:.0} % of the detector's windows ({}); ours separates them in {two} of {} recordings, \
             {} mm off",
            share(both),
            match by_speed[1][0] {
                0 => "their speeds are nowhere two bins apart".to_owned(),
                _ => format!("{} % where their speeds are two bins apart", part(by_speed[1])),
            },
            trials.seeds,
            mm(off_m)
        ));
        both_shares.push(share(both));
        split_pair.push(two as u64 == trials.seeds && off_m < 0.05);
    }
    outcome.add_finding(
        "Each bin of the transform is another speed relative to the robot (2.5): two objects at one range are \
         separated by their speeds.",
        both_shares.iter().all(|share| *share > 50.0),
        findings.join("; "),
    );
    outcome.tables.push(Table {
        head: head(&[
            "motion",
            "windows",
            "vendor: both seen (%)",
            "similar speeds (%)",
            "two bins apart (%)",
            "spurious reflection (%)",
            "ours: separated",
            "greater error (mm)",
        ]),
        rows,
        caption: "Two equal corner reflectors 20 cm apart across the first line of sight; windows in which both are \
            within range and in the beam. Seen: a reflection within 5 cm and 5 cm/s. Ours: the joint fit of two \
            positions, from all sweeps."
            .into(),
    });
    Ok(())
}

impl DetectorRun {
    /// Our two positions: the refined one, split where the sweeps support two.
    fn split_pair(&self, time_s: f64) -> Option<[DVec3; 2]> {
        let refined = self.located_until(time_s)?;
        let sweeps = chosen(&self.recorded, SWEEPS, Selection::FarthestPoint);
        let power = RangePower::new(&sweeps, &Beam::Lensless, 0.15);
        let both = split(&power, &refined, &PositionErrors::default())?;
        Some(both.map(|one| one.position_m))
    }
}
