//! Host times of frames: each sensor's ticks, and the clock that follows the first sensor.

use super::event::SensorFrame;
use super::plan::Plan;
use crate::{Clock, ClockReport, Frame, ResultInfo, ResultMessage, Setup, TickUnwrapper, TickVerdict};

/// A verdict on the ticks of a result.
pub(super) enum Ticks {
    /// The unwrapped ticks of all sensors.
    Accepted(Vec<i64>),
    /// A first tick, which the next result confirms.
    Unconfirmed,
    Refused,
}

/// Times of the frames since a set-up.
pub(super) struct FrameTimes {
    ticks: Vec<TickUnwrapper>,
    clock: Clock,
    ticks_per_second: u32,
}

impl FrameTimes {
    /// Times of a board whose results take `transfer_s` on the line.
    pub fn new(plan: &Plan, ticks_per_second: u32, transfer_s: f64) -> Self {
        let period_s = plan.result_period_s();
        let ticks = plan.timings().iter().map(|t| TickUnwrapper::new(t.frame_s, period_s, ticks_per_second));
        let clock = Clock::new(ticks_per_second, period_s, transfer_s);
        Self { ticks: ticks.collect(), clock, ticks_per_second }
    }

    pub fn report(&self) -> ClockReport {
        self.clock.report()
    }

    /// Checks the ticks of all sensors; also returns whether the board's clock has jumped, after
    /// which its relation to the host's starts anew.
    pub fn check(&mut self, infos: &[ResultInfo], arrival_ns: i64) -> (Ticks, bool) {
        let (mut accepted, mut is_first, mut has_jumped) = (Vec::new(), false, false);
        let mut of_first = None;
        for (index, (ticks, info)) in self.ticks.iter_mut().zip(infos).enumerate() {
            // The clock follows the first sensor; the other sensors' ticks come from the same board
            // clock.
            let since_first = info.tick.wrapping_sub(infos[0].tick) as i32;
            let is_possible = |tick| {
                let on_clock = if index == 0 {
                    Some(tick)
                } else {
                    of_first.map(|at: i64| at.saturating_add(i64::from(since_first)))
                };
                on_clock.is_none_or(|tick| self.clock.is_possible(tick, arrival_ns))
            };
            match ticks.check(info.tick, arrival_ns, is_possible) {
                TickVerdict::Next(tick) => {
                    of_first = of_first.or((index == 0).then_some(tick));
                    accepted.push(tick);
                }
                TickVerdict::Jumped(tick) => {
                    has_jumped |= index == 0;
                    accepted.push(tick);
                }
                TickVerdict::First => is_first = true,
                _ => {}
            }
        }
        if has_jumped {
            self.clock.reset();
        }
        let verdict = match (accepted.len() == infos.len(), is_first) {
            (true, _) => Ticks::Accepted(accepted),
            (false, true) => Ticks::Unconfirmed,
            (false, false) => Ticks::Refused,
        };
        (verdict, has_jumped)
    }

    /// The frames of a result with these accepted ticks, group by group.
    pub fn frames(&mut self, setup: &Setup, result: ResultMessage, ticks: &[i64], arrival_ns: i64) -> Vec<SensorFrame> {
        let Some(&first) = ticks.first() else { return Vec::new() };
        let rate = f64::from(self.ticks_per_second);
        let first_ns = self.clock.time_ns(first, arrival_ns);
        let places = setup.groups.iter().enumerate().flat_map(|(group, s)| s.iter().map(move |s| (group, s.sensor_id)));
        let parts = places.zip(ticks).zip(result.infos.iter().zip(result.frames));
        let frame = |(((group, sensor_id), &tick), (info, samples)): (((usize, u32), &i64), (&ResultInfo, _))| {
            // Each sensor's ticks were unwrapped from its own first tick, which may be beyond a
            // wrap.
            let after = (tick as u32).wrapping_sub(first as u32) as i32;
            let after_ns = (f64::from(after) / rate * 1e9).round() as i64;
            let frame = Frame {
                tick: first.saturating_add(i64::from(after)),
                host_time_ns: first_ns.saturating_add(after_ns),
                temperature_c: info.temperature,
                data_saturated: info.data_saturated,
                frame_delayed: info.frame_delayed,
                calibration_needed: info.calibration_needed,
                samples,
            };
            SensorFrame { group, sensor_id, frame }
        };
        parts.map(frame).collect()
    }
}
