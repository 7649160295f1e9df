//! Reads a recording from start to end, a chunk at a time: whatever is readable, and what was not.
//!
//! A damaged chunk is left out and reading goes on behind it; where the file's own framing breaks, reading ends. Nothing
//! in the file is trusted: records beyond [`MAX_RECORD_BYTES`] are refused before memory is taken for them.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use super::chunk::{MAX_RECORD_BYTES, unpack};
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::message::{Event, FRAME_TOPIC, MESSAGE_ENCODING, POSE_TOPIC, decode_frame, decode_pose};
use super::record::{Fields, channel, message, metadata, op};
use super::{Damage, RecordingError};

/// An open recording: its header, and an iterator over its frames and poses in the order of the file.
///
/// After the last event, [`damage`](Self::damage) tells what could not be read.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    header: Header,
    source: RecordSource,
    /// What came right behind the header.
    pending: Option<Fetched>,
    content: Content,
    /// The data section is over; only the index follows.
    data_ended: bool,
    ended: bool,
}

/// What came out of the chunks so far and was not yet fetched.
#[derive(Debug, Default)]
struct Content {
    topics: HashMap<u16, Topic>,
    events: VecDeque<Event>,
    damage: Damage,
}

#[derive(Debug, Clone, Copy)]
enum Topic {
    Frames,
    Poses,
    Other,
}

/// The file as a row of top-level records.
#[derive(Debug)]
struct RecordSource {
    input: BufReader<File>,
    offset: u64,
    /// Where the last record began.
    record_start: u64,
}

#[derive(Debug)]
enum Fetched {
    Record(u8, Vec<u8>),
    /// The file ends inside a record that claims so many bytes.
    Cut(u8, Vec<u8>, u64),
    /// The file ends, and no record is open.
    End,
    Broken(String),
}

impl Recording {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// Not a file, not a recording, a header that makes no sense; each says what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RecordingError> {
        let path = path.as_ref().to_owned();
        let io_error = |doing| {
            let path = path.clone();
            move |source| RecordingError::Io { doing, path, source }
        };
        if std::fs::metadata(&path).map_err(io_error("open"))?.is_dir() {
            return Err(RecordingError::Folder(path));
        }
        let mut input = BufReader::new(File::open(&path).map_err(io_error("open"))?);
        check_magic(&path, &read_up_to(&mut input, 8).map_err(io_error("read"))?)?;
        let mut source = RecordSource { input, offset: 8, record_start: 8 };
        let mut content = Content::default();
        let (header, behind) = read_header(&path, &mut source, &mut content.damage)?;
        Ok(Self { path, header, source, pending: Some(behind), content, data_ended: false, ended: false })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What holds for the whole recording.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// What could not be read so far; complete once the iterator has given its last event.
    pub fn damage(&self) -> &Damage {
        &self.content.damage
    }

    fn read_on(&mut self) {
        let fetched = self.pending.take().unwrap_or_else(|| self.source.fetch());
        let at = self.source.record_start;
        match fetched {
            Fetched::Record(op::FOOTER, _) => self.ended = true,
            Fetched::Record(op::DATA_END, _) => self.data_ended = true,
            Fetched::Record(..) if self.data_ended => {}
            Fetched::Record(opcode, record) => self.content.take(opcode, &record, record.len() as u64),
            Fetched::Cut(opcode, record, claimed_bytes) => {
                if !self.data_ended {
                    self.content.take(opcode, &record, claimed_bytes);
                }
                self.end_early(format!("the file ends in the middle of a record at byte {at}"));
            }
            Fetched::End => self.end_early(format!("the file ends at byte {at} without its closing index")),
            Fetched::Broken(reason) => self.end_early(format!("reading stopped at byte {at}: {reason}")),
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
            self.read_on();
        }
        self.content.events.pop_front()
    }
}

impl Content {
    /// Takes a top-level record; fewer bytes than claimed make it a cut one.
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

    /// Takes a record that is no chunk.
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
            _ => Self::Other,
        }
    }
}

impl RecordSource {
    fn fetch(&mut self) -> Fetched {
        self.try_fetch().unwrap_or_else(|error| Fetched::Broken(format!("the system cannot read on: {error}")))
    }

    fn try_fetch(&mut self) -> io::Result<Fetched> {
        self.record_start = self.offset;
        let head = read_up_to(&mut self.input, 9)?;
        self.offset += head.len() as u64;
        let mut fields = Fields(&head);
        let (opcode, length) = match (fields.array(), fields.u64()) {
            (Some([opcode]), Some(length)) => (opcode, length),
            (None, _) => return Ok(Fetched::End),
            (Some([opcode]), None) => return Ok(Fetched::Cut(opcode, Vec::new(), 1)),
        };
        if opcode == op::INVALID {
            return Ok(Fetched::Broken("zeros stand where a record should begin".into()));
        }
        if length > MAX_RECORD_BYTES as u64 {
            let reason = format!("a record claims {length} bytes, more than the {MAX_RECORD_BYTES} allowed");
            return Ok(Fetched::Broken(reason));
        }
        let record = read_up_to(&mut self.input, length)?;
        self.offset += record.len() as u64;
        Ok(match record.len() as u64 == length {
            true => Fetched::Record(opcode, record),
            false => Fetched::Cut(opcode, record, length),
        })
    }
}

/// So many bytes, or what is left; memory grows with what is there, not with what is asked for.
fn read_up_to(input: &mut impl Read, bytes: u64) -> io::Result<Vec<u8>> {
    let mut read = Vec::new();
    input.take(bytes).read_to_end(&mut read)?;
    Ok(read)
}

fn check_magic(path: &Path, start: &[u8]) -> Result<(), RecordingError> {
    let hint = match start {
        [] => return Err(RecordingError::Empty(path.to_owned())),
        start if start == mcap::MAGIC => return Ok(()),
        [0x89, b'H', b'D', b'F', ..] => "it is an HDF5 file: turn it into one with `radar-chaperone import`",
        start if mcap::MAGIC.starts_with(start) => "it was cut right at its start: record again",
        _ => "give a file that radar-chaperone has written",
    };
    Err(RecordingError::NotMcap { path: path.to_owned(), hint })
}

/// The header, and what came behind it.
fn read_header(
    path: &Path,
    source: &mut RecordSource,
    damage: &mut Damage,
) -> Result<(Header, Fetched), RecordingError> {
    let no_header = |found: &str| RecordingError::NoHeader { path: path.to_owned(), found: found.to_owned() };
    let mut header: Option<Header> = None;
    loop {
        let fetched = source.fetch();
        match (&fetched, &mut header) {
            (Fetched::Record(op::HEADER, _), _) => {}
            (Fetched::Record(op::METADATA, record), header) => match (metadata(record), header) {
                (Some((HEADER_RECORD, fields)), none @ None) => *none = Some(Header::from_fields(&fields)?),
                (Some((TRUTH_RECORD, fields)), Some(header)) => match Header::truth_from_fields(&fields) {
                    Ok(truth) => header.truth = Some(truth),
                    Err(error) => damage.message(error.to_string()),
                },
                _ => {}
            },
            (_, Some(_)) => break header.map(|header| (header, fetched)).ok_or_else(|| no_header("nothing")),
            (Fetched::Record(..), None) => return Err(no_header("messages begin without it")),
            (Fetched::Broken(reason), None) => return Err(no_header(reason)),
            (Fetched::Cut(..) | Fetched::End, None) => return Err(no_header("the file ends there")),
        }
    }
}
