//! Offset estimate from rates of change: the offset at which the rates of two distances correlate
//! best.
//!
//! Rates are slopes of straight lines over 0.1 s, computed alike for both series, so that their
//! smoothing cancels. A position error of the reflector changes the rates little, and a constant
//! range error not at all.

use super::RateOffset;
use super::ranges::value_at;

/// Half of the interval of a slope, nanoseconds. Choice: long enough that range noise of 5 mm
/// leaves less than 0.1 m/s, short against a stroke of a second.
const HALF_NS: i64 = 50_000_000;
/// Least number of entries of a slope, and least time that they must span. Choice: two more than a
/// line has parameters, on at least half the interval.
const MIN_ENTRIES: usize = 4;
const MIN_SPAN_NS: i64 = HALF_NS;
/// Offsets searched to both sides, and their step, nanoseconds. Choice: lags of up to a second
/// (thesis, 4.1.3); the vertex is interpolated between steps.
const SEARCH_NS: i64 = 1_000_000_000;
const STEP_NS: i64 = 2_000_000;
/// Least share of a window's rates that need a counterpart in the other series. Choice: with a
/// shorter overlap a few accidental rates correlate best.
const MIN_SHARE: f64 = 0.6;
/// Least number of rates, and least rms rate, m/s. Choice: a quarter of a second of groups; slower
/// motion is lost in the slopes' noise, 0.05 m/s where ranges have 5 mm.
const MIN_RATES: usize = 30;
const MIN_RATE_M_PER_S: f64 = 0.05;
/// Least correlation and largest 1σ, seconds, of a result. Choice: another echo or a resting sensor
/// stays below; 20 ms misplace an echo by 2 cm at 1 m/s, and the result is a check of the
/// estimator.
const MIN_CORRELATION: f64 = 0.8;
const MAX_SIGMA_S: f64 = 0.02;

/// Rates of a distance over time: nanoseconds, m/s.
pub(super) struct RateSeries(Vec<(i64, f64)>);

impl RateSeries {
    pub fn of(series: &[(i64, f64)]) -> Self {
        let (mut first, mut end) = (0, 0);
        let slope_at = |(time_ns, _): &(i64, f64)| {
            first += series[first..].partition_point(|(t, _)| *t < time_ns - HALF_NS);
            end = end.max(first) + series[end.max(first)..].partition_point(|(t, _)| *t <= time_ns + HALF_NS);
            slope(&series[first..end])
        };
        Self(series.iter().filter_map(slope_at).collect())
    }
}

/// Slope of the regression line, at the entries' mean time.
fn slope(entries: &[(i64, f64)]) -> Option<(i64, f64)> {
    let (first, last) = (entries.first()?, entries.last()?);
    if entries.len() < MIN_ENTRIES || last.0 - first.0 < MIN_SPAN_NS {
        return None;
    }
    let count = entries.len() as f64;
    let mean_ns = entries.iter().map(|(t, _)| t - first.0).sum::<i64>() / entries.len() as i64;
    let mean = entries.iter().map(|(_, value)| value).sum::<f64>() / count;
    let time_s = |t: i64| (t - first.0 - mean_ns) as f64 * 1e-9;
    let above: f64 = entries.iter().map(|(t, value)| time_s(*t) * (value - mean)).sum();
    let below: f64 = entries.iter().map(|(t, _)| time_s(*t).powi(2)).sum();
    (below > 0.0).then(|| (first.0 + mean_ns, above / below))
}

/// Delay of the poses' rates relative to the radar's, from the radar's rates within a time span.
pub(super) fn offset_by_rates(
    radar: &RateSeries,
    poses: &RateSeries,
    (from_ns, to_ns): (i64, i64),
    middle_s: f64,
) -> Option<RateOffset> {
    let first = radar.0.partition_point(|(t, _)| *t < from_ns);
    let end = radar.0.partition_point(|(t, _)| *t <= to_ns);
    let window = radar.0.get(first..end)?;
    let moving = window.iter().map(|(_, rate)| rate * rate).sum::<f64>() / window.len().max(1) as f64;
    if window.len() < MIN_RATES || moving.sqrt() < MIN_RATE_M_PER_S {
        return None;
    }
    let middle_ns = (middle_s * 1e9).round() as i64;
    let at = |step: i64| middle_ns + step * STEP_NS;
    let steps = SEARCH_NS / STEP_NS;
    let tried: Vec<f64> = (-steps..=steps).map(|step| correlation(window, poses, at(step))).collect();
    let best = (0..tried.len()).max_by(|&a, &b| tried[a].total_cmp(&tried[b]))?;
    if tried[best] < MIN_CORRELATION || best == 0 || best + 1 == tried.len() {
        return None;
    }
    let [a, b, c] = [tried[best - 1], tried[best], tried[best + 1]];
    let vertex = if a.min(c) >= 0.0 { (0.5 * (c - a) / (2.0 * b - a - c)).clamp(-1.0, 1.0) } else { 0.0 };
    let offset_ns = at(best as i64 - steps) + (vertex * STEP_NS as f64).round() as i64;
    let sigma_s = sigma_s(window, poses, offset_ns);
    (sigma_s <= MAX_SIGMA_S).then_some(RateOffset { offset_s: offset_ns as f64 * 1e-9, sigma_s, correlation: b })
}

/// Pairs of a radar rate and the pose rate this much later.
fn pairs<'a>(
    window: &'a [(i64, f64)],
    poses: &'a RateSeries,
    offset_ns: i64,
) -> impl Iterator<Item = (i64, f64, f64)> + 'a {
    window.iter().filter_map(move |(t, rate)| Some((*t, *rate, value_at(&poses.0, t.saturating_add(offset_ns))?)))
}

/// Correlation from −1 to 1; −1 when too few pairs exist.
fn correlation(window: &[(i64, f64)], poses: &RateSeries, offset_ns: i64) -> f64 {
    let (mut count, mut both, mut ours, mut theirs) = (0.0, 0.0, 0.0, 0.0);
    for (_, rate, other) in pairs(window, poses, offset_ns) {
        count += 1.0;
        both += rate * other;
        ours += rate * rate;
        theirs += other * other;
    }
    let correlation = both / (ours * theirs).sqrt();
    if count >= MIN_SHARE * window.len() as f64 && correlation.is_finite() { correlation } else { -1.0 }
}

/// 1σ of the offset from the residuals of the rates; neighbours within the time of a slope count as
/// one.
fn sigma_s(window: &[(i64, f64)], poses: &RateSeries, offset_ns: i64) -> f64 {
    let step_ns = HALF_NS / 5;
    let (mut count, mut misfit, mut steep) = (0.0, 0.0, 0.0);
    for (t, rate, other) in pairs(window, poses, offset_ns) {
        let near = |by_ns: i64| value_at(&poses.0, t.saturating_add(offset_ns).saturating_add(by_ns));
        let (Some(before), Some(after)) = (near(-step_ns), near(step_ns)) else { continue };
        count += 1.0;
        misfit += (rate - other).powi(2);
        steep += ((after - before) / (2.0 * step_ns as f64 * 1e-9)).powi(2);
    }
    let span_s = window.last().zip(window.first()).map_or(0.0, |(last, first)| (last.0 - first.0) as f64 * 1e-9);
    let independent = (span_s / (2.0 * HALF_NS as f64 * 1e-9)).clamp(1.0, f64::max(count, 1.0));
    (misfit / steep.max(1e-12) / independent).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A distance every `step_ms`, read this much later.
    fn series(step_ms: f64, late_s: f64) -> Vec<(i64, f64)> {
        let distance = |t: f64| 0.8 + 0.2 * (3.1 * t).sin() + 0.1 * (5.3 * t + 1.0).cos();
        (0..(6000.0 / step_ms) as i64)
            .map(|n| n as f64 * step_ms * 1e-3)
            .map(|t| ((t * 1e9) as i64, distance(t - late_s)))
            .collect()
    }

    #[test]
    fn rate_correlation_finds_the_offset() {
        for late_s in [-0.45, -0.02, 0.0, 0.0123, 0.8] {
            let [radar, poses] = [series(8.0, 0.0), series(5.0, late_s)].map(|s| RateSeries::of(&s));
            let found = offset_by_rates(&radar, &poses, (1_500_000_000, 4_500_000_000), 0.0).unwrap();
            assert!((found.offset_s - late_s).abs() < 0.2e-3, "{late_s}: {found:?}");
            assert!(found.correlation > 0.999 && found.sigma_s < 1e-3, "{found:?}");
        }
    }

    #[test]
    fn rest_and_empty_series_give_no_offset() {
        let still: Vec<(i64, f64)> = (0..800).map(|n| (n * 5_000_000, 0.8)).collect();
        let moving = RateSeries::of(&series(5.0, 0.0));
        let all = (0, 6_000_000_000);
        assert!(offset_by_rates(&RateSeries::of(&still), &moving, all, 0.0).is_none());
        assert!(offset_by_rates(&moving, &RateSeries::of(&still), all, 0.0).is_none());
        assert!(offset_by_rates(&RateSeries::of(&[]), &moving, all, 0.0).is_none());
        assert!(offset_by_rates(&moving, &moving, (7_000_000_000, 9_000_000_000), 0.0).is_none());
    }
}
