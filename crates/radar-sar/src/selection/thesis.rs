//! The thesis's thinning (3.4.1): by amplitude (eq. 3.6), and by the convex hull as well (eq. 3.7).
//!
//! Y = {x ∈ X | max(x) ≥ T · x_max}, and Y = {x ∈ X_hull | max(x) ≥ T · x_max}. X_hull are the
//! sweeps whose positions are vertices of the convex hull of all positions. The requested number is
//! then drawn from Y at random; a smaller Y is used completely.

use glam::DVec3;

use super::hull_vertices;

/// T. The thesis gives no value. Choice: half of the greatest amplitude keeps sweeps within 6 dB of
/// the best one.
pub const THRESHOLD_COEFFICIENT: f64 = 0.5;

/// Eq. 3.6: indices of the sweeps whose greatest amplitude is at least `coefficient` times the
/// greatest of all.
pub fn above_threshold(peak_amplitudes: &[f64], coefficient: f64) -> Vec<usize> {
    let threshold = coefficient * peak_amplitudes.iter().copied().fold(0.0, f64::max);
    (0..peak_amplitudes.len()).filter(|&n| peak_amplitudes[n] >= threshold).collect()
}

/// Eq. 3.7: those of eq. 3.6 that are vertices of the convex hull of all positions.
pub fn hull_above_threshold(positions: &[DVec3], peak_amplitudes: &[f64], coefficient: f64) -> Vec<usize> {
    let strong = above_threshold(peak_amplitudes, coefficient);
    let hull = hull_vertices(positions);
    strong.into_iter().filter(|n| hull.binary_search(n).is_ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_a_share_of_the_greatest_amplitude_of_all() {
        assert_eq!(above_threshold(&[1.0, 5.0, 4.9, 10.0], 0.5), [1, 3]);
        assert_eq!(above_threshold(&[], 0.5), [] as [usize; 0]);
    }

    #[test]
    fn the_hull_is_that_of_all_sweeps_strong_or_not() {
        // A tetrahedron with a point inside. Its weak vertex is dropped; the strong point inside
        // does not replace it.
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::splat(0.2)];
        assert_eq!(hull_above_threshold(&positions, &[1.0, 0.1, 1.0, 1.0, 1.0], 0.5), [0, 2, 3]);
    }
}
