//! Fits one track for given corrections: its reflector, and the slow tracking error along the line of sight.
//!
//! Range i = |s − p(t_i + τ)| + b (point) or r₀ − n·(p(t_i + τ) − p̄) + b (plane) + slow error, where p is the path
//! with the sensor shifted, τ the time offset and b the range bias.

use std::ops::Range;

use glam::{DMat2, DMat3, DVec2, DVec3};

use super::basis::SlowErrorBasis;
use super::boresight::{Aspect, Aspects, Directions};
use super::corrections::{BIAS, CORRECTIONS, Corrections, OFFSET};
use super::descent::Descent;
use super::echoes::Echo;
use super::information::Information;
use super::mean_direction::{RangeChanges, Sighting};
use super::normal_equations::NormalEquations;
use super::path::{PathState, SensorPath};
use super::reflector::{REFLECTOR, Reflector, ReflectorKind};
use crate::math;
use crate::symmetric::{eigen, outer};
use crate::{PHASE_RAD_PER_M, PositionErrors, WAVELENGTH_M};

/// Tangents of the starting directions off the boresight. Choice: five directions cover the beam.
const COARSE_TANGENT: f64 = 0.6;
/// Greatest number of echoes used from the starting directions. Choice: more than ten for each of the three unknowns.
const COARSE_ECHOES: usize = 40;
/// Greatest number of explanations of a track that are followed, best first. Choice: a point, a plane and a mirror
/// image of the point.
const MAX_EXPLANATIONS: usize = 3;
/// 1σ of the reflector's direction about the boresight. Choice: the beam's half-width of 34°; it only keeps an open
/// unknown finite.
pub(super) const DIRECTION_PRIOR_RAD: f64 = 0.6;
/// Jitter of the smoothed path, metres. Choice: the default 0.3 mm of a pose, of which a quadratic
/// fit to eleven poses leaves 0.46.
const JITTER_M: f64 = 0.15e-3;
/// Tracks with fewer echoes, or shorter ones, are not used. Choice: shorter pieces of a movement
/// are nearly straight and uniform, which corrections and depth explain alike.
const MIN_ECHOES: usize = 25;
const MIN_SPAN_S: f64 = 0.25;
/// Margin of the path around a track, nanoseconds. Choice: a phase's time differs from its range's by less than the
/// 8 ms of a group of sweeps.
pub(super) const MARGIN_NS: i64 = 10_000_000;
/// Residuals beyond this many times their spread get less weight (Huber). Choice: 1 % of normal
/// residuals get less weight.
const OUTLIER: f64 = 2.5;
/// Phases are unwrapped from echo to echo across at most this time, seconds, while they
/// deviate from the fit's prediction by at most this share of half a wavelength. Choice: a speed
/// error of 15 mm/s adds 0.45 mm in 30 ms; the limit is 0.74 mm, and 1.24 mm would be ambiguous.
const UNWRAP_S: f64 = 0.03;
const UNWRAP_SHARE: f64 = 0.3;
/// Unwrapped segments of fewer echoes are not used. Choice: each segment costs one unknown, and
/// short ones say little else.
const MIN_SEGMENT: usize = 12;
/// Error of an unwrapped phase, metres. Choice: the jitter's, which is correlated over the eleven
/// poses that are smoothed together.
pub(super) const PHASE_ERROR_M: f64 = 0.5e-3;
/// Cost of an echo whose phase cannot be unwrapped. Choice: that of a residual of 2σ, so that an
/// explanation which unwraps more phases wins.
const NOT_UNWRAPPED_COST: f64 = 4.0;
/// A reflector's direction is not known when a fit in another direction costs less than this more, that is, this far apart,
/// rad, or when its 1σ is greater, rad. Choice: a likelihood ratio of e¹²; half the lensless beam; 11°.
const RIVAL_COST: f64 = 25.0;
const RIVAL_RAD: f64 = 0.3;
const MAX_DIRECTION_SIGMA_RAD: f64 = 0.2;
/// Relative decrease of the cost below which a descent stops: for intermediate results, and for
/// the final one. Choice: enough to rank the starts; and far below the cost of one echo.
const COARSE_GAIN: f64 = 1e-3;
const FINE_GAIN: f64 = 1e-5;

/// A measured range with its variance, and the range from phase up to whole half wavelengths.
#[derive(Debug, Clone)]
pub(super) struct Row {
    time_ns: i64,
    pub range_m: f64,
    pub variance_m2: f64,
    phase_m: f64,
    phase_time_ns: i64,
    ln_amplitude: f64,
}

/// A track, prepared for fits. It keeps the reflectors of its explanations, from which the next fit starts.
#[derive(Debug, Clone)]
pub(super) struct TrackFit {
    pub forward: DVec3,
    pub rows: Vec<Row>,
    pub basis: SlowErrorBasis,
    reflectors: Vec<Reflector>,
    /// Where its echoes come from; `None` before the first fit, and when they move with the head.
    pub directions: Option<Directions>,
    pub first_ns: i64,
    pub last_ns: i64,
}

/// What a track follows, with the weights of the slow error's basis functions.
#[derive(Debug, Clone)]
pub(super) struct Explanation {
    pub reflector: Reflector,
    pub slow_error: Vec<f64>,
}

/// Consecutive rows whose phases are unwrapped.
pub(super) struct Segment {
    pub rows: Range<usize>,
    /// Ranges from phase, up to a constant that they share, metres.
    pub ranges_m: Vec<f64>,
    /// Values of the slow error's basis functions without their mean over the segment, row after row.
    pub values: Vec<f64>,
}

/// A fit of all unknowns of a track.
pub(super) struct Fitted {
    pub explanation: Explanation,
    pub weights: Vec<f64>,
    pub segments: Vec<Segment>,
    pub cost: f64,
}

/// One measured range, or one range from phase without the mean of its segment: measured minus modelled, weight, and
/// derivatives.
pub(super) struct Equation<'a> {
    pub time_ns: i64,
    pub residual_m: f64,
    pub weight: f64,
    pub reflector: [f64; REFLECTOR],
    pub slow_error: &'a [f64],
    pub corrections: Corrections,
}

/// A track with the path for given corrections.
pub(super) struct Problem<'a> {
    pub track: &'a TrackFit,
    /// Where the sensor was at each row's range and at its phase, relative to the middle of the path.
    pub at_range: Vec<PathState>,
    pub at_phase: Vec<PathState>,
    /// Values of the slow error's basis functions, row after row.
    values: Vec<f64>,
    pub bias_m: f64,
    /// Variance of the drift relative to the settings'.
    pub drift_scale: f64,
}

impl TrackFit {
    /// Whether echoes of one track are enough for a fit.
    pub fn is_possible(echoes: &[Echo]) -> bool {
        let [Some(first), Some(last)] = [echoes.first(), echoes.last()] else { return false };
        echoes.len() >= MIN_ECHOES && (last.time_ns - first.time_ns) as f64 >= MIN_SPAN_S * 1e9
    }

    /// Of echoes of one track; `forward` is the sum of the sensor's boresights. `None` when they are too few.
    pub fn new(echoes: &[Echo], forward: DVec3, errors: &PositionErrors) -> Option<Self> {
        let (first_ns, last_ns) = (echoes.first()?.time_ns, echoes.last()?.time_ns);
        if !Self::is_possible(echoes) {
            return None;
        }
        let row = |e: &Echo| Row {
            time_ns: e.time_ns,
            range_m: e.range_m,
            variance_m2: e.variance_m2 + JITTER_M * JITTER_M,
            phase_m: e.phase_rad / PHASE_RAD_PER_M,
            phase_time_ns: e.phase_time_ns,
            ln_amplitude: e.ln_amplitude,
        };
        Some(Self {
            forward: forward.normalize_or(DVec3::NEG_Z),
            rows: echoes.iter().map(row).collect(),
            basis: SlowErrorBasis::over(first_ns, last_ns, errors),
            reflectors: Vec::new(),
            directions: None,
            first_ns,
            last_ns,
        })
    }

    /// The track's information on corrections near `at`; `path` has the sensor shifted by them already. `None` where the
    /// path has a gap.
    pub fn information(&mut self, path: &SensorPath, at: &Corrections, drift_scale: f64) -> Option<Information> {
        let problem = Problem::new(self, path, at, drift_scale)?;
        let changes = RangeChanges::new(problem.sightings());
        if changes.as_ref().is_some_and(RangeChanges::moves_with_head) {
            self.directions = None;
            return None;
        }
        let starts = match self.reflectors.is_empty() {
            true => problem.coarse(),
            false => self.reflectors.clone(),
        };
        let fits = apart(starts.into_iter().filter_map(|start| problem.fitted(start)).collect());
        let information = Information::of(&problem, fits.first()?)?;
        self.directions = changes.map(|changes| Directions { changes, aspects: problem.aspects(&fits) });
        self.reflectors = fits.iter().map(|fit| fit.explanation.reflector).collect();
        Some(information)
    }
}

/// The best fits whose reflectors are not near a better one's.
fn apart(mut fits: Vec<Fitted>) -> Vec<Fitted> {
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut apart: Vec<Fitted> = Vec::new();
    for found in fits {
        let is_same = |known: &Fitted| known.explanation.reflector.is_same(&found.explanation.reflector);
        if apart.len() < MAX_EXPLANATIONS && !apart.iter().any(is_same) {
            apart.push(found);
        }
    }
    apart
}

/// Whether the same phases are unwrapped to the same ranges: others are half a wavelength off, or several.
fn are_unwrapped_alike(some: &[Segment], others: &[Segment]) -> bool {
    let is_near = |(a, b): (&f64, &f64)| (a - b).abs() < WAVELENGTH_M / 4.0;
    let is_same = |(a, b): (&Segment, &Segment)| a.rows == b.rows && a.ranges_m.iter().zip(&b.ranges_m).all(is_near);
    some.len() == others.len() && some.iter().zip(others).all(is_same)
}

impl<'a> Problem<'a> {
    pub fn new(track: &'a TrackFit, path: &SensorPath, at: &Corrections, drift_scale: f64) -> Option<Self> {
        let offset_ns = (at[OFFSET] * 1e9).round() as i64;
        let (from_ns, to_ns) = (track.first_ns.saturating_sub(MARGIN_NS), track.last_ns.saturating_add(MARGIN_NS));
        if !path.covers(from_ns.saturating_add(offset_ns), to_ns.saturating_add(offset_ns)) {
            return None;
        }
        let state_at = |time_ns: i64| path.at(time_ns.saturating_add(offset_ns));
        let mut at_range: Vec<PathState> = track.rows.iter().map(|row| state_at(row.time_ns)).collect::<Option<_>>()?;
        let mut at_phase: Vec<PathState> =
            track.rows.iter().map(|row| state_at(row.phase_time_ns)).collect::<Option<_>>()?;
        let middle_m = at_range.iter().map(|state| state.position_m).sum::<DVec3>() / at_range.len() as f64;
        at_range.iter_mut().chain(&mut at_phase).for_each(|state| state.position_m -= middle_m);
        let of_row = |(row, state): (&Row, &PathState)| track.basis.at(row.time_ns, state.position_m);
        let values = track.rows.iter().zip(&at_range).flat_map(of_row).collect();
        Some(Self { track, at_range, at_phase, values, bias_m: at[BIAS], drift_scale })
    }

    fn sightings(&self) -> impl Iterator<Item = Sighting> {
        self.rows().iter().zip(&self.at_range).map(|(row, state)| Sighting {
            time_ns: row.time_ns,
            range_m: row.range_m,
            position_m: state.position_m,
            tracking_from_sensor: state.tracking_from_sensor,
        })
    }

    pub fn rows(&self) -> &[Row] {
        &self.track.rows
    }

    /// Values of the slow error's basis functions at a row.
    pub fn values(&self, row: usize) -> &[f64] {
        let length = self.track.basis.len();
        &self.values[row * length..(row + 1) * length]
    }

    /// Local minima over the reflector alone, from starting directions over the beam.
    fn coarse(&self) -> Vec<Reflector> {
        let thinned = self.rows().len().div_ceil(COARSE_ECHOES);
        let some: Vec<f64> = (0..self.rows().len()).map(|n| if n % thinned == 0 { 1.0 } else { 0.0 }).collect();
        let range_m = self.rows().iter().map(|row| row.range_m).sum::<f64>() / self.rows().len() as f64 - self.bias_m;
        let forward = self.track.forward;
        let (a, b) = forward.any_orthonormal_pair();
        let directions = [DVec3::ZERO, a, -a, b, -b].map(|d| (forward + d * COARSE_TANGENT).normalize());
        let kinds = [ReflectorKind::Point, ReflectorKind::Plane];
        let starts = kinds.iter().flat_map(|&kind| directions.map(|direction| Reflector { kind, direction, range_m }));
        let Some(descent) = Descent::of_reflector(self, &some) else { return Vec::new() };
        let fit = |reflector: Reflector| {
            let (explanation, cost) = descent.from(reflector, COARSE_GAIN)?;
            Some(Fitted { explanation, weights: Vec::new(), segments: Vec::new(), cost })
        };
        let mut fits: Vec<Fitted> = starts.filter_map(fit).collect();
        let best = fits.iter().min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|fit| fit.explanation.reflector);
        fits.extend(best.and_then(|best| fit(self.mirrored(&best))));
        apart(fits).iter().map(|fit| fit.explanation.reflector).collect()
    }

    /// The reflector's mirror image in the plane that the path is closest to: a path in a plane does not distinguish them.
    fn mirrored(&self, of: &Reflector) -> Reflector {
        let spread = self.at_range.iter().map(|state| outer(state.position_m)).fold(DMat3::ZERO, |sum, of| sum + of);
        let (values, vectors) = eigen(&spread);
        let least = (0..3).min_by(|&i, &j| values[i].total_cmp(&values[j])).unwrap_or(0);
        Reflector { direction: of.direction.reflect(vectors.col(least)), ..*of }
    }

    /// Fit of all unknowns to the ranges, then to the phases too.
    pub fn fitted(&self, start: Reflector) -> Option<Fitted> {
        let all = vec![1.0; self.rows().len()];
        let (found, _) = Descent::of_all(self, &all, &[])?.from(start, COARSE_GAIN)?;
        let robust = self.robust_weights(&found);
        let (rough, _) = Descent::of_all(self, &robust, &[])?.from(found.reflector, COARSE_GAIN)?;
        let weights = self.robust_weights(&rough);
        let mut segments = self.unwrapped(&rough);
        let (mut explanation, mut cost) =
            Descent::of_all(self, &weights, &segments)?.from(rough.reflector, FINE_GAIN)?;
        // A more accurate fit may unwrap more phases.
        let unwrapped = self.unwrapped(&explanation);
        if !are_unwrapped_alike(&unwrapped, &segments) {
            segments = unwrapped;
            (explanation, cost) = Descent::of_all(self, &weights, &segments)?.from(explanation.reflector, FINE_GAIN)?;
        }
        let left = self.rows().len() - segments.iter().map(|segment| segment.rows.len()).sum::<usize>();
        Some(Fitted { explanation, weights, segments, cost: cost + left as f64 * NOT_UNWRAPPED_COST })
    }

    fn range_residual_m(&self, at: &Explanation, row: usize) -> f64 {
        let (range_m, _) = at.reflector.seen_from(self.at_range[row].position_m);
        self.rows()[row].range_m - self.bias_m - range_m - slow_error_m(at, self.values(row))
    }

    /// Reduced weights for residuals beyond the spread.
    fn robust_weights(&self, at: &Explanation) -> Vec<f64> {
        let rows = self.rows().iter().enumerate();
        let residuals: Vec<f64> =
            rows.map(|(n, row)| (self.range_residual_m(at, n) / row.variance_m2.sqrt()).abs()).collect();
        let mut sorted = residuals.clone();
        sorted.sort_by(f64::total_cmp);
        let spread = (sorted[sorted.len() / 2] * 1.483).max(1.0);
        residuals.iter().map(|r| (OUTLIER * spread / r.max(1e-9)).min(1.0)).collect()
    }

    /// Ranges from phase, unwrapped from echo to echo by the model's prediction.
    fn unwrapped(&self, at: &Explanation) -> Vec<Segment> {
        let half_m = WAVELENGTH_M / 2.0;
        let mut segments: Vec<Segment> = Vec::new();
        let mut before: Option<(i64, f64)> = None;
        for (n, (row, state)) in self.rows().iter().zip(&self.at_phase).enumerate() {
            let model_m = at.reflector.seen_from(state.position_m).0 + slow_error_m(at, self.values(n));
            let off_m = row.phase_m - model_m;
            // The multiple of half a wavelength that brings it closest to the previous one.
            let next = before.map(|(before_ns, before_m)| {
                let near_m = off_m + ((before_m - off_m) / half_m).round() * half_m;
                let pause_s = (row.phase_time_ns - before_ns) as f64 * 1e-9;
                (near_m, pause_s <= UNWRAP_S && (near_m - before_m).abs() <= UNWRAP_SHARE * half_m)
            });
            let (near_m, goes_on) = next.unwrap_or((off_m, false));
            match segments.last_mut().filter(|_| goes_on) {
                Some(segment) => {
                    segment.rows.end = n + 1;
                    segment.ranges_m.push(model_m + near_m);
                }
                None => {
                    segments.push(Segment { rows: n..n + 1, ranges_m: vec![model_m + near_m], values: Vec::new() });
                }
            }
            before = Some((row.phase_time_ns, near_m));
        }
        segments.retain(|segment| segment.rows.len() >= MIN_SEGMENT);
        segments.iter_mut().for_each(|segment| segment.values = self.values_without_mean(segment.rows.clone()));
        segments
    }

    fn values_without_mean(&self, rows: Range<usize>) -> Vec<f64> {
        let (length, count) = (self.track.basis.len(), rows.len() as f64);
        let mean = |k: usize| rows.clone().map(|n| self.values(n)[k]).sum::<f64>() / count;
        let means: Vec<f64> = (0..length).map(mean).collect();
        rows.clone().flat_map(|n| self.values(n).iter().zip(&means).map(|(value, mean)| value - mean)).collect()
    }

    /// All equations. Those of a segment of phases lack its mean, which removes its unknown constant.
    pub fn equations<'e>(&'e self, at: &Explanation, weights: &[f64], segments: &'e [Segment]) -> Vec<Equation<'e>> {
        let unknowns = at.slow_error.len();
        let mut all = Vec::with_capacity(2 * self.rows().len());
        for (n, row) in self.rows().iter().enumerate().filter(|(n, _)| weights[*n] > 0.0) {
            let (reflector, corrections) = at.reflector.derivatives(&self.at_range[n]);
            let (residual_m, weight) = (self.range_residual_m(at, n), weights[n] / row.variance_m2);
            let slow_error = &self.values(n)[..unknowns];
            all.push(Equation { time_ns: row.time_ns, residual_m, weight, reflector, slow_error, corrections });
        }
        let length = self.track.basis.len();
        for segment in segments {
            let begin = all.len();
            let values = segment.values.chunks_exact(length);
            for ((n, range_m), slow_error) in segment.rows.clone().zip(&segment.ranges_m).zip(values) {
                let (reflector, corrections) = at.reflector.derivatives(&self.at_phase[n]);
                let residual_m = range_m - at.reflector.seen_from(self.at_phase[n].position_m).0;
                let (time_ns, weight) = (self.rows()[n].phase_time_ns, phase_weight());
                all.push(Equation { time_ns, residual_m, weight, reflector, slow_error, corrections });
            }
            subtract_mean(&mut all[begin..]);
            for equation in &mut all[begin..] {
                equation.residual_m -= slow_error_m(at, equation.slow_error);
                equation.slow_error = &equation.slow_error[..unknowns];
            }
        }
        all
    }

    /// Directions and amplitudes of the echoes by the best fit; `None` when another fit is nearly as good with another
    /// direction.
    fn aspects(&self, fits: &[Fitted]) -> Option<Aspects> {
        let (best, others) = fits.split_first()?;
        let reflector = &best.explanation.reflector;
        let is_rival = |fit: &Fitted| {
            let apart = fit.explanation.reflector.direction.distance(reflector.direction);
            fit.cost < best.cost + RIVAL_COST && apart > RIVAL_RAD
        };
        let covariance = self.direction_covariance(best)?;
        let is_vague = covariance.x_axis.x + covariance.y_axis.y > MAX_DIRECTION_SIGMA_RAD.powi(2);
        if is_vague || others.iter().any(is_rival) {
            return None;
        }
        let (a, b) = reflector.direction.any_orthonormal_pair();
        // Amplitudes fall with the square of a point's range, and with a plane's range.
        let law = if reflector.kind == ReflectorKind::Point { 2.0 } else { 1.0 };
        let aspect = |(row, state): (&Row, &PathState)| {
            let sensor_from_tracking = state.tracking_from_sensor.transpose();
            Aspect {
                time_ns: row.time_ns,
                direction: sensor_from_tracking * reflector.seen_from(state.position_m).1,
                turns: [sensor_from_tracking * a, sensor_from_tracking * b],
                displacement: DVec2::new(state.position_m.dot(a), state.position_m.dot(b)) / reflector.range_m,
                ln_amplitude: row.ln_amplitude + law * math::ln(row.range_m),
            }
        };
        Some(Aspects::new(self.rows().iter().zip(&self.at_range).map(aspect), covariance))
    }

    /// Covariance of the two rotations of a fit's direction, rad².
    fn direction_covariance(&self, fit: &Fitted) -> Option<DMat2> {
        let equations = self.equations(&fit.explanation, &fit.weights, &fit.segments);
        let normal = self.normal_equations_at(fit, &equations);
        let factor = normal.factor(0.0)?;
        let column = |k: usize| {
            let mut unit = vec![0.0; normal.right.len()];
            unit[k] = 1.0;
            factor.solve(&unit)
        };
        let (x, y) = (column(1), column(2));
        Some(DMat2::from_cols_array(&[x[1], x[2], y[1], y[2]]))
    }

    /// Products of the slow error's derivatives with each other, as unknowns from `begin` on.
    pub fn slow_error_equations(&self, begin: usize, weights: &[f64], segments: &[Segment]) -> NormalEquations {
        let basis = &self.track.basis;
        let mut normal = NormalEquations::new(begin + basis.len());
        for (n, (row, weight)) in self.rows().iter().zip(weights).enumerate() {
            normal.add_linear(begin, self.values(n), weight / row.variance_m2);
        }
        for values in segments.iter().flat_map(|segment| segment.values.chunks_exact(basis.len())) {
            normal.add_linear(begin, values, phase_weight());
        }
        normal
    }

    /// Weight of the n-th slow error's prior.
    pub fn slow_error_weight(&self, n: usize) -> f64 {
        1.0 / self.track.basis.prior_variance(n, self.drift_scale)
    }

    /// The normal equations of all unknowns at a fit, with the priors.
    pub fn normal_equations_at(&self, fit: &Fitted, equations: &[Equation]) -> NormalEquations {
        let Explanation { reflector, slow_error } = &fit.explanation;
        let mut normal = self.slow_error_equations(REFLECTOR, &fit.weights, &fit.segments);
        for e in equations {
            normal.add(&e.reflector, e.slow_error, e.residual_m, e.weight);
        }
        for (turn, off) in reflector.expected_turns(self.track.forward).into_iter().enumerate() {
            normal.expect(1 + turn, off, 1.0 / (DIRECTION_PRIOR_RAD * DIRECTION_PRIOR_RAD));
        }
        for (n, value) in slow_error.iter().enumerate() {
            normal.expect(REFLECTOR + n, -value, self.slow_error_weight(n));
        }
        normal
    }
}

/// Weight of a range from phase.
pub(super) fn phase_weight() -> f64 {
    1.0 / (PHASE_ERROR_M * PHASE_ERROR_M)
}

fn slow_error_m(at: &Explanation, values: &[f64]) -> f64 {
    at.slow_error.iter().zip(values).map(|(a, b)| a * b).sum()
}

/// Subtracts the mean of residuals and derivatives but the slow error's, which lack it already.
fn subtract_mean(equations: &mut [Equation]) {
    let count = equations.len() as f64;
    let mean = |of: &dyn Fn(&Equation) -> f64| equations.iter().map(of).sum::<f64>() / count;
    let residual_m = mean(&|e| e.residual_m);
    let reflector: [f64; REFLECTOR] = std::array::from_fn(|k| mean(&|e| e.reflector[k]));
    let corrections: Corrections = std::array::from_fn(|k| mean(&|e| e.corrections[k]));
    for e in equations {
        e.residual_m -= residual_m;
        (0..REFLECTOR).for_each(|k| e.reflector[k] -= reflector[k]);
        (0..CORRECTIONS).for_each(|k| e.corrections[k] -= corrections[k]);
    }
}
