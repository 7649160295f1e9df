//! The configuration, `fake.json`. Every entry has a default; unknown names are rejected.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use radar_sar::geometry::Pose;
use serde::Deserialize;

use crate::commands::TimedCommand;
use crate::older_tables::Sdk;

/// A position and a rotation about the vertical axis.
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

    /// The pose.
    pub fn pose(self) -> Pose {
        Pose::new(DVec3::from_array(self.position_m), DQuat::from_rotation_y(self.yaw_deg.to_radians()))
    }
}

/// Direction of a projection overlay's matrix.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProjectionMatrix {
    /// Transforms from tracking space to the eye.
    EyeFromTracking,
    /// Transforms from the eye to tracking space.
    TrackingFromEye,
}

/// Half field-of-view angles of an eye, as tangents, all positive.
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
    /// Asymmetric in both directions, so that sign errors become visible.
    pub tangents: Tangents,
    /// Recommended size of an eye's image, pixels.
    pub render_target: [u32; 2],
    /// Size of an eye's image in a shot, pixels.
    pub shot_size: [u32; 2],
    /// Background colour, linear.
    pub background: [f32; 3],
    /// Whether shots show a 1 m grid on the floor of the room.
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

/// The user's play area.
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

/// A deviation from SteamVR, as other runtimes show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Defect {
    /// The headset has no CurrentUniverseId.
    NoUniverseId,
    /// Init ends the process.
    AbortsInInit,
    /// Settings are answered with zero and no error.
    ZeroSettings,
}

/// The configuration. 18 fields: the file's entries as they are.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The head's path in the initial standing universe, a TUM file; none: at rest at (0, 1.6, 0).
    pub track: Option<PathBuf>,
    pub controllers: Vec<PathBuf>,
    /// Whether times of tracks count from Init, instead of from the zero of the monotonic clock.
    pub track_is_relative: bool,
    /// Whether a relative track repeats forever, alternately forwards and backwards.
    pub track_loops: bool,
    pub display: Display,
    pub raw_from_standing: YawPose,
    pub raw_from_seated: YawPose,
    pub universe_id: u64,
    /// Motion of the raw universe at a change of universe: its new pose in the old one.
    pub universe_change: YawPose,
    pub projection_matrix: ProjectionMatrix,
    /// The required Vulkan extensions.
    pub instance_extensions: Vec<String>,
    pub device_extensions: Vec<String>,
    /// Substring of the name of the GPU that drives the headset; none: the first GPU.
    pub gpu: Option<String>,
    pub chaperone: Chaperone,
    /// Settings by section and key, overriding the built-in ones.
    pub settings: BTreeMap<String, BTreeMap<String, serde_json::Value>>,
    pub events: Vec<TimedCommand>,
    /// The SDK whose interfaces the runtime has.
    pub sdk: Sdk,
    pub defects: Vec<Defect>,
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
            sdk: Sdk::default(),
            defects: Vec::new(),
        }
    }
}

impl Config {
    /// Whether the runtime has a defect.
    pub fn has(&self, defect: Defect) -> bool {
        self.defects.contains(&defect)
    }

    /// Reads the configuration.
    ///
    /// # Errors
    /// A message that describes what is wrong with the file.
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
