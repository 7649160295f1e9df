//! Unwraps ticks to 64 bits and rejects implausible ones.
//!
//! Lines have no checksum, so a damaged digit gives a wrong tick. Rejected ticks: a step shorter
//! than the measurement of a frame; a step longer than any pause; and, once frames have been
//! regular, a step off their period. A rejected tick waits for confirmation: if the next tick
//! continues from it, by as much as the arrivals differ, the sensor's clock has jumped and both are
//! right. The first tick waits likewise. So a wrong tick loses only its own result, and a jump of
//! the clock loses one result.
//!
//! Not detected: a wrong tick within the tolerance of the period (3 %, at least 2 ticks), and,
//! before frames have been regular for a while, any plausible step. [`super::Clock`] then rejects
//! ticks whose measurement would end after the arrival.

/// Regular steps in a row before steps off the period are rejected. Choice: a quarter of a second
/// at 66 Hz; chance repeats no step so often.
const REGULAR_STEPS: u32 = 16;
/// Tolerance of a step, as a fraction of the period. Choice: regular frames differ by less; a
/// damaged digit of the tick is mostly off by more.
const PERIOD_TOLERANCE: f64 = 0.03;
/// Tolerance of a step, ticks. Physics: one for rounding at each end of the step.
const PERIOD_TOLERANCE_TICKS: f64 = 2.0;
/// Tolerance between the step of ticks and the step of arrivals, seconds. Results arrive in bursts.
/// Choice: results arrive in bursts; twice the 30 ms of the simulated board's.
const ARRIVAL_TOLERANCE_S: f64 = 0.06;
/// Weight of a new step in the period. Choice: a mean of 63 steps, a second at 66 Hz, so that
/// jitter averages out.
const PERIOD_GAIN: f64 = 1.0 / 32.0;

/// Verdict on a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TickVerdict {
    /// It continues from the previous one; unwrapped.
    Next(i64),
    /// It continues from a rejected one: the sensor's clock jumped and the clock has to be reset.
    Jumped(i64),
    /// The first after a start; accepted when the next one continues from it.
    First,
    /// Not later than the previous one, or sooner than a frame takes.
    TooSoon,
    /// Later than any pause of a stream.
    TooLate,
    /// Off the period of regular frames.
    OffPeriod,
    /// Rejected by the caller's test.
    Impossible,
}

/// Checks the ticks of one sensor.
#[derive(Debug, Clone)]
pub struct TickUnwrapper {
    min_step: u32,
    max_step: u32,
    last: Option<i64>,
    /// The last rejected tick and its arrival (host ns).
    unconfirmed: Option<(u32, i64)>,
    tick_s: f64,
    period: f64,
    regular: u32,
}

impl TickUnwrapper {
    /// Creates a checker for frames that take `frame_s` to measure and come every `period_s` by the
    /// configuration.
    pub fn new(frame_s: f64, period_s: f64, ticks_per_second: u32) -> Self {
        let rate = f64::from(ticks_per_second);
        // The timing model is accurate to 4 %.
        let min_step = ((frame_s * 0.9 * rate).floor() - 1.0).clamp(1.0, 1e9) as u32;
        let max_step = ((1.0 + 4.0 * period_s) * rate).clamp(f64::from(min_step), 2e9) as u32;
        Self { min_step, max_step, last: None, unconfirmed: None, tick_s: 1.0 / rate.max(1.0), period: 0.0, regular: 0 }
    }

    /// Checks the next tick, whose result arrived at a host time. Before it is accepted,
    /// `is_possible` is called with the unwrapped tick.
    pub fn check(&mut self, tick: u32, arrival_ns: i64, is_possible: impl FnOnce(i64) -> bool) -> TickVerdict {
        let Some(last) = self.last else {
            let Some(first) = self.unconfirmed.replace((tick, arrival_ns)) else {
                return TickVerdict::First;
            };
            let step = tick.wrapping_sub(first.0);
            if !self.confirms(first, tick, arrival_ns) {
                return if step < self.min_step { TickVerdict::TooSoon } else { TickVerdict::TooLate };
            }
            self.accept(i64::from(tick), None);
            return TickVerdict::Next(i64::from(tick));
        };
        let step = tick.wrapping_sub(last as u32);
        let unwrapped = last.saturating_add(i64::from(step));
        let refusal = match step {
            _ if step < self.min_step => Some(TickVerdict::TooSoon),
            _ if step > i32::MAX as u32 => Some(TickVerdict::TooSoon),
            _ if step > self.max_step => Some(TickVerdict::TooLate),
            _ if !self.is_on_period(step) => Some(TickVerdict::OffPeriod),
            _ if !is_possible(unwrapped) => Some(TickVerdict::Impossible),
            _ => None,
        };
        let Some(refusal) = refusal else {
            self.accept(unwrapped, Some(step));
            return TickVerdict::Next(unwrapped);
        };
        let unconfirmed = self.unconfirmed.replace((tick, arrival_ns));
        let witnessed = unconfirmed.is_some_and(|unconfirmed| {
            self.confirms(unconfirmed, tick, arrival_ns) && self.is_on_period(tick.wrapping_sub(unconfirmed.0))
        });
        if witnessed {
            self.accept(unwrapped, None);
            return TickVerdict::Jumped(unwrapped);
        }
        refusal
    }

    /// Whether a tick continues from a rejected one.
    fn confirms(&self, unconfirmed: (u32, i64), tick: u32, arrival_ns: i64) -> bool {
        let step = tick.wrapping_sub(unconfirmed.0);
        let arrivals_s = arrival_ns.saturating_sub(unconfirmed.1) as f64 * 1e-9;
        let off_s = f64::from(step) * self.tick_s - arrivals_s;
        (self.min_step..=self.max_step).contains(&step) && off_s.abs() <= ARRIVAL_TOLERANCE_S + 0.01 * arrivals_s.abs()
    }

    fn accept(&mut self, unwrapped: i64, step: Option<u32>) {
        (self.last, self.unconfirmed) = (Some(unwrapped), None);
        let Some(step) = step.map(f64::from) else {
            self.regular = 0;
            return;
        };
        let count = (step / self.period).round();
        if self.regular > 0 && count >= 1.0 && (step - count * self.period).abs() <= self.tolerance() {
            self.period += (step / count - self.period) * PERIOD_GAIN;
            self.regular = self.regular.saturating_add(1);
        } else {
            (self.period, self.regular) = (step, 1);
        }
    }

    fn tolerance(&self) -> f64 {
        (PERIOD_TOLERANCE * self.period).max(PERIOD_TOLERANCE_TICKS)
    }

    fn is_on_period(&self, step: u32) -> bool {
        let count = (f64::from(step) / self.period).round();
        let is_on_period =
            count >= 1.0 && (f64::from(step) - count * self.period).abs() <= self.tolerance() * count.min(4.0);
        self.regular < REGULAR_STEPS || is_on_period
    }
}

#[cfg(test)]
mod tests {
    use super::TickVerdict::{First, Impossible, Jumped, Next, OffPeriod, TooLate, TooSoon};
    use super::*;

    /// d16 on an XC120.
    fn ticks() -> TickUnwrapper {
        TickUnwrapper::new(14.2e-3, 15.152e-3, 1_000_000)
    }

    fn judged(ticks: &mut TickUnwrapper, values: impl IntoIterator<Item = u32>) -> Vec<TickVerdict> {
        let first_ns = ticks.last.map_or(0, |last| last * 1000);
        let arrivals_ns = (1..).map(|k| first_ns + 15_152_000 * k);
        values.into_iter().zip(arrivals_ns).map(|(tick, at)| ticks.check(tick, at, |_| true)).collect()
    }

    fn regular(first: u32) -> TickUnwrapper {
        let mut ticks = ticks();
        let verdicts = judged(&mut ticks, (0..40).map(|k| first.wrapping_add(15_152 * k)));
        assert!(verdicts[1..].iter().all(|v| matches!(v, Next(_))));
        ticks
    }

    #[test]
    fn ticks_unwrap_and_first_tick_needs_confirmation() {
        let first = u32::MAX - 20_000;
        let mut ticks = ticks();
        let verdicts = judged(&mut ticks, [first, first + 15_152, 10_303, 25_455]);
        let wrapped = (1i64 << 32) + 10_303;
        assert_eq!(verdicts, [First, Next(i64::from(first) + 15_152), Next(wrapped), Next(wrapped + 15_152)]);
    }

    #[test]
    fn one_wrong_tick_loses_only_its_own_result() {
        let next = |k: u32| 5_000_000 + 15_152 * k;
        for (wrong, verdict) in [
            (next(40) + 1_000_000_000, TooLate),
            (next(40) - 20_000, TooSoon),
            (next(40) + 1_000, OffPeriod),
            (next(40) - 1_000, OffPeriod),
            (next(40) - 3_000, TooSoon),
            (next(40) + 60_606 / 3, OffPeriod),
            (17, TooSoon),
        ] {
            let mut ticks = regular(5_000_000);
            let expected = [verdict, Next(i64::from(next(41))), Next(i64::from(next(42)))];
            assert_eq!(judged(&mut ticks, [wrong, next(41), next(42)]), expected, "{wrong}");
        }
        let mut ticks = regular(5_000_000);
        assert_eq!(ticks.check(next(44), 0, |_| false), Impossible);
        assert_eq!(ticks.check(next(41), 0, |_| true), Next(i64::from(next(41))));
    }

    #[test]
    fn lost_frames_and_clock_jumps_are_followed() {
        let mut ticks = regular(0);
        let last = 15_152 * 39;
        assert_eq!(judged(&mut ticks, [last + 3 * 15_152]), [Next(i64::from(last + 3 * 15_152))]);
        // The board restarted, or its frames shifted against their period.
        assert_eq!(judged(&mut ticks, [3_000, 18_152, 33_304])[0], TooSoon);
        let mut ticks = regular(0);
        let verdicts = judged(&mut ticks, [last + 22_000, last + 37_152, last + 52_304]);
        assert_eq!(verdicts[0], OffPeriod);
        assert_eq!(verdicts[1..], [Jumped(i64::from(last + 37_152)), Next(i64::from(last + 52_304))]);
        let mut ticks = regular(1_000_000);
        let verdicts = judged(&mut ticks, [3_000, 18_152, 33_304]);
        assert!(matches!(verdicts[..], [TooSoon, Jumped(a), Next(b)] if b - a == 15_152 && a as u32 == 18_152));
    }

    #[test]
    fn irregular_frames_pass_without_period_check() {
        let mut ticks = TickUnwrapper::new(5e-3, 8e-3, 1_000);
        let mut tick = 0;
        let verdicts: Vec<_> = (0..200u32)
            .map(|k| {
                tick += 8 + k * k % 11;
                ticks.check(tick, i64::from(tick) * 1_000_000, |_| true)
            })
            .collect();
        assert!(verdicts[1..].iter().all(|v| matches!(v, Next(_))), "{verdicts:?}");
        // Coarse ticks of regular frames count as regular: 11 and 12 ms alternate.
        let mut ticks = TickUnwrapper::new(5e-3, 11.6e-3, 1_000);
        let verdicts = judged(&mut ticks, (0..300u32).map(|k| (f64::from(k) * 11.6) as u32));
        assert!(verdicts[1..].iter().all(|v| matches!(v, Next(_))), "{verdicts:?}");
    }
}
