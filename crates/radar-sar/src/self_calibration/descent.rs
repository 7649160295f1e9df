//! The reflector that explains the ranges of a track best, by Levenberg–Marquardt. The slow error is linear, so each reflector
//! takes the slow error that fits it best (variable projection; Golub and Pereyra 1973, SIAM J. Numer. Anal. 10:413), and
//! the search is over the reflector's three unknowns alone.

use super::normal_equations::{Factor, NormalEquations};
use super::reflector::{REFLECTOR, Reflector};
use super::track_fit::{DIRECTION_PRIOR_RAD, Explanation, Problem, Segment, phase_weight};

/// Steps of a descent. Choice: it converges in some five; more means that nothing fits.
const MAX_STEPS: usize = 25;
/// Damping at first, at least, and from where on a step that does not help ends the descent. Choice: nearly undamped where the
/// model is linear.
const FIRST_DAMPING: f64 = 1e-4;
const MIN_DAMPING: f64 = 1e-9;
const LAST_DAMPING: f64 = 1e4;
/// Index of the residual in a row of derivatives.
const RESIDUAL: usize = REFLECTOR;

/// Derivatives of a range with respect to the reflector's unknowns, and what is measured beyond the reflector's range.
type Row = [f64; REFLECTOR + 1];

/// Ranges with their weights, and ranges from phase, that a reflector is searched for.
pub(super) struct Descent<'a> {
    problem: &'a Problem<'a>,
    weights: &'a [f64],
    segments: &'a [Segment],
    /// Of the slow error's own normal equations, which are the same for every reflector; of no unknowns without slow error.
    slow_error: Factor,
}

/// A reflector with the slow error that fits it best.
struct Evaluated {
    reflector: Reflector,
    /// Normal equations of the reflector, with the slow error eliminated.
    normal: NormalEquations,
    /// The slow error's right side after forward substitution.
    forward: Vec<f64>,
}

impl<'a> Descent<'a> {
    /// Without slow error.
    pub fn of_reflector(problem: &'a Problem, weights: &'a [f64]) -> Option<Self> {
        Self::new(problem, weights, &[], NormalEquations::new(0))
    }

    /// With slow error; `weights`: of the ranges.
    pub fn of_all(problem: &'a Problem, weights: &'a [f64], segments: &'a [Segment]) -> Option<Self> {
        let mut slow_error = problem.slow_error_equations(0, weights, segments);
        (0..problem.track.basis.len()).for_each(|n| slow_error.expect(n, 0.0, problem.slow_error_weight(n)));
        Self::new(problem, weights, segments, slow_error)
    }

    fn new(
        problem: &'a Problem,
        weights: &'a [f64],
        segments: &'a [Segment],
        slow_error: NormalEquations,
    ) -> Option<Self> {
        Some(Self { problem, weights, segments, slow_error: slow_error.factor(0.0)? })
    }

    /// The best explanation near a reflector, and its cost; ends when a step reduces the cost by less than the given share.
    pub fn from(&self, start: Reflector, least_gain: f64) -> Option<(Explanation, f64)> {
        let mut at = self.evaluate(start);
        let mut damping = FIRST_DAMPING;
        for _ in 0..MAX_STEPS {
            let Some(factor) = at.normal.factor(damping) else { break };
            let step = factor.solve(&at.normal.right);
            let next = self.evaluate(at.reflector.moved(&step));
            let is_small = |gain: f64| gain <= least_gain * at.normal.cost.min(next.normal.cost).max(1e-3);
            let gained = at.normal.cost - next.normal.cost;
            if gained >= 0.0 {
                let is_done = is_small(gained);
                at = next;
                damping = (damping * 0.1).max(MIN_DAMPING);
                if is_done {
                    break;
                }
            } else if damping > LAST_DAMPING || is_small(promised(&step, &at.normal.right)) {
                break;
            } else {
                damping *= 10.0;
            }
        }
        let slow_error = self.slow_error.backward(at.forward);
        Some((Explanation { reflector: at.reflector, slow_error }, at.normal.cost)).filter(|(_, cost)| cost.is_finite())
    }

    fn evaluate(&self, reflector: Reflector) -> Evaluated {
        let mut sums =
            Sums { own: [[0.0; REFLECTOR + 1]; REFLECTOR + 1], cross: vec![Row::default(); self.slow_error.size()] };
        let turns = reflector.turns();
        let row_of = |range_m: f64, position_m| {
            let (modelled_m, [range, first, second]) = reflector.range_and_derivatives(turns, position_m);
            [range, first, second, range_m - modelled_m]
        };
        let problem = self.problem;
        for (n, weight) in self.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            let measured = &problem.rows()[n];
            let row = row_of(measured.range_m - problem.bias_m, problem.at_range[n].position_m);
            sums.add(&row, problem.values(n), weight / measured.variance_m2);
        }
        let mut rows: Vec<Row> = Vec::new();
        for segment in self.segments {
            let of = |(range_m, n): (&f64, usize)| row_of(*range_m, problem.at_phase[n].position_m);
            rows.clear();
            rows.extend(segment.ranges_m.iter().zip(segment.rows.clone()).map(of));
            let sum = rows.iter().fold(Row::default(), |sum, row| std::array::from_fn(|k| sum[k] + row[k]));
            let mean = sum.map(|sum| sum / rows.len() as f64);
            for (row, values) in rows.iter().zip(segment.values.chunks_exact(problem.track.basis.len())) {
                sums.add(&std::array::from_fn(|k| row[k] - mean[k]), values, phase_weight());
            }
        }
        let expected = reflector.expected_turns(problem.track.forward);
        for (turn, off) in expected.into_iter().enumerate() {
            let mut row = Row::default();
            (row[1 + turn], row[RESIDUAL]) = (1.0, off);
            sums.add(&row, &[], 1.0 / (DIRECTION_PRIOR_RAD * DIRECTION_PRIOR_RAD));
        }
        self.eliminated(reflector, sums)
    }

    /// The slow error eliminated (Schur complement).
    fn eliminated(&self, reflector: Reflector, sums: Sums) -> Evaluated {
        let Sums { mut own, mut cross } = sums;
        self.slow_error.forward(&mut cross);
        for column in &cross {
            for (row, a) in own.iter_mut().zip(column) {
                row.iter_mut().zip(column).for_each(|(sum, b)| *sum -= a * b);
            }
        }
        let mut normal = NormalEquations::new(REFLECTOR);
        for (i, row) in own[..REFLECTOR].iter().enumerate() {
            row[..=i].iter().enumerate().for_each(|(j, value)| normal.add_entry(i, j, *value));
            normal.right[i] = row[RESIDUAL];
        }
        normal.cost = own[RESIDUAL][RESIDUAL];
        Evaluated { reflector, normal, forward: cross.iter().map(|row| row[RESIDUAL]).collect() }
    }
}

/// By how much a step reduces the cost if the model is linear, at most.
fn promised(step: &[f64], right: &[f64]) -> f64 {
    2.0 * step.iter().zip(right).map(|(step, right)| step * right).sum::<f64>()
}

/// Weighted products of the rows' columns with each other, and with the slow error's basis functions.
struct Sums {
    own: [Row; REFLECTOR + 1],
    cross: Vec<Row>,
}

impl Sums {
    fn add(&mut self, row: &Row, slow_error: &[f64], weight: f64) {
        let weighted = row.map(|value| weight * value);
        for (sums, a) in self.own.iter_mut().zip(weighted) {
            sums.iter_mut().zip(row).for_each(|(sum, b)| *sum += a * b);
        }
        for (sums, value) in self.cross.iter_mut().zip(slow_error) {
            sums.iter_mut().zip(weighted).for_each(|(sum, a)| *sum += a * value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::self_calibration::corrections::Corrections;
    use crate::self_calibration::echoes::Echo;
    use crate::self_calibration::path::SensorPath;
    use crate::self_calibration::reflector::ReflectorKind;
    use crate::self_calibration::track_fit::{Fitted, TrackFit};
    use crate::test_data::winding;
    use crate::{PHASE_RAD_PER_M, PositionErrors};
    use glam::DVec3;

    const STEP_NS: i64 = 5_000_000;

    fn pose(time_ns: i64) -> Pose {
        Pose::from_translation(winding(time_ns as f64 * 1e-9))
    }

    fn path() -> SensorPath {
        let mut path = SensorPath::default();
        for n in 0..900 {
            let velocity = (pose(n * STEP_NS + 1000).translation - pose(n * STEP_NS - 1000).translation) / 2e-6;
            path.push(n * STEP_NS, &pose(n * STEP_NS), velocity);
        }
        path
    }

    /// Echoes of a point during 4 s, with a slow error and ranges that scatter by 5 mm.
    fn track(at: DVec3, slow_m: f64) -> TrackFit {
        let echo = |n: i64| {
            let time_ns = 100_000_000 + n * 8_000_000;
            let slow_m = slow_m * (time_ns as f64 * 2e-9).sin();
            let range_m = at.distance(pose(time_ns).translation) + slow_m;
            let scatter_m = 5e-3 * ((n * 7919 % 101) as f64 / 50.0 - 1.0);
            Echo {
                time_ns,
                range_m: range_m + scatter_m,
                variance_m2: 9e-6,
                phase_rad: range_m * PHASE_RAD_PER_M,
                phase_time_ns: time_ns,
                ln_amplitude: 0.0,
            }
        };
        let echoes: Vec<Echo> = (0..500).map(echo).collect();
        TrackFit::new(&echoes, DVec3::NEG_Z, &PositionErrors::default()).unwrap()
    }

    #[test]
    fn what_it_finds_solves_the_joint_equations_of_all_unknowns() {
        let (at, path) = (DVec3::new(0.3, -0.1, -1.4), path());
        let track = track(at, 3e-3);
        let problem = Problem::new(&track, &path, &Corrections::default(), 1.0).unwrap();
        let start = Reflector { kind: ReflectorKind::Point, direction: DVec3::NEG_Z, range_m: 1.3 };
        let Fitted { explanation, weights, segments, .. } = problem.fitted(start).unwrap();
        assert!(segments.iter().map(|segment| segment.rows.len()).sum::<usize>() > 450, "phases are unwrapped");
        // To convergence: the descents of a fit end earlier.
        let descent = Descent::of_all(&problem, &weights, &segments).unwrap();
        let (explanation, cost) = descent.from(explanation.reflector, 0.0).unwrap();
        let fit = Fitted { explanation, weights, segments, cost };
        let equations = problem.equations(&fit.explanation, &fit.weights, &fit.segments);
        let joint = problem.normal_equations_at(&fit, &equations);
        let step = joint.factor(0.0).unwrap().solve(&joint.right);
        assert!((joint.cost / cost - 1.0).abs() < 1e-9, "{} {cost}", joint.cost);
        assert!(promised(&step, &joint.right) < 1e-9 * cost, "{step:?}");
        assert!((fit.explanation.reflector.range_m - 1.4).abs() < 0.1);
    }

    #[test]
    fn without_slow_error_it_solves_for_the_reflector_alone() {
        let (at, path) = (DVec3::new(0.3, -0.1, -1.4), path());
        let track = track(at, 0.0);
        let problem = Problem::new(&track, &path, &Corrections::default(), 1.0).unwrap();
        let weights = vec![1.0; problem.rows().len()];
        let start = Reflector { kind: ReflectorKind::Point, direction: DVec3::NEG_Z, range_m: 1.3 };
        let (found, _) = Descent::of_reflector(&problem, &weights).unwrap().from(start, 1e-9).unwrap();
        let mean = (0..500).map(|n| pose(100_000_000 + n * 8_000_000).translation).sum::<DVec3>() / 500.0;
        let error_m = mean + found.reflector.direction * found.reflector.range_m - at;
        assert!(found.slow_error.is_empty() && error_m.length() < 5e-3, "{error_m}");
    }
}
