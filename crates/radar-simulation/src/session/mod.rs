//! Simulated play session: a furnished room; a player who turns, steps, reaches, crouches and comes
//! near the furniture; the player's hands; a person who crosses the room twice; and a chair that is
//! removed halfway. Gives frames and poses, and the true position of everything at any time.
//!
//! The room has its own axes. The tracking frame is rotated and offset in it, as for a headset set
//! up anywhere. All public coordinates are in the tracking frame.
//!
//! A room is of point scatterers, without multipath and shadows, or of surfaces, with them
//! ([`PlayWorld`]).

mod frames;
mod hands;
mod illumination;
mod outline;
mod physical;
mod play_world;
mod player;
mod rooms;
#[cfg(test)]
mod session_tests;
mod visitor;

use std::f64::consts::TAU;
use std::sync::Arc;

use super::echoes::{DiffuseEchoes, Posture, Walk, walking_cat, walking_person, wearer};
use super::scenario::{default_mount, host_ns};
use super::sensor::SensorModel;
use super::tracker::Tracker;
use super::truth_builder::TruthBuilder;
use super::world::World;
use super::{RecordedSensor, Room, Scatterer, SceneObject, SensorEffects, Simulated, TrackingErrors, WallPanel};
use a121::{ConfigError, SensorConfig};
use glam::{DQuat, DVec3};
use radar_sar::Beam;
use radar_sar::PoseSample;
use radar_sar::geometry::{Plane, Pose};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use hands::Hands;
use outline::Outline;
use physical::{Movers, PhysicalRoom, truth_room};
pub use play_world::{PlayWorld, PlayWorldError};
use player::Player;
use rooms::play_room;
use visitor::{CAT, PERSON, Visitor};

/// Parameters of a play session.
#[derive(Debug, Clone)]
pub struct PlaySession {
    /// Length, seconds.
    pub duration_s: f64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Configuration of the sensor.
    pub config: SensorConfig,
    /// Beam of the sensor.
    pub beam: Beam,
    /// Assumed pose of the sensor on the head (mount).
    pub head_from_sensor: Pose,
    /// Errors of the tracking.
    pub errors: TrackingErrors,
    /// Imperfections of the sensor.
    pub effects: SensorEffects,
    /// Jitter and noise of a real sensor instead of the model's.
    pub recorded: Option<Arc<RecordedSensor>>,
    /// Whether the session has the player's hands.
    pub hands: bool,
    /// Whether the hands return no echoes; detections at their positions are then coincidental.
    pub hands_without_echo: bool,
    /// Whether a person crosses the room, and in a physical world a pet.
    pub visitor: bool,
    /// The kind of room.
    pub world: PlayWorld,
    /// The diffuse echoes in a physical world.
    pub diffuse: DiffuseEchoes,
    /// Offset added to the walls' reflection in a room of points, dB.
    pub walls_db: f64,
    /// Whether the tracking frame is aligned with the walls and centred on the floor.
    pub axis_aligned: bool,
}

/// Why a session cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The configuration breaks a rule of the sensor.
    #[error("sensor configuration: {0}")]
    Config(#[from] ConfigError),
    /// A strength of an effect out of range.
    #[error("sensor effects {0:?} cannot be simulated: give strengths from 0 to 100")]
    Effects(SensorEffects),
    /// Spacing or level out of range.
    #[error("diffuse echoes {0:?} cannot be simulated: give spacings of 0.25 to 4 and levels of -40 to 40 dB")]
    Diffuse(DiffuseEchoes),
    /// Duration out of range.
    #[error("a session of {0} s cannot be simulated: give 1 to 3600 s")]
    Duration(f64),
}

/// Poses start before the session and end after it by this time, seconds. Choice: the smoothing of
/// the poses and the time offset need poses on both sides.
const MARGIN_S: f64 = 0.2;

impl PlaySession {
    /// A session of ten minutes with hands and visitor, default tracking and mount, and the
    /// lensless beam.
    pub fn new(config: SensorConfig, seed: u64) -> Self {
        Self {
            duration_s: 600.0,
            seed,
            config,
            beam: Beam::Lensless,
            head_from_sensor: default_mount(),
            errors: TrackingErrors::default(),
            effects: SensorEffects::NONE,
            recorded: None,
            hands: true,
            hands_without_echo: false,
            visitor: true,
            world: PlayWorld::Points,
            diffuse: DiffuseEchoes::default(),
            walls_db: 0.0,
            axis_aligned: false,
        }
    }

    /// Generates the room and all motions.
    ///
    /// # Errors
    /// A configuration that breaks a rule, or a duration, a strength or a level out of range.
    pub fn prepare(&self) -> Result<Session, SessionError> {
        self.config.validate()?;
        if !(1.0..=3600.0).contains(&self.duration_s) {
            return Err(SessionError::Duration(self.duration_s));
        }
        if !self.effects.is_valid() {
            return Err(SessionError::Effects(self.effects));
        }
        if !self.diffuse.is_valid() {
            return Err(SessionError::Diffuse(self.diffuse));
        }
        let rng = |salt: u64| ChaCha8Rng::seed_from_u64(self.seed ^ salt);
        let world = self.world.family().map(|family| World::new(family, self.seed));
        let room = world.as_ref().map_or_else(|| self.point_room(&mut rng(0x0F00_0001)), truth_room);
        let outline = world.as_ref().map_or_else(|| Outline::of_walls(&room), |world| Outline::Plan(&world.plan));
        let end_s = self.duration_s + MARGIN_S;
        let player_rng = &mut rng(0x0F00_0002);
        let player = match self.world {
            PlayWorld::Corner => Player::in_corner(outline.inner_half_m(), end_s, player_rng),
            _ => Player::new(&room, outline, end_s, player_rng),
        };
        let hands = self.hands.then(|| Hands::new(end_s, &mut rng(0x0F00_0003)));
        let half_m = outline.inner_half_m();
        let crossing = |gait, salt| Visitor::new(gait, &room, half_m, &player, self.duration_s, &mut rng(salt));
        let visitor = self.visitor.then(|| crossing(PERSON, 0x0F00_0004));
        let pet = world.as_ref().filter(|_| self.visitor).map(|_| crossing(CAT, 0x0F00_0006));
        let removed = room.things.iter().position(|object| object.name == REMOVED_CHAIR);
        let mut after = room.clone();
        removed.map(|index| after.things.remove(index));
        let random = random_tracking_from_room(&mut rng(0x0F00_0005));
        let tracking_from_room = if self.axis_aligned { Pose::IDENTITY } else { random };
        Ok(Session {
            things: room.things.iter().map(|object| object.moved(&tracking_from_room)).collect(),
            walls: room.walls.iter().map(|panel| SessionWall::new(panel, &tracking_from_room)).collect(),
            tracking_from_room,
            removed_s: 0.5 * self.duration_s,
            true_mount: self.errors.true_mount(&self.head_from_sensor, self.seed),
            sensor: SensorModel::new(&self.config, self.effects, self.seed).with_recorded(self.recorded.clone()),
            physical: world.as_ref().map(|world| PhysicalRoom::new(world, &self.diffuse, self.seed)),
            play: self.clone(),
            before: room,
            after,
            removed,
            player,
            hands,
            visitor,
            pet,
        })
    }
}

impl PlaySession {
    fn point_room(&self, rng: &mut ChaCha8Rng) -> Room {
        let mut room = play_room(rng);
        room.walls.iter_mut().for_each(|wall| wall.reflection_db += self.walls_db);
        room
    }
}

/// A cat on its walk.
fn cat(walk: &Walk) -> Posture {
    walking_cat(walk.at_m, walk.facing, walk.stride_phase_rad)
}

/// A random `tracking_from_room`: rotated about the vertical only, since headsets are level with
/// the floor.
fn random_tracking_from_room(rng: &mut ChaCha8Rng) -> Pose {
    let mut off_m = || rng.random_range(-0.5..0.5);
    let translation = DVec3::new(off_m(), 0.0, off_m());
    Pose::new(translation, DQuat::from_rotation_y(rng.random_range(0.0..TAU)))
}

/// Name of the object that is removed halfway.
const REMOVED_CHAIR: &str = "chair to be removed";

/// An object in the room, and its time of removal.
#[derive(Debug, Clone, Copy)]
pub struct SessionObject<'s> {
    /// The object.
    pub thing: &'s SceneObject,
    /// Time of its removal, seconds; infinite if it stays.
    pub until_s: f64,
}

/// A wall, floor or ceiling of the room.
#[derive(Debug, Clone)]
pub struct SessionWall {
    /// Its plane; the normal points out of the room.
    pub plane: Plane,
    panel: WallPanel,
    room_from_tracking: Pose,
}

impl SessionWall {
    fn new(panel: &WallPanel, tracking_from_room: &Pose) -> Self {
        let plane = panel.plane.moved(tracking_from_room);
        Self { plane, panel: panel.clone(), room_from_tracking: tracking_from_room.inverse() }
    }

    /// Distance from a point to the wall's extent, metres.
    pub fn distance_m(&self, point: DVec3) -> f64 {
        self.panel.extent.distance(self.room_from_tracking.transform_point(point))
    }
}

/// A session with its room and motions generated.
#[derive(Debug, Clone)]
pub struct Session {
    play: PlaySession,
    tracking_from_room: Pose,
    things: Vec<SceneObject>,
    walls: Vec<SessionWall>,
    before: Room,
    after: Room,
    removed: Option<usize>,
    removed_s: f64,
    true_mount: Pose,
    sensor: SensorModel,
    /// What returns echoes in a physical world.
    physical: Option<PhysicalRoom>,
    player: Player,
    hands: Option<Hands>,
    visitor: Option<Visitor>,
    pet: Option<Visitor>,
}

impl Session {
    /// Parameters of the session.
    pub fn play(&self) -> &PlaySession {
        &self.play
    }

    /// Measured minus true range of a subsweep, metres.
    pub fn range_bias_m(&self, subsweep: usize) -> f64 {
        self.sensor.range_bias_m(subsweep)
    }

    /// Host time of a time in the session, nanoseconds.
    pub fn host_ns(time_s: f64) -> i64 {
        host_ns(time_s)
    }

    /// All objects.
    pub fn things(&self) -> Vec<SessionObject<'_>> {
        let until = |index: usize| if Some(index) == self.removed { self.removed_s } else { f64::INFINITY };
        self.things.iter().enumerate().map(|(n, thing)| SessionObject { thing, until_s: until(n) }).collect()
    }

    /// Distance from a point, tracking frame, to an object, metres: to its surfaces, in a room of points to its nearest
    /// scatterer. `object` is its index in [`Self::things`].
    pub fn distance_to_m(&self, object: usize, point: DVec3) -> f64 {
        let Some(physical) = &self.physical else {
            let parts = self.things[object].scatterers.iter();
            return parts.map(|part| part.position_m.distance(point)).fold(f64::INFINITY, f64::min);
        };
        physical.distance_m(object, self.tracking_from_room.inverse().transform_point(point))
    }

    /// Walls, floor and ceiling.
    pub fn walls(&self) -> &[SessionWall] {
        &self.walls
    }

    /// True `tracking_from_head`.
    pub fn head_at(&self, time_s: f64) -> Pose {
        self.tracking_from_room * self.player.head_at(time_s)
    }

    /// True `tracking_from_sensor`.
    pub fn sensor_at(&self, time_s: f64) -> Pose {
        self.head_at(time_s) * self.true_mount
    }

    /// True positions of the left and right palm; `None` in a session without hands.
    pub fn hands_at(&self, time_s: f64) -> Option<[DVec3; 2]> {
        let palms = self.hands.as_ref()?.palms_at(&self.player, time_s);
        Some(palms.map(|palm| self.tracking_from_room.transform_point(palm)))
    }

    /// Positions of the parts of the visitor; empty while there is none.
    pub fn visitor_at(&self, time_s: f64) -> Vec<DVec3> {
        let Some(visitor) = &self.visitor else { return Vec::new() };
        let parts_m = if self.physical.is_some() {
            visitor.walk_at(time_s).map_or_else(Vec::new, |walk| walking_person(&walk).joints_m)
        } else {
            visitor.scatterers_at(time_s).into_iter().map(|part| part.position_m).collect()
        };
        self.in_tracking_frame(parts_m)
    }

    /// Positions of the parts of the pet; empty while there is none, as always in a room of point scatterers.
    pub fn pet_at(&self, time_s: f64) -> Vec<DVec3> {
        let walk = self.pet.as_ref().and_then(|pet| pet.walk_at(time_s));
        self.in_tracking_frame(walk.map_or_else(Vec::new, |walk| cat(&walk).joints_m))
    }

    fn in_tracking_frame(&self, points_m: Vec<DVec3>) -> Vec<DVec3> {
        points_m.into_iter().map(|point_m| self.tracking_from_room.transform_point(point_m)).collect()
    }

    /// Those who move, at three times; one who arrives or leaves between them is not there.
    fn movers(&self, times_s: [f64; 3]) -> Movers {
        let postures = |visitor: &Option<Visitor>, posture: fn(&Walk) -> Posture| {
            let walks = times_s.map(|t| visitor.as_ref()?.walk_at(t));
            let [Some(first), Some(middle), Some(last)] = walks else { return None };
            Some([first, middle, last].map(|walk| posture(&walk)))
        };
        Movers {
            wearer: self.wearer_postures(times_s),
            visitor: postures(&self.visitor, walking_person),
            pet: postures(&self.pet, cat),
        }
    }

    /// The wearer at three times, if their body returns echoes.
    fn wearer_postures(&self, times_s: [f64; 3]) -> Option<[Posture; 3]> {
        let hands = self.hands.as_ref().filter(|_| !self.play.hands_without_echo)?;
        Some(times_s.map(|t| {
            let palms_m = hands.palms_at(&self.player, t);
            wearer(&self.player.head_at(t), hands.facing_at(&self.player, t), palms_m)
        }))
    }

    /// True `room_from_sensor`.
    fn sensor_in_room(&self, time_s: f64) -> Pose {
        self.player.head_at(time_s) * self.true_mount
    }

    fn moving_at(&self, time_s: f64) -> Vec<Scatterer> {
        let hands = self
            .hands
            .as_ref()
            .filter(|_| !self.play.hands_without_echo)
            .map(|hands| hands.scatterers_at(&self.player, time_s));
        let visitor = self.visitor.as_ref().map(|visitor| visitor.scatterers_at(time_s));
        hands.into_iter().flatten().chain(visitor.into_iter().flatten()).collect()
    }

    /// The whole session as a recording, for an axis-aligned tracking frame; the removed object is
    /// not in its truth.
    pub fn recorded(&self) -> Simulated {
        let PlaySession { seed, duration_s, beam, .. } = &self.play;
        let known = TruthBuilder { title: "play-room, play".into(), seed: *seed, duration_s: *duration_s, beam };
        let truth = known.build(&self.after, |t| self.head_at(t), |t| self.sensor_at(t));
        Simulated { frames: self.frames(0..self.frame_count()), poses: self.poses().collect(), truth }
    }

    /// The tracked poses of the head.
    pub fn poses(&self) -> impl Iterator<Item = PoseSample> + '_ {
        self.poses_tracked_with(self.play.errors)
    }

    /// The same head as another headset tracks it. The sensor's mount remains that of the session's own errors.
    pub fn poses_tracked_with(&self, errors: TrackingErrors) -> impl Iterator<Item = PoseSample> + '_ {
        self.tracked_with(errors).map(|(pose, _)| pose)
    }

    /// The poses of [`Self::poses_tracked_with`], each with where the tracking frame is: `tracked_from_true`, without jitter,
    /// drift and distortion.
    pub fn tracked_with(&self, errors: TrackingErrors) -> impl Iterator<Item = (PoseSample, Pose)> + '_ {
        let mut tracker = Tracker::new(errors, self.play.seed);
        let rate_hz = errors.rate_hz;
        let count = ((self.play.duration_s + 2.0 * MARGIN_S) * rate_hz).floor() as u64 + 1;
        (0..count).map(move |n| {
            let time_s = n as f64 / rate_hz - MARGIN_S;
            let pose = tracker.measure(time_s, &self.head_at(time_s)).sample(host_ns);
            (pose, tracker.frame())
        })
    }
}
