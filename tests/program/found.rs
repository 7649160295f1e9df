//! The parts of a replay's obstacles.json that tests need.

use glam::DVec3;
use serde_json::Value;

use crate::common::Folder;

/// One obstacle.
pub struct Found {
    pub position_m: DVec3,
    pub observed: String,
    /// Standard deviations along the axes, metres.
    pub sigma_m: DVec3,
}

/// Replays a recording into the folder `found` and reads the obstacles.
pub fn obstacles_of(folder: &Folder, line: &str) -> Vec<Found> {
    folder.run(&format!("replay {line} --out found")).succeeds();
    let file = folder.json("found/obstacles.json");
    file["obstacles"].as_array().unwrap().iter().map(found).collect()
}

/// The only obstacle.
pub fn only(mut obstacles: Vec<Found>) -> Found {
    assert_eq!(obstacles.len(), 1, "should be one obstacle");
    obstacles.remove(0)
}

/// A stream counter of the folder's last replay.
pub fn counter(folder: &Folder, name: &str) -> u64 {
    folder.json("found/obstacles.json")["counters"]["streams"][name].as_u64().unwrap()
}

fn found(entry: &Value) -> Found {
    let number = |value: &Value| value.as_f64().unwrap();
    let vector = |of: &dyn Fn(usize) -> f64| DVec3::new(of(0), of(1), of(2));
    Found {
        position_m: vector(&|axis| number(&entry["position_m"][axis])),
        observed: entry["observed"].as_str().unwrap().to_owned(),
        sigma_m: vector(&|axis| number(&entry["covariance_m2"][axis][axis]).sqrt()),
    }
}
