//! Latency of the reconstruction next to a frame loop, in real time, for any length, pose rate,
//! error of the poses' stamps and number of threads. The documented table is `lab results speed`.
//!
//!     cargo run --release -p lab --example live_latency -- [SECONDS] [SEED] [POSES_HZ] [STAMPS_MS] [THREADS]

use lab::experiments::LiveLatency;

fn main() {
    let arguments: Vec<f64> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let argument = |n: usize, or: f64| arguments.get(n).copied().unwrap_or(or);
    let default = LiveLatency::default();
    let session = LiveLatency {
        duration_s: argument(0, default.duration_s),
        seed: argument(1, default.seed as f64) as u64,
        poses_hz: argument(2, default.poses_hz),
        stamp_s: argument(3, 0.0) * 1e-3,
        threads: arguments.get(4).map(|threads| *threads as usize),
    };
    let table = session.table();
    println!("{}\n{}", table.aligned(), table.caption);
}
