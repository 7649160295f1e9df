//! Vertices of a convex hull in space, incrementally: the faces that a new point sees are replaced
//! by a cone over their rim. Coplanar, collinear or coincident points have the hull of that
//! dimension.

use std::collections::BTreeMap;

use glam::DVec3;

/// Points this close to a face count as on it, in units of the hull's extent. Choice: above the
/// rounding of f64, far below any position's error.
const FLAT: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
struct Face {
    corners: [usize; 3],
    outward: DVec3,
    offset: f64,
}

/// Indices of the vertices of the points' convex hull, in rising order; of coincident points the
/// first. Points that are not finite are ignored.
pub fn hull_vertices(points: &[DVec3]) -> Vec<usize> {
    let all: Vec<usize> = (0..points.len()).filter(|&n| points[n].is_finite()).collect();
    let Some(&first) = all.first() else { return Vec::new() };
    let farthest = |of: &dyn Fn(DVec3) -> f64| {
        all.iter().fold((first, 0.0), |best, &n| if of(points[n]) > best.1 { (n, of(points[n])) } else { best })
    };
    // An extreme point, then in turn the point farthest from the point, line and plane of those
    // before.
    let start = farthest(&|p| p.distance(points[first])).0;
    let (second, extent) = farthest(&|p| p.distance(points[start]));
    let flat = FLAT * extent;
    let mut corners = match extent > 0.0 {
        false => vec![first],
        true => {
            let along = (points[second] - points[start]).normalize();
            let (third, width) = farthest(&|p| (p - points[start]).reject_from_normalized(along).length());
            let normal = along.cross(points[third] - points[start]).normalize_or_zero();
            let (fourth, height) = farthest(&|p| normal.dot(p - points[start]).abs());
            match (width > flat, height > flat) {
                (false, _) => vec![start, second],
                (true, false) => flat_hull(points, &all, along, normal.cross(along), flat * extent),
                (true, true) => solid_hull(points, &all, [start, second, third, fourth], flat),
            }
        }
    };
    corners.sort_unstable();
    corners
}

/// Andrew's monotone chain in the plane of two axes.
fn flat_hull(points: &[DVec3], all: &[usize], x: DVec3, y: DVec3, flat_area: f64) -> Vec<usize> {
    let at = |n: usize| (x.dot(points[n]), y.dot(points[n]));
    let mut order = all.to_vec();
    order.sort_by(|&a, &b| at(a).0.total_cmp(&at(b).0).then(at(a).1.total_cmp(&at(b).1)).then(a.cmp(&b)));
    let chain = |order: &mut dyn Iterator<Item = usize>| {
        let mut chain: Vec<usize> = Vec::new();
        for n in order {
            while let [.., a, b] = chain[..] {
                let ((ax, ay), (bx, by), (cx, cy)) = (at(a), at(b), at(n));
                if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > flat_area {
                    break;
                }
                chain.pop();
            }
            chain.push(n);
        }
        chain.pop();
        chain
    };
    let mut corners = chain(&mut order.iter().copied());
    corners.extend(chain(&mut order.iter().rev().copied()));
    corners
}

fn solid_hull(points: &[DVec3], all: &[usize], start: [usize; 4], flat: f64) -> Vec<usize> {
    let inside = start.iter().map(|&n| points[n]).sum::<DVec3>() / 4.0;
    let face = |corners: [usize; 3]| -> Option<Face> {
        let [a, b, c] = corners.map(|n| points[n]);
        let outward = (b - a).cross(c - a).try_normalize()?;
        let offset = outward.dot(a);
        Some(match outward.dot(inside) <= offset {
            true => Face { corners, outward, offset },
            false => Face { corners: [corners[0], corners[2], corners[1]], outward: -outward, offset: -offset },
        })
    };
    let [a, b, c, d] = start;
    let mut faces: Vec<Face> = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].into_iter().filter_map(face).collect();
    for &n in all {
        let sees = |f: &Face| f.outward.dot(points[n]) - f.offset > flat;
        if !faces.iter().any(sees) {
            continue;
        }
        // The rim: edges of visible faces whose other face is not visible.
        let mut edges: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        for Face { corners: [a, b, c], .. } in faces.iter().filter(|f| sees(f)) {
            for (p, q) in [(*a, *b), (*b, *c), (*c, *a)] {
                *edges.entry((p.min(q), p.max(q))).or_default() += 1;
            }
        }
        faces.retain(|f| !sees(f));
        faces.extend(edges.iter().filter(|(_, times)| **times == 1).filter_map(|(&(p, q), _)| face([p, q, n])));
    }
    let mut normals: BTreeMap<usize, Vec<DVec3>> = BTreeMap::new();
    for face in &faces {
        face.corners.iter().for_each(|&n| normals.entry(n).or_default().push(face.outward));
    }
    normals.into_iter().filter(|(_, around)| is_corner(around)).map(|(n, _)| n).collect()
}

/// Whether the normals of the faces around a point span all directions. A point on an edge or a
/// face, added before that face's vertices, remains in the faces but is no vertex.
fn is_corner(normals: &[DVec3]) -> bool {
    let greatest = |of: &dyn Fn(DVec3) -> f64| normals.iter().map(|&n| of(n)).fold(0.0, f64::max);
    let Some(&first) = normals.first() else { return false };
    let second = normals.iter().copied().max_by(|a, b| first.cross(*a).length().total_cmp(&first.cross(*b).length()));
    let across = first.cross(second.unwrap_or(first));
    greatest(&|n| across.dot(n).abs()) > 1e-12
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn corners_of_a_box_with_points_on_it_and_in_it() {
        let mut points: Vec<DVec3> = Vec::new();
        for n in 0..27 {
            points.push(DVec3::new(f64::from(n % 3), f64::from(n / 3 % 3), f64::from(n / 9)));
        }
        let expected: Vec<usize> = (0..27).filter(|n| [n % 3, n / 3 % 3, n / 9].iter().all(|c| c % 2 == 0)).collect();
        assert_eq!(hull_vertices(&points), expected);
    }

    #[test]
    fn flat_straight_and_coincident_points_have_the_hull_of_their_dimension() {
        let turned = |x: f64, y: f64| DVec3::new(x, y, 0.3 * x - 0.7 * y) + 100.0;
        let square: Vec<DVec3> = (0..9).map(|n| turned(f64::from(n % 3), f64::from(n / 3))).collect();
        assert_eq!(hull_vertices(&square), [0, 2, 6, 8]);
        let line: Vec<DVec3> = [3.0, 1.0, 5.0, 2.0].map(|x| DVec3::new(x, 2.0 * x, -x)).to_vec();
        assert_eq!(hull_vertices(&line), [1, 2]);
        assert_eq!(hull_vertices(&[DVec3::ONE; 4]), [0]);
        assert_eq!(hull_vertices(&[DVec3::NAN, DVec3::ONE]), [1]);
        assert_eq!(hull_vertices(&[]), [] as [usize; 0]);
    }

    proptest! {
        #[test]
        fn the_corners_are_those_that_are_extreme_in_some_direction(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64), 4..60),
        ) {
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from).collect();
            let corners = hull_vertices(&points);
            for n in 0..2000 {
                // Directions all over the sphere.
                let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 2000.0;
                let (sin, cos) = (2.399_963 * f64::from(n)).sin_cos();
                let direction = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                let reach = |n: usize| direction.dot(points[n]);
                let extreme = (0..points.len()).max_by(|&a, &b| reach(a).total_cmp(&reach(b))).unwrap();
                prop_assert!(corners.contains(&extreme), "{extreme} of {corners:?}");
            }
            // No vertex lies inside: each sticks out of the hull of the others.
            for &corner in corners.iter().take(5) {
                let others: Vec<DVec3> = points.iter().enumerate().filter(|o| o.0 != corner).map(|o| *o.1).collect();
                let mut with = others.clone();
                with.push(points[corner]);
                prop_assert!(hull_vertices(&with).contains(&others.len()));
            }
        }
    }
}
