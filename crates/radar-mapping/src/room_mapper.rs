//! Mapper: sweeps → sub-apertures → scores → CLEAN → tracks → obstacles and walls.
//!
//! A sub-aperture triggers work in stages, so a stream need not wait for all of it: imaging of the
//! sub-aperture and, for an update, the candidates, CLEAN and the positions. The result is the same
//! whenever the stages run, as long as it is before the next sub-aperture closes.
//!
//! The position that the sub-aperture score finds is refined by `ls` over the sweeps that saw it,
//! with the ranges of all other detections masked. Both estimates are weighted by their
//! covariances.

mod background;
mod config;
mod imaging;
mod intake;
mod objects;
mod recurrence;
mod refinement;
mod screening;
mod shapes;
mod walls;
mod window;

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::calibration_control::CalibrationChange;
use super::classifier::ScoredCandidate;
use super::{
    CleanSettings, CleanWindow, Detection, Evidence, HandTrail, HandsM, MovingTarget, MovingTargetTracker, MtiSettings,
    Obstacle, ResponseCache, SavedMap, SavedMapError, TrackSettings, Wall,
};
use background::SensorBackground;
use config::RoomConfig;
use imaging::Imaging;
use intake::SweepIntake;
use objects::ObjectMap;
use radar_sar::PositionErrors;
use radar_sar::geometry::{Plane, Pose};
use radar_sar::subaperture::{
    FineCounters, FineField, FineSettings, Peak, PlanePeak, Subaperture, SubapertureSettings,
};
use radar_sar::{Beam, FollowedJump, Observation};
use recurrence::Recurrences;
use refinement::Refinement;
use screening::{CandidateLog, Screening};
use walls::{Facing, WallMap};
use window::Window;

/// Parameters of the mapper.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoomMapperSettings {
    /// Sub-apertures and their score.
    pub subapertures: SubapertureSettings,
    /// CLEAN.
    pub clean: CleanSettings,
    /// Tracks over time.
    pub tracks: TrackSettings,
    /// Fine voxels wherever something is.
    pub fine: FineSettings,
    /// Moving targets.
    pub moving: MtiSettings,
}

/// Period of the updates, nanoseconds of the recording: 4 Hz. Choice: a walking wearer moves 0.3 m
/// between updates; each runs CLEAN over the whole window, so the work grows with the rate.
const UPDATE_NS: i64 = 250_000_000;
/// Peaks of the field are maxima within this radius, metres. Choice: the width of the pulse of
/// profile 3, 0.14 m; nearer maxima share their echoes.
const PEAK_RADIUS_M: f64 = 0.15;
/// Edge of the cube around a strong point that is imaged finely, metres. Choice: two coarse voxels,
/// so that the true maximum is inside; the work grows with the cube.
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
    config: RoomConfig,
    background: SensorBackground,
    intake: SweepIntake,
    imaging: Imaging,
    window: Window,
    response_cache: ResponseCache,
    objects: ObjectMap,
    walls: WallMap,
    /// Positions of the wearer's hands.
    hands: HandTrail,
    /// Tracker of moving targets.
    mti: MovingTargetTracker,
    candidates: CandidateLog,
    recurrences: Recurrences,
    /// The next stage of the work of the last sub-aperture.
    pending: Option<Stage>,
    updates: Updates,
    work_done: WorkDone,
}

/// When the map is updated, and the last time.
#[derive(Debug, Default)]
struct Updates {
    next_ns: Option<i64>,
    /// Results of the last update.
    last: Update,
    /// End of the newest sub-aperture of the last update, host nanoseconds.
    evidence_ns: Option<i64>,
}

impl Updates {
    /// Whether an update is due; schedules the next one then.
    fn is_due(&mut self, now_ns: i64) -> bool {
        let is_due = now_ns >= *self.next_ns.get_or_insert(now_ns);
        if is_due {
            self.next_ns = Some(now_ns + UPDATE_NS);
        }
        is_due
    }
}

/// Work that the mapper counts itself; the stages count the rest.
#[derive(Debug, Default)]
struct WorkDone {
    /// Sub-apertures imaged, updates, and objects removed.
    blocks: u64,
    looks: u64,
    forgotten: u64,
    /// All work before the window was imaged again.
    before: RoomMapperCounters,
}

impl RoomMapper {
    /// An empty map.
    pub fn new(settings: RoomMapperSettings, beam: &Beam, errors: PositionErrors) -> Self {
        Self::begin(RoomConfig::new(settings, beam, errors), VecDeque::new())
    }

    /// An empty map; `backlog`: sweeps to process first.
    fn begin(config: RoomConfig, backlog: VecDeque<Observation>) -> Self {
        Self {
            background: SensorBackground::default(),
            intake: SweepIntake::new(config.settings.subapertures, backlog),
            imaging: Imaging::new(&config),
            window: Window::default(),
            response_cache: ResponseCache::default(),
            objects: ObjectMap::default(),
            walls: WallMap::default(),
            hands: HandTrail::default(),
            mti: MovingTargetTracker::new(config.settings.moving, &config.beam),
            candidates: CandidateLog::default(),
            recurrences: Recurrences::default(),
            pending: None,
            updates: Updates::default(),
            work_done: WorkDone::default(),
            config,
        }
    }

    /// Images the sweeps of the window again, because their poses had been wrong. `keep` changes or drops sweeps; the rest
    /// are processed by [`work`](Self::work), before any new ones. Objects and walls stay where they are until they are
    /// seen again, less certain than before.
    pub(crate) fn image_again(&mut self, change: &CalibrationChange, mut keep: impl FnMut(&mut Observation) -> bool) {
        let mut backlog = self.intake.take_sweeps();
        backlog.retain_mut(|sweep| keep(sweep));
        let before = std::mem::replace(self, Self::begin(self.config.clone(), backlog));
        self.work_done.before = before.counters();
        self.objects = before.objects;
        self.objects.distrust(change);
        self.walls = before.walls;
        self.walls.distrust();
        self.window = before.window.emptied();
        (self.hands, self.background, self.mti) = (before.hands, before.background, before.mti);
        self.updates.evidence_ns = before.updates.evidence_ns;
    }

    /// From now on positions have the covariances of these pose errors.
    pub(crate) fn set_errors(&mut self, errors: PositionErrors) {
        self.config.errors = errors;
    }

    /// Work done so far.
    pub fn counters(&self) -> RoomMapperCounters {
        let WorkDone { blocks, looks, forgotten, before } = &self.work_done;
        let (voxel_updates, bricks) = self.imaging.work();
        RoomMapperCounters {
            blocks: before.blocks + blocks,
            sweeps_without_block: before.sweeps_without_block + self.intake.dropped_sweeps(),
            voxel_updates: before.voxel_updates + voxel_updates,
            bricks: before.bricks + bricks,
            looks: before.looks + looks,
            forgotten: before.forgotten + forgotten,
            fine: before.fine.and(&self.imaging.fine().counters()),
        }
    }

    /// End of the newest sub-aperture that obstacles and walls rest on, host nanoseconds.
    pub fn evidence_ns(&self) -> Option<i64> {
        self.updates.evidence_ns
    }

    /// Candidates that the last update scored.
    pub fn scored_candidates(&self) -> &[ScoredCandidate] {
        self.candidates.scored()
    }

    /// Results of the last update.
    pub fn last_update(&self) -> &Update {
        &self.updates.last
    }

    /// Every voxel that was ever seen and scores at least `min_score`, the `most` highest.
    pub fn evidence(&self, min_score: f64, most: usize) -> Evidence {
        self.imaging.evidence(min_score, most)
    }

    /// The scores on fine voxels, where something is.
    pub fn fine(&self) -> &FineField {
        self.imaging.fine()
    }

    /// Confirmed obstacles, by falling evidence. Tracks near each other belong to one obstacle,
    /// which has the position of the strongest. What is behind a known wall is none.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        self.objects.obstacles(&self.imaging, |point| self.walls.hides(point))
    }

    /// Confirmed walls, by falling evidence.
    pub fn walls(&self) -> Vec<Wall> {
        self.walls.walls(self.window.middle())
    }

    /// Confirmed moving targets, the longest tracked first.
    pub fn moving_targets(&self) -> Vec<MovingTarget> {
        self.mti.targets()
    }

    /// Restores a saved map of this room as provisional. Objects already known are left as they
    /// are.
    ///
    /// # Errors
    /// A value is not valid for a room; nothing is restored then.
    pub fn restore(&mut self, saved: &SavedMap) -> Result<(), SavedMapError> {
        saved.check()?;
        self.objects.restore(&saved.places, self.config.settings.tracks.match_m);
        self.walls.restore(&saved.walls, self.window.middle());
        Ok(())
    }

    /// What is known of the room, by id: confirmed objects observed since, and restored ones that
    /// still exist.
    pub fn saved_map(&self) -> SavedMap {
        SavedMap::of(self.objects.saved(&self.imaging), self.walls.saved(self.window.middle()))
    }

    /// Takes a jump of the tracking frame: the hands' positions since were taken to be in the frame of before.
    pub fn follow(&mut self, jump: &FollowedJump) {
        self.hands.move_since(jump.first_after_ns, &jump.before_from_after);
    }

    /// Adds positions of the wearer's hands.
    pub fn push_hands(&mut self, time_ns: i64, hands_m: HandsM) {
        self.hands.push(time_ns, hands_m, self.intake.sensor_m());
    }

    /// Adds a sweep. Images the sub-aperture that it closes and, four times a second, updates the
    /// map.
    pub fn push(&mut self, observation: Observation) {
        self.push_deferred(observation);
        while self.work() {}
    }

    /// Adds a sweep and leaves its work to [`work`](Self::work).
    pub fn push_deferred(&mut self, mut observation: Observation) {
        self.background.subtract(&mut observation);
        if let Some(observation) = self.intake.receive(observation) {
            self.accept(observation);
        }
    }

    /// When a sweep would close the current sub-aperture: gives that sub-aperture's sweeps the
    /// sensor poses and velocities that `sensor_at` returns for their times. Call it before the
    /// sweep is added.
    pub fn update_poses_before(&mut self, next: &Observation, sensor_at: impl Fn(i64) -> Option<(Pose, DVec3)>) {
        self.intake.update_poses_before(next, sensor_at);
    }

    fn accept(&mut self, observation: Observation) {
        if self.intake.keep(&observation) {
            // The known walls must include the results of the sub-apertures before.
            while self.run_next_stage() {}
            self.intake.cancel_walls(&self.walls.planes());
        }
        if let Some(completed) = self.intake.add(observation) {
            self.pending = Some(Stage::Image(Box::new(completed)));
        }
    }

    /// Does a part of the work; false when there is none.
    pub fn work(&mut self) -> bool {
        while self.pending.is_none()
            && let Some(sweep) = self.intake.next_of_backlog()
        {
            self.accept(sweep);
        }
        self.run_next_stage()
    }

    /// Whether [`work`](Self::work) has something to do.
    pub fn has_work(&self) -> bool {
        self.pending.is_some() || self.intake.has_backlog()
    }

    /// Images the rest and updates the map a last time.
    pub fn finish(&mut self) {
        while self.work() {}
        self.intake.cancel_walls(&self.walls.planes());
        let last_stages = self.intake.close().into_iter().map(|last| Stage::Image(Box::new(last)));
        for stage in last_stages.chain([Stage::Candidates]) {
            self.pending = Some(stage);
            while self.run_next_stage() {}
        }
    }

    /// Does the next stage of the last sub-aperture's work; false when there is none.
    fn run_next_stage(&mut self) -> bool {
        let Some(stage) = self.pending.take() else { return false };
        // Runs all parallel loops of a stage within the pool: one transfer to the pool instead of one for
        // each loop.
        self.pending = rayon::scope(|_| self.run_stage(stage));
        true
    }

    /// Does a stage and returns the next.
    fn run_stage(&mut self, stage: Stage) -> Option<Stage> {
        match stage {
            Stage::Image(subaperture) => self.image(*subaperture).then_some(Stage::Candidates),
            Stage::Candidates => self.find_candidates(),
            Stage::Detect { planes, peaks } => Some(self.detect(&planes, &peaks)),
            Stage::Refine { walls, points } => {
                self.refine(&walls, &points);
                None
            }
        }
    }

    /// Images a sub-aperture. Returns whether an update is due.
    fn image(&mut self, subaperture: Subaperture) -> bool {
        self.work_done.blocks += 1;
        let Self { imaging, mti, hands, config, .. } = self;
        let find_moving = || {
            // Those of a window that is imaged again were taken before.
            if mti.newest_ns().is_none_or(|newest_ns| subaperture.mid_time_ns > newest_ns) {
                mti.push(subaperture.uncancelled(), hands, config.settings.tracks.hands_reach_m);
            }
        };
        rayon::join(|| imaging.add(&subaperture), find_moving);
        let now_ns = subaperture.mid_time_ns;
        self.window.push(subaperture);
        let since_ns = now_ns - self.config.window_ns();
        self.window.drop_before(since_ns, || self.imaging.leave());
        self.intake.drop_before(since_ns);
        self.updates.is_due(now_ns)
    }

    /// Begins an update: candidate planes and points.
    fn find_candidates(&mut self) -> Option<Stage> {
        let since_ns = self.window.newest()?.mid_time_ns - self.config.window_ns();
        self.work_done.looks += 1;
        let (plane_peaks, peaks) = self.imaging.peaks(&self.config, since_ns);
        let (planes, points) = self.imaging.candidates(&plane_peaks, &peaks, &self.config);
        self.updates.last = Update { peaks, plane_peaks, ..Update::default() };
        Some(Stage::Detect { planes, peaks: points })
    }

    /// Detects in the window's sub-apertures and updates the tracks.
    fn detect(&mut self, planes: &[Plane], peaks: &[DVec3]) -> Stage {
        let RoomMapperSettings { clean, tracks, .. } = &self.config.settings;
        let (query, cache) = (self.config.query(), &mut self.response_cache);
        let mut clean = CleanWindow::new(self.window.iter(), &self.hands, clean, query, cache);
        // Known objects mask before new ones do.
        let (ids, known_points): (Vec<u64>, Vec<DVec3>) = self.objects.confirmed().map(|p| (p.id, p.estimate)).unzip();
        let known = clean.detect_known(&self.walls.planes(), &known_points);
        let new = clean.detect(planes, peaks);
        let likelihoods = clean.likelihoods(&known_points, &known.responses);
        drop(clean);
        let is_established = |at: DVec3| self.recurrences.is_established(at);
        let removed =
            self.objects.update_existence(&ids, &likelihoods, &self.window, is_established, &tracks.existence);
        self.work_done.forgotten += removed.count;
        let now_ns = self.window.now_ns();
        for at in removed.positions_m {
            self.window.history.mark_removed(at, now_ns);
        }
        for at in removed.established_m {
            self.recurrences.forget(at);
        }
        let screening = self.screening();
        let (known_there, new_there) = (screening.known_detections(&known), screening.new_detections(&new));
        let (points, scored): (Vec<_>, Vec<_>) = known_there.into_iter().chain(new_there).unzip();
        (self.updates.last.places, self.updates.last.planes) = (new.places, new.planes.clone());
        let walls = [known.planes, new.planes].concat();
        self.recurrences.record(points.iter().filter(|point| tracks.may_be_hit(point)), now_ns);
        self.candidates.record(scored);
        self.updates.last.wall_hits = self.walls.update(&walls, tracks, self.window.middle());
        self.updates.last.point_hits = self.objects.update(&points, tracks);
        let facing = Facing { window: &self.window, hands: &self.hands, min_cos: self.config.min_cos };
        self.walls.remove_missed(&walls, facing);
        Stage::Refine { walls, points }
    }

    fn screening(&self) -> Screening<'_> {
        let Self { config, window, hands, objects, walls, candidates, recurrences, .. } = self;
        let background_known_since_ns = self.background.known_since_ns();
        Screening { config, window, hands, objects, walls, candidates, recurrences, background_known_since_ns }
    }

    /// Ends the update: refines the positions.
    fn refine(&mut self, walls: &[Detection<Plane>], points: &[Detection<DVec3>]) {
        self.imaging.request_fine(self.objects.confirmed().map(|p| p.estimate), points, &self.config);
        let facing = Facing { window: &self.window, hands: &self.hands, min_cos: self.config.min_cos };
        self.walls.update_feet(walls, facing);
        let Self { config, window, intake, objects, imaging, .. } = self;
        Refinement { config, window, intake, walls, points }.update(objects, imaging);
        self.updates.evidence_ns = self.window.newest().map(|newest| newest.end_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::test_data::{Echo, sweeps, winding};

    const SHIFT_M: DVec3 = DVec3::new(0.05, 0.03, -0.04);

    /// A mapper that has seen a point and a wall for 5 s from poses that are wrong by [`SHIFT_M`], and what else was there.
    fn mapped_with_wrong_poses(point: DVec3) -> (RoomMapper, [(Echo, f64); 2]) {
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.8 };
        let echoes = [(Echo::Point(point), 8.0), (Echo::Plane(wall), 3.0)];
        let mut mapper = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
        for mut sweep in sweeps(5.0, winding, &echoes, 3) {
            sweep.tracking_from_sensor.translation += SHIFT_M;
            mapper.push(sweep);
        }
        (mapper, echoes)
    }

    fn correct(mapper: &mut RoomMapper) {
        let change = CalibrationChange { time_offset_s: 0.0, mount_m: Some(SHIFT_M.length()) };
        mapper.image_again(&change, |sweep| {
            sweep.tracking_from_sensor.translation -= SHIFT_M;
            true
        });
    }

    fn push(mapper: &mut RoomMapper, echoes: &[(Echo, f64)], from_s: i64, duration_s: f64) {
        for mut sweep in sweeps(duration_s, winding, echoes, 4) {
            sweep.mid_time_ns += from_s * 1_000_000_000;
            mapper.push(sweep);
        }
    }

    fn ids(mapper: &RoomMapper) -> [Vec<u64>; 2] {
        [
            mapper.obstacles().iter().map(|obstacle| obstacle.id).collect(),
            mapper.walls().iter().map(|wall| wall.id).collect(),
        ]
    }

    #[test]
    fn the_room_stays_when_poses_are_corrected_and_moves_to_its_place() {
        let at = DVec3::new(0.2, 0.1, -1.0);
        let (mut mapper, echoes) = mapped_with_wrong_poses(at);
        let before = (ids(&mapper), mapper.obstacles());
        assert_eq!(before.0.each_ref().map(Vec::len), [1, 1], "{:?}", before.0);
        assert!(before.1[0].position_m.distance(at + SHIFT_M) < 0.03, "{:?}", before.1[0].position_m);
        correct(&mut mapper);
        assert_eq!(ids(&mapper), before.0, "nothing is gone at once");
        let doubt = |obstacle: &Obstacle| obstacle.covariance_m2.x_axis.x.sqrt();
        assert!(doubt(&mapper.obstacles()[0]) > 0.03 && doubt(&before.1[0]) < 0.02, "it is less certain");
        push(&mut mapper, &echoes, 5, 1.0);
        assert_eq!(ids(&mapper), before.0, "nothing is there twice");
        assert!(mapper.obstacles()[0].position_m.distance(at) < 0.02, "{:?}", mapper.obstacles()[0].position_m);
        assert!((mapper.walls()[0].plane.offset_m - 1.8).abs() < 0.02, "{:?}", mapper.walls()[0].plane);
        assert!(mapper.counters().blocks > 60, "work before counts");
    }

    #[test]
    fn what_only_wrong_poses_showed_goes() {
        let (mut mapper, echoes) = mapped_with_wrong_poses(DVec3::new(0.2, 0.1, -1.0));
        correct(&mut mapper);
        mapper.intake = SweepIntake::new(mapper.config.settings.subapertures, VecDeque::new());
        push(&mut mapper, &echoes[1..], 5, 2.0);
        assert_eq!(ids(&mapper).map(|ids| ids.len()), [0, 1]);
    }
}
