//! Settings of mapping: sensor, poses, the two searches; with their bounds.

use glam::DVec3;
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::subaperture::SubapertureSettings;
use radar_sar::{Beam, BoundedSettings, HistorySettings, PositionErrors, SettingBound, SettingOutOfBounds, bounds};
use serde::{Deserialize, Serialize};

use super::{DEFAULT_CUBE_M, ReflectorSettings, RoomMapperSettings};

/// Voxels of the search for single reflectors, at most: 3 m cubed at 15 mm, or 12 m cubed at 60 mm.
/// Choice: a second's work.
const MAX_VOXELS: f64 = 8e6;

/// Settings that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MappingSettingsError {
    /// A value outside its bounds.
    #[error(transparent)]
    OutOfBounds(#[from] SettingOutOfBounds),
    /// An invalid mount.
    #[error("setting {0} has a number that is not finite, or a rotation of length zero")]
    NotFinite(&'static str),
    /// An invalid box.
    #[error("setting processing.region is {0:?}: each coordinate of max must lie above min's, by 50 m at most")]
    Region(Aabb),
    /// A search that would take hours and exhaust the memory.
    #[error(
        "processing.region and reflectors.voxel_m {voxel_m} m give {places:.1e} voxels to search: at most {max:.0e}, \
             so choose a larger voxel or a smaller region"
    )]
    TooManyVoxels {
        /// Edge of a voxel, metres.
        voxel_m: f64,
        /// Voxels in the region.
        places: f64,
        /// The bound.
        max: f64,
    },
}

/// The sensor, as imaging uses it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadarSettings {
    /// The beam: uniform, thesis, lensless, fresnel, hyperbolic, or rows of [angle in degrees, two-way amplitude].
    pub beam: Beam,
}

impl Default for RadarSettings {
    fn default() -> Self {
        Self { beam: Beam::Lensless }
    }
}

/// Pose and time of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingSettings {
    /// Time of a sweep's pose minus time of the sweep, seconds; positive when sweeps are stamped too early.
    pub time_offset_s: f64,
    /// Whether the time offset is estimated from the data, within 0.1 s of the one given, and applied.
    pub estimate_time_offset: bool,
    /// An estimate is applied when its 1σ is at most this, seconds.
    pub max_time_offset_sigma_s: f64,
    /// Whether the sensor's position and direction on the head are estimated from the data, about the mount, and applied.
    pub estimate_mount: bool,
    /// Pose of the sensor on the head; left out: that of the recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<Pose>,
    /// How poses become a path.
    pub history: HistorySettings,
    /// Accuracy of the poses.
    pub errors: PositionErrors,
}

impl BoundedSettings for TrackingSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        time_offset_s: -10.0, 10.0;
        max_time_offset_sigma_s: 0.0, 0.005;
    ];
}

impl Default for TrackingSettings {
    fn default() -> Self {
        Self {
            time_offset_s: 0.0,
            estimate_time_offset: true,
            max_time_offset_sigma_s: 3e-3,
            estimate_mount: true,
            mount: None,
            history: HistorySettings::default(),
            errors: PositionErrors::default(),
        }
    }
}

/// How to map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Rooms from 400 sweeps per second on, else single reflectors.
    #[default]
    Auto,
    /// Sub-apertures, planes, CLEAN.
    Rooms,
    /// Range-only sums.
    Reflectors,
}

/// What is mapped, and how.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessingSettings {
    /// How to map.
    pub mode: Mode,
    /// Box searched for single reflectors; left out: a 3 m cube ahead of the first pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Aabb>,
}

/// What a [`Mapper`](super::Mapper) works by.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MappingSettings {
    /// The sensor.
    pub radar: RadarSettings,
    /// Poses and time.
    pub tracking: TrackingSettings,
    /// Which search.
    pub processing: ProcessingSettings,
    /// The search in rooms.
    pub rooms: RoomMapperSettings,
    /// The search for single reflectors.
    pub reflectors: ReflectorSettings,
}

impl MappingSettings {
    /// Whether every value lies within its bounds.
    ///
    /// # Errors
    /// The first one that does not, by its name in the settings file.
    pub fn check(&self) -> Result<(), MappingSettingsError> {
        let Self { tracking, rooms, reflectors, processing, .. } = self;
        tracking.check_bounds("tracking")?;
        tracking.history.check_bounds("tracking.history")?;
        tracking.errors.check_bounds("tracking.errors")?;
        rooms.subapertures.check_bounds("rooms.subapertures")?;
        rooms.clean.check_bounds("rooms.clean")?;
        rooms.tracks.check_bounds("rooms.tracks")?;
        rooms.tracks.existence.check_bounds("rooms.tracks.existence")?;
        rooms.fine.check_bounds("rooms.fine")?;
        rooms.moving.check_bounds("rooms.moving")?;
        reflectors.check_bounds("reflectors")?;
        check_ranges(&rooms.subapertures)?;
        if let Some(region) = &processing.region {
            let sound = region.min.is_finite() && region.max.is_finite() && region.size().min_element() > 0.0;
            if !sound || region.size().max_element() > 50.0 {
                return Err(MappingSettingsError::Region(*region));
            }
        }
        self.check_search_size()?;
        if let Some(mount) = &tracking.mount
            && Pose::try_new(mount.translation.to_array(), mount.rotation.to_array()).is_err()
        {
            return Err(MappingSettingsError::NotFinite("tracking.mount"));
        }
        Ok(())
    }

    fn check_search_size(&self) -> Result<(), MappingSettingsError> {
        let size = self.processing.region.map_or(DVec3::splat(DEFAULT_CUBE_M), |region| region.size());
        let voxel_m = self.reflectors.voxel_m;
        let places = (size / voxel_m).ceil().to_array().iter().product::<f64>();
        match places <= MAX_VOXELS {
            true => Ok(()),
            false => Err(MappingSettingsError::TooManyVoxels { voxel_m, places, max: MAX_VOXELS }),
        }
    }
}

/// The farthest range lies beyond the nearest.
fn check_ranges(subapertures: &SubapertureSettings) -> Result<(), SettingOutOfBounds> {
    let SubapertureSettings { min_range_m: min, max_range_m: value, .. } = *subapertures;
    match value >= min {
        true => Ok(()),
        false => Err(SettingOutOfBounds { name: "rooms.subapertures.max_range_m".into(), value, min, max: 5.0 }),
    }
}
