//! How long single steps of the mapper block the stream: natural play in a furnished room, preset
//! d16.
//!
//!     cargo run --release -p lab --example step_times -- [SECONDS] [SEED] [THREADS]
//!
//! A step is the processing that one pushed pose triggers: the sweeps that it completes, usually
//! nothing else; sometimes a sub-aperture, an update of the map, or an estimate of the time offset.
//! Steps are sorted by what they triggered. The scene is timed separately.

use radar_mapping::in_time_order;
use std::time::Instant;

use a121::preset;
use radar_chaperone::app::Latency;
use radar_mapping::MappingSettings;
use radar_mapping::{Mapper, MapperCounters};
use radar_simulation::Scenario;

fn main() {
    let arguments: Vec<f64> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let argument = |n: usize, or: f64| arguments.get(n).copied().unwrap_or(or);
    let (duration_s, seed, threads) = (argument(0, 30.0), argument(1, 1.0) as u64, argument(2, 1.0) as usize);
    let config = preset("d16").expect("a preset");
    let scenario = Scenario::new("furnished-room", "natural", config, duration_s, seed);
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default());
    let names = ["sweeps only", "sub-aperture", "with update", "estimate", "scene"];
    let mut times = names.map(|_| Latency::default());
    let begin = Instant::now();
    for event in in_time_order(simulated.frames, simulated.poses) {
        let before = mapper.counters();
        let step = Instant::now();
        let _ = pool.install(|| mapper.push(event));
        let took_ns = step.elapsed().as_nanos() as i64;
        let kind = kind(&before, &mapper.counters());
        times[kind].push(took_ns);
        if kind == 2 {
            let step = Instant::now();
            pool.install(|| std::hint::black_box(mapper.scene()));
            times[4].push(step.elapsed().as_nanos() as i64);
        }
    }
    println!("{duration_s} s of play processed in {:.1} s on {threads} threads", begin.elapsed().as_secs_f64());
    println!("{:16}{:>8}{:>12}{:>12}{:>12}", "step", "times", "median ms", "p99 ms", "longest ms");
    for (name, times) in names.iter().zip(&times) {
        let report = times.report();
        println!(
            "{name:16}{:>8}{:>12.2}{:>12.2}{:>12.2}",
            report.count,
            report.median_s * 1e3,
            report.p99_s * 1e3,
            report.max_s * 1e3
        );
    }
}

fn kind(before: &MapperCounters, after: &MapperCounters) -> usize {
    let rose = |of: fn(&MapperCounters) -> u64| of(after) > of(before);
    if rose(|c| c.time_offset.estimates) {
        return 3;
    }
    match (rose(|c| c.engine.rooms.blocks), rose(|c| c.engine.rooms.looks)) {
        (_, true) => 2,
        (true, false) => 1,
        (false, false) => 0,
    }
}
