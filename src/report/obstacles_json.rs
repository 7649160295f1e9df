//! `obstacles.json`: the scene as a file for people and programs. The same scene and counters give
//! the same bytes: the order of keys is fixed, numbers are the shortest that parse to the same f64,
//! and each obstacle is on its own line.

use std::io;
use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Serialize;
use serde_json::Value;
use serde_json::ser::Formatter;

use radar_mapping::{CalibrationInUse, MountInUse, MovingTarget, Observed, Obstacle, Scene, Wall};

use super::{ReportError, write_atomically};

#[derive(Serialize)]
struct File<'a> {
    frame: &'static str,
    obstacles: Vec<ObstacleEntry>,
    walls: Vec<WallEntry>,
    moving: Vec<MovingEntry>,
    counters: &'a Value,
    time_offset_s: f64,
    time_offset_sigma_s: Option<f64>,
    time_offset_observable: bool,
    mount: MountEntry,
    /// Slow tracking error in each axis as estimated, rms.
    drift_m: Option<f64>,
    /// Measured minus true range of each subsweep that hears echoes, by which the ranges are corrected.
    range_bias_m: Option<Vec<f64>>,
}

/// The sensor on the head: position assumed, in use, and as estimated with its 1σ, axis by axis.
#[derive(Serialize)]
struct MountEntry {
    assumed_m: [f64; 3],
    in_use_m: [f64; 3],
    estimate_m: Option<[f64; 3]>,
    estimate_sigma_m: Option<[f64; 3]>,
    observed: [bool; 3],
    /// As estimated, in the head's frame; absent while not even its side is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    boresight: Option<[f64; 3]>,
    /// 1σ of a turn of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    boresight_sigma_rad: Option<f64>,
}

#[derive(Serialize)]
struct ObstacleEntry {
    position_m: [f64; 3],
    covariance_m2: [[f64; 3]; 3],
    extent_m: [f64; 3],
    evidence: f64,
    observed: Observed,
    provisional: bool,
    first_seen_s: f64,
    last_seen_s: f64,
}

#[derive(Serialize)]
struct WallEntry {
    outward: [f64; 3],
    offset_m: f64,
    evidence: f64,
    seen_at_min_m: [f64; 3],
    seen_at_max_m: [f64; 3],
    provisional: bool,
    first_seen_s: f64,
    last_seen_s: f64,
}

/// A moving target: at a range from the sensor position of its last observation, along that
/// boresight. The direction is as uncertain as the beam is wide.
#[derive(Serialize)]
struct MovingEntry {
    id: u64,
    position_m: [f64; 3],
    covariance_m2: [[f64; 3]; 3],
    seen_from_m: [f64; 3],
    range_m: f64,
    range_sigma_m: f64,
    direction_sigma_rad: f64,
    speed_m_per_s: f64,
    evidence: f64,
    first_seen_s: f64,
    last_seen_s: f64,
}

/// The bytes of the file. Times are seconds of the host clock.
///
/// # Errors
/// A number of the scene, or the time offset, is not finite.
pub fn obstacles_json(scene: &Scene, counters: &Value, calibration: &CalibrationInUse) -> Result<Vec<u8>, ReportError> {
    let entries = scene.obstacles.iter().enumerate().map(|(n, obstacle)| obstacle_entry(n, obstacle));
    let walls = scene.walls.iter().enumerate().map(|(n, wall)| wall_entry(n, wall));
    let moving = scene.moving.iter().enumerate().map(|(n, moving)| moving_entry(n, moving));
    let number = |of: f64, name: &str| finite(of, || name.into());
    let offset = &calibration.time_offset_estimate;
    let biases_m = calibration.range_bias_m.as_deref();
    let range_bias_m = biases_m.map(|biases_m| biases_m.iter().map(|bias_m| number(*bias_m, "range_bias_m")).collect());
    let file = File {
        frame: "tracking",
        obstacles: entries.collect::<Result<_, _>>()?,
        walls: walls.collect::<Result<_, _>>()?,
        moving: moving.collect::<Result<_, _>>()?,
        counters,
        time_offset_s: number(calibration.time_offset_s, "time_offset_s")?,
        time_offset_sigma_s: offset.map(|offset| number(offset.sigma_s, "time_offset_sigma_s")).transpose()?,
        time_offset_observable: offset.is_some_and(|offset| offset.observable),
        mount: mount_entry(&calibration.mount)?,
        drift_m: calibration.drift_m.map(|drift_m| number(drift_m, "drift_m")).transpose()?,
        range_bias_m: range_bias_m.transpose()?,
    };
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, EntryPerLineFormatter::default());
    file.serialize(&mut serializer).map_err(|source| ReportError::Json { path: "obstacles.json".into(), source })?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// Writes the file atomically.
///
/// # Errors
/// As [`obstacles_json`], or the file cannot be written.
pub fn write_obstacles_json(
    path: &Path,
    scene: &Scene,
    counters: &Value,
    calibration: &CalibrationInUse,
) -> Result<(), ReportError> {
    write_atomically(path, &obstacles_json(scene, counters, calibration)?)
}

fn mount_entry(mount: &MountInUse) -> Result<MountEntry, ReportError> {
    let finite = |of: DVec3| vector(of, || "mount".into());
    let estimate = mount.estimate.map(|estimate| (estimate.position_m, estimate.sigma_m()));
    let boresight = mount.estimate.and_then(|estimate| estimate.boresight);
    Ok(MountEntry {
        assumed_m: finite(mount.assumed.translation)?,
        in_use_m: finite(mount.in_use.translation)?,
        estimate_m: estimate.map(|(position_m, _)| finite(position_m)).transpose()?,
        estimate_sigma_m: estimate.map(|(_, sigma_m)| finite(sigma_m)).transpose()?,
        observed: mount.estimate.map_or([false; 3], |estimate| estimate.observed),
        boresight: boresight.map(|boresight| finite(boresight.direction)).transpose()?,
        boresight_sigma_rad: boresight.map(|boresight| boresight.sigma_rad),
    })
}

fn obstacle_entry(n: usize, obstacle: &Obstacle) -> Result<ObstacleEntry, ReportError> {
    let named = |field: &'static str| move || format!("obstacles[{n}].{field}");
    Ok(ObstacleEntry {
        position_m: vector(obstacle.position_m, named("position_m"))?,
        covariance_m2: matrix(obstacle.covariance_m2, named("covariance_m2"))?,
        extent_m: vector(obstacle.extent_m, named("extent_m"))?,
        evidence: finite(obstacle.evidence, named("evidence"))?,
        observed: obstacle.observed,
        provisional: obstacle.provisional,
        first_seen_s: seconds(obstacle.first_seen_ns),
        last_seen_s: seconds(obstacle.last_seen_ns),
    })
}

fn wall_entry(n: usize, wall: &Wall) -> Result<WallEntry, ReportError> {
    let named = |field: &'static str| move || format!("walls[{n}].{field}");
    Ok(WallEntry {
        outward: vector(wall.plane.outward, named("outward"))?,
        offset_m: finite(wall.plane.offset_m, named("offset_m"))?,
        evidence: finite(wall.evidence, named("evidence"))?,
        seen_at_min_m: vector(wall.seen_at.min, named("seen_at_min_m"))?,
        seen_at_max_m: vector(wall.seen_at.max, named("seen_at_max_m"))?,
        provisional: wall.provisional,
        first_seen_s: seconds(wall.first_seen_ns),
        last_seen_s: seconds(wall.last_seen_ns),
    })
}

fn moving_entry(n: usize, moving: &MovingTarget) -> Result<MovingEntry, ReportError> {
    let named = |field: &'static str| move || format!("moving[{n}].{field}");
    Ok(MovingEntry {
        id: moving.id,
        position_m: vector(moving.position_m(), named("position_m"))?,
        covariance_m2: matrix(moving.covariance_m2(), named("covariance_m2"))?,
        seen_from_m: vector(moving.seen_from.translation, named("seen_from_m"))?,
        range_m: finite(moving.range_m, named("range_m"))?,
        range_sigma_m: finite(moving.range_sigma_m, named("range_sigma_m"))?,
        direction_sigma_rad: finite(moving.direction_sigma_rad, named("direction_sigma_rad"))?,
        speed_m_per_s: finite(moving.speed_m_per_s, named("speed_m_per_s"))?,
        evidence: finite(moving.evidence, named("evidence"))?,
        first_seen_s: seconds(moving.first_seen_ns),
        last_seen_s: seconds(moving.last_seen_ns),
    })
}

/// Divides instead of multiplying by 1e-9, which is not exact in f64: 1.5 s stays 1.5.
fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

fn finite(value: f64, what: impl FnOnce() -> String) -> Result<f64, ReportError> {
    if value.is_finite() { Ok(value) } else { Err(ReportError::NotFinite { what: what(), value }) }
}

fn vector(v: DVec3, what: impl FnOnce() -> String) -> Result<[f64; 3], ReportError> {
    match v.to_array().into_iter().find(|value| !value.is_finite()) {
        Some(value) => Err(ReportError::NotFinite { what: what(), value }),
        None => Ok(v.to_array()),
    }
}

/// Rows of a matrix.
fn matrix(m: DMat3, what: impl Fn() -> String + Copy) -> Result<[[f64; 3]; 3], ReportError> {
    Ok([vector(m.row(0), what)?, vector(m.row(1), what)?, vector(m.row(2), what)?])
}

/// JSON with one line per entry of the file, and per entry of those entries. Deeper levels are not
/// broken into lines.
#[derive(Default)]
struct EntryPerLineFormatter {
    depth: usize,
}

impl EntryPerLineFormatter {
    /// Deepest level whose elements get lines of their own. Choice: one line an obstacle.
    const MAX_BROKEN_DEPTH: usize = 2;

    fn open<W: ?Sized + io::Write>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth += 1;
        writer.write_all(bracket)
    }

    fn separate<W: ?Sized + io::Write>(&self, writer: &mut W, first: bool) -> io::Result<()> {
        writer.write_all(if first { b"" } else { b"," })?;
        if self.depth <= Self::MAX_BROKEN_DEPTH { writer.write_all(b"\n") } else { Ok(()) }
    }

    fn close<W: ?Sized + io::Write>(&mut self, writer: &mut W, bracket: &[u8]) -> io::Result<()> {
        writer.write_all(if self.depth <= Self::MAX_BROKEN_DEPTH { b"\n" } else { b"" })?;
        self.depth -= 1;
        writer.write_all(bracket)
    }
}

impl Formatter for EntryPerLineFormatter {
    fn begin_array<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, b"[")
    }

    fn end_array<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"]")
    }

    fn begin_array_value<W: ?Sized + io::Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.separate(writer, first)
    }

    fn begin_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.open(writer, b"{")
    }

    fn end_object<W: ?Sized + io::Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.close(writer, b"}")
    }

    fn begin_object_key<W: ?Sized + io::Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.separate(writer, first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use radar_sar::TimeOffset;
    use radar_sar::geometry::{Aabb, Plane, Pose};
    use serde_json::json;

    fn scene(x: f64) -> Scene {
        let obstacle = Obstacle {
            id: 3,
            position_m: DVec3::new(x, 0.1 + 0.2, -1e-17),
            covariance_m2: DMat3::from_cols(
                DVec3::new(1.0, 2.0, 3.0),
                DVec3::new(4.0, 5.0, 6.0),
                DVec3::new(7.0, 8.0, 9.0),
            ),
            observed: Observed::RangeAndOneDirection,
            extent_m: DVec3::new(0.3, 0.4, 0.5),
            evidence: 41.25,
            shape: vec![(DVec3::ZERO, 1.0)],
            provisional: false,
            first_seen_ns: 1_500_000_000,
            last_seen_ns: 2_300_000_000,
        };
        let wall = Wall {
            id: 4,
            plane: Plane { outward: DVec3::NEG_Z, offset_m: 2.5 },
            evidence: 9.0,
            seen_at: Aabb { min: DVec3::ZERO, max: DVec3::ONE },
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 1,
        };
        let moving = MovingTarget {
            id: 2,
            seen_from: Pose::from_translation(DVec3::Y),
            range_m: 2.0,
            range_sigma_m: 0.125,
            direction_sigma_rad: 0.25,
            speed_m_per_s: -0.75,
            evidence: 33.0,
            first_seen_ns: 0,
            last_seen_ns: 250_000_000,
        };
        Scene { time_ns: 0, obstacles: vec![obstacle.clone(), obstacle], walls: vec![wall], moving: vec![moving] }
    }

    fn nothing_estimated() -> CalibrationInUse {
        CalibrationInUse::as_set(0.0, Pose::IDENTITY)
    }

    #[test]
    fn keys_order_and_values_match_the_format() {
        let offset = TimeOffset { offset_s: 0.26, sigma_s: 0.5, observable: true, tracks: 3, tracks_left_out: 0 };
        let known = CalibrationInUse {
            time_offset_estimate: Some(offset),
            drift_m: Some(0.002),
            range_bias_m: Some(vec![0.004, -0.001]),
            ..CalibrationInUse::as_set(0.25, Pose::IDENTITY)
        };
        let text = String::from_utf8(obstacles_json(&scene(1.0), &json!({"sweeps": 7}), &known).unwrap()).unwrap();
        let entry = "{\"position_m\":[1.0,0.30000000000000004,-1e-17],\
             \"covariance_m2\":[[1.0,4.0,7.0],[2.0,5.0,8.0],[3.0,6.0,9.0]],\"extent_m\":[0.3,0.4,0.5],\
             \"evidence\":41.25,\"observed\":\"range_and_one_direction\",\"provisional\":false,\"first_seen_s\":1.5,\"last_seen_s\":2.3}";
        let wall = "{\"outward\":[-0.0,-0.0,-1.0],\"offset_m\":2.5,\"evidence\":9.0,\"seen_at_min_m\":[0.0,0.0,0.0],\
             \"seen_at_max_m\":[1.0,1.0,1.0],\"provisional\":false,\"first_seen_s\":0.0,\"last_seen_s\":1e-9}";
        let wall = wall.replace("[-0.0,-0.0,-1.0]", &serde_json::to_string(&DVec3::NEG_Z.to_array()).unwrap());
        let moving = "{\"id\":2,\"position_m\":[0.0,1.0,-2.0],\"covariance_m2\":[[0.25,0.0,0.0],[0.0,0.25,0.0],[0.0,0.0,0.015625]],\
             \"seen_from_m\":[0.0,1.0,0.0],\"range_m\":2.0,\"range_sigma_m\":0.125,\"direction_sigma_rad\":0.25,\
             \"speed_m_per_s\":-0.75,\"evidence\":33.0,\"first_seen_s\":0.0,\"last_seen_s\":0.25}";
        let mount = "\"assumed_m\":[0.0,0.0,0.0],\n\"in_use_m\":[0.0,0.0,0.0],\n\"estimate_m\":null,\n\"estimate_sigma_m\":null,\n\
             \"observed\":[false,false,false]";
        let expected = format!(
            "{{\n\"frame\":\"tracking\",\n\"obstacles\":[\n{entry},\n{entry}\n],\n\"walls\":[\n{wall}\n],\n\"moving\":[\n{moving}\n],\n\
             \"counters\":{{\n\"sweeps\":7\n}},\n\"time_offset_s\":0.25,\n\"time_offset_sigma_s\":0.5,\n\
             \"time_offset_observable\":true,\n\"mount\":{{\n{mount}\n}},\n\"drift_m\":0.002,\n\"range_bias_m\":[\n0.004,\n-0.001\n]\n}}\n"
        );
        assert_eq!(text, expected);
    }

    #[test]
    fn empty_scene_is_valid_json() {
        let bytes = obstacles_json(&Scene::default(), &json!({}), &nothing_estimated()).unwrap();
        let value: Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(
            value,
            json!({
                "frame": "tracking",
                "obstacles": [],
                "walls": [],
                "moving": [],
                "counters": {},
                "time_offset_s": 0.0,
                "time_offset_sigma_s": null,
                "time_offset_observable": false,
                "mount": {
                    "assumed_m": [0.0, 0.0, 0.0],
                    "in_use_m": [0.0, 0.0, 0.0],
                    "estimate_m": null,
                    "estimate_sigma_m": null,
                    "observed": [false, false, false]
                },
                "drift_m": null,
                "range_bias_m": null
            })
        );
    }

    #[test]
    fn non_finite_numbers_are_rejected_by_name() {
        let mut bad = scene(0.0);
        bad.obstacles[1].covariance_m2.z_axis.x = f64::NAN;
        let refused = obstacles_json(&bad, &Value::Null, &nothing_estimated()).unwrap_err().to_string();
        assert_eq!(refused, "obstacles[1].covariance_m2 is NaN, which is not a finite number");
        let endless = CalibrationInUse::as_set(f64::INFINITY, Pose::IDENTITY);
        let refused = obstacles_json(&scene(0.0), &Value::Null, &endless).unwrap_err().to_string();
        assert!(refused.starts_with("time_offset_s is inf"), "{refused}");
    }

    proptest! {
        #[test]
        fn numbers_roundtrip_exactly(x in any::<f64>().prop_filter("finite", |x| x.is_finite())) {
            let written = || obstacles_json(&scene(x), &json!({"b": 1, "a": [1.5]}), &nothing_estimated()).unwrap();
            let bytes = written();
            prop_assert_eq!(&bytes, &written());
            let text = String::from_utf8(bytes).unwrap();
            let number = text.split_once("\"position_m\":[").unwrap().1.split_once(',').unwrap().0;
            prop_assert_eq!(number.parse::<f64>().unwrap().to_bits(), x.to_bits());
        }
    }
}
