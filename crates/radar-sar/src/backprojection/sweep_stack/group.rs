//! Sixteen sweeps in lanes.

use glam::DVec3;

use super::Axis;
use crate::Observation;
use crate::simd::LANES;

/// Sixteen sweeps; a lane without a sweep has an empty range.
#[derive(Debug, Clone)]
pub(in super::super) struct Group {
    /// `[axis][lane]`, metres from the stack's origin.
    pub position_m: [[f32; LANES]; 3],
    pub velocity_m_per_s: [[f32; LANES]; 3],
    /// Unit vector of the boresight.
    pub forward: [[f32; LANES]; 3],
    /// First and last range, metres.
    pub first_m: [f32; LANES],
    pub last_m: [f32; LANES],
    /// Table entries per metre, and metres per table entry.
    pub entries_per_m: [f32; LANES],
    pub entry_m: [f32; LANES],
    /// Points of the axis per metre, and table entries per point.
    pub points_per_m: [f32; LANES],
    pub entries_per_point: [i32; LANES],
    /// Coarse entries per table entry: an inverse power of two.
    pub coarse_per_entry: [f32; LANES],
    /// A point at range d is sampled `d · time_s_per_m + time_at_zero_s` after the pose's time, from
    /// `start_m` + d · `drift`.
    pub time_s_per_m: [f32; LANES],
    pub time_at_zero_s: [f32; LANES],
    pub start_m: [[f32; LANES]; 3],
    pub drift: [[f32; LANES]; 3],
    /// |drift|².
    pub drift_squared: [f32; LANES],
    /// At least |velocity|.
    pub speed_m_per_s: [f32; LANES],
}

impl Group {
    pub(super) const EMPTY: Self = Self {
        position_m: [[0.0; LANES]; 3],
        velocity_m_per_s: [[0.0; LANES]; 3],
        forward: [[0.0; LANES]; 3],
        first_m: [f32::MAX; LANES],
        last_m: [f32::MIN; LANES],
        entries_per_m: [1.0; LANES],
        entry_m: [1.0; LANES],
        points_per_m: [1.0; LANES],
        entries_per_point: [1; LANES],
        coarse_per_entry: [1.0; LANES],
        time_s_per_m: [0.0; LANES],
        time_at_zero_s: [0.0; LANES],
        start_m: [[0.0; LANES]; 3],
        drift: [[0.0; LANES]; 3],
        drift_squared: [0.0; LANES],
        speed_m_per_s: [0.0; LANES],
    };

    /// Copies lane `from` of another group to lane `to`.
    #[cfg(feature = "rolling")]
    pub(super) fn copy_lane(&mut self, to: usize, other: &Self, from: usize) {
        for axis in 0..3 {
            self.position_m[axis][to] = other.position_m[axis][from];
            self.velocity_m_per_s[axis][to] = other.velocity_m_per_s[axis][from];
            self.forward[axis][to] = other.forward[axis][from];
            self.start_m[axis][to] = other.start_m[axis][from];
            self.drift[axis][to] = other.drift[axis][from];
        }
        self.first_m[to] = other.first_m[from];
        self.last_m[to] = other.last_m[from];
        self.entries_per_m[to] = other.entries_per_m[from];
        self.entry_m[to] = other.entry_m[from];
        self.drift_squared[to] = other.drift_squared[from];
        self.speed_m_per_s[to] = other.speed_m_per_s[from];
        self.coarse_per_entry[to] = other.coarse_per_entry[from];
        self.time_s_per_m[to] = other.time_s_per_m[from];
        self.time_at_zero_s[to] = other.time_at_zero_s[from];
    }

    pub(super) fn put(&mut self, l: usize, observation: &Observation, of_axis: &Axis, origin_m: DVec3) {
        let compressor = &of_axis.compressor;
        let pose = &observation.tracking_from_sensor;
        let axis = &observation.geometry.axis;
        let position_m = pose.translation - origin_m;
        let velocity = observation.velocity_m_per_s;
        let time_s_per_m = observation.geometry.point_period_s / axis.step_m;
        let time_at_zero_s = observation.point_time_s(axis.point_at(0.0));
        let drift = velocity * time_s_per_m;
        let vectors = [
            (&mut self.position_m, position_m),
            (&mut self.velocity_m_per_s, velocity),
            (&mut self.forward, pose.forward()),
            (&mut self.start_m, position_m + velocity * time_at_zero_s),
            (&mut self.drift, drift),
        ];
        for (lanes, vector) in vectors {
            for (lane, value) in lanes.iter_mut().zip(vector.as_vec3().to_array()) {
                lane[l] = value;
            }
        }
        self.first_m[l] = axis.first_m as f32;
        self.last_m[l] = axis.last_m() as f32;
        self.entries_per_m[l] = (1.0 / compressor.step_m()) as f32;
        self.entry_m[l] = compressor.step_m() as f32;
        self.points_per_m[l] = (1.0 / axis.step_m) as f32;
        self.entries_per_point[l] = (axis.step_m / compressor.step_m()).round() as i32;
        self.coarse_per_entry[l] = 1.0 / (1u32 << of_axis.coarse_octaves) as f32;
        (self.time_s_per_m[l], self.time_at_zero_s[l]) = (time_s_per_m as f32, time_at_zero_s as f32);
        self.drift_squared[l] = drift.length_squared() as f32;
        self.speed_m_per_s[l] = (velocity.length() * 1.000_001) as f32;
    }
}
