//! Fits one track to the path: its reflector, a point or a plane, and the time offset, by
//! Levenberg–Marquardt.
//!
//! Range i = |s − p(t_i + τ)| (point) or r₀ − n·(p(t_i + τ) − p̄) (plane), plus a slow pose error
//! along the line of sight. That error is estimated as well, as a sum of Gaussian basis functions
//! ("bumps") with the correlation exp(−Δt²/T²) and the drift's variance. The 1σ of τ therefore
//! includes what drift can imitate. Where the data cannot distinguish τ from depth, the 1σ stays
//! near its prior.
//!
//! Longer than other files: it is one least-squares problem with all its derivatives.

use std::collections::BTreeMap;

use glam::DVec3;

use super::least_squares::{HEAD, NormalEquations};
use super::path::SensorPath;
use super::tracks::Track;
use crate::PositionErrors;
use crate::math;
use crate::{PHASE_RAD_PER_M, WAVELENGTH_M};

/// Greatest distance of the offset from the middle of the search, seconds. Choice: delays of
/// headsets and lines are tens of milliseconds; a wider search costs starts and finds false fits.
pub(super) const REACH_S: f64 = 0.1;
/// A phase's time differs from its range's by less than this, seconds. Choice: above the 8 ms of a
/// group of sweeps.
const GROUP_S: f64 = 0.01;
/// Grid of the coarse search: spacing of the offsets, seconds, and angle of the directions off the
/// boresight, tangent. Choice: descents begin at most 25 ms off; five directions cover the beam.
const COARSE_STEP_S: f64 = 0.05;
const COARSE_TANGENT: f64 = 0.6;
/// Greatest number of echoes used in the coarse search. Choice: ten for each of the four unknowns;
/// it bounds the work of 25 descents.
const COARSE_ECHOES: usize = 40;
/// Greatest number of candidate explanations of a track that are followed, best first. Choice: a
/// mirror image and a few offsets that match; each costs a whole fit.
const MAX_EXPLANATIONS: usize = 5;
/// Priors, 1σ: the offset, seconds, and the direction off the boresight, rad. Choice: the reach of
/// the search, and the beam's half-width of 34°; both only keep open unknowns finite.
const OFFSET_PRIOR_S: f64 = 0.1;
const DIRECTION_PRIOR_RAD: f64 = 0.6;
/// Jitter of the smoothed path, metres. Choice: the default 0.3 mm of a pose, of which a quadratic
/// fit to eleven poses leaves 0.46.
const JITTER_M: f64 = 0.15e-3;
/// Apparent speed due to 0.3 mm of jitter in the smoothed path (0.23 of it per pose period: 8
/// mm/s), m/s. Choice: with a margin of nearly two.
const SPEED_ERROR_M_PER_S: f64 = 0.015;
/// Tracks with fewer echoes, or shorter ones, are not used. Choice: shorter pieces of a movement
/// are nearly straight and uniform, which offset and depth explain alike.
const MIN_ECHOES: usize = 25;
const MIN_SPAN_S: f64 = 0.25;
/// T of the drift's correlation exp(−Δt²/T²), in correlation times. Choice: a Gaussian of that
/// width resembles the correlation of the simulated low-pass drift.
const WANDER_WIDTH: f64 = 0.75;
/// Residuals within this time are summed when estimating their correlation, seconds. Choice: the
/// window over which poses are smoothed, within which their errors are alike.
const CORRELATION_BIN_S: f64 = 0.1;
/// Residuals beyond this many times their spread get less weight (Huber). Choice: 1 % of normal
/// residuals get less weight.
const OUTLIER: f64 = 2.5;
/// Phases are unwrapped ("carried") from echo to echo across at most this time, seconds, while they
/// deviate from the fit's prediction by at most this share of half a wavelength. Choice: a speed
/// error of 15 mm/s adds 0.45 mm in 30 ms; the limit is 0.74 mm, and 1.24 mm would be ambiguous.
const CARRY_S: f64 = 0.03;
const CARRY_SHARE: f64 = 0.3;
/// Unwrapped segments of fewer echoes are not used. Choice: each segment costs one unknown, and
/// short ones say little else.
const MIN_CARRIED: usize = 12;
/// Error of an unwrapped phase, metres. Choice: the jitter's, which is correlated over the eleven
/// poses that are smoothed together.
const PHASE_ERROR_M: f64 = 0.5e-3;
/// Cost of an echo whose phase cannot be unwrapped. Choice: that of a residual of 2σ, so that an
/// explanation which unwraps more phases wins.
const UNCARRIED_COST: f64 = 4.0;
/// Steps of a descent. Choice: it converges in some ten; more means that nothing fits.
const MAX_STEPS: usize = 25;
/// Relative decrease of the cost below which the iteration stops: for intermediate results, and for
/// the final one. Choice: enough to rank the starts; and far below the cost of one echo.
const COARSE_GAIN: f64 = 1e-3;
const FINE_GAIN: f64 = 1e-6;
/// Basis functions of the drift. Choice: bounds the matrix; tracks end at 5 s.
const MAX_KNOTS: usize = 20;

/// A track's estimate of the offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrackFit {
    /// Pose time minus sweep time, seconds.
    pub offset_s: f64,
    /// Its variance, s².
    pub variance_s2: f64,
    /// Rms of the range residuals in excess of noise, metres.
    pub excess_m: f64,
    /// Share of the echoes whose phase is unwrapped, and the rms of their phase residuals, metres.
    pub carried_share: f64,
    pub phase_rms_m: f64,
    /// End of the track, host nanoseconds.
    pub last_ns: i64,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    Point,
    Plane,
}

/// A reflector, relative to the middle of the path.
#[derive(Debug, Clone, Copy)]
struct Source {
    kind: Kind,
    pivot_m: DVec3,
    direction: DVec3,
    range_m: f64,
}

impl Source {
    /// Range from a position, and the unit vector towards the reflector.
    fn seen_from(&self, place: DVec3) -> (f64, DVec3) {
        let to = self.pivot_m + self.direction * self.range_m - place;
        match self.kind {
            Kind::Point => (to.length(), to.normalize_or(self.direction)),
            Kind::Plane => (self.direction.dot(to), self.direction),
        }
    }

    /// Derivatives of the range from a position with respect to range and rotations about the two
    /// transverse axes.
    fn derivatives(&self, (a, b): (DVec3, DVec3), place: DVec3, towards: DVec3) -> [f64; 3] {
        match self.kind {
            Kind::Point => [towards.dot(self.direction), self.range_m * towards.dot(a), self.range_m * towards.dot(b)],
            Kind::Plane => {
                let from = self.pivot_m - place;
                [1.0, from.dot(a), from.dot(b)]
            }
        }
    }

    fn moved(&self, step: &[f64]) -> Self {
        let (a, b) = self.direction.any_orthonormal_pair();
        let turn = (a * step[1] + b * step[2]).clamp_length_max(0.3);
        let range_m = (self.range_m + step[0].clamp(-0.2, 0.2)).max(0.02);
        Self { direction: (self.direction + turn).normalize(), range_m, ..*self }
    }
}

/// A measured range, its time and variance, and the basis functions at that time.
struct Row {
    time_ns: i64,
    range_m: f64,
    variance_m2: f64,
    /// Range from phase, up to whole half wavelengths, and its time.
    phase_m: f64,
    phase_time_ns: i64,
    bumps: Vec<f64>,
}

/// An unwrapped range from phase: its row, the range up to a constant shared by the segment, and
/// the basis functions minus their mean over the segment.
struct Carried {
    row: usize,
    range_m: f64,
    bumps: Vec<f64>,
}

/// Data of a fit: weights of the rows, unwrapped segments, and their contribution to the equations
/// that does not depend on the unknowns.
struct Data<'a> {
    weights: &'a [f64],
    carried: &'a [Vec<Carried>],
    constant: NormalEquations,
}

/// Residual of one range from phase: time, measured minus modelled range without the segment's
/// mean, derivatives without theirs.
struct PhaseResidual<'a> {
    time_ns: i64,
    residual_m: f64,
    head: [f64; HEAD],
    bumps: &'a [f64],
}

#[derive(Debug, Clone)]
struct Unknowns {
    source: Source,
    offset_s: f64,
    /// Weights of the basis functions, metres.
    drift_m: Vec<f64>,
}

/// Whether two explanations, given with their costs, will converge to one offset: same kind,
/// offsets within 3 ms, and either directions within 3° or about equal costs (the circle around a
/// straight path).
fn are_near(a: &(Unknowns, f64), b: &(Unknowns, f64)) -> bool {
    let (first, second) = (&a.0.source, &b.0.source);
    let same_kind = matches!(first.kind, Kind::Point) == matches!(second.kind, Kind::Point);
    let alike = first.direction.distance(second.direction) < 0.05 || (a.1 - b.1).abs() < 0.05 * a.1.min(b.1) + 1.0;
    same_kind && alike && (a.0.offset_s - b.0.offset_s).abs() < 3e-3
}

/// Index of the offset among the unknowns.
const OFFSET: usize = HEAD - 1;

struct Problem<'a> {
    path: &'a SensorPath,
    forward: DVec3,
    middle_s: f64,
    rows: Vec<Row>,
    bump_variance_m2: f64,
}

/// Fits a track; `None` when it is too short, or the path around it has gaps.
pub(super) fn fit(track: &Track, path: &SensorPath, middle_s: f64, errors: &PositionErrors) -> Option<TrackFit> {
    let problem = Problem::of(track, path, middle_s, errors)?;
    let start = problem.start()?;
    let mut coarse: Vec<(Unknowns, f64)> =
        [Kind::Point, Kind::Plane].into_iter().flat_map(|kind| problem.coarse(Source { kind, ..start })).collect();
    coarse.sort_by(|a, b| a.1.total_cmp(&b.1));
    // Explanations that coincide once all rows count are followed only once.
    let mut by_range: Vec<(Unknowns, f64)> =
        apart(coarse).into_iter().filter_map(|(found, _)| problem.by_range(found)).collect();
    by_range.sort_by(|a, b| a.1.total_cmp(&b.1));
    let fits = apart(by_range).into_iter().filter_map(|(found, _)| problem.by_phase(found, track.last_ns()));
    combine_explanations(&fits.collect::<Vec<_>>())
}

/// The best explanations that are not near a better one.
fn apart(sorted: Vec<(Unknowns, f64)>) -> Vec<(Unknowns, f64)> {
    let mut apart: Vec<(Unknowns, f64)> = Vec::new();
    for found in sorted {
        if apart.len() < MAX_EXPLANATIONS && !apart.iter().any(|known| are_near(known, &found)) {
            apart.push(found);
        }
    }
    apart
}

/// Combines several explanations of one track, each with its cost and misfit. Each is weighted by
/// its likelihood, with the noise estimated from the best one, and their disagreement adds to the
/// variance.
fn combine_explanations(fits: &[(TrackFit, f64, f64)]) -> Option<TrackFit> {
    let best = fits.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let weight = |cost: f64| math::exp(-0.5 * (cost - best.1) / best.2);
    let total: f64 = fits.iter().map(|f| weight(f.1)).sum();
    let offset_s = fits.iter().map(|f| weight(f.1) * f.0.offset_s).sum::<f64>() / total;
    let square = |f: &TrackFit| f.variance_s2 + (f.offset_s - offset_s).powi(2);
    let variance_s2 = fits.iter().map(|f| weight(f.1) * square(&f.0)).sum::<f64>() / total;
    Some(TrackFit { offset_s, variance_s2, ..best.0 })
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

fn nanoseconds(s: f64) -> i64 {
    (s * 1e9).round() as i64
}

impl<'a> Problem<'a> {
    fn of(track: &Track, path: &'a SensorPath, middle_s: f64, errors: &PositionErrors) -> Option<Self> {
        let reach_s = REACH_S + GROUP_S;
        let (early_ns, late_ns) = (nanoseconds(middle_s - reach_s), nanoseconds(middle_s + reach_s));
        let end_ns = path.end_ns()?;
        let echoes = track.echoes.iter().filter(|e| e.time_ns.saturating_add(late_ns) < end_ns);
        let (first_ns, last_ns) = (track.first_ns(), echoes.clone().next_back()?.time_ns);
        let whole = path.covers(first_ns.saturating_add(early_ns), last_ns.saturating_add(late_ns));
        if !whole || echoes.clone().count() < MIN_ECHOES || seconds(last_ns - first_ns) < MIN_SPAN_S {
            return None;
        }
        let bumps = GaussianBasis::over(first_ns, last_ns, errors);
        let row = |e: &super::echoes::Echo| Row {
            time_ns: e.time_ns,
            range_m: e.range_m,
            variance_m2: e.variance_m2 + JITTER_M * JITTER_M,
            phase_m: e.phase_rad / PHASE_RAD_PER_M,
            phase_time_ns: e.phase_time_ns,
            bumps: bumps.at(e.time_ns),
        };
        let rows = echoes.map(row).collect();
        let forward = track.forward.normalize_or(DVec3::NEG_Z);
        Some(Self { path, forward, middle_s, rows, bump_variance_m2: bumps.variance_m2 })
    }

    /// Straight ahead of the middle of the path, at the mean range.
    fn start(&self) -> Option<Source> {
        let count = self.rows.len() as f64;
        let middle_ns = nanoseconds(self.middle_s);
        let places: Option<Vec<DVec3>> =
            self.rows.iter().map(|r| Some(self.path.at(r.time_ns + middle_ns)?.0)).collect();
        Some(Source {
            kind: Kind::Point,
            pivot_m: places?.into_iter().sum::<DVec3>() / count,
            direction: self.forward,
            range_m: self.rows.iter().map(|r| r.range_m).sum::<f64>() / count,
        })
    }

    /// Local minima over reflector and offset, without the slow error, from starting offsets over
    /// the whole search interval and starting directions over the beam.
    fn coarse(&self, start: Source) -> Vec<(Unknowns, f64)> {
        let thinned = self.rows.len().div_ceil(COARSE_ECHOES);
        let some: Vec<f64> = (0..self.rows.len()).map(|n| if n % thinned == 0 { 1.0 } else { 0.0 }).collect();
        let steps = (REACH_S / COARSE_STEP_S).round() as i32;
        let offsets = (-steps..=steps).map(|step| self.middle_s + f64::from(step) * COARSE_STEP_S);
        let (a, b) = start.direction.any_orthonormal_pair();
        let directions = [DVec3::ZERO, a, -a, b, -b].map(|d| (start.direction + d * COARSE_TANGENT).normalize());
        let found = offsets.flat_map(|offset_s| directions.map(|direction| (offset_s, direction)));
        let data = self.data(&some, &[], HEAD);
        let found = found.filter_map(|(offset_s, direction)| {
            let from = Unknowns { source: Source { direction, ..start }, offset_s, drift_m: Vec::new() };
            self.descend(from, &data, COARSE_GAIN)
        });
        found.collect()
    }

    /// Fit of all unknowns to the ranges of all rows.
    fn by_range(&self, coarse: Unknowns) -> Option<(Unknowns, f64)> {
        let start = Unknowns { drift_m: vec![0.0; self.rows[0].bumps.len()], ..coarse };
        let size = HEAD + start.drift_m.len();
        let (unknowns, _) = self.descend(start, &self.data(&vec![1.0; self.rows.len()], &[], size), COARSE_GAIN)?;
        let weights = self.robust_weights(&unknowns)?;
        self.descend(unknowns, &self.data(&weights, &[], size), FINE_GAIN)
    }

    /// Fit of ranges and phases, with the cost and the misfit.
    fn by_phase(&self, by_range: Unknowns, last_ns: i64) -> Option<(TrackFit, f64, f64)> {
        let size = HEAD + by_range.drift_m.len();
        let weights = self.robust_weights(&by_range)?;
        let (mut unknowns, mut cost, mut carried) = (by_range, 0.0, Vec::new());
        // Twice: a more accurate fit unwraps more phases.
        for _ in 0..2 {
            carried = self.carried(&unknowns)?;
            (unknowns, cost) = self.descend(unknowns, &self.data(&weights, &carried, size), FINE_GAIN)?;
        }
        let left = self.rows.len() - carried.iter().map(Vec::len).sum::<usize>();
        let (fit, misfit) = self.assess(&unknowns, &self.data(&weights, &carried, size), last_ns)?;
        Some((fit, cost + left as f64 * UNCARRIED_COST, misfit))
    }

    /// Ranges from phase, unwrapped from echo to echo by the model's prediction.
    fn carried(&self, at: &Unknowns) -> Option<Vec<Vec<Carried>>> {
        let half_m = WAVELENGTH_M / 2.0;
        let mut all: Vec<Vec<Carried>> = Vec::new();
        let mut before: Option<(i64, f64)> = None;
        let model = Model::new(self.path, at);
        for (n, row) in self.rows.iter().enumerate() {
            let model_m = model.range_m(row.phase_time_ns)? + drift_m(at, &row.bumps);
            let off_m = row.phase_m - model_m;
            // The multiple of half a wavelength that brings it closest to the previous one.
            let carried = before.map(|(before_ns, before_m)| {
                let near_m = off_m + ((before_m - off_m) / half_m).round() * half_m;
                let pause_s = seconds(row.phase_time_ns - before_ns);
                (near_m, pause_s <= CARRY_S && (near_m - before_m).abs() <= CARRY_SHARE * half_m)
            });
            let (near_m, goes_on) = carried.unwrap_or((off_m, false));
            if !goes_on {
                all.push(Vec::new());
            }
            if let Some(piece) = all.last_mut() {
                piece.push(Carried { row: n, range_m: model_m + near_m, bumps: row.bumps.clone() });
            }
            before = Some((row.phase_time_ns, near_m));
        }
        all.retain(|piece| piece.len() >= MIN_CARRIED);
        for piece in &mut all {
            for k in 0..self.rows[0].bumps.len() {
                let mean = piece.iter().map(|c| c.bumps[k]).sum::<f64>() / piece.len() as f64;
                piece.iter_mut().for_each(|c| c.bumps[k] -= mean);
            }
        }
        Some(all)
    }

    /// The data of a fit with `size` unknowns.
    fn data<'d>(&self, weights: &'d [f64], carried: &'d [Vec<Carried>], size: usize) -> Data<'d> {
        let mut constant = NormalEquations::new(size);
        if size > HEAD {
            for (row, weight) in self.rows.iter().zip(weights) {
                constant.add_rest(&row.bumps, weight / row.variance_m2);
            }
            for carried in carried.iter().flatten() {
                constant.add_rest(&carried.bumps, PHASE_ERROR_M.powi(-2));
            }
        }
        Data { weights, carried, constant }
    }

    /// Levenberg–Marquardt, until a step reduces the cost by less than the given share.
    fn descend(&self, start: Unknowns, data: &Data, least_gain: f64) -> Option<(Unknowns, f64)> {
        let mut at = start;
        let mut equations = self.equations(&at, data)?;
        let mut damping = 1e-4;
        for _ in 0..MAX_STEPS {
            let Some(step) = equations.step(damping) else { break };
            let next = self.moved(&at, &step);
            match self.equations(&next, data).filter(|e| e.cost <= equations.cost) {
                Some(better) => {
                    let gained = equations.cost - better.cost;
                    (at, equations) = (next, better);
                    damping = (damping * 0.1).max(1e-9);
                    if gained <= least_gain * equations.cost.max(1e-3) {
                        break;
                    }
                }
                None if damping > 1e4 => break,
                None => damping *= 10.0,
            }
        }
        Some((at, equations.cost))
    }

    fn moved(&self, at: &Unknowns, step: &[f64]) -> Unknowns {
        let mut next = Unknowns { source: at.source.moved(step), ..at.clone() };
        if let Some(offset_step) = step.get(OFFSET) {
            next.offset_s = (at.offset_s + offset_step).clamp(self.middle_s - REACH_S, self.middle_s + REACH_S);
        }
        next.drift_m.iter_mut().zip(step.iter().skip(HEAD)).for_each(|(value, step)| *value += step);
        next
    }

    /// Measured minus modelled ranges from phase, minus the mean of their segment, which removes
    /// the unknown constant.
    fn phase_residuals<'c>(&self, piece: &'c [Carried], at: &Unknowns) -> Option<Vec<PhaseResidual<'c>>> {
        let mut all = Vec::with_capacity(piece.len());
        let model = Model::new(self.path, at);
        for Carried { row, range_m, bumps } in piece {
            let time_ns = self.rows[*row].phase_time_ns;
            let (modelled_m, head) = model.range_and_derivatives(time_ns)?;
            all.push(PhaseResidual { time_ns, residual_m: range_m - modelled_m, head, bumps });
        }
        let count = all.len() as f64;
        let mean_m = all.iter().map(|a| a.residual_m).sum::<f64>() / count;
        let means: [f64; HEAD] = std::array::from_fn(|k| all.iter().map(|a| a.head[k]).sum::<f64>() / count);
        for PhaseResidual { residual_m, head, bumps, .. } in &mut all {
            *residual_m -= mean_m + drift_m(at, bumps);
            head.iter_mut().zip(&means).for_each(|(d, mean)| *d -= mean);
        }
        Some(all)
    }

    fn equations(&self, at: &Unknowns, data: &Data) -> Option<NormalEquations> {
        let mut equations = data.constant.clone();
        let model = Model::new(self.path, at);
        for (row, weight) in self.rows.iter().zip(data.weights).filter(|(_, weight)| **weight > 0.0) {
            let (range_m, head) = model.range_and_derivatives(row.time_ns)?;
            let bumps = &row.bumps[..at.drift_m.len()];
            equations.add(&head, bumps, row.range_m - range_m - drift_m(at, bumps), weight / row.variance_m2);
        }
        for piece in data.carried {
            for phase in self.phase_residuals(piece, at)? {
                equations.add(&phase.head, phase.bumps, phase.residual_m, PHASE_ERROR_M.powi(-2));
            }
        }
        let (a, b) = at.source.direction.any_orthonormal_pair();
        for (unknown, axis) in [(1, a), (2, b)] {
            equations.expect(unknown, self.forward.dot(axis), DIRECTION_PRIOR_RAD.powi(-2));
        }
        equations.expect(OFFSET, self.middle_s - at.offset_s, OFFSET_PRIOR_S.powi(-2));
        for (n, drift_m) in at.drift_m.iter().enumerate() {
            equations.expect(HEAD + n, -drift_m, 1.0 / self.bump_variance_m2);
        }
        Some(equations)
    }

    /// Residuals of all rows, in standard deviations of their noise.
    fn residuals(&self, at: &Unknowns) -> Option<Vec<f64>> {
        let model = Model::new(self.path, at);
        let residual_m = |row: &Row| Some(row.range_m - model.range_m(row.time_ns)? - drift_m(at, &row.bumps));
        self.rows.iter().map(|row| Some(residual_m(row)? / row.variance_m2.sqrt())).collect()
    }

    /// Reduced weights for residuals beyond the spread.
    fn robust_weights(&self, at: &Unknowns) -> Option<Vec<f64>> {
        let residuals: Vec<f64> = self.residuals(at)?.into_iter().map(f64::abs).collect();
        let mut sorted = residuals.clone();
        sorted.sort_by(f64::total_cmp);
        let spread = (sorted[sorted.len() / 2] * 1.483).max(1.0);
        Some(residuals.iter().map(|r| (OUTLIER * spread / r.max(1e-9)).min(1.0)).collect())
    }

    /// The offset with its variance: from noise and drift, increased by the misfit or by the
    /// correlation of neighbouring residuals, whichever is greater.
    fn assess(&self, at: &Unknowns, data: &Data, last_ns: i64) -> Option<(TrackFit, f64)> {
        let inverse = self.equations(at, data)?.inverse_row(OFFSET)?;
        // For every range and phase: its time, and by how much its residual shifts the offset.
        let mut pulls: Vec<(i64, f64)> = Vec::new();
        let influence = |head: &[f64; HEAD], bumps: &[f64]| -> f64 {
            inverse.iter().zip(head.iter().chain(bumps)).map(|(c, d)| c * d).sum()
        };
        let (mut by_range, mut by_phase) = (0.0, 0.0);
        let model = Model::new(self.path, at);
        for (row, weight) in self.rows.iter().zip(data.weights) {
            let (range_m, head) = model.range_and_derivatives(row.time_ns)?;
            let residual_m = row.range_m - range_m - drift_m(at, &row.bumps);
            by_range += weight * residual_m * residual_m / row.variance_m2;
            pulls.push((row.time_ns, influence(&head, &row.bumps) * residual_m * weight / row.variance_m2));
        }
        for PhaseResidual { time_ns, residual_m, head, bumps } in
            data.carried.iter().filter_map(|p| self.phase_residuals(p, at)).flatten()
        {
            by_phase += residual_m * residual_m / PHASE_ERROR_M.powi(2);
            pulls.push((time_ns, influence(&head, bumps) * residual_m / PHASE_ERROR_M.powi(2)));
        }
        let count = self.rows.len() as f64;
        let misfit = (by_range / (count - 4.0)).max(1.0);
        let all_misfit = ((by_range + by_phase) / (pulls.len() as f64 - 4.0)).max(1.0);
        let in_phase = pulls.len() as f64 - count;
        let noise_m2 = self.rows.iter().map(|r| r.variance_m2).sum::<f64>() / count;
        let variance_s2 = (inverse[OFFSET] * all_misfit).max(self.correlated_variance_s2(&pulls));
        // Apparent speed variance that jitter of the path alone explains carries no information on
        // the offset.
        let told: f64 = self.rows.iter().zip(data.weights).map(|(r, w)| w / r.variance_m2).sum::<f64>()
            + in_phase * PHASE_ERROR_M.powi(-2);
        let false_share = SPEED_ERROR_M_PER_S.powi(2) * inverse[OFFSET] * told;
        let fit = TrackFit {
            offset_s: at.offset_s,
            variance_s2: variance_s2 / (1.0 - false_share).max(1e-6),
            excess_m: (noise_m2 * (misfit - 1.0)).sqrt(),
            carried_share: in_phase / count,
            phase_rms_m: PHASE_ERROR_M * (by_phase / in_phase.max(1.0)).sqrt(),
            last_ns,
        };
        Some((fit, all_misfit))
    }

    /// Variance of the offset from the shift due to each residual, summed within [`CORRELATION_BIN_S`] before
    /// squaring.
    fn correlated_variance_s2(&self, pulls: &[(i64, f64)]) -> f64 {
        let mut together: BTreeMap<i64, f64> = BTreeMap::new();
        for (time_ns, pull) in pulls {
            let bin = (time_ns - self.rows[0].time_ns).div_euclid(nanoseconds(CORRELATION_BIN_S));
            *together.entry(bin).or_default() += pull;
        }
        together.values().map(|pull| pull * pull).sum()
    }
}

/// Range model for given unknowns, without the slow error.
struct Model<'a> {
    path: &'a SensorPath,
    source: Source,
    /// Two transverse directions.
    across: (DVec3, DVec3),
    offset_ns: i64,
}

impl<'a> Model<'a> {
    fn new(path: &'a SensorPath, at: &Unknowns) -> Self {
        let across = at.source.direction.any_orthonormal_pair();
        Self { path, source: at.source, across, offset_ns: nanoseconds(at.offset_s) }
    }

    /// The modelled range of an echo of that time.
    fn range_m(&self, time_ns: i64) -> Option<f64> {
        Some(self.source.seen_from(self.path.at(time_ns.saturating_add(self.offset_ns))?.0).0)
    }

    /// The same, with derivatives with respect to the reflector's range and direction and to the
    /// offset.
    fn range_and_derivatives(&self, time_ns: i64) -> Option<(f64, [f64; HEAD])> {
        let (place, velocity) = self.path.at(time_ns.saturating_add(self.offset_ns))?;
        let (range_m, towards) = self.source.seen_from(place);
        let [by_range, by_a, by_b] = self.source.derivatives(self.across, place, towards);
        Some((range_m, [by_range, by_a, by_b, -towards.dot(velocity)]))
    }
}

/// The slow error for given values of the basis functions.
fn drift_m(at: &Unknowns, bumps: &[f64]) -> f64 {
    at.drift_m.iter().zip(bumps).map(|(a, b)| a * b).sum()
}

/// Gaussian basis functions over time, whose random sum has the drift's variance and correlation.
struct GaussianBasis {
    first_ns: i64,
    spacing_s: f64,
    width_s: f64,
    count: usize,
    variance_m2: f64,
}

impl GaussianBasis {
    fn over(first_ns: i64, last_ns: i64, errors: &PositionErrors) -> Self {
        let span_s = seconds(last_ns - first_ns);
        // Drift faster than a seventh of the track acts like noise.
        let width_s = (WANDER_WIDTH * errors.wander_s).max(span_s / 7.0);
        let spacing_s = width_s / 2.0;
        let count = (((span_s + 2.0 * width_s) / spacing_s).ceil() as usize + 1).min(MAX_KNOTS);
        // Σ exp(−4u²/T²) over the basis functions is T√π/2 divided by their spacing.
        let variance_m2 = errors.wander_m.powi(2) * 2.0 * spacing_s / (width_s * std::f64::consts::PI.sqrt());
        let count = if variance_m2 > 0.0 { count } else { 0 };
        Self { first_ns: first_ns.saturating_sub(nanoseconds(width_s)), spacing_s, width_s, count, variance_m2 }
    }

    fn at(&self, time_ns: i64) -> Vec<f64> {
        let time_s = seconds(time_ns.saturating_sub(self.first_ns));
        let bump = |n: usize| {
            let off = (time_s - n as f64 * self.spacing_s) / self.width_s;
            math::exp(-2.0 * off * off)
        };
        (0..self.count).map(bump).collect()
    }
}
