//! Numbers of a snapshot, for plots. Rates are relative to the snapshot before.

use glam::DVec3;

use super::snapshot::{ResultsCounters, Snapshot};

/// Types generated from proto/results.proto.
pub mod wire {
    #![allow(clippy::all, missing_docs)]
    include!(concat!(env!("OUT_DIR"), "/radar_chaperone.results.rs"));
}

/// Compiled descriptors of proto/results.proto.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/results.descriptors"));
/// The schema of figures.
pub const SCHEMA: &str = "radar_chaperone.results.Figures";

/// The numbers of a snapshot; `before` has the time (host ns) and the counters of the one before.
pub fn figures(snapshot: &Snapshot, before: Option<&(i64, ResultsCounters)>) -> wire::Figures {
    let head = snapshot.head.map(|head| head.translation);
    let least = |distances_m: &mut dyn Iterator<Item = f64>| {
        // If one operand of f64::min is NaN, the result is the other one.
        distances_m.fold(f64::NAN, f64::min)
    };
    let of_obstacles = |head: DVec3| least(&mut snapshot.scene.obstacles.iter().map(|o| o.distance_m(head)));
    let of_walls = |head: DVec3| least(&mut snapshot.scene.walls.iter().map(|w| w.plane.distance(head).abs()));
    let nearest_obstacle_m = head.map_or(f64::NAN, of_obstacles);
    let nearest_wall_m = head.map_or(f64::NAN, of_walls);
    let now = &snapshot.counted;
    let passed_s = before.map_or(0.0, |(then_ns, _)| snapshot.time_ns.saturating_sub(*then_ns) as f64 * 1e-9);
    let rate = |count: fn(&ResultsCounters) -> u64| match before {
        Some((_, then)) if passed_s > 0.0 => count(now).saturating_sub(count(then)) as f64 / passed_s,
        _ => f64::NAN,
    };
    let calibration = snapshot.calibration;
    let (offset, mount) = (calibration.observed_time_offset(), &calibration.mount);
    let in_thousandths = |of: Option<f64>| of.map_or(f64::NAN, |of| of * 1e3);
    wire::Figures {
        nearest_m: nearest_obstacle_m.min(nearest_wall_m),
        nearest_obstacle_m,
        nearest_wall_m,
        obstacles: snapshot.scene.obstacles.len() as f64,
        walls: snapshot.scene.walls.len() as f64,
        strongest_evidence: snapshot.scene.obstacles.iter().map(|o| o.evidence).fold(f64::NAN, f64::max),
        frames_per_s: rate(|c| c.frames),
        sweeps_per_s: rate(|c| c.sweeps),
        poses_per_s: rate(|c| c.poses),
        evidence_age_ms: snapshot
            .evidence_ns
            .map_or(f64::NAN, |then| snapshot.time_ns.saturating_sub(then) as f64 * 1e-6),
        time_offset_ms: calibration.time_offset_s * 1e3,
        time_offset_estimate_ms: in_thousandths(offset.map(|offset| offset.offset_s)),
        time_offset_sigma_ms: in_thousandths(offset.map(|offset| offset.sigma_s)),
        frames: now.frames as f64,
        sweeps: now.sweeps as f64,
        poses: now.poses as f64,
        frames_left_out: now.frames_left_out as f64,
        sweeps_left_out: now.sweeps_left_out as f64,
        poses_left_out: now.poses_left_out as f64,
        looks: now.updates as f64,
        obstacles_forgotten: now.removed as f64,
        mount_correction_mm: mount.correction_m() * 1e3,
        mount_sigma_mm: in_thousandths(mount.estimate.map(|found| found.sigma_m().max_element())),
        drift_mm: in_thousandths(calibration.drift_m),
        range_bias_mm: in_thousandths(calibration.greatest_range_bias_m()),
    }
}
