//! Latency of the reconstruction next to a frame loop, in real time: natural play in a furnished
//! room, preset d16. Frames arrive 2 ms after their end, poses at the display's rate or another
//! one; the frame loop takes the newest scene at every display frame and computes its warnings.

use std::collections::VecDeque;
use std::time::Duration;

use a121::preset;
use radar_chaperone::app::{
    Latency, LatencyReport, Reconstruction, ReconstructionCounters, ReconstructionOptions, now_ns, thread_cpu_ns,
};
use radar_chaperone::report::Table;
use radar_chaperone::settings::Settings;
use radar_chaperone::warning::warn;
use radar_mapping::{Event, Scene};
use radar_simulation::{Scenario, Simulated};

/// Display frames a second. Choice: the usual rate of headsets.
const DISPLAY_HZ: f64 = 90.0;
/// Time from a frame's end to its arrival, nanoseconds. A choice: USB's polling and a frame's
/// transfer take about that long.
const LINK_NS: i64 = 2_000_000;

/// A session in real time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiveLatency {
    /// Length, seconds.
    pub duration_s: f64,
    /// Seed of the room and the motion.
    pub seed: u64,
    /// Poses per second.
    pub poses_hz: f64,
    /// Error of the poses' stamps, seconds rms.
    pub stamp_s: f64,
    /// Threads of the reconstruction; `None`: as the program chooses.
    pub threads: Option<usize>,
}

impl Default for LiveLatency {
    fn default() -> Self {
        Self { duration_s: 30.0, seed: 1, poses_hz: DISPLAY_HZ, stamp_s: 0.0, threads: None }
    }
}

impl LiveLatency {
    /// Plays it and returns times in ms, one row per kind.
    ///
    /// # Panics
    /// When threads cannot be started.
    pub fn table(&self) -> Table {
        let config = preset("d16").expect("a preset");
        let mut scenario = Scenario::new("furnished-room", "natural", config, self.duration_s, self.seed);
        scenario.errors.rate_hz = self.poses_hz;
        scenario.errors.stamp_s = self.stamp_s;
        let simulated = scenario.run().expect("the scene exists");
        let options = ReconstructionOptions { threads: self.threads, ..Default::default() };
        let settings = Settings::default();
        let reconstruction =
            Reconstruction::start(&scenario.config, &scenario.head_from_sensor, None, &settings, &options)
                .expect("threads");
        let (to_frame, frame_cpu) = self.play(&reconstruction, &simulated, &settings);
        let (counters, scene) = reconstruction.finish();
        let rows = [
            ("from a frame's arrival to processed", &counters.processed),
            ("from a frame's arrival to the display frame drawn from it", &to_frame.report()),
            ("age of the evidence in a scene", &counters.evidence_age),
            ("longest steps of the reconstruction", &counters.step),
            ("processor time of the frame loop", &frame_cpu.report()),
        ];
        let head = ["time", "count", "median (ms)", "p99 (ms)", "greatest (ms)"];
        Table {
            head: head.map(str::to_owned).to_vec(),
            rows: rows.map(|(name, report)| row(name, report)).to_vec(),
            caption: summary(&counters, &scene),
        }
    }

    /// Feeds the recording in real time and runs the frame loop beside it.
    fn play(&self, reconstruction: &Reconstruction, simulated: &Simulated, settings: &Settings) -> (Latency, Latency) {
        let begin_ns = now_ns() + 100_000_000;
        let shift_ns = begin_ns - simulated.poses[0].time_ns;
        let (arrived, arrivals) = std::sync::mpsc::channel::<(i64, i64)>();
        let (frames, poses) = (&simulated.frames, &simulated.poses);
        std::thread::scope(|scope| {
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
            let duration_s = self.duration_s;
            scope.spawn(move || frame_loop(reconstruction, settings, begin_ns, duration_s, &arrivals)).join()
        })
        .expect("no panic")
    }
}

fn summary(counters: &ReconstructionCounters, scene: &Scene) -> String {
    format!(
        "{} obstacles at the end, {} scenes, the reconstruction took {:.1} % of a core; {} frames and {} poses dropped.",
        scene.obstacles.len(),
        counters.scenes,
        100.0 * counters.cpu_s / counters.running_s,
        counters.frames_dropped,
        counters.poses_dropped,
    )
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

fn row(name: &str, report: &LatencyReport) -> Vec<String> {
    let ms = |seconds: f64| format!("{:.2}", seconds * 1e3);
    vec![name.to_owned(), report.count.to_string(), ms(report.median_s), ms(report.p99_s), ms(report.max_s)]
}
