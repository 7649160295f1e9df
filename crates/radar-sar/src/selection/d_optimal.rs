//! D-optimal selection: greedily takes the sweep that adds most information about a point.
//!
//! A range carries information about a point along u, the direction to it; Σ u uᵀ is the
//! information of all. Adding a sweep multiplies the determinant by 1 + uᵀ M⁻¹ u, so the next sweep
//! is the one with the greatest uᵀ M⁻¹ u; of equals the oldest.

use glam::{DMat3, DVec3};

use super::first_best;

/// Prior information in each direction. Choice: less than one sweep gives at an angle of a
/// thousandth of a radian; it only makes the first inverse exist.
const PRIOR: f64 = 1e-6;

/// Indices of `count` positions, in rising order; all when there are no more.
pub fn d_optimal(positions: &[DVec3], place: DVec3, count: usize) -> Vec<usize> {
    if positions.len() <= count {
        return (0..positions.len()).collect();
    }
    let directions: Vec<DVec3> = positions.iter().map(|p| (place - *p).normalize_or_zero()).collect();
    let mut free = vec![true; positions.len()];
    let mut inverse = DMat3::IDENTITY * (1.0 / PRIOR);
    let mut chosen = Vec::with_capacity(count);
    while chosen.len() < count {
        let gain = |(u, free): (&DVec3, &bool)| if *free { u.dot(inverse * *u) } else { f64::NEG_INFINITY };
        let next = first_best(directions.iter().zip(&free).map(gain));
        free[next] = false;
        chosen.push(next);
        // Sherman–Morrison: the inverse after adding u uᵀ.
        let told = inverse * directions[next];
        let outer = DMat3::from_cols(told * told.x, told * told.y, told * told.z);
        inverse -= outer * (1.0 / (1.0 + directions[next].dot(told)));
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn determinant(positions: &[DVec3], place: DVec3, chosen: &[usize]) -> f64 {
        let outer = |n: &usize| {
            let u = (place - positions[*n]).normalize();
            DMat3::from_cols(u * u.x, u * u.y, u * u.z)
        };
        chosen.iter().map(outer).fold(DMat3::IDENTITY * PRIOR, |a, b| a + b).determinant()
    }

    #[test]
    fn greedy_choice_is_close_to_the_best_four_of_ten() {
        let place = DVec3::new(0.1, 0.0, -1.5);
        let at = |n: usize| crate::test_data::winding(n as f64 * 0.37);
        let positions: Vec<DVec3> = (0..10).map(at).collect();
        let mut best: f64 = 0.0;
        for bits in 0u32..1024 {
            let some: Vec<usize> = (0..10).filter(|n| bits >> n & 1 == 1).collect();
            if some.len() == 4 {
                best = best.max(determinant(&positions, place, &some));
            }
        }
        let greedy = determinant(&positions, place, &d_optimal(&positions, place, 4));
        assert!(greedy > 0.6 * best, "{greedy} of {best}");
    }

    #[test]
    fn coincident_positions_and_the_place_itself_do_no_harm() {
        let positions = [DVec3::ONE; 6];
        assert_eq!(d_optimal(&positions, DVec3::ONE, 3).len(), 3);
        assert_eq!(d_optimal(&positions, DVec3::ZERO, 3).len(), 3);
    }
}
