//! Thesis experiment "outputs": volumes and point clouds for other tools, written, read back by
//! independent readers, and compared.

use radar_mapping::in_time_order;
use std::path::Path;

use glam::DVec3;

use super::imaging_methods::volume;
use super::{ExperimentError, Outcome, SNR_DB, Trials, head};
use crate::experiments::trial_recording::TrialRecording;
use a121::preset;
use radar_chaperone::report::{
    CloudPoint, Marks, Table, cloud_bytes, cloud_of, ply_bytes, point_cloud, points_above, volume_of,
};
use radar_mapping::Mapper;
use radar_mapping::MappingSettings;
use radar_mapping::{Obstacle, ReflectorSettings, find_reflectors};
use radar_sar::Beam;
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::SubapertureSettings;
use radar_sar::{PositionErrors, Selection, Statistic, Volume, subaperture_volume};
use radar_simulation::{Scenario, scene};

/// Duration of the recording of two chairs, seconds, preset d16. Choice: one sweep of a head around
/// both.
const CHAIRS_S: f64 = 6.0;
/// Box around both chairs, tracking frame, metres; and the voxel edge. Choice: both chairs with a
/// margin; the parts of a chair are several voxels apart.
const CHAIRS: Aabb = Aabb { min: DVec3::new(-1.2, 0.0, -2.2), max: DVec3::new(1.2, 1.4, -0.6) };
const VOXEL_M: f64 = 0.04;
/// Threshold of the plain image's voxels as a share of the greatest score. Choice: both chairs are
/// there, and little noise.
const SHARE: f64 = 0.4;
/// Maximum distance from a chair's scatterer of a point that belongs to it, metres. Choice: three
/// voxels, or nearly the pulse's width.
const NEAR_SCATTERER_M: f64 = 0.12;
/// Number of sweeps of the reflector's image. Choice: the error is near its least from here on.
const SWEEPS: usize = 200;
/// Tolerance of a position read back, metres: single precision holds it to 0.1 µm. Choice: single
/// precision holds 0.1 µm at 1 m.
const ROUND_TRIP_TOLERANCE_M: f64 = 1e-6;

/// A row of the table, and the greatest differences after reading back.
struct RoundTrip {
    row: Vec<String>,
    value: f64,
    position_difference_m: f64,
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "Two chairs observed for {CHAIRS_S:.0} s from within a sphere of 50 cm with preset d16: the detected \
             obstacles with their shapes, and the coherence score of every voxel. And the thesis' corner reflector \
             with preset fine at {SNR_DB:.0} dB, by least squares and as a position with covariance; one seed. Volumes \
             are written as NumPy arrays with a .json beside them (origin, edge of a voxel, frame, axes, units), \
             clouds as .ply with a score and, where there is one, a covariance; then both are read back and compared \
             with what was written."
        ),
        ..Outcome::default()
    };
    let mut compared = Vec::new();
    chairs(&mut outcome, &mut compared)?;
    trials.report_progress(1, 2);
    reflector(&mut outcome, &mut compared)?;
    let lost = |f: fn(&RoundTrip) -> f64| compared.iter().map(f).fold(0.0, f64::max);
    let (value, position_difference_m) = (lost(|one| one.value), lost(|one| one.position_difference_m));
    let intact = format!(
        "files read back equal what was written: values differ by at most {value}, positions by {:.2} µm",
        position_difference_m * 1e6
    );
    let is_intact = value == 0.0 && position_difference_m < ROUND_TRIP_TOLERANCE_M;
    outcome.add_finding(
        "The clouds could be data for machine learning (5.8.2, 6.3).",
        if is_intact { None } else { Some(false) },
        format!("{intact}; nothing was trained with them here"),
    );
    outcome.add_finding(
        "The system could be the basis of simultaneous localisation and mapping (6.3).",
        if is_intact { None } else { Some(false) },
        "positions are written with covariances, which such programs use as weights; none was run here".into(),
    );
    outcome.tables.push(Table {
        head: head(&["file", "bytes", "holds", "values differ by", "positions differ by (µm)"]),
        rows: compared.into_iter().map(|one| one.row).collect(),
        caption: "Each file read back and compared; the covariance's elements count as values, as a share of the \
            greatest. Positions of a cloud are in single precision."
            .into(),
    });
    Ok(outcome)
}

/// Two chairs: the coherence score as a volume, and the detected objects as clouds.
fn chairs(outcome: &mut Outcome, compared: &mut Vec<RoundTrip>) -> Result<(), ExperimentError> {
    const NAME: &str = "two-chairs";
    let config = preset("d16").ok_or(ExperimentError::Preset("d16"))?;
    let scenario = Scenario::new(NAME, "sphere-50cm", config, CHAIRS_S, 1);
    let recorded = TrialRecording::of(&scenario)?;
    let found = detected_obstacles(&scenario)?;
    let image =
        subaperture_volume(&recorded.observations, &Beam::Lensless, &SubapertureSettings::default(), &CHAIRS, VOXEL_M);
    let objects = scene(NAME, 1).map_err(radar_simulation::ScenarioError::from)?.room.things;
    let truth: Vec<Vec<DVec3>> =
        objects.iter().map(|object| object.scatterers.iter().map(|s| s.position_m).collect()).collect();
    outcome.keep_volume("chairs", &image, Statistic::Subaperture, recorded.observations.len())?;
    compared.push(reread_volume(outcome, &image)?);
    let cloud: Vec<(DVec3, f32)> = found.iter().flat_map(|obstacle| obstacle.shape.iter().copied()).collect();
    keep_cloud(outcome, compared, "chairs.ply", &without_covariance(&cloud), ply_bytes(&cloud))?;
    let cloud_points: Vec<CloudPoint> = found.iter().map(cloud_point).collect();
    keep_cloud(outcome, compared, "chairs-places.ply", &cloud_points, cloud_bytes(&cloud_points))?;
    let near =
        |position: DVec3, points: &[DVec3]| points.iter().any(|point| point.distance(position) < NEAR_SCATTERER_M);
    let on_each: Vec<usize> =
        truth.iter().map(|points| cloud.iter().filter(|(position, _)| near(*position, points)).count()).collect();
    let share_near = |cloud: &[(DVec3, f32)]| {
        let on_any = cloud.iter().filter(|(position, _)| truth.iter().any(|points| near(*position, points))).count();
        on_any as f64 / cloud.len().max(1) as f64
    };
    let (share, plain) = (share_near(&cloud), share_near(&points_above(&image, SHARE)));
    outcome.add_finding(
        "The system creates point clouds of objects in three dimensions (5.8.2).",
        share >= 0.8 && on_each.iter().all(|count| *count > 0),
        format!(
            "two chairs: {} points, {:.0} % of them within {:.0} cm of a true scatterer; {} of one chair, {} of the \
             other; of the plain image's voxels above {:.0} % of the greatest score {:.0} %",
            cloud.len(),
            100.0 * share,
            100.0 * NEAR_SCATTERER_M,
            on_each.first().unwrap_or(&0),
            on_each.get(1).unwrap_or(&0),
            100.0 * SHARE,
            100.0 * plain
        ),
    );
    let all: Vec<DVec3> = truth.concat();
    let path: Vec<DVec3> = recorded.observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
    let marks = Marks { truth_m: &all, found_m: &[], path_m: &path };
    let picture =
        point_cloud(&rasterised(&cloud, &image), "Two chairs as a point cloud", "coherence score", 0.0, &marks);
    outcome.draw("chairs", picture, "The points of chairs.ply; crosses are the chairs' true scatterers.");
    Ok(())
}

/// Obstacles that the program reports after a recording.
fn detected_obstacles(scenario: &Scenario) -> Result<Vec<Obstacle>, ExperimentError> {
    let simulated = scenario.run()?;
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default());
    mapper.push_all(in_time_order(simulated.frames, simulated.poses));
    Ok(mapper.scene().obstacles)
}

/// Points as voxels of an image's grid, to be drawn.
fn rasterised(cloud: &[(DVec3, f32)], image: &Volume) -> Volume {
    let mut volume = Volume { values: vec![0.0; image.values.len()], ..image.clone() };
    for &(position, score) in cloud {
        let at = ((position - image.origin_m) / image.voxel_m).floor();
        if image.region().contains(position) {
            let voxel = [0, 1, 2].map(|axis| (at[axis] as usize).min(image.size[axis] - 1));
            let index = volume.index(voxel);
            volume.values[index] = volume.values[index].max(score);
        }
    }
    volume
}

fn cloud_point(obstacle: &Obstacle) -> CloudPoint {
    CloudPoint {
        position_m: obstacle.position_m,
        value: obstacle.evidence as f32,
        covariance_m2: Some(obstacle.covariance_m2),
    }
}

/// The reflector: least squares as a volume, and its position with covariance as a cloud.
fn reflector(outcome: &mut Outcome, compared: &mut Vec<RoundTrip>) -> Result<(), ExperimentError> {
    let config = preset("fine").ok_or(ExperimentError::Preset("fine"))?;
    let scenario =
        Scenario { snr_db: Some(SNR_DB), ..Scenario::new("corner-reflector", "sphere-50cm", config, 10.0, 1) };
    let recorded = TrialRecording::of(&scenario)?;
    let sweeps = super::imaging_methods::chosen(&recorded, SWEEPS, Selection::FarthestPoint);
    let image = volume(&sweeps, Statistic::Ls, VOXEL_M, 1);
    outcome.keep_volume("reflector", &image, Statistic::Ls, sweeps.len())?;
    compared.push(reread_volume(outcome, &image)?);
    let region = image.region();
    let settings = ReflectorSettings { voxel_m: 0.1, ..ReflectorSettings::default() };
    let found = find_reflectors(&sweeps, &Beam::Lensless, &region, &settings, &PositionErrors::default());
    let cloud_points: Vec<CloudPoint> = found.iter().map(cloud_point).collect();
    keep_cloud(outcome, compared, "reflector.ply", &cloud_points, cloud_bytes(&cloud_points))
}

fn without_covariance(cloud: &[(DVec3, f32)]) -> Vec<CloudPoint> {
    cloud.iter().map(|&(position_m, value)| CloudPoint { position_m, value, covariance_m2: None }).collect()
}

/// Reads the last kept volume back.
fn reread_volume(outcome: &Outcome, image: &Volume) -> Result<RoundTrip, ExperimentError> {
    let [.., npy, json] = &outcome.files[..] else { unreachable!("a volume was kept") };
    let (read, info) = volume_of(&npy.bytes, &json.bytes, Path::new(&npy.name))?;
    let pairs = image.values.iter().zip(&read.values);
    let value = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    let corners = [[0; 3], image.size.map(|n| n - 1)];
    let position_difference_m =
        corners.map(|voxel| image.center(voxel).distance(read.center(voxel))).into_iter().fold(0.0, f64::max);
    let value = if read.size == image.size { value } else { f64::INFINITY };
    let [x, y, z] = read.size;
    let holds = format!("{z} × {y} × {x} voxels [z][y][x], {}", info.statistic);
    Ok(row(&npy.name, npy.bytes.len() + json.bytes.len(), holds, value, position_difference_m))
}

/// Keeps a cloud and reads it back.
fn keep_cloud(
    outcome: &mut Outcome,
    compared: &mut Vec<RoundTrip>,
    name: &str,
    points: &[CloudPoint],
    bytes: Vec<u8>,
) -> Result<(), ExperimentError> {
    let read = cloud_of(&bytes, Path::new(name))?;
    let (mut value, mut position_difference_m, mut covariances) = (0.0f64, 0.0f64, 0);
    for (a, b) in points.iter().zip(&read) {
        position_difference_m = position_difference_m.max(a.position_m.distance(b.position_m));
        value = value.max(f64::from((a.value - b.value).abs()));
        match (a.covariance_m2, b.covariance_m2) {
            (Some(a), Some(b)) => {
                let [a, b] = [a, b].map(|m| m.to_cols_array());
                let greatest = a.iter().fold(f64::MIN_POSITIVE, |most, element| most.max(element.abs()));
                // Within single precision.
                let off = a.iter().zip(b).map(|(a, b)| (a - b).abs() / greatest).fold(0.0, f64::max);
                value = value.max(if off < f64::from(f32::EPSILON) { 0.0 } else { off });
                covariances += 1;
            }
            (None, None) => {}
            _ => value = f64::INFINITY,
        }
    }
    if points.len() != read.len() {
        value = f64::INFINITY;
    }
    let holds = match covariances {
        0 => format!("{} points with a score", read.len()),
        _ => format!("{} points with evidence and covariance", read.len()),
    };
    compared.push(row(name, bytes.len(), holds, value, position_difference_m));
    outcome.keep(name, bytes);
    Ok(())
}

fn row(name: &str, bytes: usize, holds: String, value: f64, position_difference_m: f64) -> RoundTrip {
    let differ = if value == 0.0 { "0".into() } else { format!("{value:.0e}") };
    let row = vec![name.to_owned(), bytes.to_string(), holds, differ, format!("{:.3}", position_difference_m * 1e6)];
    RoundTrip { row, value, position_difference_m }
}
