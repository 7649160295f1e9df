//! Converts board ticks to host time, from the arrival times of results.
//!
//! Used by [`super::Session`] for every result of a stream. A result arrives late by its transfer
//! time on the line, plus queueing delays: USB, a busy board, a late reader. Delays are never
//! negative. So all points (tick, arrival − tick) lie above a line, whose slope is the drift
//! between the two clocks. The model takes delays above the line as exponential and the drift as
//! normal around zero. The clock uses the most likely line below all arrivals of the last 30 s,
//! lowered by the expected lateness of the earliest arrival. Source: Moon, Skelly and Towsley,
//! "Estimation and removal of clock skew from network delay measurements", 1999; the prior on the
//! drift is added here.
//!
//! When results arrive in bursts only, any delay up to the burst interval is equally likely, and
//! the earliest arrivals say little. But a result that did not arrive with the previous burst was
//! not ready then. So each point (next tick, previous arrival) lies below the line. The clock then
//! uses the most likely line between both sets of points. Each bound is softened by the delays of
//! the board itself.
//!
//! Limits: one-way measurements cannot show a delay that all results share. The caller gives the
//! transfer time and the clock subtracts it; the rest is part of the time offset between sweeps and
//! poses, which imaging estimates. If results only ever arrive in bursts, even the earliest of them
//! is late; `examples/a121_clock.rs` measures by how much.
//!
//! With several sensors, the ticks of the first one define the time. Results wait for the last
//! sensor, which is one more shared delay.

use std::collections::VecDeque;

use super::concave::{maximise_concave, ternary_search};
use super::tick_dequantiser::{FrameNumber, TickDequantiser};

/// Arrivals are kept this long, seconds. Choice: long enough to meet early arrivals on a busy host,
/// short enough that the drift of a warming crystal is a straight line.
const WINDOW_S: f64 = 30.0;
/// Width of an arrival bin, seconds; each bin keeps its earliest arrival. Choice: 300 bins in the
/// window bound the work of an estimate.
const BIN_S: f64 = 0.1;
/// Usual drift between the clocks of two boards, as a fraction, 1σ. Choice: crystals of boards and
/// hosts are specified to between 20 and 100 ppm.
const DRIFT_SIGMA: f64 = 50e-6;
/// Largest drift considered, as a fraction. Choice: twenty times the usual; more is a wrong tick
/// rate and no drift.
const MAX_DRIFT: f64 = 1e-3;
/// Ticks shorter than this are used without dequantisation, seconds. Choice: 0.05 mm at 1 m/s;
/// XC120 has 1 µs, XM125 1 ms.
const FINE_TICK_S: f64 = 50e-6;
/// Bins needed before the clock rejects arrivals as too early. Choice: half a second, after which
/// the line lies within its tolerance.
const MIN_BINS_TO_REJECT: usize = 5;
/// An arrival that is early by less than this counts as a faster line, seconds. Choice: a USB port
/// is polled every millisecond; a damaged digit of the tick moves a time farther.
const EARLY_TOLERANCE_S: f64 = 1.5e-3;
/// A delay above this many medians counts as a fault. Choice: one exponential delay in a thousand
/// exceeds it.
const OUTLIER_MEDIANS: f64 = 10.0;
/// Bins needed before delays are tested for faults. Choice: a second; the median of fewer may
/// itself be a fault.
const MIN_BINS_FOR_OUTLIERS: usize = 10;
/// Softness of the bounds in burst mode, seconds: the mean of the board's own delays and of the
/// error in reading the time. Choice: twice the 0.05 ms of the simulated board; a harder bound
/// follows single delays, a softer one states a larger 1σ.
const BOUND_SOFTNESS_S: f64 = 0.1e-3;
/// Candidate levels between the bounds in burst mode, and iterations of the search for the drift.
/// Choice: levels are 1/32 of the bounds' distance apart; 22 ternary steps leave 0.3 ppm, 8 µs over
/// the window.
const LEVELS: usize = 32;
const DRIFT_ROUNDS: usize = 22;
/// Lower limit of the mean delay, seconds. Choice: no reader's clock is better.
const MIN_LATENESS_S: f64 = 1e-6;

/// The earliest arrival of a bin.
#[derive(Debug, Clone, Copy)]
struct ArrivalPoint {
    bin: i64,
    tick: i64,
    frame_number: Option<FrameNumber>,
    /// Arrival since the reference, host seconds.
    arrival_s: f64,
    /// Sensor time since the reference, seconds, from all ticks so far.
    sensor_s: f64,
    /// Whether it arrived together with the previous result.
    is_in_burst: bool,
}

impl ArrivalPoint {
    fn lag_s(&self) -> f64 {
        self.arrival_s - self.sensor_s
    }
}

/// The line below all arrivals.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    /// Sensor time at which `level_s` holds, seconds.
    middle_s: f64,
    /// Arrival minus sensor time at `middle_s`, seconds.
    level_s: f64,
    drift: f64,
    /// Expected lateness of the earliest arrivals, which is also the 1σ of the level, seconds.
    lateness_s: f64,
    drift_sigma: f64,
}

impl Line {
    fn at(&self, sensor_s: f64) -> f64 {
        self.level_s + self.drift * (sensor_s - self.middle_s)
    }
}

/// Quality of the host times.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClockReport {
    /// Results timed since the clock started.
    pub results: u64,
    /// Drift: how much faster the host's clock runs than the sensor's, parts per million.
    pub drift_ppm: f64,
    /// 1σ of the times, seconds, without any delay that all results share.
    pub sigma_s: f64,
    /// Rms step of the times when the line is refitted, seconds, over about the last 30 s.
    pub jitter_s: f64,
    /// Mean delay of results behind the line, seconds, over about the last 30 s.
    pub mean_delay_s: f64,
    /// Largest delay behind the line since the clock started, seconds.
    pub max_delay_s: f64,
}

/// Converts ticks to host time. See the head of this file.
#[derive(Debug, Clone)]
pub struct Clock {
    tick_s: f64,
    transfer_s: f64,
    dequantiser: Option<TickDequantiser>,
    /// First tick and first arrival (host ns); all times are relative to them.
    reference: Option<(i64, i64)>,
    earliest: VecDeque<ArrivalPoint>,
    /// For each bin, the highest lower bound: the tick of a result with the arrival of the previous
    /// one, when it had not arrived yet.
    lower_bounds: VecDeque<ArrivalPoint>,
    last_arrival_s: Option<f64>,
    line: Line,
    last_ns: i64,
    steps_s2: f64,
    report: ClockReport,
}

impl Clock {
    /// Creates a clock for a board with this tick rate, frames every `period_s` by the
    /// configuration, and a transfer time of `transfer_s` for each result.
    pub fn new(ticks_per_second: u32, period_s: f64, transfer_s: f64) -> Self {
        let rate = f64::from(ticks_per_second.max(1));
        let dequantiser = (1.0 / rate > FINE_TICK_S).then(|| TickDequantiser::new(period_s * rate, rate));
        Self {
            tick_s: 1.0 / rate,
            transfer_s,
            dequantiser,
            reference: None,
            earliest: VecDeque::new(),
            lower_bounds: VecDeque::new(),
            last_arrival_s: None,
            line: Line::default(),
            last_ns: i64::MIN,
            steps_s2: 0.0,
            report: ClockReport::default(),
        }
    }

    /// Drops all arrivals after a jump of the sensor's clock. Returned times keep rising.
    pub fn reset(&mut self) {
        (self.reference, self.line, self.steps_s2) = (None, Line::default(), 0.0);
        self.earliest.clear();
        self.lower_bounds.clear();
        self.last_arrival_s = None;
    }

    /// Whether a result with this tick can have arrived at this time, i.e. not before its
    /// measurement ended.
    pub fn is_possible(&self, tick: i64, arrival_ns: i64) -> bool {
        let Some(reference) = self.reference.filter(|_| self.earliest.len() >= MIN_BINS_TO_REJECT) else { return true };
        let sensor_s = self.tick_s * (tick.saturating_sub(reference.0) as f64);
        let lag_s = arrival_ns.saturating_sub(reference.1) as f64 * 1e-9 - sensor_s;
        lag_s - self.line.at(sensor_s) > -(EARLY_TOLERANCE_S + 2.0 * self.tick_s + 4.0 * self.line.lateness_s)
    }

    /// Returns the host time, nanoseconds, of the end of the measurement with this tick, whose
    /// result arrived at `arrival_ns`. Ticks must rise; the returned times always rise.
    pub fn time_ns(&mut self, tick: i64, arrival_ns: i64) -> i64 {
        let reference = *self.reference.get_or_insert((tick, arrival_ns));
        let frame_number = self.dequantiser.as_mut().map(|dequantiser| dequantiser.add(tick));
        let arrival_s = arrival_ns.saturating_sub(reference.1) as f64 * 1e-9;
        let sensor_s = self.sensor_s(tick, frame_number);
        let bin = (sensor_s / BIN_S).floor() as i64;
        let before_s = self.last_arrival_s.replace(arrival_s);
        let new =
            ArrivalPoint { bin, tick, frame_number, arrival_s, sensor_s, is_in_burst: before_s == Some(arrival_s) };
        if let Some(before_s) = before_s.filter(|before_s| *before_s < arrival_s) {
            self.add_lower_bound(ArrivalPoint { arrival_s: before_s, ..new });
        }
        self.add_arrival(new);
        let since_s = sensor_s + self.line.at(sensor_s) - self.transfer_s;
        let time_ns = reference.1.saturating_add((since_s * 1e9).round() as i64);
        self.last_ns = time_ns.max(self.last_ns.saturating_add(1));
        self.last_ns
    }

    /// Returns the current quality of the times.
    pub fn report(&self) -> ClockReport {
        let newest_s = self.earliest.back().map_or(0.0, |e| e.sensor_s);
        let by_drift_s = self.line.drift_sigma * (newest_s - self.line.middle_s);
        let unsmoothed_s = if self.dequantiser.is_some() { 0.1 * self.tick_s } else { 0.3 * self.tick_s };
        let sigma_s = (self.line.lateness_s.powi(2) + by_drift_s.powi(2) + unsmoothed_s.powi(2)).sqrt();
        ClockReport { drift_ppm: self.line.drift * 1e6, sigma_s, jitter_s: self.steps_s2.sqrt(), ..self.report }
    }

    /// Sensor time of the end of a measurement, seconds since the reference.
    fn sensor_s(&self, tick: i64, frame_number: Option<FrameNumber>) -> f64 {
        let within = self
            .dequantiser
            .as_ref()
            .zip(frame_number)
            .map_or(0.5, |(dequantiser, frame_number)| dequantiser.within_tick(frame_number, tick));
        self.tick_s * (self.reference.map_or(0.0, |(first, _)| tick.saturating_sub(first) as f64) + within)
    }

    fn add_lower_bound(&mut self, new: ArrivalPoint) {
        let above_drift = |e: &ArrivalPoint| e.lag_s() - self.line.drift * e.sensor_s;
        match self.lower_bounds.back_mut() {
            Some(known) if known.bin == new.bin && above_drift(&new) > above_drift(known) => *known = new,
            Some(known) if known.bin == new.bin => {}
            _ => self.lower_bounds.push_back(new),
        }
        while self.lower_bounds.front().is_some_and(|e| new.sensor_s - e.sensor_s > WINDOW_S) {
            self.lower_bounds.pop_front();
        }
    }

    fn add_arrival(&mut self, new: ArrivalPoint) {
        let delay_s = new.lag_s() - self.line.at(new.sensor_s);
        let above_drift = |e: &ArrivalPoint| e.lag_s() - self.line.drift * e.sensor_s;
        let is_new_bin = self.earliest.back().is_none_or(|e| e.bin != new.bin);
        match self.earliest.back_mut() {
            Some(known) if !is_new_bin && above_drift(&new) < above_drift(known) => *known = new,
            Some(_) if !is_new_bin => {}
            _ => self.earliest.push_back(new),
        }
        while self.earliest.front().is_some_and(|e| new.sensor_s - e.sensor_s > WINDOW_S) {
            self.earliest.pop_front();
        }
        if is_new_bin || delay_s < self.line.lateness_s {
            self.refit(new.sensor_s);
        }
        let delay_s = (new.lag_s() - self.line.at(new.sensor_s)).max(0.0);
        self.report.results += 1;
        self.report.mean_delay_s += (delay_s - self.report.mean_delay_s) / self.report.results.min(1000) as f64;
        self.report.max_delay_s = self.report.max_delay_s.max(delay_s);
    }

    fn refit(&mut self, now_s: f64) {
        // Later frames may have refined the position of a frame within its tick.
        let mut lower_bounds = std::mem::take(&mut self.lower_bounds);
        let mut earliest = std::mem::take(&mut self.earliest);
        earliest.iter_mut().chain(&mut lower_bounds).for_each(|e| e.sensor_s = self.sensor_s(e.tick, e.frame_number));
        let before_s = self.line.at(now_s);
        self.line = fit_line(earliest.make_contiguous(), lower_bounds.make_contiguous());
        (self.earliest, self.lower_bounds) = (earliest, lower_bounds);
        let step_s = if self.report.results == 0 { 0.0 } else { self.line.at(now_s) - before_s };
        self.steps_s2 += (step_s * step_s - self.steps_s2) * BIN_S / WINDOW_S;
    }
}

/// Fits the line with the model that suits the arrivals: bursts or single results.
fn fit_line(points: &[ArrivalPoint], lower_bounds: &[ArrivalPoint]) -> Line {
    let in_bursts = points.iter().filter(|p| p.is_in_burst).count();
    match 2 * in_bursts > points.len() && !lower_bounds.is_empty() {
        true => fit_line_between(points, lower_bounds),
        false => fit_line_below(points),
    }
}

/// Upper bounds of the line: arrival minus sensor time, over the sensor time from its mean.
struct UpperBounds {
    middle_s: f64,
    spread_s: f64,
    points: Vec<(f64, f64)>,
}

impl UpperBounds {
    fn new(points: &[ArrivalPoint]) -> Self {
        let count = points.len() as f64;
        let middle_s = points.iter().map(|p| p.sensor_s).sum::<f64>() / count;
        let variance_s2 = points.iter().map(|p| (p.sensor_s - middle_s).powi(2)).sum::<f64>() / count;
        Self { middle_s, spread_s: variance_s2.sqrt(), points: about(points, middle_s) }
    }

    /// Level of the highest line with this drift below all points.
    fn upper(&self, drift: f64) -> f64 {
        self.points.iter().map(|(at_s, lag_s)| lag_s - drift * at_s).fold(f64::INFINITY, f64::min)
    }

    /// The line with this drift, `below_s` below the highest one, with a 1σ of `uncertain_s`.
    fn line(&self, drift: f64, below_s: f64, uncertain_s: f64) -> Line {
        let by_points = if self.spread_s > 0.0 { uncertain_s / self.spread_s } else { f64::INFINITY };
        let drift_sigma = libm::pow(by_points.powi(-2) + DRIFT_SIGMA.powi(-2), -0.5);
        let level_s = self.upper(drift) - below_s;
        Line { middle_s: self.middle_s, level_s, drift, lateness_s: uncertain_s, drift_sigma }
    }
}

fn about(points: &[ArrivalPoint], middle_s: f64) -> Vec<(f64, f64)> {
    points.iter().map(|p| (p.sensor_s - middle_s, p.lag_s())).collect()
}

/// Most likely line below all arrivals, for exponential delays.
fn fit_line_below(points: &[ArrivalPoint]) -> Line {
    let (heights, count) = (UpperBounds::new(points), points.len() as f64);
    let (mut drift, mut lateness_s) = (0.0, 0.0);
    // The mean delay depends on the line and the line on the mean delay; three iterations converge.
    for _ in 0..3 {
        let upper_s = heights.upper(drift);
        let delays_s = heights.points.iter().map(|(at_s, lag_s)| lag_s - drift * at_s - upper_s);
        lateness_s = (mean_delay_s(delays_s.collect()) / count).max(MIN_LATENESS_S / count);
        let likelihood = |drift: f64| heights.upper(drift) / lateness_s - 0.5 * (drift / DRIFT_SIGMA).powi(2);
        drift = maximise_concave(likelihood, -MAX_DRIFT, MAX_DRIFT);
    }
    heights.line(drift, lateness_s, lateness_s)
}

/// Most likely line between the arrivals and the lower bounds.
fn fit_line_between(points: &[ArrivalPoint], lower_bounds: &[ArrivalPoint]) -> Line {
    let heights = UpperBounds::new(points);
    let bounds = BurstBounds { lower_bounds: about(lower_bounds, heights.middle_s), arrived: &heights };
    let likelihood = |drift: f64| bounds.levels(drift).log_likelihood - 0.5 * (drift / DRIFT_SIGMA).powi(2);
    let drift = ternary_search(likelihood, -MAX_DRIFT, MAX_DRIFT, DRIFT_ROUNDS);
    let LevelPosterior { below_s, sigma_s, .. } = bounds.levels(drift);
    heights.line(drift, below_s, sigma_s)
}

/// Upper and lower bounds of the line in burst mode.
struct BurstBounds<'a> {
    arrived: &'a UpperBounds,
    lower_bounds: Vec<(f64, f64)>,
}

/// Posterior over the level of a line with a given drift.
struct LevelPosterior {
    /// Log likelihood of the drift, integrated over all levels.
    log_likelihood: f64,
    /// Mean and standard deviation of the distance below the highest line, seconds.
    below_s: f64,
    sigma_s: f64,
}

impl BurstBounds<'_> {
    fn levels(&self, drift: f64) -> LevelPosterior {
        let upper_s = self.arrived.upper(drift);
        let height_s = |(at_s, lag_s): &(f64, f64)| lag_s - drift * at_s - upper_s;
        let lower_s = self.lower_bounds.iter().map(height_s).fold(-1.0, f64::max);
        let depth_s = 5.0 * BOUND_SOFTNESS_S - lower_s.min(0.0);
        // Points farther from every level contribute nothing.
        let near: Vec<f64> = self.arrived.points.iter().map(height_s).filter(|h| *h < 8.0 * BOUND_SOFTNESS_S).collect();
        let above: Vec<f64> = self.lower_bounds.iter().map(height_s).filter(|h| *h > -depth_s).collect();
        let below_s = |level: usize| (level as f64 + 0.5) / LEVELS as f64 * depth_s;
        let log_likelihood = |level: usize| {
            let below_s = below_s(level);
            // An arrived result was ready: its own delay is at most the distance to the line. A
            // result that had not arrived had a longer delay.
            let arrived: f64 = near.iter().map(|h| libm::log1p(-libm::exp(-(h + below_s) / BOUND_SOFTNESS_S))).sum();
            let not_come: f64 = above.iter().map(|h| (h + below_s).max(0.0) / BOUND_SOFTNESS_S).sum();
            arrived - not_come
        };
        let logs: [f64; LEVELS] = std::array::from_fn(log_likelihood);
        let greatest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let weights = logs.map(|log| libm::exp(log - greatest));
        let sum: f64 = weights.iter().sum();
        let mean = |value: &dyn Fn(f64) -> f64| {
            weights.iter().enumerate().map(|(level, w)| w * value(below_s(level))).sum::<f64>() / sum
        };
        let mean_s = mean(&|below_s| below_s);
        let sigma_s = mean(&|below_s| (below_s - mean_s).powi(2)).sqrt().max(depth_s / LEVELS as f64);
        LevelPosterior { log_likelihood: greatest + libm::log(sum * depth_s), below_s: mean_s, sigma_s }
    }
}

/// Mean delay. Once there are enough delays, faults (such as a board that hung for seconds) count
/// as no more than `OUTLIER_MEDIANS` medians.
fn mean_delay_s(mut delays_s: Vec<f64>) -> f64 {
    let (count, middle) = (delays_s.len(), delays_s.len() / 2);
    let (_, median_s, _) = delays_s.select_nth_unstable_by(middle, f64::total_cmp);
    let enough = count >= MIN_BINS_FOR_OUTLIERS;
    let most_s = if enough { (OUTLIER_MEDIANS * *median_s).max(MIN_LATENESS_S) } else { f64::INFINITY };
    delays_s.iter().map(|delay_s| delay_s.min(most_s)).sum::<f64>() / delays_s.len() as f64
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::clock_simulation::{ArrivalPattern, SimulatedClock, TRANSFER_S};
    use super::*;

    const S: i64 = 1_000_000_000;

    /// Rms error of the times between `from_s` and `to_s` after the start, seconds, and the final
    /// clock.
    fn rms_error_s(world: &mut SimulatedClock, from_s: f64, to_s: f64) -> (f64, Clock) {
        let mut clock = Clock::new(world.ticks_per_second as u32, 1.0 / world.frame_rate, TRANSFER_S);
        let (mut sum, mut count, mut last_ns) = (0.0, 0.0, i64::MIN);
        for k in 0..(to_s * world.frame_rate) as u64 {
            let (end_s, tick, arrival_s) = world.frame(k);
            let arrival_ns = (arrival_s * 1e9) as i64;
            assert!(clock.is_possible(tick, arrival_ns), "frame {k}");
            let time_ns = clock.time_ns(tick, arrival_ns);
            assert!(time_ns > last_ns);
            last_ns = time_ns;
            if k as f64 >= from_s * world.frame_rate {
                sum += (time_ns as f64 * 1e-9 - end_s).powi(2);
                count += 1.0;
            }
        }
        ((sum / count).sqrt(), clock)
    }

    /// Rms over six seeds, from 2 s on.
    fn rms_of_seeds_s(frame_rate: f64, ticks_per_second: f64, reader: ArrivalPattern, to_s: f64) -> f64 {
        let worlds = (0..6).map(|seed| SimulatedClock::new(seed, frame_rate, ticks_per_second, reader));
        let squares: f64 = worlds.map(|mut world| rms_error_s(&mut world, 2.0, to_s).0.powi(2)).sum();
        (squares / 6.0).sqrt()
    }

    #[test]
    fn ticks_of_1_ms_give_times_within_half_a_millisecond() {
        for reader in [ArrivalPattern::Stalls, ArrivalPattern::Bursts] {
            // Frame rates: d16, a free-running XM125, the thesis, and one nearly locked to the
            // tick, long enough for some slips.
            for (frame_rate, to_s) in [(66.0, 20.0), (86.3, 20.0), (120.0, 20.0), (500.0, 60.0)] {
                let rms_s = rms_of_seeds_s(frame_rate, 1e3, reader, to_s);
                assert!(rms_s < 0.5e-3, "{frame_rate} Hz: {rms_s}");
            }
        }
    }

    #[test]
    fn ticks_of_1_us_give_times_within_a_tenth_of_a_millisecond() {
        for frame_rate in [66.0, 120.0, 500.0] {
            let rms_s = rms_of_seeds_s(frame_rate, 1e6, ArrivalPattern::Stalls, 20.0);
            assert!(rms_s < 0.1e-3, "{frame_rate} Hz: {rms_s}");
        }
        for frame_rate in [120.0, 500.0] {
            let rms_s = rms_of_seeds_s(frame_rate, 1e6, ArrivalPattern::Bursts, 20.0);
            assert!(rms_s < 0.1e-3, "{frame_rate} Hz, bursts: {rms_s}");
        }
    }

    #[test]
    fn report_gives_drift_delay_and_jitter() {
        let mut world = SimulatedClock::new(3, 66.0, 1e6, ArrivalPattern::Stalls);
        let (_, clock) = rms_error_s(&mut world, 2.0, 60.0);
        let report = clock.report();
        // The board's clock loses 40 ppm and gains some back as it warms up.
        assert!((report.drift_ppm - 37.5).abs() < 2.0, "{report:?}");
        assert!(report.jitter_s < 0.05e-3 && report.sigma_s < 0.05e-3, "{report:?}");
        assert!((0.029..0.035).contains(&report.max_delay_s) && report.mean_delay_s > 1e-3, "{report:?}");
        assert_eq!(report.results, 3960);
    }

    #[test]
    fn one_late_result_does_not_shift_other_times() {
        let mut clock = Clock::new(1_000_000, 0.015, 0.0);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut worst_ns = 0;
        for k in 0..400i64 {
            // The board hangs for 5 s during the 200th result.
            let end_ns = k * 15_000_000 + i64::from(k > 200) * 5 * S;
            let late_ns = i64::from(k == 200) * 5 * S;
            let time_ns = clock.time_ns(end_ns / 1000, end_ns + late_ns + rng.random_range(0..100_000));
            worst_ns = worst_ns.max(if k > 100 { (time_ns - end_ns).abs() } else { 0 });
        }
        assert!(worst_ns < 50_000, "{worst_ns}");
    }

    #[test]
    fn arrival_before_measurement_is_rejected() {
        let mut clock = Clock::new(1_000_000, 0.015, 0.0);
        for k in 0..200i64 {
            clock.time_ns(15_000 * k, 1_000_000_000 + 15_000_000 * k);
        }
        let arrival_ns = 1_000_000_000 + 15_000_000 * 200;
        assert!(clock.is_possible(15_000 * 200, arrival_ns) && clock.is_possible(15_000 * 199 + 1, arrival_ns));
        assert!(!clock.is_possible(15_000 * 200 + 2_000, arrival_ns));
        clock.reset();
        assert!(clock.is_possible(1 << 40, arrival_ns));
        let before_ns = clock.time_ns(5, arrival_ns - 1_000_000_000);
        assert!(clock.time_ns(15_005, arrival_ns) > before_ns);
    }

    #[test]
    fn any_input_gives_rising_times_without_panic() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        for ticks_per_second in [0, 1, 1000, u32::MAX] {
            let mut clock = Clock::new(ticks_per_second, f64::NAN, 0.0);
            let mut last_ns = i64::MIN;
            for _ in 0..300 {
                let (tick, arrival_ns): (i64, i64) = (rng.random(), rng.random());
                clock.is_possible(tick, arrival_ns);
                let time_ns = clock.time_ns(tick, arrival_ns);
                assert!(time_ns > last_ns || time_ns == i64::MAX);
                last_ns = time_ns;
            }
        }
    }
}
