//! Cost of each stage of room imaging with preset d16: CPU seconds per second of data, as a share
//! of one core.
//!
//! Each stage is timed by itself, in CPU time of all threads (Linux; elsewhere wall time): joining the streams;
//! sub-apertures (range compression and tables); the score field at 5 cm and 2.5 cm; planes; the estimates of time
//! offset and mount once a second, as often as the mapper makes them at most; the fine field of 1 cm wherever the
//! mapper opens it, updated four times a second; and the whole mapper, with and without the estimates.
//! What the mapper takes beyond these stages are the map updates. In the mapper most fine bricks are
//! never read and so never computed.

use radar_mapping::{Event, in_time_order};
use std::time::Instant;

use a121::preset;
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_mapping::RoomMapper;
use radar_mapping::{Mapper, MapperCounters};
use radar_mapping::{Observer, ObserverSettings, SensorState};
use radar_sar::Observation;
use radar_sar::subaperture::{
    Field, FineField, FineSettings, PlaneField, Subaperture, SubapertureBuilder, SubapertureSettings,
};
use radar_sar::{CalibrationSettings, SelfCalibration};
use radar_simulation::{Scenario, ScenarioError, Simulated};

/// Repetitions of each stage, of which the shortest counts. Choice: two may both be disturbed.
const REPETITIONS: usize = 3;

/// A simulated recording whose processing is timed.
#[derive(Debug, Clone)]
pub struct PipelineCost {
    /// The simulated scene, for example `furnished-room`.
    pub scene: String,
    /// How the sensor moves in it, for example `natural`.
    pub motion: String,
    /// Length of the recording, seconds.
    pub duration_s: f64,
    /// Its seed.
    pub seed: u64,
    /// Settings of the mapper.
    pub settings: Settings,
}

impl PipelineCost {
    /// Of natural play with the default settings.
    pub fn of_play(scene: &str, duration_s: f64) -> Self {
        let (motion, settings) = ("natural".into(), Settings::default());
        Self { scene: scene.into(), motion, duration_s, seed: 500, settings }
    }

    /// Share of a core of the whole mapper, percent.
    ///
    /// # Errors
    /// There is no such scene or motion.
    pub fn whole_share(&self) -> Result<String, ScenarioError> {
        let table = self.table(true)?;
        Ok(table.rows.last().expect("the whole mapper is timed")[1].clone())
    }

    /// The stages one by one and the whole mapper, or the whole mapper alone. Updates are (voxel in
    /// the beam, sweep) pairs.
    ///
    /// # Errors
    /// There is no such scene or motion.
    pub fn table(&self, whole_alone: bool) -> Result<Table, ScenarioError> {
        let config = preset("d16").expect("d16 exists");
        let scenario = Scenario::new(&self.scene, &self.motion, config, self.duration_s, self.seed);
        let simulated = scenario.run()?;
        let mut costs = Costs { duration_s: self.duration_s, rows: Vec::new() };
        if !whole_alone {
            stages(&scenario, &simulated, &self.settings, &mut costs);
        }
        pipelines(&scenario, &simulated, &self.settings, &mut costs);
        let head = ["stage", "% of a core", "work"].map(str::to_owned).to_vec();
        let caption = format!("{}, {}, {} s, seed {}", self.scene, self.motion, self.duration_s, self.seed);
        Ok(Table { head, rows: costs.rows, caption })
    }
}

/// The rows so far.
struct Costs {
    duration_s: f64,
    rows: Vec<Vec<String>>,
}

impl Costs {
    fn add(&mut self, stage: &str, cpu_s: f64, work: String) {
        self.rows.push(vec![stage.to_owned(), format!("{:.2}", cpu_s / self.duration_s * 100.0), work]);
    }
}

fn stages(scenario: &Scenario, simulated: &Simulated, settings: &Settings, costs: &mut Costs) {
    let (join_s, (observations, path)) = timed(|| joined(scenario, simulated, settings));
    costs.add("joining the streams", join_s, String::new());
    let (copy_s, _) = timed(|| observations.to_vec());
    let (build_s, subapertures) = timed(|| subapertures(&observations, settings.rooms.subapertures));
    costs.add("sub-apertures: range compression, tables", build_s - copy_s, String::new());
    for voxel_m in [settings.rooms.subapertures.voxel_m, 0.025] {
        let with_voxel = SubapertureSettings { voxel_m, ..settings.rooms.subapertures };
        let (field_s, updates) = timed(|| {
            let mut field = Field::new(with_voxel, with_voxel.min_cos(&settings.radar.beam));
            subapertures.iter().for_each(|subaperture| field.add(subaperture));
            field.updates
        });
        let giga = updates as f64 * 1e-9;
        let work = format!("{giga:.2} G updates, {:.2} G/s", giga / field_s);
        costs.add(&format!("field, voxels of {:.1} cm", voxel_m * 100.0), field_s, work);
    }
    let (planes_s, _) = timed(|| {
        let mut planes =
            PlaneField::new(settings.rooms.subapertures, settings.rooms.subapertures.min_cos(&settings.radar.beam));
        subapertures.iter().for_each(|subaperture| planes.add(subaperture));
    });
    costs.add("planes", planes_s, String::new());
    let (offset_s, _) = timed(|| time_offset(&observations, &path, settings));
    costs.add("time offset and mount, estimated once a second", offset_s, String::new());
    fine(&observations, &subapertures, settings, costs);
}

fn pipelines(scenario: &Scenario, simulated: &Simulated, settings: &Settings, costs: &mut Costs) {
    let mut as_set = settings.clone();
    (as_set.tracking.estimate_time_offset, as_set.tracking.estimate_mount) = (false, false);
    let (whole_s, _) = timed(|| whole(scenario, simulated, &as_set));
    costs.add("the whole mapper, time offset and mount as set", whole_s, String::new());
    let (whole_s, counters) = timed(|| whole(scenario, simulated, settings));
    let rooms = counters.engine.rooms;
    let work = format!("{} sub-apertures, {} map updates", rooms.blocks, rooms.looks);
    costs.add("the whole mapper", whole_s, work);
}

fn joined(scenario: &Scenario, simulated: &Simulated, settings: &Settings) -> (Vec<Observation>, Vec<SensorState>) {
    let observer = ObserverSettings::new(&settings.mapping(), &scenario.head_from_sensor);
    let mut observer = Observer::new(&scenario.config, observer);
    let (mut observations, mut path) = (Vec::new(), Vec::new());
    for event in in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()) {
        let _ = match event {
            Event::Frame(frame) => observer.push_frame(frame),
            Event::Pose(pose) => observer.push_pose(&pose),
            Event::Hands(_) => Ok(()),
        };
        observations.extend(observer.take_ready());
        path.extend(observer.take_path());
    }
    observations.extend(observer.take_rest());
    (observations, path)
}

fn time_offset(observations: &[Observation], path: &[SensorState], settings: &Settings) {
    let tracking = &settings.tracking;
    let mut estimator = SelfCalibration::new(CalibrationSettings::new(tracking.time_offset_s, tracking.errors));
    let mut path = path.iter().peekable();
    let mut next_ns = observations.first().map_or(0, |o| o.mid_time_ns) + 1_000_000_000;
    for observation in observations {
        estimator.push_sweep(observation);
        while let Some(at) = path.next_if(|at| at.time_ns <= observation.mid_time_ns) {
            estimator.push_path(at.time_ns, &at.tracking_from_sensor, at.velocity_m_per_s);
        }
        if observation.mid_time_ns >= next_ns {
            next_ns += 1_000_000_000;
            estimator.estimate();
        }
    }
}

/// One map update: index of the last sub-aperture before it, and centres of the bricks open after
/// it.
type Update = (usize, Vec<glam::DVec3>);

/// The fine field as the mapper opens it, fully recomputed at every update, then compared with a
/// dense field.
fn fine(observations: &[Observation], subapertures: &[Subaperture], settings: &Settings, costs: &mut Costs) {
    let updates = updates(observations, settings);
    let (fine_s, fine) = timed(|| replayed_field(subapertures, &updates, settings, usize::MAX));
    let open = updates.iter().map(|(_, bricks)| bricks.len()).sum::<usize>() / updates.len().max(1);
    let work = format!("{open} bricks open on average, {:.2} G updates", fine.counters().updates as f64 * 1e-9);
    costs.add("fine field, 1 cm where opened", fine_s, work);
    // The update that opened most bricks, late enough for a full window; compared one second later.
    let new = |n: &usize| updates[*n].1.iter().filter(|brick| !updates[n - 1].1.contains(brick)).count();
    let full = |n: &usize| window(subapertures, updates[*n].0, settings).start > 0;
    let Some(at) = (1..updates.len().saturating_sub(4)).filter(full).max_by_key(new) else { return };
    let opened: Vec<glam::DVec3> = updates[at]
        .1
        .iter()
        .filter(|b| !updates[at - 1].1.contains(b) && updates[at + 4].1.contains(b))
        .copied()
        .collect();
    let (first, last) = (window(subapertures, updates[at].0, settings).start, updates[at + 4].0);
    let voxel_m = settings.rooms.fine.voxel_m;
    let with_voxel = SubapertureSettings { voxel_m, ..settings.rooms.subapertures };
    let mut dense = Field::new(with_voxel, with_voxel.min_cos(&settings.radar.beam));
    let start = cpu_s();
    subapertures[first..=last].iter().for_each(|subaperture| dense.add(subaperture));
    let dense_s = cpu_s().zip(start).map_or(f64::NAN, |(end, start)| end - start);
    let span_s = (subapertures[last].mid_time_ns - subapertures[first].mid_time_ns) as f64 * 1e-9;
    let dense_updates = dense.updates as f64 / span_s * costs.duration_s;
    let share = fine.counters().updates as f64 / dense_updates * 100.0;
    let fine = replayed_field(subapertures, &updates, settings, at + 4);
    let (mut equal, mut different) = (0, 0);
    for voxel in opened.iter().flat_map(|brick| voxels(*brick, voxel_m)) {
        match fine.field().score_at(voxel) == dense.score_at(voxel) {
            true => equal += 1,
            false => different += 1,
        }
    }
    let work = format!(
        "{:.2} G updates, the fine field's are {share:.2} % of them; of {} bricks a second after opening {equal} \
         voxels are equal to the fine field's, {different} not",
        dense_updates * 1e-9,
        opened.len()
    );
    costs.add("dense field, 1 cm", dense_s / span_s * costs.duration_s, work);
}

/// The bricks that the mapper opens, update by update.
fn updates(observations: &[Observation], settings: &Settings) -> Vec<Update> {
    let mut search = RoomMapper::new(settings.rooms, &settings.radar.beam, settings.tracking.errors);
    let mut updates: Vec<Update> = Vec::new();
    for observation in observations {
        search.push(observation.clone());
        if search.counters().looks as usize > updates.len() {
            updates.push((search.counters().blocks as usize - 1, search.fine().open_bricks()));
        }
    }
    updates
}

/// A fine field with exactly these bricks open after each update, up to a given one.
fn replayed_field(
    subapertures: &[Subaperture],
    updates: &[Update],
    settings: &Settings,
    last_update: usize,
) -> FineField {
    let follow =
        FineSettings { max_opened: usize::MAX, max_bricks: usize::MAX, keep_updates: 0, ..settings.rooms.fine };
    let rooms = &settings.rooms;
    let mut fine = FineField::new(follow, rooms.subapertures, rooms.subapertures.min_cos(&settings.radar.beam));
    let (mut next, mut first) = (0, 0);
    for (last, bricks) in updates.iter().take(last_update.saturating_add(1)) {
        while next <= *last {
            fine.push_subaperture(&subapertures[next]);
            let in_window = window(subapertures, next, settings);
            (first..in_window.start).for_each(|_| fine.pop_subaperture());
            (next, first) = (next + 1, in_window.start);
        }
        fine.request(bricks, 1e-6);
        fine.update_all(&subapertures[first..next].iter().collect::<Vec<_>>());
    }
    fine
}

/// Sub-apertures in the window when one has arrived.
fn window(subapertures: &[Subaperture], last: usize, settings: &Settings) -> std::ops::Range<usize> {
    let since_ns = subapertures[last].mid_time_ns - (settings.rooms.clean.window_s * 1e9) as i64;
    subapertures[..last].partition_point(|subaperture| subaperture.mid_time_ns < since_ns)..last + 1
}

/// Centres of a brick's voxels.
fn voxels(brick: glam::DVec3, voxel_m: f64) -> impl Iterator<Item = glam::DVec3> {
    let along = |n: usize| (n % 8) as f64 - 3.5;
    (0..512).map(move |n| brick + glam::DVec3::new(along(n), along(n / 8), along(n / 64)) * voxel_m)
}

fn subapertures(observations: &[Observation], settings: SubapertureSettings) -> Vec<Subaperture> {
    let mut builder = SubapertureBuilder::new(settings);
    let mut subapertures: Vec<Subaperture> = observations.iter().filter_map(|o| builder.push(o.clone())).collect();
    subapertures.extend(builder.close());
    subapertures
}

fn whole(scenario: &Scenario, simulated: &Simulated, settings: &Settings) -> MapperCounters {
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings.mapping());
    mapper.push_all(in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()));
    mapper.counters()
}

/// Minimum CPU time of the repetitions, and the result.
fn timed<T>(work: impl Fn() -> T) -> (f64, T) {
    let mut least = f64::INFINITY;
    let mut result = None;
    for _ in 0..REPETITIONS {
        let (start, wall) = (cpu_s(), Instant::now());
        result = Some(work());
        let took = cpu_s().zip(start).map_or(wall.elapsed().as_secs_f64(), |(end, start)| end - start);
        least = least.min(took);
    }
    (least, result.expect("at least one repetition"))
}

/// CPU time of all threads so far, seconds, where the system provides it.
fn cpu_s() -> Option<f64> {
    let mut sum_ns = 0.0;
    for task in std::fs::read_dir("/proc/self/task").ok()? {
        let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        sum_ns += text.split_whitespace().next()?.parse::<f64>().ok()?;
    }
    Some(sum_ns * 1e-9)
}
