//! Accuracy of sweep times estimated from sensor ticks and late arrivals: rms error after 2 s
//! against the truth, over seeds.
//!
//!     cargo run --release -p a121 --features simulated-board --example a121_clock -- [SEEDS]
//!
//! 20 seeds by default. The simulated boards' clocks drift by 40 ppm and change as they warm up.
//! Frames are regular to 10 µs. Results arrive 0.1 ms late on average, plus a delay by the reading
//! process: `stalls`: polls of 1 ms, one in ten with a stall of up to 30 ms; `bursts`: one burst
//! every 30 ms.

#[path = "../src/clock_simulation.rs"]
mod clock_simulation;

use a121::{Clock, ClockReport};
use clock_simulation::{ArrivalPattern, SimulatedClock, TRANSFER_S};

/// Rms error from 2 s to `to_s`, seconds, and the clock's own report.
fn rms_error_s(world: &mut SimulatedClock, to_s: f64) -> (f64, ClockReport) {
    let mut clock = Clock::new(world.ticks_per_second as u32, 1.0 / world.frame_rate, TRANSFER_S);
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..(to_s * world.frame_rate) as u64 {
        let (end_s, tick, arrival_s) = world.frame(k);
        let time_ns = clock.time_ns(tick, (arrival_s * 1e9) as i64);
        if k as f64 >= 2.0 * world.frame_rate {
            sum += (time_ns as f64 * 1e-9 - end_s).powi(2);
            count += 1.0;
        }
    }
    (f64::sqrt(sum / count), clock.report())
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(20).max(1);
    println!("ticks   reader  frames/s  from-to     rms ms  median  worst  drift ppm  jitter ms");
    for ticks_per_second in [1e3, 1e6] {
        for (reader, name) in [(ArrivalPattern::Stalls, "stalls"), (ArrivalPattern::Bursts, "bursts")] {
            for (frame_rate, to_s) in [66.0, 86.3, 120.0, 500.0].into_iter().flat_map(|f| [(f, 10.0), (f, 60.0)]) {
                let runs = (0..seeds).map(|seed| {
                    rms_error_s(&mut SimulatedClock::new(seed, frame_rate, ticks_per_second, reader), to_s)
                });
                let (mut errors, reports): (Vec<f64>, Vec<ClockReport>) = runs.unzip();
                let mean = |value: fn(&ClockReport) -> f64| reports.iter().map(value).sum::<f64>() / seeds as f64;
                let rms = (errors.iter().map(|e| e * e).sum::<f64>() / seeds as f64).sqrt();
                errors.sort_by(f64::total_cmp);
                println!(
                    "{:<7} {name}  {frame_rate:>8}  2-{to_s:<3} s   {:>7.3} {:>7.3} {:>6.3} {:>10.1} {:>10.3}",
                    if ticks_per_second < 1e6 { "1 ms" } else { "1 us" },
                    rms * 1e3,
                    errors[errors.len() / 2] * 1e3,
                    errors[errors.len() - 1] * 1e3,
                    mean(|r| r.drift_ppm),
                    mean(|r| r.jitter_s) * 1e3
                );
            }
        }
    }
}
