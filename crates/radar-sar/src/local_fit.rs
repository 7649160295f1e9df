//! Local cubic least squares: the Savitzky–Golay filter (1964) for samples at uneven times,
//! evaluated between them.
//!
//! Fits x(t) = c0 + c1·t + c2·t² + c3·t³ to the samples around t = 0; c0 is the smoothed value, c1
//! its rate. With eleven samples at 120 Hz the noise of c0 falls to 0.46 of a sample's, and a cubic
//! motion passes unchanged.

/// Weights that turn sample values into the value at t = 0 and the rate there. `times_s` are
/// relative to the wanted time. The degree falls with the number of samples (cubic from 6,
/// quadratic from 4, else linear). `None` when there are fewer than two different times.
pub(super) fn value_and_rate_weights(times_s: &[f64]) -> Option<Vec<[f64; 2]>> {
    let terms = match times_s.len() {
        0 | 1 => return None,
        2 | 3 => 2,
        4 | 5 => 3,
        _ => 4,
    };
    // Times scaled to about ±1 keep the normal equations well conditioned.
    let scale = times_s.iter().fold(0.0f64, |m, t| m.max(t.abs()));
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let powers: Vec<[f64; 4]> = times_s
        .iter()
        .map(|t| {
            let u = t / scale;
            [1.0, u, u * u, u * u * u]
        })
        .collect();
    let mut normal = [[0.0; 4]; 4];
    for p in &powers {
        for row in 0..terms {
            for col in 0..terms {
                normal[row][col] += p[row] * p[col];
            }
        }
    }
    let value_row = solve(normal, terms, 0)?;
    let rate_row = solve(normal, terms, 1)?;
    let dot = |row: &[f64; 4], p: &[f64; 4]| (0..terms).map(|k| row[k] * p[k]).sum::<f64>();
    Some(powers.iter().map(|p| [dot(&value_row, p), dot(&rate_row, p) / scale]).collect())
}

/// Row `wanted` of the inverse of a symmetric positive matrix, by Gauss–Jordan elimination with
/// pivoting.
fn solve(mut matrix: [[f64; 4]; 4], size: usize, wanted: usize) -> Option<[f64; 4]> {
    let mut right = [0.0; 4];
    right[wanted] = 1.0;
    for col in 0..size {
        let pivot = (col..size).max_by(|&a, &b| matrix[a][col].abs().total_cmp(&matrix[b][col].abs()))?;
        if matrix[pivot][col].abs() < 1e-12 {
            return None;
        }
        matrix.swap(col, pivot);
        right.swap(col, pivot);
        for row in (0..size).filter(|&row| row != col) {
            let factor = matrix[row][col] / matrix[col][col];
            let pivot_row = matrix[col];
            for (value, pivot) in matrix[row][col..size].iter_mut().zip(&pivot_row[col..size]) {
                *value -= factor * pivot;
            }
            right[row] -= factor * right[col];
        }
    }
    for (row, value) in right.iter_mut().enumerate().take(size) {
        *value /= matrix[row][row];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_passes_unchanged() {
        let times: Vec<f64> = (0..11).map(|i| (f64::from(i) - 4.3) / 120.0).collect();
        let x = |t: f64| 1.0 - 2.0 * t + 30.0 * t * t - 400.0 * t * t * t;
        let weights = value_and_rate_weights(&times).unwrap();
        let value: f64 = weights.iter().zip(&times).map(|(w, &t)| w[0] * x(t)).sum();
        let rate: f64 = weights.iter().zip(&times).map(|(w, &t)| w[1] * x(t)).sum();
        assert!((value - 1.0).abs() < 1e-9 && (rate + 2.0).abs() < 1e-6, "{value} {rate}");
    }

    #[test]
    fn noise_gain_matches_savitzky_golay() {
        let times: Vec<f64> = (-5..=5).map(|i| f64::from(i) / 120.0).collect();
        let power: f64 = value_and_rate_weights(&times).unwrap().iter().map(|w| w[0] * w[0]).sum();
        assert!((power - 89.0 / 429.0).abs() < 1e-9, "{power}");
    }

    #[test]
    fn too_few_distinct_times_give_none() {
        assert!(value_and_rate_weights(&[0.0]).is_none());
        assert!(value_and_rate_weights(&[0.0, 0.0]).is_none());
    }
}
