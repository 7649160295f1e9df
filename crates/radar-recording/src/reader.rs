//! Reads a recording from start to end, one chunk at a time, and reports what could not be read.
//!
//! A damaged chunk is skipped. Where no record can be read, or one has a wrong length, reading goes on at the next place whose
//! bytes are those of a whole chunk. Nothing in the file is trusted: records beyond 32 MiB are rejected before
//! memory is allocated for them.

use radar_mapping::Event;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::chunk::unpack;
use super::damaged_places::{MAX_HEADER_BYTES, has_wrong_length, holds_chunk, is_chunk_index};
use super::disk::{Disk, Medium};
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::message::{
    FRAME_CHANNEL, FRAME_TOPIC, HAND_CHANNELS, HANDS_CHANNEL, HANDS_TOPIC, HEAD_CHANNEL, MESSAGE_ENCODING,
    MOUNT_CHANNEL, POSE_CHANNEL, POSE_TOPIC, decode_frame, decode_hands, decode_pose,
};
use super::record::{Fields, channel, message, message_counts, metadata, op};
use super::record_source::{CHECKSUM_BYTES, FOOTER_BYTES, FetchedRecord, FileEnd, RecordSource};
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
    /// Numbers of messages as the file's statistics state them, by channel.
    stated: Option<BTreeMap<u16, u64>>,
}

/// Why reading goes on where the data seemed to have ended.
const GOES_ON: &str = "the data goes on behind what looks like its end";

/// All chunks of a file may unpack to this many bytes, and to so many more for each byte of the file. Choice: a day of silence from a
/// sensor that sends 185 kB/s (preset c16), which packs to almost nothing, and far more than noise packs. A file of 100 MB made of
/// chunks of zeros could unpack to 2 TB otherwise, which takes minutes.
const MAX_UNPACKED_BYTES: u64 = 16 << 30;
const MAX_UNPACKED_PER_BYTE: u64 = 100;

/// Content of the chunks read so far.
#[derive(Debug)]
pub(super) struct Content {
    /// To how many bytes the chunks to come may unpack.
    unpacked_left: u64,
    topics: HashMap<u16, Topic>,
    events: VecDeque<Event>,
    pub damage: Damage,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Frames,
    Poses,
    Hands,
    Other,
}

impl Recording {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// Not a file, not a recording, or an invalid header; each message states what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let (path, file) = Self::file(path.as_ref())?;
        Self::read(path, Box::new(file), None)
    }

    /// Opens a file whose header and its copies are lost, with the header of another recording.
    ///
    /// # Errors
    /// Not a file, or the system cannot read it.
    pub fn open_with_header(path: impl AsRef<Path>, header: Header) -> Result<Self, RecordingError> {
        let (path, file) = Self::file(path.as_ref())?;
        Self::read(path, Box::new(file), Some(header))
    }

    fn file(path: &Path) -> Result<(PathBuf, File), RecordingError> {
        let path = path.to_owned();
        let io_error = |source| RecordingError::Io { doing: "open", path: path.clone(), source };
        // A pipe would block until somebody writes to it.
        if !std::fs::metadata(&path).map_err(io_error)?.is_file() {
            return Err(RecordingError::NotAFile(path));
        }
        let file = File::open(&path).map_err(io_error)?;
        Ok((path, file))
    }

    fn read(path: PathBuf, medium: Box<dyn Medium>, of_another: Option<Header>) -> Result<Self, RecordingError> {
        let io_error = |source| RecordingError::Io { doing: "read", path: path.clone(), source };
        let disk = Disk::new(medium).map_err(io_error)?;
        let per_byte = disk.file_bytes().saturating_mul(MAX_UNPACKED_PER_BYTE);
        let mut content = Content::new(per_byte.saturating_add(MAX_UNPACKED_BYTES));
        let (mut source, start) = RecordSource::new(disk).map_err(io_error)?;
        let opened = check_magic(&path, &start).and_then(|()| read_header(&path, &mut source, &mut content.damage));
        let (header, pending) = match opened {
            Ok((header, behind)) => {
                let is_chunk = matches!(behind, FetchedRecord::Record(op::CHUNK, _));
                let may_have_truth = header.truth.is_none() && !(is_chunk && content.damage.is_none());
                let found = if may_have_truth { source.find_truth().map_err(io_error)? } else { None };
                source.go_to_unchanged();
                (Header { truth: header.truth.or(found), ..header }, behind)
            }
            Err(error) => {
                let copied = source.find_header().map_err(io_error)?;
                let reason = match (&copied, &of_another) {
                    (Some(_), _) => "the header is damaged, and its copy was used",
                    (None, _) => "the header is lost, and another recording's was used",
                };
                let header = match copied.or(of_another) {
                    Some(header) => header,
                    None => return Err(without_header(&path, &mut source, &mut content, error)),
                };
                content.damage = Damage::default();
                source.record_start = 8;
                (header, FetchedRecord::Broken(reason.into()))
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

    /// Number of frames as the file's statistics state it; known after the last event. `None` where these are damaged as well.
    pub fn stated_frames(&self) -> Option<u64> {
        let is_sound = !self.content.damage.index_damaged && self.content.damage.ended_early.is_none();
        let stated = self.stated.as_ref().filter(|_| is_sound)?;
        Some(stated.get(&FRAME_CHANNEL).copied().unwrap_or(0))
    }

    fn read_next_record(&mut self) {
        self.take_next_record();
        self.content.damage.unreadable_bytes = self.source.disk().refused_bytes();
        if let Some(reason) = self.source.disk().first_refusal() {
            self.content.damage.first_reason.get_or_insert_with(|| reason.to_owned());
        }
    }

    fn take_next_record(&mut self) {
        let fetched = self.pending.take().unwrap_or_else(|| self.source.fetch());
        let at = self.source.record_start;
        if self.data_ended {
            if !matches!(fetched, FetchedRecord::Record(op::CHUNK, _)) {
                return self.take_behind_data(fetched);
            }
            self.data_ended = false;
            self.content.damage.skip(0, format!("at byte {at}, {GOES_ON}"));
        }
        if let FetchedRecord::Record(op::METADATA, record) = &fetched
            && self.is_header_of_another(record)
        {
            return self.end_before_another(at);
        }
        match fetched {
            FetchedRecord::Record(op::CHUNK, record) => match self.content.take_chunk(&record) {
                Ok(()) => self.source.sound_until = self.source.offset,
                Err(reason) => self.pass_over_chunk(at, &record, &reason),
            },
            FetchedRecord::Record(op::DATA_END, record) if record.len() == CHECKSUM_BYTES => {
                self.data_ended = true;
                self.content.damage.checksum_differs |= self.source.checksum_differs(Fields(&record).u32());
            }
            FetchedRecord::Record(op::FOOTER, record) if record.len() == FOOTER_BYTES => {
                if self.go_on_behind(at, None, "there is what looks like the end").is_none() {
                    self.end_early(format!("the end of the data is not marked before byte {at}"));
                }
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

    /// Only the index follows the data; where a chunk does, the data had not ended.
    fn take_behind_data(&mut self, fetched: FetchedRecord) {
        let at = self.source.record_start;
        let mut is_end = false;
        let reason = match fetched {
            FetchedRecord::Record(op::FOOTER, record) if record.len() == FOOTER_BYTES => {
                let stated = Fields(&record[FOOTER_BYTES - CHECKSUM_BYTES..]).u32();
                self.content.damage.index_damaged |= self.source.checksum_differs(stated);
                match self.source.file_end() {
                    FileEnd::Proper => {
                        self.ended = true;
                        return;
                    }
                    FileEnd::Another(at) => return self.end_before_another(at),
                    FileEnd::Wrong => {}
                }
                is_end = true;
                GOES_ON.to_owned()
            }
            FetchedRecord::Record(op::STATISTICS, record) if !holds_chunk(&record) => {
                self.stated = message_counts(&record);
                return;
            }
            FetchedRecord::Record(opcode, record)
                if !holds_chunk(&record) || opcode == op::CHUNK_INDEX && is_chunk_index(&record) =>
            {
                self.content.damage.index_damaged |= opcode == op::DATA_END;
                return;
            }
            FetchedRecord::Record(..) => GOES_ON.to_owned(),
            FetchedRecord::Cut => format!("the file ends in the middle of a record at byte {at}"),
            FetchedRecord::End => format!("the file ends at byte {at} without its closing index"),
            FetchedRecord::Broken(reason) => format!("reading stopped at byte {at}: {reason}"),
        };
        match self.go_on_behind(at, None, &reason) {
            Some(_) => self.data_ended = false,
            None if is_end => (self.content.damage.index_damaged, self.ended) = (true, true),
            None => self.end_early(reason),
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

    /// Whether a record is the header of a recording with another one than this.
    fn is_header_of_another(&self, record: &[u8]) -> bool {
        if record.len() as u64 > MAX_HEADER_BYTES {
            return false;
        }
        let Some((HEADER_RECORD, fields)) = metadata(record) else { return false };
        let own = Header { truth: None, ..self.header.clone() };
        Header::from_fields(&fields).is_ok_and(|found| Header { truth: None, ..found } != own)
    }

    /// The frames that follow may be of another sensor and mount than this header's.
    fn end_before_another(&mut self, at: u64) {
        let reason = format!("at byte {at} is another recording, which was not read: split the file there");
        self.content.damage.ended_early = Some(reason);
        self.ended = true;
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
    /// Declarations in the file take precedence. All chunks together may unpack to `unpacked_bytes`.
    pub fn new(unpacked_bytes: u64) -> Self {
        let topics = [(FRAME_CHANNEL, Topic::Frames), (POSE_CHANNEL, Topic::Poses), (HANDS_CHANNEL, Topic::Hands)];
        let [left, right] = HAND_CHANNELS;
        let others = [HEAD_CHANNEL, MOUNT_CHANNEL, left, right].map(|id| (id, Topic::Other));
        let topics = topics.into_iter().chain(others).collect();
        Self { unpacked_left: unpacked_bytes, topics, events: VecDeque::new(), damage: Damage::default() }
    }

    /// Takes the events of a chunk record.
    ///
    /// # Errors
    /// Why it, or the rest of it, was skipped.
    pub fn take_chunk(&mut self, record: &[u8]) -> Result<(), String> {
        // Apart from the rest, which takes the events.
        let mut left = self.unpacked_left;
        let result = unpack(record, &mut left, |opcode, record| self.take_plain(opcode, record));
        self.unpacked_left = left;
        result
    }

    /// What was taken so far, to go back to.
    pub fn state(&self) -> (usize, Damage) {
        (self.events.len(), self.damage.clone())
    }

    pub fn go_back(&mut self, (events, damage): (usize, Damage)) {
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

/// The error of a file without header, by what else is in it.
fn without_header(
    path: &Path,
    source: &mut RecordSource,
    content: &mut Content,
    error: RecordingError,
) -> RecordingError {
    use RecordingError::{HeaderField, HeaderLost, Io, NoHeader, NotMcap};
    let path = path.to_owned();
    let reason = match &error {
        NotMcap { .. } => "its beginning is damaged".to_owned(),
        NoHeader { found, .. } => found.clone(),
        HeaderField { .. } => error.to_string(),
        _ => return error,
    };
    let mut from = 0;
    while let Ok(Some((_, end))) = source.whole_chunk(from, None, content) {
        if !content.events.is_empty() {
            return HeaderLost { path, reason };
        }
        from = end;
    }
    match source.disk().first_refusal() {
        Some(refusal) => Io { doing: "read", path, source: io::Error::other(refusal.to_owned()) },
        None => error,
    }
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
        let has_right_length =
            header.is_none() || !matches!(&fetched, FetchedRecord::Record(_, record) if holds_chunk(record));
        match (&fetched, &mut header) {
            (FetchedRecord::Record(op::HEADER, _), _) if has_right_length => {}
            (FetchedRecord::Record(op::METADATA, record), header)
                if has_right_length && record.len() as u64 <= MAX_HEADER_BYTES =>
            {
                match (metadata(record), header) {
                    (Some((HEADER_RECORD, fields)), none @ None) => *none = Some(Header::from_fields(&fields)?),
                    (Some((TRUTH_RECORD, fields)), Some(header)) => match Header::truth_from_fields(&fields) {
                        Ok(truth) => header.truth = Some(truth),
                        Err(error) => damage.message(error.to_string()),
                    },
                    (_, Some(_)) => damage.message("a record behind the header is not what belongs there"),
                    _ => {}
                }
            }
            (_, Some(_)) => break header.map(|header| (header, fetched)).ok_or_else(|| no_header("nothing")),
            (FetchedRecord::Record(..), None) => return Err(no_header("messages begin without it")),
            (FetchedRecord::Broken(reason), None) => return Err(no_header(reason)),
            (FetchedRecord::Cut | FetchedRecord::End, None) => return Err(no_header("the file ends there")),
        }
    }
}

#[cfg(test)]
#[path = "reader_tests.rs"]
mod tests;
