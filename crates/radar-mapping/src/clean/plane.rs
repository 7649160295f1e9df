//! Planes: refinement, and the test that they are planes.
//!
//! The search grid of planes is 1.5° and 5 cm fine. The mask of a wall's echo must be more
//! accurate, so a plane is moved uphill before it is accepted. It must also explain its echoes
//! better than any single point does: for a head that hardly moved sideways, a chair's leg looks
//! the same as a plane.

use glam::{DQuat, DVec3, IVec2};
use rayon::prelude::*;

use super::CleanSettings;
use super::candidate::{Candidate, Hypothesis};
use super::query::SubapertureQuery;
use super::residual::Residual;
use super::subapertures::WeightedSubapertures;
use crate::responses::Response;
use radar_sar::geometry::Plane;
use radar_sar::math;
use radar_sar::subaperture::Subaperture;

/// A step of the finest kind: rotation, radians, and displacement, metres. Choice: 0.25° moves a
/// wall's edge 2 m aside by 9 mm and 5 mm are λ: both below [`RANGE_SIGMA_M`], and finer steps cost
/// more scores of the whole window.
const UNIT_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;
const UNIT_M: f64 = 0.005;
/// First step of the hill climb and its greatest reach, in units of the above. Choice: steps of 1°
/// and 2 cm, reach of 3° and 6 cm; the grid of planes is 1.5° and 5 cm apart, so a neighbour of the
/// true plane is in reach and the next wall is not.
const UNITS: i32 = 4;
const REACH_UNITS: i32 = 12;
/// Steps and reach of the search for the best single point, from the middle of where the plane was
/// seen, metres. Choice: the first step is about the pulse's width, the last about half a voxel;
/// the reach covers the plane's usual extent in a window.
const POINT_STEPS_M: [f64; 3] = [0.12, 0.06, 0.03];
const POINT_REACH_M: f64 = 0.4;

/// An echo nearer than this whose range changes by less than this, rms, metres, accompanies the sensor: its ringing, its
/// mounting, the wearer's chest. Choice: what the wearer carries; and a little above what such echoes change by. Measured:
/// 2 to 8 mm for the four false walls of three simulated rooms, at 0.42 to 0.63 m. A true wall changes as little while the
/// head moves along it, so one as near is confirmed when the head comes nearer or goes farther.
const ACCOMPANYING_RANGE_M: f64 = 1.0;
const ACCOMPANYING_RMS_M: f64 = 0.01;

/// 1σ of the range of a refined plane, metres. Choice: the error of tracking and mount, which all
/// sub-apertures share; the pulse alone would state less than a millimetre.
const RANGE_SIGMA_M: f64 = 0.01;

/// The candidate that a plane is.
pub(super) fn candidate(plane: Plane, query: SubapertureQuery, residual: &Residual) -> Candidate {
    residual.candidate(Hypothesis::Plane(plane), query.plane(residual.subapertures.all(), &plane))
}

/// Moves a plane uphill in the coherent power of its unmasked responses: rotated about the vertical
/// through the middle of where it was seen, and nearer or farther. Walls stand upright; floor and
/// ceiling are level.
pub(super) fn hill_climb(best: &mut Candidate, query: SubapertureQuery, residual: &Residual) {
    let (Hypothesis::Plane(start), Some(_)) = (best.hypothesis, best.unmasked) else { return };
    let subapertures = &residual.subapertures;
    let Some(pivot) = mean_foot(subapertures, &best.responses) else { return };
    let may_turn = start.is_upright();
    let plane = |at: IVec2| {
        let outward = DQuat::from_rotation_y(f64::from(at.x) * UNIT_RAD) * start.outward;
        Plane { outward, offset_m: outward.dot(pivot) + start.distance(pivot) + f64::from(at.y) * UNIT_M }
    };
    let log_power = |candidate: &Candidate| coherent_log_power(subapertures, &candidate.responses);
    let (mut here, mut score, mut step) = (IVec2::ZERO, log_power(best), UNITS);
    while step > 0 {
        let around = [IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y].map(|axis| here + axis * step);
        let is_in_reach = |at: &IVec2| at.abs().max_element() <= REACH_UNITS && (may_turn || at.x == 0);
        let near: Vec<IVec2> = around.into_iter().filter(is_in_reach).collect();
        let tried: Vec<(IVec2, Candidate)> =
            near.par_iter().map(|at| (*at, candidate(plane(*at), query, residual))).collect();
        let scored = tried.into_iter().map(|(at, other)| (at, log_power(&other), other));
        match scored.max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((at, better, other)) if better > score => (here, score, *best) = (at, better, other),
            _ => step /= 2,
        }
    }
}

/// Weighted sum of the logarithms of the powers that add up. Unlike the score it has its maximum at
/// the very middle of a pulse, however strong it is.
fn coherent_log_power(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> f64 {
    let of_one = |(response, (_, weight)): (&Option<Response>, (&Subaperture, f64))| {
        response.map_or(0.0, |response| weight * math::ln_1p(response.net_coherent_power()))
    };
    responses.iter().zip(subapertures.iter()).map(of_one).sum()
}

/// Whether it is a plane of the room: the feet of its perpendiculars have moved, the echo does not accompany the sensor,
/// and no single point accounts for the same echoes.
pub(super) fn is_plane(
    subapertures: &WeightedSubapertures,
    responses: &[Option<Response>],
    settings: &CleanSettings,
) -> bool {
    feet_rms_m(subapertures, responses) >= settings.min_feet_rms_m
        && !accompanies_sensor(subapertures, responses)
        && margin_over_point(subapertures, responses) >= settings.min_over_point
}

/// 1σ of the plane 1 m beside where it was seen, metres, from the accuracy of the ranges and the
/// spread of the feet.
pub(super) fn sigma_m(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> f64 {
    RANGE_SIGMA_M / feet_rms_m(subapertures, responses).max(RANGE_SIGMA_M)
}

/// Whether an echo stays at one range though the sensor moves.
fn accompanies_sensor(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> bool {
    let ranges_m = || subapertures.significant(responses).map(|(_, response)| response.range_m);
    let count = ranges_m().count() as f64;
    let mean_m = ranges_m().sum::<f64>() / count;
    let variance_m2 = ranges_m().map(|range_m| (range_m - mean_m).powi(2)).sum::<f64>() / count;
    mean_m < ACCOMPANYING_RANGE_M && variance_m2 < ACCOMPANYING_RMS_M.powi(2)
}

/// Score by which a plane exceeds the best single point near where it was seen.
fn margin_over_point(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> f64 {
    let Some(start) = mean_foot(subapertures, responses) else { return 0.0 };
    let margin_over = |place: DVec3| margin_over(subapertures, responses, place);
    let (mut here, mut least) = (start, margin_over(start));
    for step_m in POINT_STEPS_M {
        loop {
            let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
            let around = axes.flat_map(|axis| [here + axis * step_m, here - axis * step_m]);
            let near: Vec<DVec3> = around.filter(|at| at.distance(start) <= POINT_REACH_M).collect();
            let tried: Vec<(DVec3, f64)> = near.par_iter().map(|at| (*at, margin_over(*at))).collect();
            match tried.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((at, less)) if less < least => (here, least) = (at, less),
                _ => break,
            }
        }
    }
    least
}

/// Score by which the sub-apertures favour a plane over a point.
fn margin_over(subapertures: &WeightedSubapertures, responses: &[Option<Response>], place: DVec3) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for ((one, weight), response) in subapertures.iter().zip(responses) {
        let Some(response) = response else { continue };
        let whole = one.uncancelled();
        let relative = (place - whole.middle.translation).as_vec3().to_array();
        let of_point = Response::evidence_of(whole.coherence_at_points(&[relative])[0].m);
        sum += weight * (response.evidence - of_point);
        squares += weight * weight;
    }
    if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
}

/// Mean of the feet of a plane's perpendiculars.
fn mean_foot(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> Option<DVec3> {
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for (one, response) in subapertures.significant(responses) {
        sum += one.middle.translation + response.toward * response.range_m;
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}

/// Rms spread of the feet of a plane's perpendiculars, metres.
fn feet_rms_m(subapertures: &WeightedSubapertures, responses: &[Option<Response>]) -> f64 {
    let Some(mean) = mean_foot(subapertures, responses) else { return 0.0 };
    let foot = |(one, response): (&Subaperture, &Response)| one.middle.translation + response.toward * response.range_m;
    let squares: Vec<f64> = subapertures.significant(responses).map(|seen| foot(seen).distance_squared(mean)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}
