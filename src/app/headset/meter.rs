//! Measures the frame loop: its cost, missed frames, and the age of sweeps when a frame shows their
//! result. Fixed memory.

use crate::app::{Latency, LatencyReport};

/// A frame that starts later than this many periods after the previous one follows a missed frame.
/// Choice: half-way between a frame in time and one missed, so jitter is not counted.
const LATE_PERIODS: f64 = 1.5;

/// A frame's start and end in host time.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameTimes {
    pub start_ns: i64,
    pub end_ns: i64,
    /// Its processor time.
    pub cpu_ns: i64,
    /// Time during the frame within the runtime's calls.
    pub in_runtime_ns: i64,
    /// Time during the frame in which the loop was runnable and had no core.
    pub waited_ns: i64,
    /// The same between the end of the previous frame and this one.
    pub waited_before_ns: i64,
}

/// Counts frames.
pub(super) struct FrameMeter {
    period_ns: i64,
    last: Option<FrameTimes>,
    newest_sweep_ns: i64,
    cpu: Latency,
    wall: Latency,
    sweep_age: Latency,
    frames: u64,
    missed_by_loop: u64,
    missed_waiting_for_core: u64,
    missed_elsewhere: u64,
}

/// Cost of the loop and missed frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameReport {
    /// Frames seen.
    pub frames: u64,
    /// Frames missed because the loop was still working on the previous one.
    pub missed_by_loop: u64,
    /// Frames missed because the loop waited for a processor core used by others.
    pub missed_waiting_for_core: u64,
    /// Frames missed for another reason: the runtime or the system was late.
    pub missed_elsewhere: u64,
    /// Processor time of the loop's thread per frame.
    pub cpu: LatencyReport,
    /// From the start of a frame to the end of its work.
    pub wall: LatencyReport,
    /// From the end of a sensor frame to the end of the first display frame whose warnings include
    /// it.
    pub sweep_to_warning: LatencyReport,
}

impl FrameMeter {
    pub fn new(frame_hz: f64) -> Self {
        Self {
            period_ns: (1e9 / frame_hz) as i64,
            last: None,
            newest_sweep_ns: 0,
            cpu: Latency::default(),
            wall: Latency::default(),
            sweep_age: Latency::default(),
            frames: 0,
            missed_by_loop: 0,
            missed_waiting_for_core: 0,
            missed_elsewhere: 0,
        }
    }

    /// Takes the next frame.
    pub fn frame(&mut self, times: FrameTimes) {
        self.frames += 1;
        self.cpu.push(times.cpu_ns);
        self.wall.push(times.end_ns - times.start_ns);
        if let Some(last) = self.last.replace(times) {
            let periods = (times.start_ns - last.start_ns) as f64 / self.period_ns as f64;
            if periods > LATE_PERIODS {
                self.count_missed(&last, &times, periods.round() as u64 - 1);
            }
        }
    }

    /// Attributes the frames missed between two frames: each cause gets those that its time alone covers.
    fn count_missed(&mut self, last: &FrameTimes, next: &FrameTimes, missed: u64) {
        let periods = |time_ns: i64| time_ns.max(0) as f64 / self.period_ns as f64;
        let waited_ns = last.waited_ns + next.waited_before_ns;
        let with_a_core = (periods(next.start_ns - last.start_ns - waited_ns).round() as u64).clamp(1, missed + 1) - 1;
        let own_ns = last.end_ns - last.start_ns - last.waited_ns - last.in_runtime_ns;
        let own = (periods(own_ns).floor() as u64).min(with_a_core);
        self.missed_waiting_for_core += missed - with_a_core;
        self.missed_by_loop += own;
        self.missed_elsewhere += with_a_core - own;
    }

    /// Warnings that include all sweeps up to a time were shown. `sensor_period_ns`: length of a
    /// sensor frame.
    pub fn shown(&mut self, newest_sweep_ns: i64, now_ns: i64, sensor_period_ns: i64) {
        let before_ns = std::mem::replace(&mut self.newest_sweep_ns, newest_sweep_ns);
        if before_ns == 0 || newest_sweep_ns <= before_ns {
            return;
        }
        // Every sensor frame that arrived with it counts, the oldest too.
        let most = (newest_sweep_ns - before_ns) / sensor_period_ns.max(1);
        for back in 0..most.clamp(1, 1000) {
            self.sweep_age.push(now_ns - (newest_sweep_ns - back * sensor_period_ns));
        }
    }

    /// Earlier sweeps do not count after a reset.
    pub fn reset_sweep_age(&mut self) {
        self.newest_sweep_ns = 0;
    }

    pub fn report(&self) -> FrameReport {
        FrameReport {
            frames: self.frames,
            missed_by_loop: self.missed_by_loop,
            missed_waiting_for_core: self.missed_waiting_for_core,
            missed_elsewhere: self.missed_elsewhere,
            cpu: self.cpu.report(),
            wall: self.wall.report(),
            sweep_to_warning: self.sweep_age.report(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn missed_frames_are_attributed_to_their_cause() {
        let mut meter = FrameMeter::new(100.0);
        let times = |start_ms: i64, took_ms: i64, waited_ms: i64| FrameTimes {
            start_ns: start_ms * MS,
            end_ns: (start_ms + took_ms) * MS,
            cpu_ns: MS,
            in_runtime_ns: 0,
            waited_ns: waited_ms * MS,
            waited_before_ns: 0,
        };
        let missed = |meter: &FrameMeter| {
            let report = meter.report();
            (report.missed_by_loop, report.missed_waiting_for_core, report.missed_elsewhere)
        };
        (0..10).for_each(|frame| meter.frame(times(frame * 10, 2, 0)));
        assert_eq!(missed(&meter), (0, 0, 0));
        meter.frame(times(120, 25, 3));
        assert_eq!(missed(&meter), (0, 0, 2));
        meter.frame(times(150, 19, 10));
        assert_eq!(missed(&meter), (2, 0, 2));
        meter.frame(times(170, 1, 0));
        assert_eq!((missed(&meter), meter.report().frames), ((2, 1, 2), 13));
        meter.frame(FrameTimes { waited_before_ns: 16 * MS, ..times(200, 1, 0) });
        assert_eq!(missed(&meter), (2, 3, 2), "it was woken in time, and had no core");
        meter.frame(FrameTimes { waited_before_ns: 4 * MS, ..times(220, 1, 0) });
        assert_eq!(missed(&meter), (2, 3, 3), "even with one at once it would have been late");
        meter.frame(times(230, 1, 0));
        meter.frame(FrameTimes { in_runtime_ns: 30 * MS, ..times(240, 45, 0) });
        meter.frame(times(300, 1, 0));
        assert_eq!(missed(&meter), (3, 3, 7), "of 45 ms of work 30 were the runtime's");
        assert!((meter.report().wall.max_s - 0.045).abs() < 1e-9);
    }

    #[test]
    fn each_sensor_frame_counts_once_with_its_age() {
        let mut meter = FrameMeter::new(90.0);
        meter.shown(100 * MS, 110 * MS, 15 * MS);
        assert_eq!(meter.report().sweep_to_warning.count, 0, "nothing to compare with yet");
        meter.shown(115 * MS, 125 * MS, 15 * MS);
        meter.shown(115 * MS, 136 * MS, 15 * MS);
        let report = meter.report().sweep_to_warning;
        assert_eq!(report.count, 1);
        assert!((report.max_s - 0.010).abs() < 1e-9);
        meter.shown(160 * MS, 165 * MS, 15 * MS);
        let report = meter.report().sweep_to_warning;
        assert_eq!(report.count, 4, "three at once");
        assert!((report.max_s - 0.035).abs() < 1e-9, "{}", report.max_s);
    }
}
