//! The board's sending side: its line, its room for results, and times at which it hangs.

use super::line::{AfterSent, Line, Transmission};
use super::outgoing::Outgoing;

/// Results that a board can hold. Choice: one being sent and one measured, as with double
/// buffering.
pub(super) const KEPT_RESULTS: usize = 2;
/// Duration of the burst fault and interval of its bursts, nanoseconds. Choice: a host that reads
/// 30 times a second, for long enough that the clock has to cope.
const BURST_NS: (i64, i64) = (1_000_000_000, 30_000_000);

/// Sends messages. See the file's head.
pub(super) struct Transmitter {
    pub line: Line,
    /// The board hangs until this host time.
    hung_until_ns: i64,
    /// Since when there is room for another result, host nanoseconds.
    slot_free_since_ns: i64,
}

impl Transmitter {
    pub fn new(baud: Option<u32>) -> Self {
        Self { line: Line::new(baud), hung_until_ns: i64::MIN, slot_free_since_ns: i64::MIN }
    }

    /// Whether there is room for another result.
    pub fn has_room(&self) -> bool {
        self.line.results() < KEPT_RESULTS
    }

    /// When a result that was measured at this time can be read out; and whether it is lost,
    /// because the board hangs.
    pub fn read_ns(&self, end_ns: i64) -> (i64, bool) {
        let read_ns = end_ns.max(self.slot_free_since_ns);
        (read_ns.max(self.hung_until_ns), read_ns < self.hung_until_ns)
    }

    /// Puts a message on the line, at the earliest at `from_ns`.
    pub fn put(&mut self, message: Outgoing, from_ns: i64, ends_result: bool, then: AfterSent) {
        let Outgoing { mut bytes, cut_at, stall_ns, hold_ns, ends_with } = message;
        let rest = cut_at.map(|at| bytes.split_off(at.min(bytes.len())));
        let whole = Transmission { bytes, from_ns, hold_ns: 0, ends_result, then };
        let Some(rest) = rest else { return self.line.put(whole) };
        let after_cut = ends_with.map_or(AfterSent::Nothing, AfterSent::Fault);
        self.line.put(Transmission { ends_result: false, then: after_cut, ..whole });
        let from_ns = from_ns.saturating_add(stall_ns);
        if stall_ns > 0 {
            self.hung_until_ns = from_ns;
        }
        if ends_with.is_none() {
            self.line.put(Transmission { bytes: rest, from_ns, hold_ns, ends_result, then });
        }
    }

    /// Lets the next piece leave the board if it is due; returns when, and what happens then.
    pub fn leave(&mut self, now_ns: i64) -> Option<(i64, AfterSent)> {
        let had_room = self.has_room();
        let left = self.line.leave(now_ns)?;
        if !had_room && self.has_room() {
            self.slot_free_since_ns = left.0;
        }
        Some(left)
    }

    /// From this time on, bytes reach the reader in bursts.
    pub fn burst(&mut self, from_ns: i64) {
        self.line.burst_until(from_ns + BURST_NS.0, BURST_NS.1);
    }

    /// Discards what has not left the board and ends a hang, as a restart does; if the board is
    /// unplugged, also what is in transit.
    pub fn restart(&mut self, is_unplugged: bool) {
        self.line.clear(is_unplugged);
        self.hung_until_ns = i64::MIN;
    }
}
