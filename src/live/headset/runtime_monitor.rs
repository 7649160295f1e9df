//! Whether the runtime is still there. When SteamVR is killed nobody says so: calls fail from then on, for good.

/// A runtime that answers nothing for so long is gone, nanoseconds. Its compositor may start again within a second or two.
const MAX_SILENCE_NS: i64 = 3_000_000_000;
/// Between two looks, nanoseconds.
const CHECK_INTERVAL_NS: i64 = 250_000_000;

/// Watches over the runtime.
#[derive(Debug, Default)]
pub(super) struct RuntimeMonitor {
    checked_ns: Option<i64>,
    /// Since when it has not answered.
    silent_ns: Option<i64>,
}

impl RuntimeMonitor {
    /// Whether it is time to look.
    pub fn is_due(&self, now_ns: i64) -> bool {
        self.checked_ns.is_none_or(|checked_ns| now_ns.saturating_sub(checked_ns) >= CHECK_INTERVAL_NS)
    }

    /// Takes in whether it answered; true when it is gone.
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
