//! One sub-aperture: its sweeps range-compressed and noise-normalised, positions relative to its
//! middle sweep.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::brick::Rows;
use super::kernel::Group;
use super::leaf::{Partition, partition};
use super::wall_cancellation::subtract_planes;
use super::{Coherence, SubapertureSettings, taper};
use crate::compression::CompressionScratch;
use crate::geometry::{Plane, Pose};
use crate::simd::LANES;
use crate::{Observation, SweepGeometry};
use crate::{RangeCompressor, subaperture_noise_rms};

/// Consecutive sweeps that are summed coherently (a coherent processing interval).
#[derive(Debug, Clone)]
pub struct Subaperture {
    /// Pose of the middle sweep, `tracking_from_sensor`. Kernel coordinates are relative to its
    /// translation.
    pub middle: Pose,
    /// Time of the middle sweep, host nanoseconds.
    pub mid_time_ns: i64,
    /// End of the last sweep, host nanoseconds.
    pub end_ns: i64,
    /// Unit vector from the first sensor position to the last; zero when the sensor did not move.
    pub motion: DVec3,
    /// Distance from the first sensor position to the last, metres.
    pub aperture_m: f64,
    /// Noise rms by which z is normalised, LSB.
    pub noise_rms_lsb: f64,
    pub(super) axis: TableAxis,
    pub(super) point_time: PointTime,
    pub(super) path: SweepPath,
    /// z times the taper, `[entry][group]` then `[re, im][sweep]`; zero in lanes beyond the last
    /// sweep.
    pub(super) z: Vec<[[f32; LANES]; 2]>,
    /// The same values sweep by sweep, for the box kernel.
    pub(super) rows: Rows,
    /// By greatest half-length; computed on first use.
    partitions: [OnceLock<Partition>; PARTITIONS],
    geometry: Arc<SweepGeometry>,
    /// The same sub-aperture before wall cancellation; `None` when nothing was cancelled.
    uncancelled: Option<Arc<Subaperture>>,
}

/// Range axis of the tables of compressed sweeps.
#[derive(Debug, Clone, Copy)]
pub(super) struct TableAxis {
    /// Range of the first table entry, and of the last point, metres.
    pub first_m: f32,
    pub last_m: f32,
    /// Distance between table entries, metres, and its inverse.
    pub entry_step_m: f32,
    pub entries_per_m: f32,
    /// Number of entries in one sweep's table.
    pub entries: usize,
}

/// When a point is sampled: `range · s_per_m + at_zero_s` after the middle of its sweep.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointTime {
    pub s_per_m: f32,
    pub at_zero_s: f32,
}

impl PointTime {
    /// Time of the point at a range after the middle of its sweep, seconds.
    #[inline]
    pub fn at_s(&self, range_m: f32) -> f32 {
        range_m * self.s_per_m + self.at_zero_s
    }
}

/// Where and when the sweeps of a sub-aperture were made.
#[derive(Debug, Clone)]
pub(super) struct SweepPath {
    pub sweep_count: usize,
    /// Positions and velocities of the sweeps, in groups of sixteen.
    pub groups: Vec<Group>,
    /// Times of the sweeps, seconds after the first.
    pub times_s: Vec<f32>,
    /// Upper bound of the distance between any sampling position and the middle, metres.
    pub reach_m: f32,
    /// Within each group of sixteen, every sweep lies at most [`SMOOTH_ENTRIES`] table entries from
    /// the group's middle one.
    pub is_smooth: bool,
}

impl SweepPath {
    /// Of sweeps around `origin`, for tables with entries every `entry_step_m`.
    fn of(observations: &[Observation], origin: DVec3, entry_step_m: f32) -> Self {
        let groups: Vec<Group> = observations.chunks(LANES).map(|sweeps| group(sweeps, origin)).collect();
        Self {
            sweep_count: observations.len(),
            times_s: observations.iter().map(|o| since_s(o.mid_time_ns, observations[0].mid_time_ns)).collect(),
            reach_m: observations.iter().map(|o| farthest_m(o, origin)).fold(0.0, f64::max) as f32 * 1.001,
            is_smooth: groups.iter().all(|group| group.reach_m() <= SMOOTH_ENTRIES * entry_step_m),
            groups,
        }
    }
}

/// A sub-aperture reduced to what evaluating single points needs: half the memory.
#[derive(Debug, Clone)]
pub struct PointSubaperture(Subaperture);

impl PointSubaperture {
    /// Copies what point evaluation needs; reuses the memory of `old` if given.
    pub fn of(block: &Subaperture, old: Option<Self>) -> Self {
        let (mut z, mut groups) = old.map_or_else(Default::default, |old| (old.0.z, old.0.path.groups));
        z.clone_from(&block.z);
        groups.clone_from(&block.path.groups);
        Self(Subaperture {
            z,
            path: SweepPath { groups, times_s: Vec::new(), ..block.path },
            rows: Rows::none(),
            partitions: Default::default(),
            geometry: Arc::clone(&block.geometry),
            uncancelled: None,
            ..*block
        })
    }

    /// See [`Subaperture::middle`].
    #[inline]
    pub fn middle(&self) -> &Pose {
        &self.0.middle
    }

    /// See [`Subaperture::geometry`].
    #[inline]
    pub fn geometry(&self) -> &SweepGeometry {
        self.0.geometry()
    }

    /// See [`Subaperture::motion`].
    #[inline]
    pub fn motion(&self) -> DVec3 {
        self.0.motion
    }

    /// See [`Subaperture::mid_time_ns`].
    #[inline]
    pub fn mid_time_ns(&self) -> i64 {
        self.0.mid_time_ns
    }

    /// See [`Subaperture::aperture_m`].
    #[inline]
    pub fn aperture_m(&self) -> f64 {
        self.0.aperture_m
    }

    /// See [`Subaperture::distance_m`].
    #[inline]
    pub fn distance_m(&self, place: DVec3) -> f64 {
        self.0.distance_m(place)
    }

    /// Coherence of a point, tracking frame, metres.
    #[inline]
    pub fn coherence_at(&self, place: DVec3) -> Coherence {
        let relative = (place - self.0.middle.translation).as_vec3().to_array();
        self.0.coherence_at_points(&[relative])[0]
    }
}

/// Partitions exist for half-lengths from this one on, metres; each is longer by the ratio. Choice:
/// from rest to 4 cm, half of what 0.9 m/s covers in 90 ms; a ratio of 1.3 wastes at most a quarter
/// of a leaf, a finer one needs more partitions.
const SHORTEST_HALF_LENGTH_M: f32 = 1e-4;
const LENGTH_RATIO: f32 = 1.3;
const PARTITIONS: usize = 24;
/// Farthest offset, in table entries, at which the parabola through three entries is evaluated.
/// Choice: 35 mm at entries of 10 mm, a quarter of the pulse, over which a parabola follows it.
const SMOOTH_ENTRIES: f32 = 3.5;

impl Subaperture {
    /// From at least two sweeps of one geometry. `voxel_m`: edge of the voxels that it will be imaged on; `None` if points
    /// and planes alone are evaluated.
    fn new(
        observations: &[Observation],
        voxel_m: Option<f64>,
        compressor: &RangeCompressor,
        room: &mut CompressionScratch,
    ) -> Self {
        let middle = &observations[observations.len() / 2];
        let origin = middle.tracking_from_sensor.translation;
        let noise_rms_lsb = noise_of(observations);
        let geometry = Arc::clone(&middle.geometry);
        let (first_m, step_m, entries) = (compressor.first_m(), compressor.step_m(), compressor.entries());
        let path = SweepPath::of(observations, origin, step_m as f32);
        let mut z = vec![[[0.0; LANES]; 2]; entries * path.groups.len()];
        let rows_for =
            |voxel_m| Rows::new(observations.len(), [first_m, step_m], entries, geometry.pulse_fwhm_m, voxel_m);
        let mut rows = voxel_m.map(rows_for);
        let mut evened = [vec![0.0; entries], vec![0.0; entries]];
        let mut sixteen = [vec![0.0; entries * LANES], vec![0.0; entries * LANES]];
        for (g, sweeps) in observations.chunks(LANES).enumerate() {
            for (l, observation) in sweeps.iter().enumerate() {
                compressor.compress_in(&observation.samples, 1.0, room);
                let k = g * LANES + l;
                let scale = (taper(k, observations.len()) / noise_rms_lsb) as f32;
                for (part, values) in [&room.re, &room.im].into_iter().enumerate() {
                    if rows.is_some() {
                        compensate_interpolation(values, scale, &mut evened[part]);
                    }
                    let scaled = sixteen[part][l * entries..][..entries].iter_mut().zip(values);
                    scaled.for_each(|(scaled, value)| *scaled = value * scale);
                }
                if let Some(rows) = &mut rows {
                    rows.set(k, &evened[0], &evened[1]);
                }
            }
            for (entry, row) in z.iter_mut().skip(g).step_by(path.groups.len()).enumerate() {
                for (row, values) in row.iter_mut().zip(&sixteen) {
                    (0..sweeps.len()).for_each(|l| row[l] = values[l * entries + entry]);
                }
            }
        }
        let way = observations[observations.len() - 1].tracking_from_sensor.translation
            - observations[0].tracking_from_sensor.translation;
        Self {
            middle: middle.tracking_from_sensor,
            mid_time_ns: middle.mid_time_ns,
            end_ns: observations[observations.len() - 1].end_ns(),
            motion: way.normalize_or_zero(),
            aperture_m: way.length(),
            noise_rms_lsb,
            axis: TableAxis {
                first_m: first_m as f32,
                last_m: geometry.axis.last_m() as f32,
                entry_step_m: step_m as f32,
                entries_per_m: (1.0 / step_m) as f32,
                entries,
            },
            point_time: PointTime {
                s_per_m: (geometry.point_period_s / geometry.axis.step_m) as f32,
                at_zero_s: middle.point_time_s(geometry.axis.point_at(0.0)) as f32,
            },
            path,
            z,
            rows: rows.unwrap_or_else(Rows::none),
            partitions: Default::default(),
            geometry,
            uncancelled: None,
        }
    }

    /// The sweeps as leaves of at most that half-length, or of the shortest one tabulated.
    pub(super) fn partition(&self, half_length_m: f32) -> &Partition {
        let (mut at, mut bound_m) = (0, SHORTEST_HALF_LENGTH_M);
        while at + 1 < PARTITIONS && bound_m * LENGTH_RATIO <= half_length_m {
            (at, bound_m) = (at + 1, bound_m * LENGTH_RATIO);
        }
        self.partitions[at].get_or_init(|| partition(&self.path.groups, self.path.sweep_count, bound_m))
    }

    /// The sub-aperture as measured, before wall cancellation. It is for planes and points: fields image the cleaned one.
    pub fn uncancelled(&self) -> &Self {
        self.uncancelled.as_deref().unwrap_or(self)
    }

    /// Number of sweeps.
    pub fn sweep_count(&self) -> usize {
        self.path.sweep_count
    }

    /// Range axis, pulse and timing of its sweeps.
    #[inline]
    pub fn geometry(&self) -> &SweepGeometry {
        &self.geometry
    }

    /// Distance from the middle to a point, metres.
    #[inline]
    pub fn distance_m(&self, place: DVec3) -> f64 {
        place.distance(self.middle.translation)
    }
}

/// Compensates linear interpolation: chords between entries lie inside the curve, so each entry is
/// moved outwards by the mean of that error.
fn compensate_interpolation(values: &[f32], scale: f32, evened: &mut [f32]) {
    let last = values.len() - 1;
    let evened_at = |before: f32, value: f32, after: f32| (value - (before + after - value * 2.0) / 12.0) * scale;
    for (evened, three) in evened[1..last].iter_mut().zip(values.windows(3)) {
        *evened = evened_at(three[0], three[1], three[2]);
    }
    evened[0] = evened_at(values[0], values[0], values[1]);
    evened[last] = evened_at(values[last - 1], values[last], values[last]);
}

/// Time from `first_ns` to a later time, seconds.
fn since_s(time_ns: i64, first_ns: i64) -> f32 {
    (time_ns.saturating_sub(first_ns) as f64 * 1e-9) as f32
}

/// Farthest distance from `origin` at which a point of the sweep was sampled, metres.
fn farthest_m(observation: &Observation, origin: DVec3) -> f64 {
    let half_s = observation
        .point_time_s(0.0)
        .abs()
        .max(observation.point_time_s(observation.geometry.axis.point_at(0.0)).abs());
    observation.tracking_from_sensor.translation.distance(origin) + observation.velocity_m_per_s.length() * half_s
}

/// Up to sixteen sweeps in lanes; the last sweep fills unused lanes.
fn group(sweeps: &[Observation], origin: DVec3) -> Group {
    let lanes = |value: &dyn Fn(&Observation) -> DVec3| {
        let of = |l: usize| value(&sweeps[l.min(sweeps.len() - 1)]).as_vec3().to_array();
        std::array::from_fn(|axis| std::array::from_fn(|l| of(l)[axis]))
    };
    Group {
        position_m: lanes(&|o| o.tracking_from_sensor.translation - origin),
        velocity_m_per_s: lanes(&|o| o.velocity_m_per_s),
    }
}

impl Group {
    /// Greatest distance of a sweep from the group's middle one, metres.
    fn reach_m(&self) -> f32 {
        let from_middle = |l: usize| -> f32 {
            self.position_m.iter().map(|axis| (axis[l] - axis[LANES / 2]).powi(2)).sum::<f32>().sqrt()
        };
        (0..LANES).map(from_middle).fold(0.0, f32::max)
    }
}

/// Noise rms of a sub-aperture's sweeps, LSB.
fn noise_of(observations: &[Observation]) -> f64 {
    subaperture_noise_rms(observations.iter().map(|o| o.samples.as_slice()))
}

/// Collects the sweeps of one subsweep into sub-apertures.
#[derive(Debug)]
pub struct SubapertureBuilder {
    settings: SubapertureSettings,
    compressor: Option<RangeCompressor>,
    rooms: [CompressionScratch; 2],
    pending: Vec<Observation>,
    planes: Vec<Plane>,
    /// Sweeps dropped because too few of them came before a pause.
    pub dropped_sweeps: u64,
}

impl SubapertureBuilder {
    /// An empty builder.
    pub fn new(settings: SubapertureSettings) -> Self {
        Self {
            settings,
            compressor: None,
            rooms: Default::default(),
            pending: Vec::new(),
            planes: Vec::new(),
            dropped_sweeps: 0,
        }
    }

    /// Whether a sweep of that time would close the current sub-aperture.
    pub fn is_closed_by(&self, mid_time_ns: i64) -> bool {
        match (self.pending.first(), self.pending.last()) {
            (Some(first), Some(last)) => !self.settings.continues(first.mid_time_ns, last.mid_time_ns, mid_time_ns),
            _ => false,
        }
    }

    /// The sweeps of the current sub-aperture, mutable.
    pub fn sweeps_mut(&mut self) -> &mut [Observation] {
        &mut self.pending
    }

    /// Cancels the echoes of these planes in all sub-apertures closed from now on; see
    /// [`Subaperture::uncancelled`].
    pub fn cancel_walls(&mut self, planes: &[Plane]) {
        self.planes.clear();
        self.planes.extend_from_slice(planes);
    }

    /// Adds a sweep; returns the sub-aperture that it closes, if any. All sweeps must share one
    /// geometry.
    pub fn push(&mut self, observation: Observation) -> Option<Subaperture> {
        let closed = if self.is_closed_by(observation.mid_time_ns) { self.close() } else { None };
        self.pending.push(observation);
        closed
    }

    /// Closes the current sub-aperture; `None` when it has too few sweeps.
    pub fn close(&mut self) -> Option<Subaperture> {
        let sweeps = std::mem::take(&mut self.pending);
        if sweeps.len() < self.settings.min_sweeps.max(2) {
            self.dropped_sweeps += sweeps.len() as u64;
            return None;
        }
        let compressor = self.compressor.get_or_insert_with(|| RangeCompressor::new(&sweeps[0].geometry));
        let (voxel_m, [room, other_room]) = (Some(self.settings.voxel_m), &mut self.rooms);
        let Some(cleaned) = subtract_planes(&sweeps, &self.planes, noise_of(&sweeps)) else {
            return Some(Subaperture::new(&sweeps, voxel_m, compressor, room));
        };
        let (uncancelled, cleaned) = rayon::join(
            || Subaperture::new(&sweeps, None, compressor, other_room),
            || Subaperture::new(&cleaned, voxel_m, compressor, room),
        );
        Some(Subaperture { uncancelled: Some(Arc::new(uncancelled)), ..cleaned })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subaperture::partition;
    use crate::test_data::{sweeps, winding};

    #[test]
    fn subapertures_match_the_oracle_partition() {
        let mut observations = sweeps(0.5, winding, &[], 1);
        // A pause, and a remainder too short for a sub-aperture.
        observations.drain(200..260);
        observations.drain(265..430);
        let settings = SubapertureSettings::default();
        let mut builder = SubapertureBuilder::new(settings);
        let mut blocks: Vec<_> = observations.iter().filter_map(|o| builder.push(o.clone())).collect();
        blocks.extend(builder.close());
        let expected = partition(&observations, &settings);
        let kept: usize = expected.iter().map(Vec::len).sum();
        assert_eq!(blocks.len(), expected.len());
        assert_eq!(builder.dropped_sweeps as usize, observations.len() - kept);
        for (block, indices) in blocks.iter().zip(&expected) {
            assert_eq!(block.sweep_count(), indices.len());
            assert_eq!(block.mid_time_ns, observations[indices[indices.len() / 2]].mid_time_ns);
        }
    }
}
