//! Reads a recording from start to end, one chunk at a time, and reports what could not be read.
//!
//! A damaged chunk is skipped. Where no record can be read, or one has a wrong length, reading goes on at the next place whose
//! bytes are those of a whole chunk. Nothing in the file is trusted: records beyond [`MAX_RECORD_BYTES`] are rejected before
//! memory is allocated for them.

use radar_mapping::Event;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::chunk::{MAX_RECORD_BYTES, unpack};
use super::damaged_places::{
    CHUNK_START_BYTES, ChunkSearch, find_metadata, has_wrong_length, holds_chunk, read_at, read_up_to,
};
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::message::{
    FRAME_CHANNEL, FRAME_TOPIC, HAND_CHANNELS, HANDS_CHANNEL, HANDS_TOPIC, HEAD_CHANNEL, MESSAGE_ENCODING,
    MOUNT_CHANNEL, POSE_CHANNEL, POSE_TOPIC, decode_frame, decode_hands, decode_pose,
};
use super::record::{Fields, channel, message, message_counts, metadata, op};
use super::{Damage, RecordingError};
use radar_sar::truth::Truth;

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
    /// Numbers of messages as the file's statistics state them, by channel.
    stated: Option<BTreeMap<u16, u64>>,
}

/// How many times the file's bytes may be read again in search of whole chunks. Choice: a damaged file needs less than one;
/// bounds the time that a hostile one takes.
const REREADS: u64 = 4;
/// Content of the records that end the data, and the file, bytes.
const DATA_END_BYTES: usize = 4;
const FOOTER_BYTES: usize = 20;

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
    /// End of the last whole chunk.
    sound_until: u64,
    /// Over all bytes so far; `None` once some were passed over.
    checksum: Option<crc32fast::Hasher>,
    file_bytes: u64,
    search: ChunkSearch,
    /// Bytes that may still be read in search of whole chunks.
    reread_bytes: u64,
    /// From here on there is no whole chunk.
    barren_from: u64,
}

#[derive(Debug)]
enum FetchedRecord {
    Record(u8, Vec<u8>),
    /// The file ends inside a record.
    Cut,
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
        let start = read_up_to(&mut input, 8).map_err(io_error("read"))?;
        let mut content = Content::new();
        let mut source = RecordSource::new(input, &start, &path).map_err(io_error("read"))?;
        let opened = check_magic(&path, &start).and_then(|()| read_header(&path, &mut source, &mut content.damage));
        let (header, pending) = match opened {
            Ok((header, behind)) => {
                let is_chunk = matches!(behind, FetchedRecord::Record(op::CHUNK, _));
                let may_have_truth = header.truth.is_none() && !(is_chunk && content.damage.is_none());
                let found = if may_have_truth { source.find_truth().map_err(io_error("read"))? } else { None };
                source.go_to_unchanged();
                (Header { truth: header.truth.or(found), ..header }, behind)
            }
            Err(error) => {
                let copied = source.find_header().map_err(io_error("read"))?.ok_or(error)?;
                content.damage = Damage::default();
                source.record_start = 8;
                (copied, FetchedRecord::Broken("the header is damaged, and its copy was used".into()))
            }
        };
        let (data_ended, ended) = (false, false);
        Ok(Self { path, header, source, pending: Some(pending), content, data_ended, ended, stated: None })
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

    /// Number of frames as the file's statistics state it; known after the last event.
    pub fn stated_frames(&self) -> Option<u64> {
        Some(self.stated.as_ref()?.get(&FRAME_CHANNEL).copied().unwrap_or(0))
    }

    fn read_next_record(&mut self) {
        let fetched = self.pending.take().unwrap_or_else(|| self.source.fetch());
        if self.data_ended {
            return self.take_behind_data(fetched);
        }
        let at = self.source.record_start;
        match fetched {
            FetchedRecord::Record(op::CHUNK, record) => match self.content.take_chunk(&record) {
                Ok(()) => self.source.sound_until = self.source.offset,
                Err(reason) => self.pass_over_chunk(at, &record, &reason),
            },
            FetchedRecord::Record(op::DATA_END, record) if record.len() == DATA_END_BYTES => {
                self.data_ended = true;
                self.content.damage.checksum_differs |= self.source.checksum_differs(&record);
            }
            FetchedRecord::Record(op::FOOTER, record) if record.len() == FOOTER_BYTES => {
                self.end_early(format!("the end of the data is not marked before byte {at}"));
            }
            // Messages are in chunks alone.
            FetchedRecord::Record(opcode, record)
                if (op::HEADER..=op::DATA_END).contains(&opcode) && !holds_chunk(&record) => {}
            FetchedRecord::Record(opcode, _) => {
                self.go_on_or_end(at, &format!("a record of kind {opcode} is out of place"))
            }
            FetchedRecord::Cut => {
                if self.go_on_behind(at, None, "a record's length is wrong").is_none() {
                    self.end_early(format!("the file ends in the middle of a record at byte {at}"));
                }
            }
            FetchedRecord::End => self.end_early(format!("the file ends at byte {at} without its closing index")),
            FetchedRecord::Broken(reason) => self.go_on_or_end(at, &reason),
        }
    }

    /// Only the index follows the data.
    fn take_behind_data(&mut self, fetched: FetchedRecord) {
        let at = self.source.record_start;
        match fetched {
            FetchedRecord::Record(op::FOOTER, _) => self.ended = true,
            FetchedRecord::Record(op::STATISTICS, record) => self.stated = message_counts(&record),
            FetchedRecord::Record(..) => {}
            FetchedRecord::Cut => self.end_early(format!("the file ends in the middle of a record at byte {at}")),
            FetchedRecord::End => self.end_early(format!("the file ends at byte {at} without its closing index")),
            FetchedRecord::Broken(reason) => self.end_early(format!("reading stopped at byte {at}: {reason}")),
        }
    }

    /// Of a chunk that cannot be read the length may be wrong: it may be whole with another, or hold other chunks.
    fn pass_over_chunk(&mut self, at: u64, record: &[u8], reason: &str) {
        let found = match has_wrong_length(record) {
            true => self.go_on_behind(at, Some(record.len() as u64), "a chunk's length is wrong"),
            false => None,
        };
        if found != Some(at) {
            self.content.damage.chunk(format!("a chunk cannot be read: {reason}"));
        }
    }

    fn go_on_or_end(&mut self, at: u64, reason: &str) {
        if self.go_on_behind(at, None, reason).is_none() {
            self.end_early(format!("reading stopped at byte {at}: {reason}"));
        }
    }

    /// Goes on at the first whole chunk from `from` on, and gives where that begins. `failed`: length with which the chunk there
    /// was tried. `None`: there is none, and reading goes on where it was.
    fn go_on_behind(&mut self, from: u64, failed: Option<u64>, reason: &str) -> Option<u64> {
        let behind = self.source.offset;
        let Ok(Some((start, end))) = self.source.whole_chunk(from, failed, &mut self.content) else {
            self.source.go_to(behind);
            return None;
        };
        let passed_from = if failed.is_some_and(|length| from + 9 + length <= start) { behind } else { from };
        self.content.damage.skip(start.saturating_sub(passed_from), format!("at byte {from}, {reason}"));
        self.source.sound_until = end;
        self.source.go_to(end);
        Some(start)
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

    fn take_chunk(&mut self, record: &[u8]) -> Result<(), String> {
        unpack(record, |opcode, record| self.take_plain(opcode, record))
    }

    /// What was taken so far, to go back to.
    fn state(&self) -> (usize, Damage) {
        (self.events.len(), self.damage.clone())
    }

    fn go_back(&mut self, (events, damage): (usize, Damage)) {
        self.events.truncate(events);
        self.damage = damage;
    }

    /// Takes a record of a chunk.
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
    /// Behind the first bytes of the file.
    fn new(input: BufReader<File>, start: &[u8], path: &Path) -> io::Result<Self> {
        let mut checksum = crc32fast::Hasher::new();
        checksum.update(start);
        let file_bytes = std::fs::metadata(path)?.len();
        Ok(Self {
            input,
            offset: 8,
            record_start: 8,
            sound_until: 8,
            checksum: Some(checksum),
            file_bytes,
            search: ChunkSearch::default(),
            reread_bytes: file_bytes.saturating_mul(REREADS),
            barren_from: u64::MAX,
        })
    }

    /// Reads on where it was, after a search.
    fn go_to_unchanged(&mut self) {
        // A place that cannot be reached gives an error when it is read.
        let _ = self.input.seek(SeekFrom::Start(self.offset));
    }

    /// Reads on from there.
    fn go_to(&mut self, offset: u64) {
        (self.offset, self.checksum) = (offset, None);
        self.go_to_unchanged();
    }

    /// Whether the file's bytes so far differ from the checksum in a record that ends the data; 0: there is none.
    fn checksum_differs(&self, data_end: &[u8]) -> bool {
        let stated = Fields(data_end).u32().filter(|stated| *stated != 0);
        let found = self.checksum.clone().map(crc32fast::Hasher::finalize);
        stated.zip(found).is_some_and(|(stated, found)| stated != found)
    }

    /// A header, with its truth, wherever it is whole.
    fn find_header(&mut self) -> io::Result<Option<Header>> {
        let fields = |record: &[u8]| metadata(record).map(|(_, fields)| fields);
        let header = |record: &[u8]| Header::from_fields(&fields(record)?).ok();
        let Some(header) = find_metadata(&mut self.input, HEADER_RECORD, header)? else { return Ok(None) };
        Ok(Some(Header { truth: self.find_truth()?, ..header }))
    }

    fn find_truth(&mut self) -> io::Result<Option<Truth>> {
        let fields = |record: &[u8]| metadata(record).map(|(_, fields)| fields);
        let truth = |record: &[u8]| Header::truth_from_fields(&fields(record)?).ok();
        find_metadata(&mut self.input, TRUTH_RECORD, truth)
    }

    /// Takes the first whole chunk from `from` on; its beginning and end. Chunks that are not whole are counted.
    fn whole_chunk(&mut self, from: u64, failed: Option<u64>, content: &mut Content) -> io::Result<Option<(u64, u64)>> {
        let search_from = from.saturating_sub(CHUNK_START_BYTES).max(self.sound_until);
        let mut next = search_from;
        while next < self.barren_from
            && let Some(place) = self.search.next(&mut self.input, next)?
        {
            for length in place.lengths.into_iter().flatten() {
                let (begin, is_failed) = (place.start + 9, place.start == from && failed == Some(length));
                if is_failed || length > self.reread_bytes || begin + length > self.file_bytes {
                    continue;
                }
                self.reread_bytes -= length;
                let record = read_at(&mut self.input, begin, length)?;
                let before = content.state();
                if content.take_chunk(&record).is_ok() {
                    return Ok(Some((place.start, begin + length)));
                }
                content.go_back(before);
            }
            if place.start != from {
                content.damage.chunk(format!("the chunk at byte {} cannot be read", place.start));
            }
            next = place.start + 1;
        }
        self.barren_from = self.barren_from.min(search_from);
        Ok(None)
    }

    fn fetch(&mut self) -> FetchedRecord {
        self.try_fetch().unwrap_or_else(|error| FetchedRecord::Broken(format!("the system cannot read on: {error}")))
    }

    fn try_fetch(&mut self) -> io::Result<FetchedRecord> {
        self.record_start = self.offset;
        let head = read_up_to(&mut self.input, 9)?;
        self.offset += head.len() as u64;
        // The checksum is over what comes before the end of the data.
        let is_counted = head.first() != Some(&op::DATA_END);
        self.count(&head, is_counted);
        let mut fields = Fields(&head);
        let (opcode, length) = match (fields.array(), fields.u64()) {
            (Some([opcode]), Some(length)) => (opcode, length),
            (None, _) => return Ok(FetchedRecord::End),
            (Some(_), None) => return Ok(FetchedRecord::Cut),
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
        self.count(&record, is_counted);
        Ok(match record.len() as u64 == length {
            true => FetchedRecord::Record(opcode, record),
            false => FetchedRecord::Cut,
        })
    }

    fn count(&mut self, bytes: &[u8], is_counted: bool) {
        if let Some(checksum) = self.checksum.as_mut().filter(|_| is_counted) {
            checksum.update(bytes);
        }
    }
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
                (_, Some(_)) => damage.message("a record behind the header is not what belongs there"),
                _ => {}
            },
            (_, Some(_)) => break header.map(|header| (header, fetched)).ok_or_else(|| no_header("nothing")),
            (FetchedRecord::Record(..), None) => return Err(no_header("messages begin without it")),
            (FetchedRecord::Broken(reason), None) => return Err(no_header(reason)),
            (FetchedRecord::Cut | FetchedRecord::End, None) => return Err(no_header("the file ends there")),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::ops::Range;

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
            let mut content = Content::new();
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
        let large = [&[op::CHUNK][..], &(1u64 << 20).to_le_bytes(), &[7; 28], b"\x04\0\0\0zstd", &[0; 8]].concat();
        let metadata = [&(1u64 << 22).to_le_bytes()[..], b"\x0f\0\0\0radar_chaperone"].concat();
        for (start, repeated) in [
            (header_end, empty_chunk),
            (header_end, head),
            (header_end, large),
            (8, metadata),
            (8, b"\x04\0\0\0zstd".to_vec()),
        ] {
            // A search for each of them would take hours.
            let mut bytes = sound[..start].to_vec();
            bytes.extend(repeated.iter().cycle().take(4 << 20));
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
                let is_index = at >= chunks[chunks.len() - 1].0.end;
                assert!(is_index || !recording.damage().is_none(), "{place}: unnoticed");
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
