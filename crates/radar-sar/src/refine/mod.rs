//! Refines a voxel to a position: the continuous maximum of Σ |z|²/σ², corrected for pose errors,
//! with its covariance.
//!
//! 1. `climb`: damped Newton steps on the log-likelihood, each sweep independently. Finds the
//!    maximum without regard to pose errors.
//! 2. `least_squares`: around it each sweep is a measured range. Tracking drift affects neighbouring sweeps
//!    alike, and the mount's error rotates with the head. Generalised least squares, implemented as
//!    a filter along the path (`path_filter`), gives position and covariance together.
//! 3. `follow_phase`: where all directions are observed and the phase can be unwrapped from sweep
//!    to sweep, it measures changes of range a hundred times more finely than the pulse. Otherwise
//!    it is not used (`phase`).
//!
//! Directions that the path does not observe are constrained by the beam alone: the position then
//! stays near the boresight, and the covariance shows it. Sweeps from within a plane, as three
//! always are, leave two positions that mirror each other (`mirror`).

mod errors;
mod joint;
mod measurements;
mod mirror;
mod pair;
mod path_filter;
mod phase;
mod unwrapped;
mod wander;

use glam::{DMat3, DVec3};

pub use errors::PositionErrors;
use measurements::{Fit, Measured, measured};
pub use pair::{JointFit, best_pair, split};

use super::range_power::{RangePower, Reading};
use super::symmetric::{inverse_above, outer};

use crate::math;
#[cfg(test)]
pub(crate) use path_filter::{JITTER_S, PathFilter, Sight};
#[cfg(test)]
pub(crate) use wander::correlation;

/// A refined position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// Tracking frame, metres.
    pub position_m: DVec3,
    /// Covariance, m²: from data, pose errors, and finally the beam.
    pub covariance_m2: DMat3,
    /// Mean position of the sensor, metres.
    pub seen_from_m: DVec3,
    /// 1σ across the line of sight from the data alone, greater and lesser, metres; infinite when
    /// unobserved.
    pub cross_range_sigma_m: [f64; 2],
    /// Number of sweeps used.
    pub sweeps: usize,
    /// Slow drift of the poses in each axis that the ranges show, at least the assumed one, metres.
    pub wander_m: f64,
    /// Rms of the sweeps' range residuals, weighted by power, in pulse widths: small for a
    /// stationary object.
    pub residual_widths: f64,
}

/// A cross-range direction counts as observed when its 1σ is at most this share of the distance
/// (3.4°). Choice: 6 cm at 1 m, within which a warning's panel stands for the object.
const OBSERVED_SHARE: f64 = 0.06;

impl Refined {
    /// How many of the two cross-range directions were observed.
    pub fn observed_directions(&self) -> usize {
        let limit_m = OBSERVED_SHARE * self.position_m.distance(self.seen_from_m);
        self.cross_range_sigma_m.iter().filter(|sigma| **sigma <= limit_m).count()
    }
}

/// Half-width of the beam used as a prior, tan 30°. Choice: where the power of the bare sensor's
/// beam has halved.
const PRIOR_TANGENT: f64 = 0.577;
/// Greatest number of Newton steps. Choice: bounds the work; open directions, along which steps are
/// shortened, take the most.
const MAX_STEPS: usize = 60;
/// Longest step, metres. Choice: less than half of the pulse width, so that no step leaves the
/// maximum that it climbs.
const MAX_STEP_M: f64 = 0.05;
/// Least number of sweeps that determine a position. Physics: three ranges for three coordinates.
const MIN_SWEEPS: usize = 3;
/// 1σ, in distances, of a direction whose whole aperture pose errors could have caused. Choice:
/// effectively unknown, wider than the beam.
const SPURIOUS_APERTURE_SIGMA: f64 = 3.0;
/// Fraction of a step taken along an unobserved direction. Choice: curvature there is mostly noise,
/// and full steps oscillate.
const OPEN_STEP_SHARE: f64 = 0.7;
/// Greatest number of generalised least-squares steps. Choice: they converge like Newton's, in a
/// few; more means that there is no maximum.
const MAX_LEAST_SQUARES_STEPS: usize = 12;
/// A step shorter than this ends the iteration, metres. Choice: a hundredth of λ/2, below every
/// error in the model.
const CONVERGED_STEP_M: f64 = 2e-5;
/// Greatest number of phase-following rounds. Choice: each begins at the position of the one
/// before, and whole numbers seldom change more than once.
const PHASE_ROUNDS: usize = 4;
/// Greatest squared normalised distance by which the phase may move a position. Choice: chi-square
/// of 3 degrees of freedom exceeds it once in 10 000.
const MAX_PHASE_SHIFT_CHI2: f64 = 21.0;

/// Climbs from `start` to the nearest maximum and estimates position and covariance there. With
/// `reach_m` it stays within that distance of `start` and does not use the phase. `None` when too
/// few sweeps see it.
pub fn refine(power: &RangePower, start: DVec3, reach_m: Option<f64>, errors: &PositionErrors) -> Option<Refined> {
    let readings = power.readings(start);
    if readings.len() < MIN_SWEEPS {
        return None;
    }
    let prior = Prior::from(power, &readings, start);
    let top = climb(power, start, reach_m, &prior);
    let errors = &match reach_m {
        Some(_) => *errors,
        None => measurements::with_drift_of(&measured(power, &power.readings(top), top), errors),
    };
    let weighed = least_squares(
        power,
        top,
        reach_m.map_or(StepConstraint::None, |reach| StepConstraint::Reach(start, reach)),
        &prior,
        errors,
    )?;
    let refined = to_refined(power, &weighed, &prior, errors);
    if reach_m.is_some() {
        return Some(refined);
    }
    if refined.observed_directions() == 2 {
        if let Some(other) = mirror::equally_likely_image(power, &weighed, &prior) {
            return Some(mirror::with_image(refined, other));
        }
        return Some(follow_phase(power, &weighed, &prior, errors).unwrap_or(refined));
    }
    // With an unobserved direction, start from the beam's axis, so that noise cannot move the
    // position along that direction.
    let prior = prior.moved_to_range(weighed.place);
    let settled = least_squares(power, prior.at, StepConstraint::Open, &prior, errors)?;
    Some(to_refined(power, &settled, &prior.moved_to_range(settled.place), errors))
}

/// Damped Newton steps on the log-likelihood.
fn climb(power: &RangePower, start: DVec3, reach_m: Option<f64>, prior: &Prior) -> DVec3 {
    let mut place = start;
    let mut readings = power.readings(place);
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let (gradient, information) = slope_and_information(power, &readings, place);
        let gradient = gradient - prior.information() * (place - prior.at);
        let total = information + prior.information();
        let damped = total + DMat3::from_diagonal(DVec3::splat(damping * trace(&total) / 3.0 + 1e-9));
        let step = (damped.inverse() * gradient).clamp_length_max(MAX_STEP_M);
        let next = match reach_m {
            Some(reach) => start + (place + step - start).clamp_length_max(reach),
            None => place + step,
        };
        let next_readings = power.readings(next);
        let gained = objective(&next_readings, prior, next) - objective(&readings, prior, place);
        if next_readings.len() >= MIN_SWEEPS && gained >= 0.0 {
            let moved = next.distance(place);
            (place, readings) = (next, next_readings);
            damping = (damping * 0.2).max(1e-9);
            if moved < 1e-6 {
                break;
            }
        } else {
            damping = (damping * 5.0).max(1e-6);
            if damping > 1e6 {
                break;
            }
        }
    }
    place
}

/// A position with its measurements and covariance.
#[derive(Debug, Clone)]
struct PointEstimate {
    place: DVec3,
    readings: Vec<Reading>,
    /// Covariance from the data alone, m².
    data_m2: DMat3,
    /// With the beam's prior, m².
    covariance_m2: DMat3,
}

impl PointEstimate {
    fn new(place: DVec3, readings: Vec<Reading>, data_m2: DMat3, prior: &Prior) -> Self {
        let covariance_m2 = regular_inverse(&(regular_inverse(&data_m2) + prior.information()));
        Self { place, readings, data_m2, covariance_m2 }
    }
}

/// Constraint on the generalised least-squares steps.
#[derive(Debug, Clone, Copy)]
enum StepConstraint {
    /// Around a maximum that the data determine.
    None,
    /// Within a distance of a start, metres.
    Reach(DVec3, f64),
    /// Along an unobserved direction: smaller steps, because the range is curved along each of
    /// them, and more of them.
    Open,
}

/// Generalised least-squares steps until the position converges.
fn least_squares(
    power: &RangePower,
    from: DVec3,
    leash: StepConstraint,
    prior: &Prior,
    errors: &PositionErrors,
) -> Option<PointEstimate> {
    let (steps, share) = if matches!(leash, StepConstraint::Open) {
        (MAX_STEPS, OPEN_STEP_SHARE)
    } else {
        (MAX_LEAST_SQUARES_STEPS, 1.0)
    };
    let mut place = from;
    let mut readings = power.readings(place);
    for _ in 0..steps {
        if readings.len() < MIN_SWEEPS {
            break;
        }
        let fit = measurements::fit_ranges(&measured(power, &readings, place), errors);
        let data_m2 = data_covariance(power, &fit, &readings, place, errors);
        let wanted = place + fit.step(&data_m2, prior, place).clamp_length_max(MAX_STEP_M) * share;
        let next = match leash {
            StepConstraint::Reach(start, reach_m) => start + (wanted - start).clamp_length_max(reach_m),
            StepConstraint::None | StepConstraint::Open => wanted,
        };
        let moved_m = next.distance(place);
        place = next;
        readings = power.readings(place);
        if moved_m < CONVERGED_STEP_M {
            break;
        }
    }
    if readings.len() < MIN_SWEEPS {
        (place, readings) = (from, power.readings(from));
    }
    if readings.len() < MIN_SWEEPS {
        return None;
    }
    let fit = measurements::fit_ranges(&measured(power, &readings, place), errors);
    let data_m2 = data_covariance(power, &fit, &readings, place, errors);
    Some(PointEstimate::new(place, readings, data_m2, prior))
}

/// Position with the help of the phase; `None` where the phase cannot be unwrapped or contradicts
/// the ranges. Lengths are linearised at the ranges' position first, then at each improved one, as
/// long as rounds succeed.
fn follow_phase(power: &RangePower, ranged: &PointEstimate, prior: &Prior, errors: &PositionErrors) -> Option<Refined> {
    let mut best: Option<PointEstimate> = None;
    for _ in 0..PHASE_ROUNDS {
        let from = best.as_ref().unwrap_or(ranged);
        let Some(next) = phase_round(power, ranged, from, prior, errors).filter(|next| agrees(ranged, next)) else {
            break;
        };
        let moved_m = next.place.distance(from.place);
        best = Some(next);
        if moved_m < CONVERGED_STEP_M {
            break;
        }
    }
    best.map(|weighed| to_refined(power, &weighed, prior, errors))
}

/// One round: lengths linearised at a position, whole wavelength numbers from the ranges, then a
/// fit of ranges and phases together.
fn phase_round(
    power: &RangePower,
    ranged: &PointEstimate,
    from: &PointEstimate,
    prior: &Prior,
    errors: &PositionErrors,
) -> Option<PointEstimate> {
    let all: Vec<Measured> = measured(power, &from.readings, from.place);
    let unwrapped = phase::unwrap_phases(&all, ranged.place - from.place, &ranged.covariance_m2, errors)?;
    let fit = measurements::fit_ranges_and_phases(&all, &unwrapped, errors)?;
    let data_m2 = data_covariance(power, &fit, &from.readings, from.place, errors);
    let place = from.place + fit.step(&data_m2, prior, from.place);
    let readings = power.readings(place);
    (readings.len() >= MIN_SWEEPS).then(|| PointEstimate::new(place, readings, data_m2, prior))
}

/// Whether the phase's correction is consistent with the ranges.
fn agrees(ranged: &PointEstimate, phased: &PointEstimate) -> bool {
    let moved = phased.place - ranged.place;
    let allowed = ranged.covariance_m2 - phased.covariance_m2 + ranged.covariance_m2 * 0.05;
    moved.dot(regular_inverse(&allowed) * moved) <= MAX_PHASE_SHIFT_CHI2
}

/// Prior knowledge: the direction lies somewhere in the beam.
struct Prior {
    at: DVec3,
    seen_from: DVec3,
    forward: DVec3,
    sigma_m: f64,
}

impl Prior {
    fn from(power: &RangePower, readings: &[Reading], start: DVec3) -> Self {
        let count = readings.len() as f64;
        let sensors = readings.iter().map(|r| &power.observations()[r.sweep].tracking_from_sensor);
        let seen_from = sensors.clone().map(|p| p.translation).sum::<DVec3>() / count;
        let forward = sensors.map(|p| p.forward()).sum::<DVec3>().normalize_or(DVec3::NEG_Z);
        let distance_m = start.distance(seen_from);
        Self { at: seen_from + forward * distance_m, seen_from, forward, sigma_m: PRIOR_TANGENT * distance_m.max(0.05) }
    }

    /// The same direction, at a point's distance.
    fn moved_to_range(&self, place: DVec3) -> Self {
        let distance_m = place.distance(self.seen_from);
        Self { at: self.seen_from + self.forward * distance_m, ..*self }
    }

    /// Only across the boresight.
    fn information(&self) -> DMat3 {
        (DMat3::IDENTITY - outer(self.forward)) * (1.0 / (self.sigma_m * self.sigma_m))
    }
}

fn objective(readings: &[Reading], prior: &Prior, place: DVec3) -> f64 {
    let off = place - prior.at;
    readings.iter().map(|r| r.power - 1.0).sum::<f64>() - 0.5 * off.dot(prior.information() * off)
}

fn direction(power: &RangePower, reading: &Reading, place: DVec3) -> DVec3 {
    let sensor = power.observations()[reading.sweep].tracking_from_sensor.translation;
    (place - sensor).normalize_or_zero()
}

fn slope_and_information(power: &RangePower, readings: &[Reading], place: DVec3) -> (DVec3, DMat3) {
    readings.iter().fold((DVec3::ZERO, DMat3::ZERO), |(gradient, information), reading| {
        let u = direction(power, reading, place);
        (gradient + u * reading.slope_per_m, information + outer(u) * reading.curvature_per_m2)
    })
}

/// Covariance from the data: the filter's, plus the contribution of an aperture that pose errors
/// alone could have caused. Such an aperture carries no information, whatever the poses say.
fn data_covariance(
    power: &RangePower,
    fit: &Fit,
    readings: &[Reading],
    place: DVec3,
    errors: &PositionErrors,
) -> DMat3 {
    let count = readings.len() as f64;
    let geometry = readings.iter().map(|r| outer(direction(power, r, place))).fold(DMat3::ZERO, |a, b| a + b) / count;
    let distance_m = readings.iter().map(|r| r.distance_m).sum::<f64>() / count;
    // Share of each direction's aperture that errors of two sigma make up. It matters only where it
    // is large, hence the fourth power.
    let errors_m2 = errors.slow_variance_m2() + errors.jitter_m.powi(2);
    let share = (4.0 * errors_m2 / (distance_m * distance_m)).max(1e-12);
    let feigned = inverse_above(&geometry, share) * share;
    let steep = symmetric(&(feigned * feigned));
    fit.covariance_m2() + symmetric(&(steep * steep)) * (SPURIOUS_APERTURE_SIGMA * distance_m).powi(2)
}

fn to_refined(power: &RangePower, weighed: &PointEstimate, prior: &Prior, errors: &PositionErrors) -> Refined {
    let line_of_sight = (weighed.place - prior.seen_from).normalize_or(prior.forward);
    let mut refined = Refined {
        position_m: weighed.place,
        covariance_m2: weighed.covariance_m2,
        seen_from_m: prior.seen_from,
        cross_range_sigma_m: cross_range_sigmas(&weighed.data_m2, line_of_sight),
        sweeps: weighed.readings.len(),
        wander_m: errors.wander_m,
        residual_widths: residual_widths(&weighed.readings),
    };
    if refined.observed_directions() == 1 {
        refined.covariance_m2 += circle_sagitta(power, &weighed.readings, &refined);
    }
    refined
}

/// A nearly straight path leaves a circle around itself unobserved. The covariance already contains
/// the variance along the tangent. This adds the deviation of the circle from its tangent, towards
/// the path.
fn circle_sagitta(power: &RangePower, readings: &[Reading], refined: &Refined) -> DMat3 {
    let axis = longest_axis(&scatter(power, readings, refined.seen_from_m));
    let radius = (refined.position_m - refined.seen_from_m).reject_from_normalized(axis);
    let tangent = axis.cross(radius).normalize_or_zero();
    let open2 = tangent.dot(refined.covariance_m2 * tangent);
    let bend_m = (open2 / (2.0 * radius.length().max(1e-3))).min(open2.sqrt());
    outer(radius.normalize_or_zero() * bend_m)
}

/// Second moments of the sensor positions about `middle`, m².
fn scatter(power: &RangePower, readings: &[Reading], middle: DVec3) -> DMat3 {
    let sensor = |r: &Reading| power.observations()[r.sweep].tracking_from_sensor.translation - middle;
    readings.iter().map(|r| outer(sensor(r))).fold(DMat3::ZERO, |a, b| a + b)
}

/// The axis of the greatest scatter, by power iteration from the longest column.
fn longest_axis(scatter: &DMat3) -> DVec3 {
    let axes = [scatter.x_axis, scatter.y_axis, scatter.z_axis];
    let start = axes.into_iter().max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or(DVec3::X);
    (0..40).fold(start.normalize_or(DVec3::X), |v, _| (*scatter * v).normalize_or(v))
}

/// Rms range residual in pulse widths, weighted by power. For a Gaussian pulse, a sweep's residual
/// is slope / curvature.
fn residual_widths(readings: &[Reading]) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for reading in readings.iter().filter(|r| r.curvature_per_m2 > 0.0) {
        // Curvature is 8 ln2 · power / width², so this is (residual / width)² · power.
        let residual_m = reading.slope_per_m / reading.curvature_per_m2;
        sum += residual_m * residual_m * reading.curvature_per_m2 / (8.0 * std::f64::consts::LN_2);
        weight += reading.power;
    }
    if weight > 0.0 { (sum / weight).sqrt() } else { f64::INFINITY }
}

/// 1σ across a line of sight, greater first.
fn cross_range_sigmas(covariance: &DMat3, along: DVec3) -> [f64; 2] {
    let (a, b) = along.any_orthonormal_pair();
    let (aa, bb, ab) = (a.dot(*covariance * a), b.dot(*covariance * b), a.dot(*covariance * b));
    let (mean, spread) = ((aa + bb) * 0.5, math::hypot((aa - bb) * 0.5, ab));
    [(mean + spread).max(0.0).sqrt(), (mean - spread).max(0.0).sqrt()]
}

fn trace(m: &DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

/// Inverse of a symmetric, possibly singular matrix: directions without information get a very
/// large variance.
fn regular_inverse(m: &DMat3) -> DMat3 {
    let floor = (trace(m) * 1e-12).max(1e-12);
    inverse_above(m, floor)
}

fn symmetric(m: &DMat3) -> DMat3 {
    (*m + m.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Beam;
    use crate::test_data::{Echo, conjugated, sweeps, winding};

    const AT: DVec3 = DVec3::new(0.2, 0.1, -1.2);

    fn refined(path: impl Fn(f64) -> DVec3) -> Refined {
        let all = sweeps(3.0, path, &[(Echo::Point(AT), 10.0)], 1);
        let some: Vec<_> = all.into_iter().step_by(30).collect();
        let power = RangePower::new(&some, &Beam::Lensless, 0.15);
        refine(&power, AT + DVec3::new(0.03, -0.02, 0.02), None, &PositionErrors::default()).unwrap()
    }

    #[test]
    fn a_wide_path_gives_the_place_to_millimetres() {
        let refined = refined(|t| winding(t) * 3.0);
        assert_eq!(refined.observed_directions(), 2);
        assert!(refined.position_m.distance(AT) < 6e-3, "{refined:?}");
    }

    #[test]
    fn stationary_sensor_gives_range_only_and_a_wide_covariance() {
        let refined = refined(|_| DVec3::ZERO);
        assert_eq!(refined.observed_directions(), 0);
        assert!((refined.position_m.length() - AT.length()).abs() < 5e-3, "{refined:?}");
        // Across the line of sight the covariance is as wide as the beam; the truth lies within two
        // sigma.
        let sight = refined.position_m.normalize();
        let across = (AT - refined.position_m).reject_from_normalized(sight);
        let along = across.normalize();
        assert!(across.length() < 2.0 * along.dot(refined.covariance_m2 * along).sqrt());
        assert!(sight.dot(refined.covariance_m2 * sight).sqrt() < 0.02);
        assert!(refined.covariance_m2.x_axis.x.sqrt() > 0.2);
    }

    #[test]
    fn too_few_sweeps_determine_nothing() {
        let two = sweeps(0.002, winding, &[(Echo::Point(AT), 10.0)], 1);
        let power = RangePower::new(&two, &Beam::Lensless, 0.15);
        assert_eq!(refine(&power, AT, None, &PositionErrors::default()), None);
    }

    /// A 6 cm path with poses that drift by a millimetre; every tenth of a thousand sweeps a
    /// second.
    fn with_wrong_poses(seed: u64) -> Vec<crate::Observation> {
        with_drift(seed, 0.4, 1e-3)
    }

    fn with_drift(seed: u64, path_scale: f64, drift_m: f64) -> Vec<crate::Observation> {
        let path = |t: f64| winding(t * 2.0) * path_scale;
        let mut all = sweeps(6.0, path, &[(Echo::Point(AT), 10.0)], seed);
        for observation in &mut all {
            let t = (observation.mid_time_ns - 1_000_000_000) as f64 * 1e-9 + seed as f64;
            let wander =
                DVec3::new((1.3 * t).sin(), (0.9 * t + 2.0).sin(), (2.1 * t + 1.0).sin()) * 2f64.sqrt() * drift_m;
            observation.tracking_from_sensor.translation += wander;
        }
        all.into_iter().step_by(10).collect()
    }

    #[test]
    fn phase_improves_the_position_and_covariances_are_consistent() {
        let errors = PositionErrors { mount_m: 0.0, ..Default::default() };
        let (mut by_ranges, mut by_phase, mut normalised) = (0.0, 0.0, 0.0);
        for seed in 0..8 {
            let some = with_wrong_poses(seed);
            let power = RangePower::new(&some, &Beam::Lensless, 0.15);
            let start = AT + DVec3::new(0.02, -0.02, 0.01);
            let phased = refine(&power, start, None, &errors).unwrap();
            let ranged = refine(&power, start, Some(0.3), &errors).unwrap();
            by_phase += phased.position_m.distance_squared(AT) / 8.0;
            by_ranges += ranged.position_m.distance_squared(AT) / 8.0;
            for refined in [phased, ranged] {
                let off = refined.position_m - AT;
                normalised += off.dot(refined.covariance_m2.inverse() * off) / 16.0;
            }
        }
        assert!(by_phase < 0.25 * by_ranges, "{by_phase} {by_ranges}");
        // Mean of sixteen values: 3 ± 0.6. This test's drift is not the filter's process.
        assert!((1.0..5.0).contains(&normalised), "{normalised}");
    }

    #[test]
    fn drift_that_nobody_knew_of_is_estimated_and_goes_into_the_covariance() {
        let errors = PositionErrors { mount_m: 0.0, ..Default::default() };
        for (drift_m, expected_m) in [(1e-3, 1e-3..1.6e-3), (4e-3, 2.5e-3..7e-3)] {
            let mut normalised = 0.0;
            for seed in 0..8 {
                let some = with_drift(seed, 1.5, drift_m);
                let power = RangePower::new(&some, &Beam::Lensless, 0.15);
                let refined = refine(&power, AT + DVec3::new(0.02, -0.02, 0.01), None, &errors).unwrap();
                assert!(expected_m.contains(&refined.wander_m), "{drift_m}: {}", refined.wander_m);
                let off = refined.position_m - AT;
                normalised += off.dot(refined.covariance_m2.inverse() * off) / 8.0;
            }
            // Mean of eight values: 3 ± 0.9. This test's drift is not the filter's process.
            assert!((0.7..6.0).contains(&normalised), "{drift_m}: {normalised}");
        }
    }

    #[test]
    fn single_wrong_ranges_are_no_drift() {
        let errors = PositionErrors { mount_m: 0.0, ..Default::default() };
        let mut some = with_drift(3, 1.5, 1e-3);
        // One of twenty sweeps, as by interference or another echo.
        some.iter_mut().step_by(20).for_each(|sweep| sweep.tracking_from_sensor.translation += DVec3::Z * 0.05);
        let power = RangePower::new(&some, &Beam::Lensless, 0.15);
        let refined = refine(&power, AT, None, &errors).unwrap();
        assert!((1e-3..1.6e-3).contains(&refined.wander_m), "{}", refined.wander_m);
    }

    #[test]
    fn conjugated_phase_is_ignored() {
        for seed in 0..4 {
            let turned = conjugated(with_wrong_poses(seed));
            let power = RangePower::new(&turned, &Beam::Lensless, 0.15);
            let errors = PositionErrors { mount_m: 0.0, ..Default::default() };
            let refined = refine(&power, AT, None, &errors).unwrap();
            let ranged = refine(&power, AT, Some(0.3), &errors).unwrap();
            assert!(refined.position_m.distance(ranged.position_m) < 1e-4, "{refined:?} {ranged:?}");
        }
    }

    #[test]
    fn outlier_sweeps_do_not_move_the_position() {
        let mut some: Vec<_> =
            sweeps(3.0, |t| winding(t) * 3.0, &[(Echo::Point(AT), 10.0)], 1).into_iter().step_by(30).collect();
        let at = |some: &[crate::Observation]| {
            let power = RangePower::new(some, &Beam::Lensless, 0.15);
            refine(&power, AT, Some(0.1), &PositionErrors::default()).unwrap().position_m
        };
        let before = at(&some);
        for n in [10, 40, 70] {
            some[n].tracking_from_sensor.translation.z += 0.04;
        }
        assert!(at(&some).distance(before) < 2e-3, "{} {before}", at(&some));
    }
}
