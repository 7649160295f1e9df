//! The frame of reference of a session: what head poses and the map are expressed in.
//!
//! It follows the standing universe, which the user may recentre, and the raw universe, which may
//! change or leap. Each change that makes earlier positions invalid asks for a reset of the map.

use std::sync::{MutexGuard, PoisonError};

use super::anchor::{Anchor, AnchorChange, LeapDetector};
use super::pose_thread::{RoomFrame, SharedFrame};
use crate::openvr::{Poses, Runtime};

/// Interval of checks of the standing universe, nanoseconds; an event triggers one at once. Choice:
/// after a recentring panels stand wrong for this long if its event is missed; ten calls a second.
const CHECK_INTERVAL_NS: i64 = 100_000_000;

/// After a change it is checked in every frame for this time, nanoseconds: other programs move the standing universe continuously
/// while the user drags the play space. Choice: a pause within a drag.
const FOLLOW_NS: i64 = 1_000_000_000;

/// The session's frame, shared with the threads that read poses and save the map.
pub(super) struct SessionFrame<'s> {
    shared: &'s SharedFrame,
    /// `None` before the standing universe is known.
    anchor: Option<Anchor>,
    leap: LeapDetector,
    /// How often the raw universe has leapt.
    leaps: u64,
    /// How often the user requested a map reset.
    map_resets: u64,
    checked_ns: i64,
    /// Until then it is checked in every frame.
    follow_until_ns: i64,
}

impl<'s> SessionFrame<'s> {
    pub fn new(shared: &'s SharedFrame) -> Self {
        Self {
            shared,
            anchor: None,
            leap: LeapDetector::default(),
            leaps: 0,
            map_resets: 0,
            checked_ns: i64::MIN,
            follow_until_ns: i64::MIN,
        }
    }

    pub fn anchor(&self) -> Option<Anchor> {
        self.anchor
    }

    /// Makes the next [`check`](Self::check) due at once.
    pub fn check_soon(&mut self) {
        self.checked_ns = i64::MIN;
    }

    /// Compares the universes with those before, when that is due. The change is shared, except that
    /// of a new universe, whose reset shares it.
    pub fn check(&mut self, runtime: &Runtime, now_ns: i64) -> AnchorChange {
        if now_ns.saturating_sub(self.checked_ns) < CHECK_INTERVAL_NS && now_ns >= self.follow_until_ns {
            return AnchorChange::Unchanged;
        }
        self.checked_ns = now_ns;
        let Some(standing_from_raw) = runtime.standing_from_raw() else { return AnchorChange::Unchanged };
        let universe = runtime.universe_id();
        let Some(anchor) = &mut self.anchor else {
            self.anchor = Some(Anchor::new(standing_from_raw, universe));
            self.share();
            return AnchorChange::Unchanged;
        };
        let before = anchor.universe();
        let change = anchor.update(standing_from_raw, universe);
        let is_renamed = anchor.universe() != before;
        match change {
            // The room's id may have become known only now.
            AnchorChange::Unchanged if is_renamed => self.share(),
            AnchorChange::Recentred => {
                self.follow_until_ns = now_ns.saturating_add(FOLLOW_NS);
                self.share();
            }
            AnchorChange::Unchanged | AnchorChange::NewUniverse => {}
        }
        change
    }

    /// Follows the head; returns whether the origin of the raw universe has moved.
    pub fn has_leapt(&mut self, time_ns: i64, poses: &Poses) -> bool {
        let Some(head) = poses.head.valid_pose() else {
            self.leap.lost();
            return false;
        };
        if !self.leap.push(time_ns, head) {
            return false;
        }
        let Some(anchor) = &mut self.anchor else { return false };
        anchor.rebase();
        self.leaps += 1;
        true
    }

    /// The user requested a reset of the map.
    pub fn count_map_reset(&mut self) {
        self.map_resets += 1;
    }

    /// Holds the frame while it changes: the pose thread holds it until its pose has been pushed, so
    /// no pose of the new frame reaches the old map, and none of the old frame the new map.
    pub fn lock(&self) -> MutexGuard<'s, Option<RoomFrame>> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The current frame.
    pub fn room_frame(&self) -> Option<RoomFrame> {
        self.anchor.map(|anchor| RoomFrame {
            session_from_raw: anchor.session_from_raw(),
            standing_from_raw: anchor.standing_from_raw(),
            universe: anchor.universe(),
            leaps: self.leaps,
            map_resets: self.map_resets,
        })
    }

    /// Shares the frame: a few times a session.
    fn share(&self) {
        *self.lock() = self.room_frame();
    }
}
