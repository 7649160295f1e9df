//! The two ways to map: rooms by sub-apertures, or single reflectors by range alone.

use a121::{SensorConfig, frame_timing};
use glam::DVec3;
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::{FollowedJump, Observation, PositionErrors};
use serde::{Deserialize, Serialize};

use super::calibration_control::CalibrationChange;
use super::reflector_mapper::ReflectorMapper;
use super::{
    Evidence, HandsSample, MappingSettings, Mode, RoomMapper, RoomMapperCounters, SavedMap, SavedMapError, Scene,
    ScoredCandidate,
};

/// Sweeps per second from which on the phase can be followed from sweep to sweep: λ/4 per sweep at
/// 0.5 m/s. Choice: 0.5 m/s is a moderate movement of the head.
pub(super) const SUBAPERTURES_FROM_SWEEPS_PER_S: f64 = 400.0;
/// Default edge of the cube searched for single reflectors, metres. Choice: the presets measure up
/// to 3.1 m ahead.
pub const DEFAULT_CUBE_M: f64 = 3.0;
/// How long poses are kept for observations that are kept without limit, seconds. Choice: longer
/// than any session; [`crate::Observer`] bounds the number of poses.
const UNBOUNDED_RETENTION_S: f64 = 1e5;
/// Sub-aperture score that noise reaches occasionally. Measured: noise alone scores up to 2.0 in
/// simulated rooms.
const NOISE_SCORE: f64 = 2.0;

/// How a recording is mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapperKind {
    /// Sub-apertures, planes, CLEAN: furnished rooms, fast sensors.
    Rooms,
    /// Range-only sums: single reflectors, slow sensors.
    Reflectors,
}

/// The search in use.
#[derive(Debug)]
pub(crate) enum Search {
    /// See [`MapperKind::Rooms`].
    Rooms(Box<RoomMapper>),
    /// See [`MapperKind::Reflectors`].
    Reflectors(Box<ReflectorMapper>),
}

impl Search {
    /// The search that the settings name, or that fits the sensor's rate.
    pub fn new(config: &SensorConfig, settings: &MappingSettings) -> Self {
        let sweeps_per_s = f64::from(config.sweeps_per_frame) / frame_timing(config).frame_period_s;
        let is_fast = sweeps_per_s >= SUBAPERTURES_FROM_SWEEPS_PER_S;
        match settings.processing.mode {
            Mode::Rooms => Self::rooms(settings),
            Mode::Auto if is_fast => Self::rooms(settings),
            Mode::Auto | Mode::Reflectors => Self::Reflectors(Box::new(ReflectorMapper::new(settings))),
        }
    }

    fn rooms(settings: &MappingSettings) -> Self {
        Self::Rooms(Box::new(RoomMapper::new(settings.rooms, &settings.radar.beam, settings.tracking.errors)))
    }

    pub fn kind(&self) -> MapperKind {
        match self {
            Self::Rooms(_) => MapperKind::Rooms,
            Self::Reflectors(_) => MapperKind::Reflectors,
        }
    }

    /// Takes an observation; what it triggers is left to [`work`](Self::work).
    pub fn push(&mut self, observation: Observation) {
        match self {
            Self::Rooms(rooms) => rooms.push_deferred(observation),
            Self::Reflectors(reflectors) => reflectors.push(observation),
        }
    }

    /// Does a part of the triggered work; false when nothing is left.
    pub fn work(&mut self) -> bool {
        match self {
            Self::Rooms(rooms) => rooms.work(),
            Self::Reflectors(_) => false,
        }
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        match self {
            Self::Rooms(rooms) => rooms.has_work(),
            Self::Reflectors(_) => false,
        }
    }

    /// If the next observation completes a sub-aperture, updates the poses of its sweeps with
    /// `sensor_at`, which knows more poses than when each sweep arrived.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        if let Self::Rooms(rooms) = self {
            rooms.update_poses_before(next, sensor_at);
        }
    }

    /// Takes a jump of the tracking frame: what came since was taken to be in the frame of before.
    pub fn follow(&mut self, jump: &FollowedJump) {
        if let Self::Rooms(rooms) = self {
            rooms.follow(jump);
        }
    }

    /// Takes the positions of the wearer's hands: detections there are not furniture.
    pub fn push_hands(&mut self, hands: &HandsSample) {
        if let Self::Rooms(rooms) = self {
            rooms.push_hands(hands.time_ns, hands.hands_m);
        }
    }

    /// Takes the pose errors as they were estimated. Single reflectors estimate their own.
    pub fn set_errors(&mut self, errors: PositionErrors) {
        if let Self::Rooms(rooms) = self {
            rooms.set_errors(errors);
        }
    }

    /// Ends the input and finishes the triggered work.
    pub fn finish(&mut self) {
        if let Self::Rooms(rooms) = self {
            rooms.finish();
        }
    }

    /// Map updates so far; single reflectors have none.
    pub fn updates(&self) -> u64 {
        match self {
            Self::Rooms(rooms) => rooms.counters().looks,
            Self::Reflectors(_) => 0,
        }
    }

    /// Counters of the room mapper.
    pub fn room_counters(&self) -> RoomMapperCounters {
        match self {
            Self::Rooms(rooms) => rooms.counters(),
            Self::Reflectors(_) => RoomMapperCounters::default(),
        }
    }

    /// Observations dropped to bound memory.
    pub fn thinned(&self) -> u64 {
        match self {
            Self::Rooms(_) => 0,
            Self::Reflectors(reflectors) => reflectors.thinned(),
        }
    }

    /// End of the newest sweep that the last map update used, host nanoseconds; `newest_ns` for
    /// single reflectors.
    pub fn evidence_ns(&self, newest_ns: Option<i64>) -> Option<i64> {
        match self {
            Self::Rooms(rooms) => rooms.evidence_ns(),
            Self::Reflectors(_) => newest_ns,
        }
    }

    /// Candidates scored in the last map update.
    pub fn scored_candidates(&self) -> &[ScoredCandidate] {
        match self {
            Self::Rooms(rooms) => rooms.scored_candidates(),
            Self::Reflectors(_) => &[],
        }
    }

    /// The map for saving; empty for single reflectors.
    pub fn saved_map(&self) -> SavedMap {
        match self {
            Self::Rooms(rooms) => rooms.saved_map(),
            Self::Reflectors(_) => SavedMap::default(),
        }
    }

    /// Restores a saved map as provisional; only checked for single reflectors.
    pub fn restore(&mut self, saved: &SavedMap) -> Result<(), SavedMapError> {
        match self {
            Self::Rooms(rooms) => rooms.restore(saved),
            Self::Reflectors(_) => saved.check(),
        }
    }

    /// How long observations are kept so that they can get new poses, seconds.
    pub fn pose_retention_s(&self, settings: &MappingSettings) -> f64 {
        match self {
            Self::Rooms(_) => settings.rooms.clean.window_s + 1.0,
            Self::Reflectors(_) => UNBOUNDED_RETENTION_S,
        }
    }

    /// Gives kept observations the poses of a changed calibration with `repose`, which returns whether there is one. The
    /// room mapper keeps sums, not sweeps: unless the change is harmless it images the sweeps of its window again.
    /// Returns whether it does.
    pub fn repose(&mut self, change: &CalibrationChange, repose: impl FnMut(&mut Observation) -> bool) -> bool {
        match self {
            Self::Rooms(_) if change.is_harmless() => false,
            Self::Rooms(rooms) => {
                rooms.image_again(change, repose);
                true
            }
            Self::Reflectors(reflectors) => {
                reflectors.repose(repose);
                false
            }
        }
    }

    /// The obstacles, walls and moving targets found so far. For single reflectors this does the
    /// search. `time_ns`: time of the scene.
    pub fn scene(&self, time_ns: i64) -> Scene {
        match self {
            Self::Rooms(rooms) => {
                Scene { time_ns, obstacles: rooms.obstacles(), walls: rooms.walls(), moving: rooms.moving_targets() }
            }
            Self::Reflectors(reflectors) => Scene { time_ns, obstacles: reflectors.obstacles(), ..Scene::default() },
        }
    }

    /// The `most` strongest voxels with evidence: sub-aperture scores from 2 on, which noise
    /// reaches; for single reflectors the excess over noise.
    pub fn evidence(&self, most: usize) -> Evidence {
        match self {
            Self::Rooms(rooms) => rooms.evidence(NOISE_SCORE, most),
            Self::Reflectors(reflectors) => reflectors.evidence(most),
        }
    }
}

/// An axis-aligned 3 m cube centred 1.5 m ahead of a sensor.
pub fn cube_ahead(tracking_from_sensor: &Pose) -> Aabb {
    let half = DEFAULT_CUBE_M * 0.5;
    let middle = tracking_from_sensor.translation + tracking_from_sensor.forward() * half;
    Aabb { min: middle - DVec3::splat(half), max: middle + DVec3::splat(half) }
}
