//! Pose history, and interpolation to any time between poses, never across a gap or an invalid
//! pose.
//!
//! Poses are kept in the map frame: the tracking frame of the first pose. Where the tracking frame jumps, the poses after it
//! are moved back by the jump, so that the path goes on as the head does.

use std::collections::VecDeque;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::{BoundedSettings, SettingBound, bounds};

use super::frame_step::{FrameStep, frame_step, strayed_s, velocity_step};
use super::local_fit::value_and_rate_weights;
use super::pose_jumps::JumpDetector;
use super::{PoseRefusal, PoseSample};
use crate::geometry::{Pose, rotation_vector};

/// How poses become a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HistorySettings {
    /// Poses farther apart than this are not joined, seconds.
    pub max_gap_s: f64,
    /// Width of the local cubic fit that smooths the path, seconds; 0 interpolates linearly.
    pub smoothing_window_s: f64,
    /// How long after a sweep its poses may arrive, seconds. The fit uses no later ones, except the
    /// next pose after the sweep. Half of the window is as good as anything longer. Less gives
    /// sweeps earlier and less smooth poses.
    pub max_ahead_s: f64,
    /// Whether the map frame stays where it is to the head when the tracking frame jumps.
    pub follow_jumps: bool,
}

impl BoundedSettings for HistorySettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        max_gap_s: 0.001, 1.0;
        smoothing_window_s: 0.0, 0.5;
        max_ahead_s: 0.0, 0.5;
    ];
}

impl Default for HistorySettings {
    /// 50 ms are four to six frames of a headset; 92 ms are eleven poses at 120 Hz.
    fn default() -> Self {
        Self { max_gap_s: 0.05, smoothing_window_s: 0.092, max_ahead_s: 0.046, follow_jumps: true }
    }
}

/// Least time to wait for poses after a sweep, where `max_ahead_s` allows it, seconds. Choice: two
/// poses at 120 Hz, between which a sweep is interpolated.
const MIN_WAIT_S: f64 = 0.02;

impl HistorySettings {
    /// Whether poses are waited for less long than the smoothing could use them.
    pub fn is_early(&self) -> bool {
        self.max_ahead_s < self.smoothing_window_s * 0.5
    }

    /// After this time, no later pose changes the path at a point, except the next one,
    /// nanoseconds.
    pub fn ahead_ns(&self) -> i64 {
        let most_ns = (self.max_ahead_s * 1e9).round() as i64;
        self.smooth_ns().min(most_ns)
    }

    /// After this time, no later pose makes the path at a point smoother, nanoseconds.
    pub fn smooth_ns(&self) -> i64 {
        ((self.smoothing_window_s * 0.5).max(MIN_WAIT_S) * 1e9).round() as i64
    }
}

/// An interpolated pose with its velocities, in the map frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothPose {
    /// `tracking_from_head` at the wanted time, in the map frame.
    pub tracking_from_head: Pose,
    /// Velocity of the head's origin, tracking frame, m/s.
    pub velocity_m_per_s: DVec3,
    /// Angular velocity, tracking frame, rad/s.
    pub angular_velocity_rad_per_s: DVec3,
}

/// Why there is no pose at a time.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoPose {
    /// Before the first or after the last pose.
    #[error("outside the time span of the poses")]
    Outside,
    /// The neighbours are too far apart.
    #[error("in a gap of {0:.3} s between poses")]
    Gap(f64),
    /// An invalid pose lies between the neighbours.
    #[error("next to an invalid pose")]
    Invalid,
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    time_ns: i64,
    /// `None`: an invalid pose; nothing is joined across it.
    pose: Option<Pose>,
}

/// Poses before a jump that its size is measured with, at least. Choice: with three after it they determine a parabola and
/// the jump.
const MIN_BEFORE: usize = 4;

/// How many poses before the suspected one [`frame_step`] may find a jump, or a bad pose.
const MAX_EARLIER: usize = 2;

/// Poses before a jump that show whether it is a return, nanoseconds, at least so many. Choice: with 46 ms after it, the change of
/// speed is known to 0.05 m/s.
const RETURN_WINDOW_NS: i64 = 200_000_000;
const MIN_BEFORE_RETURN: usize = 10;

/// A jump of the tracking frame that the path does not have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowedJump {
    /// Time of the first pose after it.
    pub first_after_ns: i64,
    /// What it changes of positions of this time on, as the map frame had them before it was known.
    pub before_from_after: Pose,
}

/// A jump that is suspected, and waits for the poses that its size is measured with.
#[derive(Debug, Clone, Copy)]
struct PendingJump {
    first_after_ns: i64,
}

/// Poses in rising time. The oldest are dropped on request.
#[derive(Debug, Clone)]
pub struct PoseHistory {
    settings: HistorySettings,
    entries: VecDeque<Entry>,
    jump_detector: JumpDetector,
    pending: Option<PendingJump>,
    map_from_tracking: Pose,
    last_jump: Option<FollowedJump>,
    jumps_followed: u64,
}

impl Default for PoseHistory {
    fn default() -> Self {
        Self::new(HistorySettings::default())
    }
}

impl PoseHistory {
    /// An empty history.
    pub fn new(settings: HistorySettings) -> Self {
        Self {
            settings,
            entries: VecDeque::new(),
            jump_detector: JumpDetector::default(),
            pending: None,
            map_from_tracking: Pose::IDENTITY,
            last_jump: None,
            jumps_followed: 0,
        }
    }

    /// Adds a pose, `tracking_from_head`. A refused pose with a rising time stays as a border that is not interpolated
    /// across; so does the last one before a jump of the tracking frame.
    ///
    /// # Errors
    /// The reason why it is not used.
    pub fn push(&mut self, sample: &PoseSample) -> Result<(), PoseRefusal> {
        if let Some(before_ns) = self.last_time_ns().filter(|&before| sample.time_ns <= before) {
            return Err(PoseRefusal::TimeNotRising { time_ns: sample.time_ns, before_ns });
        }
        let pose = sample.tracking_from_head();
        // A product with the identity rounds.
        let in_map = |pose: Pose| if self.jumps_followed == 0 { pose } else { self.map_from_tracking * pose };
        self.entries.push_back(Entry { time_ns: sample.time_ns, pose: pose.as_ref().ok().copied().map(in_map) });
        match &pose {
            Ok(pose) => {
                let jumped = self.jump_detector.push(sample.time_ns, pose);
                if jumped || self.is_pending_complete(sample.time_ns) {
                    self.follow_pending();
                }
                if jumped {
                    self.suspect_jump();
                }
            }
            Err(_) => {
                self.jump_detector.interrupt();
                self.follow_pending();
            }
        }
        pose.map(|_| ())
    }

    /// Transforms from the tracking frame of the newest pose to the map frame. It changes when a jump has been followed.
    pub fn map_from_tracking(&self) -> Pose {
        self.map_from_tracking
    }

    /// Jumps of the tracking frame so far that the path does not have.
    pub fn jumps_followed(&self) -> u64 {
        self.jumps_followed
    }

    /// The frame may have jumped between the fourth and the third newest entry. Waits for poses to measure by how much.
    fn suspect_jump(&mut self) {
        let Some(border) = self.entries.len().checked_sub(4) else { return };
        self.pending = Some(PendingJump { first_after_ns: self.entries[border + 1].time_ns });
    }

    /// Whether no later pose is waited for to measure the jump.
    fn is_pending_complete(&self, newest_ns: i64) -> bool {
        let since_ns = |pending: &PendingJump| newest_ns.saturating_sub(pending.first_after_ns);
        self.pending
            .as_ref()
            .is_some_and(|pending| since_ns(pending) >= (self.settings.smoothing_window_s * 0.5e9) as i64)
    }

    /// Measures the suspected jump and moves the poses after it back.
    fn follow_pending(&mut self) {
        let Some(PendingJump { first_after_ns }) = self.pending.take() else { return };
        let near = self.entries.partition_point(|entry| entry.time_ns < first_after_ns);
        let since_ns = first_after_ns.saturating_sub(self.settings.smooth_ns());
        let is_joined = |n: &usize| self.entries[*n].pose.is_some();
        let is_near = |n: &usize| near - *n <= MIN_BEFORE || self.entries[*n].time_ns >= since_ns;
        let first = (0..near).rev().take_while(|n| is_joined(n) && is_near(n)).last().unwrap_or(near);
        let end = (near..self.entries.len()).take_while(is_joined).last().map_or(near, |last| last + 1);
        let run = self.entries.range(first..end).filter_map(|entry| {
            let since_s = entry.time_ns.saturating_sub(first_after_ns) as f64 * 1e-9;
            entry.pose.map(|pose| (since_s, pose))
        });
        match frame_step(&run.collect::<Vec<_>>(), near - first) {
            FrameStep::Jump { first_after, before_from_after } => {
                self.follow(first + first_after, end, &before_from_after);
            }
            FrameStep::BadPose(bad) => self.entries[first + bad].pose = None,
            FrameStep::Nothing => {}
        }
    }

    /// Moves the poses from entry `first_after` on back by a jump, after which those up to `end` are joined. Where the tracker only
    /// returned, its poses of the excursion are not used instead, as far as they have not been.
    fn follow(&mut self, first_after: usize, end: usize, before_from_after: &Pose) {
        let first_after_ns = self.entries[first_after].time_ns;
        let excursion_s = self.excursion_s(first_after, end, before_from_after);
        self.entries[first_after - 1].pose = None;
        if let Some(excursion_s) = excursion_s {
            let since_ns = first_after_ns.saturating_sub((excursion_s * 1e9) as i64);
            let strayed = self.entries.range_mut(..first_after).filter(|entry| entry.time_ns >= since_ns);
            strayed.for_each(|entry| entry.pose = None);
            return;
        }
        if !self.settings.follow_jumps {
            return;
        }
        let later = self.entries.range_mut(first_after..).filter_map(|entry| entry.pose.as_mut());
        later.for_each(|pose| *pose = *before_from_after * *pose);
        self.map_from_tracking = *before_from_after * self.map_from_tracking;
        self.last_jump = Some(FollowedJump { first_after_ns, before_from_after: *before_from_after });
        self.jumps_followed += 1;
    }

    /// For how long the tracker had strayed, if the jump before entry `first_after` is its return.
    fn excursion_s(&self, first_after: usize, end: usize, before_from_after: &Pose) -> Option<f64> {
        let after = self.entries[first_after].pose?;
        let jump_m = after.translation - before_from_after.transform_point(after.translation);
        let first_after_ns = self.entries[first_after].time_ns;
        let since_ns = first_after_ns.saturating_sub(RETURN_WINDOW_NS);
        let is_used = |n: &usize| self.entries[*n].pose.is_some() && self.entries[*n].time_ns >= since_ns;
        let before = (0..first_after).rev().take_while(is_used).count();
        if before < MIN_BEFORE_RETURN {
            return None;
        }
        let run = self.entries.range(first_after - before..end).enumerate().filter_map(|(n, entry)| {
            let pose = entry.pose?;
            let since_s = entry.time_ns.saturating_sub(first_after_ns) as f64 * 1e-9;
            Some((since_s, if n < before { pose } else { *before_from_after * pose }))
        });
        strayed_s(jump_m, velocity_step(&run.collect::<Vec<_>>(), before)?)
    }

    /// Whether a jump of the tracking frame is being measured.
    pub fn is_measuring_jump(&self) -> bool {
        self.pending.is_some()
    }

    /// Until when no jump that is being measured, or may still be found, moves or removes a pose, but for the earlier poses of an
    /// excursion; `None` while there are too few.
    pub fn settled_until_ns(&self) -> Option<i64> {
        // The next pose may show a jump just before the second newest.
        let first_after = match &self.pending {
            Some(pending) => self.entries.partition_point(|entry| entry.time_ns < pending.first_after_ns),
            None => self.entries.len().checked_sub(2)?,
        };
        let last = first_after.checked_sub(MAX_EARLIER + 1)?;
        Some(self.entries.get(last)?.time_ns)
    }

    /// The last jump that the path does not have.
    pub fn last_jump(&self) -> Option<FollowedJump> {
        self.last_jump
    }

    /// Time of the newest entry, valid or not.
    pub fn last_time_ns(&self) -> Option<i64> {
        self.entries.back().map(|e| e.time_ns)
    }

    /// The newest valid pose, `map_from_head`, and its time.
    pub fn last_pose(&self) -> Option<(i64, Pose)> {
        self.entries.iter().rev().find_map(|e| e.pose.map(|p| (e.time_ns, p)))
    }

    /// Drops entries older than `time_ns`.
    pub fn remove_before(&mut self, time_ns: i64) {
        while self.entries.front().is_some_and(|e| e.time_ns < time_ns) {
            self.entries.pop_front();
        }
    }

    /// Drops the oldest entries beyond a number.
    pub fn keep_newest(&mut self, count: usize) {
        while self.entries.len() > count {
            self.entries.pop_front();
        }
        if self.entries.is_empty() {
            self.pending = None;
        }
    }

    /// Number of entries held.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing is held.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Checks that the poses before entry `later` and at it may be joined.
    fn check_joined(&self, later: usize) -> Result<(), NoPose> {
        let (a, b) = (&self.entries[later - 1], &self.entries[later]);
        if a.pose.is_none() || b.pose.is_none() {
            return Err(NoPose::Invalid);
        }
        // Stamps are untrusted: two of them may be further apart than an i64 holds.
        let gap_s = b.time_ns.saturating_sub(a.time_ns) as f64 * 1e-9;
        if gap_s > self.settings.max_gap_s { Err(NoPose::Gap(gap_s)) } else { Ok(()) }
    }

    /// The pose at a time.
    ///
    /// # Errors
    /// Outside the poses, in a gap, or next to an invalid pose.
    pub fn at(&self, time_ns: i64) -> Result<SmoothPose, NoPose> {
        self.at_with_poses_until(time_ns, i64::MIN)
    }

    /// The pose at a time, fitted to the poses up to `known_until_ns`, or up to where
    /// [`at`](Self::at) uses them if that is later.
    ///
    /// # Errors
    /// As [`at`](Self::at).
    pub fn at_with_poses_until(&self, time_ns: i64, known_until_ns: i64) -> Result<SmoothPose, NoPose> {
        let later = self.entries.partition_point(|e| e.time_ns < time_ns);
        if self.entries.is_empty() || later == self.entries.len() {
            return Err(NoPose::Outside);
        }
        if later == 0 && self.entries[0].time_ns > time_ns {
            return Err(NoPose::Outside);
        }
        if later > 0 && self.entries[later].time_ns != time_ns {
            self.check_joined(later)?;
        } else if self.entries[later].pose.is_none() {
            return Err(NoPose::Invalid);
        }
        let (first, last) = self.fit_window(time_ns, later, known_until_ns);
        self.fit(time_ns, first, last).ok_or(NoPose::Outside)
    }

    /// First and last entry (inclusive) around `later` that the fit may use: unbroken, within the
    /// smoothing window, not later than what is waited for or known, and at least the two
    /// neighbours.
    fn fit_window(&self, time_ns: i64, later: usize, known_until_ns: i64) -> (usize, usize) {
        let until_ns = known_until_ns.max(time_ns.saturating_add(self.settings.ahead_ns()));
        let half_ns = (self.settings.smoothing_window_s * 0.5e9) as i64;
        let (mut first, mut last) =
            if self.entries[later].time_ns == time_ns { (later, later) } else { (later - 1, later) };
        while first > 0 && self.check_joined(first).is_ok() && time_ns - self.entries[first - 1].time_ns <= half_ns {
            first -= 1;
        }
        while last + 1 < self.entries.len()
            && self.check_joined(last + 1).is_ok()
            && self.entries[last + 1].time_ns - time_ns <= half_ns
            && self.entries[last + 1].time_ns <= until_ns
        {
            last += 1;
        }
        // A single sample needs a neighbour to have a velocity.
        if first == last {
            if first > 0 && self.check_joined(first).is_ok() {
                first -= 1;
            } else if last + 1 < self.entries.len() && self.check_joined(last + 1).is_ok() {
                last += 1;
            }
        }
        (first, last)
    }

    fn fit(&self, time_ns: i64, first: usize, last: usize) -> Option<SmoothPose> {
        let run: Vec<(f64, Pose)> = self
            .entries
            .range(first..=last)
            .filter_map(|e| e.pose.map(|p| ((e.time_ns - time_ns) as f64 * 1e-9, p)))
            .collect();
        let reference = run.iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?.1;
        let times: Vec<f64> = run.iter().map(|r| r.0).collect();
        let Some(weights) = value_and_rate_weights(&times) else {
            return Some(SmoothPose {
                tracking_from_head: reference,
                velocity_m_per_s: DVec3::ZERO,
                angular_velocity_rad_per_s: DVec3::ZERO,
            });
        };
        // Relative to the nearest pose, so that distant origins cost no digits and rotations are
        // small.
        let mut position = DVec3::ZERO;
        let mut velocity = DVec3::ZERO;
        let mut turn = DVec3::ZERO;
        let mut turn_rate = DVec3::ZERO;
        for (weight, (_, pose)) in weights.iter().zip(&run) {
            let offset = pose.translation - reference.translation;
            let turned = rotation_vector(pose.rotation * reference.rotation.conjugate());
            position += offset * weight[0];
            velocity += offset * weight[1];
            turn += turned * weight[0];
            turn_rate += turned * weight[1];
        }
        Some(SmoothPose {
            tracking_from_head: Pose::new(
                reference.translation + position,
                DQuat::from_scaled_axis(turn) * reference.rotation,
            ),
            velocity_m_per_s: velocity,
            angular_velocity_rad_per_s: turn_rate,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::TrackingResult;
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const MS: i64 = 1_000_000;

    fn pose(x: f64, yaw: f64) -> Pose {
        Pose::new(DVec3::new(x, 1.6, 0.0), DQuat::from_rotation_y(yaw))
    }

    #[test]
    fn poses_later_than_max_ahead_are_ignored() {
        let mut at = Vec::new();
        for max_ahead_s in [0.0, 0.012, 0.046] {
            let settings = HistorySettings { max_ahead_s, ..Default::default() };
            let mut history = PoseHistory::new(settings);
            let x = |i: i64| 0.1 * (i as f64 * 0.2).sin() + if i % 2 == 0 { 1e-3 } else { 0.0 };
            let mut seen = None;
            for i in 0..30i64 {
                history.push(&PoseSample::valid(i * 8 * MS, &pose(x(i), 0.0))).unwrap();
                let complete = i * 8 * MS - settings.ahead_ns() >= 101 * MS;
                if complete {
                    let now = history.at(101 * MS).unwrap().tracking_from_head.translation;
                    assert_eq!(*seen.get_or_insert(now), now, "{max_ahead_s}");
                }
            }
            at.push(seen.unwrap().x);
        }
        assert!(at[0] != at[1] && at[1] != at[2] && at.iter().all(|x| (x - at[2]).abs() < 3e-3), "{at:?}");
    }

    #[test]
    fn later_poses_turn_early_path_into_smooth_one() {
        let at = |max_ahead_s: f64, known_until_ns: i64| {
            let mut history = PoseHistory::new(HistorySettings { max_ahead_s, ..Default::default() });
            for i in 0..30i64 {
                let jitter = if i % 2 == 0 { 1e-3 } else { 0.0 };
                history
                    .push(&PoseSample::valid(i * 8 * MS, &pose(0.1 * (i as f64 * 0.2).sin() + jitter, 0.0)))
                    .unwrap();
            }
            history.at_with_poses_until(101 * MS, known_until_ns).unwrap().tracking_from_head.translation
        };
        assert_eq!(at(0.0, 147 * MS), at(0.046, i64::MIN));
        assert_eq!(at(0.0, i64::MAX), at(0.046, i64::MAX));
        assert_ne!(at(0.0, 120 * MS), at(0.0, i64::MIN));
    }

    #[test]
    fn extreme_stamps_are_a_gap() {
        let mut history = PoseHistory::default();
        for time_ns in [i64::MIN, 0, 8 * MS, i64::MAX] {
            history.push(&PoseSample::valid(time_ns, &pose(0.0, 0.0))).unwrap();
        }
        for between_ns in [i64::MIN + 1, -8 * MS, 16 * MS, i64::MAX - 1] {
            assert!(matches!(history.at(between_ns), Err(NoPose::Gap(gap_s)) if gap_s > 9e9));
        }
        for time_ns in [i64::MIN, 4 * MS, i64::MAX] {
            assert!(history.at(time_ns).is_ok(), "{time_ns}");
        }
    }

    #[test]
    fn the_path_goes_on_where_the_tracking_frame_jumps() {
        let jump = Pose::new(DVec3::new(0.08, -0.02, 0.05), DQuat::from_rotation_y(0.08));
        let mut history = history(0.092);
        let x = |i: i64| 0.1 * (i as f64 * 0.05).sin();
        for i in 0..60i64 {
            let frame = if i < 30 { Pose::IDENTITY } else { jump };
            history.push(&PoseSample::valid(i * 8 * MS, &(frame * pose(x(i), 0.01 * i as f64)))).unwrap();
            let is_measured = !(32..36).contains(&i);
            assert_eq!(history.is_measuring_jump(), !is_measured, "pose {i}");
            let settled = history.settled_until_ns().map(|until_ns| until_ns / (8 * MS));
            let expected = if is_measured { i - 4 } else { 27 };
            assert_eq!(settled, (expected >= 0).then_some(expected), "pose {i}");
            assert_eq!(history.jumps_followed(), u64::from(i >= 36), "46 ms after the jump");
        }
        for i in [10, 29, 30, 31, 40, 59] {
            let at = history.at(i * 8 * MS);
            if i == 29 {
                assert_eq!(at, Err(NoPose::Invalid), "nothing is interpolated across the jump");
                continue;
            }
            let (at, expected) = (at.unwrap().tracking_from_head, pose(x(i), 0.01 * i as f64));
            assert!(at.translation.distance(expected.translation) < 1e-4, "pose {i}");
            assert!(at.rotation.angle_between(expected.rotation) < 1e-4, "pose {i}");
        }
        let followed = history.map_from_tracking() * jump;
        assert!(followed.translation.length() < 1e-4 && followed.rotation.angle_between(DQuat::IDENTITY) < 1e-4);
    }

    #[test]
    fn a_bad_pose_is_left_out_and_moves_no_frame() {
        let mut history = history(0.092);
        for i in 0..60i64 {
            let off = if i == 30 { DVec3::Y * 0.02 } else { DVec3::ZERO };
            // Jitter, so that the bad pose is not found by its symmetry.
            let jitter = DVec3::X * 1e-4 * (i as f64 * 2.4).sin();
            let at = pose(0.001 * i as f64, 0.0);
            history
                .push(&PoseSample::valid(i * 8 * MS, &Pose { translation: at.translation + off + jitter, ..at }))
                .unwrap();
        }
        assert_eq!((history.jumps_followed(), history.map_from_tracking()), (0, Pose::IDENTITY));
        assert_eq!(history.at(30 * 8 * MS), Err(NoPose::Invalid));
        assert!((history.at(31 * 8 * MS).unwrap().tracking_from_head.translation.y - 1.6).abs() < 1e-3);
    }

    #[test]
    fn a_jump_that_loss_of_tracking_cuts_short_is_still_followed() {
        let mut history = history(0.092);
        for i in 0..34i64 {
            let at = pose(0.05 * f64::from(u8::from(i >= 30)), 0.0);
            history.push(&PoseSample::valid(i * 8 * MS, &at)).unwrap();
        }
        let lost = PoseSample { valid: false, ..PoseSample::valid(34 * 8 * MS, &pose(0.05, 0.0)) };
        assert_eq!(history.push(&lost), Err(PoseRefusal::Invalid));
        assert_eq!((history.jumps_followed(), history.is_measuring_jump()), (1, false));
        assert!((history.last_pose().unwrap().1.translation.x).abs() < 1e-4);
    }

    #[test]
    fn a_tracker_that_strayed_and_returned_moves_nothing() {
        // Error of the acceleration, metres a second squared, and how long it lasts: up to 0.6 m.
        for (acceleration, strays_s) in [(1.0, 0.5), (2.0, 0.5), (5.0, 0.3), (5.0, 0.5), (0.5, 1.2)] {
            for first in [100, 117, 141] {
                let returned = first + (strays_s * 120.0) as i64;
                let mut history = PoseHistory::default();
                let mut last_ns = 0;
                for n in 0..returned + 60 {
                    let mut pose = head_at(n);
                    let strayed_s = (n - first) as f64 / 120.0;
                    if (first..returned).contains(&n) {
                        pose.translation +=
                            DVec3::new(0.8, -0.1, 0.6).normalize() * (0.5 * acceleration * strayed_s * strayed_s);
                    }
                    last_ns = n * 25 * MS / 3;
                    history.push(&PoseSample::valid(last_ns, &pose)).unwrap();
                }
                let case = format!("{acceleration} m/s² for {strays_s} s from pose {first}");
                assert_eq!(history.jumps_followed(), 0, "{case}");
                let now = history.at(last_ns).unwrap().tracking_from_head.translation;
                assert!(now.distance(head_at(returned + 59).translation) < 1e-3, "{case}");
                let strayed_ns = (returned - 2) * 25 * MS / 3;
                assert!(history.at(strayed_ns).is_err(), "{case}: its last poses are used");
            }
        }
    }

    #[test]
    fn jumps_of_the_frame_are_hardly_ever_taken_for_returns() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut vector = || DVec3::new(normal(), normal(), normal());
        for size_m in [0.06, 0.1, 0.3] {
            let mut followed = 0;
            for n in 0..200 {
                let jump = Pose::from_translation(vector().normalize() * size_m);
                let mut history = PoseHistory::default();
                for i in 0..80 {
                    let frame = if i < 50 { Pose::IDENTITY } else { jump };
                    let pose = frame * head_at(i + 13 * n);
                    let noisy = Pose { translation: pose.translation + vector() * 0.3e-3, ..pose };
                    history.push(&PoseSample::valid(i * 25 * MS / 3, &noisy)).unwrap();
                }
                followed += history.jumps_followed();
            }
            assert!(followed >= 196, "{followed} of 200 at {size_m} m");
        }
    }

    /// Where a brisk head is at pose `n` of 120 a second.
    fn head_at(n: i64) -> Pose {
        let t = n as f64 / 120.0;
        let position_m = DVec3::new((6.0 * t).sin(), 0.3 * (9.0 * t).cos(), (4.0 * t).sin()) * 0.12 + DVec3::Y * 1.6;
        let turn_rad = DVec3::new(0.2 * (5.0 * t).sin(), (2.0 * t).sin(), 0.1 * (8.0 * t).sin());
        Pose::new(position_m, DQuat::from_scaled_axis(turn_rad))
    }

    fn history(smoothing_window_s: f64) -> PoseHistory {
        PoseHistory::new(HistorySettings { smoothing_window_s, ..Default::default() })
    }

    #[test]
    fn straight_motion_is_interpolated_exactly() {
        for window in [0.0, 0.092] {
            let mut history = history(window);
            for i in 0..40i64 {
                history.push(&PoseSample::valid(i * 8 * MS, &pose(i as f64 * 0.008, i as f64 * 0.016))).unwrap();
            }
            let at = history.at(100 * MS).unwrap();
            assert!((at.tracking_from_head.translation.x - 0.1).abs() < 1e-9);
            assert!((at.velocity_m_per_s - DVec3::X).length() < 1e-6);
            assert!((at.angular_velocity_rad_per_s - DVec3::Y * 2.0).length() < 1e-6);
        }
    }

    #[test]
    fn gaps_and_invalid_poses_are_not_bridged() {
        let mut history = history(0.092);
        for i in 0..10 {
            history.push(&PoseSample::valid(i * 10 * MS, &pose(0.0, 0.0))).unwrap();
        }
        for i in 20..30 {
            history.push(&PoseSample::valid(i * 10 * MS, &pose(5.0, 0.0))).unwrap();
        }
        assert!(matches!(history.at(150 * MS), Err(NoPose::Gap(gap)) if (gap - 0.11).abs() < 1e-9));
        let lost = PoseSample { valid: false, ..PoseSample::valid(295 * MS, &pose(9.0, 0.0)) };
        assert_eq!(history.push(&lost), Err(PoseRefusal::Invalid));
        for i in 30..40 {
            history.push(&PoseSample::valid(i * 10 * MS, &pose(6.0, 0.0))).unwrap();
        }
        assert_eq!(history.at(293 * MS), Err(NoPose::Invalid));
        assert_eq!(history.at(295 * MS), Err(NoPose::Invalid));
        // Next to the border the fit uses one side only, so nothing of the jump leaks in.
        assert!((history.at(288 * MS).unwrap().tracking_from_head.translation.x - 5.0).abs() < 1e-9);
        assert!((history.at(302 * MS).unwrap().tracking_from_head.translation.x - 6.0).abs() < 1e-9);
        assert_eq!(history.at(-1), Err(NoPose::Outside));
        assert_eq!(history.at(391 * MS), Err(NoPose::Outside));
    }

    #[test]
    fn refused_poses_name_the_reason() {
        let mut history = history(0.0);
        history.push(&PoseSample::valid(10, &pose(0.0, 0.0))).unwrap();
        let same_time = PoseSample::valid(10, &pose(0.0, 0.0));
        assert!(matches!(history.push(&same_time), Err(PoseRefusal::TimeNotRising { .. })));
        let nan = PoseSample { position_m: [f64::NAN; 3], ..PoseSample::valid(20, &pose(0.0, 0.0)) };
        assert!(matches!(history.push(&nan), Err(PoseRefusal::Numbers(_))));
        let zero = PoseSample { quaternion_xyzw: [0.0; 4], ..PoseSample::valid(30, &pose(0.0, 0.0)) };
        assert!(matches!(history.push(&zero), Err(PoseRefusal::Numbers(_))));
        let lost = PoseSample { result: TrackingResult::OutOfRange, ..PoseSample::valid(40, &pose(0.0, 0.0)) };
        assert_eq!(history.push(&lost), Err(PoseRefusal::Result(TrackingResult::OutOfRange)));
    }
}
