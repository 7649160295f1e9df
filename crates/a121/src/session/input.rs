//! Received bytes: the parser, and how long the line has been quiet.

use crate::{Parser, Received, ResultLayout, StreamCounters};

/// A line without bytes for this long has ended a payload, nanoseconds. Serial lines need longer,
/// because converters pass bytes on in pieces, one per millisecond. Choice: USB and networks
/// deliver a message's packets closer together, and two pieces are awaited; a result waits for it.
pub(super) const QUIET_NS: i64 = 300_000;
const QUIET_SERIAL_NS: i64 = 2_000_000;

/// The receiving side of the line.
pub(super) struct Input {
    parser: Parser,
    /// Kept between reads for its capacity.
    received: Vec<Received>,
    last_bytes_ns: i64,
}

impl Input {
    pub fn new(now_ns: i64) -> Self {
        Self { parser: Parser::default(), received: Vec::new(), last_bytes_ns: now_ns }
    }

    pub fn counters(&self) -> StreamCounters {
        *self.parser.counters()
    }

    /// Announces the layout of the results to come; `None` while the board should send none.
    pub fn expect_results(&mut self, layout: Option<ResultLayout>) {
        self.parser.expect_results(layout);
    }

    /// Discards the beginning of a message.
    pub fn clear(&mut self) {
        self.parser.clear();
    }

    /// Parses bytes. The messages come in a buffer that [`Self::recycle`] takes back.
    pub fn receive(&mut self, bytes: &[u8], now_ns: i64) -> Vec<Received> {
        self.last_bytes_ns = now_ns;
        let mut received = std::mem::take(&mut self.received);
        self.parser.push(bytes, now_ns, &mut received);
        received
    }

    /// Takes back a buffer that has been read.
    pub fn recycle(&mut self, received: Vec<Received>) {
        self.received = received;
    }

    /// When [`Self::accept_when_quiet`] is due; `None` while nothing waits for that.
    pub fn quiet_deadline_ns(&self, has_baud: bool) -> Option<i64> {
        self.parser.has_unconfirmed().then(|| self.last_bytes_ns.saturating_add(quiet_ns(has_baud)))
    }

    /// The result that waits for a following line, once the line has been quiet.
    pub fn accept_when_quiet(&mut self, has_baud: bool, now_ns: i64) -> Option<Vec<Received>> {
        let is_quiet = now_ns.saturating_sub(self.last_bytes_ns) >= quiet_ns(has_baud);
        if !(self.parser.has_unconfirmed() && is_quiet) {
            return None;
        }
        let mut received = std::mem::take(&mut self.received);
        self.parser.accept_when_quiet(&mut received);
        Some(received)
    }
}

fn quiet_ns(has_baud: bool) -> i64 {
    if has_baud { QUIET_SERIAL_NS } else { QUIET_NS }
}
