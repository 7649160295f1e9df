//! Tests of the reader thread against a small fake board over a socket and a pseudo-terminal.

use std::path::PathBuf;
use std::time::Instant;

use super::super::test_board::{SAMPLES, TestBoard, setup};
use super::*;
use a121::SensorFrame;
use a121::find::{Board, choose};

/// Upper bound of every wait. Choice: a loaded machine passes, a hang fails.
const TIMEOUT: Duration = Duration::from_secs(20);

fn open(address: &str, options: &StreamOptions) -> SensorStream {
    SensorStream::open(setup(), &choose(Some(address), &[]).unwrap(), options).unwrap()
}

fn link(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("radar-chaperone-{name}-{}", std::process::id()))
}

/// Takes events until one matches.
fn until<T>(stream: &SensorStream, mut wanted: impl FnMut(StreamEvent) -> Option<T>) -> T {
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        match stream.recv_timeout(Duration::from_millis(200)) {
            Received::Event(event) => {
                if let Some(found) = wanted(event) {
                    return found;
                }
            }
            Received::TimedOut => {}
            Received::Closed => panic!("over too early: {:?}", stream.counters()),
        }
    }
    panic!("it never came: {:?}", stream.counters());
}

fn next_frame(stream: &SensorStream) -> SensorFrame {
    until(stream, |event| match event {
        StreamEvent::Session(Event::Frames(mut frames)) => frames.pop(),
        _ => None,
    })
}

fn reopened(event: StreamEvent) -> Option<String> {
    match event {
        StreamEvent::Reopened(address) => Some(address),
        _ => None,
    }
}

#[test]
fn frames_arrive_in_order_with_their_times() {
    let (_board, address) = TestBoard::on_tcp();
    let stream = open(&format!("tcp:{address}"), &StreamOptions::default());
    let frames: Vec<SensorFrame> = (0..100).map(|_| next_frame(&stream)).collect();
    for (before, after) in frames.iter().zip(&frames[1..]) {
        assert_eq!(after.frame.tick - before.frame.tick, 5000);
        assert!(after.frame.host_time_ns > before.frame.host_time_ns && after.frame.host_time_ns < now_ns());
        assert_eq!(after.frame.samples[0].re.wrapping_sub(before.frame.samples[0].re), 1);
    }
    assert!(frames.iter().all(|f| f.frame.samples.len() == SAMPLES && f.sensor_id == 1));
    stream.stop();
    let start = Instant::now();
    while stream.recv_timeout(Duration::from_millis(50)) != Received::Closed {
        assert!(start.elapsed() < TIMEOUT, "stopping hangs");
    }
    let counters = stream.finish();
    assert!(counters.session.results >= 100 && counters.session.stream.skipped_bytes == 0, "{counters:?}");
    assert_eq!((counters.dropped, counters.losses), (Dropped::default(), 0));
    assert!(counters.latency.count == counters.session.results && counters.latency.max_s > 0.0, "{counters:?}");
    assert!(counters.cpu_s > 0.0 && counters.cpu_s < counters.running_s && counters.clock.is_some());
}

#[test]
fn closed_socket_is_reopened_and_streams_again() {
    let (board, address) = TestBoard::on_tcp();
    let stream = open(&format!("tcp:{address}"), &StreamOptions::default());
    next_frame(&stream);
    board.pull();
    until(&stream, |event| matches!(event, StreamEvent::Session(Event::Trouble(_))).then_some(()));
    until(&stream, |event| matches!(event, StreamEvent::Waiting(_)).then_some(()));
    board.plug_in();
    assert_eq!(until(&stream, reopened), format!("tcp:{address}"));
    next_frame(&stream);
    let counters = stream.finish();
    assert_eq!((counters.losses, counters.reopenings), (1, 1));
}

#[test]
fn replugged_terminal_streams_again() {
    let link = link("replug");
    let board = TestBoard::on_terminal(&link);
    let stream = open(link.to_str().unwrap(), &StreamOptions::default());
    next_frame(&stream);
    board.pull();
    let reason = until(&stream, |event| match event {
        StreamEvent::Session(Event::Trouble(error)) => Some(error.to_string()),
        _ => None,
    });
    assert!(reason.contains("the connection is lost"), "{reason}");
    board.plug_in();
    until(&stream, reopened);
    next_frame(&stream);
    drop(stream);
}

#[test]
fn slow_reader_gets_newest_frames_and_drops_are_counted() {
    let (_board, address) = TestBoard::on_tcp();
    let stream = open(&format!("tcp:{address}"), &StreamOptions { max_results: 10, baud: None });
    let start = Instant::now();
    while stream.counters().dropped.frames < 50 {
        assert!(start.elapsed() < TIMEOUT, "{:?}", stream.counters());
        std::thread::sleep(Duration::from_millis(20));
    }
    // Earlier events of other channels are still delivered.
    until(&stream, |event| matches!(event, StreamEvent::Session(Event::Streaming)).then_some(()));
    let oldest = next_frame(&stream).frame;
    assert!(oldest.tick >= 5000 * 50, "{}", oldest.tick);
    let counters = stream.finish();
    assert!(counters.dropped.frames >= 50 && counters.session.results > counters.dropped.frames, "{counters:?}");
}

#[test]
fn stopping_is_bounded_in_time() {
    // A board that accepts the connection and never answers.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let stream = open(&format!("tcp:{}", listener.local_addr().unwrap()), &StreamOptions::default());
    let start = Instant::now();
    stream.finish();
    assert!(start.elapsed() < TIMEOUT);
    // A board that disappears while frames are expected.
    let (board, address) = TestBoard::on_tcp();
    let stream = open(&format!("tcp:{address}"), &StreamOptions::default());
    next_frame(&stream);
    drop(board);
    stream.finish();
    assert!(start.elapsed() < TIMEOUT);
}

#[test]
fn open_errors_are_immediate() {
    let candidate = choose(Some("/dev/ttyNONE7"), &[]).unwrap();
    assert_eq!(candidate.board, Board::Unknown);
    let error = SensorStream::open(setup(), &candidate, &StreamOptions::default()).err().unwrap();
    assert!(matches!(error, StreamError::Port(PortError::NotFound { .. })), "{error}");
    let (_board, address) = TestBoard::on_tcp();
    let candidate = choose(Some(&format!("tcp:{address}")), &[]).unwrap();
    let error = SensorStream::open(Setup::default(), &candidate, &StreamOptions::default()).err().unwrap();
    assert!(matches!(error, StreamError::Session(SessionError::NoSensors)), "{error}");
}
