//! Parses the byte stream into messages and resynchronises after every fault.
//!
//! The stream is a JSON line, then as many raw bytes as the line announces, without any checksum. A
//! message is accepted only if it is consistent: the line must parse with every field of a result,
//! announce exactly the payload of the set-up, and the start of another line must follow the
//! payload. Otherwise the parser drops one byte at a time until a line starts. So a fault loses
//! only the messages that it touched.
//!
//! Whether a line follows a payload is known when more bytes arrive. Streams pause between frames.
//! So a complete payload waits for more bytes, or until the caller reports a quiet line with
//! [`Parser::accept_when_quiet`], unless the payload itself ends like the start of a line.
//!
//! Not detectable here: a flipped bit in a sample, a temperature or a tick (for ticks see
//! [`super::TickUnwrapper`]); one byte lost and another gained in the same payload; a doubled byte in a
//! payload whose last byte arrives after `accept_when_quiet`. The last case is counted
//! afterwards as `unconfirmed_damage`.
//!
//! Memory is bounded: a line has at most [`MAX_LINE_BYTES`] and a payload has the size of the
//! set-up.

use num_complex::Complex;

use super::reply::Header;
use super::{Reply, ResultInfo, ResultLayout};

/// Longest line, bytes. A result's line has about 170 bytes per sensor; replies to a set-up with
/// calibrations are the longest. Choice: several times those of five sensors, some 2 kB; it bounds
/// memory when the line's end is lost.
pub const MAX_LINE_BYTES: usize = 16 << 10;
/// Bytes processed at a time. Choice: bounds what is held beyond a line, whatever a read returns.
const PIECE_BYTES: usize = 4096;
/// Keys that a line can start with. If one appears in a payload, bytes were lost before it.
const KEYS: [&[u8]; 8] = [
    b"\"result_info\"",
    b"\"status\"",
    b"\"payload_size\"",
    b"\"level\"",
    b"\"timestamp\"",
    b"\"module\"",
    b"\"log\"",
    b"\"message\"",
];

/// Bytes checked after a payload: the brace of a line and the start of a key. Choice: noise matches
/// once in 10⁷ cases; with more bytes a result would wait longer for the next one.
const LINE_START_BYTES: usize = 5;

/// A result: metadata of its frames, and their samples.
#[derive(Debug, Clone, PartialEq)]
pub struct ResultMessage {
    /// One for each sensor, group by group.
    pub infos: Vec<ResultInfo>,
    /// One for each sensor, group by group; `[sweep][point]`, subsweeps concatenated inside each
    /// sweep.
    pub frames: Vec<Vec<Complex<i16>>>,
}

/// A message of the server.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// A reply, a log line or an error.
    Reply(Reply),
    /// A result with the expected layout.
    Result(ResultMessage),
    /// A result while none is expected, or of another set-up; its payload is skipped.
    StaleResult,
}

/// A message and the arrival time of its last byte, host nanoseconds.
#[derive(Debug, Clone, PartialEq)]
pub struct Received {
    /// The message.
    pub message: Message,
    /// When the read with its last byte returned, host nanoseconds.
    pub arrival_ns: i64,
}

/// Counters of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StreamCounters {
    /// All bytes received.
    pub bytes: u64,
    /// Bytes that belong to no message.
    pub skipped_bytes: u64,
    /// Times that the parser lost synchronisation and skipped to the next line.
    pub resyncs: u64,
    /// Lines that start like one but are not part of the protocol.
    pub damaged_lines: u64,
    /// Results with another shape or length than the set-up.
    pub misfit_results: u64,
    /// Results that arrived while none was expected.
    pub stale_results: u64,
    /// Payloads with lost or gained bytes.
    pub damaged_payloads: u64,
    /// Results accepted by [`Parser::accept_when_quiet`] that no line followed; they may be
    /// damaged.
    pub unconfirmed_damage: u64,
    /// Results emitted.
    pub results: u64,
}

/// What follows a complete payload.
enum PayloadCheck {
    Line,
    Damage,
    NeedsMoreBytes,
}

/// State of the line at the buffer's start.
enum LineEnd {
    At(usize),
    NoLine,
    NotYet,
}

/// An accepted result line that waits for its payload.
struct Announced {
    infos: Vec<ResultInfo>,
    line_bytes: usize,
}

/// Parser of the byte stream. See the head of this file for what it accepts.
#[derive(Default)]
pub struct Parser {
    buffer: Vec<u8>,
    start: usize,
    /// Bytes from `start` on that are known to contain no control character, so no end of a line.
    scanned: usize,
    announced: Option<Announced>,
    /// For each read: its end in the buffer and its arrival time.
    pieces: std::collections::VecDeque<(usize, i64)>,
    layout: Option<ResultLayout>,
    out_of_sync: bool,
    /// The last payload was accepted by `accept_when_quiet`, before the bytes after it arrived.
    accepted_when_quiet: bool,
    counters: StreamCounters,
    /// Total bytes scanned for the end of a line.
    #[cfg(test)]
    scanned_bytes: u64,
}

impl Parser {
    /// Sets the layout of the results to expect; `None` to expect none.
    pub fn expect_results(&mut self, layout: Option<ResultLayout>) {
        self.announced = None;
        self.layout = layout;
    }

    /// Drops all buffered bytes, after the line was closed or flushed. Counters are kept.
    pub fn clear(&mut self) {
        *self = Self { layout: self.layout.take(), counters: self.counters, ..Default::default() };
    }

    /// The counters so far.
    pub fn counters(&self) -> &StreamCounters {
        &self.counters
    }

    /// Bytes buffered until more arrive.
    pub fn held_bytes(&self) -> usize {
        self.buffer.len() - self.start
    }

    /// Takes bytes received at a host time and appends the messages that they complete. How the
    /// stream is split affects only the times.
    pub fn push(&mut self, bytes: &[u8], now_ns: i64, out: &mut Vec<Received>) {
        self.counters.bytes += bytes.len() as u64;
        for piece in bytes.chunks(PIECE_BYTES) {
            self.buffer.extend_from_slice(piece);
            match self.pieces.back_mut() {
                Some((end, time_ns)) if *time_ns == now_ns => *end = self.buffer.len(),
                _ => self.pieces.push_back((self.buffer.len(), now_ns)),
            }
            while self.step(false, out) {}
            self.compact();
        }
    }

    /// Reports that the line has been quiet for longer than any pause inside a message; a complete
    /// payload is accepted.
    pub fn accept_when_quiet(&mut self, out: &mut Vec<Received>) {
        if self.step(true, out) {
            while self.step(false, out) {}
            self.compact();
        }
    }

    /// Whether [`Self::accept_when_quiet`] would emit a message.
    pub fn has_unconfirmed(&self) -> bool {
        // A payload that ends like the start of a line always waits for more bytes.
        self.payload_end().is_some_and(|end| end == self.buffer.len()) && !ends_with_line_start(&self.buffer)
    }

    fn payload_end(&self) -> Option<usize> {
        Some(self.start + self.announced.as_ref()?.line_bytes + self.layout.as_ref()?.payload_bytes())
    }

    /// Makes one parsing step; returns false when more bytes are needed.
    fn step(&mut self, is_quiet: bool, out: &mut Vec<Received>) -> bool {
        if self.announced.is_some() {
            return self.step_payload(is_quiet, out);
        }
        let data = &self.buffer[self.start..];
        if data.is_empty() {
            return false;
        }
        if data[0] != b'{' {
            let count = data.iter().position(|&byte| byte == b'{').unwrap_or(data.len());
            self.counters.unconfirmed_damage += u64::from(self.accepted_when_quiet);
            self.skip(count);
            return true;
        }
        match self.line_end() {
            LineEnd::NotYet => false,
            LineEnd::NoLine => {
                self.skip(1);
                true
            }
            LineEnd::At(end) => {
                self.step_line(end, out);
                true
            }
        }
    }

    /// Finds the end of the line at the buffer's start. Lines contain no control characters, which
    /// are frequent in noise. Noise may look like the start of a line at every other byte; still,
    /// no byte is scanned twice.
    fn line_end(&mut self) -> LineEnd {
        let data = &self.buffer[self.start..];
        if data.get(1).is_some_and(|&byte| byte != b'"' && byte != b' ') {
            return LineEnd::NoLine;
        }
        let control = |&byte: &u8| byte < b' ' && byte != b'\t' && byte != b'\r';
        let found = data[self.scanned..].iter().position(control).map(|at| self.scanned + at);
        let scanned = found.unwrap_or(data.len());
        #[cfg(test)]
        (self.scanned_bytes += (scanned - self.scanned) as u64);
        self.scanned = scanned;
        match found {
            Some(at) if data[at] == b'\n' && at <= MAX_LINE_BYTES => LineEnd::At(at),
            None if data.len() <= MAX_LINE_BYTES => LineEnd::NotYet,
            _ => LineEnd::NoLine,
        }
    }

    fn step_line(&mut self, end: usize, out: &mut Vec<Received>) {
        let line = &self.buffer[self.start..self.start + end];
        let Some(header) = Header::parse(line) else {
            // Noise contains braces too, so only a plausible line counts as damaged.
            self.counters.damaged_lines += u64::from(line.starts_with(b"{\"") && line.len() > 8);
            return self.skip(1);
        };
        match (header, &self.layout) {
            (Header::Reply(reply), _) => self.emit(Message::Reply(reply), end + 1, out),
            (Header::Result(..), None) => {
                self.counters.stale_results += 1;
                self.emit(Message::StaleResult, end + 1, out);
                // Skipping its payload is not a fault.
                self.out_of_sync = true;
            }
            (Header::Result(infos, bytes), Some(layout)) if layout.fits(&infos, bytes) => {
                self.announced = Some(Announced { infos: infos.concat(), line_bytes: end + 1 });
            }
            (Header::Result(..), Some(_)) => {
                self.counters.misfit_results += 1;
                self.skip(1);
            }
        }
    }

    fn step_payload(&mut self, is_quiet: bool, out: &mut Vec<Received>) -> bool {
        let (Some(end), Some(announced)) = (self.payload_end(), &self.announced) else { return false };
        if self.buffer.len() < end {
            return false;
        }
        let (payload, rest) = (&self.buffer[self.start + announced.line_bytes..end], &self.buffer[end..]);
        match check_payload_end(payload, rest) {
            PayloadCheck::Damage => {
                self.counters.damaged_payloads += 1;
                self.announced = None;
                self.skip(1);
                return true;
            }
            PayloadCheck::NeedsMoreBytes if !(is_quiet && rest.is_empty() && !ends_with_line_start(payload)) => {
                return false;
            }
            PayloadCheck::NeedsMoreBytes | PayloadCheck::Line => {}
        }
        let accepted_when_quiet = rest.is_empty();
        let frames = self.layout.as_ref().map(|layout| layout.split(payload)).unwrap_or_default();
        let Some(Announced { infos, .. }) = self.announced.take() else { return false };
        self.counters.results += 1;
        self.emit(Message::Result(ResultMessage { infos, frames }), end - self.start, out);
        self.accepted_when_quiet = accepted_when_quiet;
        true
    }

    fn emit(&mut self, message: Message, bytes: usize, out: &mut Vec<Received>) {
        let end = self.start + bytes;
        let piece = self.pieces.iter().find(|(piece_end, _)| *piece_end >= end);
        let arrival_ns = piece.map_or(0, |&(_, time_ns)| time_ns);
        self.advance(bytes);
        (self.out_of_sync, self.accepted_when_quiet) = (false, false);
        out.push(Received { message, arrival_ns });
    }

    fn skip(&mut self, bytes: usize) {
        self.counters.skipped_bytes += bytes as u64;
        self.counters.resyncs += u64::from(!self.out_of_sync);
        (self.out_of_sync, self.accepted_when_quiet) = (true, false);
        self.advance(bytes);
    }

    fn advance(&mut self, bytes: usize) {
        self.start += bytes;
        self.scanned = self.scanned.saturating_sub(bytes);
    }

    fn compact(&mut self) {
        if self.start == 0 {
            return;
        }
        self.buffer.drain(..self.start);
        let start = std::mem::take(&mut self.start);
        while self.pieces.front().is_some_and(|&(end, _)| end <= start) {
            self.pieces.pop_front();
        }
        self.pieces.iter_mut().for_each(|(end, _)| *end -= start);
    }
}

/// Checks whether a line follows a payload, or the payload lost or gained bytes.
fn check_payload_end(payload: &[u8], rest: &[u8]) -> PayloadCheck {
    if contains_key(payload) {
        return PayloadCheck::Damage;
    }
    match *rest {
        // Ambiguous: a payload that ends with a brace and gained a byte, or a doubled brace.
        [b'{', b'{', ..] => PayloadCheck::Damage,
        // The brace of the line was lost, or the last byte of the payload.
        [b'"', ..] if payload.last() == Some(&b'{') => PayloadCheck::Damage,
        _ if rest.len() < LINE_START_BYTES + 1 => PayloadCheck::NeedsMoreBytes,
        _ if is_line_start(rest) => PayloadCheck::Line,
        _ => PayloadCheck::Damage,
    }
}

/// Whether these bytes start a line: with any lower-case key, or with a known key of which one byte
/// may be lost, doubled or damaged. Noise matches once in 10⁷ cases.
fn is_line_start(rest: &[u8]) -> bool {
    if rest.starts_with(b"{\"") && rest[2..LINE_START_BYTES].iter().all(u8::is_ascii_lowercase) {
        return true;
    }
    KEYS.iter().any(|key| {
        // The brace, then the key.
        let wanted = |at: usize| if at == 0 { b'{' } else { key[at - 1] };
        let same = (0..LINE_START_BYTES).take_while(|&at| rest[at] == wanted(at)).count();
        let goes_on = |skipped: usize, missing: usize| {
            (same..LINE_START_BYTES - missing).all(|at| rest[at + skipped] == wanted(at + missing))
        };
        let is_damaged = (same + 1..LINE_START_BYTES).all(|at| rest[at] == wanted(at));
        // An extra byte in front belongs to the payload, which gained it.
        same == LINE_START_BYTES || is_damaged || (same > 0 && goes_on(1, 0)) || goes_on(0, 1)
    })
}

fn contains_key(payload: &[u8]) -> bool {
    let quotes = payload.iter().enumerate().filter(|(_, byte)| **byte == b'"');
    quotes.into_iter().any(|(at, _)| KEYS.iter().any(|key| payload[at..].starts_with(key)))
}

/// Whether the last bytes could be the start of the next line: `{`, `{"`, `{"res`.
fn ends_with_line_start(payload: &[u8]) -> bool {
    let longest = KEYS.iter().map(|key| key.len()).max().unwrap_or(0) + 1;
    let tail = &payload[payload.len().saturating_sub(longest)..];
    let Some(brace) = tail.iter().rposition(|&byte| byte == b'{') else { return false };
    let (_, begun) = tail.split_at(brace + 1);
    KEYS.iter().any(|key| key.starts_with(begun))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::test_stream::{result_bytes, small_setup};
    use super::*;

    const RESULTS: u32 = 12;

    /// A stream of results with some log lines between them, and the position of each result.
    struct Stream {
        bytes: Vec<u8>,
        results: Vec<(std::ops::Range<usize>, ResultMessage)>,
    }

    fn stream(seed: u64) -> Stream {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut bytes, mut results) = (Vec::new(), Vec::new());
        for index in 0..RESULTS {
            let info = ResultInfo {
                tick: 1_000_000 + 15_151 * index,
                data_saturated: rng.random_bool(0.3),
                temperature: rng.random_range(-20..60),
                calibration_needed: rng.random_bool(0.3),
                frame_delayed: rng.random_bool(0.3),
            };
            // Any byte value: braces, quotes and newlines are as likely as others.
            let payload: Vec<u8> =
                (0..ResultLayout::of(&small_setup()).payload_bytes()).map(|_| rng.random()).collect();
            let begin = bytes.len();
            bytes.extend(result_bytes(&info, &payload));
            let frames = ResultLayout::of(&small_setup()).split(&payload);
            results.push((begin..bytes.len(), ResultMessage { infos: vec![info], frames }));
            if index % 4 == 3 {
                let log =
                    b"{\"status\":\"log\",\"level\":\"info\",\"timestamp\":7,\"module\":\"m\",\"log\":\"{ok}\"}\n";
                bytes.extend_from_slice(log);
            }
        }
        bytes.extend_from_slice(b"{\"status\":\"stop\"}\n");
        Stream { bytes, results }
    }

    fn parser() -> Parser {
        let mut parser = Parser::default();
        parser.expect_results(Some(ResultLayout::of(&small_setup())));
        parser
    }

    fn parsed(parser: &mut Parser, bytes: &[u8]) -> Vec<Message> {
        let mut out = Vec::new();
        parser.push(bytes, 0, &mut out);
        out.into_iter().map(|received| received.message).collect()
    }

    fn results(messages: &[Message]) -> Vec<ResultMessage> {
        let result = |m: &Message| if let Message::Result(result) = m { Some(result.clone()) } else { None };
        messages.iter().filter_map(result).collect()
    }

    #[test]
    fn valid_stream_parses_without_skipped_bytes() {
        let stream = stream(1);
        let mut parser = parser();
        let messages = parsed(&mut parser, &stream.bytes);
        assert_eq!(results(&messages), stream.results.iter().map(|(_, r)| r.clone()).collect::<Vec<_>>());
        assert_eq!(messages.last(), Some(&Message::Reply(Reply::Stopped)));
        let counters = parser.counters();
        assert_eq!((counters.skipped_bytes, counters.resyncs, counters.damaged_lines), (0, 0, 0));
        assert_eq!((parser.held_bytes(), counters.results), (0, u64::from(RESULTS)));
    }

    #[test]
    fn results_have_the_arrival_time_of_their_last_byte() {
        let stream = stream(2);
        let (mut parser, mut out) = (parser(), Vec::new());
        for (index, &byte) in stream.bytes.iter().enumerate() {
            parser.push(&[byte], index as i64, &mut out);
        }
        let times = out.iter().filter(|r| matches!(r.message, Message::Result(_))).map(|r| r.arrival_ns);
        assert!(times.eq(stream.results.iter().map(|(range, _)| range.end as i64 - 1)));
    }

    #[test]
    fn quiet_line_emits_only_complete_results() {
        let stream = stream(3);
        let (range, result) = &stream.results[0];
        let (mut parser, mut out) = (parser(), Vec::new());
        parser.push(&stream.bytes[..range.end - 1], 0, &mut out);
        parser.accept_when_quiet(&mut out);
        assert!(out.is_empty() && !parser.has_unconfirmed());
        parser.push(&stream.bytes[range.end - 1..range.end], 5, &mut out);
        assert!(out.is_empty() && parser.has_unconfirmed());
        parser.accept_when_quiet(&mut out);
        assert_eq!(out, [Received { message: Message::Result(result.clone()), arrival_ns: 5 }]);
        // One byte is lost and the brace of the next line takes its place: a quiet line proves
        // nothing.
        let mut short = stream.bytes[..range.end].to_vec();
        short.remove(range.end - 9);
        short.push(b'{');
        out.clear();
        parser.push(&short, 9, &mut out);
        parser.accept_when_quiet(&mut out);
        assert!(out.is_empty());
    }

    #[test]
    fn noise_in_a_payload_is_not_taken_as_its_end() {
        let stream = stream(5);
        let (first, second) = (&stream.results[0].0, &stream.results[1]);
        let payload_bytes = ResultLayout::of(&small_setup()).payload_bytes();
        // Nine extra bytes; the position of the payload's end then looks like the start of a line.
        for begin in [&b"{x"[..], b"{7k", b"a\"9", b"{\"\x80"] {
            let mut bytes = stream.bytes[first.clone()].to_vec();
            let at = bytes.len() - 9;
            bytes[at..at + begin.len()].copy_from_slice(begin);
            let inside = first.len() - payload_bytes / 2;
            bytes.splice(inside..inside, [1, 2, 3, 4, 5, 6, 7, 8, 9]);
            bytes.extend_from_slice(&stream.bytes[second.0.start..]);
            let got = results(&parsed(&mut parser(), &bytes));
            let wanted: Vec<_> = stream.results[1..].iter().map(|(_, result)| result.clone()).collect();
            assert_eq!(got, wanted, "{begin:?}");
        }
    }

    /// Applies one fault to a stream. Only touched results may be lost; emitted results must be
    /// right, except for undetectable damage.
    fn check_fault(stream: &Stream, at: usize, kind: usize, flip: u8) -> StreamCounters {
        let mut bytes = stream.bytes.clone();
        match kind {
            0 => drop(bytes.remove(at)),
            1 => bytes.insert(at, bytes[at]),
            _ => bytes[at] ^= flip,
        }
        let mut parser = parser();
        let got = results(&parsed(&mut parser, &bytes));
        let mut left: BTreeSet<usize> = (0..stream.results.len()).collect();
        let payload_bytes = ResultLayout::of(&small_setup()).payload_bytes();
        for result in &got {
            let exact = stream.results.iter().position(|(_, original)| original == result);
            let index = exact.unwrap_or_else(|| {
                // Differs from what was sent: a flip in a payload, or a digit of a tick or
                // temperature.
                let touched = stream.results.iter().position(|(range, _)| range.contains(&at)).expect("in a result");
                let (range, original) = &stream.results[touched];
                if at >= range.end - payload_bytes {
                    assert_eq!((kind, &original.infos), (2, &result.infos), "byte {at}");
                } else {
                    let (tick, temperature) = (result.infos[0].tick, result.infos[0].temperature);
                    let known = ResultInfo { tick, temperature, ..original.infos[0] };
                    assert_eq!((&vec![known], &original.frames), (&result.infos, &result.frames), "byte {at}");
                }
                touched
            });
            assert!(left.remove(&index), "result {index} twice");
        }
        for index in left {
            let range = &stream.results[index].0;
            // A second brace at a line's start looks like a doubled last byte of the payload, so
            // the previous result is dropped.
            let brace_after = bytes.get(range.end..range.end + 2) == Some(b"{{");
            assert!(range.contains(&at) || brace_after && at <= range.end + 1, "fault {kind} at {at} cost {range:?}");
        }
        *parser.counters()
    }

    #[test]
    fn damaged_byte_loses_only_the_result_it_touched() {
        for kind in 0..3 {
            let mut rng = ChaCha8Rng::seed_from_u64(4 + kind as u64);
            let (mut told, mut cost) = (0, 0);
            for trial in 0..1500 {
                let stream = stream(trial % 7);
                let end = stream.bytes.len() - 20;
                // Every third fault hits a line, since lines are short.
                let at = match trial % 3 {
                    0 => stream.results[rng.random_range(0..RESULTS as usize)].0.start + rng.random_range(0..130),
                    _ => rng.random_range(0..end),
                };
                let counters = check_fault(&stream, at, kind, 1 << rng.random_range(0..8));
                let faults = counters.damaged_lines + counters.damaged_payloads + counters.misfit_results;
                told += u32::from(faults + counters.resyncs > 0);
                cost += u64::from(RESULTS) - counters.results;
            }
            // Lost and doubled bytes are always detected, except in digits of ticks and
            // temperatures.
            assert!(told > if kind == 2 { 200 } else { 1400 }, "{kind}: {told} detected");
            assert!(cost <= 1500, "{kind}: {cost} results lost");
        }
    }

    #[test]
    fn every_bit_flip_in_a_line_is_handled() {
        let stream = stream(11);
        let next = stream.results[4].0.start;
        for at in (stream.results[3].0.start..stream.results[3].0.start + 130).chain(next - 3..next + 20) {
            (0..8).for_each(|bit| _ = check_fault(&stream, at, 2, 1 << bit));
            (0..2).for_each(|kind| _ = check_fault(&stream, at, kind, 0));
        }
    }

    #[test]
    fn unexpected_results_are_skipped_without_trusting_their_size() {
        let mut bytes = stream(5).bytes;
        let mut parser = Parser::default();
        let messages = parsed(&mut parser, &bytes);
        assert_eq!(messages.iter().filter(|m| **m == Message::StaleResult).count(), RESULTS as usize);
        assert_eq!(messages.last(), Some(&Message::Reply(Reply::Stopped)));
        // A size beyond any memory is counted as a misfit.
        let mut expecting = super::tests::parser();
        let info = stream(5).results[0].1.infos[0];
        bytes = result_bytes(&info, &[]);
        let text =
            String::from_utf8(bytes).unwrap().replace("\"payload_size\":0", "\"payload_size\":18446744073709551615");
        assert!(parsed(&mut expecting, text.as_bytes()).is_empty());
        assert_eq!((expecting.counters().misfit_results, expecting.held_bytes()), (1, 0));
    }

    #[test]
    fn bytes_are_scanned_once_for_a_line_end() {
        for end in ["", "\n", "\u{1}"] {
            let mut parser = parser();
            let text = [&"{\"".repeat(12_000), end].concat().repeat(4);
            text.as_bytes().chunks(700).for_each(|piece| _ = parsed(&mut parser, piece));
            assert!(parser.scanned_bytes <= text.len() as u64 + 50_000, "{} of {}", parser.scanned_bytes, text.len());
        }
    }

    #[test]
    fn endless_line_is_dropped_and_memory_stays_bounded() {
        let mut parser = parser();
        for _ in 0..50 {
            assert!(parsed(&mut parser, &[b"{\"".to_vec(), vec![b'a'; 5000]].concat()).is_empty());
            assert!(parser.held_bytes() <= MAX_LINE_BYTES + PIECE_BYTES);
        }
        // Many line starts, each of which has to be examined.
        for text in ["{\"", "{\"a\":", "{\"a\":[{\"b\":1},", "[[{\"tick\":"] {
            assert!(parsed(&mut parser, text.repeat(20_000).as_bytes()).is_empty());
        }
        assert!(parsed(&mut parser, b"\n{\"status\":\"stop\"}\n").contains(&Message::Reply(Reply::Stopped)));
    }

    /// Noise and fragments of lines, in any order.
    fn any_stream() -> impl Strategy<Value = Vec<u8>> {
        let info = ResultInfo {
            tick: 77,
            data_saturated: false,
            temperature: 20,
            calibration_needed: false,
            frame_delayed: false,
        };
        let payload = vec![b'{'; ResultLayout::of(&small_setup()).payload_bytes()];
        let whole = result_bytes(&info, &payload);
        let part = prop_oneof![
            prop::collection::vec(any::<u8>(), 0..200),
            Just(whole.clone()),
            (0..whole.len()).prop_map(move |n| whole[n..].to_vec()),
            prop::sample::select(vec![
                "{",
                "\"",
                "\n",
                "{\"status\":\"",
                "ok\"}\n",
                "{\"status\":\"start\"}\n",
                "[[{\"tick\":1"
            ])
            .prop_map(|text| text.as_bytes().to_vec()),
        ];
        prop::collection::vec(part, 0..20).prop_map(|parts| parts.concat())
    }

    proptest! {
        #[test]
        fn messages_do_not_depend_on_how_bytes_are_split(
            bytes in any_stream(),
            splits in prop::collection::vec(1usize..300, 1..40),
        ) {
            let mut whole = parser();
            let expected = parsed(&mut whole, &bytes);
            let mut split = parser();
            let (mut got, mut rest, mut sizes) = (Vec::new(), &bytes[..], splits.iter().cycle());
            while !rest.is_empty() {
                let (piece, later) = rest.split_at(rest.len().min(*sizes.next().unwrap()));
                got.extend(parsed(&mut split, piece));
                rest = later;
                let payload_bytes = ResultLayout::of(&small_setup()).payload_bytes();
                prop_assert!(split.held_bytes() <= MAX_LINE_BYTES + payload_bytes + 8);
            }
            prop_assert_eq!(&got, &expected);
            prop_assert_eq!(split.counters(), whole.counters());
            // Whatever came before, the next line is parsed once noise has ended the previous
            // message.
            let mut after = vec![0u8; 2 * ResultLayout::of(&small_setup()).payload_bytes()];
            after.extend_from_slice(b"{\"status\":\"stop\"}\n");
            prop_assert!(parsed(&mut whole, &after).contains(&Message::Reply(Reply::Stopped)));
        }
    }
}
