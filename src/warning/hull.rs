//! Convex hull in the plane by Andrew's monotone chain: sort by x, then y; walk the lower and the upper side, dropping every
//! corner that does not turn left. O(n log n).

use glam::DVec2;

/// Corners of the convex hull, counter-clockwise in a plane of x to the right and y up, without collinear or double ones.
/// One point gives one corner, points on a line give two. Points that are not finite are left out.
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted: Vec<DVec2> = points.iter().copied().filter(|p| p.is_finite()).collect();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull = half(sorted.iter().copied());
    hull.pop();
    let mut upper = half(sorted.iter().rev().copied());
    upper.pop();
    hull.append(&mut upper);
    hull
}

/// One side of the hull, both ends included.
fn half(points: impl Iterator<Item = DVec2>) -> Vec<DVec2> {
    let mut chain: Vec<DVec2> = Vec::new();
    for point in points {
        while let [.., a, b] = chain[..] {
            if (b - a).perp_dot(point - b) > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(point);
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn degenerate_sets_give_what_there_is() {
        assert_eq!(convex_hull(&[]), vec![]);
        assert_eq!(convex_hull(&[DVec2::ONE, DVec2::ONE]), vec![DVec2::ONE]);
        let line: Vec<DVec2> = (0..5).map(|i| DVec2::splat(f64::from(i))).collect();
        assert_eq!(convex_hull(&line), vec![DVec2::ZERO, DVec2::splat(4.0)]);
        assert_eq!(convex_hull(&[DVec2::NAN]), vec![]);
    }

    #[test]
    fn a_square_keeps_its_corners_counter_clockwise() {
        let square = [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.0, 1.0), (1.0, 0.0), (0.5, 0.0)];
        let hull = convex_hull(&square.map(DVec2::from));
        assert_eq!(hull, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(DVec2::from));
    }

    proptest! {
        #[test]
        fn every_point_is_inside(points in prop::collection::vec(prop::array::uniform2(-2.0..2.0f64), 3..60)) {
            let points: Vec<DVec2> = points.into_iter().map(DVec2::from).collect();
            let hull = convex_hull(&points);
            for (i, &a) in hull.iter().enumerate() {
                let b = hull[(i + 1) % hull.len()];
                for &p in &points {
                    prop_assert!((b - a).perp_dot(p - a) >= -1e-9);
                }
            }
        }
    }
}
