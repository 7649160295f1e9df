//! Tests of reading: round trips, damage at every place, power cuts, hostile files.

use std::collections::HashSet;
use std::ops::Range;

use glam::DVec3;
use num_complex::Complex;
use proptest::prelude::*;

use super::*;
use crate::test_files::{TestFile, assert_same, events, header, recorded, recorded_with};
use a121::Frame;
use radar_mapping::HandsSample;
use radar_sar::PoseSample;
use radar_sar::TrackingResult;

fn read(bytes: &[u8]) -> Result<(Vec<Event>, Recording), RecordingError> {
    let file = TestFile::with(bytes);
    let mut recording = Recording::open(&file.0)?;
    Ok((recording.by_ref().collect(), recording))
}

#[test]
fn events_and_header_round_trip() {
    let written = events(3);
    let (events, recording) = read(&recorded(&written)).unwrap();
    assert_same(&events, &written);
    assert_eq!(recording.header(), &header());
    assert!(recording.damage().is_none(), "{}", recording.damage());
}

proptest! {
    #[test]
    fn arbitrary_numbers_round_trip_exactly(
        bits in prop::array::uniform7(any::<u64>()),
        times in prop::collection::vec(any::<i64>(), 3),
        flags in any::<[bool; 4]>(),
        result in 0..4usize,
        samples in prop::collection::vec(any::<(i16, i16)>(), 0..40),
        temperature_c in any::<i16>(),
    ) {
        let numbers = bits.map(f64::from_bits);
        let results = [
            TrackingResult::Ok,
            TrackingResult::OutOfRange,
            TrackingResult::RotationOnly,
            TrackingResult::NotTracking,
        ];
        let pose = PoseSample {
            time_ns: times[0],
            position_m: [numbers[0], numbers[1], -0.0],
            quaternion_xyzw: [numbers[3], f64::NAN, numbers[5], numbers[6]],
            valid: flags[0],
            result: results[result],
        };
        let frame = Frame {
            tick: times[1],
            host_time_ns: times[2],
            temperature_c,
            data_saturated: flags[1],
            frame_delayed: flags[2],
            calibration_needed: flags[3],
            samples: samples.iter().map(|&(re, im)| Complex::new(re, im)).collect(),
        };
        let written = [Event::Pose(pose), Event::Frame(frame), Event::Pose(pose)];
        let (events, recording) = read(&recorded(&written)).unwrap();
        assert_same(&events, &written);
        prop_assert!(recording.damage().is_none());
    }
}

#[test]
fn hands_round_trip_and_untracked_hands_stay_absent() {
    let hands = |time_ns, left: Option<DVec3>, right: Option<DVec3>| {
        Event::Hands(HandsSample { time_ns, hands_m: [left, right] })
    };
    let (here, there) = (DVec3::new(0.1, 1.0 / 3.0, -0.0), DVec3::new(-0.5, 1.2, -0.4));
    let mut written = events(1);
    let bare = recorded(&written);
    written.insert(9, hands(5, Some(here), None));
    written.insert(20, hands(6, Some(there), Some(here)));
    written.insert(21, hands(7, None, None));
    let (events, recording) = read(&recorded(&written)).unwrap();
    assert_same(&events, &written);
    assert!(recording.damage().is_none(), "{}", recording.damage());
    // A position that is not finite counts as not tracked. Without hands, the file has no
    // topics of hands.
    let (events, _) = read(&recorded(&[hands(1, Some(DVec3::NAN), Some(here))])).unwrap();
    assert_same(&events, &[hands(1, None, Some(here))]);
    let topic = b"/tracking/hands_raw";
    assert!(!bare.windows(topic.len()).any(|window| window == topic));
}

#[test]
fn hands_with_invalid_numbers_are_rejected() {
    for bytes in [[f64::NAN, 0.0, 0.0].as_slice(), &[0.0; 2], &[f64::INFINITY; 3], &[0.0; 4]] {
        // Field 2, packed doubles, after a time of 0.
        let mut message = vec![0x12, bytes.len() as u8 * 8];
        message.extend(bytes.iter().flat_map(|v| v.to_le_bytes()));
        let refused = decode_hands(&message).unwrap_err();
        assert!(refused.starts_with("a hand has the position"), "{refused}");
    }
}

#[test]
fn truncated_file_gives_events_before_the_cut() {
    let written = events(4);
    let bytes = recorded(&written);
    let mut most = 0;
    for length in (0..bytes.len()).step_by(97) {
        match read(&bytes[..length]) {
            Ok((events, recording)) => {
                assert!(events.len() >= most, "a longer file gave less");
                most = events.len();
                assert_same(&events, &written[..events.len()]);
                assert!(recording.damage().ended_early.is_some());
                assert_eq!(recording.header().config, header().config);
            }
            Err(error) => {
                assert!(length < 8000, "{length}: {error}");
                assert_eq!(most, 0);
            }
        }
    }
    assert_eq!(most, written.len());
}

#[test]
fn flipped_byte_loses_at_most_one_chunk() {
    let written = events(4);
    let bytes = recorded(&written);
    // NaN does not equal itself; its text does.
    let known: HashSet<String> = written.iter().map(|event| format!("{event:?}")).collect();
    let (mut files, mut sound) = (0, 0);
    for position in (0..bytes.len()).step_by(211) {
        let mut damaged = bytes.clone();
        damaged[position] ^= 0x55;
        files += 1;
        let Ok((events, recording)) = read(&damaged) else { continue };
        assert!(events.len() <= written.len());
        // Usually one chunk of about 61 events is lost; broken framing is rare.
        sound += usize::from(events.len() + 62 >= written.len() && !recording.damage().is_none());
        assert!(events.iter().all(|e| known.contains(&format!("{e:?}"))), "a made-up event, byte {position}");
    }
    assert!(sound > files / 2, "{sound} of {files}");
}

#[test]
fn damaged_chunk_is_skipped() {
    let written = events(4);
    let mut bytes = recorded(&written);
    let chunks = chunks(&bytes);
    let middle = &chunks[chunks.len() / 2].0;
    bytes[(middle.start + middle.end) / 2] ^= 0xff;
    let (events, recording) = read(&bytes).unwrap();
    assert_eq!(recording.damage().chunks_damaged, 1);
    assert_eq!(recording.damage().bytes_skipped, 0);
    assert!(recording.damage().ended_early.is_none());
    assert!(events.len() < written.len() && events.len() + 62 > written.len());
    assert_same(&events[events.len() - 1..], &written[written.len() - 1..]);
    let frames = |events: &[Event]| events.iter().filter(|event| matches!(event, Event::Frame(_))).count();
    assert_eq!(recording.stated_frames(), Some(frames(&written) as u64));
}

/// Where each chunk is, and its events as text: NaN does not equal itself.
fn chunks(bytes: &[u8]) -> Vec<(Range<usize>, Vec<String>)> {
    let index = mcap::Summary::read(bytes).unwrap().unwrap();
    let of = |chunk: &mcap::records::ChunkIndex| {
        let (start, length) = (chunk.chunk_start_offset as usize, chunk.chunk_length as usize);
        let mut content = Content::new(u64::MAX);
        content.take_chunk(&bytes[start + 9..start + length]).unwrap();
        (start..start + length, content.events.iter().map(|event| format!("{event:?}")).collect())
    };
    let mut chunks: Vec<_> = index.chunk_indexes.iter().map(of).collect();
    chunks.sort_by_key(|chunk| chunk.0.start);
    chunks
}

/// Every chunk is there, but for some of those that may be lost; nothing is made up.
fn check_chunks(
    chunks: &[(Range<usize>, Vec<String>)],
    found: &[Event],
    may_be_lost: impl Fn(&Range<usize>) -> bool,
    place: &str,
) {
    let found: Vec<String> = found.iter().map(|event| format!("{event:?}")).collect();
    let mut rest = found.as_slice();
    for (range, events) in chunks {
        if let Some(behind) = rest.strip_prefix(events.as_slice()) {
            rest = behind;
            continue;
        }
        assert!(may_be_lost(range), "{place}: {range:?} is lost");
    }
    assert_eq!(rest.len(), 0, "{place}: made up");
}

/// What a disk holds after a power cut: all that was passed to it; of the rest any pages, others being zeros or missing.
#[test]
fn a_power_cut_at_any_byte_loses_only_what_was_not_passed_to_the_disk() {
    const PAGE: usize = 512;
    let bytes = recorded(&events(6));
    let chunks = chunks(&bytes);
    let mut state = 7u32;
    let mut random = move |below: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((u64::from(state) * below as u64) >> 32) as usize
    };
    let first = chunks[0].0.end;
    for _ in 0..1500 {
        let written = first + random(bytes.len() - first + 1);
        // The disk is behind by up to three chunks.
        let whole = chunks.iter().map(|chunk| chunk.0.end).take_while(|end| *end <= written);
        let ends: Vec<usize> = whole.collect();
        let synced = ends[ends.len() - 1 - random(ends.len().min(3))];
        let mut disk = bytes[..synced + random(written - synced + 1)].to_vec();
        let end = disk.len();
        for page in (synced.next_multiple_of(PAGE)..end).step_by(PAGE) {
            if random(2) == 0 {
                disk[page..(page + PAGE).min(end)].fill(0);
            }
        }
        disk.resize(end + random(3) * PAGE, 0);
        let place = format!("{written} of {} bytes written, {synced} on the disk", bytes.len());
        let (found, recording) = read(&disk).unwrap_or_else(|error| panic!("{place}: {error}"));
        assert_eq!(recording.header(), &header(), "{place}");
        check_chunks(&chunks, &found, |range| range.end > synced, &format!("{place}: {}", recording.damage()));
    }
}

#[test]
fn no_bit_of_a_chunks_head_or_of_what_is_between_chunks_costs_another_chunk() {
    let bytes = recorded(&events(4));
    let chunks = chunks(&bytes);
    let heads = chunks.iter().flat_map(|chunk| chunk.0.start..chunk.0.start + 61);
    let of_heads = heads.flat_map(|at| (0..8).map(move |bit| (at, bit)));
    let behind = chunks.iter().map(|chunk| chunk.0.end).zip(chunks.iter().skip(1).map(|chunk| chunk.0.start));
    let between = behind.flat_map(|(end, next)| (end..next).step_by(7)).map(|at| (at, at % 8));
    for (at, bit) in of_heads.chain(between) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << bit;
        let (found, recording) = read(&flipped).unwrap_or_else(|error| panic!("byte {at}, bit {bit}: {error}"));
        assert!(!recording.damage().is_none(), "byte {at}, bit {bit}: unnoticed");
        let place = format!("byte {at}, bit {bit}: {}", recording.damage());
        check_chunks(&chunks, &found, |range| range.contains(&at), &place);
    }
}

#[test]
fn hostile_files_are_read_in_linear_time() {
    let sound = recorded(&events(1));
    let header_end = chunks(&sound)[0].0.start;
    let empty_chunk = [&[op::CHUNK][..], &[0; 8]].concat();
    let head = [&[op::CHUNK][..], &u64::MAX.to_le_bytes(), &[7; 28], b"\x04\0\0\0zstd", &[0xff; 8]].concat();
    // Claims what is allowed, and unpacks to more.
    let bomb = {
        let mut packed = Vec::with_capacity(1 << 20);
        zstd_safe::compress(&mut packed, &vec![0; 33 << 20], 3).unwrap();
        let claims = [&[7; 16][..], &(32u64 << 20).to_le_bytes(), &[7; 4], b"\x04\0\0\0zstd"].concat();
        let content = [&claims[..], &(packed.len() as u64).to_le_bytes(), &packed].concat();
        [&[op::CHUNK][..], &(content.len() as u64).to_le_bytes(), &content].concat()
    };
    let large = [&[op::CHUNK][..], &(1u64 << 20).to_le_bytes(), &[7; 28], b"\x04\0\0\0zstd", &[0; 8]].concat();
    let metadata = [&(1u64 << 22).to_le_bytes()[..], b"\x0f\0\0\0radar_chaperone"].concat();
    for (start, repeated, length) in [
        (header_end, empty_chunk, 4 << 20),
        (header_end, head, 4 << 20),
        (header_end, large, 4 << 20),
        (header_end, bomb.clone(), 100 * bomb.len()),
        (8, metadata, 4 << 20),
        (8, b"\x04\0\0\0zstd".to_vec(), 4 << 20),
    ] {
        // A search for each of them would take hours.
        let mut bytes = sound[..start].to_vec();
        bytes.extend(repeated.iter().cycle().take(length));
        if let Ok((events, recording)) = read(&bytes) {
            assert!(events.is_empty() && !recording.damage().is_none());
        }
    }
}

/// Harms a file at a byte; how many bytes it hits. The number decides on the bit.
type Harm = fn(&mut Vec<u8>, usize, u32) -> usize;

#[test]
fn every_chunk_that_is_not_hit_is_read() {
    let bytes = recorded(&events(6));
    let chunks = chunks(&bytes);
    assert!(chunks.len() >= 7, "topics, and one a second");
    let harms: [Harm; 3] = [
        |bytes, at, n| {
            bytes[at] ^= 1 << (n % 8);
            1
        },
        |bytes, at, _| {
            let end = (at + 512).min(bytes.len());
            bytes.drain(at..end);
            end - at
        },
        |bytes, at, _| {
            let end = (at + 512).min(bytes.len());
            bytes[at..end].fill(0);
            end - at
        },
    ];
    for (kind, harm) in harms.iter().enumerate() {
        let mut state = 1u32;
        for n in 0..1000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let at = ((u64::from(state) * bytes.len() as u64) >> 32) as usize;
            let mut harmed = bytes.clone();
            let hit = at..at + harm(&mut harmed, at, n);
            let place = format!("harm {kind} at byte {at} of {}", bytes.len());
            let (found, recording) = read(&harmed).unwrap_or_else(|error| panic!("{place}: {error}"));
            assert_eq!(recording.header(), &header(), "{place}");
            assert!(!recording.damage().is_none(), "{place}: unnoticed");
            let may_be_lost = |range: &Range<usize>| range.start < hit.end && hit.start < range.end;
            check_chunks(&chunks, &found, may_be_lost, &format!("{place}: {}", recording.damage()));
        }
    }
}

#[test]
fn no_flipped_bit_of_the_header_goes_unnoticed() {
    let bytes = recorded(&[]);
    let copy_end = content_of(&bytes, op::DATA_END, 8) - 9;
    for bit in 0..copy_end * 8 {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let (_, recording) = read(&flipped).unwrap_or_else(|error| panic!("bit {bit}: {error}"));
        assert_eq!(recording.header(), &header(), "bit {bit}");
        assert!(!recording.damage().is_none(), "bit {bit} of {} went unnoticed", copy_end * 8);
    }
}

#[test]
fn no_flipped_bit_behind_the_data_goes_unnoticed_or_costs_an_event() {
    let written = events(1);
    let bytes = recorded(&written);
    let last = chunks(&bytes).last().unwrap().0.end;
    for bit in content_of(&bytes, op::DATA_END, last) * 8 - 72..bytes.len() * 8 {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let (found, recording) = read(&flipped).unwrap_or_else(|error| panic!("bit {bit}: {error}"));
        assert_same(&found, &written);
        assert!(!recording.damage().is_none(), "bit {bit} of {} went unnoticed", bytes.len() * 8);
    }
    let (found, recording) = read(&[&bytes[..], b"x"].concat()).unwrap();
    assert_same(&found, &written);
    assert!(recording.damage().index_damaged);
}

#[test]
fn what_looks_like_the_end_costs_nothing_behind_it() {
    let written = events(4);
    let mut bytes = recorded(&written);
    let topics = content_of(&bytes, op::CHUNK, 8) - 9;
    for (opcode, length) in [(op::FOOTER, 20), (op::DATA_END, 4)] {
        bytes[topics..topics + 9].copy_from_slice(&[opcode, length, 0, 0, 0, 0, 0, 0, 0]);
        let (found, recording) = read(&bytes).unwrap();
        assert_same(&found, &written);
        let damage = recording.damage();
        assert!(damage.ended_early.is_none() && !damage.is_none(), "{opcode}: {damage}");
    }
    // Between two chunks, and before the end itself: an end of the data of the right and of a wrong length, with a footer behind it,
    // and with a record that takes the next chunk for its content.
    let bytes = recorded(&written);
    let found_chunks = chunks(&bytes);
    let (chunk, next) = (&found_chunks[2].0, &found_chunks[3].0);
    let data_end = [&[op::DATA_END, 4][..], &[0; 11]].concat();
    let wrong_length = [&[op::DATA_END, 5][..], &[0; 12]].concat();
    let footer = [&data_end[..], &[op::FOOTER, 20], &[0; 27]].concat();
    let swallow = [&data_end[..], &[7], &((next.end - next.start) as u64).to_le_bytes()].concat();
    let end = content_of(&bytes, op::DATA_END, found_chunks.last().unwrap().0.end) - 9;
    for (n, inserted) in [data_end.clone(), wrong_length, footer, swallow].iter().enumerate() {
        for at in [chunk.start, next.start, end] {
            let (found, recording) = read(&[&bytes[..at], inserted, &bytes[at..]].concat()).unwrap();
            let place = format!("{n} at {at}: {}", recording.damage());
            assert_same(&found, &written);
            assert!(!recording.damage().is_none(), "{place}");
            assert!(recording.damage().ended_early.is_none() || at == end, "{place}");
        }
    }
    // Nor does it hide the damage of what follows.
    let mut harmed = [&bytes[..chunk.start], &data_end, &bytes[chunk.start..]].concat();
    harmed[data_end.len() + chunk.end - 40] ^= 1;
    let (found, recording) = read(&harmed).unwrap();
    assert!(found.len() < written.len() && found.len() + 62 > written.len());
    assert_eq!((recording.damage().chunks_damaged, recording.damage().ended_early.clone()), (1, None));
}

#[test]
fn recording_behind_another_is_left_to_itself() {
    let written = events(4);
    let bytes = recorded(&written);
    let (found, recording) = read(&[&bytes[..], &bytes[..]].concat()).unwrap();
    assert_same(&found, &written);
    let reason = recording.damage().ended_early.clone().unwrap();
    assert!(reason.starts_with(&format!("at byte {} is another recording", bytes.len())), "{reason}");
    // The first one cut, and one of another sensor behind it, whose chunks before the first copy of its header look like this one's.
    let found_chunks = chunks(&bytes);
    let other = recorded_with(&written, &Header { source: "another".into(), ..header() });
    let (found, recording) = read(&[&bytes[..found_chunks[2].0.start + 20], &other[..]].concat()).unwrap();
    let at_most: usize = found_chunks[..5].iter().map(|(_, events)| events.len()).sum();
    assert!(found.len() <= at_most, "{} of at most {at_most}", found.len());
    assert!(recording.damage().ended_early.as_ref().unwrap().contains("another recording"), "{}", recording.damage());
    // Anything else behind the end is no beginning.
    let (found, recording) = read(&[&bytes[..], &bytes[4..]].concat()).unwrap();
    assert_eq!(found.len(), 2 * written.len());
    assert!(recording.damage().bytes_skipped > 0 && recording.damage().ended_early.is_none());
}

/// A record of any kind, wherever records may begin, that claims as its content what follows it, to the end of a chunk or into one.
#[test]
fn no_record_hides_the_chunks_behind_it() {
    let written = events(4);
    let bytes = recorded(&written);
    let found_chunks = chunks(&bytes);
    let starts: Vec<usize> = found_chunks.iter().map(|chunk| chunk.0.start).collect();
    let data_end = [&[op::DATA_END, 4][..], &[0; 11]].concat();
    for opcode in op::HEADER..=op::DATA_END {
        for (n, at) in starts.iter().copied().enumerate().take(3) {
            for (before, claimed) in [
                (&[][..], found_chunks[n].0.end - at),
                (&[], found_chunks[n + 2].0.end - at),
                (&[], found_chunks[n + 2].0.end - at - 100),
                (&data_end, found_chunks[n + 1].0.end - at),
            ] {
                let head = [before, &[opcode], &(claimed as u64).to_le_bytes()].concat();
                let (found, recording) = read(&[&bytes[..at], &head, &bytes[at..]].concat()).unwrap();
                let damage = recording.damage();
                assert_eq!(found.len(), written.len(), "kind {opcode}, {claimed} bytes at {at}: {damage}");
                assert_same(&found, &written);
                assert!(damage.bytes_skipped > 0, "kind {opcode}, {claimed} bytes at {at}: {damage}");
            }
        }
    }
}

/// Of a chunk record's content, its checksum: behind two times and the unpacked size (MCAP specification, "Chunk").
const CHECKSUM_IN_CHUNK: Range<usize> = 24..28;

#[test]
fn topics_are_known_with_a_damaged_declaration() {
    let written = events(2);
    let mut bytes = recorded(&written);
    let topics = content_of(&bytes, op::CHUNK, 8);
    bytes[topics + 100] ^= 0xff;
    let (events, recording) = read(&bytes).unwrap();
    assert_same(&events, &written);
    assert_eq!((recording.damage().chunks_damaged, recording.damage().messages_skipped), (1, 0));
    // Zeros for its checksum, with any other bit wrong: MCAP would take it unchecked.
    let sound = recorded(&written);
    for at in topics + CHECKSUM_IN_CHUNK.end..chunks(&sound)[0].0.end {
        for bit in [0, 3, 7] {
            let mut bytes = sound.clone();
            bytes[topics + CHECKSUM_IN_CHUNK.start..topics + CHECKSUM_IN_CHUNK.end].fill(0);
            bytes[at] ^= 1 << bit;
            let (events, recording) = read(&bytes).unwrap();
            assert_same(&events, &written);
            assert!(!recording.damage().is_none(), "bit {bit} at {at}");
        }
    }
}

#[test]
fn what_all_chunks_unpack_to_is_bounded() {
    let bytes = recorded(&events(3));
    let (start, end) = {
        let range = &chunks(&bytes)[1].0;
        (range.start, range.end)
    };
    let chunk = &bytes[start + 9..end];
    let unpacked_bytes = crate::record::chunk_header(chunk).unwrap().unpacked_bytes;
    let mut content = Content::new(10 * unpacked_bytes + unpacked_bytes / 2);
    let taken = (0..20).map(|_| content.take_chunk(chunk)).take_while(Result::is_ok).count();
    assert_eq!(taken, 10);
    assert!(content.take_chunk(chunk).unwrap_err().contains("cannot be a recording"));
    // What only claims to unpack to much counts nothing.
    let mut content = Content::new(unpacked_bytes);
    let mut damaged = chunk.to_vec();
    let end = damaged.len();
    damaged[end - 20..].fill(0xff);
    damaged.truncate(end - 1);
    assert!((0..20).all(|_| content.take_chunk(&damaged).is_err()));
    assert_eq!(content.take_chunk(chunk), Ok(()));
}

/// Offset of the content of the first top-level record with this opcode, from `from` on.
fn content_of(bytes: &[u8], opcode: u8, from: usize) -> usize {
    let mut at = from;
    while bytes[at] != opcode {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at + 9
}

#[test]
fn huge_lengths_are_rejected_without_allocation() {
    let bytes = recorded(&events(2));
    let topics = content_of(&bytes, op::CHUNK, 8);
    let chunk = content_of(&bytes, op::CHUNK, topics - 9 + 9 + chunk_length(&bytes, topics));
    // A chunk that claims 100 GB when unpacked is skipped.
    let mut bomb = bytes.clone();
    bomb[chunk + 16..chunk + 24].copy_from_slice(&100_000_000_000u64.to_le_bytes());
    let (_, recording) = read(&bomb).unwrap();
    assert!(recording.damage().first_reason.as_ref().unwrap().contains("100000000000 bytes"));
    // A record that claims 100 GB ends reading.
    let mut long = bytes.clone();
    long[chunk - 8..chunk].copy_from_slice(&100_000_000_000u64.to_le_bytes());
    let (found, recording) = read(&long).unwrap();
    assert_same(&found, &events(2));
    assert!(recording.damage().first_reason.as_ref().unwrap().contains("claims 100000000000 bytes"));
    // A compression name of 4 GB.
    let mut name = bytes.clone();
    name[chunk + 28..chunk + 32].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(read(&name).unwrap().1.damage().chunks_damaged, 1);
    // Zeros, as a file system may leave them after a power failure.
    let mut zeros = bytes[..chunk - 9].to_vec();
    zeros.extend([0; 5000]);
    assert!(read(&zeros).unwrap().1.damage().ended_early.as_ref().unwrap().contains("zeros"));
}

fn chunk_length(bytes: &[u8], content: usize) -> usize {
    u64::from_le_bytes(bytes[content - 8..content].try_into().unwrap()) as usize
}

#[test]
fn invalid_messages_are_counted_and_skipped() {
    let mut content = Content::new(u64::MAX);
    content.topics.insert(1, Topic::Frames);
    content.topics.insert(2, Topic::Poses);
    content.topics.insert(3, Topic::Other);
    content.take_message(1, &[0x3a, 3, 1, 2, 3]);
    content.take_message(1, &[0x3a, 200]);
    content.take_message(1, &[0x18, 0x80, 0x80, 0x10]);
    content.take_message(2, &[]);
    content.take_message(3, &[1, 2, 3]);
    content.take_message(40, &[]);
    content.take_plain(op::MESSAGE, &[1, 0]);
    assert_eq!(content.damage.messages_skipped, 6);
    assert!(content.events.is_empty());
    assert!(content.damage.first_reason.unwrap().contains("3 bytes of samples"));
}

#[test]
fn foreign_files_are_rejected_with_a_remedy() {
    let message = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
    assert!(message(b"").contains("is empty"));
    assert!(message(b"\x89HDF\r\n\x1a\nrest").contains("radar-chaperone import"));
    assert!(message(b"timestamp_s tx ty tz").contains("does not begin as an MCAP file"));
    assert!(message(&mcap::MAGIC[..5]).contains("cut right at its start"));
    assert!(message(mcap::MAGIC).contains("no radar-chaperone header (the file ends there)"));
    let mut foreign = Vec::new();
    let mut writer = mcap::Writer::new(std::io::Cursor::new(&mut foreign)).unwrap();
    writer.add_schema("a", "protobuf", &[]).unwrap();
    writer.finish().unwrap();
    drop(writer);
    assert!(message(&foreign).contains("no radar-chaperone header (messages begin without it)"));
    let missing = Recording::open("/no/such/file.mcap").unwrap_err().to_string();
    assert!(missing.contains("cannot open /no/such/file.mcap"), "{missing}");
    assert!(matches!(Recording::open(std::env::temp_dir()), Err(RecordingError::NotAFile(_))));
}

#[test]
fn random_bytes_behind_the_header_never_panic() {
    let bytes = recorded(&[]);
    let start = content_of(&bytes, op::CHUNK, 8) - 9;
    proptest!(|(tail in prop::collection::vec(any::<u8>(), 0..300), opcode in 0u8..16, length in 0u64..300)| {
        let mut file = bytes[..start].to_vec();
        file.push(opcode);
        file.extend(length.to_le_bytes());
        file.extend(tail);
        let (events, _) = read(&file).unwrap();
        prop_assert!(events.is_empty());
    });
}

#[test]
fn what_a_disk_loses_at_once_never_costs_the_header() {
    let written = events(6);
    let short = Header { truth: None, settings: String::new(), ..header() };
    for header in [header(), short] {
        let bytes = recorded_with(&written, &header);
        for length in [2048, 4096, 16_384] {
            let mut harmed = bytes.clone();
            harmed[..length].fill(0);
            let (found, recording) = read(&harmed).unwrap();
            assert_eq!(recording.header(), &header, "{length} bytes");
            let whole = chunks(&bytes).into_iter().filter(|chunk| chunk.0.start >= length);
            let due: usize = whole.map(|chunk| chunk.1.len()).sum();
            assert!(found.len() >= due && due > 0 && !recording.damage().is_none(), "{} of {due}", found.len());
        }
    }
}

#[test]
fn a_recording_that_was_cut_off_has_a_header_behind_its_first_chunks() {
    let written = events(120);
    let bytes = recorded_with(&written, &header());
    let mut harmed = bytes[..bytes.len() * 9 / 10].to_vec();
    harmed[..1 << 16].fill(0);
    let (found, recording) = read(&harmed).unwrap();
    assert_eq!(recording.header(), &header());
    assert!(found.len() > written.len() / 2, "{}", found.len());
}

#[test]
fn a_recording_without_any_header_is_read_with_that_of_another() {
    let written = events(4);
    let mut bytes = recorded(&written);
    let name = HEADER_RECORD.as_bytes();
    for at in 0..bytes.len() - name.len() {
        if bytes[at..].starts_with(name) && bytes[at + name.len()] != b'.' {
            bytes[at] ^= 1;
        }
    }
    let error = read(&bytes).unwrap_err();
    assert!(
        matches!(&error, RecordingError::HeaderLost { .. }) && error.to_string().contains("--header-of"),
        "{error}"
    );
    let file = TestFile::with(&bytes);
    let mut recording = Recording::open_with_header(&file.0, header()).unwrap();
    assert_same(&recording.by_ref().collect::<Vec<_>>(), &written);
    assert_eq!(recording.header(), &header());
    assert!(recording.damage().to_string().contains("another recording's"), "{}", recording.damage());
}

#[test]
fn unreadable_sectors_cost_the_chunks_that_they_are_in() {
    use super::super::disk::tests::bad_sectors;
    let bytes = recorded(&events(30));
    let chunks = chunks(&bytes);
    let sectors = bytes.len() as u64 / 4096;
    let every_fifth: Vec<u64> = (2..sectors).step_by(5).collect();
    let sets = [vec![0], vec![1], vec![sectors], vec![3, 5], vec![4, 5, 6], every_fifth, (8..sectors - 4).collect()];
    for bad in sets {
        for ends_before in [true, false] {
            let medium = Box::new(bad_sectors(&bytes, bad.clone(), ends_before));
            let mut recording = Recording::read("bad.mcap".into(), medium, None).unwrap();
            let found: Vec<Event> = recording.by_ref().collect();
            assert_eq!(recording.header(), &header(), "{bad:?}");
            let is_hit = |range: &Range<usize>| {
                let first = range.start as u64 / 4096;
                bad.iter().any(|sector| (first..=(range.end as u64 - 1) / 4096).contains(sector))
            };
            // Where many sectors in a row are bad, as many behind them are passed over as well.
            let may_be_lost = |range: &Range<usize>| is_hit(range) || bad.len() > sectors as usize / 2;
            check_chunks(&chunks, &found, may_be_lost, &format!("{bad:?}: {}", recording.damage()));
            assert!(recording.damage().unreadable_bytes > 0, "{bad:?}");
        }
    }
}

#[test]
fn what_a_file_claims_of_itself_is_bounded() {
    // Settings, a frame.
    let long = Header { settings: "#".repeat(2 << 20), ..header() };
    assert!(long.check_readable().unwrap_err().to_string().contains("settings"), "too long to be read");
    let mut frame =
        events(1).into_iter().find_map(|event| if let Event::Frame(frame) = event { Some(frame) } else { None });
    frame.as_mut().unwrap().samples.resize(1 << 16, Complex::default());
    let (found, recording) = read(&recorded(&[Event::Frame(frame.unwrap())])).unwrap();
    assert!(found.is_empty() && recording.damage().to_string().contains("65536 points"), "{}", recording.damage());
    // Times that leap to and fro.
    let mut leaping = events(10);
    for (n, event) in leaping.iter_mut().enumerate() {
        match event {
            Event::Frame(frame) => frame.host_time_ns = (n % 2) as i64 * 5_000_000_000,
            Event::Pose(pose) => pose.time_ns = (n % 2) as i64 * 5_000_000_000,
            Event::Hands(_) => {}
        }
    }
    let (usual, leaping) = (recorded(&events(10)), recorded(&leaping));
    assert!(leaping.len() < 2 * usual.len(), "{} and {} bytes", leaping.len(), usual.len());
}

#[test]
fn numbers_of_a_damaged_index_are_not_believed() {
    let written = events(4);
    let bytes = recorded(&written);
    let last = chunks(&bytes).last().unwrap().0.end;
    let statistics = content_of(&bytes, op::STATISTICS, last);
    let stated = |bytes: &[u8]| read(bytes).unwrap().1.stated_frames();
    assert_eq!(stated(&bytes), Some(80));
    for at in statistics + 46..statistics + 76 {
        let mut flipped = bytes.clone();
        flipped[at] ^= 16;
        assert_eq!(stated(&flipped), None, "byte {at}");
    }
}
