//! A device's path from a TUM file: positions are interpolated linearly and rotations along the
//! shortest arc. There is no pose in a gap; before and after the track the device is at rest.

use std::path::Path;

use glam::DVec3;
use radar_recording::read_track;
use radar_sar::geometry::Pose;

/// Largest distance of neighbouring lines across which poses are interpolated, nanoseconds. Choice:
/// two poses at 72 Hz; across a longer gap tracking counts as lost.
const MAX_GAP_NS: i64 = 30_000_000;
/// Half the interval over which velocities are computed, nanoseconds. Choice: shorter than the
/// poses' spacing, so that neighbouring intervals alone count.
const VELOCITY_HALF_NS: i64 = 2_000_000;

/// Pose and motion of a device, in the universe of its track.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    pub pose: Pose,
    pub velocity_m_s: DVec3,
    pub angular_velocity_rad_s: DVec3,
}

/// Poses by time.
#[derive(Debug)]
pub struct Track {
    poses: Vec<(i64, Pose)>,
    loops: bool,
}

impl Track {
    /// At rest forever.
    pub fn at_rest(pose: Pose) -> Self {
        Self { poses: vec![(0, pose)], loops: false }
    }

    /// Reads a TUM file. Lines that are no pose or not later than the previous one are skipped.
    ///
    /// # Errors
    /// A message that describes what is wrong with the file.
    pub fn read(path: &Path, loops: bool) -> Result<Self, String> {
        let samples = read_track(path).map_err(|error| error.to_string())?;
        let mut poses: Vec<(i64, Pose)> = Vec::with_capacity(samples.len());
        for sample in samples.iter().filter(|sample| sample.valid) {
            let later = poses.last().is_none_or(|(time_ns, _)| *time_ns < sample.time_ns);
            if let (true, Ok(pose)) = (later, Pose::try_new(sample.position_m, sample.quaternion_xyzw)) {
                poses.push((sample.time_ns, pose));
            }
        }
        if poses.is_empty() {
            return Err(format!("{}: no pose in it", path.display()));
        }
        Ok(Self { poses, loops })
    }

    /// Motion of the device at a time of the track; `None` in a gap.
    pub fn at(&self, time_ns: i64) -> Option<Motion> {
        let pose = self.pose(time_ns)?;
        let (before, after) = (self.pose(time_ns - VELOCITY_HALF_NS), self.pose(time_ns + VELOCITY_HALF_NS));
        let (from, to) = (before.unwrap_or(pose), after.unwrap_or(pose));
        let halves = f64::from(u8::from(before.is_some()) + u8::from(after.is_some())).max(1.0);
        let span_s = halves * VELOCITY_HALF_NS as f64 * 1e-9;
        let turn = (to.rotation * from.rotation.conjugate()).to_scaled_axis();
        let velocity_m_s = (to.translation - from.translation) / span_s;
        Some(Motion { pose, velocity_m_s, angular_velocity_rad_s: turn / span_s })
    }

    fn pose(&self, time_ns: i64) -> Option<Pose> {
        let time_ns = if self.loops { self.ping_pong_time(time_ns) } else { time_ns };
        let next = self.poses.partition_point(|(t, _)| *t <= time_ns);
        let Some((from_ns, from)) = next.checked_sub(1).map(|i| self.poses[i]) else {
            return Some(self.poses[0].1);
        };
        let Some((to_ns, to)) = self.poses.get(next).copied() else {
            return Some(from);
        };
        if time_ns == from_ns {
            return Some(from);
        }
        let span_ns = to_ns - from_ns;
        (span_ns <= MAX_GAP_NS).then(|| from.interpolate(&to, (time_ns - from_ns) as f64 / span_ns as f64))
    }

    /// Maps a time to a track that plays forwards and backwards in turn.
    fn ping_pong_time(&self, time_ns: i64) -> i64 {
        let (first, last) = (self.poses[0].0, self.poses[self.poses.len() - 1].0);
        let span = last - first;
        if span <= 0 {
            return first;
        }
        let along = (time_ns - first).rem_euclid(2 * span);
        first + if along > span { 2 * span - along } else { along }
    }
}
