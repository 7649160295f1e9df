//! Obstacles in rooms: sweeps → blocks → scores → explaining away → sightings → obstacles and walls.
//!
//! What a block sets off is done in stages, so that a stream need not wait for all of it: a block's imaging, and of a look at
//! the evidence the candidates, explaining away, the places. Whenever the stages are worked off, before the next block, the
//! result is the same.
//!
//! The place that the block score finds is refined by `ls` over the sweeps that saw it, with the ranges of everything else
//! that was explained left out; both are weighed by their covariances.

mod refinement;
mod restore;
mod screening;
mod shapes;
mod walls;

use std::collections::{BTreeMap, VecDeque};

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::classifier::ScoredCandidate;
use super::existence::Existence;
use super::history::History;
use super::saved_map::SavedMap;
use super::{
    CleanSettings, CleanWindow, Detection, Evidence, HandTrail, HandsM, MapSettings, MovingTarget, MovingTargetTracker,
    MtiSettings, ResponseCache, TrackList, same_plane, same_point,
};
use radar_sar::PositionErrors;
use radar_sar::geometry::{Aabb, Plane, Pose};
use radar_sar::subaperture::{
    Field, FineCounters, FineField, FineSettings, Peak, PlaneField, PlanePeak, Subaperture, SubapertureBuilder,
    SubapertureSettings,
};
use radar_sar::{Beam, Observation};
use shapes::Shape;

/// Parameters of the search in rooms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoomMapperSettings {
    /// Blocks and their score.
    pub blocks: SubapertureSettings,
    /// Explaining away.
    pub explain: CleanSettings,
    /// Sightings over time.
    pub map: MapSettings,
    /// Fine voxels wherever something is.
    pub fine: FineSettings,
    /// What moves by itself.
    pub moving: MtiSettings,
}

/// Time between two looks at the evidence, nanoseconds of the recording: 4 Hz.
const UPDATE_NS: i64 = 250_000_000;
/// Peaks of the field are maxima within this radius, metres.
const PEAK_RADIUS_M: f64 = 0.15;
/// Edge of the cube around a strong place that is looked at finely, metres.
const FINE_EDGE_M: f64 = 0.1;

/// What was done, for the counters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RoomMapperCounters {
    /// Blocks imaged.
    pub blocks: u64,
    /// Sweeps left out: too few before a pause to make a block.
    pub sweeps_without_block: u64,
    /// (voxel, sweep) pairs summed.
    pub voxel_updates: u64,
    /// Bricks of 8³ voxels that were ever in the beam.
    pub bricks: u64,
    /// Looks at the evidence.
    pub looks: u64,
    /// Confirmed places that were forgotten, since nothing was at them any more.
    pub forgotten: u64,
    /// The fine field.
    pub fine: FineCounters,
}

/// What a look came upon before anything was confirmed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Update {
    /// Maxima of the field, by falling score; the first `max_candidates` were candidates.
    pub peaks: Vec<Peak>,
    /// Maxima over planes, by falling score.
    pub plane_peaks: Vec<PlanePeak>,
    /// Places that were newly believed, strongest first.
    pub places: Vec<Detection<DVec3>>,
    /// Planes that were newly believed, strongest first.
    pub planes: Vec<Detection<Plane>>,
    /// Places that counted as sighted.
    pub point_hits: usize,
    /// Planes that counted as sighted.
    pub wall_hits: usize,
}

/// The place of a sighting, refined.
#[derive(Debug, Clone)]
struct RefinedPoint {
    position_m: DVec3,
    covariance_m2: DMat3,
    shape: Shape,
}

/// What is to be done next.
#[derive(Debug)]
enum Stage {
    /// A block is imaged.
    Image(Box<Subaperture>),
    /// A look begins: what may be there.
    Candidates,
    /// What is there.
    Detect { planes: Vec<Plane>, peaks: Vec<DVec3> },
    /// Where it is.
    Refine { walls: Vec<Detection<Plane>>, points: Vec<Detection<DVec3>> },
}

/// Searches a room.
#[derive(Debug)]
pub struct RoomMapper {
    settings: RoomMapperSettings,
    errors: PositionErrors,
    beam: Beam,
    min_cos: f64,
    builders: BTreeMap<usize, SubapertureBuilder>,
    field: Field,
    fine: FineField,
    planes: PlaneField,
    window: VecDeque<Subaperture>,
    /// Those that have left it.
    history: History,
    response_cache: ResponseCache,
    /// Sweeps of the window, for refinement.
    sweeps: VecDeque<Observation>,
    next_update_ns: Option<i64>,
    middle: Option<DVec3>,
    points: TrackList<DVec3>,
    walls: TrackList<Plane>,
    /// By sighting: its refined place and the quality that it was refined at.
    refined: BTreeMap<u64, (f64, RefinedPoint)>,
    /// By sighting that is confirmed: whether it is still there.
    existences: BTreeMap<u64, Existence>,
    /// Where the player's own hands were.
    hands: HandTrail,
    /// Where the newest sweep was taken.
    sensor_m: Option<DVec3>,
    /// What moves by itself.
    mti: MovingTargetTracker,
    /// By wall: feet of the perpendiculars that it was seen at.
    wall_feet: BTreeMap<u64, Aabb>,
    /// By wall: looks at where it should be, without any sign of it, since it was last believed.
    missed_updates: BTreeMap<u64, u32>,
    /// What was remembered from before.
    restored: SavedMap,
    /// The next stage of what the last block set off, and how many sweeps were taken since.
    pending: Option<Stage>,
    sweeps_since: usize,
    /// Sweeps that are to be taken first, when the search began again.
    backlog: VecDeque<Observation>,
    /// End of the newest sweep of the last look's blocks, host nanoseconds.
    evidence_ns: Option<i64>,
    /// Middle of the first block, host nanoseconds.
    first_ns: Option<i64>,
    /// What the last look weighed.
    scored: Vec<ScoredCandidate>,
    /// Places that the last looks weighed and that may be new.
    recent_candidates: VecDeque<Vec<DVec3>>,
    /// What it came upon.
    update: Update,
    counters: RoomMapperCounters,
    /// What was done before the search began again.
    counters_before_restart: RoomMapperCounters,
}

impl RoomMapper {
    /// Nothing seen yet.
    pub fn new(settings: RoomMapperSettings, beam: &Beam, errors: PositionErrors) -> Self {
        let min_cos = settings.blocks.min_cos(beam);
        Self {
            field: Field::new(settings.blocks, min_cos),
            fine: FineField::new(settings.fine, settings.blocks, min_cos),
            planes: PlaneField::new(settings.blocks, settings.blocks.mirror_min_cos(beam)),
            settings,
            errors,
            beam: beam.clone(),
            min_cos,
            builders: BTreeMap::new(),
            window: VecDeque::new(),
            history: History::default(),
            response_cache: ResponseCache::default(),
            sweeps: VecDeque::new(),
            next_update_ns: None,
            middle: None,
            points: TrackList::default(),
            walls: TrackList::default(),
            refined: BTreeMap::new(),
            existences: BTreeMap::new(),
            hands: HandTrail::default(),
            sensor_m: None,
            mti: MovingTargetTracker::new(settings.moving, beam),
            wall_feet: BTreeMap::new(),
            missed_updates: BTreeMap::new(),
            restored: SavedMap::default(),
            pending: None,
            sweeps_since: 0,
            backlog: VecDeque::new(),
            evidence_ns: None,
            first_ns: None,
            scored: Vec::new(),
            recent_candidates: VecDeque::new(),
            update: Update::default(),
            counters: RoomMapperCounters::default(),
            counters_before_restart: RoomMapperCounters::default(),
        }
    }

    /// Forgets everything but what was remembered from before and the sweeps of the window, which `keep` may change or drop; those are searched again by
    /// [`work`](Self::work), before any that come.
    pub fn restart(&mut self, mut keep: impl FnMut(&mut Observation) -> bool) {
        let counters_before_restart = self.counters();
        let mut backlog = std::mem::take(&mut self.sweeps);
        backlog.append(&mut self.backlog);
        backlog.retain_mut(|sweep| keep(sweep));
        let (hands, remembered) = (std::mem::take(&mut self.hands), self.still_saved());
        *self = Self { counters_before_restart, backlog, hands, ..Self::new(self.settings, &self.beam, self.errors) };
        // It was sound when it was taken up.
        let _ = self.restore(&remembered);
    }

    /// What was done so far.
    pub fn counters(&self) -> RoomMapperCounters {
        let dropped: u64 = self.builders.values().map(|b| b.dropped_sweeps).sum();
        RoomMapperCounters {
            blocks: self.counters_before_restart.blocks + self.counters.blocks,
            sweeps_without_block: self.counters_before_restart.sweeps_without_block + dropped,
            voxel_updates: self.counters_before_restart.voxel_updates + self.field.updates,
            bricks: self.counters_before_restart.bricks + self.field.brick_count() as u64,
            looks: self.counters_before_restart.looks + self.counters.looks,
            forgotten: self.counters_before_restart.forgotten + self.counters.forgotten,
            fine: self.counters_before_restart.fine.and(&self.fine.counters()),
        }
    }

    /// End of the newest sweep that obstacles and walls rest on, host nanoseconds.
    pub fn evidence_ns(&self) -> Option<i64> {
        self.evidence_ns
    }

    /// Places that the last look weighed.
    pub fn scored_candidates(&self) -> &[ScoredCandidate] {
        &self.scored
    }

    /// What the last look came upon.
    pub fn last_update(&self) -> &Update {
        &self.update
    }

    /// Every voxel that was ever seen and scores at least `min_score`, the `most` strongest.
    pub fn evidence(&self, min_score: f64, most: usize) -> Evidence {
        let peaks = self.field.above(min_score, i64::MIN);
        let voxels = peaks.into_iter().map(|peak| (peak.position_m, peak.score as f32)).collect();
        Evidence::strongest(self.settings.blocks.voxel_m, voxels, most)
    }

    /// The score on fine voxels, where something is.
    pub fn fine(&self) -> &FineField {
        &self.fine
    }

    /// Takes where the player's own hands are.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.hands.push(time_ns, hands_m, self.sensor_m);
    }

    /// Takes a sweep; images the block that it closes and, four times a second, looks at the evidence.
    pub fn push(&mut self, observation: Observation) {
        self.push_deferred(observation);
        while self.work() {}
    }

    /// Takes a sweep and leaves what it sets off to [`work`](Self::work).
    pub fn push_deferred(&mut self, observation: Observation) {
        self.sensor_m = Some(observation.tracking_from_sensor.translation);
        match self.backlog.is_empty() {
            true => self.accept(observation),
            false => self.backlog.push_back(observation),
        }
    }

    /// When a sweep would close the block at hand: gives that block's sweeps the places that `sensor_at` has for their times.
    /// To be called before the sweep is taken.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        let subsweep = next.geometry.subsweep;
        let builder = self.builders.get_mut(&subsweep).filter(|builder| builder.is_closed_by(next.mid_time_ns));
        let Some(sweeps) = builder.filter(|_| self.backlog.is_empty()).map(SubapertureBuilder::sweeps_mut) else {
            return;
        };
        let Some(first_ns) = sweeps.first().map(|sweep| sweep.mid_time_ns) else { return };
        // Those kept for refinement are copies of them.
        let kept = self.sweeps.iter_mut().rev().take_while(|sweep| sweep.mid_time_ns >= first_ns);
        for sweep in sweeps.iter_mut().chain(kept.filter(|sweep| sweep.geometry.subsweep == subsweep)) {
            if let Some((tracking_from_sensor, velocity_m_per_s)) = sensor_at(sweep.mid_time_ns) {
                (sweep.tracking_from_sensor, sweep.velocity_m_per_s) = (tracking_from_sensor, velocity_m_per_s);
            }
        }
    }

    fn accept(&mut self, observation: Observation) {
        let settings = self.settings.blocks;
        self.sweeps.push_back(observation.clone());
        self.sweeps_since += 1;
        let subsweep = observation.geometry.subsweep;
        if self.builders.get(&subsweep).is_some_and(|builder| builder.is_closed_by(observation.mid_time_ns)) {
            // What is known is what the blocks before say.
            while self.run_next_stage() {}
            self.cancel_walls();
        }
        let builder = self.builders.entry(subsweep).or_insert_with(|| SubapertureBuilder::new(settings));
        if let Some(block) = builder.push(observation) {
            (self.pending, self.sweeps_since) = (Some(Stage::Image(Box::new(block))), 0);
        }
    }

    /// Blocks are to be without the walls that are known now.
    fn cancel_walls(&mut self) {
        let mirrors: Vec<Plane> = self.walls.confirmed().map(|wall| wall.estimate).collect();
        self.builders.values_mut().for_each(|builder| builder.cancel_walls(&mirrors));
    }

    /// Does a part of what is to be done; false when nothing is.
    pub fn work(&mut self) -> bool {
        while self.pending.is_none()
            && let Some(sweep) = self.backlog.pop_front()
        {
            self.accept(sweep);
        }
        self.run_next_stage()
    }

    /// Does the next stage of what the last block set off; false when there is none.
    fn run_next_stage(&mut self) -> bool {
        let Some(stage) = self.pending.take() else { return false };
        // All of a stage's parallel loops from within the pool: one hand-over instead of one for each loop.
        self.pending = rayon::scope(|_| self.run_stage(stage));
        true
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.pending.is_some() || !self.backlog.is_empty()
    }

    /// Images what is left and looks at the evidence a last time.
    pub fn finish(&mut self) {
        while self.work() {}
        self.cancel_walls();
        let last: Vec<Subaperture> = self.builders.values_mut().filter_map(SubapertureBuilder::close).collect();
        let last_stages = last.into_iter().map(|block| Stage::Image(Box::new(block)));
        for stage in last_stages.chain([Stage::Candidates]) {
            self.pending = Some(stage);
            while self.run_next_stage() {}
        }
    }

    /// Does a stage and gives the next.
    fn run_stage(&mut self, stage: Stage) -> Option<Stage> {
        match stage {
            Stage::Image(block) => self.process_subaperture(*block).then_some(Stage::Candidates),
            Stage::Candidates => self.candidates(),
            Stage::Detect { planes, peaks } => Some(self.detect(&planes, &peaks)),
            Stage::Refine { walls, points } => {
                self.refine_positions(&walls, &points);
                None
            }
        }
    }

    /// Images a block; says whether it is time for a look.
    fn process_subaperture(&mut self, block: Subaperture) -> bool {
        self.counters.blocks += 1;
        self.middle.get_or_insert(block.middle.translation);
        self.first_ns.get_or_insert(block.mid_time_ns);
        self.field.add(&block);
        self.fine.push_subaperture(&block);
        self.planes.add(block.uncancelled());
        self.mti.push(block.uncancelled(), &self.hands, self.settings.map.hands_reach_m);
        let now_ns = block.mid_time_ns;
        self.window.push_back(block);
        let since_ns = now_ns - self.window_ns();
        while let Some(old) = self.window.pop_front_if(|b| b.mid_time_ns < since_ns) {
            self.fine.pop_subaperture(&old);
            self.history.push(&old);
        }
        while self.sweeps.front().is_some_and(|o| o.mid_time_ns < since_ns) {
            self.sweeps.pop_front();
        }
        let is_due = now_ns >= *self.next_update_ns.get_or_insert(now_ns);
        if is_due {
            self.next_update_ns = Some(now_ns + UPDATE_NS);
        }
        is_due
    }

    fn window_ns(&self) -> i64 {
        (self.settings.explain.window_s * 1e9) as i64
    }

    /// A look begins: planes and places that may be there.
    fn candidates(&mut self) -> Option<Stage> {
        let since_ns = self.window.back()?.mid_time_ns - self.window_ns();
        self.counters.looks += 1;
        let explain = self.settings.explain;
        let planes = self.planes.peaks(explain.plane_min_score, explain.plane_min_blocks, since_ns);
        let peaks = self.field.peaks(explain.min_candidate_score, PEAK_RADIUS_M, since_ns);
        let stage = Stage::Detect {
            planes: planes.iter().map(|p| p.plane).collect(),
            peaks: peaks.iter().take(explain.max_candidates).map(|p| p.position_m).collect(),
        };
        self.update = Update { peaks, plane_peaks: planes, ..Update::default() };
        Some(stage)
    }

    /// Explains the window's blocks, and takes the sightings.
    fn detect(&mut self, planes: &[Plane], peaks: &[DVec3]) -> Stage {
        let explain = self.settings.explain;
        let (blocks, memory) = (&self.settings.blocks, &mut self.response_cache);
        let mut window = CleanWindow::new(self.window.iter(), &self.hands, &explain, blocks, &self.beam, memory);
        // What is known claims before anything new does.
        let known_walls: Vec<Plane> = self.walls.confirmed().map(|w| w.estimate).collect();
        let (ids, known_points): (Vec<u64>, Vec<DVec3>) = self.points.confirmed().map(|p| (p.id, p.estimate)).unzip();
        let known = window.detect_known(&known_walls, &known_points);
        let new = window.detect(planes, peaks);
        let likelihoods = window.likelihoods(&known_points, &known.responses);
        drop(window);
        self.update_existence(&ids, &likelihoods);
        let there = self.new_detections(&new);
        (self.update.places, self.update.planes) = (new.places, new.planes.clone());
        let (points, scored): (Vec<_>, Vec<_>) = self.known_detections(&known).into_iter().chain(there).unzip();
        let walls = [known.planes, new.planes].concat();
        self.record_candidates(scored);
        let map = self.settings.map;
        self.update.wall_hits = walls.iter().filter(|wall| map.for_planes().is_hit(wall)).count();
        self.walls.update(&walls, &map.for_planes(), same_plane(self.middle.unwrap_or(DVec3::ZERO)));
        self.update.point_hits = points.iter().filter(|point| map.is_hit(point)).count();
        self.points.update(&points, &map, same_point(map.match_m));
        self.confirm_provisional_tracks();
        self.remove_missed_walls(&walls);
        Stage::Refine { walls, points }
    }

    /// The look ends: where things are.
    fn refine_positions(&mut self, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) {
        self.request_fine_imaging(points);
        self.update_feet(walls);
        self.refine_new(walls, points);
        self.evidence_ns = self.window.back().map(|block| block.end_ns);
    }

    /// Keeps the fine field around what is known and around what may soon be: places that were believed and are determined.
    fn request_fine_imaging(&mut self, detections: &[Detection<DVec3>]) {
        let strong =
            detections.iter().filter(|p| p.observable && p.score >= self.settings.fine.min_score).map(|p| p.estimate);
        let places: Vec<DVec3> = self.points.confirmed().map(|p| p.estimate).chain(strong).collect();
        self.fine.request(&places, FINE_EDGE_M);
    }

    /// What moves by itself, the longest followed first.
    pub fn moving_targets(&self) -> Vec<MovingTarget> {
        self.mti.targets()
    }
}
