//! Where the room lies: what keeps the map in its place when the user recentres, and says when it is worthless.
//!
//! The radar's map is kept in a frame of the session: the standing universe as it was at the start, fixed to the raw universe, which
//! recentring does not move. So poses and map agree at every moment, whenever news of a recentring arrives; only the standing
//! universe, which says where the floor is, moves against both. A tracking system that takes the room for another, or whose raw
//! universe leaps, makes all places of before worthless: then the session's frame is laid anew and everything is forgotten.

use radar_sar::geometry::Pose;

/// Poses of the universe this much apart are the same.
const SAME_M: f64 = 1e-4;
const SAME_RAD: f64 = 1e-4;
/// No head moves faster, m/s: what does is the tracking system's universe.
const MAX_HEAD_M_PER_S: f64 = 15.0;
/// Nor does it get so far between two frames by a correction of tracking, metres.
const MIN_LEAP_M: f64 = 0.2;
/// Poses farther apart in time say nothing about a leap, nanoseconds.
const MAX_PAIR_NS: i64 = 60_000_000;

/// What became of the room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AnchorChange {
    /// Nothing.
    Unchanged,
    /// The user recentred: the map stays where it is in the room.
    Recentred,
    /// The places of before mean nothing any more.
    NewUniverse,
}

/// The session's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Anchor {
    session_from_raw: Pose,
    standing_from_raw: Pose,
    universe: Option<u64>,
}

impl Anchor {
    /// The session's frame is the standing universe of now.
    pub fn new(standing_from_raw: Pose, universe: Option<u64>) -> Self {
        Self { session_from_raw: standing_from_raw, standing_from_raw, universe }
    }

    /// Takes in where the standing universe is now and which room the tracking system believes to be in.
    pub fn update(&mut self, standing_from_raw: Pose, universe: Option<u64>) -> AnchorChange {
        // A room that is not told for a moment is no other room.
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

    /// The raw universe has leapt: lays the session's frame anew.
    pub fn rebase(&mut self) {
        self.session_from_raw = self.standing_from_raw;
    }

    /// What turns poses of the raw universe into the session's.
    pub fn session_from_raw(&self) -> Pose {
        self.session_from_raw
    }

    /// Where the standing universe is now.
    pub fn standing_from_raw(&self) -> Pose {
        self.standing_from_raw
    }

    /// The tracking system's name for the room.
    pub fn universe(&self) -> Option<u64> {
        self.universe
    }

    /// What turns the map's places into those of the play area as it is now.
    pub fn standing_from_session(&self) -> Pose {
        self.standing_from_raw * self.session_from_raw.inverse()
    }

    /// What turns places of the play area into those of the raw universe.
    pub fn raw_from_standing(&self) -> Pose {
        self.standing_from_raw.inverse()
    }
}

/// Tells a leap of the raw universe from a head's motion.
#[derive(Debug, Default)]
pub(super) struct LeapDetector {
    last: Option<(i64, Pose)>,
}

impl LeapDetector {
    /// Whether the universe has leapt between the trusted pose before and this one.
    pub fn push(&mut self, time_ns: i64, raw_from_head: Pose) -> bool {
        let Some((before_ns, before)) = self.last.replace((time_ns, raw_from_head)) else { return false };
        let apart_ns = time_ns.saturating_sub(before_ns);
        if !(0..=MAX_PAIR_NS).contains(&apart_ns) {
            return false;
        }
        let allowed_m = MIN_LEAP_M.max(MAX_HEAD_M_PER_S * apart_ns as f64 * 1e-9);
        raw_from_head.translation.distance(before.translation) > allowed_m
    }

    /// The head was lost: what comes next may be elsewhere.
    pub fn lost(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

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
        assert_eq!(anchor.update(there, None), AnchorChange::Recentred, "not told which");
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
        assert!(!watch.push(33_000_000, at(0.61)), "told once");
        watch.lost();
        assert!(!watch.push(44_000_000, at(3.0)), "found again elsewhere");
        assert!(!watch.push(244_000_000, at(0.0)), "too long ago to tell");
    }
}
