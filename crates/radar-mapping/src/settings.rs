//! Settings of mapping: sensor, poses, the two searches; with their bounds.

use glam::DVec3;
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::{Beam, HistorySettings, PositionErrors};
use serde::{Deserialize, Serialize};

use super::{DEFAULT_CUBE_M, RECENT_UPDATES, ReflectorSettings, RoomMapperSettings};

/// Voxels of the search for single reflectors, at most: 3 m cubed at 15 mm, or 12 m cubed at 60 mm. A choice: a second's work.
const MAX_VOXELS: f64 = 8e6;

/// Settings that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MappingSettingsError {
    /// A value outside its bounds.
    #[error("setting {name} is {value}: it must lie in {min} to {max}")]
    OutOfRange {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
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
    /// Pose of the sensor on the head; left out: that of the recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<Pose>,
    /// How poses become a path.
    pub history: HistorySettings,
    /// Accuracy of the poses.
    pub errors: PositionErrors,
}

impl Default for TrackingSettings {
    fn default() -> Self {
        Self {
            time_offset_s: 0.0,
            estimate_time_offset: true,
            max_time_offset_sigma_s: 3e-3,
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
        let blocks = &rooms.blocks;
        let bounded = [
            ("tracking.time_offset_s", tracking.time_offset_s, -10.0, 10.0),
            ("tracking.max_time_offset_sigma_s", tracking.max_time_offset_sigma_s, 0.0, 0.005),
            ("tracking.history.max_gap_s", tracking.history.max_gap_s, 0.001, 1.0),
            ("tracking.history.smoothing_window_s", tracking.history.smoothing_window_s, 0.0, 0.5),
            ("tracking.history.max_ahead_s", tracking.history.max_ahead_s, 0.0, 0.5),
            ("tracking.errors.wander_m", tracking.errors.wander_m, 0.0, 1.0),
            ("tracking.errors.wander_s", tracking.errors.wander_s, 0.01, 1e4),
            ("tracking.errors.mount_m", tracking.errors.mount_m, 0.0, 1.0),
            ("tracking.errors.jitter_m", tracking.errors.jitter_m, 0.0, 1.0),
            ("tracking.errors.rotation_deg", tracking.errors.rotation_deg, 0.0, 90.0),
            ("rooms.blocks.block_s", blocks.block_s, 0.01, 0.5),
            ("rooms.blocks.min_sweeps", blocks.min_sweeps as f64, 2.0, 1e4),
            ("rooms.blocks.memory_s", blocks.memory_s, 0.1, 100.0),
            ("rooms.blocks.min_amplitude", blocks.min_amplitude, 0.01, 1.0),
            ("rooms.blocks.mirror_min_amplitude", blocks.mirror_min_amplitude, 0.001, 1.0),
            ("rooms.blocks.min_range_m", blocks.min_range_m, 0.05, 10.0),
            ("rooms.blocks.max_range_m", blocks.max_range_m, blocks.min_range_m, 5.0),
            ("rooms.blocks.voxel_m", blocks.voxel_m, 0.02, 0.5),
            ("rooms.explain.window_s", rooms.explain.window_s, 0.5, 20.0),
            ("rooms.explain.max_candidates", rooms.explain.max_candidates as f64, 1.0, 1e4),
            ("rooms.explain.min_score", rooms.explain.min_score, 0.0, 1e6),
            ("rooms.explain.min_candidate_score", rooms.explain.min_candidate_score, 0.0, 1e6),
            ("rooms.explain.plane_min_score", rooms.explain.plane_min_score, 0.0, 1e6),
            ("rooms.explain.min_over_point", rooms.explain.min_over_point, -1e6, 1e6),
            ("rooms.explain.plane_min_blocks", f64::from(rooms.explain.plane_min_blocks), 1.0, 1e4),
            ("rooms.explain.max_sigma_m", rooms.explain.max_sigma_m, 0.01, 10.0),
            ("rooms.explain.min_feet_rms_m", rooms.explain.min_feet_rms_m, 0.0, 10.0),
            ("rooms.explain.claim_range_m", rooms.explain.claim_range_m, 0.0, 10.0),
            ("rooms.explain.claim_lobes", rooms.explain.claim_lobes, 0.0, 1e3),
            ("rooms.map.confirm_score", rooms.map.confirm_score, 0.0, 1e6),
            ("rooms.map.confirm_sightings", rooms.map.confirm_sightings as f64, 1.0, RECENT_UPDATES as f64),
            ("rooms.map.confirm_wall_sightings", rooms.map.confirm_wall_sightings as f64, 1.0, RECENT_UPDATES as f64),
            ("rooms.map.confirm_odds", rooms.map.confirm_odds, -100.0, 100.0),
            ("rooms.map.forget.leak", rooms.map.forget.leak, 0.0, 1e3),
            ("rooms.map.forget.shadow_leak", rooms.map.forget.shadow_leak, 0.0, 1e3),
            ("rooms.map.forget.beside", rooms.map.forget.beside, 0.0, 100.0),
            ("rooms.map.forget.familiar_blocks", rooms.map.forget.familiar_blocks, 0.0, 1e9),
            ("rooms.explain.uneven_cost", rooms.explain.uneven_cost, 0.0, 1e6),
            ("rooms.map.hands_reach_m", rooms.map.hands_reach_m, 0.0, 10.0),
            ("rooms.map.forget.confirm", rooms.map.forget.confirm, -100.0, 100.0),
            ("rooms.map.forget.newly", rooms.map.forget.newly, 0.0, 100.0),
            ("rooms.map.forget.most", rooms.map.forget.most, 0.1, 100.0),
            ("rooms.map.forget.familiar", rooms.map.forget.familiar, 0.0, 0.99),
            ("rooms.map.forget.unfamiliar", rooms.map.forget.unfamiliar, 0.0, 0.99),
            ("rooms.map.match_m", rooms.map.match_m, 0.01, 1.0),
            ("rooms.fine.voxel_m", rooms.fine.voxel_m, 0.005, 0.05),
            ("rooms.fine.min_score", rooms.fine.min_score, 0.0, 1e6),
            ("rooms.fine.max_opened", rooms.fine.max_opened as f64, 0.0, 1e4),
            ("rooms.fine.max_bricks", rooms.fine.max_bricks as f64, 0.0, 1e5),
            ("rooms.fine.keep_looks", f64::from(rooms.fine.keep_looks), 0.0, 1e4),
            ("rooms.moving.alarms_per_block", rooms.moving.alarms_per_block, 1e-6, 1.0),
            ("rooms.moving.confirm_blocks", rooms.moving.confirm_blocks as f64, 1.0, 6.0),
            ("rooms.moving.min_travel_m", rooms.moving.min_travel_m, 0.0, 10.0),
            ("rooms.moving.forget_s", rooms.moving.forget_s, 0.1, 10.0),
            ("reflectors.voxel_m", reflectors.voxel_m, 0.005, 0.5),
            ("reflectors.min_range_m", reflectors.min_range_m, 0.0, 10.0),
            ("reflectors.threshold_sigma", reflectors.threshold_sigma, 0.0, 1e6),
            ("reflectors.max_reflectors", reflectors.max_reflectors as f64, 1.0, 1000.0),
            ("reflectors.max_sweeps", reflectors.max_sweeps as f64, 0.0, 1e9),
            ("reflectors.search_sweeps", reflectors.search_sweeps as f64, 3.0, 1e5),
        ];
        for (name, value, min, max) in bounded {
            if !(min..=max).contains(&value) {
                return Err(MappingSettingsError::OutOfRange { name, value, min, max });
            }
        }
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
