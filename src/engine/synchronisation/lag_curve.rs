//! The time between poses and radar as a curve: for recordings whose streams start out of step and fall into it (thesis, 4.1.3).
//!
//! Two series of one reflector, its range by radar r(t) and its distance by poses d(s) at stamps s, and a lag τ(t) with r(t) = d(t + τ(t)) + b(t),
//! b what place, mount and wander add. Two steps:
//!
//! 1. Coarse: the cheapest way through a grid of lags, one step every 50 ms (dynamic programming, as in time warping): finds lags of up to a
//!    second without a start, as long as they change by less than half a second a second.
//! 2. Fine: a Kalman smoother (Rauch, Tung and Striebel 1965) of τ, its rate and b about the coarse way, three times over.
//!    A lag may change fast in the first seconds and hardly later: that is what starting up means here.
//!
//! Limits: what does not move tells no lag, and the 1σ says so.

use glam::{DMat3, DVec3};

use super::ranges::value_at;
use crate::tracking::PoseSample;

/// Lags tried, seconds, and their grid.
const LEAST_LAG_S: f64 = -1.2;
const MOST_LAG_S: f64 = 1.2;
const GRID_S: f64 = 5e-3;
/// Time of a step, nanoseconds, and how far a lag goes in one: cells at most, and 1σ of it, cells.
const STEP_NS: i64 = 50_000_000;
const MOST_CELLS: usize = 6;
const USUAL_CELLS: f64 = 2.5;
/// What a range may be off while the way is sought, metres, and what no distance at all costs.
const COARSE_M: f64 = 0.02;
const NO_DISTANCE: f64 = 3.0;
/// How fast the lag's rate changes at the start, over which time that fades, and later: 1/s/√s, seconds.
const RESTLESS: f64 = 0.15;
const FADES_S: f64 = 2.0;
const STEADY: f64 = 1.5e-3;
/// The rate itself fades over this, seconds, and is known to this beforehand.
const RATE_LASTS_S: f64 = 2.0;
const RATE_PRIOR: f64 = 0.5;
/// b wanders by this, metres/√s, and is known to this beforehand, metres.
const BIAS_WALK_M: f64 = 1e-3;
const BIAS_PRIOR_M: f64 = 0.05;
/// Least noise of a range, metres, and beyond how many of its 1σ a range counts less.
const LEAST_NOISE_M: f64 = 0.5e-3;
const OUTLIER: f64 = 3.0;
const ROUNDS: usize = 3;
/// Distances change over this when their rate is asked for, nanoseconds.
const RATE_HALF_NS: i64 = 10_000_000;
/// Ranges that are too few.
const LEAST_RANGES: usize = 50;

/// The lag at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Since the first sweep, in sweeps' time, seconds.
    pub time_s: f64,
    /// Stamp of the pose minus time of the sweep, seconds.
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
    /// From a reflector's range by radar and distance by poses, each in rising time, seconds and metres; `None`: too few ranges, or
    /// numbers that are none.
    pub fn of(radar_m: &[[f64; 2]], poses_m: &[[f64; 2]]) -> Option<Self> {
        let series = |points: &[[f64; 2]]| -> Vec<(i64, f64)> {
            let sound = points.iter().filter(|p| p[0].abs() < 1e6 && p[1].is_finite());
            sound.map(|p| ((p[0] * 1e9).round() as i64, p[1])).collect()
        };
        let (radar, poses) = (series(radar_m), series(poses_m));
        if radar.len() < LEAST_RANGES || poses.len() < 2 {
            return None;
        }
        let mut way = coarse(&radar, &poses, 0.0);
        // Once more without what the ranges are off as a whole.
        let bias_m = median(radar.iter().zip(&way).filter_map(|((t, r), lag_s)| Some(r - value_at(&poses, t + ns(*lag_s))?)));
        way = coarse(&radar, &poses, bias_m);
        let mut lags = Vec::new();
        for _ in 0..ROUNDS {
            lags = smoothed(&radar, &poses, &way, bias_m);
            way = lags.iter().map(|lag: &Lag| lag.lag_s.clamp(LEAST_LAG_S, MOST_LAG_S)).collect();
        }
        lags.iter().all(|lag| lag.lag_s.is_finite() && lag.sigma_s.is_finite()).then_some(Self { lags })
    }

    /// Another curve laid over it: what is left of the lag once this one was taken out, at times in rising order.
    pub fn with(mut self, left: &[Lag]) -> Self {
        let left: Vec<Lag> = left.iter().copied().filter(|lag| (lag.time_s + lag.lag_s + lag.sigma_s).is_finite()).collect();
        if !left.is_empty() {
            let left = Self { lags: left };
            for lag in &mut self.lags {
                let more = left.at(lag.time_s);
                (lag.lag_s, lag.sigma_s) = (lag.lag_s + more.lag_s, more.sigma_s);
            }
        }
        self
    }

    /// The lag where it was told, in rising time.
    pub fn lags(&self) -> &[Lag] {
        &self.lags
    }

    /// The lag at a time, seconds; outside, that of the nearest.
    pub fn at(&self, time_s: f64) -> Lag {
        let later = self.lags.partition_point(|lag| lag.time_s < time_s);
        let (a, b) = (self.lags[later.saturating_sub(1)], self.lags[later.min(self.lags.len() - 1)]);
        let share = ((time_s - a.time_s) / (b.time_s - a.time_s).max(1e-9)).clamp(0.0, 1.0);
        let mix = |from: f64, to: f64| from + (to - from) * share;
        Lag { time_s, lag_s: mix(a.lag_s, b.lag_s), sigma_s: mix(a.sigma_s, b.sigma_s) }
    }

    /// Poses with the lag taken out of their stamps; `start_ns` is the first sweep's time. Their order stays.
    pub fn corrected(&self, poses: &[PoseSample], start_ns: i64) -> Vec<PoseSample> {
        // Stamps rise with the time they belong to; where the curve would have them fall, they wait.
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

/// The cheapest way, as a lag at each range.
fn coarse(radar: &[(i64, f64)], poses: &[(i64, f64)], bias_m: f64) -> Vec<f64> {
    let cells = ((MOST_LAG_S - LEAST_LAG_S) / GRID_S).round() as usize + 1;
    let lag_s = |cell: usize| LEAST_LAG_S + cell as f64 * GRID_S;
    let first_ns = radar[0].0;
    let step_of = |time_ns: i64| ((time_ns - first_ns) / STEP_NS) as usize;
    let steps = step_of(radar[radar.len() - 1].0) + 1;
    let turn_cost: Vec<f64> = (0..=MOST_CELLS).map(|n| 0.5 * (n as f64 / USUAL_CELLS).powi(2)).collect();
    let mut costs = vec![0.0f64; cells];
    let mut from: Vec<u16> = Vec::with_capacity(steps * cells);
    let mut rest = radar;
    for step in 0..steps {
        let (now, later) = rest.split_at(rest.partition_point(|(t, _)| step_of(*t) <= step));
        rest = later;
        let mut next = vec![f64::INFINITY; cells];
        for (cell, cost) in next.iter_mut().enumerate() {
            let near = cell.saturating_sub(MOST_CELLS)..(cell + MOST_CELLS + 1).min(cells);
            let best = near.map(|n| (costs[n] + turn_cost[n.abs_diff(cell)], n));
            let Some((least, before)) = best.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            from.push(before as u16);
            let misfit = |(t, range_m): &(i64, f64)| {
                let distance_m = value_at(poses, t.saturating_add(ns(lag_s(cell))));
                distance_m.map_or(NO_DISTANCE, |d| {
                    let off = (range_m - d - bias_m) / COARSE_M;
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
    // From step to step in straight lines.
    let at = |time_ns: i64| {
        let place = (time_ns - first_ns) as f64 / STEP_NS as f64 - 0.5;
        let before = (place.max(0.0) as usize).min(steps - 1);
        let share = (place - before as f64).clamp(0.0, 1.0);
        way[before] + (way[(before + 1).min(steps - 1)] - way[before]) * share
    };
    radar.iter().map(|(t, _)| at(*t)).collect()
}

/// A range about the way: what is left of it and how it changes with the lag; `None`: no distance there.
fn about(reading: &(i64, f64), poses: &[(i64, f64)], lag_s: f64) -> Option<(f64, f64)> {
    let stamp_ns = reading.0.saturating_add(ns(lag_s));
    let [before, at, after] = [-RATE_HALF_NS, 0, RATE_HALF_NS].map(|by| value_at(poses, stamp_ns.saturating_add(by)));
    Some((reading.1 - at?, (after? - before?) / (2.0 * RATE_HALF_NS as f64 * 1e-9)))
}

/// What the smoother remembers of a step: the state predicted and corrected with their covariances, and how it came from the step before.
struct Step {
    predicted: (DVec3, DMat3),
    corrected: (DVec3, DMat3),
    carried: DMat3,
}

fn smoothed(radar: &[(i64, f64)], poses: &[(i64, f64)], way: &[f64], bias_m: f64) -> Vec<Lag> {
    let left: Vec<Option<(f64, f64)>> = radar.iter().zip(way).map(|(reading, lag_s)| about(reading, poses, *lag_s)).collect();
    let noise_m = noise_m(&left);
    // State: the lag itself, its rate, b.
    let mut state = DVec3::new(way[0], 0.0, bias_m);
    let mut covariance = DMat3::from_diagonal(DVec3::new(1.0, RATE_PRIOR * RATE_PRIOR, BIAS_PRIOR_M * BIAS_PRIOR_M));
    let mut steps: Vec<Step> = Vec::with_capacity(radar.len());
    for (n, (time_ns, _)) in radar.iter().enumerate() {
        let h = if n == 0 { 0.0 } else { (time_ns - radar[n - 1].0) as f64 * 1e-9 };
        let since_s = (time_ns - radar[0].0) as f64 * 1e-9;
        let fades = (-h / RATE_LASTS_S).exp();
        let carried = DMat3::from_cols(DVec3::X, DVec3::new(h, fades, 0.0), DVec3::Z);
        let restless = (RESTLESS * (-since_s / FADES_S).exp() + STEADY).powi(2);
        let walk = DMat3::from_cols(
            DVec3::new(restless * h.powi(3) / 3.0, restless * h * h / 2.0, 0.0),
            DVec3::new(restless * h * h / 2.0, restless * h, 0.0),
            DVec3::new(0.0, 0.0, BIAS_WALK_M * BIAS_WALK_M * h),
        );
        state = carried * state;
        covariance = carried * covariance * carried.transpose() + walk;
        let predicted = (state, covariance);
        if let Some((left_m, rate)) = left[n] {
            let by = DVec3::new(rate, 0.0, 1.0);
            let shared = covariance * by;
            let expected = rate * (state.x - way[n]) + state.z;
            let off = left_m - expected;
            let spread = (by.dot(shared) + noise_m * noise_m).sqrt();
            // What lies far off counts as if it had more noise (Huber).
            let extra = ((off.abs() / spread) / OUTLIER).max(1.0);
            let total = by.dot(shared) + noise_m * noise_m * extra * extra;
            state += shared * (off / total);
            covariance -= DMat3::from_cols(shared * shared.x, shared * shared.y, shared * shared.z) * (1.0 / total);
        }
        steps.push(Step { predicted, corrected: (state, covariance), carried });
    }
    let mut later = steps.last().map_or((state, covariance), |last| last.corrected);
    let mut lags = vec![later; steps.len()];
    for n in (0..steps.len().saturating_sub(1)).rev() {
        let (step, next) = (&steps[n], &steps[n + 1]);
        let gain = step.corrected.1 * next.carried.transpose() * next.predicted.1.inverse();
        later = (
            step.corrected.0 + gain * (later.0 - next.predicted.0),
            step.corrected.1 + gain * (later.1 - next.predicted.1) * gain.transpose(),
        );
        lags[n] = later;
    }
    let told = |((time_ns, _), (state, covariance)): (&(i64, f64), &(DVec3, DMat3))| Lag {
        time_s: *time_ns as f64 * 1e-9,
        lag_s: state.x,
        sigma_s: covariance.x_axis.x.max(0.0).sqrt(),
    };
    radar.iter().zip(&lags).map(told).collect()
}

/// Noise of a range by how it differs from its neighbours, metres.
fn noise_m(left: &[Option<(f64, f64)>]) -> f64 {
    let pairs = left.windows(2).filter_map(|pair| Some((pair[1]?.0 - pair[0]?.0).abs()));
    (1.4826 / 2f64.sqrt() * median(pairs)).max(LEAST_NOISE_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;

    fn distance_m(t: f64) -> f64 {
        let moving = (t - 0.5).clamp(0.0, 1.0);
        0.8 + moving * (0.2 * (3.1 * t).sin() + 0.1 * (5.3 * t + 1.0).cos())
    }

    /// Ranges every 8 ms and distances every 5 ms, whose stamps lag.
    fn series(lag_s: impl Fn(f64) -> f64, bias_m: f64) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
        // Noise that repeats: half a millimetre.
        let noise = |n: usize| 0.5e-3 * ((n * n % 1009) as f64 / 504.0 - 1.0);
        let radar = (0..1250).map(|n| n as f64 * 8e-3).map(|t| [t, distance_m(t) + bias_m]).enumerate();
        let radar = radar.map(|(n, [t, r])| [t, r + noise(n)]).collect();
        let poses = (0..2200).map(|n| n as f64 * 5e-3 - 0.5).map(|t| [t + lag_s(t), distance_m(t)]).collect();
        (radar, poses)
    }

    #[test]
    fn a_lag_that_decays_is_followed_and_taken_out() {
        let lag = |t: f64| -0.06 - 0.8 * (1.0 - t.max(0.0) / 5.0).max(0.0).powi(2);
        let (radar, poses) = series(lag, 0.01);
        let curve = LagCurve::of(&radar, &poses).unwrap();
        for told in curve.lags().iter().filter(|told| told.time_s > 1.5) {
            let off_s = (told.lag_s - lag(told.time_s)).abs();
            assert!(off_s < 8e-3 && off_s < 5.0 * told.sigma_s + 2e-3, "{told:?} against {}", lag(told.time_s));
        }
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
    fn a_constant_offset_is_a_flat_curve_and_rest_tells_nothing() {
        let (radar, poses) = series(|_| 0.042, 0.0);
        let curve = LagCurve::of(&radar, &poses).unwrap();
        assert!(curve.lags().iter().filter(|t| t.time_s > 2.0).all(|t| (t.lag_s - 0.042).abs() < 3e-3));
        let still = |points: Vec<[f64; 2]>| points.iter().map(|[t, _]| [*t, 0.8]).collect::<Vec<_>>();
        let curve = LagCurve::of(&still(radar), &still(poses)).unwrap();
        assert!(curve.lags().iter().all(|told| told.sigma_s > 0.1), "{:?}", curve.at(5.0));
    }

    #[test]
    fn bad_series_give_none_and_no_panic() {
        assert!(LagCurve::of(&[], &[]).is_none());
        let (radar, poses) = series(|_| 0.0, 0.0);
        assert!(LagCurve::of(&radar, &[]).is_none() && LagCurve::of(&radar[..10], &poses).is_none());
        let nan: Vec<[f64; 2]> = radar.iter().map(|[t, _]| [*t, f64::NAN]).collect();
        assert!(LagCurve::of(&nan, &poses).is_none());
        let far: Vec<[f64; 2]> = poses.iter().map(|[t, m]| [t + 1e5, *m]).collect();
        if let Some(curve) = LagCurve::of(&radar, &far) {
            assert!(curve.lags().iter().all(|told| told.sigma_s > 0.1));
        }
    }
}
