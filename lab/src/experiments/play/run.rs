//! Plays sessions through the whole chain: frames and poses into the mapper, its scenes into the
//! warnings, scored against the truth thirty times a second.

use std::iter::Peekable;

use radar_mapping::{Event, in_time_order};
use rayon::prelude::*;

use super::figures::Figures;
use super::scorer::Scorer;
use super::target::ShownWarnings;
use a121::{Frame, frame_timing};
use radar_chaperone::settings::Settings;
use radar_chaperone::warning::{PanelKind, WarningTracker, Warnings, Wearer};
use radar_mapping::Mapper;
use radar_mapping::{HandsM, Scene, ScoredCandidate};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_simulation::{PlaySession, Session, SessionError, TrackingErrors};

/// Sessions to play, and who plays them.
#[derive(Debug, Clone)]
pub struct PlayTrial {
    /// The session; its seed is replaced.
    pub session: PlaySession,
    /// Each plays every session, with the same sweeps and the same true motion.
    pub players: Vec<PlayerSetup>,
    /// Whether the players' controllers are tracked.
    pub controllers: bool,
}

/// The program and the headset that a session is played with.
#[derive(Debug, Clone)]
pub struct PlayerSetup {
    /// Mount and sensor configuration come from the session.
    pub settings: Settings,
    /// Errors of the headset's tracking; that of the mount comes from the session.
    pub tracking: TrackingErrors,
}

/// Why there are no figures.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The session cannot be simulated.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// Duration of frames simulated at a time, seconds. Choice: bounds memory; each batch simulates in
/// parallel.
const BATCH_S: f64 = 4.0;
/// Poses between two scoring steps: 30 steps per second. Choice: 30 steps a second at 120 poses, 4
/// cm at walking speed.
const POSES_PER_STEP: usize = 4;

/// Plays one session per seed and returns the figures `[seed][player]`, in their order. `done` is
/// called when each session is over. The result does not depend on the number of threads.
///
/// # Errors
/// A session that cannot be simulated.
pub fn play(trial: &PlayTrial, seeds: &[u64], done: impl Fn(u64) + Sync) -> Result<Vec<Vec<Figures>>, PlayError> {
    let play_one = |&seed: &u64| -> Result<Vec<Figures>, PlayError> {
        let session = PlaySession { seed, ..trial.session.clone() }.prepare()?;
        let mut players = players(&session, trial);
        for frames in batches(&session) {
            players.par_iter_mut().for_each(|player| player.play(&frames, |_, _| ()));
        }
        done(seed);
        Ok(players.into_iter().map(Player::end).collect())
    };
    seeds.par_iter().map(play_one).collect()
}

/// Plays one session. `on_update` is called after each update of each player's map with the time,
/// seconds, and the scored detections.
pub(in crate::experiments) fn for_each_update(
    session: &Session,
    trial: &PlayTrial,
    mut on_update: impl FnMut(f64, &[ScoredCandidate]),
) {
    let mut players = players(session, trial);
    for frames in batches(session) {
        players.iter_mut().for_each(|player| player.play(&frames, &mut on_update));
    }
}

fn players<'s>(session: &'s Session, trial: &'s PlayTrial) -> Vec<Player<'s>> {
    trial.players.iter().map(|setup| Player::new(session, setup, trial.controllers)).collect()
}

/// A session's frames, simulated some seconds at a time.
fn batches(session: &Session) -> impl Iterator<Item = Vec<Frame>> + '_ {
    let batch = (BATCH_S / frame_timing(&session.play().config).frame_period_s).ceil() as usize;
    let count = session.frame_count();
    (0..count).step_by(batch).map(move |first| session.frames(first..(first + batch as u64).min(count)))
}

/// The chain with one setting and one headset.
struct Player<'s> {
    session: &'s Session,
    settings: &'s Settings,
    controllers: bool,
    /// Poses to come, each with where the tracking frame is.
    poses: Peekable<Box<dyn Iterator<Item = (PoseSample, Pose)> + Send + 's>>,
    /// When the tracking frame jumped, and `tracked_from_true` from then on.
    frames: Vec<(i64, Pose)>,
    taken_poses: usize,
    /// How often the tracking frame had jumped at the last scene.
    tracking_jumps: u64,
    mapper: Mapper,
    tracker: WarningTracker,
    scene: Scene,
    evidence_ns: Option<i64>,
    scorer: Scorer<'s>,
}

impl<'s> Player<'s> {
    fn new(session: &'s Session, setup: &'s PlayerSetup, controllers: bool) -> Self {
        let (play, settings) = (session.play(), &setup.settings);
        let poses: Box<dyn Iterator<Item = (PoseSample, Pose)> + Send + 's> =
            Box::new(session.tracked_with(setup.tracking));
        Self {
            session,
            settings,
            controllers,
            poses: poses.peekable(),
            frames: vec![(i64::MIN, Pose::IDENTITY)],
            taken_poses: 0,
            tracking_jumps: 0,
            mapper: Mapper::new(&play.config, &play.head_from_sensor, &settings.mapping()),
            tracker: WarningTracker::new(),
            scene: Scene::default(),
            evidence_ns: None,
            scorer: Scorer::new(session, settings.rooms.tracks.confirm_log_odds),
        }
    }

    /// Takes the next frames and the poses up to the last of them.
    fn play(&mut self, frames: &[Frame], mut on_update: impl FnMut(f64, &[ScoredCandidate])) {
        let Some(until_ns) = frames.last().map(|frame| frame.host_time_ns) else { return };
        let tracked = std::iter::from_fn(|| self.poses.next_if(|(pose, _)| pose.time_ns <= until_ns));
        let mut poses = Vec::new();
        for (pose, tracked_from_true) in tracked {
            if self.frames.last().is_none_or(|(_, last)| *last != tracked_from_true) {
                self.frames.push((pose.time_ns, tracked_from_true));
            }
            poses.push(pose);
        }
        for event in in_time_order(frames.iter().cloned(), poses) {
            self.take(event, &mut on_update);
        }
    }

    fn tracked_from_true(&self, time_ns: i64) -> Pose {
        let later = self.frames.partition_point(|(from_ns, _)| *from_ns <= time_ns);
        self.frames[later.saturating_sub(1)].1
    }

    fn take(&mut self, event: Event, on_update: &mut impl FnMut(f64, &[ScoredCandidate])) {
        let (time_ns, is_pose) = (event.time_ns(), matches!(event, Event::Pose(_)));
        let start_ns = Session::host_ns(0.0);
        let time_s = (time_ns - start_ns) as f64 * 1e-9;
        let tracked_from_true = self.tracked_from_true(time_ns);
        let hands_m = self.session.hands_at(time_s).filter(|_| self.controllers);
        let hands_m = hands_m.map(|hands| hands.map(|hand_m| Some(tracked_from_true.transform_point(hand_m))));
        // What is refused is counted.
        if let Some(hands_m) = hands_m.filter(|_| is_pose) {
            let _ = self.mapper.push(Event::hands(time_ns, hands_m));
        }
        let _ = self.mapper.push(event);
        if is_pose && self.taken_poses.is_multiple_of(POSES_PER_STEP) && time_ns >= start_ns {
            self.step(time_ns, time_s, hands_m.unwrap_or_default(), on_update);
        }
        self.taken_poses += usize::from(is_pose);
    }

    fn step(
        &mut self,
        time_ns: i64,
        time_s: f64,
        hands_m: HandsM,
        on_update: &mut impl FnMut(f64, &[ScoredCandidate]),
    ) {
        let true_from_tracked = self.tracked_from_true(time_ns).inverse();
        if let Some(scene) = self.mapper.poll_scene() {
            self.scene = scene;
            let jumps = self.mapper.tracking_jumps();
            if std::mem::replace(&mut self.tracking_jumps, jumps) != jumps {
                self.tracker.change_frame();
            }
            self.tracker.update(&self.scene);
        }
        let evidence_ns = self.mapper.evidence_ns();
        if evidence_ns != self.evidence_ns {
            self.evidence_ns = evidence_ns;
            let mut scored = self.mapper.scored_candidates();
            scored.iter_mut().for_each(|one| one.position_m = true_from_tracked.transform_point(one.position_m));
            self.scorer.note_detections(time_s, &scored);
            on_update(time_s, &scored);
        }
        let Some((_, tracking_from_head)) = self.mapper.head() else { return };
        let player = Wearer { time_ns, tracking_from_head, hands_m };
        let warnings = self.tracker.warn(&player, &self.settings.warning);
        // Scored as the wearer sees it: relative to the head, wherever the tracking frame is.
        let shown = self.shown(&warnings).moved(&true_from_tracked);
        self.scorer.step(time_s, &self.scene.moved(&true_from_tracked), &shown);
    }

    fn shown(&self, warnings: &Warnings) -> ShownWarnings {
        let shapes = self.tracker.shapes(warnings);
        let walls = warnings.panels.iter().filter(|panel| panel.kind == PanelKind::Wall);
        let plane = |panel: &radar_chaperone::warning::Panel| {
            self.scene.walls.iter().find(|wall| wall.id == panel.id).map(|wall| wall.plane)
        };
        ShownWarnings {
            points_m: shapes.iter().flat_map(|shape| shape.points_m.iter().copied()).collect(),
            planes: walls.filter_map(plane).collect(),
        }
    }

    fn end(self) -> Figures {
        let reports = self.scene.obstacles.len();
        self.scorer.end(reports)
    }
}
