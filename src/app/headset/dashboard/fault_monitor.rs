//! When to notify the wearer that the radar has failed or recovered: a state machine over the
//! sensor's sweeps.
//!
//! A fault is reported once it has lasted for some seconds, and again once a minute: nobody should
//! rely on missing warnings, and nobody should be kept from playing.

use super::super::display_monitor::WarningOutput;
use super::super::status::SensorCount;
use crate::panel::Notice;

/// Longest time from connecting to the first sweep, nanoseconds. Choice: a board's restart with its
/// second set-up fits, so a normal start raises no notice.
const MAX_START_NS: i64 = 12_000_000_000;
/// Longest silence of a streaming sensor, nanoseconds. Choice: its own restart takes less.
const MAX_SILENCE_NS: i64 = 4_000_000_000;
/// Duration of a notice, nanoseconds. Choice: time to notice two lines during a game and read them.
const NOTICE_NS: i64 = 8_000_000_000;
/// Interval from the start of a notice to its repetition, nanoseconds. Choice: a wearer learns
/// within a minute that warnings are missing; more often would drive them to switch it off.
const REPEAT_NS: i64 = 60_000_000_000;
/// Duration of the notice of a recovery, nanoseconds. Choice: short, because it asks for nothing.
const RECOVERED_NOTICE_NS: i64 = 3_000_000_000;

/// Monitors the sensor's sweeps and the reconstruction.
#[derive(Debug, Default)]
pub(super) struct FaultMonitor {
    sweeps: u64,
    /// Time of the last sweeps; before the first, time of the first check.
    last_sweep_ns: Option<i64>,
    has_sent: bool,
    /// Since when the sensor has been connected.
    connected_ns: Option<i64>,
    /// The current notice and since when it applies.
    now: Option<(Notice, i64)>,
    /// Since when panels have replaced the display mode of the settings.
    panels_since_ns: Option<i64>,
}

/// Condition at a moment.
enum Condition {
    Good,
    Fault(Notice),
    /// Still undecided: the previous condition holds.
    Unknown,
}

impl FaultMonitor {
    /// The notice to show now. `sensor`: what it has sent, while connected; `is_alive`: whether the
    /// reconstruction is running, once there is one; `output`: how the wearer is warned.
    pub fn update(
        &mut self,
        now_ns: i64,
        sensor: Option<SensorCount>,
        is_alive: Option<bool>,
        output: WarningOutput,
    ) -> Option<Notice> {
        self.fault(now_ns, sensor, is_alive, output).or_else(|| self.replaced_display(now_ns, output))
    }

    /// Said once: nothing is missing.
    fn replaced_display(&mut self, now_ns: i64, output: WarningOutput) -> Option<Notice> {
        if output != WarningOutput::PanelsInstead {
            self.panels_since_ns = None;
            return None;
        }
        let since_ns = *self.panels_since_ns.get_or_insert(now_ns);
        (now_ns.saturating_sub(since_ns) < NOTICE_NS).then_some(Notice::PanelsInstead)
    }

    fn fault(
        &mut self,
        now_ns: i64,
        sensor: Option<SensorCount>,
        is_alive: Option<bool>,
        output: WarningOutput,
    ) -> Option<Notice> {
        let seen = match (is_alive, output) {
            (Some(false), _) => Condition::Fault(Notice::MapStopped),
            (_, WarningOutput::CuesAlone) => Condition::Fault(Notice::CuesAlone),
            _ => self.condition(now_ns, sensor),
        };
        match (seen, self.now) {
            // A change from one sensor fault to another does not restart the interval: a flapping
            // sensor would be reported without end.
            (Condition::Fault(wrong), Some((before, since_ns))) if before != Notice::Recovered => {
                let is_graver = matches!(wrong, Notice::MapStopped | Notice::CuesAlone) && before != wrong;
                self.now = Some((wrong, if is_graver { now_ns } else { since_ns }));
            }
            (Condition::Fault(wrong), _) => self.now = Some((wrong, now_ns)),
            (Condition::Good | Condition::Unknown, Some((Notice::CuesAlone, _))) => self.now = None,
            (Condition::Good, Some((before, _))) if before != Notice::Recovered => {
                self.now = Some((Notice::Recovered, now_ns));
            }
            _ => {}
        }
        let (notice, since_ns) = self.now?;
        let lasted_ns = now_ns.saturating_sub(since_ns).max(0);
        let is_said = match notice {
            Notice::Recovered => lasted_ns < RECOVERED_NOTICE_NS,
            _ => lasted_ns % REPEAT_NS < NOTICE_NS,
        };
        is_said.then_some(notice)
    }

    fn condition(&mut self, now_ns: i64, sensor: Option<SensorCount>) -> Condition {
        let Some(count) = sensor else {
            self.connected_ns = None;
            let quiet_ns = now_ns.saturating_sub(*self.last_sweep_ns.get_or_insert(now_ns));
            return match self.has_sent {
                true if quiet_ns > MAX_SILENCE_NS => Condition::Fault(Notice::SensorGone),
                false if quiet_ns > MAX_START_NS => Condition::Fault(Notice::NoSensor),
                _ => Condition::Unknown,
            };
        };
        let connected_ns = *self.connected_ns.get_or_insert(now_ns);
        if count.sweeps != self.sweeps {
            (self.sweeps, self.last_sweep_ns, self.has_sent) = (count.sweeps, Some(now_ns), true);
            return Condition::Good;
        }
        let last_sweep_ns = *self.last_sweep_ns.get_or_insert(now_ns);
        // Since it was connected, it has either streamed or is being set up.
        let (since_ns, limit_ns) = if self.has_sent && last_sweep_ns >= connected_ns {
            (last_sweep_ns, MAX_SILENCE_NS)
        } else {
            (connected_ns, MAX_START_NS)
        };
        if now_ns.saturating_sub(since_ns) > limit_ns {
            Condition::Fault(Notice::SensorSilent)
        } else {
            Condition::Unknown
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Notices of each second for a sensor's state in each second.
    fn notices(sensor: impl Fn(i64) -> Option<u64>, seconds: i64) -> Vec<Option<Notice>> {
        let mut troubles = FaultMonitor::default();
        let count = |sweeps| SensorCount { sweeps, lost: 0 };
        (0..seconds)
            .map(|s| troubles.update(s * 1_000_000_000, sensor(s).map(count), Some(true), WarningOutput::AsSet))
            .collect()
    }

    fn times(notices: &[Option<Notice>], what: Notice) -> Vec<usize> {
        notices.iter().enumerate().filter(|(_, s)| **s == Some(what)).map(|(n, _)| n).collect()
    }

    #[test]
    fn streaming_sensor_gives_no_notice() {
        assert!(notices(|s| Some(1 + s as u64), 300).iter().all(Option::is_none));
        assert!(notices(|s| (s > 8).then_some(s as u64), 300).iter().all(Option::is_none), "found after some seconds");
        let begins = notices(|s| Some((s - 11).max(0) as u64), 300);
        assert!(begins.iter().all(Option::is_none), "it was set up for some seconds");
    }

    #[test]
    fn silence_notice_repeats_each_minute_and_recovery_once() {
        let notices = notices(|s| Some(if s < 150 { s.min(10) as u64 } else { s as u64 }), 200);
        let silent: Vec<usize> = (15..23).chain(75..83).chain(135..143).collect();
        assert_eq!(times(&notices, Notice::SensorSilent), silent);
        assert_eq!(times(&notices, Notice::Recovered), [150, 151, 152]);
    }

    #[test]
    fn unplugged_and_missing_sensors_are_reported() {
        let pulled = notices(|s| (s < 10).then_some(s as u64), 40);
        assert_eq!(times(&pulled, Notice::SensorGone), (14..22).collect::<Vec<_>>());
        let never = notices(|_| None, 40);
        assert_eq!(times(&never, Notice::NoSensor), (13..21).collect::<Vec<_>>());
    }

    #[test]
    fn late_or_repeated_plugging_gives_no_extra_notice() {
        // Connected after 40 s and set up for four; gone from 100 to 130 s, then set up for four
        // again.
        let sweeps = |s: i64| match s {
            0..40 | 100..130 => None,
            40..100 => Some((s - 43).max(0) as u64),
            _ => Some(56 + (s - 133).max(0) as u64),
        };
        let notices = notices(sweeps, 200);
        assert_eq!(times(&notices, Notice::SensorSilent), [0; 0]);
        assert_eq!(times(&notices, Notice::NoSensor), (13..21).collect::<Vec<_>>());
        assert_eq!(times(&notices, Notice::SensorGone), (104..112).collect::<Vec<_>>());
        assert_eq!(times(&notices, Notice::Recovered), [44, 45, 46, 134, 135, 136]);
    }

    #[test]
    fn flapping_sensor_is_reported_once_a_minute() {
        for (there, away) in [(2, 3), (20, 3)] {
            let notices = notices(|s| (s % (there + away) < there).then_some(0), 200);
            let any = notices.iter().filter(|notice| notice.is_some()).count();
            assert!((16..=32).contains(&any) && times(&notices, Notice::Recovered).is_empty(), "{notices:?}");
        }
    }

    #[test]
    fn stopped_map_is_reported_at_once() {
        let mut troubles = FaultMonitor::default();
        let sensor = Some(SensorCount { sweeps: 5, lost: 0 });
        assert_eq!(troubles.update(0, sensor, None, WarningOutput::AsSet), None, "it has not begun");
        assert_eq!(troubles.update(1, sensor, Some(false), WarningOutput::AsSet), Some(Notice::MapStopped));
        let mut troubles = FaultMonitor::default();
        let silent: Vec<_> =
            (0..40).map(|s| troubles.update(s * 1_000_000_000, sensor, Some(true), WarningOutput::AsSet)).collect();
        assert!(silent.contains(&Some(Notice::SensorSilent)) && silent[39].is_none(), "{silent:?}");
        let stopped = troubles.update(40_000_000_000, sensor, Some(false), WarningOutput::AsSet);
        assert_eq!(stopped, Some(Notice::MapStopped), "though another fault was reported a moment ago");
    }

    #[test]
    fn refused_displays_are_reported() {
        let mut troubles = FaultMonitor::default();
        let mut notices = |from_s: i64, to_s: i64, output| -> Vec<Option<Notice>> {
            let sensor = |s: i64| Some(SensorCount { sweeps: s as u64, lost: 0 });
            (from_s..to_s).map(|s| troubles.update(s * 1_000_000_000, sensor(s), Some(true), output)).collect()
        };
        let instead = notices(1, 100, WarningOutput::PanelsInstead);
        assert_eq!(times(&instead, Notice::PanelsInstead), (0..8).collect::<Vec<_>>(), "once");
        let refused = notices(100, 180, WarningOutput::CuesAlone);
        assert_eq!(times(&refused, Notice::CuesAlone), (0..8).chain(60..68).collect::<Vec<_>>());
        assert_eq!(notices(180, 200, WarningOutput::AsSet), [None; 20]);
    }
}
