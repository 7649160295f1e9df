//! Simulated play session: a furnished room; a player who turns, steps, reaches, crouches and comes
//! near the furniture; the player's hands; a person who crosses the room twice; and a chair that is
//! removed halfway. Gives frames and poses, and the true position of everything at any time.
//!
//! The room has its own axes. The tracking frame is rotated and offset in it, as for a headset set
//! up anywhere. All public coordinates are in the tracking frame.
//!
//! A room is of point scatterers, without multipath and shadows, or of surfaces, with them
//! ([`PlayWorld`]).

mod hands;
mod outline;
mod physical;
mod play_world;
mod player;
mod rooms;
mod visitor;

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};
use num_complex::{Complex, Complex64};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::echoes::{EchoPath, Posture, Walk, walking_cat, walking_person, wearer};
use super::receiver::MovingScatterer;
use super::sampler::{Sampler, Surroundings};
use super::scenario::{default_mount, host_ns};
use super::sensor::{SensorModel, SubsweepOfFrame, unit_amplitude_lsb};
use super::tracker::Tracker;
use super::truth_builder::TruthBuilder;
use super::truth_builder::{IN_BEAM_AMPLITUDE, IN_BEAM_M};
use super::world::World;
use super::{Room, Scatterer, SceneObject, SensorEffects, Simulated, TrackingErrors, WallPanel};
use a121::{ConfigError, Frame, SensorConfig, Subsweep, frame_timing, noise_rms_lsb};
use radar_sar::Beam;
use radar_sar::PoseSample;
use radar_sar::geometry::{Plane, Pose};

use hands::Hands;
use outline::Outline;
use physical::{Movers, PathLimits, PhysicalRoom, frames_per_visibility, truth_room};
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
    /// Whether the session has the player's hands.
    pub hands: bool,
    /// Whether the hands return no echoes; detections at their positions are then coincidental.
    pub hands_without_echo: bool,
    /// Whether a person crosses the room, and in a physical world a pet.
    pub visitor: bool,
    /// The kind of room.
    pub world: PlayWorld,
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
            hands: true,
            hands_without_echo: false,
            visitor: true,
            world: PlayWorld::Points,
            walls_db: 0.0,
            axis_aligned: false,
        }
    }

    /// Generates the room and all motions.
    ///
    /// # Errors
    /// A configuration that breaks a rule, or a duration out of range.
    pub fn prepare(&self) -> Result<Session, SessionError> {
        self.config.validate()?;
        if !(1.0..=3600.0).contains(&self.duration_s) {
            return Err(SessionError::Duration(self.duration_s));
        }
        if !self.effects.is_valid() {
            return Err(SessionError::Effects(self.effects));
        }
        let rng = |salt: u64| ChaCha8Rng::seed_from_u64(self.seed ^ salt);
        let world = self.world.family().map(|family| World::new(family, self.seed));
        let room = world.as_ref().map_or_else(|| self.point_room(&mut rng(0x0F00_0001)), truth_room);
        let outline = world.as_ref().map_or_else(|| Outline::of_walls(&room), |world| Outline::Plan(&world.plan));
        let end_s = self.duration_s + MARGIN_S;
        let player = Player::new(&room, outline, end_s, &mut rng(0x0F00_0002));
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
            sensor: SensorModel::new(&self.config, self.effects, self.seed),
            physical: world.as_ref().map(|world| PhysicalRoom::new(world, self.seed)),
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

    /// Host time of a time in the session, nanoseconds.
    pub fn host_ns(time_s: f64) -> i64 {
        host_ns(time_s)
    }

    /// All objects.
    pub fn things(&self) -> Vec<SessionObject<'_>> {
        let until = |index: usize| if Some(index) == self.removed { self.removed_s } else { f64::INFINITY };
        self.things.iter().enumerate().map(|(n, thing)| SessionObject { thing, until_s: until(n) }).collect()
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

    /// Positions of the parts of the visitor, and of the pet; empty while there is neither.
    pub fn visitor_at(&self, time_s: f64) -> Vec<DVec3> {
        let parts_m: Vec<DVec3> = if self.physical.is_some() {
            let Movers { visitor, pet, .. } = self.movers([time_s; 3]);
            visitor.into_iter().chain(pet).flat_map(|[posture, ..]| posture.joints_m).collect()
        } else {
            let visitor = self.visitor.as_ref().map(|visitor| visitor.scatterers_at(time_s));
            visitor.into_iter().flatten().map(|part| part.position_m).collect()
        };
        parts_m.into_iter().map(|part_m| self.tracking_from_room.transform_point(part_m)).collect()
    }

    /// Whether a point is in the beam, by amplitude and distance.
    pub fn is_in_beam(&self, tracking_from_sensor: &Pose, point: DVec3) -> bool {
        let to = point - tracking_from_sensor.translation;
        let cos = to.normalize_or_zero().dot(tracking_from_sensor.forward());
        to.length() <= IN_BEAM_M && self.play.beam.amplitude(cos) >= IN_BEAM_AMPLITUDE
    }

    /// Number of frames of the session.
    pub fn frame_count(&self) -> u64 {
        let timing = frame_timing(&self.play.config);
        ((self.play.duration_s - timing.frame_s) / timing.frame_period_s).floor().max(0.0) as u64 + 1
    }

    /// Frames by number, computed in parallel; the result does not depend on the number of threads.
    pub fn frames(&self, numbers: std::ops::Range<u64>) -> Vec<Frame> {
        match &self.physical {
            Some(physical) => self.physical_frames(physical, numbers),
            None => numbers.into_par_iter().map(|number| self.point_frame(number)).collect(),
        }
    }

    /// A frame in a room of points.
    fn point_frame(&self, number: u64) -> Frame {
        let PlaySession { config, beam, .. } = &self.play;
        let sampler = Sampler { config, beam, sensor: &self.sensor, rcs_offset_db: 0.0 };
        let start_s = self.start_s(number);
        let mut samples: Vec<Complex<i16>> = Vec::with_capacity(config.points_per_frame());
        let surroundings = |first_s: f64, last_s: f64| self.surroundings(first_s, last_s);
        let data_saturated = sampler.frame(number, start_s, |t| self.sensor_in_room(t), surroundings, &mut samples);
        self.frame(start_s, data_saturated, samples)
    }

    /// Frames in a physical world. Neighbours share what is seen, by their numbers.
    fn physical_frames(&self, physical: &PhysicalRoom, numbers: std::ops::Range<u64>) -> Vec<Frame> {
        let timing = frame_timing(&self.play.config);
        let group = frames_per_visibility(timing.frame_period_s);
        let groups = numbers.start / group..numbers.end.div_ceil(group);
        let frames = groups.into_par_iter().flat_map_iter(|n| {
            let (first, beyond) = ((n * group).max(numbers.start), ((n + 1) * group).min(numbers.end));
            let middle_s = (n as f64 + 0.5) * group as f64 * timing.frame_period_s;
            let removed = middle_s >= self.removed_s;
            let sensor = self.sensor_in_room(middle_s);
            let seen = physical.visibility(removed, &sensor, &self.play.beam, self.path_limits());
            let frame = |number: u64| {
                let start_s = self.start_s(number);
                let times_s = [0.0, 0.5, 1.0].map(|share| start_s + share * timing.frame_s);
                let paths =
                    physical.paths(removed, &seen, &times_s.map(|t| self.sensor_in_room(t)), &self.movers(times_s));
                self.physical_frame(number, &paths)
            };
            (first..beyond).map(frame).collect::<Vec<_>>()
        });
        frames.collect()
    }

    fn physical_frame(&self, number: u64, paths: &[EchoPath]) -> Frame {
        let PlaySession { config, beam, .. } = &self.play;
        let timing = frame_timing(config);
        let start_s = self.start_s(number);
        let sums = config.subsweeps.iter().enumerate().map(|(index, subsweep)| {
            let bias_m = self.sensor.range_bias_m(index);
            let of_frame = SubsweepOfFrame {
                unit_lsb: unit_amplitude_lsb(subsweep, beam),
                ..SubsweepOfFrame::new(subsweep, index, config.sweeps_per_frame, &timing, bias_m)
            };
            of_frame.sum(if self.sensor.hears_echoes(index) { paths } else { &[] })
        });
        let mut sums: Vec<Vec<Vec<Complex64>>> = sums.collect();
        let mut state = self.sensor.frame(number, start_s);
        let mut samples = Vec::with_capacity(config.points_per_frame());
        let mut data_saturated = false;
        for sweep in 0..config.sweeps_per_frame as usize {
            for (index, sums) in sums.iter_mut().enumerate() {
                let time_s = start_s + sweep as f64 * timing.sweep_period_s + timing.subsweeps[index].0;
                data_saturated |= state.convert(index, time_s, std::mem::take(&mut sums[sweep]), &mut samples);
            }
        }
        self.frame(start_s, data_saturated, samples)
    }

    fn start_s(&self, number: u64) -> f64 {
        number as f64 * frame_timing(&self.play.config).frame_period_s
    }

    fn frame(&self, start_s: f64, data_saturated: bool, samples: Vec<Complex<i16>>) -> Frame {
        let end_s = start_s + frame_timing(&self.play.config).frame_s;
        Frame {
            tick: (end_s * 1e6).round() as i64,
            host_time_ns: host_ns(end_s),
            temperature_c: self.sensor.temperature_c(start_s).round() as i16,
            data_saturated,
            frame_delayed: false,
            calibration_needed: false,
            samples,
        }
    }

    /// Paths below a hundredth of the noise, or beyond the last point by the pulse's length, are left
    /// out.
    fn path_limits(&self) -> PathLimits {
        let PlaySession { config, beam, .. } = &self.play;
        let weakest = |subsweep: &Subsweep| 0.01 * noise_rms_lsb(subsweep) / unit_amplitude_lsb(subsweep, beam);
        let farthest_m = |subsweep: &Subsweep| subsweep.last_m() + 1.6 * subsweep.profile.envelope_fwhm_m() + 0.05;
        PathLimits {
            min_amplitude: config.subsweeps.iter().map(weakest).fold(f64::INFINITY, f64::min),
            max_range_m: config.subsweeps.iter().map(farthest_m).fold(0.0, f64::max),
        }
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

    fn surroundings(&self, first_s: f64, last_s: f64) -> Surroundings<'_> {
        let middle_s = 0.5 * (first_s + last_s);
        let room = if middle_s < self.removed_s { &self.before } else { &self.after };
        let [first, middle, last] = [first_s, middle_s, last_s].map(|t| self.moving_at(t));
        // A visitor who arrives or leaves during a sweep is not in it.
        let whole = first.len() == middle.len() && last.len() == middle.len();
        let ways = first.iter().zip(&last).map(|(a, b)| b.position_m - a.position_m);
        let moving = middle.iter().zip(ways).filter(|_| whole);
        Surroundings { room, moving: moving.map(|(&scatterer, way)| MovingScatterer { scatterer, way }).collect() }
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
        let mut tracker = Tracker::new(self.play.errors, self.play.seed);
        let rate_hz = self.play.errors.rate_hz;
        let count = ((self.play.duration_s + 2.0 * MARGIN_S) * rate_hz).floor() as u64 + 1;
        (0..count).map(move |n| {
            let time_s = n as f64 / rate_hz - MARGIN_S;
            tracker.measure(time_s, &self.head_at(time_s)).sample(host_ns)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;

    fn session(seed: u64, duration_s: f64) -> Session {
        PlaySession { duration_s, ..PlaySession::new(preset("d16").unwrap(), seed) }.prepare().unwrap()
    }

    #[test]
    fn same_seed_gives_same_session_on_any_thread_count() {
        let (a, b) = (session(3, 4.0), session(3, 4.0));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(a.frames(100..120), pool.install(|| b.frames(100..120)));
        assert!(a.poses().eq(b.poses()));
        assert_ne!(a.frames(100..101), session(4, 4.0).frames(100..101));
        assert_eq!(a.frame_count(), a.frames(0..a.frame_count()).len() as u64);
    }

    fn physical(world: PlayWorld, seed: u64, duration_s: f64) -> Session {
        let play = PlaySession { duration_s, world, ..PlaySession::new(preset("d16").unwrap(), seed) };
        play.prepare().unwrap()
    }

    #[test]
    fn physical_frames_depend_on_neither_threads_nor_ranges() {
        for world in [PlayWorld::Office, PlayWorld::Dining, PlayWorld::Living] {
            let session = physical(world, 5, 4.0);
            let whole = session.frames(100..110);
            let parts = [session.frames(100..104), session.frames(104..110)].concat();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            assert_eq!(whole, parts);
            assert_eq!(whole, pool.install(|| session.frames(100..110)));
            let noise = noise_rms_lsb(&session.play.config.subsweeps[0]);
            let strongest =
                whole.iter().flat_map(|frame| &frame.samples).map(|s| f64::from(s.re).hypot(f64::from(s.im)));
            assert!(strongest.fold(0.0, f64::max) > 5.0 * noise, "{world:?} is silent");
        }
    }

    #[test]
    fn players_of_physical_worlds_come_near_furniture_and_walk_through_none() {
        for world in [PlayWorld::Office, PlayWorld::Dining, PlayWorld::Living] {
            for seed in 0..4 {
                let session = physical(world, seed, 120.0);
                assert!(session.things().iter().any(|object| object.until_s.is_finite()));
                assert!(session.things().iter().any(|object| object.thing.name == "soft chair"));
                let level = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
                let mut nearest_m = f64::INFINITY;
                for n in 0..1200 {
                    let head = session.player.head_at(f64::from(n) * 0.1).translation;
                    let away = session.before.scatterers().map(|s| level(s.position_m).distance(level(head)));
                    nearest_m = away.fold(nearest_m, f64::min);
                }
                assert!((0.12..0.7).contains(&nearest_m), "{world:?} {seed}: {nearest_m}");
            }
        }
    }

    #[test]
    fn motion_is_continuous_and_avoids_furniture() {
        for seed in 0..4 {
            let session = session(seed, 60.0);
            let parts = |t: f64| session.moving_at(t).iter().map(|s| s.position_m).collect::<Vec<_>>();
            for n in 0..6000 {
                let (t, next) = (f64::from(n) * 0.01, f64::from(n + 1) * 0.01);
                let head = session.player.head_at(t);
                assert!(
                    head.translation.distance(session.player.head_at(next).translation) < 0.03,
                    "seed {seed} at {t}"
                );
                let (now, then) = (parts(t), parts(next));
                if now.len() == then.len() {
                    let step = now.iter().zip(&then).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
                    assert!(step < 0.09, "seed {seed} at {t}: {step}");
                }
                let body = |p: DVec3| DVec3::new(p.x - head.translation.x, 0.0, p.z - head.translation.z).length();
                let nearest = session.before.scatterers().map(|s| body(s.position_m)).fold(f64::INFINITY, f64::min);
                assert!(nearest > 0.15, "seed {seed} at {t}: {nearest}");
            }
        }
    }

    #[test]
    fn player_approaches_furniture_and_visitor_crosses_twice() {
        let session = session(1, 120.0);
        let times: Vec<f64> = (0..1200).map(|n| f64::from(n) * 0.1).collect();
        let level = |a: DVec3, b: DVec3| DVec3::new(a.x - b.x, 0.0, a.z - b.z).length();
        let objects = session.things();
        let near = objects.iter().filter(|session_object| {
            let nearest = |t: &f64| {
                let head = session.head_at(*t).translation;
                session_object.thing.scatterers.iter().map(|s| level(s.position_m, head)).fold(f64::INFINITY, f64::min)
            };
            times.iter().map(nearest).fold(f64::INFINITY, f64::min) < 0.5
        });
        assert!(near.count() >= 3);
        let there: Vec<bool> = times.iter().map(|t| !session.visitor_at(*t).is_empty()).collect();
        assert_eq!(there.windows(2).filter(|w| !w[0] && w[1]).count(), 2);
        let gone = session.things().iter().filter(|session_object| session_object.until_s == 60.0).count();
        assert_eq!(gone, 1);
    }

    #[test]
    fn reported_coordinates_are_the_room_transformed() {
        let session = session(2, 20.0);
        let turned_rad = session.tracking_from_room.rotation.to_scaled_axis();
        assert!(turned_rad.x.hypot(turned_rad.z) < 1e-12 && turned_rad.y.abs() > 0.01, "{turned_rad}");
        for time_s in [0.0, 7.3, 15.0] {
            let (tracked, room) = (session.sensor_at(time_s), session.sensor_in_room(time_s));
            let tracked_scatterers =
                session.things().into_iter().flat_map(|session_object| &session_object.thing.scatterers);
            for (there, here) in tracked_scatterers.zip(session.before.scatterers()) {
                let towards = |from: &Pose, to: &Scatterer| {
                    let way = to.position_m - from.translation;
                    DVec3::new(way.length(), way.normalize().dot(from.forward()), to.rcs_towards_dbsm(-way.normalize()))
                };
                assert!(towards(&tracked, there).distance(towards(&room, here)) < 1e-9);
            }
            for (wall, panel) in session.walls().iter().zip(&session.before.walls) {
                let away_m = wall.plane.distance(tracked.translation);
                assert!((away_m - panel.plane.distance(room.translation)).abs() < 1e-9);
                assert!((wall.distance_m(tracked.translation) - panel.extent.distance(room.translation)).abs() < 1e-9);
            }
        }
    }
}
