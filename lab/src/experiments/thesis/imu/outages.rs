//! Inertia beside a tracker with outages.

use super::super::{Outcome, cm, head, mm};
use super::dead_reckoning::drift_m;
use super::drifts::{Drift, drift_of};
use super::{
    IMU_PARTS, OUTAGE_DURATIONS_S, OUTAGE_START_S, SHARP_M, SHARP_RATIO, SWEEPS, SwingTrial, WINDOW_S, image_errors,
    medians, pose_samples,
};
use crate::experiments::trial_recording::quantile;
use crate::inertial::{FusionSettings, ImuSpec, NavState, PoseFusion};
use crate::inertial::{simulated_imu, true_state};
use radar_chaperone::report::{Chart, Series, Table};
use radar_sar::PoseSample;

/// Fused states of a recording whose optical poses end at the outage.
fn fused_states(swung: &SwingTrial, part: &ImuSpec) -> Vec<NavState> {
    let mut fusion = PoseFusion::new(FusionSettings::of(*part));
    let lost_ns = swung.ns(OUTAGE_START_S);
    let mut poses = swung.simulated.poses.iter().take_while(|pose| pose.time_ns < lost_ns).peekable();
    let mut states = Vec::new();
    for sample in &simulated_imu(&swung.path, part) {
        while let Some(pose) = poses.next_if(|pose| pose.time_ns <= sample.time_ns) {
            // Errors mean refused poses; the simulation has none.
            let _ = fusion.push_pose(pose);
        }
        let _ = fusion.push_imu(sample);
        states.extend(fusion.state().copied());
    }
    states
}

/// Medians of one IMU for each of [`OUTAGE_DURATIONS_S`].
struct OutageResults {
    pose_m: Vec<f64>,
    worst_m: Vec<f64>,
    /// Columns as in [`image_errors()`].
    images: Vec<Vec<f64>>,
}

impl OutageResults {
    fn of(part: &ImuSpec, swung: &[SwingTrial]) -> Self {
        let mut off = vec![Vec::new(); OUTAGE_DURATIONS_S.len()];
        let mut images = vec![Vec::new(); OUTAGE_DURATIONS_S.len()];
        for one in swung {
            let states = fused_states(one, part);
            let truth = |time_ns: i64| true_state(&one.path, time_ns).tracking_from_body.translation;
            let poses = pose_samples(&states);
            for (n, lost_s) in OUTAGE_DURATIONS_S.into_iter().enumerate() {
                off[n].push(drift_m(&states, one.ns(OUTAGE_START_S), lost_s, truth));
                let until_s = OUTAGE_START_S + lost_s;
                images[n].push(image_errors(&one.seen(&poses, until_s - WINDOW_S, until_s)).to_vec());
            }
        }
        let share = |share: f64| off.iter().map(|off| quantile(off, share)).collect();
        Self { pose_m: share(0.5), worst_m: share(1.0), images: images.iter().map(|rows| medians(rows)).collect() }
    }

    /// Longest outage up to which every image is sharp, seconds.
    fn sharp_s(&self) -> f64 {
        let is_sharp = |image: &&Vec<f64>| image[2] <= SHARP_M && image[1] <= SHARP_RATIO * self.images[0][1];
        let sharp = self.images.iter().take_while(is_sharp).count();
        sharp.checked_sub(1).map_or(0.0, |last| OUTAGE_DURATIONS_S[last])
    }
}

pub(super) fn outages(outcome: &mut Outcome, drifts: &[Drift], swung: &[SwingTrial]) {
    let lost: Vec<OutageResults> = IMU_PARTS.iter().map(|part| OutageResults::of(part, swung)).collect();
    let mut rows = Vec::new();
    for (part, lost) in IMU_PARTS.iter().zip(&lost) {
        for (n, lost_s) in OUTAGE_DURATIONS_S.iter().enumerate() {
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
    for (lost_s, image) in OUTAGE_DURATIONS_S.iter().zip(&alone) {
        rows.push(vec![
            "none: tracker alone".into(),
            format!("{lost_s}"),
            "–".into(),
            "–".into(),
            cm(image[0]),
            if image[1].is_finite() { format!("{:.1}", image[1]) } else { "–".into() },
            mm(image[2]),
        ]);
    }
    let sharp = lost.iter().map(OutageResults::sharp_s).collect::<Vec<_>>();
    let ((one_s, five_s), phone) = ((4, 6), &lost[1]);
    outcome.add_finding(
        "Combined with other sensors an IMU improves accuracy and robustness (2.6.1).",
        phone.images[one_s][2] <= SHARP_M && phone.images[one_s][2] < alone[one_s][2],
        format!(
            "tracker outage of 1 s in the {WINDOW_S:.0} s that are imaged: the reflector {} mm off with an \
             ICM-42688-P and {} mm from the remaining sweeps without one; outage of 3 s: {} mm with it and {} mm \
             without; of 5 s: {} mm with it, and without one no sweep has a pose",
            mm(phone.images[one_s][2]),
            mm(alone[one_s][2]),
            mm(phone.images[one_s + 1][2]),
            mm(alone[one_s + 1][2]),
            mm(phone.images[five_s][2])
        ),
    );
    let by_itself_m = drift_of(drifts, "ICM-42688-P, swinging, zeroed")[3];
    outcome.add_finding(
        "More realistic than an IMU by itself is one together with another positioning system (5.7).",
        phone.pose_m[five_s] < 0.5 * by_itself_m,
        format!(
            "5 s without optical poses: {} cm off with an ICM-42688-P zeroed at rest, {} cm with one that was fused \
             with the tracker before; sharp for outages of up to {} s with an MPU-6050, {} s with an ICM-42688-P, {} s \
             with tactical grade, of the durations tried",
            cm(by_itself_m),
            cm(phone.pose_m[five_s]),
            sharp[0],
            sharp[1],
            sharp[2]
        ),
    );
    outcome.tables.push(Table {
        head: head(&[
            "IMU beside the tracker",
            "outage (s)",
            "pose error (mm)",
            "maximum (mm)",
            "thesis: error (cm)",
            "footprint (l)",
            "ours: error (mm)",
        ]),
        rows,
        caption: format!(
            "Pose: at the end of the outage, median and maximum. Images: of the last {WINDOW_S:.0} s before the \
             tracker returns, {SWEEPS} sweeps, medians; – where no sweep has a pose. Sharp: the reflector within {:.0} \
             cm and the footprint at most {SHARP_RATIO} times that without an outage.",
            SHARP_M * 100.0
        ),
    });
    // A logarithmic axis cannot show an outage of 0.
    let series = |name: &str, values: Vec<f64>| Series {
        name: name.into(),
        points: OUTAGE_DURATIONS_S.iter().zip(values).skip(1).map(|(s, v)| [*s, v]).collect(),
        joined: true,
    };
    let chart = |title: &str, y_label: &str, series: Vec<Series>| Chart {
        title: title.into(),
        x_label: "outage of optical poses (s)".into(),
        y_label: y_label.into(),
        x_log: true,
        y_log: true,
        series,
    };
    let each = |of: &dyn Fn(&OutageResults) -> Vec<f64>| {
        IMU_PARTS.iter().zip(&lost).map(|(part, lost)| series(part.name, of(lost))).collect::<Vec<_>>()
    };
    let scaled = |values: &[f64], by: f64| values.iter().map(|v| v * by).collect::<Vec<f64>>();
    let pose = chart(
        "Inertia during a tracker outage: pose error",
        "pose error at the end (mm)",
        each(&|lost| scaled(&lost.pose_m, 1e3)),
    );
    outcome.draw("outage-pose", pose.draw(), "Fused poses at the end of the outage, medians.");
    let column =
        |images: &[Vec<f64>], n: usize, by: f64| images.iter().map(|image| image[n] * by).collect::<Vec<f64>>();
    let mut position_errors = each(&|lost| column(&lost.images, 2, 1e3));
    position_errors.push(series("tracker alone", column(&alone, 2, 1e3)));
    let position_chart = chart(
        "Inertia during a tracker outage: error of the reflector",
        "error of the reflector (mm)",
        position_errors,
    );
    outcome.draw(
        "outage-reflector",
        position_chart.draw(),
        "Position of the reflector from the last four seconds before the \
        tracker returns. The tracker alone has only sweeps from before the outage, and none when the outage lasts \
        longer.",
    );
    let mut sizes = each(&|lost| column(&lost.images, 1, 1.0));
    sizes.push(series("tracker alone", column(&alone, 1, 1.0)));
    let size = Chart {
        y_log: false,
        ..chart("Inertia during a tracker outage: footprint of the image", "footprint (l)", sizes)
    };
    outcome.draw(
        "outage-footprint",
        size.draw(),
        "Volume of the voxels of at least half of the greatest value, \
        least squares, voxels of 4 cm. A drift of centimetres shifts such an image; it hardly blurs it, since the \
        pulse is 14 cm long.",
    );
}

/// Medians of [`image_errors()`] for each of [`OUTAGE_DURATIONS_S`] without an IMU.
fn tracker_alone(swung: &[SwingTrial]) -> Vec<Vec<f64>> {
    let of = |lost_s: &f64| {
        let until_s = OUTAGE_START_S + lost_s;
        let images = swung.iter().map(|one| {
            let (gone_ns, back_ns) = (one.ns(OUTAGE_START_S), one.ns(until_s));
            let is_there = |pose: &&PoseSample| !(gone_ns..back_ns).contains(&pose.time_ns);
            let poses: Vec<PoseSample> = one.simulated.poses.iter().filter(is_there).copied().collect();
            image_errors(&one.seen(&poses, until_s - WINDOW_S, until_s)).to_vec()
        });
        medians(&images.collect::<Vec<_>>())
    };
    OUTAGE_DURATIONS_S.iter().map(of).collect()
}
