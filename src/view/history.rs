//! What was known when: every look's scene, the evidence, the head's way, in memory that is bounded. Going back in it shows what
//! was known then.
//!
//! Kept at most: 4096 scenes with their counters (17 minutes at four looks a second), 128 images of the evidence of 20 000 voxels
//! each (41 MB), 16 384 poses of the head, the times of a million frames, 1024 marks. When one is full, every second entry goes,
//! and from then on entries are kept as seldom.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;

use super::decimated_series::DecimatedSeries;
use super::player::Extent;
use radar_mapping::Counters;
use radar_mapping::{Evidence, Scene};
use radar_sar::TimeOffset;
use radar_sar::geometry::{Aabb, Pose};

/// Scenes kept at most.
const SCENES: usize = 4096;
/// Images of the evidence kept at most, and voxels of each.
const IMAGES: usize = 128;
/// See `IMAGES`.
pub const VOXELS: usize = 20_000;
/// Poses of the head kept at most.
const HEADS: usize = 16_384;
/// Times of frames kept at most.
const FRAMES: usize = 1 << 20;
/// Obstacles whose first time is kept at most.
const MARKS: usize = 1024;

/// What was taken, left out and done until then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// The pipeline's own.
    pub counters: Counters,
    /// The time offset in force, seconds.
    pub time_offset_s: f64,
    /// The last estimate of it.
    pub estimate: Option<TimeOffset>,
}

/// An obstacle is there for the first time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    /// When, host nanoseconds.
    pub time_ns: i64,
    /// Which.
    pub id: u64,
}

/// What was known at one time.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Seconds from the beginning.
    pub time_s: f64,
    /// What stood in the room, as far as seen.
    pub scene: Arc<Scene>,
    /// Where there was evidence.
    pub evidence: Arc<Evidence>,
    /// The head.
    pub head: Option<Pose>,
    /// Where the head was before, oldest first: seconds from the beginning, and places in metres.
    pub path: Vec<(f64, DVec3)>,
    /// What was taken, left out and done.
    pub health: Option<Health>,
}

/// Everything that was known, over time.
#[derive(Debug)]
pub struct History {
    updates: DecimatedSeries<(Arc<Scene>, Health)>,
    evidence: DecimatedSeries<Arc<Evidence>>,
    heads: DecimatedSeries<Pose>,
    frames: DecimatedSeries<()>,
    marks: Vec<Mark>,
    known: BTreeSet<u64>,
    heads_around: Option<Aabb>,
    greatest_score: f32,
    expected_s: f64,
    is_complete: bool,
}

impl History {
    /// Empty; `expected_s`: how long the recording says it is.
    pub fn new(expected_s: f64) -> Self {
        Self {
            updates: DecimatedSeries::new(SCENES),
            evidence: DecimatedSeries::new(IMAGES),
            heads: DecimatedSeries::new(HEADS),
            frames: DecimatedSeries::new(FRAMES),
            marks: Vec::new(),
            known: BTreeSet::new(),
            heads_around: None,
            greatest_score: 0.0,
            expected_s: if expected_s.is_finite() { expected_s.max(0.0) } else { 0.0 },
            is_complete: false,
        }
    }

    /// The head is here now. Times only rise.
    pub fn push_head(&mut self, time_ns: i64, head: Pose) {
        if self.heads.last().is_none_or(|last| time_ns > last.0) {
            self.heads.push(time_ns, head);
            let before = self.heads_around.into_iter().flat_map(|around| [around.min, around.max]);
            self.heads_around = Aabb::around(before.chain([head.translation]));
        }
    }

    /// A frame ended.
    pub fn push_frame(&mut self, time_ns: i64) {
        if self.frames.last().is_none_or(|last| time_ns > last.0) {
            self.frames.push(time_ns, ());
        }
    }

    /// This is known from now on.
    pub fn push_update(&mut self, time_ns: i64, scene: Scene, health: Health) {
        let new = scene.obstacles.iter().map(|obstacle| obstacle.id).filter(|id| !self.known.contains(id));
        let new: Vec<u64> = new.take(MARKS.saturating_sub(self.marks.len())).collect();
        self.marks.extend(new.iter().map(|&id| Mark { time_ns, id }));
        self.known.extend(new);
        // As it was before: the same scene again costs nothing.
        let same = self.updates.last().map(|last| Arc::clone(&last.1.0)).filter(|last| **last == scene);
        self.updates.push(time_ns, (same.unwrap_or_else(|| Arc::new(scene)), health));
    }

    /// There is this evidence from now on.
    pub fn push_evidence(&mut self, time_ns: i64, evidence: impl Into<Arc<Evidence>>) {
        let evidence = evidence.into();
        self.greatest_score = evidence.voxels.first().map_or(0.0, |voxel| voxel.1).max(self.greatest_score);
        self.evidence.push(time_ns, evidence);
    }

    /// Nothing more will come.
    pub fn complete(&mut self) {
        self.is_complete = true;
    }

    /// The greatest score that any evidence had so far: the end of the colour scale.
    pub fn greatest_score(&self) -> f32 {
        self.greatest_score
    }

    /// The box around all places of the head so far.
    pub fn heads_around(&self) -> Option<Aabb> {
        self.heads_around
    }

    /// Where the recording begins, host nanoseconds.
    fn start_ns(&self) -> i64 {
        let firsts = [self.heads.first().map(|h| h.0), self.frames.first().map(|f| f.0)];
        firsts.into_iter().flatten().min().unwrap_or(0)
    }

    fn end_ns(&self) -> i64 {
        let lasts = [self.heads.last().map(|h| h.0), self.frames.last().map(|f| f.0), self.updates.last().map(|l| l.0)];
        lasts.into_iter().flatten().max().unwrap_or(0)
    }

    fn seconds(&self, time_ns: i64) -> f64 {
        time_ns.saturating_sub(self.start_ns()) as f64 * 1e-9
    }

    fn nanoseconds(&self, time_s: f64) -> i64 {
        self.start_ns().saturating_add((time_s * 1e9).round() as i64)
    }

    /// How much there is.
    pub fn extent(&self) -> Extent {
        let buffered_s = self.seconds(self.end_ns());
        let duration_s = if self.is_complete { buffered_s } else { buffered_s.max(self.expected_s) };
        Extent { buffered_s, duration_s, is_complete: self.is_complete }
    }

    /// When obstacles were first there: seconds from the beginning, and which.
    pub fn marks(&self) -> impl Iterator<Item = (f64, u64)> {
        self.marks.iter().map(|mark| (self.seconds(mark.time_ns), mark.id))
    }

    /// End of the frame before (−1) or after (+1) a time, seconds from the beginning.
    pub fn adjacent_frame(&self, time_s: f64, way: i32) -> Option<f64> {
        let time_ns = self.nanoseconds(time_s);
        let frame = if way < 0 { self.frames.before(time_ns) } else { self.frames.after(time_ns) };
        frame.map(|frame| self.seconds(frame.0))
    }

    /// What was known at a time, with at most `path_points` places of the head before.
    pub fn moment(&self, time_s: f64, path_points: usize) -> Moment {
        let time_ns = self.nanoseconds(time_s);
        let look = self.updates.at(time_ns).map(|look| &look.1);
        let heads = self.heads.until(time_ns);
        let step = heads.len().div_ceil(path_points.max(2)).max(1);
        // Always the same ones, whatever the time: a path that grows does not flicker.
        let path = heads.iter().step_by(step.next_power_of_two()).chain(heads.last());
        Moment {
            time_s,
            scene: look.map(|look| Arc::clone(&look.0)).unwrap_or_default(),
            evidence: self.evidence.at(time_ns).map(|evidence| Arc::clone(&evidence.1)).unwrap_or_default(),
            head: heads.last().map(|head| head.1),
            path: path.map(|(time_ns, head)| (self.seconds(*time_ns), head.translation)).collect(),
            health: look.map(|look| look.1),
        }
    }
}

#[cfg(test)]
mod tests {
    use radar_mapping::MappingSettings;

    use super::*;
    use a121::preset;
    use glam::DMat3;
    use radar_mapping::Pipeline;
    use radar_mapping::{Observed, Obstacle};

    fn health() -> Health {
        let pipeline = Pipeline::new(&preset("d16").unwrap(), &Pose::IDENTITY, &MappingSettings::default());
        Health { counters: pipeline.counters(), time_offset_s: 0.0, estimate: None }
    }

    fn scene(time_ns: i64, ids: &[u64]) -> Scene {
        let obstacle = |id: &u64| Obstacle {
            id: *id,
            position_m: DVec3::X * *id as f64,
            covariance_m2: DMat3::IDENTITY,
            observed: Observed::Position,
            extent_m: DVec3::ONE,
            evidence: 5.0,
            shape: vec![],
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: time_ns,
        };
        Scene { time_ns, obstacles: ids.iter().map(obstacle).collect(), walls: vec![], moving: vec![] }
    }

    const MS: i64 = 1_000_000;

    /// Ten seconds at 10 poses and 4 looks a second; calls `after` whenever something came.
    fn filled(mut after: impl FnMut(&History)) -> History {
        let mut history = History::new(12.0);
        for tick in 0..=100 {
            let time_ns = 77_000 * MS + tick * 100 * MS;
            history.push_head(time_ns, Pose::from_translation(DVec3::X * tick as f64));
            history.push_frame(time_ns + 50 * MS);
            if tick % 3 == 0 {
                let ids: Vec<u64> = (0..tick as u64 / 20).collect();
                history.push_update(time_ns, scene(time_ns, &ids), health());
                history
                    .push_evidence(time_ns, Evidence { voxel_m: 0.05, voxels: vec![(glam::Vec3::ZERO, tick as f32)] });
            }
            after(&history);
        }
        history
    }

    fn shown(history: &History, time_s: f64) -> (Scene, Evidence, Option<Pose>, Vec<(f64, DVec3)>) {
        let moment = history.moment(time_s, 500);
        ((*moment.scene).clone(), (*moment.evidence).clone(), moment.head, moment.path)
    }

    #[test]
    fn seeking_back_reproduces_earlier_state() {
        let mut first = Vec::new();
        let history = filled(|history| {
            let now_s = history.extent().buffered_s - 0.05;
            first.push((now_s, shown(history, now_s)));
        });
        for (time_s, then) in first.iter().rev() {
            assert_eq!(&shown(&history, *time_s), then, "at {time_s} s");
        }
    }

    #[test]
    fn extent_follows_announced_then_actual_duration() {
        let mut history = filled(|_| {});
        let extent = history.extent();
        assert!((extent.buffered_s - 10.05).abs() < 1e-9 && extent.duration_s == 12.0 && !extent.is_complete);
        history.complete();
        assert_eq!(history.extent().duration_s, history.extent().buffered_s);
    }

    #[test]
    fn marks_are_at_first_confirmation() {
        let history = filled(|_| {});
        let marks: Vec<_> = history.marks().collect();
        assert_eq!(marks.iter().map(|m| m.1).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert!((marks[0].0 - 2.1).abs() < 1e-9, "the first look from tick 20 on: {marks:?}");
    }

    #[test]
    fn frame_steps_go_both_ways() {
        let history = filled(|_| {});
        let next = history.adjacent_frame(1.0, 1).unwrap();
        assert!((next - 1.05).abs() < 1e-9);
        assert!((history.adjacent_frame(next, 1).unwrap() - 1.15).abs() < 1e-9);
        assert!((history.adjacent_frame(next, -1).unwrap() - 0.95).abs() < 1e-9);
        assert_eq!(history.adjacent_frame(0.0, -1), None);
        assert_eq!(history.adjacent_frame(99.0, 1), None);
    }

    #[test]
    fn history_is_bounded() {
        let mut history = History::new(0.0);
        let health = health();
        for n in 0..40_000i64 {
            history.push_head(n * 250 * MS, Pose::IDENTITY);
            history.push_update(n * 250 * MS, scene(n, &[n as u64]), health);
            history.push_evidence(n * 250 * MS, Evidence::default());
        }
        assert!(history.updates.len() <= SCENES && history.evidence.len() <= IMAGES && history.heads.len() <= HEADS);
        assert_eq!((history.marks.len(), history.known.len()), (MARKS, MARKS));
        assert!(history.moment(1e9, 700).path.len() <= 701);
        assert_eq!(history.moment(history.extent().buffered_s, 10).scene.time_ns, 39_999);
    }

    #[test]
    fn equal_scenes_share_memory() {
        let mut history = History::new(0.0);
        history.push_update(1, scene(0, &[1]), health());
        history.push_update(2, scene(0, &[1]), health());
        assert!(Arc::ptr_eq(&history.updates.at(1).unwrap().1.0, &history.updates.at(2).unwrap().1.0));
    }
}
