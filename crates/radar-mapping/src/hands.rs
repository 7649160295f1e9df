//! Positions of the wearer's tracked hands, from the controllers.
//!
//! Echoes near a hand are not furniture. Conversely, no hand passes through furniture.

use std::collections::VecDeque;
use std::ops::Range;

use glam::DVec3;
use radar_sar::geometry::Pose;

/// Left and right hand, tracking frame, metres; `None` for one that is not tracked.
pub type HandsM = [Option<DVec3>; 2];

/// Positions of the hands at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandsSample {
    /// Host's monotonic clock, nanoseconds.
    pub time_ns: i64,
    /// Positions of the hands.
    pub hands_m: HandsM,
}

/// Longest distance from the radar, on the forehead, to a held controller, metres. A controller
/// farther away was put down. Choice: the reach of a long arm, 0.8 m, from a shoulder 0.4 m off the
/// forehead.
const ARM_LENGTH_M: f64 = 1.2;
/// Range on either side of the palm that a hand, what it holds and the pulse's width may occupy,
/// metres. Choice: half a hand with a controller, 0.1 m, and half the pulse's width, 0.07 m.
const HAND_HALF_EXTENT_M: f64 = 0.17;
/// Length of the forearm, wrist to elbow, which echoes from as much nearer than the hand, metres.
/// Choice: an adult's is 0.25 m, and it seldom points straight at the radar; longer intervals hide
/// furniture.
const FOREARM_LENGTH_M: f64 = 0.2;

/// Range interval in which a hand, what it holds and its forearm echo, for the palm at a range.
pub fn hand_ranges_m(palm_range_m: f64) -> Range<f64> {
    palm_range_m - FOREARM_LENGTH_M - HAND_HALF_EXTENT_M..palm_range_m + HAND_HALF_EXTENT_M
}

/// Retention of samples, nanoseconds. Choice: longer than any window and than the 10 s for which a
/// hand excludes detections.
const RETENTION_NS: i64 = 25_000_000_000;
/// Least spacing of the samples kept, nanoseconds. Choice: a hand at 2 m/s moves 2 cm, less than it
/// echoes over, and 25 s are at most 2500 samples.
const MIN_STEP_NS: i64 = 10_000_000;
/// A time that is earlier than the newest by more than this shows that the newest were wrong,
/// nanoseconds. Choice: as a jump of the streams' time stamps; a lesser error passes by itself.
const MAX_BACKWARD_STEP_NS: i64 = 1_000_000_000;
/// Greatest distance in time to a sample that is used, nanoseconds. Choice: ten samples; a hand at
/// 2 m/s moves 0.2 m, about as far as it echoes.
const MAX_SAMPLE_DISTANCE_NS: i64 = 100_000_000;

/// Positions of the hands over the last seconds, in rising time.
#[derive(Debug, Default)]
pub struct HandTrail(VecDeque<(i64, HandsM)>);

impl HandTrail {
    /// Adds positions. Ignores a sample less than 10 ms after the newest one, a position that is
    /// not finite and, if the sensor's position is known, a controller out of reach of it. A time
    /// far before the newest one drops the later samples.
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

    /// Moves the positions of a time on: their frame jumped.
    pub fn move_since(&mut self, since_ns: i64, new_from_old: &Pose) {
        for (_, hands_m) in self.0.iter_mut().rev().take_while(|(at_ns, _)| *at_ns >= since_ns) {
            *hands_m = hands_m.map(|hand| hand.map(|at_m| new_from_old.transform_point(at_m)));
        }
    }

    /// Whether a hand was within this distance of a point since a time.
    pub fn came_near(&self, point: DVec3, within_m: f64, since_ns: i64) -> bool {
        let recent = self.0.iter().rev().take_while(|(at_ns, _)| *at_ns >= since_ns);
        recent.flat_map(|(_, hands_m)| hands_m).flatten().any(|hand| hand.distance(point) < within_m)
    }

    /// Positions at a time.
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
    fn a_jump_moves_the_positions_of_its_time_on() {
        let mut trail = HandTrail::default();
        (0..3).for_each(|n| trail.push(n * 100_000_000, [Some(DVec3::X), None], None));
        trail.move_since(100_000_000, &Pose::from_translation(DVec3::Y));
        let moved = [Some(DVec3::X + DVec3::Y), None];
        assert_eq!([0, 1, 2].map(|n| trail.at(n * 100_000_000)), [[Some(DVec3::X), None], moved, moved]);
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
        // A time stamp far in the future costs itself alone, and so does one a little late.
        // Positions that are not finite are ignored.
        trail.push(i64::MAX, hand(0.0), None);
        trail.push(10_000 * 20_000_000, hand(10_000.0), None);
        trail.push(10_000 * 20_000_000 - 5, hand(0.0), None);
        assert_eq!(trail.at(10_000 * 20_000_000), hand(10_000.0));
        trail.push(10_001 * 20_000_000, [Some(DVec3::NAN), Some(DVec3::X)], None);
        assert_eq!(trail.at(10_001 * 20_000_000), [None, Some(DVec3::X)]);
    }
}
