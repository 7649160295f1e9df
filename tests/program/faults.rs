//! Every fault on the sensor's line, 40 times each; the example `a121_faults` of `crates/a121` does
//! the same a thousand times.

#[path = "../../crates/a121/examples/a121_faults/trial/mod.rs"]
mod trial;

use a121::device::Fault;
use trial::Phase;

#[test]
fn sessions_recover_from_every_fault_and_deliver_only_sent_frames() {
    const TIMES: u64 = 40;
    let (mut accepted, mut phases) = (0, [0, 0, 0]);
    for fault in Fault::ALL {
        for index in 0..TIMES {
            let outcome = trial::run(fault, index, 99);
            assert!(outcome.failures.is_empty(), "{} {index}: {:?}", fault.name(), outcome.failures);
            // Longest time to detect the fault and to reconnect.
            assert!(outcome.recovery_s < 15.0, "{} {index}: {} s", fault.name(), outcome.recovery_s);
            let bytes_alone = matches!(fault, Fault::Drop | Fault::Double | Fault::Flip | Fault::Garbage);
            assert!(outcome.lost <= 3 || !bytes_alone, "{} {index}: {} lost", fault.name(), outcome.lost);
            assert!(outcome.undetected == 0 || bytes_alone, "{} {index}", fault.name());
            assert!(outcome.counters.dropped_events == 0 && outcome.worst_error_s < 0.05);
            accepted += outcome.accepted;
            phases[match outcome.phase {
                Phase::Opening => 0,
                Phase::Streaming => 1,
                Phase::Stopping => 2,
            }] += 1;
        }
    }
    assert!(accepted > 100 * TIMES && phases.iter().all(|count| *count > 10), "{accepted} {phases:?}");
}

#[test]
fn flipped_tick_of_another_sensor_is_refused_even_when_plausible() {
    // The flipped digit moves the tick by one second: 50 results ahead.
    let outcome = trial::run(Fault::Flip, 979, 2);
    assert!(outcome.failures.is_empty(), "{:?}", outcome.failures);
    assert_eq!(outcome.counters.refused_ticks, 1);
}
