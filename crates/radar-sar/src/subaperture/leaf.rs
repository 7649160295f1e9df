//! Partitions a sub-aperture's sweeps into leaves: runs along which the sensor moved in a straight
//! line of bounded length.
//!
//! Leaves are the lowest level of the factorised backprojection. Over a small box of points a leaf
//! acts as one unit: its sum depends only on the distance from the leaf's middle and on the cosine
//! to its direction of motion. How long a leaf may be follows from how much the cosine varies over
//! the box.

use super::kernel::Group;
use crate::simd::LANES;

/// Consecutive sweeps that act as one unit.
#[derive(Debug, Clone)]
pub(super) struct Leaf {
    pub first: usize,
    pub end: usize,
    /// Mean sensor position over its sweeps, relative to the sub-aperture's middle.
    pub position_m: [f32; 3],
    /// Mean velocity.
    pub velocity_m_per_s: [f32; 3],
    /// Unit vector of the motion; zero when the sensor did not move.
    pub along: [f32; 3],
    /// Greatest distance of a sweep from the mean position along the motion.
    pub half_length_m: f32,
}

impl Leaf {
    /// One over the number of its sweeps.
    pub fn share(&self) -> f32 {
        1.0 / (self.end - self.first) as f32
    }
}

/// All sweeps of a sub-aperture, partitioned into leaves.
#[derive(Debug, Clone)]
pub(super) struct Partition {
    pub runs: Vec<Leaf>,
    /// `[sweep]`: signed distance along its leaf's direction from the leaf's mean position.
    pub offset_m: Vec<f32>,
}

/// Greatest lateral distance of a sweep from its leaf's line, as a share of the half-length.
/// Choice: a tenth of the phase that the leaf's length is bounded by, 0.05 rad.
const MAX_LATERAL_SHARE: f32 = 0.1;

/// Greedy partition from the first sweep on, each leaf with a half-length of at most
/// `half_length_m`. A leaf of one sweep is always allowed.
pub(super) fn partition(groups: &[Group], sweep_count: usize, half_length_m: f32) -> Partition {
    let positions: Vec<[f32; 3]> = per_sweep(groups, sweep_count, |group| &group.position_m);
    let velocities: Vec<[f32; 3]> = per_sweep(groups, sweep_count, |group| &group.velocity_m_per_s);
    let mut found = Partition { runs: Vec::new(), offset_m: vec![0.0; sweep_count] };
    let mut first = 0;
    while first < sweep_count {
        let mut line = Line::through(&positions[first..=first]);
        let mut end = first + 1;
        // Constant steps forward while they fit, then halved steps: finds a long run without trying
        // every length.
        let mut step = 4;
        while step > 0 && end < sweep_count {
            let longer = Line::through(&positions[first..(end + step).min(sweep_count)]);
            if longer.half_length_m <= half_length_m && longer.lateral_m <= MAX_LATERAL_SHARE * half_length_m {
                (line, end) = (longer, (end + step).min(sweep_count));
            } else {
                step /= 2;
            }
        }
        for (offset, position) in found.offset_m[first..end].iter_mut().zip(&positions[first..end]) {
            *offset = dot(minus(*position, line.middle_m), line.along);
        }
        found.runs.push(Leaf {
            first,
            end,
            position_m: line.middle_m,
            velocity_m_per_s: mean(&velocities[first..end]),
            along: line.along,
            half_length_m: line.half_length_m,
        });
        first = end;
    }
    found
}

/// From lanes to one vector per sweep.
fn per_sweep(groups: &[Group], count: usize, of: impl Fn(&Group) -> &[[f32; LANES]; 3]) -> Vec<[f32; 3]> {
    (0..count).map(|k| std::array::from_fn(|axis| of(&groups[k / LANES])[axis][k % LANES])).collect()
}

/// A line through positions, and their greatest distances from its middle along and beside it.
struct Line {
    middle_m: [f32; 3],
    along: [f32; 3],
    half_length_m: f32,
    lateral_m: f32,
}

impl Line {
    fn through(places: &[[f32; 3]]) -> Self {
        let middle_m = mean(places);
        let way = minus(places[places.len() - 1], places[0]);
        let length = dot(way, way).sqrt();
        let along = if length > 1e-7 { way.map(|x| x / length) } else { [0.0; 3] };
        let (mut half_length_m, mut beside2) = (0.0f32, 0.0f32);
        for place in places {
            let from = minus(*place, middle_m);
            let offset = dot(from, along);
            half_length_m = half_length_m.max(offset.abs());
            beside2 = beside2.max(dot(from, from) - offset * offset);
        }
        Self { middle_m, along, half_length_m, lateral_m: beside2.max(0.0).sqrt() }
    }
}

fn mean(vectors: &[[f32; 3]]) -> [f32; 3] {
    let count = vectors.len() as f32;
    std::array::from_fn(|axis| vectors.iter().map(|v| v[axis]).sum::<f32>() / count)
}

#[inline(always)]
pub(super) fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups(path: impl Fn(f32) -> [f32; 3], count: usize) -> Vec<Group> {
        let lane = |k: usize| path(k.min(count - 1) as f32 * 1e-3);
        let group = |g: usize| Group {
            position_m: std::array::from_fn(|axis| std::array::from_fn(|l| lane(g * LANES + l)[axis])),
            velocity_m_per_s: [[0.5; LANES]; 3],
        };
        (0..count.div_ceil(LANES)).map(group).collect()
    }

    #[test]
    fn leaves_are_contiguous_and_within_bounds() {
        let path = |t: f32| [0.05 * (20.0 * t).sin(), 0.05 * (20.0 * t).cos(), 0.2 * t];
        let groups = groups(path, 90);
        let mut fewer = usize::MAX;
        for half_length_m in [5e-4, 2e-3, 8e-3, 3e-2] {
            let found = partition(&groups, 90, half_length_m);
            assert_eq!((found.runs[0].first, found.runs[found.runs.len() - 1].end), (0, 90));
            assert!(found.runs.windows(2).all(|pair| pair[0].end == pair[1].first));
            for run in found.runs.iter().filter(|run| run.end - run.first > 1) {
                assert!(run.half_length_m <= half_length_m, "{run:?}");
                for k in run.first..run.end {
                    let from = minus(path(k as f32 * 1e-3), run.position_m);
                    let on_line = run.along.map(|u| u * found.offset_m[k]);
                    let beside = minus(from, on_line);
                    assert!(dot(beside, beside).sqrt() <= 0.11 * half_length_m, "{run:?} {k}");
                }
            }
            assert!(found.runs.len() < fewer);
            fewer = found.runs.len();
        }
        assert!(fewer <= 12, "{fewer}");
    }

    #[test]
    fn stationary_sensor_gives_one_leaf() {
        let found = partition(&groups(|_| [0.1, 0.0, 0.0], 40), 40, 1e-3);
        assert_eq!(found.runs.len(), 1);
        assert_eq!(found.runs[0].along, [0.0; 3]);
    }
}
