//! Whether the runtime is still there. When SteamVR is killed nobody says so: calls fail from then on, for good.

/// A runtime that answers nothing for so long is gone, nanoseconds. Its compositor may start again within a second or two.
const GONE_NS: i64 = 3_000_000_000;
/// Between two looks, nanoseconds.
const LOOK_NS: i64 = 250_000_000;

/// Watches over the runtime.
#[derive(Debug, Default)]
pub(super) struct Vitals {
    looked_ns: Option<i64>,
    /// Since when it has not answered.
    silent_ns: Option<i64>,
}

impl Vitals {
    /// Whether it is time to look.
    pub fn is_due(&self, now_ns: i64) -> bool {
        self.looked_ns.is_none_or(|looked_ns| now_ns.saturating_sub(looked_ns) >= LOOK_NS)
    }

    /// Takes in whether it answered; true when it is gone.
    pub fn looked(&mut self, now_ns: i64, answered: bool) -> bool {
        self.looked_ns = Some(now_ns);
        if answered {
            self.silent_ns = None;
            return false;
        }
        now_ns.saturating_sub(*self.silent_ns.get_or_insert(now_ns)) >= GONE_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_has_to_last() {
        let mut vitals = Vitals::default();
        let s = |seconds: f64| (seconds * 1e9) as i64;
        assert!(vitals.is_due(0) && !vitals.looked(0, true));
        assert!(!vitals.is_due(s(0.1)) && vitals.is_due(s(0.3)));
        assert!(!vitals.looked(s(1.0), false) && !vitals.looked(s(3.5), false));
        assert!(!vitals.looked(s(3.6), true), "its compositor started again");
        assert!(!vitals.looked(s(4.0), false) && vitals.looked(s(7.1), false));
    }
}
