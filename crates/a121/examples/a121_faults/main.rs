//! Effect of each fault on the sensor's line: every fault many times, at random times of sessions
//! with a simulated board, in simulated time.
//!
//! Fails when a session panics, delivers a frame that was not sent, gives a time beyond its stated
//! accuracy, or does not recover by itself.
//!
//!     cargo run --release -p a121 --features simulated-board --example a121_faults -- \
//!         [TIMES] [SEED] [FILE.md]
//!
//! By default 1000 times each with seed 1; docs/results/faults.md is made with both defaults.

mod trial;

use std::fmt::Write;
use std::process::ExitCode;

use a121::SessionCounters;
use a121::device::Fault;
use rayon::prelude::*;
use trial::{Outcome, Phase};

fn quantiles(mut values: Vec<f64>) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    (values.get(values.len() / 2).copied().unwrap_or(0.0), values.last().copied().unwrap_or(0.0))
}

/// The counters of irregularities, by name.
fn named(c: &SessionCounters) -> [(&'static str, u64); 14] {
    [
        ("resyncs", c.stream.resyncs),
        ("damaged lines", c.stream.damaged_lines),
        ("damaged payloads", c.stream.damaged_payloads),
        ("misfit results", c.stream.misfit_results),
        ("stale results", c.stream.stale_results),
        ("doubtful", c.stream.unconfirmed_damage),
        ("refused ticks", c.refused_ticks),
        ("tick jumps", c.tick_jumps),
        ("unanswered", c.unanswered),
        ("silences", c.silences),
        ("unexpected replies", c.unexpected_replies),
        ("recalibrations", c.recalibrations),
        ("connects", c.connects.saturating_sub(1)),
        ("dropped events", c.dropped_events),
    ]
}

fn counted(outcomes: &[Outcome]) -> String {
    let rows: Vec<_> = outcomes.iter().map(|outcome| named(&outcome.counters)).collect();
    let names = named(&SessionCounters::default()).map(|(name, _)| name);
    let sums = names.iter().enumerate().map(|(i, name)| (*name, rows.iter().map(|row| row[i].1).sum::<u64>()));
    let texts: Vec<String> = sums.filter(|(_, sum)| *sum > 0).map(|(name, sum)| format!("{name} {sum}")).collect();
    if texts.is_empty() { "–".into() } else { texts.join(", ") }
}

fn row(fault: Fault, outcomes: &[Outcome]) -> String {
    let of = |phase| outcomes.iter().filter(move |o| o.phase == phase);
    let times = |phase| quantiles(of(phase).map(|o| o.recovery_s).collect());
    let (opening, streaming, stopping) = (times(Phase::Opening), times(Phase::Streaming), times(Phase::Stopping));
    let lost = quantiles(of(Phase::Streaming).map(|o| o.lost as f64).collect());
    let undetected: u64 = outcomes.iter().map(|o| o.undetected).sum();
    let error_s = outcomes.iter().map(|o| o.worst_error_s).fold(0.0, f64::max);
    format!(
        "| {} | {} | {:.3} | {:.2} | {} | {} | {:.2} | {:.2} | {:.2} | {} | {:.2} | {} |",
        fault.name(),
        outcomes.len(),
        streaming.0,
        streaming.1,
        lost.0,
        lost.1,
        opening.0,
        opening.1,
        stopping.1,
        undetected,
        error_s * 1e3,
        counted(outcomes)
    )
}

const HEAD: &str = "# Faults on the sensor's line

Made by `cargo run --release -p a121 --features simulated-board --example a121_faults -- TIMES SEED docs/results/faults.md`:
sessions with a simulated board (XC120 over USB and TCP, one and three sensors; XM125 at 2 Mbaud; SparkFun's at 115 200 baud), in
simulated time. Each session meets one fault at a random time: three in ten before streaming, with the reply to one of the
commands, six in ten while frames are streamed, one in ten while the session stops. Every delivered frame is compared with what
the board sent with that tick, bit for bit, and its time with the true end of its measurement.

- *Recovery*, while streaming: from the fault to the frame from which on none is missed, seconds; *lost*: frames missed.
- *Opening*: from a fault before streaming to the first frame, seconds; without a fault up to 1.7 s: the break and the
  second of silence that boards require after it, 0.2 s of calibration, two frames. *Stop*: from a fault while stopping to the end.
- *Undetected*: frames delivered with a flipped bit in a sample, or a changed digit in a temperature or, within 3 % of a
  period, in a tick: the protocol has no checksum, so they cannot be detected.
- *Time*: greatest error of a frame's time after the first 2 s of frames, milliseconds, without the delay common to all.
";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let times: u64 = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1000);
    let seed: u64 = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut table = String::from(HEAD);
    let (mut accepted, mut failed) = (0, 0);
    table.push_str(
        "\n| fault | times | recovery (s): median | worst | lost: median | worst | opening (s): median | worst | ",
    );
    table.push_str("stop (s): worst | undetected | time (ms): worst | counted |\n");
    table.push_str("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|\n");
    for fault in Fault::ALL {
        let outcomes: Vec<Outcome> = (0..times).into_par_iter().map(|index| trial::run(fault, index, seed)).collect();
        for (index, outcome) in outcomes.iter().enumerate() {
            let told = outcome.failures.iter().take(3);
            told.for_each(|failure| eprintln!("{} {index} {:?}: {failure}", fault.name(), outcome.phase));
            failed += u64::from(!outcome.failures.is_empty());
        }
        accepted += outcomes.iter().map(|o| o.accepted).sum::<u64>();
        let row = row(fault, &outcomes);
        eprintln!("{row}");
        let _ = writeln!(table, "{row}");
    }
    let _ =
        writeln!(table, "\nSeed {seed}. {accepted} frames were delivered; sessions that failed in any way: {failed}.");
    let written = match arguments.next() {
        Some(path) => std::fs::write(path, &table),
        None => std::io::Write::write_all(&mut std::io::stdout(), table.as_bytes()),
    };
    if failed == 0 && written.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
