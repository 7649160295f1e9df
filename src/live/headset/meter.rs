//! What the frame loop costs, whether it kept up, and how old sweeps are when a frame shows what they told. Fixed memory.

use crate::live::{Latency, LatencyReport};

/// A frame that comes later than this share of a period after the one before it was missed by somebody.
const LATE: f64 = 1.5;

/// Counts frames.
pub(super) struct FrameMeter {
    period_ns: i64,
    last_start_ns: Option<i64>,
    last_end_ns: i64,
    newest_sweep_ns: i64,
    cpu: Latency,
    wall: Latency,
    sweep_age: Latency,
    frames: u64,
    missed_by_us: u64,
    missed_elsewhere: u64,
}

/// What the loop cost, and whether it kept up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameReport {
    /// Frames seen.
    pub frames: u64,
    /// Frames that went by while this loop was at work on the one before.
    pub missed_by_us: u64,
    /// Frames that went by without a reason here: the runtime was late, or the system.
    pub missed_elsewhere: u64,
    /// Processor time of the loop's thread a frame.
    pub cpu: LatencyReport,
    /// From a frame's beginning to the end of its work.
    pub wall: LatencyReport,
    /// From the end of a sensor's frame to the end of the first frame whose warnings rest on a reconstruction that has worked it off.
    pub sweep_to_warning: LatencyReport,
}

impl FrameMeter {
    pub fn new(frame_hz: f64) -> Self {
        Self {
            period_ns: (1e9 / frame_hz) as i64,
            last_start_ns: None,
            last_end_ns: 0,
            newest_sweep_ns: 0,
            cpu: Latency::default(),
            wall: Latency::default(),
            sweep_age: Latency::default(),
            frames: 0,
            missed_by_us: 0,
            missed_elsewhere: 0,
        }
    }

    /// A frame that began and ended at host times, for so much processor time.
    pub fn frame(&mut self, start_ns: i64, end_ns: i64, cpu_ns: i64) {
        self.frames += 1;
        self.cpu.push(cpu_ns);
        self.wall.push(end_ns - start_ns);
        if let Some(last_ns) = self.last_start_ns {
            let periods = (start_ns - last_ns) as f64 / self.period_ns as f64;
            if periods > LATE {
                let missed = periods.round() as u64 - 1;
                // The one before had no end within its period.
                let is_ours = self.last_end_ns - last_ns > self.period_ns;
                *if is_ours { &mut self.missed_by_us } else { &mut self.missed_elsewhere } += missed;
            }
        }
        (self.last_start_ns, self.last_end_ns) = (Some(start_ns), end_ns);
    }

    /// Warnings that rest on all sweeps up to a time were shown at a time; a sensor's frame takes so long.
    pub fn shown(&mut self, newest_sweep_ns: i64, now_ns: i64, sensor_period_ns: i64) {
        let before_ns = std::mem::replace(&mut self.newest_sweep_ns, newest_sweep_ns);
        if before_ns == 0 || newest_sweep_ns <= before_ns {
            return;
        }
        // Every frame of the sensor that came with it counts, the oldest too.
        let most = (newest_sweep_ns - before_ns) / sensor_period_ns.max(1);
        for back in 0..most.clamp(1, 1000) {
            self.sweep_age.push(now_ns - (newest_sweep_ns - back * sensor_period_ns));
        }
    }

    /// Sweeps of before do not count: everything was forgotten.
    pub fn forget_sweeps(&mut self) {
        self.newest_sweep_ns = 0;
    }

    pub fn report(&self) -> FrameReport {
        FrameReport {
            frames: self.frames,
            missed_by_us: self.missed_by_us,
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
    fn missed_frames_are_laid_at_the_right_door() {
        let mut meter = FrameMeter::new(100.0);
        for frame in 0..10 {
            meter.frame(frame * 10 * MS, frame * 10 * MS + 2 * MS, MS);
        }
        assert_eq!((meter.report().missed_by_us, meter.report().missed_elsewhere), (0, 0));
        meter.frame(120 * MS, 145 * MS, MS);
        assert_eq!((meter.report().missed_by_us, meter.report().missed_elsewhere), (0, 2));
        meter.frame(150 * MS, 151 * MS, MS);
        let report = meter.report();
        assert_eq!((report.missed_by_us, report.missed_elsewhere, report.frames), (2, 2, 12));
        assert!((report.wall.max_s - 0.025).abs() < 1e-9);
    }

    #[test]
    fn every_frame_of_the_sensor_counts_once_with_its_own_age() {
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
