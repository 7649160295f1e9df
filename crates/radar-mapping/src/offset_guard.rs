//! Guards the time offset in use against single wrong estimates.
//!
//! Interfering echoes occasionally give an estimate that is wrong by ten milliseconds with a small
//! 1σ. Applying it would image the room with wrong poses. So an offset that an
//! estimate has confirmed is replaced by an incompatible one only after the disagreement has lasted
//! longer than the estimator's window.

/// Least duration of the disagreement, nanoseconds. Choice: the estimator's window is 20 s.
const MIN_DISAGREEMENT_NS: i64 = 25_000_000_000;

/// Agreement of the estimates with the offset in use.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OffsetGuard {
    /// An estimate has agreed with it.
    is_confirmed: bool,
    /// Since when all estimates have disagreed harmfully.
    since_ns: Option<i64>,
}

impl OffsetGuard {
    /// Takes an estimate; returns whether it may be applied. `is_known`: it is accurate enough;
    /// `is_harmful`: the change is
    /// so large that evidence from before and after does not fit together.
    pub fn allows(&mut self, now_ns: i64, is_known: bool, is_harmful: bool) -> bool {
        self.is_confirmed |= is_known && !is_harmful;
        if !(is_known && is_harmful && self.is_confirmed) {
            self.since_ns = None;
            return true;
        }
        // Backward times must not lengthen the duration.
        let since_ns = self.since_ns.map_or(now_ns, |since_ns| since_ns.min(now_ns));
        self.since_ns = Some(since_ns);
        now_ns.saturating_sub(since_ns) >= MIN_DISAGREEMENT_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn unconfirmed_offset_is_replaced_at_once() {
        assert!(OffsetGuard::default().allows(0, true, true));
    }

    #[test]
    fn confirmed_offset_is_replaced_only_after_lasting_disagreement() {
        let mut offset_guard = OffsetGuard::default();
        assert!(offset_guard.allows(0, true, false));
        assert!((1..=25).all(|s| !offset_guard.allows(s * S, true, true)));
        assert!(offset_guard.clone().allows(26 * S, true, true));
        // An estimate that agrees or is unknown restarts the duration.
        for (is_known, is_harmful) in [(true, false), (false, true)] {
            let mut offset_guard = offset_guard;
            assert!(offset_guard.allows(26 * S, is_known, is_harmful));
            assert!(!offset_guard.allows(27 * S, true, true) && !offset_guard.allows(51 * S, true, true));
            assert!(offset_guard.allows(52 * S, true, true));
        }
    }
}
