//! The session frame: keeps the map in place when the user recentres, and detects when it becomes
//! invalid.
//!
//! The map uses the session frame: the standing universe at the start, fixed to the raw universe,
//! which recentring does not move. So poses and map agree at any time, whenever the news of a
//! recentring arrives. Only the standing universe, which defines the floor, moves against both.
//! When the tracking system reports another room, or its raw universe leaps, all earlier positions
//! are invalid: the session frame is defined anew and the map is reset.

use std::collections::VecDeque;

use glam::DVec3;
use radar_sar::geometry::Pose;

/// Poses of the universe closer than this are the same, metres and radians. Choice: well above the
/// rounding of the runtime's f32 matrices at 10 m (1 µm), far below what one sees.
const SAME_M: f64 = 1e-4;
const SAME_RAD: f64 = 1e-4;
/// Largest speed of a head, m/s; a faster pose is a leap of the tracking universe. Choice: faster
/// than any head moves (a sprinter reaches 12 m/s), so no motion resets the map.
const MAX_HEAD_M_PER_S: f64 = 15.0;
/// Least step that counts as a leap, metres: tracking corrections between two frames are smaller.
/// Choice: about a step; a wrong reset costs the whole map, a missed one displaces it by this much.
const MIN_LEAP_M: f64 = 0.2;
/// Poses farther apart in time are not compared, nanoseconds. Choice: five frames at 90 Hz; over
/// longer gaps the speed limit would allow a metre.
const MAX_PAIR_NS: i64 = 60_000_000;
/// Time over which the speed before a leap is taken, nanoseconds. Choice: nine frames at 90 Hz.
const RECENT_NS: i64 = 100_000_000;

/// Change of the tracking frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AnchorChange {
    /// No change.
    Unchanged,
    /// The user recentred: the map stays in place in the room.
    Recentred,
    /// All earlier positions are invalid.
    NewUniverse,
}

/// The session frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Anchor {
    session_from_raw: Pose,
    standing_from_raw: Pose,
    universe: Option<u64>,
}

impl Anchor {
    /// Defines the session frame as the current standing universe.
    pub fn new(standing_from_raw: Pose, universe: Option<u64>) -> Self {
        Self { session_from_raw: standing_from_raw, standing_from_raw, universe }
    }

    /// Takes the current standing universe and the tracking system's id of the room.
    pub fn update(&mut self, standing_from_raw: Pose, universe: Option<u64>) -> AnchorChange {
        // A missing id is not another room.
        if universe.is_some() && self.universe.is_some() && universe != self.universe {
            *self = Self::new(standing_from_raw, universe);
            return AnchorChange::NewUniverse;
        }
        self.universe = universe.or(self.universe);
        let (before, now) = (self.standing_from_raw, standing_from_raw);
        let is_same = before.translation.distance(now.translation) < SAME_M
            && before.rotation.angle_between(now.rotation) < SAME_RAD;
        if is_same {
            return AnchorChange::Unchanged;
        }
        self.standing_from_raw = standing_from_raw;
        AnchorChange::Recentred
    }

    /// The raw universe has leapt: defines the session frame anew.
    pub fn rebase(&mut self) {
        self.session_from_raw = self.standing_from_raw;
    }

    /// Transforms poses of the raw universe into the session frame.
    pub fn session_from_raw(&self) -> Pose {
        self.session_from_raw
    }

    /// Transforms poses of the raw universe into the current standing universe.
    pub fn standing_from_raw(&self) -> Pose {
        self.standing_from_raw
    }

    /// The tracking system's id of the room.
    pub fn universe(&self) -> Option<u64> {
        self.universe
    }

    /// Transforms positions of the map into the current play area.
    pub fn standing_from_session(&self) -> Pose {
        self.standing_from_raw * self.session_from_raw.inverse()
    }

    /// Transforms positions of the play area into the raw universe.
    pub fn raw_from_standing(&self) -> Pose {
        self.standing_from_raw.inverse()
    }
}

/// Distinguishes a leap of the raw universe from motion of the head, and from the return of a tracker that has strayed.
#[derive(Debug, Default)]
pub(super) struct LeapDetector {
    /// Valid poses of the last tenth of a second, without a leap between them.
    recent: VecDeque<(i64, DVec3)>,
}

impl LeapDetector {
    /// Whether the universe has leapt between the previous valid pose and this one.
    pub fn push(&mut self, time_ns: i64, raw_from_head: Pose) -> bool {
        let head_m = raw_from_head.translation;
        let before = self.recent.back().copied();
        let step_m = before.and_then(|(before_ns, before_m)| {
            let apart_ns = time_ns.saturating_sub(before_ns);
            let allowed_m = MIN_LEAP_M.max(MAX_HEAD_M_PER_S * apart_ns as f64 * 1e-9);
            let step_m = head_m - before_m;
            ((0..=MAX_PAIR_NS).contains(&apart_ns) && step_m.length() > allowed_m).then_some(step_m)
        });
        let has_leapt = step_m.is_some_and(|step_m| !self.is_return(step_m));
        if step_m.is_some() {
            self.recent.clear();
        }
        self.recent.push_back((time_ns, head_m));
        while self.recent.front().is_some_and(|(of_ns, _)| time_ns.saturating_sub(*of_ns) > RECENT_NS) {
            self.recent.pop_front();
        }
        has_leapt
    }

    /// Whether a step undoes what a tracker without references has strayed: it then had the speed that acceleration alone gives, against
    /// the step. Whether the map follows the step, the mapper decides when it knows the speed after it as well.
    fn is_return(&self, step_m: DVec3) -> bool {
        let (Some((first_ns, first_m)), Some((last_ns, last_m))) = (self.recent.front(), self.recent.back()) else {
            return false;
        };
        let passed_s = last_ns.saturating_sub(*first_ns) as f64 * 1e-9;
        let velocity_m_per_s = (*last_m - *first_m) / passed_s.max(1e-3);
        radar_sar::strayed_s(step_m, -velocity_m_per_s).is_some()
    }

    /// Tracking was lost: the next pose may be anywhere.
    pub fn lost(&mut self) {
        self.recent.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn turned(yaw_deg: f64, x: f64, z: f64) -> Pose {
        Pose::new(DVec3::new(x, 0.0, z), DQuat::from_rotation_y(yaw_deg.to_radians()))
    }

    fn same(a: &Pose, b: &Pose) -> bool {
        a.translation.distance(b.translation) < 1e-12 && a.rotation.angle_between(b.rotation) < 1e-7
    }

    #[test]
    fn recentring_keeps_the_map_in_place() {
        let start = turned(30.0, 0.3, -0.1);
        let mut anchor = Anchor::new(start, Some(7));
        let raw_chair = DVec3::new(1.0, 0.4, -2.0);
        let chair = anchor.session_from_raw().transform_point(raw_chair);
        assert_eq!(anchor.update(start, Some(7)), AnchorChange::Unchanged);
        let after = turned(-50.0, 1.0, 0.7);
        assert_eq!(anchor.update(after, Some(7)), AnchorChange::Recentred);
        assert!((anchor.session_from_raw().transform_point(raw_chair) - chair).length() < 1e-12, "the map stays");
        let in_play_area = anchor.standing_from_session().transform_point(chair);
        assert!((in_play_area - after.transform_point(raw_chair)).length() < 1e-12, "drawn by the play area of now");
        let back = anchor.raw_from_standing().transform_point(in_play_area);
        assert!((back - raw_chair).length() < 1e-12, "and never elsewhere in the room");
    }

    #[test]
    fn new_universe_resets_the_anchor() {
        let mut anchor = Anchor::new(turned(30.0, 0.3, -0.1), Some(7));
        let there = turned(5.0, 2.0, 2.0);
        assert_eq!(anchor.update(there, None), AnchorChange::Recentred, "unknown universe");
        assert_eq!(anchor.update(there, Some(8)), AnchorChange::NewUniverse);
        assert!(same(&anchor.standing_from_session(), &Pose::IDENTITY));
        assert_eq!(anchor.update(there, Some(8)), AnchorChange::Unchanged);
    }

    #[test]
    fn unknown_universe_is_no_change() {
        let mut anchor = Anchor::new(Pose::IDENTITY, None);
        assert_eq!(anchor.update(Pose::IDENTITY, Some(3)), AnchorChange::Unchanged);
        assert_eq!(anchor.update(Pose::IDENTITY, Some(4)), AnchorChange::NewUniverse);
    }

    #[test]
    fn leap_detector_accepts_head_motion() {
        let mut watch = LeapDetector::default();
        let at = |x: f64| Pose::from_translation(DVec3::new(x, 1.6, 0.0));
        assert!(!watch.push(0, at(0.0)));
        assert!(!watch.push(11_000_000, at(0.15)), "a correction of tracking");
        assert!(watch.push(22_000_000, at(0.6)));
        assert!(!watch.push(33_000_000, at(0.61)), "reported once");
        watch.lost();
        assert!(!watch.push(44_000_000, at(3.0)), "found again elsewhere");
        assert!(!watch.push(244_000_000, at(0.0)), "too long ago to compare");
    }

    #[test]
    fn the_return_of_a_tracker_that_has_strayed_is_no_leap() {
        // By acceleration alone, with an error of 2 m/s² for half a second; a step of the same size the other way is one.
        for (to_m, is_leap) in [(0.0, false), (0.5, true)] {
            let mut watch = LeapDetector::default();
            let mut leaps = 0;
            for n in 0..100i64 {
                let since_s = n as f64 / 90.0;
                let x = if n < 45 { since_s * since_s } else { to_m };
                let pose = Pose::from_translation(DVec3::new(x, 1.6, 0.0));
                leaps += usize::from(watch.push(n * 11_111_111, pose));
            }
            assert_eq!(leaps, usize::from(is_leap), "to {to_m} m");
        }
    }
}
