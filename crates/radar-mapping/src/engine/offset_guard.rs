//! Whether a new time offset may cost what the search knows.
//!
//! Echoes that beat against each other make a wrong estimate now and then, ten milliseconds off and sure of itself. A room's search would begin
//! again with it, and forget its map. So an offset that an estimate has agreed with is not given up for one that does this until that was asked
//! for longer than an estimate looks back.

/// So long, nanoseconds: an estimate looks back 20 s.
const MIN_DISAGREEMENT_NS: i64 = 25_000_000_000;

/// What estimates have said of the offset in force.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OffsetGuard {
    /// One has agreed with it.
    is_confirmed: bool,
    /// Since when they have asked for a change that costs what the search knows.
    since_ns: Option<i64>,
}

impl OffsetGuard {
    /// Takes an estimate; says whether it may be put in force. `is_known`: it is known well enough for that; `invalidates_map`: it costs what the search
    /// knows.
    pub fn allows(&mut self, now_ns: i64, is_known: bool, invalidates_map: bool) -> bool {
        self.is_confirmed |= is_known && !invalidates_map;
        if !(is_known && invalidates_map && self.is_confirmed) {
            self.since_ns = None;
            return true;
        }
        // A time that was taken back does not make it longer.
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
        // An estimate that agrees, or is none, in between: from the beginning.
        for (is_known, invalidates_map) in [(true, false), (false, true)] {
            let mut offset_guard = offset_guard;
            assert!(offset_guard.allows(26 * S, is_known, invalidates_map));
            assert!(!offset_guard.allows(27 * S, true, true) && !offset_guard.allows(51 * S, true, true));
            assert!(offset_guard.allows(52 * S, true, true));
        }
    }
}
