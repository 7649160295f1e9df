//! Reads a recording from start to end, one chunk at a time, and reports what could not be read.
//!
//! A damaged chunk is skipped. If the framing of the file itself is broken, reading ends. Nothing
//! in the file is trusted: records beyond [`MAX_RECORD_BYTES`] are rejected before memory is
//! allocated for them.

use radar_mapping::Event;
use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use super::chunk::{MAX_RECORD_BYTES, unpack};
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::message::{
    FRAME_CHANNEL, FRAME_TOPIC, HAND_CHANNELS, HANDS_CHANNEL, HANDS_TOPIC, HEAD_CHANNEL, MESSAGE_ENCODING,
    MOUNT_CHANNEL, POSE_CHANNEL, POSE_TOPIC, decode_frame, decode_hands, decode_pose,
};
use super::record::{Fields, channel, message, metadata, op};
use super::{Damage, RecordingError};

/// An open recording: its header, and an iterator over its frames, poses and hands in the order of
/// the file.
///
/// After the last event, [`damage`](Self::damage) reports what could not be read.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    header: Header,
    source: RecordSource,
    /// The record after the header.
    pending: Option<FetchedRecord>,
    content: Content,
    /// Whether the data section has ended; only the index follows.
    data_ended: bool,
    ended: bool,
}

/// Content of the chunks read so far.
#[derive(Debug)]
struct Content {
    topics: HashMap<u16, Topic>,
    events: VecDeque<Event>,
    damage: Damage,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Frames,
    Poses,
    Hands,
    Other,
}

/// The file as a sequence of top-level records.
#[derive(Debug)]
struct RecordSource {
    input: BufReader<File>,
    offset: u64,
    /// Offset of the last record, bytes.
    record_start: u64,
}

#[derive(Debug)]
enum FetchedRecord {
    Record(u8, Vec<u8>),
    /// The file ends inside a record with this claimed length.
    Cut(u8, Vec<u8>, u64),
    /// The file ends between records.
    End,
    Broken(String),
}

impl Recording {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// Not a file, not a recording, or an invalid header; each message states what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref().to_owned();
        let io_error = |doing| {
            let path = path.clone();
            move |source| RecordingError::Io { doing, path, source }
        };
        if !std::fs::metadata(&path).map_err(io_error("open"))?.is_file() {
            return Err(RecordingError::NotAFile(path));
        }
        let mut input = BufReader::new(File::open(&path).map_err(io_error("open"))?);
        check_magic(&path, &read_up_to(&mut input, 8).map_err(io_error("read"))?)?;
        let mut source = RecordSource { input, offset: 8, record_start: 8 };
        let mut content = Content::new();
        let (header, behind) = read_header(&path, &mut source, &mut content.damage)?;
        Ok(Self { path, header, source, pending: Some(behind), content, data_ended: false, ended: false })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// What could not be read so far; complete after the last event.
    pub fn damage(&self) -> &Damage {
        &self.content.damage
    }

    fn read_next_record(&mut self) {
        let fetched = self.pending.take().unwrap_or_else(|| self.source.fetch());
        let at = self.source.record_start;
        match fetched {
            FetchedRecord::Record(op::FOOTER, _) => self.ended = true,
            FetchedRecord::Record(op::DATA_END, _) => self.data_ended = true,
            FetchedRecord::Record(..) if self.data_ended => {}
            FetchedRecord::Record(opcode, record) => self.content.take(opcode, &record, record.len() as u64),
            FetchedRecord::Cut(opcode, record, claimed_bytes) => {
                if !self.data_ended {
                    self.content.take(opcode, &record, claimed_bytes);
                }
                self.end_early(format!("the file ends in the middle of a record at byte {at}"));
            }
            FetchedRecord::End => self.end_early(format!("the file ends at byte {at} without its closing index")),
            FetchedRecord::Broken(reason) => self.end_early(format!("reading stopped at byte {at}: {reason}")),
        }
    }

    fn end_early(&mut self, reason: String) {
        let lost = if self.data_ended { "; all frames and poses came before it" } else { "" };
        self.content.damage.ended_early = Some(reason + lost);
        self.ended = true;
    }
}

impl Iterator for Recording {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        while self.content.events.is_empty() && !self.ended {
            self.read_next_record();
        }
        self.content.events.pop_front()
    }
}

impl Content {
    /// The topics with the writer's channel ids, in case the chunk that declares them is damaged.
    /// Declarations in the file take precedence.
    fn new() -> Self {
        let topics = [(FRAME_CHANNEL, Topic::Frames), (POSE_CHANNEL, Topic::Poses), (HANDS_CHANNEL, Topic::Hands)];
        let [left, right] = HAND_CHANNELS;
        let others = [HEAD_CHANNEL, MOUNT_CHANNEL, left, right].map(|id| (id, Topic::Other));
        Self { topics: topics.into_iter().chain(others).collect(), events: VecDeque::new(), damage: Damage::default() }
    }

    /// Takes a top-level record; with fewer bytes than claimed it is truncated.
    fn take(&mut self, opcode: u8, record: &[u8], claimed_bytes: u64) {
        if opcode == op::CHUNK {
            let unpacked = unpack(record, claimed_bytes, |opcode, record| self.take_plain(opcode, record));
            if let Err(reason) = unpacked {
                self.damage.chunk(format!("a chunk cannot be read: {reason}"));
            }
        } else if record.len() as u64 == claimed_bytes {
            self.take_plain(opcode, record);
        }
    }

    /// Takes a record that is not a chunk.
    fn take_plain(&mut self, opcode: u8, record: &[u8]) {
        match opcode {
            op::CHANNEL => match channel(record) {
                Some((id, topic, encoding)) => {
                    self.topics.insert(id, Topic::of(topic, encoding));
                }
                None => self.damage.message("a topic's record is unreadable"),
            },
            op::MESSAGE => match message(record) {
                Some((id, bytes)) => self.take_message(id, bytes),
                None => self.damage.message("a message's record is too short"),
            },
            _ => {}
        }
    }

    fn take_message(&mut self, id: u16, bytes: &[u8]) {
        let event = match self.topics.get(&id) {
            Some(Topic::Frames) => decode_frame(bytes).map(Event::Frame),
            Some(Topic::Poses) => decode_pose(bytes).map(Event::Pose),
            Some(Topic::Hands) => decode_hands(bytes).map(Event::Hands),
            Some(Topic::Other) => return,
            None => Err(format!("a message names topic {id}, which the file does not declare")),
        };
        match event {
            Ok(event) => self.events.push_back(event),
            Err(reason) => self.damage.message(reason),
        }
    }
}

impl Topic {
    fn of(topic: &str, encoding: &str) -> Self {
        match (topic, encoding) {
            (FRAME_TOPIC, MESSAGE_ENCODING) => Self::Frames,
            (POSE_TOPIC, MESSAGE_ENCODING) => Self::Poses,
            (HANDS_TOPIC, MESSAGE_ENCODING) => Self::Hands,
            _ => Self::Other,
        }
    }
}

impl RecordSource {
    fn fetch(&mut self) -> FetchedRecord {
        self.try_fetch().unwrap_or_else(|error| FetchedRecord::Broken(format!("the system cannot read on: {error}")))
    }

    fn try_fetch(&mut self) -> io::Result<FetchedRecord> {
        self.record_start = self.offset;
        let head = read_up_to(&mut self.input, 9)?;
        self.offset += head.len() as u64;
        let mut fields = Fields(&head);
        let (opcode, length) = match (fields.array(), fields.u64()) {
            (Some([opcode]), Some(length)) => (opcode, length),
            (None, _) => return Ok(FetchedRecord::End),
            (Some([opcode]), None) => return Ok(FetchedRecord::Cut(opcode, Vec::new(), 1)),
        };
        if opcode == op::INVALID {
            return Ok(FetchedRecord::Broken("there are zeros where a record should begin".into()));
        }
        if length > MAX_RECORD_BYTES as u64 {
            let reason = format!("a record claims {length} bytes, more than the {MAX_RECORD_BYTES} allowed");
            return Ok(FetchedRecord::Broken(reason));
        }
        let record = read_up_to(&mut self.input, length)?;
        self.offset += record.len() as u64;
        Ok(match record.len() as u64 == length {
            true => FetchedRecord::Record(opcode, record),
            false => FetchedRecord::Cut(opcode, record, length),
        })
    }
}

/// Reads up to this many bytes. Memory grows with what is there, not with what is requested.
fn read_up_to(input: &mut impl Read, bytes: u64) -> io::Result<Vec<u8>> {
    let mut read = Vec::new();
    input.take(bytes).read_to_end(&mut read)?;
    Ok(read)
}

fn check_magic(path: &Path, start: &[u8]) -> Result<(), RecordingError> {
    let hint = match start {
        [] => return Err(RecordingError::Empty(path.to_owned())),
        start if start == mcap::MAGIC => return Ok(()),
        [0x89, b'H', b'D', b'F', ..] => "it is an HDF5 file: import it with `radar-chaperone import`",
        start if mcap::MAGIC.starts_with(start) => "it was cut right at its start: record again",
        _ => "give a file that radar-chaperone has written",
    };
    Err(RecordingError::NotMcap { path: path.to_owned(), hint })
}

/// Reads the header; also returns the record after it.
fn read_header(
    path: &Path,
    source: &mut RecordSource,
    damage: &mut Damage,
) -> Result<(Header, FetchedRecord), RecordingError> {
    let no_header = |found: &str| RecordingError::NoHeader { path: path.to_owned(), found: found.to_owned() };
    let mut header: Option<Header> = None;
    loop {
        let fetched = source.fetch();
        match (&fetched, &mut header) {
            (FetchedRecord::Record(op::HEADER, _), _) => {}
            (FetchedRecord::Record(op::METADATA, record), header) => match (metadata(record), header) {
                (Some((HEADER_RECORD, fields)), none @ None) => *none = Some(Header::from_fields(&fields)?),
                (Some((TRUTH_RECORD, fields)), Some(header)) => match Header::truth_from_fields(&fields) {
                    Ok(truth) => header.truth = Some(truth),
                    Err(error) => damage.message(error.to_string()),
                },
                _ => {}
            },
            (_, Some(_)) => break header.map(|header| (header, fetched)).ok_or_else(|| no_header("nothing")),
            (FetchedRecord::Record(..), None) => return Err(no_header("messages begin without it")),
            (FetchedRecord::Broken(reason), None) => return Err(no_header(reason)),
            (FetchedRecord::Cut(..) | FetchedRecord::End, None) => return Err(no_header("the file ends there")),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use glam::DVec3;
    use num_complex::Complex;
    use proptest::prelude::*;

    use super::super::test_files::{TestFile, assert_same, events, header, recorded};
    use super::*;
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
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0xff;
        let (events, recording) = read(&bytes).unwrap();
        assert_eq!(recording.damage().chunks_damaged, 1);
        assert!(recording.damage().ended_early.is_none());
        assert!(events.len() < written.len() && events.len() + 62 > written.len());
        assert_same(&events[events.len() - 1..], &written[written.len() - 1..]);
    }

    #[test]
    fn topics_are_known_with_a_damaged_declaration() {
        let written = events(2);
        let mut bytes = recorded(&written);
        let topics = content_of(&bytes, op::CHUNK, 8);
        bytes[topics + 100] ^= 0xff;
        let (events, recording) = read(&bytes).unwrap();
        assert_same(&events, &written);
        assert_eq!((recording.damage().chunks_damaged, recording.damage().messages_skipped), (1, 0));
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
        let (events, recording) = read(&long).unwrap();
        assert!(events.is_empty());
        assert!(recording.damage().ended_early.as_ref().unwrap().contains("claims 100000000000 bytes"));
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
        let mut content = Content::new();
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
        let mut writer = mcap::Writer::new(io::Cursor::new(&mut foreign)).unwrap();
        writer.add_schema("a", "protobuf", &[]).unwrap();
        writer.finish().unwrap();
        drop(writer);
        assert!(message(&foreign).contains("no radar-chaperone header (messages begin without it)"));
        let missing = Recording::open("/no/such/file.mcap").unwrap_err().to_string();
        assert!(missing.contains("cannot open /no/such/file.mcap"), "{missing}");
        assert!(matches!(Recording::open(std::env::temp_dir()), Err(RecordingError::NotAFile(_))));
    }

    #[test]
    fn invalid_configuration_is_rejected_with_its_rule() {
        let bytes = recorded(&[]);
        let from = br#""hwaas":16"#;
        let at = bytes.windows(from.len()).position(|w| w == from).unwrap();
        let mut broken = bytes;
        broken[at..at + from.len()].copy_from_slice(br#""hwaas": 0"#);
        let error = read(&broken).unwrap_err().to_string();
        assert!(error.contains("subsweeps[0].hwaas is 0"), "{error}");
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
}
