//! Parser of the board's byte stream, with any bytes in any split.
//!
//! Checks: no panic; messages and counters do not depend on the split; results have the length of
//! the set-up; buffered and allocated bytes are bounded; after noise the next line is parsed.
#![no_main]

use a121::{MAX_LINE_BYTES, Message, Parser, Received, Reply, ResultLayout};
use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{board, memory, script::Script, seeds};

/// Largest allocation, bytes: the lists that the longest line can describe, which grow by doubling.
const LARGEST_BYTES: usize = 1 << 20;

fuzz_target!(init: seeds::write("parser"), |data: &[u8]| {
    let mut script = Script(data);
    let (choice, mut seed) = (script.u8(), u32::from(script.u8()) + 1);
    let setup = board::setup(choice);
    let layout = (choice < 0xf0).then(|| ResultLayout::of(&setup));
    let lengths: Vec<usize> = board::samples(&setup).concat();
    let held_at_most = MAX_LINE_BYTES + 4 * lengths.iter().sum::<usize>() + 8;
    memory::bounded((1 << 22) + 64 * data.len(), LARGEST_BYTES.max(64 * data.len()), || {
        let (mut whole, mut split, mut settled) = (Parser::default(), Parser::default(), Parser::default());
        for parser in [&mut whole, &mut split, &mut settled] {
            parser.expect_results(layout.clone());
        }
        let (mut expected, mut got, mut rest) = (Vec::new(), Vec::new(), script.0);
        whole.push(rest, 0, &mut expected);
        let mut now_ns = 0;
        while !rest.is_empty() {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let size = 1 + (seed >> 16) as usize % if seed & 1 == 0 { 5 } else { 400 };
            let (piece, later) = rest.split_at(size.min(rest.len()));
            rest = later;
            now_ns += 1;
            split.push(piece, now_ns, &mut got);
            assert!(split.held_bytes() <= held_at_most, "{} bytes held", split.held_bytes());
            let mut out = Vec::new();
            settled.push(piece, now_ns, &mut out);
            if seed >> 8 & 3 == 0 {
                let is_due = settled.has_unconfirmed();
                let before = out.len();
                settled.accept_when_quiet(&mut out);
                assert!(!is_due || out.len() > before, "a due result was not emitted");
                assert!(!settled.has_unconfirmed());
            }
            out.iter().for_each(|received| check(received, &lengths));
        }
        let messages = |all: &[Received]| all.iter().map(|r| r.message.clone()).collect::<Vec<_>>();
        assert_eq!(messages(&got), messages(&expected));
        assert_eq!(split.counters(), whole.counters());
        assert!(got.windows(2).all(|pair| pair[0].arrival_ns <= pair[1].arrival_ns));
        expected.iter().for_each(|received| check(received, &lengths));
        let mut after = vec![0; 2 * held_at_most];
        after.extend_from_slice(b"{\"status\":\"stop\"}\n");
        expected.clear();
        whole.push(&after, 0, &mut expected);
        assert!(expected.iter().any(|r| r.message == Message::Reply(Reply::Stopped)), "not resynchronised");
    });
});

fn check(received: &Received, lengths: &[usize]) {
    if let Message::Result(result) = &received.message {
        assert_eq!(result.infos.len(), lengths.len());
        assert!(result.frames.iter().map(Vec::len).eq(lengths.iter().copied()));
    }
}
