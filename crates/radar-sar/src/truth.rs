//! Ground truth of a recording, where it is known (simulated recordings).

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::geometry::{Aabb, Plane};

/// Ground truth of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Room and motion, as named by `simulate`.
    pub title: String,
    /// Seed of all randomness in it.
    pub seed: u64,
    /// Objects in the room.
    pub obstacles: Vec<TruthObstacle>,
    /// Walls, floor, ceiling.
    pub walls: Vec<TruthWall>,
    /// Time of a sweep's pose minus time of the sweep, seconds, as the streams were written.
    pub time_offset_s: f64,
}

/// An object in the room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthObstacle {
    /// "chair", "table", …
    pub name: String,
    /// Its point scatterers, tracking frame, metres.
    pub points_m: Vec<DVec3>,
    /// Radar cross-section of each point, dBsm.
    pub rcs_dbsm: Vec<f64>,
    /// Least distance from the head's origin to any of its points during the recording, metres.
    pub closest_approach_m: f64,
    /// Time for which any of its points was in the beam within 2.3 m, seconds.
    pub in_beam_s: f64,
}

/// A smooth wall: only its specular point is visible.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthWall {
    /// "floor", "wall north", …
    pub name: String,
    /// The wall's plane.
    pub plane: Plane,
    /// Its extent, a flat box.
    pub extent: Aabb,
}
