//! Geometry of one sweep and a brick's voxels, each voxel separately: at an edge of range or beam, or
//! where the brick is too large or too near for an expansion.

use super::brick_geometry::{BrickShape, EDGE, Offsets, Sight};
use super::sweep_stack::{Group, SweepStack, WIDE_WINDOW};
use crate::simd::{LANES, Lanes, add3, dot, load3, scale3, splat3, sub3};

/// Greatest error of a distance where no phase depends on it, metres. Choice: a value is then off by at
/// most 0.36 % of the peak of the narrowest pulse (40 mm), about as much as by the table's interpolation.
pub(super) const DISTANCE_ERROR_M: f64 = 1e-4;

/// Geometry of one sweep and a brick's voxels, each voxel separately.
pub(super) struct Edges<'a, S: Lanes> {
    stack: &'a SweepStack,
    from_pose: Exact<S>,
    along: Along<S>,
    first: S::F,
    last: S::F,
    /// If the sensor moves while it samples: the centre relative to its pose, its velocity, and the
    /// sampling times (per metre and at zero).
    moving: Option<([f32; 3], [f32; 3], [f32; 2])>,
}

impl<'a, S: Lanes> Edges<'a, S> {
    #[inline(always)]
    pub(super) fn new(
        s: S,
        stack: &'a SweepStack,
        group: usize,
        center: [f32; 3],
        l: usize,
        offsets: &Offsets<S>,
        heights: [f32; EDGE],
    ) -> Self {
        let sweeps = &stack.groups[group];
        let from_pose = from_pose(sweeps, center, l);
        let velocity = lane_vector(&sweeps.velocity_m_per_s, l);
        let mut moving = None;
        if velocity != [0.0; 3] {
            moving = Some((from_pose, velocity, [sweeps.time_s_per_m[l], sweeps.time_at_zero_s[l]]));
        }
        Self {
            stack,
            from_pose: Exact::new(s, from_pose, offsets, heights),
            along: Along::new(s, from_pose, lane_vector(&sweeps.forward, l), offsets, heights),
            // A point at the sensor itself has no direction and does not count.
            first: s.splat(sweeps.first_m[l].max(f32::MIN_POSITIVE)),
            last: s.splat(sweeps.last_m[l]),
            moving,
        }
    }

    /// One layer's voxels.
    #[inline(always)]
    pub(super) fn layer(&self, s: S, offsets: &Offsets<S>, layer: usize) -> AtEdge<S> {
        let pose_distance = s.sqrt(self.from_pose.squares(s, layer));
        let mut distance = pose_distance;
        if let Some(([x, y, z], velocity, [time_per_m, time_at_zero])) = self.moving {
            // The time at which points at about this range were sampled, and the sensor's
            // displacement by then.
            let time = s.mul_add(pose_distance, s.splat(time_per_m), s.splat(time_at_zero));
            let from_pose = add3(s, offsets.layer(layer), splat3(s, [x, y, z]));
            let from = sub3(s, from_pose, scale3(s, splat3(s, velocity), time));
            distance = s.sqrt(dot(s, from, from));
        }
        let mut counts = s.and(s.at_most(self.first, distance), s.at_most(distance, self.last));
        let mut along = pose_distance;
        if !self.stack.beam.uniform {
            along = self.along.at(s, layer);
            if self.stack.beam.cut_cos > -1.0 {
                counts = s.and(counts, s.at_most(s.mul(pose_distance, s.splat(self.stack.beam.cut_cos)), along));
            }
        }
        AtEdge { distance, pose_distance, along, counts }
    }
}

/// One sweep's geometry at one layer's voxels, each separately.
pub(super) struct AtEdge<S: Lanes> {
    /// Distance from the sensor when it sampled points at about this range.
    pub distance: S::F,
    /// Distance from the sweep's pose, and its component along the boresight.
    pub pose_distance: S::F,
    pub along: S::F,
    /// Which voxels lie within range and beam.
    pub counts: S::M,
}

impl<S: Lanes> AtEdge<S> {
    /// Cosine to the boresight.
    #[inline(always)]
    pub(super) fn cos(&self, s: S) -> S::F {
        let cos = s.div(self.along, s.max(self.pose_distance, s.splat(1e-9)));
        s.min(s.max(cos, s.splat(-1.0)), s.splat(1.0))
    }
}

/// Table positions of the voxels of the four layers: the entry before, and the fraction beyond it.
pub(super) type Places<S> = [(<S as Lanes>::I, <S as Lanes>::F); EDGE];

/// A table's values at these positions, linear between entries.
#[inline(always)]
pub(super) fn read<S: Lanes>(s: S, table: &[f32], sight: &Sight, l: usize, places: &Places<S>) -> [S::F; EDGE] {
    let mut values = [s.splat(0.0); EDGE];
    if let Some((first, window)) = wide_window::<S>(table, sight, l) {
        // One window for all lookups, which stays in registers.
        let (here, next) = (s.splat_int(-first), s.splat_int(1 - first));
        for (value, &(n, rest)) in values.iter_mut().zip(places) {
            let (here, next) = (s.add_int(n, here), s.add_int(n, next));
            let (here, next) = (s.look_up(window, here), s.look_up(window, next));
            *value = s.mul_add(rest, s.sub(next, here), here);
        }
        return values;
    }
    for (value, &(n, rest)) in values.iter_mut().zip(places) {
        let (here, next) = s.gather_pairs(table, n);
        *value = s.mul_add(rest, s.sub(next, here), here);
    }
    values
}

/// The window with all entries that a brick needs, and its first entry; `None` where the brick
/// spans too many, or gathers are faster.
#[inline(always)]
fn wide_window<'a, S: Lanes>(table: &'a [f32], sight: &Sight, l: usize) -> Option<(i32, &'a [f32; WIDE_WINDOW])> {
    if !S::WIDE_WINDOWS || sight.wide >> l & 1 == 0 {
        return None;
    }
    // Moved down at the end of the table.
    let first = (sight.windows.first[l] as usize).min(table.len().checked_sub(WIDE_WINDOW)?);
    Some((first as i32, table.get(first..)?.first_chunk()?))
}

/// Lanes at an edge whose voxels all count nevertheless: the brick is only too large or too near
/// for the expansion. The direction to the sensor must be nearly constant within it, as far as the
/// sensor's motion matters.
#[inline(always)]
pub(super) fn fully_visible<S: Lanes>(
    s: S,
    stack: &SweepStack,
    group: usize,
    (sight, pose): (&Sight, &FromPoses<S>),
    shape: &BrickShape,
) -> u16 {
    if !stack.beam.solid {
        return 0;
    }
    let sweeps = &stack.groups[group];
    let distance = s.load(&sight.distance_m);
    let (radius, half) = (s.splat(shape.radius_m), s.splat(shape.half_m));
    // Ranges: at least the tangent plane's, at most that plus the curvature.
    let slack = s.mul_add(s.abs(s.sub(s.load(&sight.stretch), s.splat(1.0))), radius, s.splat(1e-5));
    let reach = s.mul_add(extent(s, load3(s, &sight.toward)), half, slack);
    let bend = s.mul(s.mul(radius, radius), s.load(&sight.half_per_m));
    let (near, far) = (s.sub(distance, reach), s.add(distance, s.add(reach, bend)));
    let mut whole = s.and(s.at_most(s.load(&sweeps.first_m), near), s.at_most(far, s.load(&sweeps.last_m)));
    whole = s.and(whole, s.at_most(s.splat(1e-3), near));
    // Over the brick the direction turns by up to ρ/d, and the motion's contribution to the
    // distance changes by that share.
    let speed = extent(s, load3(s, &sweeps.velocity_m_per_s));
    let moved = s.mul(speed, s.mul(s.load(&sweeps.time_s_per_m), s.splat(shape.radius_m * shape.radius_m)));
    whole = s.and(whole, s.at_most(moved, s.mul(distance, s.splat(DISTANCE_ERROR_M as f32))));
    if stack.beam.cut_cos > -1.0 {
        // Component along the boresight against the cut's share of the distance: the least of the
        // former, the greatest of the latter.
        let reach = s.mul_add(extent(s, load3(s, &sweeps.forward)), half, s.splat(1e-5));
        let along = s.sub(s.mul(pose.cos, pose.distance), reach);
        let least = s.mul(s.splat(stack.beam.cut_cos), s.add(pose.distance, s.splat(shape.radius_m + 1e-5)));
        whole = s.and(whole, s.at_most(s.max(least, s.splat(0.0)), along));
    }
    s.mask_bits(whole)
}

/// |x| + |y| + |z|: the extent of a box with half-edges of 1 along a unit vector.
#[inline(always)]
pub(super) fn extent<S: Lanes>(s: S, [x, y, z]: [S::F; 3]) -> S::F {
    s.add(s.add(s.abs(x), s.abs(y)), s.abs(z))
}

/// Exact distances of a brick's voxels from a point: |p + δ|², layer by layer.
pub(super) struct Exact<S: Lanes> {
    flat: S::F,
    up: [f32; EDGE],
}

impl<S: Lanes> Exact<S> {
    /// Of a brick whose centre lies at `from` relative to the point.
    #[inline(always)]
    pub(super) fn new(s: S, [x, y, z]: [f32; 3], offsets: &Offsets<S>, heights: [f32; EDGE]) -> Self {
        let (x, y) = (s.add(offsets.x, s.splat(x)), s.add(offsets.y, s.splat(y)));
        let [a, b, c, d] = [heights[0] + z, heights[1] + z, heights[2] + z, heights[3] + z];
        Self { flat: s.mul_add(x, x, s.mul(y, y)), up: [a * a, b * b, c * c, d * d] }
    }

    /// Squared distances of a layer.
    #[inline(always)]
    pub(super) fn squares(&self, s: S, layer: usize) -> S::F {
        s.add(self.flat, s.splat(self.up[layer]))
    }
}

/// Component along a direction, layer by layer: (p + δ)·b.
struct Along<S: Lanes> {
    flat: S::F,
    up: [f32; EDGE],
}

impl<S: Lanes> Along<S> {
    #[inline(always)]
    fn new(s: S, [x, y, z]: [f32; 3], [bx, by, bz]: [f32; 3], offsets: &Offsets<S>, heights: [f32; EDGE]) -> Self {
        let (x, y) = (s.add(offsets.x, s.splat(x)), s.add(offsets.y, s.splat(y)));
        let [a, b, c, d] = [heights[0] + z, heights[1] + z, heights[2] + z, heights[3] + z];
        Self { flat: s.mul_add(x, s.splat(bx), s.mul(y, s.splat(by))), up: [a * bz, b * bz, c * bz, d * bz] }
    }

    #[inline(always)]
    fn at(&self, s: S, layer: usize) -> S::F {
        s.add(self.flat, s.splat(self.up[layer]))
    }
}

/// A brick's centre as seen from the poses in the middle of sixteen sweeps.
pub(super) struct FromPoses<S: Lanes> {
    pub distance: S::F,
    /// Cosine to the boresight.
    pub cos: S::F,
}

impl<S: Lanes> FromPoses<S> {
    #[inline(always)]
    pub(super) fn new(s: S, sweeps: &Group, center: [f32; 3]) -> Self {
        let from_pose = sub3(s, splat3(s, center), load3(s, &sweeps.position_m));
        let distance = s.sqrt(dot(s, from_pose, from_pose));
        let along = dot(s, from_pose, load3(s, &sweeps.forward));
        Self { distance, cos: s.div(along, s.max(distance, s.splat(1e-6))) }
    }
}

/// Vector from the pose in the middle of sweep `l` to a brick's centre.
#[inline(always)]
pub(super) fn from_pose(sweeps: &Group, center: [f32; 3], l: usize) -> [f32; 3] {
    let [x, y, z] = lane_vector(&sweeps.position_m, l);
    [center[0] - x, center[1] - y, center[2] - z]
}

/// One lane of three vectors.
#[inline(always)]
pub(super) fn lane_vector(v: &[[f32; LANES]; 3], l: usize) -> [f32; 3] {
    [v[0][l], v[1][l], v[2][l]]
}

/// Vector to the brick's centre from the sensor when it sampled points at its range.
#[inline(always)]
pub(super) fn from_sensor(sight: &Sight, l: usize) -> [f32; 3] {
    let ([x, y, z], distance) = (lane_vector(&sight.toward, l), sight.distance_m[l]);
    [x * distance, y * distance, z * distance]
}
