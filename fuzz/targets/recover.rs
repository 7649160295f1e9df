//! Reader of recordings, on a sound recording that the input damages.
//!
//! Checks: no panic, no hang; every chunk that no edit touches is read, and nothing is made up; damage is reported; what is read
//! and written again is sound and the same.
#![no_main]

use std::ops::Range;
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{file, script::Script, seeds};
use radar_mapping::Event;
use radar_recording::{Existing, Recording, RecordingWriter};

/// A sound recording, and where its chunks are, with their events as text: NaN does not equal itself.
struct Sound {
    bytes: Vec<u8>,
    chunks: Vec<(Range<usize>, Vec<String>)>,
}

/// What an input does to a range of the recording.
struct Edit {
    hit: Range<usize>,
    bytes: Vec<u8>,
}

/// MCAP's opcode of a chunk, its magic bytes, and a record's opcode and length (MCAP specification).
const CHUNK: u8 = 6;
const MAGIC_BYTES: usize = 8;
const RECORD_HEAD_BYTES: usize = 9;

fn read(bytes: &[u8]) -> Option<(Vec<Event>, Recording)> {
    let mut recording = Recording::open(file::temp_file_with(bytes)).ok()?;
    Some((recording.by_ref().collect(), recording))
}

fn texts(events: &[Event]) -> Vec<String> {
    events.iter().map(|event| format!("{event:?}")).collect()
}

fn sound() -> &'static Sound {
    static SOUND: OnceLock<Sound> = OnceLock::new();
    SOUND.get_or_init(|| {
        let bytes = seeds::long_recording();
        let (mut chunks, mut at, mut known) = (Vec::new(), MAGIC_BYTES, 0);
        while let Some(head) = bytes.get(at..at + RECORD_HEAD_BYTES) {
            let length = u64::from_le_bytes(head[1..].try_into().expect("eight bytes")) as usize;
            let end = at + RECORD_HEAD_BYTES + length;
            if head[0] == CHUNK {
                // What the file gives up to here, less what it gave up to the chunk before.
                let events = read(&bytes[..end]).map_or(Vec::new(), |(events, _)| texts(&events));
                chunks.push((at..end, events[known..].to_vec()));
                known = events.len();
            }
            at = end;
        }
        assert!(chunks.len() > 5 && known > 100, "{} chunks, {known} events", chunks.len());
        Sound { bytes, chunks }
    })
}

/// Edits from the first chunk on, the last first; the header has tests of its own.
fn edits(sound: &Sound, data: &[u8]) -> Vec<Edit> {
    let mut script = Script(data);
    let mut edits = Vec::new();
    let first = sound.chunks[0].0.start;
    while !script.is_over() && edits.len() < 8 {
        let at = first + usize::from(script.u16()) * (sound.bytes.len() - first) / (1 << 16);
        let (kind, length) = (script.u8() % 4, usize::from(script.u8()));
        let end = (at + length).min(sound.bytes.len());
        edits.push(match kind {
            0 => Edit { hit: at..at + 1, bytes: vec![sound.bytes[at] ^ 1 << (length % 8)] },
            1 => Edit { hit: at..end, bytes: Vec::new() },
            2 => Edit { hit: at..end, bytes: vec![0; end - at] },
            _ => Edit { hit: at..at, bytes: script.bytes(length % 64).to_vec() },
        });
    }
    edits.sort_by_key(|edit| std::cmp::Reverse(edit.hit.start));
    // Only those that do not reach into what is edited already.
    let mut behind = sound.bytes.len();
    edits.retain(|edit| {
        let is_apart = edit.hit.end <= behind;
        behind = if is_apart { edit.hit.start } else { behind };
        is_apart
    });
    edits
}

fuzz_target!(init: seeds::write("recover"), |data: &[u8]| {
    let sound = sound();
    let edits = edits(sound, data);
    let mut bytes = sound.bytes.clone();
    for Edit { hit, bytes: new } in &edits {
        bytes.splice(hit.clone(), new.iter().copied());
    }
    let (events, recording) = read(&bytes).expect("the header is whole");
    assert!(bytes == sound.bytes || !recording.damage().is_none(), "unnoticed");
    let found = texts(&events);
    let mut rest = found.as_slice();
    for (range, events) in &sound.chunks {
        if let Some(behind) = rest.strip_prefix(events.as_slice()) {
            rest = behind;
            continue;
        }
        let is_hit = edits.iter().any(|edit| edit.hit.start < range.end && range.start < edit.hit.end.max(edit.hit.start + 1));
        assert!(is_hit, "{range:?} is lost: {}", recording.damage());
    }
    assert!(rest.is_empty(), "made up: {rest:?}");
    let path = file::temp_path("-written");
    let mut writer = RecordingWriter::create(&path, recording.header(), Existing::Replace).expect("a file");
    events.iter().for_each(|event| writer.write(event).expect("an event"));
    writer.finish().expect("a recording");
    let (again, recovered) = read(&std::fs::read(&path).expect("a recording")).expect("what was recovered can be read");
    assert!(recovered.damage().is_none() && texts(&again) == found);
});
