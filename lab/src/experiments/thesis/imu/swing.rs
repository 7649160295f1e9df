//! Images of the swing with poses from dead reckoning alone.

use crate::inertial::{simulated_imu, true_state};
use glam::DVec3;

use super::super::imaging_methods::{THESIS_VOXEL_M, chosen, volume};
use super::super::{Outcome, cm, head, mm};
use super::dead_reckoning::dead_reckon;
use super::drifts::{Drift, drift_of};
use super::{IMU_PARTS, REST_S, SHARP_M, SWEEPS, SWING_DURATIONS_S, SwingTrial, image_errors, medians, pose_samples};
use radar_chaperone::report::{Marks, Table, cross_sections};
use radar_sar::PoseSample;
use radar_sar::{Selection, Statistic};

/// Medians of [`image_errors()`] for each source of poses and each of [`SWING_DURATIONS_S`].
pub(super) type SwingImages = Vec<(&'static str, Vec<Vec<f64>>)>;

pub(super) fn swing_images(outcome: &mut Outcome, swung: &[SwingTrial]) -> SwingImages {
    let sources = [
        ("the arm's angle", None),
        (IMU_PARTS[0].name, Some(0)),
        (IMU_PARTS[1].name, Some(1)),
        (IMU_PARTS[2].name, Some(2)),
    ];
    let mut figures = Vec::new();
    for (name, part) in sources {
        let mut rows = vec![Vec::new(); SWING_DURATIONS_S.len()];
        for one in swung {
            let until_ns = one.ns(REST_S);
            let poses = match part {
                None => one
                    .simulated
                    .poses
                    .iter()
                    .map(|pose| {
                        PoseSample::valid(pose.time_ns, &true_state(&one.path, pose.time_ns).tracking_from_body)
                    })
                    .collect(),
                Some(part) => {
                    pose_samples(&dead_reckon(&simulated_imu(&one.path, &IMU_PARTS[part]), &one.path, until_ns, true))
                }
            };
            for (n, swung_s) in SWING_DURATIONS_S.into_iter().enumerate() {
                let recorded = one.seen(&poses, REST_S, REST_S + swung_s);
                rows[n].push(image_errors(&recorded).to_vec());
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
        SWING_DURATIONS_S.iter().zip(of_times).map(each).collect()
    };
    outcome.tables.push(Table {
        head: head(&[
            "poses by",
            "first seconds of the swing",
            "thesis: error (cm)",
            "footprint (l)",
            "ours: error (mm)",
        ]),
        rows: figures.iter().flat_map(row).collect(),
        caption: format!(
            "Images from {SWEEPS} sweeps, poses from dead reckoning alone since the rest. Footprint: \
            volume of the voxels of at least half of the greatest value, least squares, voxels of 4 cm."
        ),
    });
    figures
}

pub(super) fn swing_findings(outcome: &mut Outcome, drifts: &[Drift], of_swing: &SwingImages) {
    let figure = |source: usize, time: usize, which: usize| of_swing[source].1[time][which];
    outcome.add_finding(
        "Noise and drift make the IMU impossible to use for imaging.",
        (figure(1, 3, 2) > 0.1)
            .then_some(true)
            .or((figure(1, 0, 2) < SHARP_M && figure(1, 3, 2) < SHARP_M).then_some(false)),
        format!(
            "MPU-6050 alone, the reflector's error: {} mm from the first second of the swing, {} mm from four, {} mm \
             from eight; the arm's own angle gives {} mm",
            mm(figure(1, 0, 2)),
            mm(figure(1, 2, 2)),
            mm(figure(1, 3, 2)),
            mm(figure(0, 3, 2))
        ),
    );
    let after_5_s = IMU_PARTS.map(|part| drift_of(drifts, &format!("{}, swinging, zeroed", part.name))[3]);
    outcome.add_finding(
        "An improved IMU gives accurate positions for longer, and a second of sweeps suffices: it could still be feasible (5.7).",
        after_5_s[1] < 0.5 * after_5_s[0] && figure(2, 0, 2) < SHARP_M,
        format!(
            "after 5 s on the arm {} cm off with an MPU-6050, {} cm with an ICM-42688-P; from one second of sweeps \
             the latter locates the reflector {} mm off",
            cm(after_5_s[0]), cm(after_5_s[1]), mm(figure(2, 0, 2))
        ),
    );
    outcome.add_finding(
        "Accurate tracking by inertia alone takes sophisticated and expensive IMUs (2.6.1).",
        figure(3, 3, 2) < SHARP_M && figure(2, 3, 2) > SHARP_M,
        format!(
            "the reflector's error from four and from eight seconds of swing: MPU-6050 {} and {} mm, ICM-42688-P {} \
             and {} mm, tactical grade {} and {} mm; sufficient would be {} mm from eight",
            mm(figure(1, 2, 2)),
            mm(figure(1, 3, 2)),
            mm(figure(2, 2, 2)),
            mm(figure(2, 3, 2)),
            mm(figure(3, 2, 2)),
            mm(figure(3, 3, 2)),
            mm(SHARP_M)
        ),
    );
}
