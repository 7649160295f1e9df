//! The time lag between poses and radar as a curve, for recordings whose streams start out of step
//! and converge (thesis, 4.1.3).
//!
//! The input is two series of one reflector: its radar range r(t), and its distance by poses d(s)
//! at timestamps s. The model is r(t) = d(t + τ(t)) + b(t) + c·(d − d̄), with the lag τ(t), an
//! offset b from mount and tracking wander, and a slope c from an error of the reflector's
//! position. Two steps:
//!
//! 1. Coarse: the cheapest path through a grid of lags, one step every 50 ms (dynamic programming,
//!    as in time warping). It finds lags of up to a second without an initial guess, if they change
//!    by less than half a second per second.
//! 2. Fine: a Kalman smoother (Rauch, Tung and Striebel 1965) of τ, its rate, b and c about the
//!    coarse path, iterated three times. The lag may change fast in the first seconds and hardly
//!    later, as at a start of the streams.
//!
//! Limits: without motion the lag is unobservable, and the 1σ shows it.

use glam::{DMat4, DVec4};

use super::ranges::value_at;
use super::{SIGNIFICANT, StartLag};
use radar_sar::PoseSample;
use radar_sar::math;

/// Range of the lags tried, and their grid, seconds. Choice: lags of up to a second (thesis, 4.1.3)
/// with a margin; 5 ms are 5 mm at 1 m/s, and the fine step does the rest.
const MIN_LAG_S: f64 = -1.2;
const MAX_LAG_S: f64 = 1.2;
const GRID_S: f64 = 5e-3;
/// Time step, nanoseconds, and the change of the lag per step in grid cells: the limit and its 1σ.
/// Choice: a lag that changes by less than 0.5 s/s (limit 0.6, 1σ 0.25); a looser limit lets the
/// path follow another echo.
const STEP_NS: i64 = 50_000_000;
const MAX_STEP_CELLS: usize = 6;
const STEP_SIGMA_CELLS: f64 = 2.5;
/// 1σ of a range in the coarse step, metres, and the cost of a lag for which there is no distance.
/// Choice: a range of 20 dB and the tracking's error; a cost of 3 is that of 2.4σ, less than of a
/// wrong echo, so that gaps do not bend the path.
const COARSE_SIGMA_M: f64 = 0.02;
const NO_DISTANCE_COST: f64 = 3.0;
/// Random walk of the lag's rate at the start, 1/s/√s; decay time of it (a Gaussian), seconds; and
/// random walk later. Choice: at the start the lag may run by some 0.2 s/s for seconds (thesis,
/// 4.1.3), later only by the drift of clocks and buffers.
const START_RATE_WALK: f64 = 0.15;
const START_DECAY_S: f64 = 3.0;
const STEADY_RATE_WALK: f64 = 3e-4;
/// Time constant of the rate's decay, seconds, and its prior 1σ. Choice: streams settle within
/// seconds; the prior is the fastest change that the coarse step finds.
const RATE_TIME_CONSTANT_S: f64 = 2.0;
const RATE_PRIOR_SIGMA: f64 = 0.5;
/// Random walk of b, metres/√s, and its prior 1σ, metres. Choice: tracking wanders by about a
/// millimetre in a second; mount and tracking are wrong by some centimetres at most.
const BIAS_WALK_M: f64 = 1e-3;
const BIAS_PRIOR_SIGMA_M: f64 = 0.05;
/// Prior 1σ of c. Choice: a position error of 15 cm across at 1 m, for 20 cm of motion.
const SLOPE_PRIOR_SIGMA: f64 = 0.05;
/// Least noise of a range, metres; number of 1σ beyond which a range is down-weighted; iterations
/// of the smoother. Choice: the jitter of good tracking, so that no range counts for more; 3σ
/// (Huber) keeps 99.7 % at full weight; the coarse path lies within the linear region, so three
/// iterations settle.
const MIN_NOISE_M: f64 = 0.5e-3;
const HUBER_SIGMAS: f64 = 3.0;
const ITERATIONS: usize = 3;
/// Half of the interval over which the distance's rate is computed, nanoseconds. Choice: spans two
/// poses at 120 Hz, which averages their jitter, and follows accelerations.
const RATE_HALF_NS: i64 = 10_000_000;
/// A lag with a larger 1σ is unobservable, seconds; length of the start, seconds; least lag at the
/// start that is reported, seconds. Choice: 20 ms misplace an echo by 2 cm at 1 m/s; the start is
/// as long as the first window; the least lag is one cell of the grid.
const MAX_OBSERVABLE_SIGMA_S: f64 = 0.02;
const START_S: f64 = 2.0;
const MIN_START_LAG_S: f64 = 5e-3;
/// Least number of ranges. Half a second of ranges; the four states would follow the noise of
/// fewer. Choice: 0.4 s of ranges; the four states would follow the noise of fewer.
const MIN_RANGES: usize = 50;

/// The lag at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Sweep time since the first sweep, seconds.
    pub time_s: f64,
    /// Timestamp of the pose minus time of the sweep, seconds.
    pub lag_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
}

/// The lag over time.
#[derive(Debug, Clone, PartialEq)]
pub struct LagCurve {
    lags: Vec<Lag>,
}

impl LagCurve {
    /// From a reflector's radar ranges and its distances by poses, each as [time, length] in rising
    /// time, seconds and metres; `None`: too few ranges, or invalid numbers.
    pub fn of(radar_m: &[[f64; 2]], poses_m: &[[f64; 2]]) -> Option<Self> {
        let series = |points: &[[f64; 2]]| -> Vec<(i64, f64)> {
            let sound = points.iter().filter(|p| p[0].abs() < 1e6 && p[1].is_finite());
            sound.map(|p| ((p[0] * 1e9).round() as i64, p[1])).collect()
        };
        let (radar, poses) = (series(radar_m), series(poses_m));
        if radar.len() < MIN_RANGES || poses.len() < 2 {
            return None;
        }
        let evenly = ResampledSeries::of(&poses);
        let mut way = coarse_lags(&radar, &evenly, 0.0);
        // Once more without the common offset of the ranges.
        let bias_m =
            median(radar.iter().zip(&way).filter_map(|((t, r), lag_s)| Some(r - value_at(&poses, t + ns(*lag_s))?)));
        way = coarse_lags(&radar, &evenly, bias_m);
        let mut lags = Vec::new();
        for _ in 0..ITERATIONS {
            lags = kalman_smooth(&radar, &poses, &way, bias_m);
            way = lags.iter().map(|lag: &Lag| lag.lag_s.clamp(MIN_LAG_S, MAX_LAG_S)).collect();
        }
        lags.iter().all(|lag| lag.lag_s.is_finite() && lag.sigma_s.is_finite()).then_some(Self { lags })
    }

    /// Adds the residual lag that was estimated after this curve had been removed, in rising time.
    pub fn plus_residual(mut self, left: &[Lag]) -> Self {
        let left: Vec<Lag> =
            left.iter().copied().filter(|lag| (lag.time_s + lag.lag_s + lag.sigma_s).is_finite()).collect();
        if !left.is_empty() {
            let left = Self { lags: left };
            for lag in &mut self.lags {
                let more = left.at(lag.time_s);
                (lag.lag_s, lag.sigma_s) = (lag.lag_s + more.lag_s, more.sigma_s);
            }
        }
        self
    }

    /// Lag of the first two observable seconds relative to the last third of the recording; `None`:
    /// not both are observable.
    pub fn start_lag(&self) -> Option<StartLag> {
        let accurate: Vec<&Lag> = self.lags.iter().filter(|lag| lag.sigma_s <= MAX_OBSERVABLE_SIGMA_S).collect();
        let (first_s, last_s) = (accurate.first()?.time_s, accurate.last()?.time_s);
        let rest_s = last_s - (last_s - first_s) / 3.0;
        if rest_s < first_s + START_S {
            return None;
        }
        let mean = |from_s: f64, to_s: f64, of: fn(&Lag) -> f64| {
            let values: Vec<f64> =
                accurate.iter().filter(|lag| (from_s..=to_s).contains(&lag.time_s)).map(|lag| of(lag)).collect();
            values.iter().sum::<f64>() / values.len().max(1) as f64
        };
        // Errors of neighbours are correlated, so their mean has the 1σ of a single value.
        let both = |of: fn(&Lag) -> f64| [mean(first_s, first_s + START_S, of), mean(rest_s, last_s, of)];
        let ([early_s, late_s], [early_1s, late_1s]) = (both(|lag| lag.lag_s), both(|lag| lag.sigma_s));
        let (lag_s, sigma_s) = (early_s - late_s, math::hypot(early_1s, late_1s));
        Some(StartLag { lag_s, sigma_s, is_significant: lag_s.abs() > (SIGNIFICANT * sigma_s).max(MIN_START_LAG_S) })
    }

    /// The lags at the ranges, in rising time.
    pub fn lags(&self) -> &[Lag] {
        &self.lags
    }

    /// The interpolated lag at a time, seconds; outside, the nearest.
    pub fn at(&self, time_s: f64) -> Lag {
        let later = self.lags.partition_point(|lag| lag.time_s < time_s);
        let (a, b) = (self.lags[later.saturating_sub(1)], self.lags[later.min(self.lags.len() - 1)]);
        let share = ((time_s - a.time_s) / (b.time_s - a.time_s).max(1e-9)).clamp(0.0, 1.0);
        let mix = |from: f64, to: f64| from + (to - from) * share;
        Lag { time_s, lag_s: mix(a.lag_s, b.lag_s), sigma_s: mix(a.sigma_s, b.sigma_s) }
    }

    /// Poses with the lag removed from their timestamps, in the same order; `start_ns` is the first
    /// sweep's time.
    pub fn corrected(&self, poses: &[PoseSample], start_ns: i64) -> Vec<PoseSample> {
        // Timestamps must rise with the sweep time; points of the curve at which they would fall
        // are skipped.
        let mut stamped: Vec<(f64, f64)> = Vec::with_capacity(self.lags.len());
        for lag in &self.lags {
            let stamp_s = lag.time_s + lag.lag_s;
            if stamped.last().is_none_or(|last| stamp_s > last.0) {
                stamped.push((stamp_s, lag.time_s));
            }
        }
        let time_s = |stamp_s: f64| {
            let later = stamped.partition_point(|(s, _)| *s < stamp_s);
            let (Some(a), Some(b)) = (later.checked_sub(1).map(|n| stamped[n]), stamped.get(later)) else {
                let nearest = stamped[later.min(stamped.len() - 1)];
                return stamp_s - (nearest.0 - nearest.1);
            };
            a.1 + (b.1 - a.1) * (stamp_s - a.0) / (b.0 - a.0)
        };
        let moved = |pose: &PoseSample| PoseSample {
            time_ns: start_ns.saturating_add(ns(time_s(pose.time_ns.saturating_sub(start_ns) as f64 * 1e-9))),
            ..*pose
        };
        poses.iter().map(moved).collect()
    }
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Distances resampled every few milliseconds, for many look-ups; NaN where there is none.
struct ResampledSeries {
    first_ns: i64,
    values_m: Vec<f64>,
}

impl ResampledSeries {
    /// Choice: between poses at 120 Hz, and finer than the grid of lags.
    const STEP_NS: i64 = 2_000_000;
    /// More than an hour. Choice: wrong time stamps cost at most 16 MB.
    const MAX_STEPS: i64 = 2_000_000;

    fn of(series: &[(i64, f64)]) -> Self {
        let (first_ns, last_ns) = (series[0].0, series[series.len() - 1].0);
        let count = ((last_ns - first_ns) / Self::STEP_NS).clamp(0, Self::MAX_STEPS);
        let value = |n: i64| value_at(series, first_ns + n * Self::STEP_NS).unwrap_or(f64::NAN);
        Self { first_ns, values_m: (0..=count).map(value).collect() }
    }

    fn at(&self, time_ns: i64) -> Option<f64> {
        let since_ns = time_ns - self.first_ns;
        let before = usize::try_from(since_ns.div_euclid(Self::STEP_NS)).ok()?;
        let (a, b) = (*self.values_m.get(before)?, *self.values_m.get(before + 1)?);
        let value = a + (b - a) * (since_ns.rem_euclid(Self::STEP_NS) as f64 / Self::STEP_NS as f64);
        value.is_finite().then_some(value)
    }
}

/// The cheapest path, as a lag at each range.
fn coarse_lags(radar: &[(i64, f64)], poses: &ResampledSeries, bias_m: f64) -> Vec<f64> {
    let cells = ((MAX_LAG_S - MIN_LAG_S) / GRID_S).round() as usize + 1;
    let lag_s = |cell: usize| MIN_LAG_S + cell as f64 * GRID_S;
    let first_ns = radar[0].0;
    let step_of = |time_ns: i64| ((time_ns - first_ns) / STEP_NS) as usize;
    let steps = step_of(radar[radar.len() - 1].0) + 1;
    let turn_cost: Vec<f64> = (0..=MAX_STEP_CELLS).map(|n| 0.5 * (n as f64 / STEP_SIGMA_CELLS).powi(2)).collect();
    let mut costs = vec![0.0f64; cells];
    let mut from: Vec<u16> = Vec::with_capacity(steps * cells);
    let mut rest = radar;
    for step in 0..steps {
        let (now, later) = rest.split_at(rest.partition_point(|(t, _)| step_of(*t) <= step));
        rest = later;
        let mut next = vec![f64::INFINITY; cells];
        for (cell, cost) in next.iter_mut().enumerate() {
            let near = cell.saturating_sub(MAX_STEP_CELLS)..(cell + MAX_STEP_CELLS + 1).min(cells);
            let best = near.map(|n| (costs[n] + turn_cost[n.abs_diff(cell)], n));
            let Some((least, before)) = best.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            from.push(before as u16);
            let misfit = |(t, range_m): &(i64, f64)| {
                let distance_m = poses.at(t + ns(lag_s(cell)));
                distance_m.map_or(NO_DISTANCE_COST, |d| {
                    let off = (range_m - d - bias_m) / COARSE_SIGMA_M;
                    // Beyond a few 1σ it is another echo.
                    0.5 * off.powi(2).min(16.0)
                })
            };
            *cost = least + now.iter().map(misfit).sum::<f64>() / now.len().max(1) as f64;
        }
        costs = next;
    }
    let mut cell = (0..cells).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
    let mut way = vec![0.0; steps];
    for step in (0..steps).rev() {
        way[step] = lag_s(cell);
        cell = usize::from(from[step * cells + cell]);
    }
    // Interpolates linearly between steps.
    let at = |time_ns: i64| {
        let position = (time_ns - first_ns) as f64 / STEP_NS as f64 - 0.5;
        let before = (position.max(0.0) as usize).min(steps - 1);
        let share = (position - before as f64).clamp(0.0, 1.0);
        way[before] + (way[(before + 1).min(steps - 1)] - way[before]) * share
    };
    radar.iter().map(|(t, _)| at(*t)).collect()
}

/// A range linearised about the current path: its residual, its change with the lag, and the
/// distance, metres.
#[derive(Debug, Clone, Copy)]
struct LinearisedRange {
    residual_m: f64,
    rate: f64,
    distance_m: f64,
}

impl LinearisedRange {
    /// `None`: there is no distance at this time.
    fn of(reading: &(i64, f64), poses: &[(i64, f64)], lag_s: f64) -> Option<Self> {
        let stamp_ns = reading.0.saturating_add(ns(lag_s));
        let at = |by_ns: i64| value_at(poses, stamp_ns.saturating_add(by_ns));
        let distance_m = at(0)?;
        let rate = (at(RATE_HALF_NS)? - at(-RATE_HALF_NS)?) / (2.0 * RATE_HALF_NS as f64 * 1e-9);
        Some(Self { residual_m: reading.1 - distance_m, rate, distance_m })
    }
}

/// A step of the filter: the predicted and the corrected state with their covariances, and the
/// transition from the step before.
struct FilterStep {
    predicted: (DVec4, DMat4),
    corrected: (DVec4, DMat4),
    transition: DMat4,
}

fn kalman_smooth(radar: &[(i64, f64)], poses: &[(i64, f64)], way: &[f64], bias_m: f64) -> Vec<Lag> {
    let about: Vec<Option<LinearisedRange>> =
        radar.iter().zip(way).map(|(reading, lag_s)| LinearisedRange::of(reading, poses, *lag_s)).collect();
    let noise_m = noise_m(&about);
    let middle_m = median(about.iter().flatten().map(|about| about.distance_m));
    // State: lag, its rate, b, c.
    let mut state = DVec4::new(way[0], 0.0, bias_m, 0.0);
    let priors = DVec4::new(1.0, RATE_PRIOR_SIGMA, BIAS_PRIOR_SIGMA_M, SLOPE_PRIOR_SIGMA);
    let mut covariance = DMat4::from_diagonal(priors * priors);
    let mut steps: Vec<FilterStep> = Vec::with_capacity(radar.len());
    for (n, (time_ns, _)) in radar.iter().enumerate() {
        let h = if n == 0 { 0.0 } else { (time_ns - radar[n - 1].0) as f64 * 1e-9 };
        let since_s = (time_ns - radar[0].0) as f64 * 1e-9;
        let transition = DMat4::from_cols(
            DVec4::X,
            DVec4::new(h, math::exp(-h / RATE_TIME_CONSTANT_S), 0.0, 0.0),
            DVec4::Z,
            DVec4::W,
        );
        state = transition * state;
        covariance = transition * covariance * transition.transpose() + process_noise(h, since_s);
        let predicted = (state, covariance);
        if let Some(LinearisedRange { residual_m, rate, distance_m }) = about[n] {
            let by = DVec4::new(rate, 0.0, 1.0, distance_m - middle_m);
            let shared = covariance * by;
            let off = residual_m + rate * way[n] - by.dot(state);
            let spread = (by.dot(shared) + noise_m * noise_m).sqrt();
            // Outliers get more noise (Huber).
            let extra = ((off.abs() / spread) / HUBER_SIGMAS).max(1.0);
            let total = by.dot(shared) + noise_m * noise_m * extra * extra;
            state += shared * (off / total);
            let known = DMat4::from_cols(shared * shared.x, shared * shared.y, shared * shared.z, shared * shared.w);
            covariance -= known * (1.0 / total);
        }
        steps.push(FilterStep { predicted, corrected: (state, covariance), transition });
    }
    let smoothed = |((time_ns, _), (state, covariance)): (&(i64, f64), &(DVec4, DMat4))| Lag {
        time_s: *time_ns as f64 * 1e-9,
        lag_s: state.x,
        sigma_s: covariance.x_axis.x.max(0.0).sqrt(),
    };
    radar.iter().zip(&rts_smooth(&steps)).map(smoothed).collect()
}

/// Process noise of a step.
fn process_noise(h: f64, since_s: f64) -> DMat4 {
    let restless = (START_RATE_WALK * math::exp(-(since_s / START_DECAY_S).powi(2)) + STEADY_RATE_WALK).powi(2);
    DMat4::from_cols(
        DVec4::new(restless * h.powi(3) / 3.0, restless * h * h / 2.0, 0.0, 0.0),
        DVec4::new(restless * h * h / 2.0, restless * h, 0.0, 0.0),
        DVec4::new(0.0, 0.0, BIAS_WALK_M * BIAS_WALK_M * h, 0.0),
        DVec4::ZERO,
    )
}

/// The backward pass of the Rauch–Tung–Striebel smoother.
fn rts_smooth(steps: &[FilterStep]) -> Vec<(DVec4, DMat4)> {
    let Some(last) = steps.last() else { return Vec::new() };
    let mut all = vec![last.corrected; steps.len()];
    for n in (0..steps.len() - 1).rev() {
        let (step, next, later) = (&steps[n], &steps[n + 1], all[n + 1]);
        let gain = step.corrected.1 * next.transition.transpose() * next.predicted.1.inverse();
        all[n] = (
            step.corrected.0 + gain * (later.0 - next.predicted.0),
            step.corrected.1 + gain * (later.1 - next.predicted.1) * gain.transpose(),
        );
    }
    all
}

/// Noise of a range from the differences of neighbours, metres.
fn noise_m(about: &[Option<LinearisedRange>]) -> f64 {
    let pairs = about.windows(2).filter_map(|pair| Some((pair[1]?.residual_m - pair[0]?.residual_m).abs()));
    (1.4826 / 2f64.sqrt() * median(pairs)).max(MIN_NOISE_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::geometry::Pose;

    fn distance_m(t: f64) -> f64 {
        let moving = (t - 0.5).clamp(0.0, 1.0);
        0.8 + moving * (0.2 * (3.1 * t).sin() + 0.1 * (5.3 * t + 1.0).cos())
    }

    /// Ranges every 8 ms and distances every 5 ms with lagging timestamps.
    fn series(lag_s: impl Fn(f64) -> f64, bias_m: f64) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
        // Repeatable noise of half a millimetre.
        let noise = |n: usize| 0.5e-3 * ((n * n % 1009) as f64 / 504.0 - 1.0);
        let radar = (0..1250).map(|n| n as f64 * 8e-3).map(|t| [t, distance_m(t) + bias_m]).enumerate();
        let radar = radar.map(|(n, [t, r])| [t, r + noise(n)]).collect();
        let poses = (0..2200).map(|n| n as f64 * 5e-3 - 0.5).map(|t| [t + lag_s(t), distance_m(t)]).collect();
        (radar, poses)
    }

    #[test]
    fn decaying_lag_is_estimated_and_removed() {
        let lag = |t: f64| -0.06 - 0.8 * (1.0 - t.max(0.0) / 5.0).max(0.0).powi(2);
        let (radar, poses) = series(lag, 0.01);
        let curve = LagCurve::of(&radar, &poses).unwrap();
        for estimated in curve.lags().iter().filter(|estimated| estimated.time_s > 1.5) {
            let off_s = (estimated.lag_s - lag(estimated.time_s)).abs();
            assert!(
                off_s < 8e-3 && off_s < 5.0 * estimated.sigma_s + 2e-3,
                "{estimated:?} against {}",
                lag(estimated.time_s)
            );
        }
        let start = curve.start_lag().unwrap();
        assert!(start.is_significant && start.lag_s < -0.3, "{start:?}");
        assert!((curve.at(9.0).lag_s + 0.06).abs() < 1.5e-3, "{:?}", curve.at(9.0));
        let stamped: Vec<PoseSample> = poses.iter().map(|[s, _]| PoseSample::valid(ns(*s), &Pose::IDENTITY)).collect();
        let corrected = curve.corrected(&stamped, 0);
        for (n, pose) in corrected.iter().enumerate().filter(|(n, _)| (400..2000).contains(n)) {
            let true_s = n as f64 * 5e-3 - 0.5;
            assert!((pose.time_ns as f64 * 1e-9 - true_s).abs() < 8e-3, "{true_s}");
        }
        assert!(corrected.windows(2).all(|pair| pair[0].time_ns <= pair[1].time_ns));
    }

    #[test]
    fn constant_offset_gives_a_flat_curve_and_rest_is_unobservable() {
        let (radar, poses) = series(|_| 0.042, 0.0);
        let curve = LagCurve::of(&radar, &poses).unwrap();
        assert!(curve.lags().iter().filter(|t| t.time_s > 2.0).all(|t| (t.lag_s - 0.042).abs() < 3e-3));
        assert!(!curve.start_lag().unwrap().is_significant, "{:?}", curve.start_lag());
        let still = |points: Vec<[f64; 2]>| points.iter().map(|[t, _]| [*t, 0.8]).collect::<Vec<_>>();
        let curve = LagCurve::of(&still(radar), &still(poses)).unwrap();
        assert!(curve.lags().iter().all(|estimated| estimated.sigma_s > 0.1), "{:?}", curve.at(5.0));
    }

    #[test]
    fn invalid_series_give_none() {
        assert!(LagCurve::of(&[], &[]).is_none());
        let (radar, poses) = series(|_| 0.0, 0.0);
        assert!(LagCurve::of(&radar, &[]).is_none() && LagCurve::of(&radar[..10], &poses).is_none());
        let nan: Vec<[f64; 2]> = radar.iter().map(|[t, _]| [*t, f64::NAN]).collect();
        assert!(LagCurve::of(&nan, &poses).is_none());
        let far: Vec<[f64; 2]> = poses.iter().map(|[t, m]| [t + 1e5, *m]).collect();
        if let Some(curve) = LagCurve::of(&radar, &far) {
            assert!(curve.lags().iter().all(|estimated| estimated.sigma_s > 0.1));
        }
    }
}
