//! Settings of mapping: sensor, poses, the two searches; with their bounds.

use glam::DVec3;
use radar_sar::geometry::{Aabb, MountError, Pose, mount};
use radar_sar::{Beam, BoundedSettings, HistorySettings, PositionErrors, SettingBound, SettingOutOfBounds, bounds};
use serde::{Deserialize, Serialize};

use super::search::SUBAPERTURES_FROM_SWEEPS_PER_S;
use super::{DEFAULT_CUBE_M, ReflectorSettings, RoomMapperSettings};

/// Voxels of the search for single reflectors, at most: 3 m cubed at 15 mm, or 12 m cubed at 60 mm.
/// Choice: a second's work.
const MAX_VOXELS: f64 = 8e6;
/// Range biases that can be set, metres. Choice: several times the greatest that the vendor's compensation gives for four modules,
/// 16 mm.
const RANGE_BIAS_M: [f64; 2] = [-0.1, 0.1];
/// Least number of sweeps that reflectors are searched in. Choice: three ranges determine a point, and some sweeps do not see it.
const MIN_SWEEPS: usize = 10;
/// Least difference of farthest and nearest range, metres. Choice: more than three pulses of 14 cm; what is seen at fewer ranges
/// is not resolved.
const MIN_DEPTH_M: f64 = 0.5;

/// Settings that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MappingSettingsError {
    /// A value outside its bounds.
    #[error(transparent)]
    OutOfBounds(#[from] SettingOutOfBounds),
    /// A value with which nothing could ever be mapped, because of another one.
    #[error("setting {name} is {value}: with {with} = {other} it must lie in {min} to {max}, else {otherwise}")]
    Contradiction {
        /// The setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The other setting.
        with: &'static str,
        /// The other's value.
        other: f64,
        /// Least value that agrees with the other.
        min: f64,
        /// Greatest value that agrees with the other.
        max: f64,
        /// What would happen.
        otherwise: &'static str,
    },
    /// Too few sweeps for a position.
    #[error("setting reflectors.max_sweeps is {0}: give 0 for all, or at least {MIN_SWEEPS}")]
    TooFewSweeps(usize),
    /// An invalid mount.
    #[error("setting tracking.mount: {0}")]
    Mount(#[from] MountError),
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
    /// Measured minus true range of all subsweeps, metres; left out: by the loopback where one is recorded, else 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range_bias_m: Option<f64>,
}

impl Default for RadarSettings {
    fn default() -> Self {
        Self { beam: Beam::Lensless, range_bias_m: None }
    }
}

impl RadarSettings {
    fn check_range_bias(&self) -> Result<(), SettingOutOfBounds> {
        let [min, max] = RANGE_BIAS_M;
        match self.range_bias_m {
            Some(value) if !(min..=max).contains(&value) => {
                Err(SettingOutOfBounds { name: "radar.range_bias_m".into(), value, min, max })
            }
            _ => Ok(()),
        }
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
        let Self { radar, tracking, rooms, reflectors, processing } = self;
        radar.check_range_bias()?;
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
        rooms.check_agreement()?;
        if (1..MIN_SWEEPS).contains(&reflectors.max_sweeps) {
            return Err(MappingSettingsError::TooFewSweeps(reflectors.max_sweeps));
        }
        if let Some(region) = &processing.region {
            let sound = region.min.is_finite() && region.max.is_finite() && region.size().min_element() > 0.0;
            if !sound || region.size().max_element() > 50.0 {
                return Err(MappingSettingsError::Region(*region));
            }
        }
        self.check_search_size()?;
        if let Some(Pose { translation, rotation }) = &tracking.mount {
            mount(translation.to_array(), rotation.to_array())?;
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

impl RoomMapperSettings {
    /// Checks that the values agree: that there are ranges, that sub-apertures and walls can be seen in enough of what they
    /// consist of, and that the log odds of an object can reach what confirms it.
    fn check_agreement(&self) -> Result<(), MappingSettingsError> {
        let Self { subapertures, clean, tracks, .. } = self;
        let existence = &tracks.existence;
        let sweeps = subapertures.duration_s * SUBAPERTURES_FROM_SWEEPS_PER_S;
        let subapertures_in_window = clean.window_s / subapertures.duration_s;
        let rules = [
            Rule {
                setting: ("rooms.subapertures.max_range_m", subapertures.max_range_m),
                other: ("rooms.subapertures.min_range_m", subapertures.min_range_m),
                within: (subapertures.min_range_m + MIN_DEPTH_M, 5.0),
                otherwise: "no range is left to see objects in",
            },
            Rule {
                setting: ("rooms.subapertures.min_sweeps", subapertures.min_sweeps as f64),
                other: ("rooms.subapertures.duration_s", subapertures.duration_s),
                within: (2.0, sweeps.round()),
                otherwise: "a sensor of 400 sweeps per second completes no sub-aperture",
            },
            Rule {
                setting: ("rooms.clean.plane_min_subapertures", f64::from(clean.plane_min_subapertures)),
                other: ("rooms.clean.window_s", clean.window_s),
                within: (1.0, subapertures_in_window.floor()),
                otherwise: "no wall is ever detected",
            },
            Rule {
                setting: ("rooms.tracks.existence.max_log_odds", existence.max_log_odds),
                other: ("rooms.tracks.existence.confirm_log_odds", existence.confirm_log_odds),
                within: (existence.confirm_log_odds.max(0.1), 100.0),
                otherwise: "no object is ever confirmed",
            },
            Rule {
                setting: ("rooms.tracks.existence.established_max_log_odds", existence.established_max_log_odds),
                other: ("rooms.tracks.existence.max_log_odds", existence.max_log_odds),
                within: (existence.max_log_odds, 100.0),
                otherwise: "what is detected again is removed sooner than what is new",
            },
        ];
        rules.iter().try_for_each(Rule::check)
    }
}

/// The interval that one setting leaves to another.
struct Rule {
    setting: (&'static str, f64),
    other: (&'static str, f64),
    within: (f64, f64),
    otherwise: &'static str,
}

impl Rule {
    fn check(&self) -> Result<(), MappingSettingsError> {
        let Self { setting: (name, value), other: (with, other), within: (min, max), otherwise } = *self;
        match (min..=max).contains(&value) {
            true => Ok(()),
            false => Err(MappingSettingsError::Contradiction { name, value, with, other, min, max, otherwise }),
        }
    }
}
