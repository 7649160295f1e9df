//! Mapper: sweeps → sub-apertures → scores → CLEAN → tracks → obstacles and walls.
//!
//! A sub-aperture triggers work in stages, so a stream need not wait for all of it: imaging of the
//! sub-aperture and, for an update, the candidates, CLEAN and the positions. The result is the same
//! whenever the stages are worked off, as long as it is before the next sub-aperture closes.
//!
//! The position that the sub-aperture score finds is refined by `ls` over the sweeps that saw it,
//! with the ranges of all other detections masked. Both estimates are weighted by their
//! covariances.

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

/// Parameters of the mapper.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoomMapperSettings {
    /// Sub-apertures and their score.
    pub blocks: SubapertureSettings,
    /// CLEAN.
    pub explain: CleanSettings,
    /// Tracks over time.
    pub map: MapSettings,
    /// Fine voxels wherever something is.
    pub fine: FineSettings,
    /// Moving targets.
    pub moving: MtiSettings,
}

/// Period of the updates, nanoseconds of the recording (choice): 4 Hz.
const UPDATE_NS: i64 = 250_000_000;
/// Peaks of the field are maxima within this radius, metres (choice).
const PEAK_RADIUS_M: f64 = 0.15;
/// Edge of the cube around a strong point that is imaged finely, metres (choice).
const FINE_EDGE_M: f64 = 0.1;

/// Work done, for the counters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RoomMapperCounters {
    /// Sub-apertures imaged.
    pub blocks: u64,
    /// Sweeps skipped: too few before a pause to make a sub-aperture.
    pub sweeps_without_block: u64,
    /// (voxel, sweep) pairs summed.
    pub voxel_updates: u64,
    /// Bricks of 8³ voxels that were ever in the beam.
    pub bricks: u64,
    /// Updates of the map.
    pub looks: u64,
    /// Confirmed points that were removed, because nothing was there any more.
    pub forgotten: u64,
    /// The fine field.
    pub fine: FineCounters,
}

/// Results of an update before anything is confirmed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Update {
    /// Maxima of the field, by falling score; the first `max_candidates` were candidates.
    pub peaks: Vec<Peak>,
    /// Maxima over planes, by falling score.
    pub plane_peaks: Vec<PlanePeak>,
    /// New point detections, strongest first.
    pub places: Vec<Detection<DVec3>>,
    /// New plane detections, strongest first.
    pub planes: Vec<Detection<Plane>>,
    /// Point detections that counted as hits.
    pub point_hits: usize,
    /// Plane detections that counted as hits.
    pub wall_hits: usize,
}

/// The refined position of a track.
#[derive(Debug, Clone)]
struct RefinedPoint {
    position_m: DVec3,
    covariance_m2: DMat3,
    shape: Shape,
}

/// The next stage of the work.
#[derive(Debug)]
enum Stage {
    /// Image a sub-aperture.
    Image(Box<Subaperture>),
    /// Begin an update: find candidates.
    Candidates,
    /// Detect with CLEAN.
    Detect { planes: Vec<Plane>, peaks: Vec<DVec3> },
    /// Refine the positions.
    Refine { walls: Vec<Detection<Plane>>, points: Vec<Detection<DVec3>> },
}

/// Maps a room.
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
    /// Sub-apertures that have left the window.
    history: History,
    response_cache: ResponseCache,
    /// Sweeps of the window, for the refinement.
    sweeps: VecDeque<Observation>,
    next_update_ns: Option<i64>,
    middle: Option<DVec3>,
    points: TrackList<DVec3>,
    walls: TrackList<Plane>,
    /// By track: its refined position and the quality that it was refined at.
    refined: BTreeMap<u64, (f64, RefinedPoint)>,
    /// By confirmed track: whether it still exists.
    existences: BTreeMap<u64, Existence>,
    /// Positions of the wearer's hands.
    hands: HandTrail,
    /// Position of the sensor at the newest sweep.
    sensor_m: Option<DVec3>,
    /// Tracker of moving targets.
    mti: MovingTargetTracker,
    /// By wall: feet of the perpendiculars that it was seen at.
    wall_feet: BTreeMap<u64, Aabb>,
    /// By wall: updates since its last detection in which it should have been seen.
    missed_updates: BTreeMap<u64, u32>,
    /// What was restored from a saved map.
    restored: SavedMap,
    /// The next stage of the work of the last sub-aperture, and the number of sweeps taken since.
    pending: Option<Stage>,
    sweeps_since: usize,
    /// Sweeps that are processed first after a restart.
    backlog: VecDeque<Observation>,
    /// End of the newest sub-aperture of the last update, host nanoseconds.
    evidence_ns: Option<i64>,
    /// Middle of the first sub-aperture, host nanoseconds.
    first_ns: Option<i64>,
    /// Candidates that the last update scored.
    scored: Vec<ScoredCandidate>,
    /// Candidates that the last updates scored and that may be new.
    recent_candidates: VecDeque<Vec<DVec3>>,
    /// Results of the last update.
    update: Update,
    counters: RoomMapperCounters,
    /// Work done before the last restart.
    counters_before_restart: RoomMapperCounters,
}

impl RoomMapper {
    /// An empty map.
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

    /// Restarts from an empty map. Restored objects, the hands' positions and the sweeps of the
    /// window stay. `keep` may change or drop sweeps; the rest are processed again by
    /// [`work`](Self::work), before any new ones.
    pub fn restart(&mut self, mut keep: impl FnMut(&mut Observation) -> bool) {
        let counters_before_restart = self.counters();
        let mut backlog = std::mem::take(&mut self.sweeps);
        backlog.append(&mut self.backlog);
        backlog.retain_mut(|sweep| keep(sweep));
        let (hands, remembered) = (std::mem::take(&mut self.hands), self.still_saved());
        *self = Self { counters_before_restart, backlog, hands, ..Self::new(self.settings, &self.beam, self.errors) };
        // It was valid when it was restored.
        let _ = self.restore(&remembered);
    }

    /// Work done so far.
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

    /// End of the newest sub-aperture that obstacles and walls rest on, host nanoseconds.
    pub fn evidence_ns(&self) -> Option<i64> {
        self.evidence_ns
    }

    /// Candidates that the last update scored.
    pub fn scored_candidates(&self) -> &[ScoredCandidate] {
        &self.scored
    }

    /// Results of the last update.
    pub fn last_update(&self) -> &Update {
        &self.update
    }

    /// Every voxel that was ever seen and scores at least `min_score`, the `most` highest.
    pub fn evidence(&self, min_score: f64, most: usize) -> Evidence {
        let peaks = self.field.above(min_score, i64::MIN);
        let voxels = peaks.into_iter().map(|peak| (peak.position_m, peak.score as f32)).collect();
        Evidence::strongest(self.settings.blocks.voxel_m, voxels, most)
    }

    /// The scores on fine voxels, where something is.
    pub fn fine(&self) -> &FineField {
        &self.fine
    }

    /// Adds positions of the wearer's hands.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.hands.push(time_ns, hands_m, self.sensor_m);
    }

    /// Adds a sweep. Images the sub-aperture that it closes and, four times a second, updates the
    /// map.
    pub fn push(&mut self, observation: Observation) {
        self.push_deferred(observation);
        while self.work() {}
    }

    /// Adds a sweep and leaves its work to [`work`](Self::work).
    pub fn push_deferred(&mut self, observation: Observation) {
        self.sensor_m = Some(observation.tracking_from_sensor.translation);
        match self.backlog.is_empty() {
            true => self.accept(observation),
            false => self.backlog.push_back(observation),
        }
    }

    /// When a sweep would close the current sub-aperture: gives that sub-aperture's sweeps the
    /// sensor poses and velocities that `sensor_at` returns for their times. Call it before the
    /// sweep is added.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        let subsweep = next.geometry.subsweep;
        let builder = self.builders.get_mut(&subsweep).filter(|builder| builder.is_closed_by(next.mid_time_ns));
        let Some(sweeps) = builder.filter(|_| self.backlog.is_empty()).map(SubapertureBuilder::sweeps_mut) else {
            return;
        };
        let Some(first_ns) = sweeps.first().map(|sweep| sweep.mid_time_ns) else { return };
        // The sweeps kept for the refinement are copies of these.
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
            // The known walls must include the results of the sub-apertures before.
            while self.run_next_stage() {}
            self.cancel_walls();
        }
        let builder = self.builders.entry(subsweep).or_insert_with(|| SubapertureBuilder::new(settings));
        if let Some(block) = builder.push(observation) {
            (self.pending, self.sweeps_since) = (Some(Stage::Image(Box::new(block))), 0);
        }
    }

    /// Makes the following sub-apertures cancel the walls known now.
    fn cancel_walls(&mut self) {
        let mirrors: Vec<Plane> = self.walls.confirmed().map(|wall| wall.estimate).collect();
        self.builders.values_mut().for_each(|builder| builder.cancel_walls(&mirrors));
    }

    /// Does a part of the work; false when there is none.
    pub fn work(&mut self) -> bool {
        while self.pending.is_none()
            && let Some(sweep) = self.backlog.pop_front()
        {
            self.accept(sweep);
        }
        self.run_next_stage()
    }

    /// Does the next stage of the last sub-aperture's work; false when there is none.
    fn run_next_stage(&mut self) -> bool {
        let Some(stage) = self.pending.take() else { return false };
        // Runs all parallel loops of a stage within the pool: one hand-over instead of one for each
        // loop.
        self.pending = rayon::scope(|_| self.run_stage(stage));
        true
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.pending.is_some() || !self.backlog.is_empty()
    }

    /// Images the rest and updates the map a last time.
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

    /// Does a stage and returns the next.
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

    /// Images a sub-aperture. Returns whether an update is due.
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

    /// Begins an update: candidate planes and points.
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

    /// Detects in the window's sub-apertures and updates the tracks.
    fn detect(&mut self, planes: &[Plane], peaks: &[DVec3]) -> Stage {
        let explain = self.settings.explain;
        let (blocks, memory) = (&self.settings.blocks, &mut self.response_cache);
        let mut window = CleanWindow::new(self.window.iter(), &self.hands, &explain, blocks, &self.beam, memory);
        // Known objects mask before new ones do.
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

    /// Ends the update: refines the positions.
    fn refine_positions(&mut self, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) {
        self.request_fine_imaging(points);
        self.update_feet(walls);
        self.refine_new(walls, points);
        self.evidence_ns = self.window.back().map(|block| block.end_ns);
    }

    /// Keeps the fine field around known objects and around detections that may soon be confirmed:
    /// those that are observable and strong enough.
    fn request_fine_imaging(&mut self, detections: &[Detection<DVec3>]) {
        let strong =
            detections.iter().filter(|p| p.observable && p.score >= self.settings.fine.min_score).map(|p| p.estimate);
        let places: Vec<DVec3> = self.points.confirmed().map(|p| p.estimate).chain(strong).collect();
        self.fine.request(&places, FINE_EDGE_M);
    }

    /// Confirmed moving targets, the longest tracked first.
    pub fn moving_targets(&self) -> Vec<MovingTarget> {
        self.mti.targets()
    }
}
