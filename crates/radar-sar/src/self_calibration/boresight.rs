//! Where the sensor faces, from the amplitudes of echoes against the beam.
//!
//! The search begins at the mean direction of all echoes. A track gives the direction of its reflector, so the head's rotation moves the reflector through the beam in a known way.
//! ln amplitude = level of the track + ln A(angle from the boresight) + aspect · displacement. The level, errors of
//! the reflector's direction and the aspect dependence are the track's own and are eliminated; the boresight is
//! common to all tracks and is found by Gauss–Newton, robustly, with the mean direction as a prior. A turn about the boresight is not observable, and has
//! no effect: the beam is the same in both planes.

use std::collections::BTreeMap;

use glam::{DMat2, DVec2, DVec3};

use super::combination::{TrackTerm, combine};
use super::corrections::Quadratic;
use super::mean_direction::{PoseMistake, RangeChanges, mean_direction, pose_mistake};
use crate::{Beam, math};

/// Echoes within this time are averaged, nanoseconds. Choice: fading and noise are correlated over a few groups of sweeps.
const BIN_NS: i64 = 100_000_000;
/// Tracks of fewer averages are not used. Choice: a level and a trend leave two.
const MIN_BINS: usize = 4;
/// Least rms fluctuation of a track's averages, nepers. Choice: 1.7 dB, antenna ripple and interference.
const MIN_FLUCTUATION: f64 = 0.2;
/// 1σ of the aspect dependence, nepers per radian. Measured (`lab --example mount`, world dining): without it
/// furniture's fading passes for a turn of 10°.
const ASPECT_SLOPE: f64 = 1.0;
/// Error of a reflector's direction beyond what its fit states, rad. Choice: 2°, an extended object's centre wanders.
const OWN_ERROR_RAD: f64 = 0.03;
/// Amplitudes below this do not distinguish directions. Choice: the pattern is not known at −26 dB.
const MIN_AMPLITUDE: f64 = 0.05;
/// 1σ of the boresight about the true mean direction of the echoes, rad. Measured (`lab --example mount -- --gross`, worlds
/// dining and office): floor and furniture lie below the boresight, on average by up to 25°.
const OFF_MEAN_RAD: f64 = 0.25;
/// An optimum of the amplitudes farther than this from the mean direction is not believed, rad. Choice: the beam's half-width;
/// echoes of a dozen tracks were once explained by a boresight 53° off (`lab --example mount`, world office, after 15 s).
const MAX_OFF_MEAN_RAD: f64 = 0.5;
/// Iterations, and their greatest step, rad. Choice: three suffice; the pattern is quadratic about as far.
const MAX_ITERATIONS: usize = 8;
const MAX_STEP_RAD: f64 = 0.3;
/// The iteration ends when a step is smaller than this share of 1σ.
const SMALL_STEP: f64 = 0.1;
/// Error that all tracks share, 1σ, rad. Measured (`lab --example mount`, worlds dining and office, sensor set right): errors
/// of 6°, mostly in elevation, that the tracks' scatter does not show.
const SYSTEMATIC_RAD: f64 = 0.1;
/// The boresight counts as observed up to this 1σ, rad. Choice: 8°, a quarter of the lensless beam's half-width.
const OBSERVED_RAD: f64 = 0.14;
/// Amplitudes of fewer tracks are not used. Choice: enough that their scatter shows what a track does not know of itself.
const MIN_TRACKS: usize = 12;

/// Where the sensor faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boresight {
    /// Unit vector in the axes of the assumed sensor, which is assumed to face along −z.
    pub direction: DVec3,
    /// 1σ of a turn about the less certain axis, rad.
    pub sigma_rad: f64,
    /// Number of tracks whose amplitudes were used.
    pub tracks: usize,
    /// Whether it is known to better than the side, to about 6°.
    pub observable: bool,
}

/// What the directions of the echoes show.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EchoDirections {
    /// Where the sensor faces; `None` while echoes do not show a side.
    pub boresight: Option<Boresight>,
    /// What is wrong with the poses, when they do not fit the ranges and would without that.
    pub pose_mistake: Option<PoseMistake>,
}

/// An echo's direction and amplitude.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aspect {
    pub time_ns: i64,
    /// Towards the reflector, in the sensor's axes.
    pub direction: DVec3,
    /// By how much that changes with each rotation of the reflector's direction.
    pub turns: [DVec3; 2],
    /// Displacement of the sensor across the line of sight, relative to the range.
    pub displacement: DVec2,
    /// Logarithm of the amplitude without the law of range.
    pub ln_amplitude: f64,
}

/// Where the echoes of a track come from.
#[derive(Debug, Clone)]
pub(super) struct Directions {
    pub changes: RangeChanges,
    /// `None` while the reflector's direction is not known.
    pub aspects: Option<Aspects>,
}

/// Aspects of a track, averaged over [`BIN_NS`].
#[derive(Debug, Clone)]
pub(super) struct Aspects {
    averages: Vec<Aspect>,
    /// Covariance of the reflector's direction, rad².
    covariance: DMat2,
}

impl Aspects {
    /// Of a track whose reflector's direction has this covariance.
    pub fn new(aspects: impl Iterator<Item = Aspect>, covariance: DMat2) -> Self {
        let mut bins: BTreeMap<i64, Vec<Aspect>> = BTreeMap::new();
        aspects.for_each(|aspect| bins.entry(aspect.time_ns.div_euclid(BIN_NS)).or_default().push(aspect));
        Self { averages: bins.values().map(|bin| average(bin)).collect(), covariance }
    }

    fn middle_ns(&self) -> i64 {
        self.averages.get(self.averages.len() / 2).map_or(0, |aspect| aspect.time_ns)
    }

    /// The information near a boresight on turns along two tangents, with the track's own unknowns eliminated.
    fn term(&self, boresight: DVec3, tangents: &[DVec3; 2], beam: &Beam) -> Option<TrackTerm<2>> {
        if self.averages.len() < MIN_BINS {
            return None;
        }
        let row = |aspect: &Aspect| {
            let (ln_gain, slope) = ln_gain_and_slope(beam, aspect.direction.dot(boresight));
            let by_boresight = tangents.map(|tangent| slope * tangent.dot(aspect.direction));
            let by_reflector = aspect.turns.map(|turn| slope * turn.dot(boresight));
            let [x, y] = aspect.displacement.to_array();
            let unknowns = [by_boresight[0], by_boresight[1], by_reflector[0], by_reflector[1], x, y];
            (aspect.ln_amplitude - ln_gain, unknowns)
        };
        let mut rows: Vec<(f64, [f64; 6])> = self.averages.iter().map(row).collect();
        subtract_means(&mut rows);
        let variance = rows.iter().map(|row| row.0 * row.0).sum::<f64>() / (rows.len() - 1) as f64;
        let weight = 1.0 / variance.max(MIN_FLUCTUATION * MIN_FLUCTUATION);
        let mut all = Quadratic::<6>::default();
        for (residual, unknowns) in &rows {
            let matrix = unknowns.map(|a| unknowns.map(|b| a * b));
            all.add(&Quadratic { matrix, gradient: unknowns.map(|a| a * residual) }, weight);
        }
        let own = self.covariance + DMat2::from_diagonal(DVec2::splat(OWN_ERROR_RAD * OWN_ERROR_RAD));
        let known = own.inverse().to_cols_array_2d();
        (0..2).for_each(|i| (0..2).for_each(|j| all.matrix[2 + i][2 + j] += known[i][j]));
        let left = all.without(4, ASPECT_SLOPE).without(5, ASPECT_SLOPE);
        let left = left.without(2, f64::INFINITY).without(3, f64::INFINITY);
        let matrix = [0, 1].map(|i| [left.matrix[i][0], left.matrix[i][1]]);
        let quadratic = Quadratic { matrix, gradient: [left.gradient[0], left.gradient[1]] };
        Some(TrackTerm { quadratic, variance_factor: 1.0, middle_ns: self.middle_ns() })
    }
}

fn average(bin: &[Aspect]) -> Aspect {
    let count = bin.len() as f64;
    Aspect {
        time_ns: bin[0].time_ns,
        direction: bin.iter().map(|a| a.direction).sum::<DVec3>().normalize_or(DVec3::NEG_Z),
        turns: [0, 1].map(|k| bin.iter().map(|a| a.turns[k]).sum::<DVec3>() / count),
        displacement: bin.iter().map(|a| a.displacement).sum::<DVec2>() / count,
        ln_amplitude: bin.iter().map(|a| a.ln_amplitude).sum::<f64>() / count,
    }
}

/// Eliminates the track's level.
fn subtract_means(rows: &mut [(f64, [f64; 6])]) {
    let count = rows.len() as f64;
    let residual = rows.iter().map(|row| row.0).sum::<f64>() / count;
    let unknowns: [f64; 6] = std::array::from_fn(|k| rows.iter().map(|row| row.1[k]).sum::<f64>() / count);
    for row in rows {
        row.0 -= residual;
        row.1.iter_mut().zip(unknowns).for_each(|(value, mean)| *value -= mean);
    }
}

/// ln A and its derivative with respect to the cosine of the angle from the boresight.
fn ln_gain_and_slope(beam: &Beam, cos: f64) -> (f64, f64) {
    const STEP: f64 = 1e-3;
    let ln_gain = |cos: f64| math::ln(beam.amplitude(cos).max(MIN_AMPLITUDE));
    let (below, above) = ((cos - STEP).max(-1.0), (cos + STEP).min(1.0));
    (ln_gain(cos), (ln_gain(above) - ln_gain(below)) / (above - below))
}

impl EchoDirections {
    pub(super) fn of<'a>(tracks: impl Iterator<Item = &'a Directions>, beam: &Beam) -> Self {
        let tracks: Vec<&Directions> = tracks.collect();
        let pose_mistake = pose_mistake(tracks.iter().map(|track| &track.changes));
        Self { boresight: boresight(&tracks, beam), pose_mistake }
    }
}

/// The boresight that the tracks agree on; `None` while they do not show a side.
fn boresight(tracks: &[&Directions], beam: &Beam) -> Option<Boresight> {
    let mean = mean_direction(tracks.iter().map(|track| &track.changes))?;
    let aspects: Vec<&Aspects> = tracks.iter().filter_map(|track| track.aspects.as_ref()).collect();
    let prior_rad = math::hypot(mean.sigma_rad, OFF_MEAN_RAD);
    let by_mean = Boresight { direction: mean.direction, sigma_rad: prior_rad, tracks: 0, observable: false };
    let by_amplitudes = if aspects.len() >= MIN_TRACKS { by_amplitudes(&aspects, &by_mean, beam) } else { None };
    Some(by_amplitudes.unwrap_or(by_mean))
}

/// Gauss–Newton from what is known before. `None` without an optimum near it.
fn by_amplitudes(tracks: &[&Aspects], before: &Boresight, beam: &Beam) -> Option<Boresight> {
    let (mut direction, mut found) = (before.direction, None);
    for _ in 0..MAX_ITERATIONS {
        let tangents = <[DVec3; 2]>::from(direction.any_orthonormal_pair());
        let terms: Vec<TrackTerm<2>> = tracks.iter().filter_map(|t| t.term(direction, &tangents, beam)).collect();
        let mut prior = Quadratic::default();
        let expected = |(k, tangent): (usize, &DVec3)| (k, tangent.dot(before.direction));
        tangents.iter().enumerate().map(expected).for_each(|(k, off)| prior.expect(k, off, before.sigma_rad));
        let combination = combine(&terms, &prior, &[before.sigma_rad; 2])?;
        let step = DVec2::from_array(combination.step).clamp_length_max(MAX_STEP_RAD);
        direction = (direction + tangents[0] * step.x + tangents[1] * step.y).normalize();
        let [x, y] = combination.covariance;
        let own_rad = x[0].max(y[1]).sqrt();
        let sigma_rad = math::hypot(own_rad, SYSTEMATIC_RAD);
        found = Some(Boresight { direction, sigma_rad, tracks: terms.len(), observable: sigma_rad <= OBSERVED_RAD });
        if step.length() <= SMALL_STEP * own_rad {
            break;
        }
    }
    found.filter(|found| found.direction.angle_between(before.direction) <= MAX_OFF_MEAN_RAD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Tracks of 3 s: the head sweeps a reflector through the beam of a sensor that faces `boresight`, while its echo
    /// fades by 1 dB.
    fn tracks(boresight: DVec3, turn_rad: f64) -> Vec<Aspects> {
        let track = |n: i64| {
            let (a, b) = boresight.any_orthonormal_pair();
            let phase = n as f64 * 0.7;
            let towards = (boresight + a * 0.4 * phase.cos() + b * 0.4 * phase.sin()).normalize();
            let aspect = |k: i64| {
                let time_s = k as f64 * 0.02;
                let turn = DQuat::from_axis_angle(a, turn_rad * (2.0 * time_s + phase).sin())
                    * DQuat::from_axis_angle(b, turn_rad * (1.7 * time_s + 2.0 * phase).cos());
                let direction = turn * towards;
                let fading = 0.1 * (31.0 * time_s + phase).sin();
                let gain = Beam::Lensless.amplitude(direction.dot(boresight)).ln();
                let (x, y) = direction.any_orthonormal_pair();
                Aspect {
                    time_ns: (n * 3_000_000_000) + (time_s * 1e9) as i64,
                    direction,
                    turns: [x, y],
                    displacement: DVec2::new(0.1 * time_s, -0.05 * time_s),
                    ln_amplitude: n as f64 + gain + fading,
                }
            };
            Aspects::new((0..150).map(aspect), DMat2::from_diagonal(DVec2::splat(1e-4)))
        };
        (0..16).map(track).collect()
    }

    /// Gauss–Newton from 20° off.
    fn found(tracks: &[Aspects], towards: DVec3, beam: &Beam) -> Option<Boresight> {
        let direction = DQuat::from_axis_angle(towards.any_orthonormal_vector(), 0.35) * towards;
        let before = Boresight { direction, sigma_rad: 0.3, tracks: 0, observable: false };
        by_amplitudes(&tracks.iter().collect::<Vec<_>>(), &before, beam)
    }

    #[test]
    fn boresight_is_found_wherever_the_sensor_faces() {
        for truth in [DVec3::NEG_Z, DVec3::new(0.2, -0.1, -0.9).normalize(), DVec3::X, DVec3::Z] {
            let found = found(&tracks(truth, 0.3), truth, &Beam::Lensless).unwrap();
            let error_rad = found.direction.angle_between(truth);
            assert!(found.observable && error_rad < 0.03 && error_rad < 3.0 * found.sigma_rad, "{truth}: {found:?}");
        }
    }

    #[test]
    fn without_rotation_or_without_a_pattern_it_is_not_observed() {
        let found = |turn_rad: f64, beam: &Beam| found(&tracks(DVec3::NEG_Z, turn_rad), DVec3::NEG_Z, beam);
        assert!(!found(0.001, &Beam::Lensless).unwrap().observable);
        assert!(!found(0.3, &Beam::Uniform).unwrap().observable);
        assert_eq!(EchoDirections::of([].iter(), &Beam::Lensless), EchoDirections::default());
    }
}
