//! Refinement and the reflector search: finite positions and valid covariances, whatever the
//! geometry.

use glam::{DMat3, DVec3};
use radar_mapping::{ReflectorSettings, find_reflectors};
use radar_sar::geometry::Aabb;
use radar_sar::{PositionErrors, RangePower, refine};

use crate::cases::{cases, rows, sound, sweeps};
use crate::quick_or_long;

/// Why a matrix is no covariance: not finite, not symmetric, or with a negative variance in some
/// direction (Cholesky pivots, up to rounding).
fn covariance_defect(m: &DMat3) -> Option<&'static str> {
    if !m.is_finite() {
        return Some("not finite");
    }
    let trace = m.x_axis.x + m.y_axis.y + m.z_axis.z;
    if (*m - m.transpose()).abs_diff_eq(DMat3::ZERO, 1e-9 * trace.abs()) {
        let a = *m + DMat3::from_diagonal(DVec3::splat(1e-12 * trace));
        let first = a.x_axis.x;
        let second = a.y_axis.y - a.x_axis.y * a.x_axis.y / first;
        let (b, c) = (a.x_axis.z, a.y_axis.z - a.x_axis.y * a.x_axis.z / first);
        let third = a.z_axis.z - b * b / first - c * c / second;
        (!(first > 0.0 && second > 0.0 && third > 0.0)).then_some("not positive")
    } else {
        Some("not symmetric")
    }
}

#[test]
fn refinement_is_finite_with_a_covariance_everywhere() {
    let (mut wrong, mut refined) = (Vec::new(), 0);
    for (case, path) in rows(&cases()) {
        let observations = sound(&sweeps(case, path, quick_or_long(24, 200), 13));
        let starts = [
            ("beside the target", case.at() + DVec3::new(0.02, -0.03, 0.02)),
            ("at the sensor", case.origin),
            ("beside the sensor", case.origin + DVec3::splat(1e-9)),
            ("behind the sensor", case.origin - case.target),
            ("at the first range", case.origin + DVec3::NEG_Z * case.axis.first_m),
            ("at the last range", case.origin + DVec3::NEG_Z * case.axis.last_m()),
            ("out of range", case.origin + DVec3::NEG_Z * 100.0),
        ];
        let all = [PositionErrors::default(), PositionErrors { wander_s: 0.01, ..PositionErrors::none() }];
        for min_range_m in [0.0, 0.15] {
            let power = RangePower::new(&observations, &case.beam, min_range_m);
            for ((start, place), reach_m) in starts.into_iter().flat_map(|s| [(s, None), (s, Some(0.05))]) {
                let errors = &all[usize::from(reach_m.is_some() && min_range_m > 0.0)];
                let Some(found) = refine(&power, place, reach_m, errors) else { continue };
                refined += 1;
                let what = format!("{} / {} / from {start}, {place}, reach {reach_m:?}", case.name, path.name);
                if !found.position_m.is_finite() || !found.seen_from_m.is_finite() || found.residual_widths.is_nan() {
                    wrong.push(format!("{what}: {found:?}"));
                }
                if let Some(why) = covariance_defect(&found.covariance_m2) {
                    wrong.push(format!("{what}: covariance {why}, {found:?}"));
                }
                let on_the_spot = ["coincident", "turning on the spot", "a nanometre"].contains(&path.name);
                if on_the_spot && found.observed_directions() > 0 {
                    wrong.push(format!("{what}: a direction seen from one spot counts as observed, {found:?}"));
                }
                if found.cross_range_sigma_m.iter().any(|sigma| sigma.is_nan()) {
                    wrong.push(format!("{what}: {found:?}"));
                }
            }
        }
    }
    assert!(refined > 1000, "{refined} refined");
    wrong.truncate(60);
    assert!(wrong.is_empty(), "{} wrong of {refined}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn reflectors_are_finite_and_absent_in_silence() {
    let settings = ReflectorSettings { voxel_m: 0.2, ..Default::default() };
    let errors = PositionErrors::default();
    let (mut wrong, mut found) = (Vec::new(), 0);
    for (case, path) in rows(&cases()) {
        let what = format!("{} / {}", case.name, path.name);
        let observations = sound(&sweeps(case, path, quick_or_long(24, 200), 17));
        let region = Aabb { min: case.at() - 0.8, max: case.at() + 0.8 };
        let obstacles = find_reflectors(&observations, &case.beam, &region, &settings, &errors);
        found += obstacles.len();
        for obstacle in &obstacles {
            let finite = obstacle.position_m.is_finite()
                && obstacle.extent_m.is_finite()
                && obstacle.evidence.is_finite()
                && obstacle.shape.iter().all(|(place, value)| place.is_finite() && value.is_finite());
            if let Some(why) = covariance_defect(&obstacle.covariance_m2).or((!finite).then_some("not finite")) {
                wrong.push(format!("{what}: {why}, {obstacle:?}"));
            }
        }
        if obstacles.len() > settings.max_reflectors {
            wrong.push(format!("{what}: {} reflectors", obstacles.len()));
        }
        let silent = observations.iter().flat_map(|o| &o.samples).all(|x| x.norm() < 1e-30);
        if silent && !obstacles.is_empty() {
            wrong.push(format!("{what}: found in silence, {obstacles:?}"));
        }
    }
    assert!(found > 50, "{found} found");
    wrong.truncate(60);
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
    let case = &cases()[0];
    assert!(find_reflectors(&[], &case.beam, &case.region(), &settings, &errors).is_empty());
}
