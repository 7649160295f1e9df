//! Two reflectors closer than a pulse where one was found: a joint fit of both positions, and the
//! decision threshold.
//!
//! The sum of powers has one maximum for such a pair. But the two pulses overlap differently in
//! each sweep, so two ranges with free amplitudes explain more than one range does. Wrong poses
//! have the same effect: each sweep's range is off by a millimetre or two, and a second pulse next
//! to the first absorbs that. So noise alone cannot set the threshold. The sensor's motion within a
//! sweep must be compensated too, because it turns the phase over the pulse: at 0.5 m/s it looks
//! like a second reflector with up to 4 % of the power.
//!
//! Calibration (`lab/examples/pairs.rs`, `calibrate seeds=0..6`; 10 s at 120 sweeps a second, 50,
//! 200 and all sweeps, 10 to 40 dB, default pose errors). Gain as a share of the first reflector's
//! power: one corner reflector at most 0.0004 in any of four motions; two equal ones 20 cm apart
//! across range at least 0.030 (50 cm sphere), 0.069 (50 cm along x), 0.013 (straight approach),
//! 0.0008 to 0.005 (10 cm sphere, from 20 dB on). The threshold is four times what pose errors
//! leave unexplained of a pulse, 0.0014 with default errors, and eight sigma of noise.

use glam::DVec3;

use super::joint::{JointReading, joint_reading, solve_six};
use super::measurements::Measured;
use super::path_filter::Sight;
use super::{
    CONVERGED_STEP_M, MIN_SWEEPS, PointEstimate, PositionErrors, Prior, Refined, data_covariance, measurements,
    regular_inverse, to_refined,
};
use crate::farthest_points;
use crate::math;
use crate::range_power::RangePower;

/// A second reflector must explain at least this multiple of the share of power that pose errors
/// leave unexplained. Measured: the calibration above, in which single reflectors reach 0.0004 and
/// the threshold is 0.0014.
const GATE_POSES: f64 = 4.0;
/// And at least this share: interpolation and quantisation leave some power unexplained too.
/// Choice: above the 0.0004 that a single reflector reached in the calibration above.
const MIN_SHARE: f64 = 0.5e-3;
/// And this share where it lies behind the first in range: a pulse that differs from the template
/// looks like that. Choice: −17 dB of the first, more than a pulse differs from the template.
const GATE_BEHIND: f64 = 0.02;
/// And this many standard deviations of the gain under noise. Choice: the greatest of dozens of
/// starts stays below, however many places are tested.
const GATE_SIGMA: f64 = 8.0;
/// Greatest number of sweeps used for the search among starts. Choice: bounds its time; the best
/// one is fitted to all sweeps.
const SEARCH_SWEEPS: usize = 60;
/// Initial distances between the two, in pulse widths. Choice: 10, 20 and 30 cm for profile 3,
/// between which the fit climbs.
const APART_WIDTHS: [f64; 3] = [0.7, 1.4, 2.1];
/// Initial directions across the line of sight, over a full turn. Choice: 45° apart, within reach
/// of the fit.
const DIRECTIONS: usize = 8;
/// Number of best starts that are optimised. Choice: about a fifth of the starts, which bounds the
/// time.
const FOLLOWED: usize = 8;
/// Greatest number of steps of the joint fit. Choice: with steps of up to 4 cm it reaches every
/// place at which it may end.
const MAX_STEPS: usize = 60;
/// Longest step of a position, metres. Choice: less than a third of the pulse width, so that the
/// two do not change places.
const MAX_STEP_M: f64 = 0.04;
/// Beyond this many pulse widths, reflectors are found one after the other instead. Choice: their
/// pulses no longer overlap.
const FAR_WIDTHS: f64 = 4.0;
/// Least power of both amplitudes over their noise at which a sweep separates their ranges. Choice:
/// weaker amplitudes leave errors of centimetres where pulses overlap.
const MIN_AMPLITUDE_POWER: f64 = 6.0;

/// Two positions fitted jointly, without a decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointFit {
    /// Tracking frame, metres.
    pub places_m: [DVec3; 2],
    /// Power that two reflectors explain beyond one and beyond noise, in units of the noise.
    pub gain: f64,
    /// Power that one reflector explains, in units of the noise.
    pub single: f64,
    /// Number of sweeps that see both.
    pub sweeps: usize,
}

impl JointFit {
    /// Whether the gain exceeds what noise, pose errors and the pulse shape produce with one
    /// reflector. `single` is that one; `width_m` is the envelope's FWHM.
    pub fn passes(&self, single: &Refined, width_m: f64, errors: &PositionErrors) -> bool {
        let sight = (single.position_m - single.seen_from_m).normalize_or_zero();
        let behind = (self.places_m[1] - self.places_m[0]).normalize_or_zero().dot(sight).powi(2);
        let share = GATE_POSES * unexplained_share(width_m, errors) + GATE_BEHIND * behind;
        self.gain > share * self.single && self.gain > GATE_SIGMA * (2.0 * self.sweeps as f64).sqrt()
    }
}

/// Share of a pulse's power that range errors of the poses' size leave unexplained: half the
/// curvature of its squared magnitude times their variance.
fn unexplained_share(width_m: f64, errors: &PositionErrors) -> f64 {
    let variance_m2 = errors.slow_variance_m2() + errors.mount_variance_m2() + errors.jitter_m * errors.jitter_m;
    (4.0 * std::f64::consts::LN_2 / (width_m * width_m) * variance_m2).max(MIN_SHARE / GATE_POSES)
}

/// Splits a refined reflector into two; `None` when one is enough.
pub fn split(power: &RangePower, single: &Refined, errors: &PositionErrors) -> Option<[Refined; 2]> {
    let motion_compensated = power.motion_compensated(single.position_m);
    let width_m = power.observations().first()?.geometry.pulse_fwhm_m;
    if !may_be_two(&motion_compensated, single, 0.5 * GATE_POSES * unexplained_share(width_m, errors)) {
        return None;
    }
    let fit = best_of_compensated(&motion_compensated, single)?;
    if !fit.passes(single, width_m, errors) {
        return None;
    }
    let pair = assess_pair(&motion_compensated, &fit, errors)?;
    let apart = pair[0].position_m - pair[1].position_m;
    let covariance_m2 = pair[0].covariance_m2 + pair[1].covariance_m2;
    let told_apart = apart.dot(regular_inverse(&covariance_m2) * apart) > 9.0;
    let observed = pair.iter().all(|one| one.observed_directions() == 2);
    (told_apart && observed).then_some(pair)
}

/// Quick pre-test: a second pulse nearby would explain z's derivative at the position. Its power
/// must be a share of the total.
fn may_be_two(power: &RangePower, single: &Refined, share: f64) -> bool {
    let (mut derived, mut total) = (0.0, 0.0);
    for sweep in 0..power.observations().len() {
        let Some((_, z, slope)) = power.echo(sweep, single.position_m) else { continue };
        let width_m = power.observations()[sweep].geometry.pulse_fwhm_m;
        derived += slope.norm_sqr() * width_m * width_m / (4.0 * std::f64::consts::LN_2) - 1.0;
        total += z.norm_sqr() - 1.0;
    }
    derived > share * total
}

/// The best two positions around one, fitted to the ranges of all sweeps that see both. `None` when
/// too few do.
pub fn best_pair(power: &RangePower, single: &Refined) -> Option<JointFit> {
    best_of_compensated(&power.motion_compensated(single.position_m), single)
}

fn best_of_compensated(power: &RangePower, single: &Refined) -> Option<JointFit> {
    let readings = power.readings(single.position_m);
    if readings.len() < MIN_SWEEPS {
        return None;
    }
    let all: Vec<usize> = readings.iter().map(|r| r.sweep).collect();
    let mean_power = readings.iter().map(|r| r.power).sum::<f64>() / readings.len() as f64;
    let whole = Joint { power, single: single.position_m, sweeps: all, ridge: 1.0 / mean_power.max(1.0) };
    let positions: Vec<DVec3> =
        whole.sweeps.iter().map(|&s| power.observations()[s].tracking_from_sensor.translation).collect();
    let few = farthest_points(&positions, SEARCH_SWEEPS).into_iter().map(|n| whole.sweeps[n]).collect();
    let searched = Joint { sweeps: few, ..whole.clone() };
    let mut starts: Vec<(f64, [DVec3; 2])> = starts(power, single, readings[0].sweep)
        .into_iter()
        .filter_map(|places| Some((searched.evaluate(places)?.gain, places)))
        .collect();
    starts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let followed = starts.iter().take(FOLLOWED).filter_map(|&(_, places)| searched.climb(places));
    let (_, best) = followed.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (_, places_m) = whole.climb(best)?;
    let evaluated = whole.evaluate(places_m)?;
    Some(JointFit { places_m, gain: evaluated.gain, single: evaluated.single, sweeps: evaluated.sweeps })
}

/// Initial pairs: on both sides of the single position, or it and another one, across the line of
/// sight; and along it.
fn starts(power: &RangePower, single: &Refined, sweep: usize) -> Vec<[DVec3; 2]> {
    let width_m = power.observations()[sweep].geometry.pulse_fwhm_m;
    let sight = (single.position_m - single.seen_from_m).normalize_or(DVec3::NEG_Z);
    let (a, b) = sight.any_orthonormal_pair();
    let at = single.position_m;
    let mut starts = Vec::new();
    for apart_m in APART_WIDTHS.map(|widths| widths * width_m) {
        for n in 0..DIRECTIONS {
            let angle = std::f64::consts::TAU * n as f64 / DIRECTIONS as f64;
            let across = (a * math::cos(angle) + b * math::sin(angle)) * apart_m;
            starts.push([at, at + across]);
            if n < DIRECTIONS / 2 {
                starts.push([at - across * 0.5, at + across * 0.5]);
            }
        }
        starts.push([at - sight * apart_m * 0.25, at + sight * apart_m * 0.25]);
    }
    starts
}

/// The joint likelihood over some sweeps.
#[derive(Clone)]
struct Joint<'a, 'b> {
    power: &'a RangePower<'b>,
    single: DVec3,
    sweeps: Vec<usize>,
    ridge: f64,
}

/// The joint likelihood and its derivatives at two positions.
struct Evaluated {
    gain: f64,
    single: f64,
    sweeps: usize,
    slope: [f64; 6],
    information: [[f64; 6]; 6],
}

/// One sweep's measurement of two positions.
struct PairMeasurement {
    sweep: usize,
    toward: [DVec3; 2],
    reading: JointReading,
}

impl Joint<'_, '_> {
    fn measure(&self, sweep: usize, places: &[DVec3; 2]) -> Option<PairMeasurement> {
        let echoes = [self.power.echo(sweep, places[0])?, self.power.echo(sweep, places[1])?];
        let observation = &self.power.observations()[sweep];
        let sensor = observation.tracking_from_sensor.translation;
        let reading = joint_reading(&echoes, observation.geometry.pulse_fwhm_m, self.ridge);
        let toward = places.map(|place| (place - sensor).normalize_or_zero());
        Some(PairMeasurement { sweep, toward, reading })
    }

    /// `None` when too few sweeps see both.
    fn evaluate(&self, places: [DVec3; 2]) -> Option<Evaluated> {
        let mut sum = Evaluated { gain: 0.0, single: 0.0, sweeps: 0, slope: [0.0; 6], information: [[0.0; 6]; 6] };
        for &sweep in &self.sweeps {
            let Some((_, alone, _)) = self.power.echo(sweep, self.single) else { continue };
            let Some(measurement) = self.measure(sweep, &places) else { continue };
            let single = alone.norm_sqr() - 1.0;
            sum.gain += measurement.reading.excess - single;
            sum.single += single;
            sum.sweeps += 1;
            let toward = measurement.toward.map(|u| u.to_array());
            for row in 0..6 {
                sum.slope[row] += toward[row / 3][row % 3] * measurement.reading.slope_per_m[row / 3];
                for col in 0..6 {
                    sum.information[row][col] += measurement.reading.information_per_m2[row / 3][col / 3]
                        * toward[row / 3][row % 3]
                        * toward[col / 3][col % 3];
                }
            }
        }
        (sum.sweeps >= MIN_SWEEPS.max(self.sweeps.len() / 2)).then_some(sum)
    }

    /// Damped Newton steps; returns the final gain and positions. `None` when they end too far
    /// apart.
    fn climb(&self, mut places: [DVec3; 2]) -> Option<(f64, [DVec3; 2])> {
        let mut here = self.evaluate(places)?;
        let mut damping = 1e-2;
        for _ in 0..MAX_STEPS {
            let mean = (0..6).map(|n| here.information[n][n]).sum::<f64>() / 6.0;
            let mut damped = here.information;
            for (n, row) in damped.iter_mut().enumerate() {
                row[n] += damping * (row[n] + 0.01 * mean) + 1e-6;
            }
            let next = solve_six(damped, here.slope).map(|step| {
                [0, 1].map(|k| {
                    let step = DVec3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]);
                    places[k] + step.clamp_length_max(MAX_STEP_M)
                })
            });
            let better = next.and_then(|next| Some((next, self.evaluate(next)?))).filter(|(_, e)| e.gain >= here.gain);
            match better {
                Some((next, evaluated)) => {
                    let moved_m = next[0].distance(places[0]).max(next[1].distance(places[1]));
                    (places, here) = (next, evaluated);
                    damping = (damping * 0.3).max(1e-6);
                    if moved_m < CONVERGED_STEP_M {
                        break;
                    }
                }
                None => {
                    damping *= 5.0;
                    if damping > 1e5 {
                        break;
                    }
                }
            }
        }
        let width_m = self.power.observations()[*self.sweeps.first()?].geometry.pulse_fwhm_m;
        (places[0].distance(places[1]) < FAR_WIDTHS * width_m).then_some((here.gain, places))
    }
}

/// Both positions with the covariance due to noise and pose errors. The positions stay at the joint
/// fit, whose sums lack the bias that sweeps with nearly equal ranges give to single lengths.
fn assess_pair(power: &RangePower, fit: &JointFit, errors: &PositionErrors) -> Option<[Refined; 2]> {
    let mean_power = fit.single / fit.sweeps.max(1) as f64;
    let sweeps = (0..power.observations().len()).collect();
    let joint = Joint { power, single: fit.places_m[0], sweeps, ridge: 1.0 / mean_power.max(1.0) };
    let measurements: Vec<PairMeasurement> =
        joint.sweeps.iter().filter_map(|&sweep| joint.measure(sweep, &fit.places_m)).collect();
    let judge_one = |which: usize| {
        let place = fit.places_m[which];
        let (all, readings) = (lengths(power, &measurements, which), power.readings(place));
        if all.len() < MIN_SWEEPS || readings.len() < MIN_SWEEPS {
            return None;
        }
        let prior = Prior::from(power, &readings, place);
        let data_m2 = data_covariance(power, &measurements::fit_ranges(&all, errors), &readings, place, errors);
        Some(to_refined(power, &PointEstimate::new(place, readings, data_m2, &prior), &prior, errors))
    };
    Some([judge_one(0)?, judge_one(1)?])
}

/// Lengths to one of the two positions from the joint measurement, with the other's range unknown.
fn lengths(power: &RangePower, measurements: &[PairMeasurement], which: usize) -> Vec<Measured> {
    let start_ns = measurements.first().map_or(0, |l| power.observations()[l.sweep].mid_time_ns);
    let mut all: Vec<Measured> = measurements
        .iter()
        .filter_map(|measurement| {
            let observation = &power.observations()[measurement.sweep];
            let width_m = observation.geometry.pulse_fwhm_m;
            let JointReading { slope_per_m: slope, amplitudes, amplitude_variance, .. } = measurement.reading;
            let (true_info, info) =
                (measurement.reading.true_information_per_m2, measurement.reading.information_per_m2);
            let signal = amplitudes.map(|a| a.norm_sqr() / amplitude_variance);
            if signal[0].min(signal[1]) < MIN_AMPLITUDE_POWER {
                return None;
            }
            let determinant = true_info[0][0] * true_info[1][1] - true_info[0][1] * true_info[1][0];
            let other = 1 - which;
            // This row of the inverse converts slopes to ranges; the slopes' variance follows from
            // the noisy amplitudes.
            let (own, across) = (true_info[other][other] / determinant, -true_info[0][1] / determinant);
            let off_m = own * slope[which] + across * slope[other];
            let variance_m2 =
                own * own * info[which][which] + 2.0 * own * across * info[0][1] + across * across * info[other][other];
            // A range uncertain by a third of a pulse is not used.
            if !(determinant > 0.0 && variance_m2 > 0.0 && variance_m2 < width_m * width_m / 9.0) {
                return None;
            }
            let toward = measurement.toward[which];
            Some(Measured {
                sight: Sight {
                    time_s: (observation.mid_time_ns - start_ns) as f64 * 1e-9,
                    toward,
                    toward_in_sensor: observation.tracking_from_sensor.rotation.conjugate() * toward,
                },
                range_off_m: off_m,
                range_variance_m2: variance_m2,
                phase_off_m: 0.0,
                phase_variance_m2: None,
            })
        })
        .collect();
    all.sort_by(|a, b| a.sight.time_s.total_cmp(&b.sight.time_s));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refine::refine;
    use crate::test_data::{Echo, sweeps, winding};
    use crate::{Beam, Observation};

    const LEFT: DVec3 = DVec3::new(-0.1, 0.0, -1.1);
    const RIGHT: DVec3 = DVec3::new(0.1, 0.0, -1.1);

    fn some(echoes: &[(Echo, f64)], seed: u64) -> Vec<Observation> {
        sweeps(4.0, |t| winding(t) * 3.0, echoes, seed).into_iter().step_by(40).collect()
    }

    fn halves(observations: &[Observation], errors: &PositionErrors) -> Option<[Refined; 2]> {
        let power = RangePower::new(observations, &Beam::Lensless, 0.15);
        split(&power, &refine(&power, (LEFT + RIGHT) * 0.5, None, errors)?, errors)
    }

    #[test]
    fn two_across_range_are_told_apart_with_their_covariance() {
        for seed in 0..3 {
            let both = some(&[(Echo::Point(LEFT), 20.0), (Echo::Point(RIGHT), 20.0)], seed);
            let mut found = halves(&both, &PositionErrors::none()).expect("two");
            found.sort_by(|a, b| a.position_m.x.total_cmp(&b.position_m.x));
            for (one, truth) in found.iter().zip([LEFT, RIGHT]) {
                let off = one.position_m - truth;
                assert!(off.length() < 0.012, "{one:?}");
                assert!(off.dot(one.covariance_m2.inverse() * off) < 16.0, "{one:?}");
            }
        }
    }

    #[test]
    fn one_reflector_with_wrong_poses_is_not_split() {
        for seed in 0..4 {
            let mut one = some(&[(Echo::Point(LEFT), 60.0)], seed);
            for observation in &mut one {
                let t = observation.mid_time_ns as f64 * 1e-9;
                observation.tracking_from_sensor.translation +=
                    DVec3::new((1.3 * t).sin(), (2.9 * t).sin(), (2.1 * t).sin()) * 1.4e-3;
            }
            assert_eq!(halves(&one, &PositionErrors::default()), None);
        }
    }

    #[test]
    fn noise_and_too_few_sweeps_are_not_split() {
        let errors = PositionErrors::default();
        assert_eq!(halves(&some(&[], 1), &errors), None);
        let two = &some(&[(Echo::Point(LEFT), 20.0), (Echo::Point(RIGHT), 20.0)], 2)[..2];
        assert_eq!(halves(two, &errors), None);
    }
}
