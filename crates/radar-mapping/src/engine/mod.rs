//! The pipeline: observation in, scene out. No clock, no I/O, no threads of its own making; the same observations and
//! settings give the same scene, byte for byte.
//!
//! Stream in: `Observation`s in time (or frames and poses, through [`Pipeline`]). Out: a `Scene` whenever asked.

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

/// Sweeps a second from which on blocks follow the phase: λ/4 a sweep at 0.5 m/s.
const SUBAPERTURES_FROM_SWEEPS_PER_S: f64 = 400.0;
/// Edge of the cube that is searched for single reflectors unless told otherwise, metres.
pub const DEFAULT_CUBE_M: f64 = 3.0;
/// Observations that a search for single reflectors keeps at most; beyond, every second one goes.
const MAX_OBSERVATIONS: usize = 20_000;
/// A change of the time offset that ruins what a room's search has summed so far, seconds: 3 ms do no harm, 10 ms do.
const MAX_HARMLESS_OFFSET_CHANGE_S: f64 = 4e-3;
/// Poses are kept for this long for observations that are kept for good, seconds.
const UNBOUNDED_RETENTION_S: f64 = 1e5;

/// Block scores that noise reaches now and then.
const NOISE_SCORE: f64 = 2.0;

/// How a recording is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapperKind {
    /// Blocks, planes, explaining away: furnished rooms, fast sensors.
    Rooms,
    /// Range-only sums: single reflectors, slow sensors.
    Reflectors,
}

/// What the engine did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EngineCounters {
    /// How it searched.
    pub search: MapperKind,
    /// Observations taken in.
    pub observations: u64,
    /// Observations thinned out to bound memory (single reflectors alone).
    pub observations_thinned: u64,
    /// Observations that got a new pose by a new time offset.
    pub observations_reposed: u64,
    /// Observations that the new time offset left without a pose.
    pub observations_lost: u64,
    /// Times that the search in rooms began again since its poses had been wrong.
    pub searches_begun_again: u64,
    /// Blocks and voxels (rooms alone).
    pub rooms: RoomMapperCounters,
}

/// Observation in, scene out.
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
    /// For sweeps of a sound configuration.
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

    /// From now on sweeps are only taken; what they set off is left to [`work`](Self::work).
    pub fn defer(&mut self) {
        self.is_deferred = true;
    }

    /// Does a part of what the sweeps set off; false when nothing is left to do.
    pub fn work(&mut self) -> bool {
        self.rooms.work()
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.rooms.has_work()
    }

    /// How it searches.
    pub fn search(&self) -> MapperKind {
        self.search
    }

    /// What was done so far.
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

    /// Memory stays bounded: when full, every second sweep goes, so that what is kept still spans the whole motion.
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

    /// End of the newest sweep taken in, host nanoseconds.
    pub fn newest_sweep_ns(&self) -> Option<i64> {
        self.newest_end_ns
    }

    /// End of the newest sweep that [`scene`](Self::scene) rests on, host nanoseconds: of the last look at a room, or of the
    /// newest sweep where every scene is a search by itself.
    pub fn evidence_ns(&self) -> Option<i64> {
        match self.search {
            MapperKind::Rooms => self.rooms.evidence_ns(),
            MapperKind::Reflectors => self.newest_end_ns,
        }
    }

    /// Places that the last look at a room weighed, for who learns from them.
    pub fn weighed(&self) -> &[ScoredCandidate] {
        self.rooms.scored_candidates()
    }

    /// When an observation to come closes a block: gives that block's sweeps the places that `sensor_at` has for them, which
    /// knows more poses than there were when each came.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        if self.search == MapperKind::Rooms {
            self.rooms.update_poses_before(next, sensor_at);
        }
    }

    /// Takes where the player's own hands are: what is there is no furniture.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.rooms.push_hands(time_ns, hands_m);
    }

    /// What is known of the room, to be kept; nothing where single reflectors are searched.
    pub fn saved_map(&self) -> SavedMap {
        match self.search {
            MapperKind::Rooms => self.rooms.saved_map(),
            MapperKind::Reflectors => SavedMap::default(),
        }
    }

    /// Takes up what is remembered of this room, as provisional; not where single reflectors are searched.
    ///
    /// # Errors
    /// Numbers that are none of a room; nothing is taken up then.
    pub fn restore(&mut self, remembered: &SavedMap) -> Result<(), SavedMapError> {
        match self.search {
            MapperKind::Rooms => self.rooms.restore(remembered),
            MapperKind::Reflectors => remembered.check(),
        }
    }

    /// How long observations are kept, seconds, so that they can get new poses.
    pub fn pose_retention_s(&self) -> f64 {
        match self.search {
            MapperKind::Rooms => self.settings.rooms.explain.window_s + 1.0,
            MapperKind::Reflectors => UNBOUNDED_RETENTION_S,
        }
    }

    /// Gives what is kept the poses of a new time offset; those that have none any more go. `change_s` is how far the
    /// offset moved, `sensor_at` the pose and velocity of a sweep's middle. The search in rooms keeps sums, not sweeps:
    /// when the change ruins them it begins again with the sweeps of its window.
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

    /// Whether such a change of the time offset ruins what the search has summed so far, so that it begins again.
    pub fn is_invalidated_by(&self, change_s: f64) -> bool {
        self.search == MapperKind::Rooms && change_s.abs() >= MAX_HARMLESS_OFFSET_CHANGE_S
    }

    /// No more observations will come: what waits is worked off.
    pub fn finish(&mut self) {
        if self.search == MapperKind::Rooms {
            self.rooms.finish();
        }
    }

    /// The box searched for single reflectors: the settings', else a cube ahead of the first pose.
    pub fn region(&self) -> Aabb {
        self.settings.processing.region.unwrap_or_else(|| cube_ahead(&self.first_pose.unwrap_or(Pose::IDENTITY)))
    }

    /// What stands in the room, as far as seen. For single reflectors this is where the work is done.
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
    /// Where in space there is evidence, the `most` strongest voxels: block scores of 2, which noise reaches, and more; for
    /// single reflectors the excess over noise.
    pub fn evidence(&self, most: usize) -> Evidence {
        let MappingSettings { radar, reflectors, .. } = &self.settings;
        match self.search {
            MapperKind::Rooms => self.rooms.evidence(NOISE_SCORE, most),
            MapperKind::Reflectors => reflector_evidence(&self.kept, &radar.beam, &self.region(), reflectors, most),
        }
    }
}

/// A 3 m cube along the axes whose middle lies 1.5 m ahead of a sensor.
pub fn cube_ahead(tracking_from_sensor: &Pose) -> Aabb {
    let half = DEFAULT_CUBE_M * 0.5;
    let middle = tracking_from_sensor.translation + tracking_from_sensor.forward() * half;
    Aabb { min: middle - DVec3::splat(half), max: middle + DVec3::splat(half) }
}
