//! Simulated line from the board to the reader. Bytes leave the board at its baud rate, in pieces,
//! and reach the reader later if the transport delays them.

use std::collections::VecDeque;

use super::Fault;

/// Longest piece, as time on the line, nanoseconds. Physics: full-speed USB passes bytes on once a
/// millisecond.
const PIECE_NS: i64 = 1_000_000;
/// Bits per byte on a UART. Source: 8N1 is a start bit, eight data bits and a stop bit.
const BITS_A_BYTE: i64 = 10;

/// What happens when a transmission has left the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AfterSent {
    Nothing,
    /// The line changes its baud rate.
    Baud(u32),
    /// The board fails in the middle of the transmission.
    Fault(Fault),
}

/// Bytes sent together.
#[derive(Debug, Clone)]
pub(super) struct Transmission {
    pub bytes: Vec<u8>,
    /// Earliest time of sending, host nanoseconds.
    pub from_ns: i64,
    /// Delay by the transport, for these bytes and all later ones, nanoseconds.
    pub hold_ns: i64,
    /// Whether these bytes end a result.
    pub ends_result: bool,
    pub then: AfterSent,
}

/// Line from the board to the reader.
#[derive(Debug, Clone, Default)]
pub(super) struct Line {
    /// Baud rate; `None` for no limit.
    pub baud: Option<u32>,
    queue: VecDeque<Transmission>,
    sent_of_first: usize,
    free_ns: i64,
    is_blocked: bool,
    /// Pieces in transit: arrival (host ns), baud rate, bytes.
    on_the_way: VecDeque<(i64, Option<u32>, Vec<u8>)>,
    held_until_ns: i64,
    /// End of the burst mode and interval of its bursts, host nanoseconds.
    bursts: Option<(i64, i64)>,
}

impl Line {
    pub fn new(baud: Option<u32>) -> Self {
        Self { baud, ..Self::default() }
    }

    pub fn put(&mut self, parcel: Transmission) {
        self.queue.push_back(parcel);
    }

    /// Discards bytes that have not left the board; with `and_way` also those in transit.
    pub fn clear(&mut self, and_way: bool) {
        self.queue.clear();
        self.sent_of_first = 0;
        if and_way {
            self.on_the_way.clear();
        }
    }

    /// Until `until_ns`, bytes reach the reader only every `every_ns`.
    pub fn burst_until(&mut self, until_ns: i64, every_ns: i64) {
        self.bursts = Some((until_ns, every_ns.max(1)));
    }

    /// Flow control: whether the other side accepts no bytes.
    pub fn set_blocked(&mut self, is_blocked: bool, now_ns: i64) {
        if self.is_blocked && !is_blocked {
            self.free_ns = self.free_ns.max(now_ns);
        }
        self.is_blocked = is_blocked;
    }

    /// Number of results that have not completely left the board.
    pub fn results(&self) -> usize {
        self.queue.iter().filter(|parcel| parcel.ends_result).count()
    }

    /// When [`Self::leave`] or [`Self::arrive`] is due, host nanoseconds.
    pub fn next_ns(&self) -> i64 {
        let arrives_ns = self.on_the_way.front().map_or(i64::MAX, |(at, ..)| *at);
        self.next_leaves_ns().min(arrives_ns)
    }

    fn next_leaves_ns(&self) -> i64 {
        let Some(first) = self.queue.front().filter(|_| !self.is_blocked) else { return i64::MAX };
        let line_ns = self.baud.map_or(0, |baud| byte_ns(baud) * self.piece(first) as i64);
        self.free_ns.max(first.from_ns).saturating_add(line_ns)
    }

    fn piece(&self, first: &Transmission) -> usize {
        let left = first.bytes.len() - self.sent_of_first;
        self.baud.map_or(left, |baud| left.min((PIECE_NS / byte_ns(baud)).max(1) as usize))
    }

    /// Lets the next piece leave the board if it is due; returns when, and what happens then.
    pub fn leave(&mut self, now_ns: i64) -> Option<(i64, AfterSent)> {
        let left_ns = self.next_leaves_ns();
        let first = self.queue.front().filter(|_| left_ns <= now_ns)?;
        let (count, then, hold_ns) = (self.piece(first), first.then, first.hold_ns);
        let piece = first.bytes[self.sent_of_first..self.sent_of_first + count].to_vec();
        if self.sent_of_first == 0 && hold_ns > 0 {
            self.held_until_ns = self.held_until_ns.max(left_ns.saturating_add(hold_ns));
        }
        self.free_ns = left_ns;
        self.sent_of_first += count;
        let is_last = self.sent_of_first == first.bytes.len();
        if is_last {
            self.queue.pop_front();
            self.sent_of_first = 0;
        }
        if !piece.is_empty() {
            self.on_the_way.push_back((self.arrival_ns(left_ns), self.baud, piece));
        }
        if let (true, AfterSent::Baud(baud)) = (is_last, then) {
            self.baud = self.baud.map(|_| baud);
        }
        Some((left_ns, if is_last { then } else { AfterSent::Nothing }))
    }

    fn arrival_ns(&self, left_ns: i64) -> i64 {
        let held_ns = left_ns.max(self.held_until_ns);
        let burst_ns = match self.bursts {
            Some((until_ns, every_ns)) if held_ns < until_ns => {
                held_ns.div_euclid(every_ns).saturating_add(1) * every_ns
            }
            _ => held_ns,
        };
        self.on_the_way.back().map_or(burst_ns, |(last_ns, ..)| burst_ns.max(*last_ns))
    }

    /// Returns the next piece that has reached the reader, with its baud rate.
    pub fn arrive(&mut self, now_ns: i64) -> Option<(Option<u32>, Vec<u8>)> {
        self.on_the_way.pop_front_if(|(at, ..)| *at <= now_ns).map(|(_, baud, piece)| (baud, piece))
    }
}

fn byte_ns(baud: u32) -> i64 {
    BITS_A_BYTE * 1_000_000_000 / i64::from(baud.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parcel(bytes: usize, from_ns: i64) -> Transmission {
        Transmission { bytes: vec![7; bytes], from_ns, hold_ns: 0, ends_result: true, then: AfterSent::Nothing }
    }

    fn all(line: &mut Line) -> Vec<(i64, usize)> {
        let mut out = Vec::new();
        while line.next_ns() < i64::MAX {
            let now_ns = line.next_ns();
            while line.leave(now_ns).is_some() {}
            while let Some((_, piece)) = line.arrive(now_ns) {
                out.push((now_ns, piece.len()));
            }
        }
        out
    }

    #[test]
    fn bytes_leave_no_faster_than_the_baud_rate() {
        let mut line = Line::new(Some(1_000_000));
        line.put(parcel(250, 5_000_000));
        line.put(parcel(10, 0));
        assert_eq!(line.results(), 2);
        assert_eq!(all(&mut line), [(6_000_000, 100), (7_000_000, 100), (7_500_000, 50), (7_600_000, 10)]);
        let mut line = Line::default();
        line.put(parcel(250, 5));
        assert_eq!(all(&mut line), [(5, 250)]);
    }

    #[test]
    fn held_blocked_or_bursty_bytes_arrive_later() {
        let mut line = Line::new(Some(1_000_000));
        line.put(Transmission { hold_ns: 5_000_000, ..parcel(10, 0) });
        line.put(parcel(10, 0));
        line.set_blocked(true, 0);
        assert_eq!(line.next_ns(), i64::MAX);
        line.set_blocked(false, 2_000_000);
        assert_eq!(all(&mut line), [(7_100_000, 10), (7_100_000, 10)]);
        let mut line = Line::default();
        line.burst_until(90, 30);
        (0..5).for_each(|i| line.put(parcel(1, 20 * i + 1)));
        assert_eq!(all(&mut line), [(30, 1), (30, 1), (60, 1), (90, 1), (90, 1)]);
        assert_eq!(line.results(), 0);
    }
}
