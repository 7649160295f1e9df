//! From a voxel to a place: the continuous maximum of Σ |z|²/σ², and how sure it is.
//!
//! Newton steps on the log-likelihood, whose curvature is Σ c u uᵀ (u: direction to the place, c: what pulse and SNR give
//! to one range). The covariance adds what the data cannot show: slow tracking wander, which moves many sweeps alike, and
//! the mount's error. Directions that the path did not observe are held by the beam alone: the place then stays near the
//! boresight and the covariance says so.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::range_power::{RangePower, Reading};
use super::symmetric::inverse_above;

/// How well the poses are known; what good lighthouse tracking shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionErrors {
    /// Slow drift in each axis, rms, metres.
    pub wander_m: f64,
    /// Time over which the drift stays alike, seconds.
    pub wander_s: f64,
    /// Error of the mount's offset, metres.
    pub mount_m: f64,
}

impl Default for PositionErrors {
    fn default() -> Self {
        Self { wander_m: 1e-3, wander_s: 1.0, mount_m: 2e-3 }
    }
}

/// A refined place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// Tracking frame, metres.
    pub position_m: DVec3,
    /// Covariance, m²: data, pose errors, and the beam as the last resort.
    pub covariance_m2: DMat3,
    /// Mean place of the sensor, metres.
    pub seen_from_m: DVec3,
    /// 1σ across the line of sight as the data alone give it, greater and lesser, metres; infinite when unobserved.
    pub cross_range_sigma_m: [f64; 2],
    /// Sweeps that counted.
    pub sweeps: usize,
    /// Rms of the sweeps' range residuals, weighed by power, in pulse widths: small when the thing stands still.
    pub residual_widths: f64,
}

/// A cross-range direction counts as observed when its 1σ is at most this share of the distance (3.4°).
const OBSERVED_SHARE: f64 = 0.06;

impl Refined {
    /// How many of the two cross-range directions were observed.
    pub fn observed_directions(&self) -> usize {
        let limit_m = OBSERVED_SHARE * self.position_m.distance(self.seen_from_m);
        self.cross_range_sigma_m.iter().filter(|sigma| **sigma <= limit_m).count()
    }
}

/// Half-width of the beam as a prior: tan 30°.
const PRIOR_TANGENT: f64 = 0.577;
/// Newton steps at most.
const MAX_STEPS: usize = 60;
/// Longest step, metres: less than half of the pulse.
const MAX_STEP_M: f64 = 0.05;
/// Fewer sweeps determine nothing.
const MIN_SWEEPS: usize = 3;

/// Climbs from `start` to the nearest maximum; stays within `reach_m` of it when given. `None` when too few sweeps see it.
pub fn refine(power: &RangePower, start: DVec3, reach_m: Option<f64>, errors: &PositionErrors) -> Option<Refined> {
    let readings = power.readings(start);
    if readings.len() < MIN_SWEEPS {
        return None;
    }
    let prior = Prior::from(power, &readings, start);
    let place = climb(power, start, reach_m, &prior);
    let refined = judged(power, place, &prior, errors)?;
    if reach_m.is_some() || refined.observed_directions() == 2 {
        return Some(refined);
    }
    let prior = prior.moved_to_range(place);
    let settled = settle(power, &prior, errors);
    judged(power, settled, &prior.moved_to_range(settled), errors)
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

/// The place when a direction is open: from the beam's middle at the measured range, Newton steps weighed by what the data
/// are worth with their pose errors against the beam. Noise alone cannot drag it along the open direction.
fn settle(power: &RangePower, prior: &Prior, errors: &PositionErrors) -> DVec3 {
    let mut place = prior.at;
    for _ in 0..MAX_STEPS {
        let readings = power.readings(place);
        if readings.len() < MIN_SWEEPS {
            return prior.at;
        }
        let (gradient, information) = slope_and_information(power, &readings, place);
        let worth = regular_inverse(&data_covariance(power, &readings, place, &information, errors));
        let pull = worth * (regular_inverse(&information) * gradient) - prior.information() * (place - prior.at);
        let step = ((worth + prior.information()).inverse() * pull).clamp_length_max(MAX_STEP_M) * 0.7;
        place += step;
        if step.length() < 1e-6 {
            break;
        }
    }
    place
}

/// What is known before any range: the direction lies somewhere in the beam.
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

    /// The same direction, at the distance of a place.
    fn moved_to_range(&self, place: DVec3) -> Self {
        let distance_m = place.distance(self.seen_from);
        Self { at: self.seen_from + self.forward * distance_m, ..*self }
    }

    /// Across the boresight alone.
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

/// Covariance as the data give it: noise, misfit, wander that moves many sweeps alike, the mount.
fn data_covariance(
    power: &RangePower,
    readings: &[Reading],
    place: DVec3,
    information: &DMat3,
    errors: &PositionErrors,
) -> DMat3 {
    let geometry = readings.iter().map(|r| outer(direction(power, r, place))).fold(DMat3::ZERO, |a, b| a + b)
        * (1.0 / readings.len() as f64);
    let independent = (span_s(power, readings) / errors.wander_s).max(1.0);
    let wander2 = errors.wander_m * errors.wander_m;
    let shift = DMat3::IDENTITY * (wander2 / independent + errors.mount_m * errors.mount_m);
    // Below 1e-4 rad of aperture nothing is known; the floor keeps the square below within double precision.
    let spread = inverse_above(&geometry, 1e-8);
    // An aperture no wider than the wander itself is none: the second term outweighs the first there.
    let distance_m = readings.iter().map(|r| r.distance_m).sum::<f64>() / readings.len() as f64;
    let false_aperture = (3.0 * wander2 / distance_m).powi(2);
    regular_inverse(information) * misfit(readings).max(1.0)
        + spread * (wander2 / independent)
        + spread * spread * false_aperture
        + shift
}

fn judged(power: &RangePower, place: DVec3, prior: &Prior, errors: &PositionErrors) -> Option<Refined> {
    let readings = power.readings(place);
    if readings.len() < MIN_SWEEPS {
        return None;
    }
    let (_, information) = slope_and_information(power, &readings, place);
    let data = data_covariance(power, &readings, place, &information, errors);
    let line_of_sight = (place - prior.seen_from).normalize_or(prior.forward);
    let mut refined = Refined {
        position_m: place,
        covariance_m2: regular_inverse(&(regular_inverse(&data) + prior.information())),
        seen_from_m: prior.seen_from,
        cross_range_sigma_m: cross_range_sigmas(&data, line_of_sight),
        sweeps: readings.len(),
        residual_widths: residual_widths(&readings),
    };
    if refined.observed_directions() == 1 {
        refined.covariance_m2 += along_the_circle(power, &readings, &refined);
    }
    Some(refined)
}

/// A path that is nearly a line leaves a circle around itself open. The tangent's variance is in the covariance already;
/// this adds how far the circle bends away from its tangent, towards the path.
fn along_the_circle(power: &RangePower, readings: &[Reading], refined: &Refined) -> DMat3 {
    let sensor = |r: &Reading| power.observations()[r.sweep].tracking_from_sensor.translation - refined.seen_from_m;
    let scatter = readings.iter().map(|r| outer(sensor(r))).fold(DMat3::ZERO, |a, b| a + b);
    // The path's axis: power iteration from the axis with the greatest scatter.
    let axes = [scatter.x_axis, scatter.y_axis, scatter.z_axis];
    let start = axes.into_iter().max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or(DVec3::X);
    let axis = (0..40).fold(start.normalize_or(DVec3::X), |v, _| (scatter * v).normalize_or(v));
    let radius = (refined.position_m - refined.seen_from_m).reject_from_normalized(axis);
    let tangent = axis.cross(radius).normalize_or_zero();
    let open2 = tangent.dot(refined.covariance_m2 * tangent);
    let bend_m = (open2 / (2.0 * radius.length().max(1e-3))).min(open2.sqrt());
    outer(radius.normalize_or_zero() * bend_m)
}

/// Mean square of each sweep's range residual against what noise allows; 1 when the model fits.
fn misfit(readings: &[Reading]) -> f64 {
    let strong = readings.iter().filter(|r| r.power > 6.0);
    let squares: Vec<f64> = strong.map(|r| r.slope_per_m * r.slope_per_m / r.curvature_per_m2).collect();
    if squares.len() > 3 { squares.iter().sum::<f64>() / (squares.len() - 3) as f64 } else { 1.0 }
}

/// Rms range residual in pulse widths, weighed by power. A Gaussian pulse gives a sweep's residual as slope / curvature.
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

fn span_s(power: &RangePower, readings: &[Reading]) -> f64 {
    let time = |r: &Reading| power.observations()[r.sweep].mid_time_ns;
    let (first, last) = (readings.iter().map(time).min(), readings.iter().map(time).max());
    first.zip(last).map_or(0.0, |(a, b)| (b - a) as f64 * 1e-9)
}

/// 1σ across a line of sight, greater first.
fn cross_range_sigmas(covariance: &DMat3, along: DVec3) -> [f64; 2] {
    let (a, b) = along.any_orthonormal_pair();
    let (aa, bb, ab) = (a.dot(*covariance * a), b.dot(*covariance * b), a.dot(*covariance * b));
    let (mean, spread) = ((aa + bb) * 0.5, ((aa - bb) * 0.5).hypot(ab));
    [(mean + spread).max(0.0).sqrt(), (mean - spread).max(0.0).sqrt()]
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

fn trace(m: &DMat3) -> f64 {
    m.x_axis.x + m.y_axis.y + m.z_axis.z
}

/// Inverse of a symmetric, possibly singular matrix: directions without information get a very large variance.
fn regular_inverse(m: &DMat3) -> DMat3 {
    inverse_above(m, (trace(m) * 1e-12).max(1e-12))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::test_data::{Echo, sweeps, winding};
    use crate::radar::Beam;

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
    fn a_still_sensor_knows_the_range_alone_and_says_so() {
        let refined = refined(|_| DVec3::ZERO);
        assert_eq!(refined.observed_directions(), 0);
        assert!((refined.position_m.length() - AT.length()).abs() < 5e-3, "{refined:?}");
        // Across the line of sight as wide as the beam; the truth lies within two sigmas of it.
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
}
