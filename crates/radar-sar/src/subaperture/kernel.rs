//! Exact inner loop: coherent sum and incoherent energy of one sub-aperture, point by point.
//!
//! Sixteen sweeps are processed in lanes, so a point's distances, table rows and phases are whole
//! vectors read contiguously, without gathers: over sixteen sweeps a point stays within a few table
//! entries of the middle one, and a parabola through that entry and its neighbours covers that
//! distance. Where a point lies near an end of the range axis, or the sensor jumped, a checked copy
//! of the loop tests each lane. All in f32: positions are relative to the sub-aperture's middle,
//! distances stay below a few metres, and phase is reduced to ±½ turn before the sine, or turned
//! from one parallel plane to the next. m agrees with the oracle to 1 % of itself plus 0.02.
//!
//! For single points and planes. Volumes use `brick`, which handles many sweeps at a time.

use super::Subaperture;
use crate::WAVELENGTH_M;
use crate::simd::{Kernel, LANES, Lanes, ROUNDER, dot, load3, on_widest, splat3, sub3};

pub(super) const HALF_TURNS_PER_M: f32 = crate::HALF_TURNS_PER_M as f32;

/// Positions and velocities of sixteen consecutive sweeps, relative to the sub-aperture's middle;
/// the last lanes may repeat a sweep.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// `[axis][sweep]`, metres.
    pub position_m: [[f32; LANES]; 3],
    /// `[axis][sweep]`.
    pub velocity_m_per_s: [[f32; LANES]; 3],
}

/// One sub-aperture's measurement at a point or plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Coherence {
    /// m: coherent power over max(1, incoherent power).
    pub m: f32,
    /// P: coherent power; noise gives 1.
    pub power: f32,
}

/// A plane relative to a sub-aperture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneAt {
    /// Unit normal, pointing towards the plane.
    pub toward: [f32; 3],
    /// Its distance from the sub-aperture's middle, metres.
    pub distance_m: f32,
}

/// Parallel planes, evenly spaced, relative to a sub-aperture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParallelPlanes {
    /// Unit normal, pointing towards the planes.
    pub toward: [f32; 3],
    /// Distance of the first plane from the sub-aperture's middle, metres.
    pub first_m: f32,
    /// Distance from one plane to the next, metres.
    pub step_m: f32,
    /// Number of planes.
    pub count: usize,
}

impl ParallelPlanes {
    /// The n-th plane.
    #[inline(always)]
    fn at(&self, n: usize) -> PlaneAt {
        PlaneAt { toward: self.toward, distance_m: self.first_m + n as f32 * self.step_m }
    }
}

/// Anything with a distance: a point (relative to the sub-aperture's middle) or a plane.
trait RangeTarget: Copy {
    fn distance_m(self, from: [f32; 3]) -> f32;
    /// Distances from sixteen positions.
    fn distances<S: Lanes>(self, s: S, from: [S::F; 3]) -> S::F;
    #[inline(always)]
    fn distances_m(self, from: &[[f32; LANES]; 3]) -> [f32; LANES] {
        let mut distances = [0.0; LANES];
        for l in 0..LANES {
            distances[l] = self.distance_m([from[0][l], from[1][l], from[2][l]]);
        }
        distances
    }
}

impl RangeTarget for [f32; 3] {
    #[inline(always)]
    fn distance_m(self, from: [f32; 3]) -> f32 {
        let (x, y, z) = (self[0] - from[0], self[1] - from[1], self[2] - from[2]);
        (x * x + y * y + z * z).sqrt()
    }
    #[inline(always)]
    fn distances<S: Lanes>(self, s: S, from: [S::F; 3]) -> S::F {
        let to = sub3(s, splat3(s, self), from);
        s.sqrt(dot(s, to, to))
    }
}

impl RangeTarget for PlaneAt {
    #[inline(always)]
    fn distance_m(self, from: [f32; 3]) -> f32 {
        let u = self.toward;
        self.distance_m - (u[0] * from[0] + u[1] * from[1] + u[2] * from[2])
    }
    #[inline(always)]
    fn distances<S: Lanes>(self, s: S, from: [S::F; 3]) -> S::F {
        s.sub(s.splat(self.distance_m), dot(s, splat3(s, self.toward), from))
    }
}

impl Subaperture {
    /// Coherence at points relative to the sub-aperture's middle, metres.
    pub fn coherence_at_points(&self, points: &[[f32; 3]]) -> Vec<Coherence> {
        on_widest(MeasureAll { block: self, places: points })
    }

    /// Coherence of planes.
    pub fn coherence_of_planes(&self, planes: &[PlaneAt]) -> Vec<Coherence> {
        on_widest(MeasureAll { block: self, places: planes })
    }

    /// Coherence of parallel planes, equal to that of each alone but for rounding.
    pub fn coherence_of_parallel_planes(&self, planes: &ParallelPlanes) -> Vec<Coherence> {
        on_widest(MeasureParallel { block: self, planes })
    }
}

/// Coherence of every plane. From one plane to the next, the distance from each sweep grows by the same, and so does its phase.
#[derive(Clone)]
struct MeasureParallel<'a> {
    block: &'a Subaperture,
    planes: &'a ParallelPlanes,
}

/// Sixteen sweeps at a plane. The angle of `turn` is off by 1e-4 rad, from the sines' polynomials; over all planes that adds up to
/// hundredths of a radian, nearly the same for all sweeps, which the magnitude of their sum does not depend on.
struct GroupAtPlane<S: Lanes> {
    /// Distance from the middle sweep, metres.
    middle_m: f32,
    /// Distance from each sweep at the time of its sample there, metres, and what it grows by.
    distance_m: S::F,
    step_m: S::F,
    /// e^(jκ · distance), and the factor from one plane to the next.
    phasor: [S::F; 2],
    turn: [S::F; 2],
}

impl Kernel for MeasureParallel<'_> {
    type Out = Vec<Coherence>;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> Vec<Coherence> {
        let Self { block, planes } = self;
        let mut groups: Vec<GroupAtPlane<S>> = Vec::with_capacity(block.path.groups.len());
        if block.path.is_smooth && planes.count > 0 {
            for group in &block.path.groups {
                groups.push(GroupAtPlane::at_first(s, block, group, planes));
            }
        }
        let mut found = Vec::with_capacity(planes.count);
        for n in 0..planes.count {
            let plane = planes.at(n);
            if block.path.is_smooth && block.covers(plane.distance_m, plane.distance_m) {
                found.push(coherence_of_groups(s, block, &groups));
            } else {
                found.push(bounds_checked_coherence(block, plane));
            }
            for group in &mut groups {
                group.advance(s, planes.step_m);
            }
        }
        found
    }
}

impl<S: Lanes> GroupAtPlane<S> {
    #[inline(always)]
    fn at_first(s: S, block: &Subaperture, group: &Group, planes: &ParallelPlanes) -> Self {
        let first = planes.at(0);
        let [x, y, z] = &group.position_m;
        let middle_m = first.distance_m([x[LANES / 2], y[LANES / 2], z[LANES / 2]]);
        let toward = splat3(s, planes.toward);
        let nearer_m_per_s = dot(s, toward, load3(s, &group.velocity_m_per_s));
        let resting_m = first.distances(s, load3(s, &group.position_m));
        let distance_m = s.neg_mul_add(nearer_m_per_s, s.splat(block.point_time.at_s(middle_m)), resting_m);
        let later_s = s.splat(block.point_time.s_per_m * planes.step_m);
        let step_m = s.neg_mul_add(nearer_m_per_s, later_s, s.splat(planes.step_m));
        let half_turns_per_m = s.splat(HALF_TURNS_PER_M);
        let (cos, sin) = s.cos_sin_of_half_turns(s.mul(distance_m, half_turns_per_m));
        let (turn_cos, turn_sin) = s.cos_sin_of_half_turns(s.mul(step_m, half_turns_per_m));
        // At the n-th plane the phasor has this magnitude to the n-th power: one step of Newton's method makes it 1.
        let square = s.mul_add(turn_cos, turn_cos, s.mul(turn_sin, turn_sin));
        let scale = s.neg_mul_add(square, s.splat(0.5), s.splat(1.5));
        let turn = [s.mul(turn_cos, scale), s.mul(turn_sin, scale)];
        Self { middle_m, distance_m, step_m, phasor: [cos, sin], turn }
    }

    /// Goes to the next plane.
    #[inline(always)]
    fn advance(&mut self, s: S, step_m: f32) {
        let ([cos, sin], [turn_cos, turn_sin]) = (self.phasor, self.turn);
        self.middle_m += step_m;
        self.distance_m = s.add(self.distance_m, self.step_m);
        self.phasor =
            [s.neg_mul_add(sin, turn_sin, s.mul(cos, turn_cos)), s.mul_add(cos, turn_sin, s.mul(sin, turn_cos))];
    }
}

/// For a plane within the range axis of every sweep, with every sweep close to its group's middle one.
#[inline(always)]
fn coherence_of_groups<S: Lanes>(s: S, block: &Subaperture, groups: &[GroupAtPlane<S>]) -> Coherence {
    let mut sums = [s.splat(0.0); 3];
    for (g, group) in groups.iter().enumerate() {
        add_group(s, block, (g, group.middle_m), group.distance_m, group.phasor, &mut sums);
    }
    Coherence::of_sums(s, block, sums)
}

/// Coherence at every place.
#[derive(Clone)]
struct MeasureAll<'a, T> {
    block: &'a Subaperture,
    places: &'a [T],
}

impl<T: RangeTarget> Kernel for MeasureAll<'_, T> {
    type Out = Vec<Coherence>;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> Vec<Coherence> {
        let Self { block, places } = self;
        let mut found = Vec::with_capacity(places.len());
        for &place in places {
            let middle_m = place.distance_m([0.0; 3]);
            let plain = block.path.is_smooth && block.covers(middle_m, middle_m);
            found.push(if plain { coherence(s, block, place) } else { bounds_checked_coherence(block, place) });
        }
        found
    }
}

/// For a point within the range axis of every sweep, with every sweep close to its group's middle
/// one.
#[inline(always)]
fn coherence<S: Lanes>(s: S, block: &Subaperture, place: impl RangeTarget) -> Coherence {
    let mut sums = [s.splat(0.0); 3];
    let half_turns_per_m = s.splat(HALF_TURNS_PER_M);
    for (g, group) in block.path.groups.iter().enumerate() {
        let [x, y, z] = &group.position_m;
        let middle_m = place.distance_m([x[LANES / 2], y[LANES / 2], z[LANES / 2]]);
        let time = s.splat(block.point_time.at_s(middle_m));
        let [x, y, z] = load3(s, &group.position_m);
        let [vx, vy, vz] = load3(s, &group.velocity_m_per_s);
        let distance = place.distances(s, [s.mul_add(vx, time, x), s.mul_add(vy, time, y), s.mul_add(vz, time, z)]);
        let (cos, sin) = s.cos_sin_of_half_turns(s.mul(distance, half_turns_per_m));
        add_group(s, block, (g, middle_m), distance, [cos, sin], &mut sums);
    }
    Coherence::of_sums(s, block, sums)
}

/// Adds z e^(−jκd) of sixteen sweeps and its energy; `phasor` is e^(jκd). The table is read about the distance from the middle
/// sweep, metres.
#[inline(always)]
fn add_group<S: Lanes>(
    s: S,
    block: &Subaperture,
    (g, middle_m): (usize, f32),
    distance: S::F,
    phasor: [S::F; 2],
    sums: &mut [S::F; 3],
) {
    let ([cos, sin], [sum_re, sum_im, energy]) = (phasor, *sums);
    let (at, entry_m) = block.entry_at(middle_m);
    let rows = [block.row(at - 1, g), block.row(at, g), block.row(at + 1, g)];
    let u = s.mul(s.sub(distance, s.splat(entry_m)), s.splat(block.axis.entries_per_m));
    let half_u = s.mul(u, s.splat(0.5));
    let one = s.splat(1.0);
    let weights = [s.sub(s.mul(half_u, u), half_u), s.neg_mul_add(u, u, one), s.mul_add(half_u, u, half_u)];
    let [re, im] = [interpolate(s, &rows, 0, weights), interpolate(s, &rows, 1, weights)];
    *sums = [
        s.mul_add(re, cos, s.mul_add(im, sin, sum_re)),
        s.mul_add(im, cos, s.neg_mul_add(re, sin, sum_im)),
        s.mul_add(re, re, s.mul_add(im, im, energy)),
    ];
}

#[inline(always)]
fn interpolate<S: Lanes>(s: S, rows: &[&[[f32; LANES]; 2]; 3], part: usize, weights: [S::F; 3]) -> S::F {
    let [before, here, after] = weights;
    let outer = s.mul_add(s.load(&rows[0][part]), before, s.mul(s.load(&rows[2][part]), after));
    s.mul_add(s.load(&rows[1][part]), here, outer)
}

impl Coherence {
    /// From the sums over all groups, lane by lane.
    #[inline(always)]
    fn of_sums<S: Lanes>(s: S, block: &Subaperture, sums: [S::F; 3]) -> Self {
        let [re, im, energy] = [s.store(sums[0]), s.store(sums[1]), s.store(sums[2])];
        Self::of(sum(re), sum(im), sum(energy), block.path.sweep_count as f32)
    }

    #[inline(always)]
    fn of(re: f32, im: f32, energy: f32, count: f32) -> Self {
        let power = (re * re + im * im) / count;
        let rest = (energy - power) / (count - 1.0);
        Self { m: power / rest.max(1.0), power }
    }
}

#[inline(always)]
fn bounds_checked_coherence(block: &Subaperture, place: impl RangeTarget) -> Coherence {
    let (mut sum_re, mut sum_im, mut energy) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
    let turns_per_m = (2.0 / WAVELENGTH_M) as f32;
    for (g, group) in block.path.groups.iter().enumerate() {
        // The middle sweep determines the table entry, and the time at which points at about this
        // range were sampled.
        let [x, y, z] = &group.position_m;
        let middle_m = place.distance_m([x[LANES / 2], y[LANES / 2], z[LANES / 2]]);
        let distance = place.distances_m(&group.moved(block.point_time.at_s(middle_m)));
        let (re, im) = block.look_up(g, middle_m, &distance);
        for l in 0..LANES {
            // Limited to 100 m and NaN-free, so that lanes that do not count add zero and not NaN.
            let turns = distance[l].abs().min(100.0) * turns_per_m;
            let (cos, sin) = cos_sin_of_turns(turns - ((turns + ROUNDER) - ROUNDER));
            // z · e^(−j·2π·turns)
            sum_re[l] += re[l] * cos + im[l] * sin;
            sum_im[l] += im[l] * cos - re[l] * sin;
            energy[l] += re[l] * re[l] + im[l] * im[l];
        }
    }
    Coherence::of(sum(sum_re), sum(sum_im), sum(energy), block.path.sweep_count as f32)
}

impl Group {
    /// Sensor positions after that time.
    #[inline(always)]
    fn moved(&self, time_s: f32) -> [[f32; LANES]; 3] {
        let mut position_m = self.position_m;
        for (positions, velocities) in position_m.iter_mut().zip(&self.velocity_m_per_s) {
            for (position, velocity) in positions.iter_mut().zip(velocities) {
                *position += velocity * time_s;
            }
        }
        position_m
    }
}

impl Subaperture {
    /// The interior table entry nearest to a distance, and its range.
    #[inline(always)]
    fn entry_at(&self, middle_m: f32) -> (usize, f32) {
        let at = (middle_m - self.axis.first_m) * self.axis.entries_per_m + 0.5;
        // A NaN distance falls on the first entry; it does not count.
        let at = if at >= 1.0 { at.min((self.axis.entries - 2) as f32) } else { 1.0 } as i32;
        (at as usize, self.axis.first_m + at as f32 * self.axis.entry_step_m)
    }

    #[inline(always)]
    fn row(&self, entry: usize, group: usize) -> &[[f32; LANES]; 2] {
        &self.z[entry * self.path.groups.len() + group]
    }

    /// z of a group's sweeps, each at its own distance; zero outside the axis.
    #[inline(always)]
    fn look_up(&self, group: usize, middle_m: f32, distance: &[f32; LANES]) -> ([f32; LANES], [f32; LANES]) {
        let (at, entry_m) = self.entry_at(middle_m);
        let (before, here, after) = (self.row(at - 1, group), self.row(at, group), self.row(at + 1, group));
        let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let u = (distance[l] - entry_m) * self.axis.entries_per_m;
            // Sixteen sweeps share an entry. A sweep more than four entries away does not belong to
            // their motion.
            let inside = (distance[l] >= self.axis.first_m) & (distance[l] <= self.axis.last_m) & (u.abs() <= 4.0);
            let (u, inside) = if inside { (u, 1.0) } else { (0.0, 0.0) };
            let (low, middle, high) = (0.5 * (u * u - u) * inside, (1.0 - u * u) * inside, 0.5 * (u * u + u) * inside);
            re[l] = before[0][l] * low + here[0][l] * middle + after[0][l] * high;
            im[l] = before[1][l] * low + here[1][l] * middle + after[1][l] * high;
        }
        (re, im)
    }
}

/// Sum of the lanes, by halves.
#[inline(always)]
fn sum(lanes: [f32; LANES]) -> f32 {
    let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
    for l in 0..8 {
        eight[l] = lanes[l] + lanes[l + 8];
    }
    for l in 0..4 {
        four[l] = eight[l] + eight[l + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// cos and sin of 2π·f for f within ±½, to 1e-5, from one odd polynomial for a quarter turn.
#[inline(always)]
fn cos_sin_of_turns(f: f32) -> (f32, f32) {
    let positive = f.abs();
    let cos = sin_quarter(0.25 - positive);
    let sin = sin_quarter(0.25 - (positive - 0.25).abs());
    (cos, sin.copysign(f))
}

/// sin(2πx) for x within ±¼.
#[inline(always)]
fn sin_quarter(x: f32) -> f32 {
    let x2 = x * x;
    x * (std::f32::consts::TAU + x2 * (-41.341_66 + x2 * (81.601_27 + x2 * (-76.555_02 + x2 * 39.572_15))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Plane;
    use crate::simd::on_each;
    use crate::subaperture::{MEAN_LOG_OF_NOISE, SubapertureBuilder, SubapertureSettings};
    use crate::test_data::{Echo, sweeps, winding};
    use crate::{Beam, Observation};
    use crate::{Oracle, Statistic};
    use glam::DVec3;

    #[test]
    fn sines_are_right_to_1e_5() {
        for i in -5000..=5000 {
            let f = i as f32 * 1e-4;
            let (cos, sin) = cos_sin_of_turns(f);
            let (s, c) = (f64::from(f) * std::f64::consts::TAU).sin_cos();
            assert!((f64::from(cos) - c).abs() < 1e-5 && (f64::from(sin) - s).abs() < 1e-5, "{f}: {cos} {sin}");
        }
    }

    fn block(observations: &[Observation]) -> Subaperture {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        observations.iter().for_each(|o| assert!(builder.push(o.clone()).is_none()));
        builder.close().unwrap()
    }

    /// Points around the echo at `AT`, and along the boresight from near to far.
    fn places() -> Vec<DVec3> {
        let around = (0..60).map(|n| AT + 0.2 * winding(f64::from(n)));
        around.chain((0..40).map(|n| DVec3::NEG_Z * (0.5 + 0.04 * f64::from(n)))).collect()
    }

    const AT: DVec3 = DVec3::new(0.1, -0.2, -1.1);

    #[test]
    fn coherence_agrees_with_the_oracle() {
        let fast = |t: f64| winding(2.5 * t);
        let observations = sweeps(0.089, fast, &[(Echo::Point(AT), 2.0)], 7);
        let oracle = Oracle::new(&observations, &Beam::Lensless, &SubapertureSettings::default());
        let block = block(&observations);
        let places = places();
        let relative: Vec<_> = places.iter().map(|p| (*p - block.middle.translation).as_vec3().to_array()).collect();
        for (place, found) in places.iter().zip(block.coherence_at_points(&relative)) {
            // The score of a single sub-aperture is ln(1 + m) minus its mean under noise.
            let exact = (oracle.value(Statistic::Subaperture, *place) + MEAN_LOG_OF_NOISE).exp() - 1.0;
            assert!((f64::from(found.m) - exact).abs() < 0.01 * exact + 0.02, "{place}: {found:?} {exact}");
        }
    }

    #[test]
    fn parallel_planes_are_as_each_alone() {
        let wall = Plane { outward: DVec3::new(0.6, 0.0, -0.8), offset_m: 1.3 };
        for (speed, amplitude) in [(0.0, 5.0), (0.3, 0.0), (1.0, 5.0), (2.5, 300.0), (60.0, 5.0)] {
            let moving = |t: f64| winding(speed * t);
            let block = block(&sweeps(0.089, moving, &[(Echo::Plane(wall), amplitude)], 7));
            // From before the range axis to beyond it, with one at the wall, as many as a field of planes has.
            let at_wall_m = wall.distance(block.middle.translation) as f32;
            let toward = wall.outward.as_vec3().to_array();
            let planes = ParallelPlanes { toward, first_m: at_wall_m - 93.0 * 0.02, step_m: 0.02, count: 187 };
            let each: Vec<_> = (0..planes.count).map(|n| planes.at(n)).collect();
            let all = block.coherence_of_parallel_planes(&planes);
            assert_eq!(all.len(), planes.count);
            for (together, alone) in all.iter().zip(block.coherence_of_planes(&each)) {
                assert!((together.m - alone.m).abs() < 2e-3 * alone.m + 1e-3, "{speed}: {together:?} {alone:?}");
            }
            assert!(f64::from(all[93].m) >= amplitude, "{amplitude}: {:?}", all[93]);
            assert_eq!(block.coherence_of_parallel_planes(&ParallelPlanes { count: 0, ..planes }), []);
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let block = block(&sweeps(0.089, winding, &[(Echo::Point(AT), 2.0)], 8));
        let relative: Vec<_> = places().iter().map(|p| (*p - block.middle.translation).as_vec3().to_array()).collect();
        let all = on_each(&MeasureAll { block: &block, places: &relative });
        assert!(all.windows(2).all(|two| two[0] == two[1]));
        let toward = [0.6, 0.0, -0.8];
        let planes: Vec<_> = (0..60).map(|n| PlaneAt { toward, distance_m: 0.3 + 0.05 * n as f32 }).collect();
        let all = on_each(&MeasureAll { block: &block, places: &planes });
        assert!(all.windows(2).all(|two| two[0] == two[1]));
        let planes = ParallelPlanes { toward, first_m: 0.3, step_m: 0.05, count: 60 };
        let all = on_each(&MeasureParallel { block: &block, planes: &planes });
        assert!(all.windows(2).all(|two| two[0] == two[1]));
        // The checked loop differs by rounding only.
        for (plain, place) in block.coherence_at_points(&relative).iter().zip(&relative) {
            let careful = bounds_checked_coherence(&block, *place);
            assert!((plain.m - careful.m).abs() < 2e-3 * careful.m + 1e-3, "{plain:?} {careful:?}");
        }
    }
}
