//! Cramér–Rao bound of a reflector's position: the accuracy limit of any estimator, given noise and
//! pose errors.
//!
//! Dense matrices, straight from the formula: lengths l = U·s + e + n with e ~ N(0, K), K_ij =
//! u_i·u_j k(t_i − t_j) + (R_i⁻¹u_i)·(R_j⁻¹u_j) m², n independent. The bound is (Uᵀ (K + N)⁻¹ U)⁻¹.
//! With phases, each sweep measures l twice, the second time with an offset that all sweeps share.
//! The whole number of half wavelengths is taken as known. For studies with a known truth; the
//! reference for `refine`.

use glam::{DMat3, DQuat, DVec3};

use crate::symmetric::outer;

/// One sweep's view of the reflector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundSight {
    /// Time since an arbitrary fixed moment, seconds.
    pub time_s: f64,
    /// Unit vector from the sensor to the reflector, tracking frame.
    pub toward: DVec3,
    /// `tracking_from_sensor`.
    pub rotation: DQuat,
    /// Variance of the range from the pulse alone, m².
    pub range_variance_m2: f64,
    /// Variance of the length from the phase, m²; `None`: the phase is not used.
    pub phase_variance_m2: Option<f64>,
}

/// Least covariance of the position, m². `poses_m2`: covariance of the pose error per axis between
/// two moments that many seconds apart. `mount_m2`: variance of the mount error per axis. `None`
/// when the sweeps do not determine a position.
pub fn cramer_rao_bound(sights: &[BoundSight], poses_m2: impl Fn(f64) -> f64, mount_m2: f64) -> Option<DMat3> {
    let count = sights.len();
    let in_sensor: Vec<DVec3> = sights.iter().map(|s| s.rotation.conjugate() * s.toward).collect();
    // Weights of range and phase in each sweep's best length. Their difference determines the
    // offset, together with the rest.
    let weights: Vec<(f64, f64)> =
        sights.iter().map(|s| (1.0 / s.range_variance_m2, s.phase_variance_m2.map_or(0.0, |v| 1.0 / v))).collect();
    let mut lower: Vec<Vec<f64>> = Vec::with_capacity(count);
    for (i, a) in sights.iter().enumerate() {
        let row = sights[..=i].iter().enumerate().map(|(j, b)| {
            let noise = if i == j { 1.0 / (weights[i].0 + weights[i].1) } else { 0.0 };
            a.toward.dot(b.toward) * poses_m2((a.time_s - b.time_s).abs())
                + in_sensor[i].dot(in_sensor[j]) * mount_m2
                + noise
        });
        lower.push(row.collect());
    }
    factor(&mut lower)?;
    let share = |i: usize| weights[i].1 / (weights[i].0 + weights[i].1);
    let columns: [Vec<f64>; 4] = [
        sights.iter().map(|s| s.toward.x).collect(),
        sights.iter().map(|s| s.toward.y).collect(),
        sights.iter().map(|s| s.toward.z).collect(),
        (0..count).map(share).collect(),
    ];
    let whitened = columns.map(|column| solve_lower(&lower, column));
    let product = |a: usize, b: usize| whitened[a].iter().zip(&whitened[b]).map(|(x, y)| x * y).sum::<f64>();
    let by_place = DMat3::from_cols_array_2d(&[0, 1, 2].map(|a| [0, 1, 2].map(|b| product(a, b))));
    let by_difference: f64 = (0..count).map(|i| weights[i].0 * share(i)).sum();
    let across = DVec3::new(product(0, 3), product(1, 3), product(2, 3));
    let offset = product(3, 3) + by_difference;
    let lost = if offset > 0.0 { outer(across) * (1.0 / offset) } else { DMat3::ZERO };
    let bound = (by_place - lost).inverse();
    let largest_m2 = bound.x_axis.x.max(bound.y_axis.y).max(bound.z_axis.z);
    (bound.is_finite() && largest_m2 <= MAX_VARIANCE_M2).then_some(bound)
}

/// Largest variance of a meaningful position in a room, 1σ of 100 m. Choice: beyond, the matrix is
/// singular but for rounding.
const MAX_VARIANCE_M2: f64 = 1e4;

/// Cholesky factor, in place, of a symmetric matrix's lower half; `None` when it is not positive
/// definite.
fn factor(lower: &mut [Vec<f64>]) -> Option<()> {
    for i in 0..lower.len() {
        let (above, from_here) = lower.split_at_mut(i);
        let row = &mut from_here[0];
        for (j, other) in above.iter().enumerate() {
            let sum: f64 = row[..j].iter().zip(&other[..j]).map(|(a, b)| a * b).sum();
            row[j] = (row[j] - sum) / other[j];
        }
        let rest = row[i] - row[..i].iter().map(|a| a * a).sum::<f64>();
        if rest.is_nan() || rest <= 0.0 {
            return None;
        }
        row[i] = rest.sqrt();
    }
    Some(())
}

fn solve_lower(lower: &[Vec<f64>], mut right: Vec<f64>) -> Vec<f64> {
    for (i, row) in lower.iter().enumerate() {
        let sum: f64 = row[..i].iter().zip(&right).map(|(a, b)| a * b).sum();
        right[i] = (right[i] - sum) / row[i];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::super::PositionErrors;
    use super::super::refine::{JITTER_S, PathFilter, Sight, correlation};
    use super::*;

    fn sights(phase: bool) -> Vec<BoundSight> {
        let sight = |k: usize| {
            let t = k as f64 * 0.07 + 0.02 * (k as f64 * 1.7).sin();
            let from = 0.3 * DVec3::new((1.3 * t).sin(), (2.1 * t).cos(), (0.9 * t).sin());
            BoundSight {
                time_s: t,
                toward: (DVec3::new(0.2, -0.1, -1.1) - from).normalize(),
                rotation: DQuat::from_scaled_axis(DVec3::new(0.3, 0.5, -0.1) * (0.8 * t).sin()),
                range_variance_m2: 4e-6 * (1.0 + 0.5 * (k as f64).sin()),
                phase_variance_m2: phase.then_some(1e-8 * (1.0 + 0.5 * (k as f64).cos())),
            }
        };
        (0..60).map(sight).collect()
    }

    /// Covariance from the path filter for the same sweeps.
    fn filtered(sights: &[BoundSight], errors: &PositionErrors) -> DMat3 {
        let mut filter = PathFilter::new(&DMat3::from_diagonal(DVec3::splat(100.0)), errors);
        for one in sights {
            let sight = Sight {
                time_s: one.time_s,
                toward: one.toward,
                toward_in_sensor: one.rotation.conjugate() * one.toward,
            };
            filter.advance(&sight);
            filter.update(&filter.predict(&sight, false, one.range_variance_m2), &[0.0], 0);
            if let Some(variance_m2) = one.phase_variance_m2 {
                filter.update(&filter.predict(&sight, true, variance_m2), &[0.0], 0);
            }
        }
        filter.place_covariance_m2()
    }

    #[test]
    fn the_filter_along_the_path_reaches_the_bound_of_its_own_model() {
        let errors = PositionErrors { jitter_m: 0.4e-3, ..Default::default() };
        let poses_m2 = |apart: f64| {
            errors.slow_variance_m2() * correlation(apart, errors.wander_s)
                + errors.jitter_m.powi(2) * (-apart / JITTER_S).exp()
        };
        for phase in [false, true] {
            let sights = sights(phase);
            let bound = cramer_rao_bound(&sights, poses_m2, errors.mount_variance_m2()).unwrap();
            let filtered = filtered(&sights, &errors);
            let largest = bound.to_cols_array().into_iter().fold(0.0f64, |a, b| a.max(b.abs()));
            // The filter's offset starts with a σ of 10 cm and not unbounded, its position with 10
            // m.
            let apart = (bound - filtered).to_cols_array().into_iter().fold(0.0f64, |a, b| a.max(b.abs()));
            assert!(apart < 1e-3 * largest, "{phase}: {bound} {filtered}");
        }
    }

    #[test]
    fn without_pose_errors_it_is_the_noise_over_the_geometry() {
        let sights = sights(false);
        let bound = cramer_rao_bound(&sights, |_| 0.0, 0.0).unwrap();
        let information = sights.iter().fold(DMat3::ZERO, |sum, s| sum + outer(s.toward) * (1.0 / s.range_variance_m2));
        assert!((bound * information - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-9));
        assert_eq!(cramer_rao_bound(&sights[..2], |_| 0.0, 0.0), None);
    }
}
