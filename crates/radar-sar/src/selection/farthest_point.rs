//! Farthest-point selection: starts with the sweep nearest to the mean of all sensor positions,
//! then repeatedly takes the sweep farthest from its nearest selected neighbour. Spreads the
//! aperture as widely as possible; of equals the oldest.

use glam::DVec3;

use super::first_best;

/// Indices of `count` positions, in rising order; all when there are no more.
pub fn farthest_points(positions: &[DVec3], count: usize) -> Vec<usize> {
    if positions.len() <= count {
        return (0..positions.len()).collect();
    }
    if count == 0 {
        return Vec::new();
    }
    let middle = positions.iter().copied().sum::<DVec3>() / positions.len() as f64;
    let mut next = first_best(positions.iter().map(|p| -p.distance_squared(middle)));
    let mut nearest_chosen = vec![f64::INFINITY; positions.len()];
    let mut chosen = Vec::with_capacity(count);
    while chosen.len() < count {
        chosen.push(next);
        for (distance, p) in nearest_chosen.iter_mut().zip(positions) {
            *distance = distance.min(p.distance_squared(positions[next]));
        }
        // A selected sweep is never selected again, even among coincident positions.
        nearest_chosen[next] = f64::NEG_INFINITY;
        next = first_best(nearest_chosen.iter().copied());
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_line_are_kept() {
        let line: Vec<_> = (0..101).map(|i| DVec3::X * f64::from(i)).collect();
        assert_eq!(farthest_points(&line, 3), vec![0, 50, 100]);
        assert_eq!(farthest_points(&line[..2], 5), vec![0, 1]);
    }

    #[test]
    fn coincident_positions_are_chosen_once_each() {
        let mut chosen = farthest_points(&[DVec3::ONE; 10], 4);
        chosen.dedup();
        assert_eq!(chosen.len(), 4);
    }
}
