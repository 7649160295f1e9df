//! Reads the poses of head and hands only, for a recording without a frame loop.

use radar_mapping::Event;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::anchor::{Anchor, AnchorChange, LeapDetector};
use super::samples::{HandSampler, poses_now, sample};
use super::status::EventSink;
use crate::app::now_ns;
use crate::openvr::{Hands, Runtime};

/// Interval of checks of the standing universe, nanoseconds. Choice: a recentring is rare, and
/// poses in the raw universe do not depend on it; saves a call per pose.
const CHECK_INTERVAL_NS: i64 = 250_000_000;

/// Reads head poses in the standing universe as it was at the first pose.
pub struct HeadPoses<'a> {
    runtime: &'a Runtime,
    anchor: Option<Anchor>,
    leap: LeapDetector,
    checked_ns: i64,
    hands: Hands,
    hand_sampler: HandSampler,
}

impl<'a> HeadPoses<'a> {
    /// Without any pose yet.
    pub fn new(runtime: &'a Runtime) -> Self {
        let (hands, hand_sampler) = (Hands::NONE, HandSampler::default());
        Self { runtime, anchor: None, leap: LeapDetector::default(), checked_ns: i64::MIN, hands, hand_sampler }
    }

    /// Reads poses at this rate until asked to stop.
    pub fn read(mut self, rate_hz: f64, sink: EventSink, stop: &AtomicBool) {
        let period = Duration::from_secs_f64(1.0 / rate_hz);
        while !stop.load(Ordering::Relaxed) {
            let start_ns = now_ns();
            self.update_anchor(start_ns);
            self.read_one(sink);
            // SteamVR's events are not used, but their queue must be emptied.
            while self.runtime.next_event().is_some() {}
            let took = Duration::from_nanos(now_ns().saturating_sub(start_ns).max(0) as u64);
            std::thread::sleep(period.saturating_sub(took));
        }
    }

    fn read_one(&mut self, sink: EventSink) {
        let (Some(anchor), Some((time_ns, poses))) = (&mut self.anchor, poses_now(self.runtime, self.hands)) else {
            return;
        };
        match poses.head.valid_pose() {
            None => self.leap.lost(),
            Some(head) if self.leap.push(time_ns, head) => {
                anchor.rebase();
                log::warn!("the origin of the tracking system has moved: positions before and after do not match");
            }
            Some(_) => {}
        }
        sink(Event::Pose(sample(time_ns, &poses.head, &anchor.session_from_raw())));
        if let Some(hands) = self.hand_sampler.next(time_ns, &poses, &anchor.session_from_raw()) {
            sink(Event::Hands(hands));
        }
    }

    fn update_anchor(&mut self, now_ns: i64) {
        if now_ns.saturating_sub(self.checked_ns) < CHECK_INTERVAL_NS {
            return;
        }
        self.checked_ns = now_ns;
        // Controllers may have been switched on or off.
        self.hands = self.runtime.hands();
        let Some(standing_from_raw) = self.runtime.standing_from_raw() else { return };
        let universe = self.runtime.universe_id();
        match &mut self.anchor {
            None => self.anchor = Some(Anchor::new(standing_from_raw, universe)),
            Some(anchor) => {
                if anchor.update(standing_from_raw, universe) == AnchorChange::NewUniverse {
                    log::warn!("the tracking system reports another room: positions before and after do not match");
                }
            }
        }
    }
}
