//! When the player must be told that the radar sees nothing, or sees again: a state machine over what came from the sensor.
//!
//! What is wrong is said when it has lasted, for some seconds, and again once a minute as long as it is so: nobody shall believe that
//! they are warned, nobody shall be kept from playing.

use super::SensorCount;
use crate::panel::Notice;

/// A sensor that begins or comes back has so long until its first sweep, nanoseconds.
const BEGINS_NS: i64 = 12_000_000_000;
/// One that has sent is silent after so long: its own restart takes less, nanoseconds.
const SILENT_NS: i64 = 4_000_000_000;
/// It is said for so long ...
const SAID_NS: i64 = 8_000_000_000;
/// ... and again as long as it lasts, from one beginning to the next.
const AGAIN_NS: i64 = 60_000_000_000;
/// That all is well again is said for so long.
const WELL_NS: i64 = 3_000_000_000;

/// Watches over the sensor's sweeps and the map.
#[derive(Debug, Default)]
pub(super) struct Troubles {
    sweeps: u64,
    /// When sweeps came last; at first when it was looked for the first time.
    came_ns: Option<i64>,
    has_sent: bool,
    /// What is the matter and since when.
    now: Option<(Notice, i64)>,
}

impl Troubles {
    /// What to say now. `sensor`: what came from it so far, while it is there; `is_alive`: whether the map is worked on, once there is one.
    pub fn look(&mut self, now_ns: i64, sensor: Option<SensorCount>, is_alive: Option<bool>) -> Option<Notice> {
        let sweeps = sensor.map_or(self.sweeps, |count| count.sweeps);
        if sweeps != self.sweeps {
            (self.sweeps, self.came_ns, self.has_sent) = (sweeps, Some(now_ns), true);
        }
        let quiet_ns = now_ns.saturating_sub(*self.came_ns.get_or_insert(now_ns));
        let is_quiet = quiet_ns > if self.has_sent { SILENT_NS } else { BEGINS_NS };
        let wrong = match (is_alive, sensor) {
            (Some(false), _) => Some(Notice::MapStopped),
            (_, None) if is_quiet && self.has_sent => Some(Notice::SensorGone),
            (_, None) if is_quiet => Some(Notice::NoSensor),
            (_, Some(_)) if is_quiet => Some(Notice::SensorSilent),
            _ => None,
        };
        match (wrong, self.now) {
            (Some(wrong), now) if now.is_none_or(|(before, _)| before != wrong) => self.now = Some((wrong, now_ns)),
            (None, Some((before, _))) if before != Notice::WellAgain => self.now = Some((Notice::WellAgain, now_ns)),
            _ => {}
        }
        let (notice, since_ns) = self.now?;
        let lasted_ns = now_ns.saturating_sub(since_ns).max(0);
        let is_said = match notice {
            Notice::WellAgain => lasted_ns < WELL_NS,
            _ => lasted_ns % AGAIN_NS < SAID_NS,
        };
        is_said.then_some(notice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is said at each second, of a sensor that is as told at each.
    fn said(sensor: impl Fn(i64) -> Option<u64>, seconds: i64) -> Vec<Option<Notice>> {
        let mut troubles = Troubles::default();
        let count = |sweeps| SensorCount { sweeps, lost: 0 };
        (0..seconds).map(|s| troubles.look(s * 1_000_000_000, sensor(s).map(count), Some(true))).collect()
    }

    fn times(said: &[Option<Notice>], what: Notice) -> Vec<usize> {
        said.iter().enumerate().filter(|(_, s)| **s == Some(what)).map(|(n, _)| n).collect()
    }

    #[test]
    fn a_sensor_that_sends_is_not_talked_about() {
        assert!(said(|s| Some(1 + s as u64), 300).iter().all(Option::is_none));
        assert!(said(|s| (s > 8).then_some(s as u64), 300).iter().all(Option::is_none), "found after some seconds");
        let begins = said(|s| Some((s - 11).max(0) as u64), 300);
        assert!(begins.iter().all(Option::is_none), "it was set up for some seconds");
    }

    #[test]
    fn silence_is_said_once_a_minute_and_its_end_once() {
        let said = said(|s| Some(if s < 150 { s.min(10) as u64 } else { s as u64 }), 200);
        let silent: Vec<usize> = (15..23).chain(75..83).chain(135..143).collect();
        assert_eq!(times(&said, Notice::SensorSilent), silent);
        assert_eq!(times(&said, Notice::WellAgain), [150, 151, 152]);
    }

    #[test]
    fn who_pulls_the_plug_is_told_so_and_who_never_had_one_too() {
        let pulled = said(|s| (s < 10).then_some(s as u64), 40);
        assert_eq!(times(&pulled, Notice::SensorGone), (14..22).collect::<Vec<_>>());
        let never = said(|_| None, 40);
        assert_eq!(times(&never, Notice::NoSensor), (13..21).collect::<Vec<_>>());
    }

    #[test]
    fn a_map_that_has_stopped_is_said_at_once() {
        let mut troubles = Troubles::default();
        let sensor = Some(SensorCount { sweeps: 5, lost: 0 });
        assert_eq!(troubles.look(0, sensor, None), None, "it has not begun");
        assert_eq!(troubles.look(1, sensor, Some(false)), Some(Notice::MapStopped));
    }
}
