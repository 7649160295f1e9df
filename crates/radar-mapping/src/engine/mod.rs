//! The engine: observations in, scene out. It has no clock, no I/O and no threads of its own; the
//! same observations and settings give the same scene, byte for byte.
//!
//! Input: `Observation`s in time order, or frames and poses through [`Pipeline`]. Output: a `Scene`
//! on request.

mod offset_guard;
mod pipeline;
mod synchronisation;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{
    Evidence, HandsM, MappingSettings, Mode, RoomMapper, RoomMapperCounters, SavedMap, SavedMapError, Scene,
    ScoredCandidate, find_reflectors, reflector_evidence,
};
use a121::{SensorConfig, frame_timing};
use radar_sar::Observation;
use radar_sar::geometry::{Aabb, Pose};

pub use pipeline::{Counters, Pipeline, TimeOffsetCounters};
pub use synchronisation::{
    Lag, LagCurve, OffsetWindow, RateOffset, ReflectorSeries, StartLag, Synchronisation, SynchronisationError,
    reflector_series, synchronisation,
};

/// Sweeps per second from which on sub-apertures can follow the phase. Physics: λ/4 per sweep at
/// 0.5 m/s.
const SUBAPERTURES_FROM_SWEEPS_PER_S: f64 = 400.0;
/// Default edge of the cube searched for single reflectors, metres. Choice.
pub const DEFAULT_CUBE_M: f64 = 3.0;
/// Largest number of observations kept for single reflectors; beyond, every second sweep is
/// dropped. Choice.
const MAX_OBSERVATIONS: usize = 20_000;
/// Change of the time offset that invalidates the room mapper's sums, seconds. 3 ms are
/// harmless, 10 ms are not.
const MAX_HARMLESS_OFFSET_CHANGE_S: f64 = 4e-3;
/// How long poses are kept for observations that are kept without limit, seconds. Choice.
const UNBOUNDED_RETENTION_S: f64 = 1e5;

/// Sub-aperture score that noise reaches occasionally.
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

/// Counters of the engine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EngineCounters {
    /// How it maps.
    pub search: MapperKind,
    /// Observations taken.
    pub observations: u64,
    /// Observations dropped to bound memory (single reflectors only).
    pub observations_thinned: u64,
    /// Observations that got a new pose from a new time offset.
    pub observations_reposed: u64,
    /// Observations for which the new time offset gives no pose.
    pub observations_lost: u64,
    /// How often the room mapper restarted because its poses had been wrong.
    pub searches_begun_again: u64,
    /// Counters of the room mapper.
    pub rooms: RoomMapperCounters,
}

/// Observations in, scene out.
#[derive(Debug)]
pub struct Engine {
    settings: MappingSettings,
    search: MapperKind,
    rooms: RoomMapper,
    kept: Vec<Observation>,
    first_pose: Option<Pose>,
    newest_ns: i64,
    newest_end_ns: Option<i64>,
    observations: u64,
    thinned: u64,
    reposed: u64,
    lost: u64,
    restarts: u64,
    is_deferred: bool,
}

impl Engine {
    /// For a valid configuration.
    pub fn new(config: &SensorConfig, settings: &MappingSettings) -> Self {
        let sweeps_per_s = f64::from(config.sweeps_per_frame) / frame_timing(config).frame_period_s;
        let search = match settings.processing.mode {
            Mode::Rooms => MapperKind::Rooms,
            Mode::Reflectors => MapperKind::Reflectors,
            Mode::Auto if sweeps_per_s >= SUBAPERTURES_FROM_SWEEPS_PER_S => MapperKind::Rooms,
            Mode::Auto => MapperKind::Reflectors,
        };
        Self {
            rooms: RoomMapper::new(settings.rooms, &settings.radar.beam, settings.tracking.errors),
            settings: settings.clone(),
            search,
            kept: Vec::new(),
            first_pose: None,
            newest_ns: 0,
            newest_end_ns: None,
            observations: 0,
            thinned: 0,
            reposed: 0,
            lost: 0,
            restarts: 0,
            is_deferred: false,
        }
    }

    /// From now on [`push`](Self::push) only stores sweeps, and [`work`](Self::work) processes
    /// them.
    pub fn defer(&mut self) {
        self.is_deferred = true;
    }

    /// Does a part of the deferred work; false when nothing is left.
    pub fn work(&mut self) -> bool {
        self.rooms.work()
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.rooms.has_work()
    }

    /// How it maps.
    pub fn search(&self) -> MapperKind {
        self.search
    }

    /// Counters so far.
    pub fn counters(&self) -> EngineCounters {
        EngineCounters {
            search: self.search,
            observations: self.observations,
            observations_thinned: self.thinned,
            observations_reposed: self.reposed,
            observations_lost: self.lost,
            searches_begun_again: self.restarts,
            rooms: self.rooms.counters(),
        }
    }

    /// Takes an observation.
    pub fn push(&mut self, observation: Observation) {
        self.observations += 1;
        self.newest_ns = observation.mid_time_ns;
        self.newest_end_ns = Some(observation.end_ns());
        self.first_pose.get_or_insert(observation.tracking_from_sensor);
        match self.search {
            MapperKind::Rooms if self.is_deferred => self.rooms.push_deferred(observation),
            MapperKind::Rooms => self.rooms.push(observation),
            MapperKind::Reflectors => self.keep(observation),
        }
    }

    /// Bounds memory: when full, every second sweep is dropped, so that the rest still spans the
    /// whole motion.
    fn keep(&mut self, observation: Observation) {
        if self.kept.len() >= MAX_OBSERVATIONS {
            let mut sweep = 0;
            let before = self.kept.len();
            let mut last_subsweep = None;
            self.kept.retain(|o| {
                sweep += usize::from(last_subsweep.is_none_or(|last| o.geometry.subsweep <= last));
                last_subsweep = Some(o.geometry.subsweep);
                sweep % 2 == 0
            });
            self.thinned += (before - self.kept.len()) as u64;
        }
        self.kept.push(observation);
    }

    /// End of the newest sweep taken, host nanoseconds.
    pub fn newest_sweep_ns(&self) -> Option<i64> {
        self.newest_end_ns
    }

    /// End of the newest sweep contained in [`scene`](Self::scene), host nanoseconds: of the last
    /// map update, or of the newest sweep for single reflectors.
    pub fn evidence_ns(&self) -> Option<i64> {
        match self.search {
            MapperKind::Rooms => self.rooms.evidence_ns(),
            MapperKind::Reflectors => self.newest_end_ns,
        }
    }

    /// Candidates scored in the last map update, for training the classifier.
    pub fn weighed(&self) -> &[ScoredCandidate] {
        self.rooms.scored_candidates()
    }

    /// If the next observation completes a sub-aperture, updates the poses of its sweeps with
    /// `sensor_at`, which knows more poses than when each sweep arrived.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        if self.search == MapperKind::Rooms {
            self.rooms.update_poses_before(next, sensor_at);
        }
    }

    /// Takes the positions of the wearer's hands: detections there are not furniture.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.rooms.push_hands(time_ns, hands_m);
    }

    /// The map for saving; empty for single reflectors.
    pub fn saved_map(&self) -> SavedMap {
        match self.search {
            MapperKind::Rooms => self.rooms.saved_map(),
            MapperKind::Reflectors => SavedMap::default(),
        }
    }

    /// Restores a saved map as provisional; ignored for single reflectors.
    ///
    /// # Errors
    /// Numbers that are not valid for a room; nothing is restored then.
    pub fn restore(&mut self, remembered: &SavedMap) -> Result<(), SavedMapError> {
        match self.search {
            MapperKind::Rooms => self.rooms.restore(remembered),
            MapperKind::Reflectors => remembered.check(),
        }
    }

    /// How long observations are kept so that they can get new poses, seconds.
    pub fn pose_retention_s(&self) -> f64 {
        match self.search {
            MapperKind::Rooms => self.settings.rooms.explain.window_s + 1.0,
            MapperKind::Reflectors => UNBOUNDED_RETENTION_S,
        }
    }

    /// Gives kept observations the poses of a new time offset and drops those without one.
    /// `change_s`: change of the offset; `sensor_at`: pose and velocity at the middle of a sweep.
    /// The room mapper keeps sums, not sweeps: when the change invalidates them it restarts with
    /// the sweeps of its window.
    pub fn repose(&mut self, change_s: f64, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        let (mut reposed, mut lost) = (0, 0);
        let mut repose = |observation: &mut Observation| {
            let sensor = sensor_at(observation.mid_time_ns);
            if let Some((tracking_from_sensor, velocity_m_per_s)) = sensor {
                observation.tracking_from_sensor = tracking_from_sensor;
                observation.velocity_m_per_s = velocity_m_per_s;
            }
            (reposed, lost) = (reposed + u64::from(sensor.is_some()), lost + u64::from(sensor.is_none()));
            sensor.is_some()
        };
        match self.search {
            MapperKind::Reflectors => self.kept.retain_mut(repose),
            MapperKind::Rooms if self.is_invalidated_by(change_s) => {
                self.rooms.restart(&mut repose);
                while !self.is_deferred && self.rooms.work() {}
                self.restarts += 1;
            }
            MapperKind::Rooms => {}
        }
        self.reposed += reposed;
        self.lost += lost;
    }

    /// Whether such a change of the time offset invalidates the mapper's sums, so that it restarts.
    pub fn is_invalidated_by(&self, change_s: f64) -> bool {
        self.search == MapperKind::Rooms && change_s.abs() >= MAX_HARMLESS_OFFSET_CHANGE_S
    }

    /// Ends the input and finishes the deferred work.
    pub fn finish(&mut self) {
        if self.search == MapperKind::Rooms {
            self.rooms.finish();
        }
    }

    /// The box searched for single reflectors: from the settings, or a cube ahead of the first
    /// pose.
    pub fn region(&self) -> Aabb {
        self.settings.processing.region.unwrap_or_else(|| cube_ahead(&self.first_pose.unwrap_or(Pose::IDENTITY)))
    }

    /// The obstacles, walls and moving targets found so far. For single reflectors this does the
    /// search.
    pub fn scene(&self) -> Scene {
        let (obstacles, walls, moving) = match self.search {
            MapperKind::Rooms => (self.rooms.obstacles(), self.rooms.walls(), self.rooms.moving_targets()),
            MapperKind::Reflectors => {
                let MappingSettings { radar, tracking, reflectors, .. } = &self.settings;
                let found = find_reflectors(&self.kept, &radar.beam, &self.region(), reflectors, &tracking.errors);
                (found, Vec::new(), Vec::new())
            }
        };
        Scene { time_ns: self.newest_ns, obstacles, walls, moving }
    }
}

impl Engine {
    /// The `most` strongest voxels with evidence: sub-aperture scores from 2 on, which noise
    /// reaches; for single reflectors the excess over noise.
    pub fn evidence(&self, most: usize) -> Evidence {
        let MappingSettings { radar, reflectors, .. } = &self.settings;
        match self.search {
            MapperKind::Rooms => self.rooms.evidence(NOISE_SCORE, most),
            MapperKind::Reflectors => reflector_evidence(&self.kept, &radar.beam, &self.region(), reflectors, most),
        }
    }
}

/// An axis-aligned 3 m cube centred 1.5 m ahead of a sensor.
pub fn cube_ahead(tracking_from_sensor: &Pose) -> Aabb {
    let half = DEFAULT_CUBE_M * 0.5;
    let middle = tracking_from_sensor.translation + tracking_from_sensor.forward() * half;
    Aabb { min: middle - DVec3::splat(half), max: middle + DVec3::splat(half) }
}
