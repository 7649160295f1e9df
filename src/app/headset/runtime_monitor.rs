//! Detects when the runtime is gone. When SteamVR is killed there is no event: all calls fail from
//! then on.

/// A runtime that has not answered for this time is gone, nanoseconds. Choice: its compositor may
/// restart within a second or two.
const MAX_SILENCE_NS: i64 = 3_000_000_000;
/// Interval of checks, nanoseconds. Choice: a twelfth of the silence that counts, at four calls of
/// the runtime a second.
const CHECK_INTERVAL_NS: i64 = 250_000_000;

/// Monitors the runtime.
#[derive(Debug, Default)]
pub(super) struct RuntimeMonitor {
    checked_ns: Option<i64>,
    /// Since when it has not answered.
    silent_ns: Option<i64>,
}

impl RuntimeMonitor {
    /// Whether a check is due.
    pub fn is_due(&self, now_ns: i64) -> bool {
        self.checked_ns.is_none_or(|checked_ns| now_ns.saturating_sub(checked_ns) >= CHECK_INTERVAL_NS)
    }

    /// Takes the result of a check; true when the runtime is gone.
    pub fn record(&mut self, now_ns: i64, answered: bool) -> bool {
        self.checked_ns = Some(now_ns);
        if answered {
            self.silent_ns = None;
            return false;
        }
        now_ns.saturating_sub(*self.silent_ns.get_or_insert(now_ns)) >= MAX_SILENCE_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_lasting_silence_counts_as_gone() {
        let mut monitor = RuntimeMonitor::default();
        let s = |seconds: f64| (seconds * 1e9) as i64;
        assert!(monitor.is_due(0) && !monitor.record(0, true));
        assert!(!monitor.is_due(s(0.1)) && monitor.is_due(s(0.3)));
        assert!(!monitor.record(s(1.0), false) && !monitor.record(s(3.5), false));
        assert!(!monitor.record(s(3.6), true), "its compositor started again");
        assert!(!monitor.record(s(4.0), false) && monitor.record(s(7.1), false));
    }
}
