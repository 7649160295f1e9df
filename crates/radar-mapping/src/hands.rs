//! Where the player's own hands were, as far as their controllers are tracked: what is there is no furniture, and no hand goes through any.

use std::collections::VecDeque;
use std::ops::Range;

use glam::DVec3;

/// Left and right hand, tracking frame, metres; `None` for one that is not tracked.
pub type HandsM = [Option<DVec3>; 2];

/// Where the hands were at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandsSample {
    /// Host's monotonic clock, nanoseconds.
    pub time_ns: i64,
    /// Where they were.
    pub hands_m: HandsM,
}

/// No hand is farther from the radar on the forehead than an arm reaches, metres: such a controller was put down.
const ARM_LENGTH_M: f64 = 1.2;
/// A hand with what it holds and the pulse's width: so far around its range everything may be the hand, metres.
const HAND_HALF_EXTENT_M: f64 = 0.17;
/// The forearm, from wrist to elbow, echoes from as much nearer than the hand, metres.
const FOREARM_LENGTH_M: f64 = 0.2;

/// Between which ranges a hand, what it holds and its forearm echo, if the palm is at a range, metres.
pub fn hand_ranges_m(palm_range_m: f64) -> Range<f64> {
    palm_range_m - FOREARM_LENGTH_M - HAND_HALF_EXTENT_M..palm_range_m + HAND_HALF_EXTENT_M
}

/// Places of before are kept for so long, nanoseconds: longer than any window of blocks.
const RETENTION_NS: i64 = 25_000_000_000;
/// Between two that are kept, nanoseconds.
const MIN_STEP_NS: i64 = 10_000_000;
/// Nobody's times go back so far, nanoseconds.
const MAX_BACKWARD_STEP_NS: i64 = 1_000_000_000;
/// A place says nothing of times farther away than this, nanoseconds.
const MAX_SAMPLE_DISTANCE_NS: i64 = 100_000_000;

/// Places of the hands over the last seconds, in time.
#[derive(Debug, Default)]
pub struct HandTrail(VecDeque<(i64, HandsM)>);

impl HandTrail {
    /// Takes where they are; what is not newer than the newest is left out, and so are places that are none and controllers that are out of
    /// reach of where the radar is, if that is known. A time far before the newest shows that the newest were wrong.
    pub fn push(&mut self, time_ns: i64, hands_m: HandsM, sensor_m: Option<DVec3>) {
        if self.0.back().is_some_and(|(last_ns, _)| last_ns.saturating_sub(time_ns) > MAX_BACKWARD_STEP_NS) {
            while self.0.pop_back_if(|(later_ns, _)| *later_ns > time_ns).is_some() {}
        }
        if self.0.back().is_some_and(|(last_ns, _)| time_ns.saturating_sub(*last_ns) < MIN_STEP_NS) {
            return;
        }
        let is_held =
            |hand: &DVec3| hand.is_finite() && sensor_m.is_none_or(|sensor| sensor.distance(*hand) <= ARM_LENGTH_M);
        self.0.push_back((time_ns, hands_m.map(|hand| hand.filter(is_held))));
        while self.0.pop_front_if(|(old_ns, _)| time_ns.saturating_sub(*old_ns) > RETENTION_NS).is_some() {}
    }

    /// Whether a hand was this near to a place since a time.
    pub fn came_near(&self, place: DVec3, within_m: f64, since_ns: i64) -> bool {
        let recent = self.0.iter().rev().take_while(|(at_ns, _)| *at_ns >= since_ns);
        recent.flat_map(|(_, hands_m)| hands_m).flatten().any(|hand| hand.distance(place) < within_m)
    }

    /// Where they were at a time.
    pub fn at(&self, time_ns: i64) -> HandsM {
        let later = self.0.partition_point(|(at_ns, _)| *at_ns < time_ns);
        let around = [later.checked_sub(1).and_then(|n| self.0.get(n)), self.0.get(later)];
        let near = around.into_iter().flatten().min_by_key(|(at_ns, _)| at_ns.abs_diff(time_ns));
        let near = near.filter(|(at_ns, _)| at_ns.abs_diff(time_ns) <= MAX_SAMPLE_DISTANCE_NS as u64);
        near.map_or([None; 2], |(_, hands_m)| *hands_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_ranges_cover_palm_and_forearm() {
        let ranges = hand_ranges_m(0.6);
        assert!([0.25, 0.4, 0.6, 0.75].iter().all(|range_m| ranges.contains(range_m)), "{ranges:?}");
        assert!([0.2, 0.8].iter().all(|range_m| !ranges.contains(range_m)), "{ranges:?}");
    }

    #[test]
    fn controller_beyond_arm_length_is_ignored() {
        let mut trail = HandTrail::default();
        let hands = [Some(DVec3::X * 0.7), Some(DVec3::X * 1.5)];
        trail.push(0, hands, Some(DVec3::ZERO));
        trail.push(100_000_000, hands, Some(DVec3::X * 0.6));
        trail.push(200_000_000, hands, None);
        assert_eq!([0, 100_000_000, 200_000_000].map(|at_ns| trail.at(at_ns)), [[hands[0], None], hands, hands]);
    }

    #[test]
    fn nearest_sample_in_time_is_used_and_old_ones_expire() {
        let mut trail = HandTrail::default();
        assert_eq!(trail.at(0), [None; 2]);
        let hand = |x: f64| [Some(DVec3::X * x), None];
        for n in 0..10_000i64 {
            trail.push(n * 20_000_000, hand(n as f64), None);
        }
        assert_eq!(trail.at(9_999 * 20_000_000 - 25_000_000), hand(9_998.0));
        assert_eq!((trail.at(0), trail.at(9_999 * 20_000_000 + 200_000_000)), ([None; 2], [None; 2]));
        assert!(trail.0.len() <= 1300);
        let came_near = |x: f64, since: i64| trail.came_near(DVec3::new(x, 0.0, 0.1), 0.2, since * 20_000_000);
        assert!(came_near(9_999.0, 9_000) && came_near(9_500.0, 9_500) && !came_near(9_400.0, 9_500));
        // One stamp far in the future costs itself alone, one a little late too, and so do places that are none.
        trail.push(i64::MAX, hand(0.0), None);
        trail.push(10_000 * 20_000_000, hand(10_000.0), None);
        trail.push(10_000 * 20_000_000 - 5, hand(0.0), None);
        assert_eq!(trail.at(10_000 * 20_000_000), hand(10_000.0));
        trail.push(10_001 * 20_000_000, [Some(DVec3::NAN), Some(DVec3::X)], None);
        assert_eq!(trail.at(10_001 * 20_000_000), [None, Some(DVec3::X)]);
    }
}
