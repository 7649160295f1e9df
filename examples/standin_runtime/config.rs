//! The configuration, `standin.json`. Everything has a default; a name that is none of these is refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use radar_sar::geometry::Pose;
use serde::Deserialize;

use crate::commands::TimedCommand;

/// A place and a turn about the vertical.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YawPose {
    #[serde(default)]
    position_m: [f64; 3],
    #[serde(default)]
    yaw_deg: f64,
}

impl YawPose {
    fn new(position_m: [f64; 3], yaw_deg: f64) -> Self {
        Self { position_m, yaw_deg }
    }

    /// As a pose.
    pub fn pose(self) -> Pose {
        Pose::new(DVec3::from_array(self.position_m), DQuat::from_rotation_y(self.yaw_deg.to_radians()))
    }
}

/// Which way a projection overlay's matrix is read.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProjectionMatrix {
    /// It takes coordinates of the tracking space and gives those of the eye.
    EyeFromTracking,
    /// It takes coordinates of the eye and gives those of the tracking space.
    TrackingFromEye,
}

/// Half angles of an eye's picture, as tangents, all positive.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tangents {
    pub outer: f64,
    pub inner: f64,
    pub up: f64,
    pub down: f64,
}

/// The headset's display.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Display {
    pub frequency_hz: f64,
    pub vsync_to_photons_s: f64,
    pub ipd_m: f64,
    /// Asymmetric in both directions, so that a swapped sign shows.
    pub tangents: Tangents,
    /// Recommended size of an eye's picture.
    pub render_target: [u32; 2],
    /// Size of an eye's picture in a shot.
    pub shot_size: [u32; 2],
    /// Colour behind everything, linear.
    pub background: [f32; 3],
    /// Lines 1 m apart on the floor of the room, in shots.
    pub floor_grid: bool,
}

impl Default for Display {
    fn default() -> Self {
        Self {
            frequency_hz: 90.0,
            vsync_to_photons_s: 0.011,
            ipd_m: 0.063,
            tangents: Tangents { outer: 1.39, inner: 1.24, up: 1.40, down: 1.47 },
            render_target: [1852, 2056],
            shot_size: [960, 1080],
            background: [0.003, 0.004, 0.006],
            floor_grid: false,
        }
    }
}

/// The user's play area and its colour.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Chaperone {
    /// Extent along x and z; none: not set up.
    pub size_m: Option<[f32; 2]>,
    /// A `ChaperoneCalibrationState`.
    pub calibration: u32,
}

impl Default for Chaperone {
    fn default() -> Self {
        Self { size_m: Some([2.4, 3.2]), calibration: 1 }
    }
}

/// Everything.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The head's path in the standing universe at the start, a TUM file; none: at rest at (0, 1.6, 0).
    pub track: Option<PathBuf>,
    pub controllers: Vec<PathBuf>,
    /// Times of tracks count from Init, not from the monotonic clock's zero.
    pub track_is_relative: bool,
    /// A relative track plays forwards and backwards in turn, for ever.
    pub track_loops: bool,
    pub display: Display,
    pub raw_from_standing: YawPose,
    pub raw_from_seated: YawPose,
    pub universe_id: u64,
    /// How the raw universe moves at a change of universe: its new pose in the old one.
    pub universe_change: YawPose,
    pub projection_matrix: ProjectionMatrix,
    /// The Vulkan extensions asked for.
    pub instance_extensions: Vec<String>,
    pub device_extensions: Vec<String>,
    /// Part of the name of the GPU that drives the headset; none: the first one.
    pub gpu: Option<String>,
    pub chaperone: Chaperone,
    /// Settings by section and key, over the built-in ones.
    pub settings: BTreeMap<String, BTreeMap<String, serde_json::Value>>,
    pub events: Vec<TimedCommand>,
}

impl Default for Config {
    fn default() -> Self {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Self {
            track: None,
            controllers: Vec::new(),
            track_is_relative: false,
            track_loops: false,
            display: Display::default(),
            raw_from_standing: YawPose::new([0.3, -0.05, 0.2], 30.0),
            raw_from_seated: YawPose::new([0.1, 1.2, 0.4], -20.0),
            universe_id: 1_700_000_001,
            universe_change: YawPose::new([0.7, 0.1, -0.4], 100.0),
            projection_matrix: ProjectionMatrix::EyeFromTracking,
            instance_extensions: names(&[
                "VK_KHR_get_physical_device_properties2",
                "VK_KHR_external_memory_capabilities",
                "VK_KHR_external_semaphore_capabilities",
                "VK_KHR_external_fence_capabilities",
            ]),
            device_extensions: names(&[
                "VK_KHR_external_memory",
                "VK_KHR_external_semaphore",
                "VK_KHR_dedicated_allocation",
                "VK_KHR_get_memory_requirements2",
            ]),
            gpu: None,
            chaperone: Chaperone::default(),
            settings: BTreeMap::new(),
            events: Vec::new(),
        }
    }
}

impl Config {
    /// Reads it.
    ///
    /// # Errors
    /// What is wrong with the file, in words.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let config: Self = serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
        config.check().map_err(|what| format!("{}: {what}", path.display()))?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        let Display { frequency_hz, tangents, shot_size, .. } = &self.display;
        if !(1.0..=1000.0).contains(frequency_hz) {
            return Err(format!("frequency_hz is {frequency_hz}; it is 1 to 1000"));
        }
        if ![tangents.outer, tangents.inner, tangents.up, tangents.down].iter().all(|t| (0.01..=20.0).contains(t)) {
            return Err(format!("{tangents:?}: each is 0.01 to 20"));
        }
        if !shot_size.iter().all(|size| (16..=4096).contains(size)) {
            return Err(format!("shot_size is {shot_size:?}; each is 16 to 4096"));
        }
        if self.track_loops && !self.track_is_relative {
            return Err("track_loops is for tracks with track_is_relative".into());
        }
        Ok(())
    }
}
