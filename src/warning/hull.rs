//! Convex hull in the plane by Andrew's monotone chain: sorts by x, then y, and walks the lower and
//! the upper side, dropping every corner that does not turn left. O(n log n).

use glam::DVec2;

/// Corners of the convex hull, counter-clockwise with x to the right and y up, without collinear or
/// duplicate points. One point gives one corner, collinear points give two. Points that are not
/// finite are ignored.
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted: Vec<DVec2> = points.iter().copied().filter(|p| p.is_finite()).collect();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull = monotone_chain(sorted.iter().copied());
    hull.pop();
    let mut upper = monotone_chain(sorted.iter().rev().copied());
    upper.pop();
    hull.append(&mut upper);
    hull
}

/// Points of a square lattice through the origin that lie within a convex polygon, row by row from
/// below. `hull` is counter-clockwise.
pub(super) fn lattice_within(hull: &[DVec2], step: f64) -> impl Iterator<Item = DVec2> {
    let (low, high) =
        hull.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c.y), high.max(c.y)));
    steps_within((low, high), step).flat_map(move |row| {
        let y = f64::from(row) * step;
        steps_within(row_extent(hull, y), step).map(move |column| DVec2::new(f64::from(column) * step, y))
    })
}

/// Largest number of steps across a polygon; more give an empty range. Choice: an outline as wide
/// as a street is no obstacle in a room.
const MAX_STEPS: f64 = 500.0;

/// Whole steps from one number to another; empty for numbers that are not finite and for too many
/// steps.
fn steps_within((from, to): (f64, f64), step: f64) -> std::ops::Range<i32> {
    let (from, to) = ((from / step).ceil(), (to / step).floor());
    if to - from < MAX_STEPS && from.abs() < 1e9 { from as i32..to as i32 + 1 } else { 0..0 }
}

/// Extent in x of a convex polygon at height y.
fn row_extent(hull: &[DVec2], y: f64) -> (f64, f64) {
    let edges = (0..hull.len()).map(|n| (hull[n], hull[(n + 1) % hull.len()]));
    let crossed = edges.filter(|(a, b)| a.y.min(b.y) <= y && y <= a.y.max(b.y) && a.y != b.y);
    crossed
        .map(|(a, b)| a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// One side of the hull, both ends included.
fn monotone_chain(points: impl Iterator<Item = DVec2>) -> Vec<DVec2> {
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
    fn degenerate_point_sets_give_their_points() {
        assert_eq!(convex_hull(&[]), vec![]);
        assert_eq!(convex_hull(&[DVec2::ONE, DVec2::ONE]), vec![DVec2::ONE]);
        let line: Vec<DVec2> = (0..5).map(|i| DVec2::splat(f64::from(i))).collect();
        assert_eq!(convex_hull(&line), vec![DVec2::ZERO, DVec2::splat(4.0)]);
        assert_eq!(convex_hull(&[DVec2::NAN]), vec![]);
    }

    #[test]
    fn square_hull_is_counter_clockwise() {
        let square = [(0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.0, 1.0), (1.0, 0.0), (0.5, 0.0)];
        let hull = convex_hull(&square.map(DVec2::from));
        assert_eq!(hull, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(DVec2::from));
    }

    #[test]
    fn lattice_covers_exactly_the_triangle() {
        let triangle = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(DVec2::from);
        let filled: Vec<_> = lattice_within(&triangle, 0.1).collect();
        assert!((60..=66).contains(&filled.len()), "{}", filled.len());
        assert!(filled.iter().all(|p| p.min_element() >= -1e-9 && p.x + p.y <= 1.0 + 1e-9));
        assert_eq!(lattice_within(&[], 0.1).count(), 0);
        assert_eq!(lattice_within(&triangle[..1], 0.1).count(), 0);
        let street = triangle.map(|corner| corner * 1e3);
        assert_eq!(lattice_within(&street, 0.1).count(), 0, "however wide an object is reported, it costs nothing");
        let line = [DVec2::ZERO, DVec2::new(0.0, 0.5)];
        assert_eq!(lattice_within(&line, 0.1).count(), 6, "a pole's parts are joined by a line");
    }

    proptest! {
        #[test]
        fn hull_contains_all_points(points in prop::collection::vec(prop::array::uniform2(-2.0..2.0f64), 3..60)) {
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
