//! Tick dequantiser: gives regular frames a finer time than the tick, by fitting a straight line
//! through the ticks of the last 30 s.
//!
//! A tick of 1 ms gives the end of a frame to within 1 ms. Frames that follow the sensor's own
//! timer end at varying positions within the tick. So the line that passes through all ticks, with
//! the greatest margin to their edges, gives a much finer time. Every time stays inside its tick,
//! so an irregular stream loses no accuracy. Limit: frames nearly locked to the tick show their
//! position in it only when they slip; until then it is an unknown constant, part of the clock's
//! shared delay.

use std::collections::VecDeque;

use super::concave::maximise_concave;

/// Length of the fit, seconds. Choice: the clock's window.
const FIT_SPAN_S: f64 = 30.0;
/// Width of a bin, seconds; each bin keeps its lowest and highest frame. Choice: the clock's bin;
/// 600 bounds at most.
const BIN_S: f64 = 0.1;
/// Number of initial frames that each get their own bin. Choice: the period is not known at first,
/// and each of these frames narrows it.
const FIRST_FRAMES: u32 = 16;
/// Tolerance of the configured period, as a fraction. Choice: a board rounds the period to its
/// ticks; of 1 ms, that is 5 % at 100 Hz.
const PERIOD_TOLERANCE: f64 = 0.05;
/// Change of the period allowed between fits, as a fraction. Choice: 6 ppm a minute, as a crystal
/// drifts while its board warms up.
const PERIOD_DRIFT_PER_BIN: f64 = 1e-8;
/// A frame farther from the line than this starts a new fit, ticks. Choice: less than a tick off is
/// jitter of the interrupt, more is a late frame or a gap.
const RESTART_OFFSET_TICKS: f64 = 0.75;

/// Number of a frame, counted in periods, within a run of regular frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameNumber {
    epoch: u32,
    number: i64,
}

/// The frames of a bin that bound the line, as (number, tick).
#[derive(Debug, Clone, Copy)]
struct Bounds {
    bin: i64,
    lowest: (i64, i64),
    highest: (i64, i64),
}

/// Estimates the ends of frames within their ticks.
#[derive(Debug, Clone)]
pub(super) struct TickDequantiser {
    span_ticks: f64,
    bin_ticks: f64,
    /// Frame period, ticks.
    period: f64,
    /// Bounds of the period from older frames, ticks.
    known_period: (f64, f64),
    /// Newest frame as (number, tick), and the line there, in ticks after its tick.
    newest: (i64, i64),
    level: f64,
    epoch: u32,
    frames: u32,
    bounds: VecDeque<Bounds>,
}

impl TickDequantiser {
    /// Creates a dequantiser for frames about `period_ticks` apart.
    pub fn new(period_ticks: f64, ticks_per_second: f64) -> Self {
        Self {
            span_ticks: FIT_SPAN_S * ticks_per_second,
            bin_ticks: BIN_S * ticks_per_second,
            period: period_ticks.clamp(1.0, 1e12),
            known_period: (0.0, f64::INFINITY),
            newest: (0, 0),
            level: 0.5,
            epoch: 0,
            frames: 0,
            bounds: VecDeque::new(),
        }
    }

    /// Takes the tick of the next frame.
    pub fn add(&mut self, tick: i64) -> FrameNumber {
        let (last_number, last_tick) = self.newest;
        let step = tick.saturating_sub(last_tick) as f64;
        // A step that fits both a slipped and a lost frame counts as slipped: frames two ticks
        // apart slip in one step of three.
        let number = last_number.saturating_add(((step / self.period - 0.1).round() as i64).max(1));
        let off = self.line_at(number, tick) - 0.5;
        if self.frames > 0 && off.abs() > 0.5 + RESTART_OFFSET_TICKS {
            // After a restart the position within the tick is unknown.
            (self.frames, self.level) = (0, 0.5);
            self.epoch = self.epoch.wrapping_add(1);
            self.bounds.clear();
            self.known_period = (0.0, f64::INFINITY);
        }
        self.frames = self.frames.saturating_add(1);
        let level = self.line_at(number, tick);
        (self.newest, self.level) = ((number, tick), if self.frames == 1 { 0.5 } else { level });
        if self.add_bound(number, tick) {
            self.fit();
        }
        FrameNumber { epoch: self.epoch, number }
    }

    /// Position of a frame's end within its tick, 0 to 1.
    pub fn within_tick(&self, frame_number: FrameNumber, tick: i64) -> f64 {
        if frame_number.epoch == self.epoch { self.line_at(frame_number.number, tick).clamp(0.0, 1.0) } else { 0.5 }
    }

    /// The line at a frame, in ticks after its tick.
    fn line_at(&self, number: i64, tick: i64) -> f64 {
        let (newest_number, newest_tick) = self.newest;
        let frames_between = number.saturating_sub(newest_number) as f64;
        self.level + frames_between * self.period - tick.saturating_sub(newest_tick) as f64
    }

    /// Keeps a frame if it bounds the line; returns true if the line has to be fitted again.
    fn add_bound(&mut self, number: i64, tick: i64) -> bool {
        let frame = (number, tick);
        let bin = if self.frames <= FIRST_FRAMES { i64::MIN } else { (tick as f64 / self.bin_ticks) as i64 };
        while self.bounds.front().is_some_and(|b| tick.saturating_sub(b.lowest.1) as f64 > self.span_ticks) {
            self.bounds.pop_front();
        }
        let above_line = |(n, t): (i64, i64)| -self.line_at(n, t);
        let height = above_line(frame);
        let known = self.bounds.back().filter(|b| b.bin == bin && bin != i64::MIN);
        let Some(&Bounds { lowest, highest, .. }) = known else {
            self.bounds.push_back(Bounds { bin, lowest: frame, highest: frame });
            return true;
        };
        let (is_lowest, is_highest) = (height < above_line(lowest), height > above_line(highest));
        if let Some(back) = self.bounds.back_mut() {
            back.lowest = if is_lowest { frame } else { lowest };
            back.highest = if is_highest { frame } else { highest };
        }
        // The line must pass through the newest tick.
        !(-1.0..=0.0).contains(&height)
    }

    /// Fits the line with the greatest margin to the edges of all ticks.
    fn fit(&mut self) {
        let (newest_number, newest_tick) = self.newest;
        let relative =
            |(n, t): (i64, i64)| (n.saturating_sub(newest_number) as f64, t.saturating_sub(newest_tick) as f64);
        let ends: Vec<_> = self.bounds.iter().map(|b| (relative(b.lowest), relative(b.highest))).collect();
        // Highest and lowest level at the newest frame for lines of this slope.
        let levels = |slope: f64| {
            ends.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(high, low), &((n_low, t_low), (n_high, t_high))| {
                (high.min(t_low + 1.0 - slope * n_low), low.max(t_high - slope * n_high))
            })
        };
        let margin = |slope: f64| {
            let (high, low) = levels(slope);
            high - low
        };
        let tolerance = if self.frames < 4 * FIRST_FRAMES { PERIOD_TOLERANCE } else { PERIOD_TOLERANCE / 50.0 };
        let (mut below, mut above) = (self.period * (1.0 - tolerance), self.period * (1.0 + tolerance));
        if ends.len() > 2 {
            let widest = maximise_concave(margin, below, above);
            // All lines through every tick are equally good, so take the middle one. If no line
            // passes through every tick, take the one that misses least.
            below = bisect_boundary(|slope| margin(slope) >= 0.0, widest, below);
            above = bisect_boundary(|slope| margin(slope) >= 0.0, widest, above);
            // Keep the period's bounds from older frames, widened for changes of temperature.
            let (known_below, known_above) = self.known_period;
            let joint = (
                below.max(known_below * (1.0 - PERIOD_DRIFT_PER_BIN)),
                above.min(known_above * (1.0 + PERIOD_DRIFT_PER_BIN)),
            );
            self.known_period = if joint.0 <= joint.1 { joint } else { (below, above) };
            self.period = (0.5 * (self.known_period.0 + self.known_period.1)).max(1.0);
        }
        let (high, low) = levels(self.period);
        self.level = 0.5 * (high + low);
    }
}

/// Bisects for the farthest point from `from` towards `to` up to which the test holds; `from` if it
/// does not hold there.
fn bisect_boundary(holds: impl Fn(f64) -> bool, from: f64, to: f64) -> f64 {
    let (mut inside, mut outside) = (from, to);
    if !holds(from) || holds(to) {
        return if holds(from) { to } else { from };
    }
    for _ in 0..40 {
        let middle = 0.5 * (inside + outside);
        if holds(middle) { inside = middle } else { outside = middle }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error, ticks, of frames with this period, from frame `from` on; one frame in a
    /// hundred is lost.
    fn worst_error(period: f64, nominal: f64, frames: i64, from: i64) -> f64 {
        let mut dequantiser = TickDequantiser::new(nominal, 1000.0);
        let mut worst: f64 = 0.0;
        for k in (0..frames).filter(|k| k % 100 != 50) {
            let end = 5000.0 + period * k as f64 + 0.123;
            let tick = end.floor() as i64;
            let frame_number = dequantiser.add(tick);
            let error = (end.floor() + dequantiser.within_tick(frame_number, tick) - end).abs();
            worst = if k >= from { worst.max(error) } else { worst };
        }
        worst
    }

    #[test]
    fn regular_frames_are_timed_finer_than_their_ticks() {
        let worst = worst_error(1000.0 / 120.0 * 1.00004, 8.3333, 10_000, 2400);
        assert!(worst < 0.2, "{worst}");
        let worst = worst_error(11.59, 11.9, 10_000, 240);
        assert!(worst < 0.05, "{worst}");
        // Nearly locked to the tick: the position is known after a slip.
        let worst = worst_error(2.0 * 1.00004, 2.0, 60_000, 30_000);
        assert!(worst < 0.1, "{worst}");
    }

    #[test]
    fn irregular_frames_stay_inside_their_ticks() {
        let mut dequantiser = TickDequantiser::new(10.0, 1000.0);
        let mut tick = 1 << 40;
        for k in 0..500i64 {
            tick += 3 + (k * k * 7) % 31;
            let frame_number = dequantiser.add(tick);
            assert!((0.0..=1.0).contains(&dequantiser.within_tick(frame_number, tick)));
        }
        for tick in [1, 1 << 60, 0, -5] {
            let frame_number = dequantiser.add(tick);
            assert!((0.0..=1.0).contains(&dequantiser.within_tick(frame_number, tick)));
        }
    }
}
