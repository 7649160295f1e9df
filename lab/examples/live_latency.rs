//! Latency of the reconstruction next to a frame loop, in real time: natural play in a furnished
//! room, preset d16. Frames arrive 2 ms after their end, poses at the display's rate or another
//! one; the frame loop takes the newest scene at every display frame and computes its warnings.
//!
//!     cargo run --release -p lab --example live_latency -- [SECONDS] [SEED] [POSES_HZ] [THREADS]
//!
//! "Sweep to frame" is the time from a frame's arrival to the display frame drawn from data that
//! include it: the wait for the next pose, the processing, and the wait for the display frame. The
//! age of the evidence comes on top and is printed separately.

use radar_mapping::Event;
use std::collections::VecDeque;
use std::time::Duration;

use a121::preset;
use radar_chaperone::app::{Latency, LatencyReport, Reconstruction, ReconstructionOptions, now_ns, thread_cpu_ns};
use radar_chaperone::settings::Settings;
use radar_chaperone::warning::warn;
use radar_simulation::Scenario;

const DISPLAY_HZ: f64 = 90.0;
/// Time from a frame's end to its arrival, nanoseconds.
const LINK_NS: i64 = 2_000_000;

fn main() {
    let arguments: Vec<f64> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let argument = |n: usize, or: f64| arguments.get(n).copied().unwrap_or(or);
    let (duration_s, seed, poses_hz) = (argument(0, 30.0), argument(1, 1.0) as u64, argument(2, DISPLAY_HZ));
    let threads = arguments.get(3).map(|threads| *threads as usize);
    let config = preset("d16").expect("a preset");
    let mut scenario = Scenario::new("furnished-room", "natural", config, duration_s, seed);
    scenario.errors.rate_hz = poses_hz;
    let simulated = scenario.run().unwrap_or_else(|error| panic!("{error}"));
    let options = ReconstructionOptions { threads, ..Default::default() };
    let settings = Settings::default();
    let reconstruction =
        Reconstruction::start(&scenario.config, &scenario.head_from_sensor, &settings, &options).expect("threads");
    let begin_ns = now_ns() + 100_000_000;
    let shift_ns = begin_ns - simulated.poses[0].time_ns;
    let (arrived, arrivals) = std::sync::mpsc::channel::<(i64, i64)>();
    let (to_frame, frame_cpu) = std::thread::scope(|scope| {
        let (reconstruction, frames, poses) = (&reconstruction, &simulated.frames, &simulated.poses);
        scope.spawn(move || {
            for frame in frames {
                let mut frame = frame.clone();
                frame.host_time_ns += shift_ns;
                wait_until(frame.host_time_ns + LINK_NS);
                let _ = arrived.send((frame.host_time_ns, now_ns()));
                reconstruction.push(Event::Frame(frame));
            }
        });
        scope.spawn(move || {
            for pose in poses {
                let pose = radar_sar::PoseSample { time_ns: pose.time_ns + shift_ns, ..*pose };
                wait_until(pose.time_ns);
                reconstruction.push(Event::Pose(pose));
            }
        });
        scope.spawn(move || frame_loop(reconstruction, &settings, begin_ns, duration_s, &arrivals)).join()
    })
    .expect("no panic");
    let (counters, scene) = reconstruction.finish();
    println!("{:24}{:>8}{:>12}{:>10}{:>10}", "", "count", "median ms", "p99 ms", "max ms");
    line("arrival to processed", &counters.processed);
    line("sweep to frame", &to_frame.report());
    line("age of evidence", &counters.evidence_age);
    line("longest steps", &counters.step);
    line("frame loop, CPU", &frame_cpu.report());
    println!(
        "{} obstacles, {} scenes, {:.1} % of a core, dropped {} frames and {} poses, {:?}",
        scene.obstacles.len(),
        counters.scenes,
        100.0 * counters.cpu_s / counters.running_s,
        counters.frames_dropped,
        counters.poses_dropped,
        counters.mapper.time_offset
    );
}

/// Takes the scene, computes warnings and measures, at every display frame.
fn frame_loop(
    reconstruction: &Reconstruction,
    settings: &Settings,
    begin_ns: i64,
    duration_s: f64,
    arrivals: &std::sync::mpsc::Receiver<(i64, i64)>,
) -> (Latency, Latency) {
    let (mut to_frame, mut cpu, mut waiting) = (Latency::default(), Latency::default(), VecDeque::new());
    for n in 0..(duration_s * DISPLAY_HZ) as i64 {
        wait_until(begin_ns + (n as f64 / DISPLAY_HZ * 1e9) as i64);
        let cpu_ns = thread_cpu_ns();
        let newest = reconstruction.latest();
        std::hint::black_box(warn(&newest.scene, &radar_sar::geometry::Pose::IDENTITY, &settings.warning));
        cpu.push(thread_cpu_ns() - cpu_ns);
        waiting.extend(arrivals.try_iter());
        while let Some((_, arrived_ns)) =
            waiting.pop_front_if(|(end_ns, _): &mut (i64, i64)| *end_ns < newest.newest_sweep_ns + 1_000_000)
        {
            to_frame.push(now_ns() - arrived_ns);
        }
    }
    (to_frame, cpu)
}

fn wait_until(at_ns: i64) {
    let wait_ns = at_ns - now_ns();
    if wait_ns > 0 {
        std::thread::sleep(Duration::from_nanos(wait_ns as u64));
    }
}

fn line(name: &str, report: &LatencyReport) {
    println!(
        "{name:24}{:>8}{:>12.2}{:>10.2}{:>10.2}",
        report.count,
        report.median_s * 1e3,
        report.p99_s * 1e3,
        report.max_s * 1e3
    );
}
