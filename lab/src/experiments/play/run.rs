//! Plays sessions through the whole chain: frames and poses into the mapper, its scenes into the
//! warnings, scored against the truth thirty times a second.

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
use radar_simulation::{PlaySession, Session, SessionError};

/// Sessions to play, and the settings to play them with.
#[derive(Debug, Clone)]
pub struct PlayTrial {
    /// The session; its seed is replaced.
    pub session: PlaySession,
    /// The settings, each played with the same frames and poses. Mount and sensor configuration
    /// come from the session.
    pub settings: Vec<Settings>,
    /// Whether the player's controllers are tracked.
    pub controllers: bool,
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

/// Plays one session per seed and returns the figures `[seed][setting]`, in their order. `done` is
/// called when each session is over. The result does not depend on the number of threads.
///
/// # Errors
/// A session that cannot be simulated.
pub fn play(trial: &PlayTrial, seeds: &[u64], done: impl Fn(u64) + Sync) -> Result<Vec<Vec<Figures>>, PlayError> {
    let play_one = |&seed: &u64| -> Result<Vec<Figures>, PlayError> {
        let session = PlaySession { seed, ..trial.session.clone() }.prepare()?;
        let figures = play_session(&session, trial, |_, _| ());
        done(seed);
        Ok(figures)
    };
    seeds.par_iter().map(play_one).collect()
}

/// Plays one session. `on_update` is called after each update of the map of each setting with the
/// time, seconds, and the scored detections.
pub(in crate::experiments) fn for_each_update(
    session: &Session,
    trial: &PlayTrial,
    on_update: impl FnMut(f64, &[ScoredCandidate]),
) {
    play_session(session, trial, on_update);
}

/// The figures of each setting.
fn play_session(
    session: &Session,
    trial: &PlayTrial,
    mut on_update: impl FnMut(f64, &[ScoredCandidate]),
) -> Vec<Figures> {
    let start_ns = Session::host_ns(0.0);
    let end_ns = Session::host_ns(session.play().duration_s);
    let mut players: Vec<Player> = trial.settings.iter().map(|settings| Player::new(session, settings)).collect();
    let mut poses = 0;
    for event in in_time_order(Frames::new(session), session.poses()) {
        let (time_ns, is_pose) = (event.time_ns(), matches!(event, Event::Pose(_)));
        let time_s = (time_ns - start_ns) as f64 * 1e-9;
        let hands_m = session.hands_at(time_s).filter(|_| trial.controllers).map(|hands| hands.map(Some));
        let is_step = is_pose && poses % POSES_PER_STEP == 0 && (start_ns..end_ns).contains(&time_ns);
        for player in &mut players {
            // What is refused is counted.
            if let Some(hands_m) = hands_m.filter(|_| is_pose) {
                let _ = player.mapper.push(Event::hands(time_ns, hands_m));
            }
            let _ = player.mapper.push(event.clone());
            if is_step {
                player.step(time_ns, time_s, hands_m.unwrap_or_default(), &mut on_update);
            }
        }
        poses += usize::from(is_pose);
    }
    players.into_iter().map(Player::end).collect()
}

/// The chain with one setting.
struct Player<'s> {
    settings: &'s Settings,
    mapper: Mapper,
    tracker: WarningTracker,
    scene: Scene,
    evidence_ns: Option<i64>,
    scorer: Scorer<'s>,
}

impl<'s> Player<'s> {
    fn new(session: &'s Session, settings: &'s Settings) -> Self {
        let play = session.play();
        Self {
            settings,
            mapper: Mapper::new(&play.config, &play.head_from_sensor, &settings.mapping()),
            tracker: WarningTracker::new(),
            scene: Scene::default(),
            evidence_ns: None,
            scorer: Scorer::new(session, settings.rooms.tracks.confirm_log_odds),
        }
    }

    fn step(
        &mut self,
        time_ns: i64,
        time_s: f64,
        hands_m: HandsM,
        on_update: &mut impl FnMut(f64, &[ScoredCandidate]),
    ) {
        let evidence_ns = self.mapper.evidence_ns();
        if evidence_ns != self.evidence_ns {
            self.evidence_ns = evidence_ns;
            self.scene = self.mapper.scene();
            self.scorer.note_detections(time_s, self.mapper.scored_candidates());
            on_update(time_s, self.mapper.scored_candidates());
            self.tracker.update(&self.scene);
        }
        let Some((_, tracking_from_head)) = self.mapper.head() else { return };
        let player = Wearer { time_ns, tracking_from_head, hands_m };
        let warnings = self.tracker.warn(&player, &self.settings.warning);
        let shown = self.shown(&warnings);
        self.scorer.step(time_s, &self.scene, &shown);
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

/// A session's frames one by one, simulated some seconds at a time.
struct Frames<'s> {
    session: &'s Session,
    next: u64,
    batch: std::vec::IntoIter<Frame>,
}

impl<'s> Frames<'s> {
    fn new(session: &'s Session) -> Self {
        Self { session, next: 0, batch: Vec::new().into_iter() }
    }

    fn simulate(&mut self) -> Option<Frame> {
        let batch = (BATCH_S / frame_timing(&self.session.play().config).frame_period_s).ceil() as u64;
        let until = (self.next + batch).min(self.session.frame_count());
        self.batch = self.session.frames(self.next..until).into_iter();
        self.next = until;
        self.batch.next()
    }
}

impl Iterator for Frames<'_> {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        self.batch.next().or_else(|| self.simulate())
    }
}
