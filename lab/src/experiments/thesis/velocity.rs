//! Thesis experiment "sensor velocity": what speed does to the image.

use super::imaging_methods::{Quality, THESIS_VOXEL_M, locate, volume};
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, mm};
use crate::experiments::trial_recording::quantile;
use radar_chaperone::report::{Marks, Table, cross_sections};
use radar_sar::Statistic;

/// The thesis' motions and their speeds, m/s.
const SPEEDS: [(&str, f64); 3] = [("approach-1.0", 1.0), ("approach-1.5", 1.5), ("approach-2.5", 2.5)];
/// Time offsets between poses and sweeps, seconds. Choice: none, and as much as a link or a plugin
/// may cause.
const OFFSETS_S: [f64; 3] = [0.0, 0.005, 0.02];
/// Offsets that are drawn, seconds. Choice: the extremes.
const DRAWN_S: [f64; 2] = [0.0, 0.02];
/// Duration, seconds. Choice: long enough for the slowest motion to come near.
const DURATION_S: f64 = 2.0;

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "The sensor moves towards the reflector and back at three speeds, {DURATION_S:.0} s with preset fine \
             (120 sweeps a second, as the thesis had), {} seeds, all sweeps.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let (mut rows, mut figures) = (Vec::new(), Vec::new());
    let cases: Vec<_> = OFFSETS_S.iter().flat_map(|offset| SPEEDS.map(|speed| (*offset, speed))).collect();
    for (n, &(offset_s, (motion, speed))) in cases.iter().enumerate() {
        trials.report_progress(n, cases.len());
        let (mut depth, mut sizes, mut own) = (Vec::new(), Vec::new(), Vec::new());
        let all = trials.recorded("fine", DURATION_S, |scenario| {
            scenario.motion = motion.into();
            scenario.snr_db = Some(SNR_DB);
            scenario.time_offset_s = offset_s;
        })?;
        for recorded in &all {
            let image = volume(&recorded.observations, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
            let quality = Quality::of(&image, recorded.truth_m);
            depth.push(quality.off_m.z.abs());
            sizes.push(quality.footprint_l);
            let (refined, _) = locate(&recorded.observations, recorded.seed);
            // An approach determines the range only; the cross-range error is not caused by the
            // speed and is left out.
            let off = refined.map(|refined| {
                let toward = (recorded.truth_m - refined.seen_from_m).length();
                (refined.position_m.distance(refined.seen_from_m) - toward).abs()
            });
            own.push(off.unwrap_or(f64::INFINITY));
            if recorded.seed == 1 && DRAWN_S.contains(&offset_s) {
                let path: Vec<_> =
                    recorded.observations.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
                let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &path };
                let late = format!("{:.0} ms", offset_s * 1e3);
                let (words, file) = match offset_s > 0.0 {
                    true => (format!(", poses offset by {late}"), format!("-{late}").replace(' ', "")),
                    false => Default::default(),
                };
                let title = format!("The thesis' image at {speed} m/s{words}");
                let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
                outcome.draw(format!("image-{motion}{file}"), picture, format!("{title}."));
            }
        }
        let [depth, size, own] = [&depth, &sizes, &own].map(|values| quantile(values, 0.5));
        rows.push(vec![
            format!("{speed:.1}"),
            format!("{:.0}", offset_s * 1e3),
            cm(depth),
            format!("{size:.0}"),
            mm(own),
        ]);
        figures.push((size, own));
    }
    let (slow, fast) = (figures[0], figures[2]);
    outcome.add_finding(
        "At 2.5 m/s the image is slightly more blurred than at 1 m/s, without practical relevance.",
        fast.0 > slow.0 && fast.0 < 1.5 * slow.0,
        format!(
            "voxels above half of the peak fill {:.0} l at 1 m/s and {:.0} l at 2.5 m/s; each range point is imaged \
             with the pose of its own time here",
            slow.0, fast.0
        ),
    );
    // [offset][speed]: litres.
    let litres = |offset: usize, speed: usize| figures[offset * SPEEDS.len() + speed].0;
    let footprint_growth = |offset: usize| litres(offset, 2) / litres(offset, 0);
    outcome.add_finding(
        "The blur may come from small discrepancies in time between poses and sweeps.",
        footprint_growth(2) > 1.05 * footprint_growth(0) && litres(2, 2) > 1.05 * litres(0, 2),
        format!(
            "voxels above half of the peak at 2.5 m/s fill {:.0} l without offset, {:.0} l with 5 ms and {:.0} l \
             with 20 ms between the streams; at 1 m/s {:.0}, {:.0} and {:.0} l. Our range is {} mm off at 2.5 m/s \
             without offset, {} mm with 5 ms and {} mm with 20 ms",
            litres(0, 2),
            litres(1, 2),
            litres(2, 2),
            litres(0, 0),
            litres(1, 0),
            litres(2, 0),
            mm(figures[2].1),
            mm(figures[5].1),
            mm(figures[8].1)
        ),
    );
    outcome.tables.push(Table {
        head: head(&[
            "speed (m/s)",
            "pose offset (ms)",
            "thesis: depth error (cm)",
            "footprint (l)",
            "ours: range error (mm)",
        ]),
        rows,
        caption: "An approach determines the range only: cross-range errors are left out.".into(),
    });
    Ok(outcome)
}
