//! State over time, in bounded memory: the scene of every map update, the evidence, the path of the
//! head. Seeking back shows what was known at that time.
//!
//! Limits: 4096 scenes with their counters (17 minutes at four updates per second), 128 evidence
//! images of 20 000 voxels each (41 MB), 16 384 head poses, the times of a million frames, 1024
//! marks. When a series is full, every second entry is dropped, and later entries are kept at the
//! halved rate.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::DVec3;

use super::decimated_series::DecimatedSeries;
use super::player::Extent;
use radar_mapping::MapperCounters;
use radar_mapping::{Evidence, Scene};
use radar_sar::TimeOffset;
use radar_sar::geometry::{Aabb, Pose};

/// Limit of scenes. Choice: 17 minutes at four updates a second; of longer recordings every second
/// one is kept.
const SCENES: usize = 4096;
/// Limit of evidence images. Choice: one every eight seconds of these 17 minutes; images are the
/// largest entries.
const IMAGES: usize = 128;
/// Limit of voxels per evidence image. Choice: 300 kB an image; more points would hide each other.
pub const VOXELS: usize = 20_000;
/// Limit of head poses. Choice: four poses for each scene, a smooth path.
const HEADS: usize = 16_384;
/// Limit of frame times. Choice: four hours of d16, 8 MB.
const FRAMES: usize = 1 << 20;
/// Limit of marks. Choice: as many as the timeline has pixels.
const MARKS: usize = 1024;

/// MapperCounters and time offset at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Counters of the mapper.
    pub counters: MapperCounters,
    /// The active time offset, seconds.
    pub time_offset_s: f64,
    /// The latest estimate of the time offset.
    pub estimate: Option<TimeOffset>,
}

/// First confirmation of an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    /// Time, host nanoseconds.
    pub time_ns: i64,
    /// Id of the obstacle.
    pub id: u64,
}

/// State at one time.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Seconds from the beginning.
    pub time_s: f64,
    /// The scene.
    pub scene: Arc<Scene>,
    /// The evidence.
    pub evidence: Arc<Evidence>,
    /// Pose of the head.
    pub head: Option<Pose>,
    /// Earlier positions of the head, oldest first: seconds from the beginning, and position in
    /// metres.
    pub path: Vec<(f64, DVec3)>,
    /// MapperCounters and time offset.
    pub health: Option<Health>,
}

/// State over the whole recording.
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
    /// An empty history. `expected_s`: the announced duration, seconds.
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

    /// Adds a pose of the head. Ignored unless its time is later than the previous one.
    pub fn push_head(&mut self, time_ns: i64, head: Pose) {
        if self.heads.last().is_none_or(|last| time_ns > last.0) {
            self.heads.push(time_ns, head);
            let before = self.heads_around.into_iter().flat_map(|around| [around.min, around.max]);
            self.heads_around = Aabb::around(before.chain([head.translation]));
        }
    }

    /// Adds the end of a frame. Ignored unless its time is later than the previous one.
    pub fn push_frame(&mut self, time_ns: i64) {
        if self.frames.last().is_none_or(|last| time_ns > last.0) {
            self.frames.push(time_ns, ());
        }
    }

    /// Adds a scene.
    pub fn push_update(&mut self, time_ns: i64, scene: Scene, health: Health) {
        let new = scene.obstacles.iter().map(|obstacle| obstacle.id).filter(|id| !self.known.contains(id));
        let new: Vec<u64> = new.take(MARKS.saturating_sub(self.marks.len())).collect();
        self.marks.extend(new.iter().map(|&id| Mark { time_ns, id }));
        self.known.extend(new);
        // An unchanged scene shares the memory of the previous one.
        let same = self.updates.last().map(|last| Arc::clone(&last.1.0)).filter(|last| **last == scene);
        self.updates.push(time_ns, (same.unwrap_or_else(|| Arc::new(scene)), health));
    }

    /// Adds evidence.
    pub fn push_evidence(&mut self, time_ns: i64, evidence: impl Into<Arc<Evidence>>) {
        let evidence = evidence.into();
        self.greatest_score = evidence.voxels.first().map_or(0.0, |voxel| voxel.1).max(self.greatest_score);
        self.evidence.push(time_ns, evidence);
    }

    /// Marks the end of the data.
    pub fn complete(&mut self) {
        self.is_complete = true;
    }

    /// The largest score of any evidence so far: the end of the colour scale.
    pub fn greatest_score(&self) -> f32 {
        self.greatest_score
    }

    /// The box around all positions of the head so far.
    pub fn heads_around(&self) -> Option<Aabb> {
        self.heads_around
    }

    /// Begin of the recording, host nanoseconds.
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

    /// Buffered and total duration.
    pub fn extent(&self) -> Extent {
        let buffered_s = self.seconds(self.end_ns());
        let duration_s = if self.is_complete { buffered_s } else { buffered_s.max(self.expected_s) };
        Extent { buffered_s, duration_s, is_complete: self.is_complete }
    }

    /// First confirmations of obstacles: seconds from the beginning, and id.
    pub fn marks(&self) -> impl Iterator<Item = (f64, u64)> {
        self.marks.iter().map(|mark| (self.seconds(mark.time_ns), mark.id))
    }

    /// End of the frame before (−1) or after (+1) a time, seconds from the beginning.
    pub fn adjacent_frame(&self, time_s: f64, way: i32) -> Option<f64> {
        let time_ns = self.nanoseconds(time_s);
        let frame = if way < 0 { self.frames.before(time_ns) } else { self.frames.after(time_ns) };
        frame.map(|frame| self.seconds(frame.0))
    }

    /// State at a time, with at most about `path_points` earlier positions of the head.
    pub fn moment(&self, time_s: f64, path_points: usize) -> Moment {
        let time_ns = self.nanoseconds(time_s);
        let update = self.updates.at(time_ns).map(|update| &update.1);
        let heads = self.heads.until(time_ns);
        let step = heads.len().div_ceil(path_points.max(2)).max(1);
        // The step is a power of two, so the same positions are chosen at every time: a growing
        // path does not flicker.
        let path = heads.iter().step_by(step.next_power_of_two()).chain(heads.last());
        Moment {
            time_s,
            scene: update.map(|update| Arc::clone(&update.0)).unwrap_or_default(),
            evidence: self.evidence.at(time_ns).map(|evidence| Arc::clone(&evidence.1)).unwrap_or_default(),
            head: heads.last().map(|head| head.1),
            path: path.map(|(time_ns, head)| (self.seconds(*time_ns), head.translation)).collect(),
            health: update.map(|update| update.1),
        }
    }
}

#[cfg(test)]
mod tests {
    use radar_mapping::MappingSettings;

    use super::*;
    use a121::preset;
    use glam::DMat3;
    use radar_mapping::Mapper;
    use radar_mapping::{Observed, Obstacle};

    fn health() -> Health {
        let mapper = Mapper::new(&preset("d16").unwrap(), &Pose::IDENTITY, &MappingSettings::default());
        Health { counters: mapper.counters(), time_offset_s: 0.0, estimate: None }
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

    /// Ten seconds at 10 poses and 4 scenes per second. Calls `after` after every addition.
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
        assert!((marks[0].0 - 2.1).abs() < 1e-9, "the first update from tick 20 on: {marks:?}");
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
