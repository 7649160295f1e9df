//! Where the time goes when a room is imaged with preset d16: CPU seconds per second of data, as a share of one core.
//!
//!     cargo run --release --example blocks_speed -- [SECONDS] [SEED] [rooms.blocks.memory_s=2 …]
//!
//! Simulates a furnished and an empty room (natural play, 10 s unless told otherwise), then times each stage by itself, in
//! CPU time of all threads (Linux; elsewhere wall time): joining the streams, blocks (range compression and tables), the
//! field at 5 cm and 2.5 cm, planes, and the whole pipeline; what the pipeline takes beyond its stages are the looks. Each
//! stage is repeated and the least counts. Updates are (voxel in the beam, sweep) pairs.

use std::time::Instant;

use radar_chaperone::engine::{Pipeline, Settings};
use radar_chaperone::imaging::blocks::{Block, BlockBuilder, BlockSettings, Field, PlaneField};
use radar_chaperone::radar::{Observation, preset};
use radar_chaperone::simulation::{Scenario, Simulated};
use radar_chaperone::tracking::{Observer, ObserverSettings};

const REPETITIONS: usize = 3;

fn main() {
    let (mut numbers, mut changes) = (Vec::new(), Vec::new());
    for argument in std::env::args().skip(1) {
        match argument.parse::<f64>() {
            Ok(number) => numbers.push(number),
            Err(_) => changes.push(argument),
        }
    }
    let settings = Settings::from_toml("", &changes).unwrap_or_else(|error| panic!("{error}"));
    let duration_s = numbers.first().copied().unwrap_or(10.0);
    let seed = numbers.get(1).map_or(500, |n| *n as u64);
    for scene in ["furnished-room", "empty-room"] {
        let scenario = Scenario::new(scene, "natural", preset("d16").expect("d16 exists"), duration_s, seed);
        let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
        println!("{scene}, {duration_s} s, seed {seed}");
        stages(&scenario, &simulated, &settings, duration_s);
    }
}

fn stages(scenario: &Scenario, simulated: &Simulated, settings: &Settings, duration_s: f64) {
    let line = |name: &str, cpu_s: f64| println!("  {name:<44}{:>7.2} % of a core", cpu_s / duration_s * 100.0);
    let (join_s, observations) = timed(|| joined(scenario, simulated, settings));
    line("joining the streams", join_s);
    let (copy_s, _) = timed(|| observations.to_vec());
    let (build_s, blocks) = timed(|| blocks(&observations, settings.rooms.blocks));
    line("blocks: range compression, tables", build_s - copy_s);
    for voxel_m in [0.05, 0.025] {
        let with_voxel = BlockSettings { voxel_m, ..settings.rooms.blocks };
        let (field_s, updates) = timed(|| {
            let mut field = Field::new(with_voxel, with_voxel.min_cos(&settings.radar.beam));
            blocks.iter().for_each(|block| field.add(block));
            field.updates
        });
        line(&format!("field, voxels of {} cm", voxel_m * 100.0), field_s);
        println!("      {:.2} G updates, {:.2} G/s", updates as f64 * 1e-9, updates as f64 * 1e-9 / field_s);
    }
    let (planes_s, _) = timed(|| {
        let mut planes = PlaneField::new(settings.rooms.blocks, settings.rooms.blocks.min_cos(&settings.radar.beam));
        blocks.iter().for_each(|block| planes.add(block));
    });
    line("planes", planes_s);
    let (whole_s, counters) = timed(|| whole(scenario, simulated, settings));
    line("the whole pipeline", whole_s);
    println!("      {counters:?}");
}

fn joined(scenario: &Scenario, simulated: &Simulated, settings: &Settings) -> Vec<Observation> {
    let observer = ObserverSettings {
        history: settings.tracking.history,
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: settings.tracking.time_offset_s,
    };
    let mut observer = Observer::new(&scenario.config, observer);
    let mut frames = simulated.frames.iter().peekable();
    let mut observations = Vec::new();
    for pose in &simulated.poses {
        while let Some(frame) = frames.next_if(|f| f.host_time_ns <= pose.time_ns) {
            observer.push_frame(frame.clone());
        }
        observer.push_pose(pose);
        observations.extend(observer.take_ready());
    }
    observations.extend(observer.take_rest());
    observations
}

fn blocks(observations: &[Observation], settings: BlockSettings) -> Vec<Block> {
    let mut builder = BlockBuilder::new(settings);
    let mut blocks: Vec<Block> = observations.iter().filter_map(|o| builder.push(o.clone())).collect();
    blocks.extend(builder.close());
    blocks
}

fn whole(scenario: &Scenario, simulated: &Simulated, settings: &Settings) -> radar_chaperone::obstacles::RoomCounters {
    let mut pipeline = Pipeline::new(&scenario.config, &scenario.head_from_sensor, settings);
    let mut frames = simulated.frames.iter().peekable();
    for pose in &simulated.poses {
        while let Some(frame) = frames.next_if(|f| f.host_time_ns <= pose.time_ns) {
            pipeline.push_frame(frame.clone());
        }
        pipeline.push_pose(pose);
    }
    pipeline.finish();
    pipeline.counters().engine.rooms
}

/// Least CPU time of some repetitions, and what came out.
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

/// CPU time of all threads so far, where the system tells it.
fn cpu_s() -> Option<f64> {
    let mut sum_ns = 0.0;
    for task in std::fs::read_dir("/proc/self/task").ok()? {
        let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        sum_ns += text.split_whitespace().next()?.parse::<f64>().ok()?;
    }
    Some(sum_ns * 1e-9)
}
