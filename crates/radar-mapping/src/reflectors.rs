//! Single reflectors from range alone: the `ls` sum over a dense grid, one reflector after the
//! other.
//!
//! The point with the greatest excess over noise is refined, its ranges are masked in every sweep,
//! and the search continues in the rest until nothing stands out. For trials and slow sensors.
//! Rooms need sub-apertures, because range-only sums do not find furniture in front of a wall.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Evidence, Observed, Obstacle};
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{BoundedSettings, SettingBound, bounds};
use radar_sar::{PositionErrors, RangePower, Refined, Volume, farthest_points, refine, split};

/// Parameters of the search.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReflectorSettings {
    /// Edge of the search's voxels, metres; the refinement continues from there.
    pub voxel_m: f64,
    /// Most sweeps used, chosen by farthest point; 0: all.
    pub max_sweeps: usize,
    /// Most sweeps that the dense search uses; the refinement uses all chosen.
    pub search_sweeps: usize,
    /// Points nearer than this to the sensor are ignored in a sweep, metres: the antenna's own
    /// leakage.
    pub min_range_m: f64,
    /// Excess over noise, in standard deviations, that a reflector needs.
    pub threshold_sigma: f64,
    /// Most reflectors reported.
    pub max_reflectors: usize,
}

impl BoundedSettings for ReflectorSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        voxel_m: 0.005, 0.5;
        max_sweeps: 0.0, 1e9;
        search_sweeps: 10.0, 1e5;
        min_range_m: 0.0, 1.0;
        threshold_sigma: 0.0, 100.0;
        max_reflectors: 1.0, 1000.0;
    ];
}

impl Default for ReflectorSettings {
    fn default() -> Self {
        Self {
            voxel_m: 0.06,
            max_sweeps: 0,
            search_sweeps: 60,
            min_range_m: 0.15,
            threshold_sigma: 7.0,
            max_reflectors: 8,
        }
    }
}

/// Least share of the sweeps that see its point, and least number, that must be unmasked for a
/// reflector. Choice: three ranges are the least that determine a point; where most sweeps are
/// masked, what is left are the edges of stronger echoes.
const MIN_UNCLAIMED_SHARE: f64 = 0.3;
const MIN_SWEEPS: usize = 3;

/// Share of the strongest reflector's evidence below which others cannot be told from its own
/// sidelobes and pose errors. Choice: −30 dB; farther down each strong reflector is followed by a
/// ring of spurious ones.
const DYNAMIC_RANGE: f64 = 1e-3;
/// Rms range residual of a static object, without noise, in pulse widths: 17 mm of a 14 cm pulse.
/// Choice: well above tracking errors of some millimetres, well below the decimetres of what moves
/// with the sensor.
const MAX_STATIC_RESIDUAL_WIDTHS: f64 = 0.12;

/// Whether the ranges of all sweeps agree on one point, as far as their noise allows. Objects that
/// move with the sensor (its own housing) or by themselves leave them apart. `mean_power`: mean
/// excess of a sweep over noise. It is tested for all but the strongest, which is reported in any
/// case, with its covariance grown by the misfit.
fn is_static(refined: &Refined, mean_power: f64) -> bool {
    let noise2 = 1.0 / (8.0 * std::f64::consts::LN_2 * mean_power.max(1e-9));
    refined.residual_widths * refined.residual_widths
        <= MAX_STATIC_RESIDUAL_WIDTHS * MAX_STATIC_RESIDUAL_WIDTHS + noise2
}

/// Finds reflectors in a region, strongest first. `observations` in rising time.
pub fn find_reflectors(
    observations: &[Observation],
    beam: &Beam,
    region: &Aabb,
    settings: &ReflectorSettings,
    errors: &PositionErrors,
) -> Vec<Obstacle> {
    let chosen = choose(observations, settings.max_sweeps);
    let searched = choose(&chosen, settings.search_sweeps);
    let mut power = RangePower::new(&chosen, beam, settings.min_range_m);
    let mut search = RangePower::new(&searched, beam, settings.min_range_m);
    let grid = Volume { values: Vec::new(), ..Volume::covering(region, settings.voxel_m) };
    let points: Vec<DVec3> = (0..grid.size.iter().product()).map(|n| grid.center(grid.voxel(n))).collect();
    let unclaimed: Vec<usize> = search.excess_at(&points).iter().map(|&(_, count)| count).collect();
    let mut found: Vec<Obstacle> = Vec::new();
    while found.len() < settings.max_reflectors {
        let excess = search.excess_at(&points);
        let enough = |n: usize| {
            let (sum, count) = excess[n];
            count >= MIN_SWEEPS
                && count as f64 >= MIN_UNCLAIMED_SHARE * unclaimed[n] as f64
                && sum >= settings.threshold_sigma * (count as f64).sqrt()
        };
        let best = (0..points.len()).filter(|&n| enough(n)).max_by(|&a, &b| excess[a].0.total_cmp(&excess[b].0));
        let Some((start, refined)) = best.and_then(|n| Some((n, refine(&power, points[n], None, errors)?))) else {
            break;
        };
        let (sum, count) = power.excess(refined.position_m);
        let evidence = sum / (count.max(1) as f64).sqrt();
        let strongest = found.first().map_or(evidence, |f| f.evidence);
        let stands_out = count >= MIN_SWEEPS && evidence >= settings.threshold_sigma.max(strongest * DYNAMIC_RANGE);
        let errors = PositionErrors { wander_m: refined.wander_m, ..*errors };
        let pair = if stands_out { split(&power, &refined, &errors) } else { None };
        let stands = stands_out && (pair.is_some() || found.is_empty() || is_static(&refined, sum / count as f64));
        let parts = pair.map_or(vec![refined], Vec::from);
        // Masked in any case: the search must go on elsewhere. It ends when nothing is left to
        // mask.
        let left_before = search.excess(points[start]).1;
        for part in &parts {
            if stands && found.len() < settings.max_reflectors {
                found.push(obstacle(found.len() as u64 + 1, part, evidence, &chosen));
            }
            search.mask_point(part.position_m);
            power.mask_point(part.position_m);
        }
        if !stands && (evidence < strongest * DYNAMIC_RANGE || search.excess(points[start]).1 == left_before) {
            break;
        }
    }
    found
}

/// The excess over noise in standard deviations on the search's voxels, before anything is masked.
/// Of the voxels that reach the threshold and half of the greatest, the `most` highest. Range alone
/// gives shells, and reflectors stand where shells meet.
pub fn reflector_evidence(
    observations: &[Observation],
    beam: &Beam,
    region: &Aabb,
    settings: &ReflectorSettings,
    most: usize,
) -> Evidence {
    let chosen = choose(observations, settings.search_sweeps);
    let search = RangePower::new(&chosen, beam, settings.min_range_m);
    let grid = Volume { values: Vec::new(), ..Volume::covering(region, settings.voxel_m) };
    let points: Vec<DVec3> = (0..grid.size.iter().product()).map(|n| grid.center(grid.voxel(n))).collect();
    let scores = search.excess_at(&points).into_iter().map(|(sum, count)| (sum / (count.max(1) as f64).sqrt()) as f32);
    let mut voxels: Vec<(DVec3, f32)> = points.into_iter().zip(scores).collect();
    let greatest = voxels.iter().map(|voxel| voxel.1).fold(0.0, f32::max);
    voxels.retain(|voxel| voxel.1 >= (0.5 * greatest).max(settings.threshold_sigma as f32));
    Evidence::strongest(settings.voxel_m, voxels, most)
}

/// `count` sweeps by farthest point (0: all); subsweeps of one sweep stay together.
fn choose(observations: &[Observation], count: usize) -> Vec<Observation> {
    if count == 0 {
        return observations.to_vec();
    }
    let mut sweeps: Vec<&[Observation]> =
        observations.chunk_by(|a, b| b.geometry.subsweep > a.geometry.subsweep).collect();
    let positions: Vec<DVec3> = sweeps.iter().map(|s| s[0].tracking_from_sensor.translation).collect();
    sweeps = farthest_points(&positions, count).into_iter().map(|n| sweeps[n]).collect();
    sweeps.concat()
}

fn obstacle(id: u64, refined: &Refined, evidence: f64, observations: &[Observation]) -> Obstacle {
    let observed = match refined.observed_directions() {
        2 => Observed::Position,
        1 => Observed::RangeAndOneDirection,
        _ => Observed::RangeOnly,
    };
    Obstacle {
        id,
        position_m: refined.position_m,
        covariance_m2: refined.covariance_m2,
        observed,
        extent_m: DVec3::ZERO,
        evidence,
        shape: vec![(refined.position_m, evidence as f32)],
        provisional: false,
        first_seen_ns: observations.first().map_or(0, |o| o.mid_time_ns),
        last_seen_ns: observations.last().map_or(0, |o| o.mid_time_ns),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::test_data::{Echo, sweeps, winding};

    fn found(echoes: &[(Echo, f64)], seed: u64) -> Vec<Obstacle> {
        let all = sweeps(3.0, |t| winding(t) * 3.0, echoes, seed);
        let observations: Vec<_> = all.into_iter().step_by(60).collect();
        let region = Aabb { min: DVec3::new(-0.7, -0.7, -2.4), max: DVec3::new(0.7, 0.7, -0.5) };
        let settings = ReflectorSettings::default();
        find_reflectors(&observations, &Beam::Lensless, &region, &settings, &PositionErrors::default())
    }

    #[test]
    fn noise_gives_no_reflector() {
        for seed in 0..3 {
            assert_eq!(found(&[], seed), []);
        }
    }

    #[test]
    fn single_reflector_is_found_once() {
        let at = DVec3::new(0.2, -0.1, -2.0);
        let found = found(&[(Echo::Point(at), 10.0)], 4);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].position_m.distance(at) < 0.02 && found[0].observed == Observed::Position, "{found:?}");
    }

    #[test]
    fn two_reflectors_within_one_pulse_are_separated() {
        let (left, right) = (DVec3::new(-0.1, 0.0, -1.2), DVec3::new(0.1, 0.0, -1.2));
        let found = found(&[(Echo::Point(left), 25.0), (Echo::Point(right), 25.0)], 6);
        assert_eq!(found.len(), 2, "{found:?}");
        for truth in [left, right] {
            assert!(found.iter().any(|f| f.position_m.distance(truth) < 0.015), "{found:?}");
        }
    }
}
