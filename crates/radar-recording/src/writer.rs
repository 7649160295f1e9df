//! Writes a recording: header, then chunks of at most one second, or of 4 kB where that is longer. A live recording passes on
//! what it has three times a second, so a crash loses at most a second. The same input gives the
//! same bytes.

use radar_mapping::Event;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use foxglove::Encode;
use foxglove::messages::{FrameTransform, PoseInFrame};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, McapResult, WriteOptions};

use super::disk_sync::DiskSync;
use super::foxglove_messages::{hand_pose, head_transform, mount_transform};
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::live_file::{Kept, LiveFile};
use super::message::{
    DESCRIPTORS, FRAME_CHANNEL, FRAME_SCHEMA, FRAME_TOPIC, HAND_CHANNELS, HANDS_CHANNEL, HANDS_SCHEMA, HANDS_TOPIC,
    HEAD_CHANNEL, MESSAGE_ENCODING, MOUNT_CHANNEL, POSE_CHANNEL, POSE_SCHEMA, POSE_TOPIC, encode_frame, encode_hands,
    encode_pose,
};
use super::whole_file::{Existing, Readers, WholeFile};
use super::{RecordingError, RecordingSummary};
use a121::Frame;
use radar_mapping::HandsSample;
use radar_sar::PoseSample;

/// Longest duration of a chunk, nanoseconds, if it holds this many bytes. Choices: what a crash or power failure costs at most; times
/// that leap to and fro do not swell the file, as a chunk takes some hundred bytes beside its content.
const CHUNK_NS: i64 = 1_000_000_000;
const MIN_CHUNK_BYTES: usize = 4096;
/// A chunk ends when it holds this many bytes. Choice: chunks much smaller compress worse, and a
/// reader that seeks unpacks a whole one.
const CHUNK_BYTES: usize = 1 << 20;
/// Behind this many bytes of chunks, before they are packed, the header is written once more. Choice: what a disk loses at once is
/// shorter.
const HEADER_COPY_BYTES: usize = 1 << 18;
/// Library name in the file; constant, so that the bytes depend only on the input.
const LIBRARY: &str = "radar-chaperone";

/// A channel of the file.
struct Channel {
    id: u16,
    messages: u32,
}

/// A topic whose channel is created with its first message.
pub(super) struct Topic {
    id: u16,
    name: &'static str,
    schema: String,
    descriptors: Vec<u8>,
    channel: Option<Channel>,
}

impl Topic {
    /// A topic of protobuf messages.
    pub(super) fn new(id: u16, name: &'static str, schema: &str, descriptors: &[u8]) -> Self {
        Self { id, name, schema: schema.to_owned(), descriptors: descriptors.to_vec(), channel: None }
    }

    /// A topic with a Foxglove schema.
    pub(super) fn foxglove<M: Encode>(id: u16, name: &'static str) -> Self {
        let (schema, descriptors) = M::get_schema().map_or_else(Default::default, |s| (s.name, s.data.into_owned()));
        Self::new(id, name, &schema, &descriptors)
    }
}

/// Content of the open chunk.
struct OpenChunk {
    earliest_ns: i64,
    latest_ns: i64,
    bytes: usize,
}

/// What a recording is written to: a file, in tests one whose disk fails.
trait Storage: io::Write + io::Seek + Send {
    /// Passes all that was written to the disk.
    fn sync_all(&self) -> io::Result<()>;
}

impl Storage for File {
    fn sync_all(&self) -> io::Result<()> {
        Self::sync_all(self)
    }
}

/// The file, and the open chunk.
struct Output {
    mcap: mcap::Writer<BufWriter<Box<dyn Storage>>>,
    chunk: Option<OpenChunk>,
    /// Content of the chunks before that, bytes.
    bytes: usize,
}

/// Where a recording is while it is written.
enum Place {
    /// Beside its name.
    Beside(WholeFile),
    /// Under its name, passed to the disk again and again.
    Live(LiveFile, DiskSync),
}

impl Place {
    /// Passes what was written to the disk, under the recording's name.
    fn keep(self, storage: &dyn Storage) -> io::Result<Kept> {
        match self {
            Self::Beside(whole) => {
                storage.sync_all()?;
                whole.rename()?;
                Ok(Kept::InPlace)
            }
            Self::Live(file, sync) => {
                sync.finish()?;
                storage.sync_all()?;
                file.keep()
            }
        }
    }
}

/// Writer of a recording. Dropping it without [`finish`](Self::finish) leaves nothing of a recording that would appear when
/// finished, and ends a live one properly, but hides errors.
pub struct RecordingWriter {
    path: PathBuf,
    place: Place,
    output: Output,
    frames: Channel,
    raw_poses: Channel,
    head: Channel,
    mount: Channel,
    /// Raw hands, and one channel per hand for Foxglove; created with the first hands.
    hands: Option<(Channel, [Channel; 2])>,
    /// Whether the header was written behind the first chunks.
    is_header_copied: bool,
    summary: RecordingSummary,
}

impl RecordingWriter {
    /// A recording that appears under its name when it is finished; until then it is a neighbour.
    ///
    /// # Errors
    /// A header that could not be read back (a broken rule, a number that is not finite), or a file
    /// that cannot be written.
    pub fn create(path: impl AsRef<Path>, header: &Header, existing: Existing) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        header.check_readable()?;
        let (whole, file) =
            WholeFile::create(path, Readers::Usual, existing).map_err(|source| create_error(path, source))?;
        Self::start(path, Place::Beside(whole), Box::new(file), header).map_err(|error| write_error(path, error))
    }

    /// A recording that stands under its name from the beginning, readable by the user alone: what was written survives a crash.
    ///
    /// # Errors
    /// As [`Self::create`], and a file that is there already.
    pub fn create_live(path: impl AsRef<Path>, header: &Header) -> Result<Self, RecordingError> {
        let path = path.as_ref();
        header.check_readable()?;
        let create = || {
            let (live, file) = LiveFile::create(path)?;
            Ok((Place::Live(live, DiskSync::of(path)?), file))
        };
        let (place, file) = create().map_err(|source| create_error(path, source))?;
        Self::start(path, place, Box::new(file), header).map_err(|error| write_error(path, error))
    }

    fn start(path: &Path, place: Place, storage: Box<dyn Storage>, header: &Header) -> McapResult<Self> {
        let mut output = Output::start(storage)?;
        output.write_header(header)?;
        let frames = output.add_channel(FRAME_CHANNEL, FRAME_TOPIC, FRAME_SCHEMA, DESCRIPTORS)?;
        let raw_poses = output.add_channel(POSE_CHANNEL, POSE_TOPIC, POSE_SCHEMA, DESCRIPTORS)?;
        let head = output.add_foxglove_channel::<FrameTransform>(HEAD_CHANNEL, "/tracking/head")?;
        let mount = output.add_foxglove_channel::<FrameTransform>(MOUNT_CHANNEL, "/tracking/mount")?;
        // The topics get a chunk of their own, so that damage to later chunks does not affect them.
        output.flush()?;
        // A copy, so that no damaged bit costs the header. Two more follow, farther away.
        output.write_header(header)?;
        let (path, summary) = (path.to_owned(), RecordingSummary::new(header.clone()));
        Ok(Self { path, place, output, frames, raw_poses, head, mount, hands: None, is_header_copied: false, summary })
    }

    /// Writes a frame. Of more points than the sensor's buffer holds, 4095, it is left out when it is read.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write_frame(&mut self, frame: &Frame) -> Result<(), RecordingError> {
        self.begin(frame.host_time_ns)
            .and_then(|()| self.output.message(&mut self.frames, frame.host_time_ns, &encode_frame(frame)))
            .map_err(|error| write_error(&self.path, error))?;
        self.summary.push_frame(frame);
        Ok(())
    }

    /// Writes a raw pose, and a valid one also for Foxglove.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write_pose(&mut self, pose: &PoseSample) -> Result<(), RecordingError> {
        self.put_pose(pose).map_err(|error| write_error(&self.path, error))?;
        self.summary.push_pose(pose);
        Ok(())
    }

    fn put_pose(&mut self, pose: &PoseSample) -> McapResult<()> {
        self.begin(pose.time_ns)?;
        self.output.message(&mut self.raw_poses, pose.time_ns, &encode_pose(pose))?;
        match pose.tracking_from_head() {
            Ok(sound) => self.output.foxglove(&mut self.head, pose.time_ns, &head_transform(pose.time_ns, &sound)),
            Err(_) => Ok(()),
        }
    }

    /// Writes raw hands, and each tracked one also for Foxglove.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write_hands(&mut self, hands: &HandsSample) -> Result<(), RecordingError> {
        self.put_hands(hands).map_err(|error| write_error(&self.path, error))?;
        self.summary.push_hands(hands);
        Ok(())
    }

    fn put_hands(&mut self, hands: &HandsSample) -> McapResult<()> {
        self.begin(hands.time_ns)?;
        let (both, each) = match &mut self.hands {
            Some(channels) => channels,
            none => {
                let both = self.output.add_channel(HANDS_CHANNEL, HANDS_TOPIC, HANDS_SCHEMA, DESCRIPTORS)?;
                let [left, right] = HAND_CHANNELS;
                let left = self.output.add_foxglove_channel::<PoseInFrame>(left, "/tracking/left_hand")?;
                let right = self.output.add_foxglove_channel::<PoseInFrame>(right, "/tracking/right_hand")?;
                none.insert((both, [left, right]))
            }
        };
        self.output.message(both, hands.time_ns, &encode_hands(hands))?;
        for (channel, position_m) in each.iter_mut().zip(hands.hands_m) {
            if let Some(position_m) = position_m.filter(|position_m| position_m.is_finite()) {
                self.output.foxglove(channel, hands.time_ns, &hand_pose(hands.time_ns, position_m))?;
            }
        }
        Ok(())
    }

    /// Writes an event.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write(&mut self, event: &Event) -> Result<(), RecordingError> {
        match event {
            Event::Frame(frame) => self.write_frame(frame),
            Event::Pose(pose) => self.write_pose(pose),
            Event::Hands(hands) => self.write_hands(hands),
        }
    }

    /// Writes a message of a results topic, which reading skips.
    pub(super) fn write_to_topic(
        &mut self,
        topic: &mut Topic,
        time_ns: i64,
        bytes: &[u8],
    ) -> Result<(), RecordingError> {
        self.put_result(topic, time_ns, bytes).map_err(|error| write_error(&self.path, error))
    }

    fn put_result(&mut self, topic: &mut Topic, time_ns: i64, bytes: &[u8]) -> McapResult<()> {
        self.begin(time_ns)?;
        let channel = match &mut topic.channel {
            Some(channel) => channel,
            none => none.insert(self.output.add_channel(topic.id, topic.name, &topic.schema, &topic.descriptors)?),
        };
        self.output.message(channel, time_ns, bytes)
    }

    /// Counts a snapshot of results.
    pub(super) fn count_scene(&mut self) {
        self.summary.scenes += 1;
    }

    /// Ends the open chunk and passes it to the system; a later crash does not affect it. Of a live recording it is passed to the
    /// disk as well, in the background: soon, a power cut does not affect it either.
    ///
    /// # Errors
    /// The system refuses the bytes, or the disk refused earlier ones.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        let synced = |place: &Place| if let Place::Live(_, sync) = place { sync.request() } else { Ok(()) };
        let flushed = self.output.flush().and_then(|()| Ok(synced(&self.place)?));
        flushed.map_err(|error| write_error(&self.path, error))
    }

    /// Writes the index, ends the file and passes it to the disk; returns a summary.
    ///
    /// # Errors
    /// The system refuses the bytes. The name leads elsewhere now: the error states where the recording is.
    pub fn finish(self) -> Result<RecordingSummary, RecordingError> {
        let Self { path, place, output, summary, .. } = self;
        let kept = output.end(&summary.header).and_then(|storage| Ok(place.keep(&*storage)?));
        match kept.map_err(|error| write_error(&path, error))? {
            Kept::InPlace => Ok(summary),
            Kept::Copied(copy) => Err(RecordingError::Displaced { path, copy }),
        }
    }

    /// Starts a new chunk if necessary, writes the header before it if a copy is due, and the mount before the first event.
    fn begin(&mut self, time_ns: i64) -> McapResult<()> {
        self.output.start_chunk_if_needed(time_ns)?;
        if !self.is_header_copied && self.output.bytes >= HEADER_COPY_BYTES {
            self.is_header_copied = true;
            self.output.write_header(&self.summary.header)?;
        }
        if self.mount.messages == 0 {
            let mount = mount_transform(time_ns, &self.summary.header.head_from_sensor);
            self.output.foxglove(&mut self.mount, time_ns, &mount)?;
        }
        Ok(())
    }
}

impl Output {
    fn start(storage: Box<dyn Storage>) -> McapResult<Self> {
        let mcap = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .library(LIBRARY)
            .chunk_size(None)
            // Chunks are assembled in memory and written whole.
            .disable_seeking(true)
            .create(BufWriter::new(storage))?;
        Ok(Self { mcap, chunk: None, bytes: 0 })
    }

    fn write_header(&mut self, header: &Header) -> McapResult<()> {
        self.mcap.write_metadata(&Metadata { name: HEADER_RECORD.into(), metadata: header.to_fields() })?;
        let truth = header.truth_to_fields();
        truth.map_or(Ok(()), |metadata| self.mcap.write_metadata(&Metadata { name: TRUTH_RECORD.into(), metadata }))
    }

    fn add_channel(&mut self, id: u16, topic: &str, schema: &str, descriptors: &[u8]) -> McapResult<Channel> {
        let schema = self.mcap.add_schema(schema, "protobuf", descriptors)?;
        let id = self.mcap.add_channel_with_id(id, schema, topic, MESSAGE_ENCODING, &BTreeMap::new())?;
        Ok(Channel { id, messages: 0 })
    }

    fn add_foxglove_channel<M: Encode>(&mut self, id: u16, topic: &str) -> McapResult<Channel> {
        match M::get_schema() {
            Some(schema) => self.add_channel(id, topic, &schema.name, &schema.data),
            None => Err(io::Error::other(format!("no schema for {topic}")).into()),
        }
    }

    fn start_chunk_if_needed(&mut self, time_ns: i64) -> McapResult<()> {
        if let Some(chunk) = &mut self.chunk {
            let (earliest_ns, latest_ns) = (chunk.earliest_ns.min(time_ns), chunk.latest_ns.max(time_ns));
            let is_short = latest_ns.saturating_sub(earliest_ns) <= CHUNK_NS || chunk.bytes < MIN_CHUNK_BYTES;
            if is_short && chunk.bytes < CHUNK_BYTES {
                (chunk.earliest_ns, chunk.latest_ns) = (earliest_ns, latest_ns);
                return Ok(());
            }
            self.flush()?;
        }
        self.chunk = Some(OpenChunk { earliest_ns: time_ns, latest_ns: time_ns, bytes: 0 });
        Ok(())
    }

    fn flush(&mut self) -> McapResult<()> {
        self.bytes += self.chunk.take().map_or(0, |chunk| chunk.bytes);
        self.mcap.flush()
    }

    /// Writes a last copy of the header, and the index; the storage, with all bytes passed to the system.
    fn end(mut self, header: &Header) -> McapResult<Box<dyn Storage>> {
        self.mcap.flush()?;
        self.write_header(header)?;
        self.mcap.finish()?;
        Ok(self.mcap.into_inner().into_inner().map_err(io::IntoInnerError::into_error)?)
    }

    fn foxglove<M: Encode>(&mut self, channel: &mut Channel, time_ns: i64, message: &M) -> McapResult<()> {
        let mut bytes = Vec::new();
        message.encode(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
        self.message(channel, time_ns, &bytes)
    }

    /// Writes a message. MCAP's times start at 0; earlier times are logged as 0 and stay exact
    /// inside the message.
    fn message(&mut self, channel: &mut Channel, time_ns: i64, bytes: &[u8]) -> McapResult<()> {
        let filed_ns = u64::try_from(time_ns).unwrap_or(0);
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.messages,
            log_time: filed_ns,
            publish_time: filed_ns,
        };
        channel.messages = channel.messages.wrapping_add(1);
        if let Some(chunk) = &mut self.chunk {
            chunk.bytes += bytes.len();
        }
        self.mcap.write_to_known_channel(&header, bytes)
    }
}

fn create_error(path: &Path, source: io::Error) -> RecordingError {
    match source.kind() {
        io::ErrorKind::AlreadyExists => RecordingError::AlreadyThere(path.to_owned()),
        _ => RecordingError::Io { doing: "create", path: path.to_owned(), source },
    }
}

fn write_error(path: &Path, error: McapError) -> RecordingError {
    let source = match error {
        McapError::Io(source) => source,
        other => io::Error::other(other.to_string()),
    };
    RecordingError::Io { doing: "write", path: path.to_owned(), source }
}

#[cfg(test)]
#[path = "writer_failure_tests.rs"]
mod failure_tests;

#[cfg(test)]
mod tests {
    use super::super::test_files::{TestFile, assert_same, events, header, recorded};
    use super::super::{Recording, RecordingSummary};
    use super::*;

    #[test]
    fn the_same_input_gives_the_same_bytes() {
        let events = events(2);
        assert_eq!(recorded(&events), recorded(&events));
    }

    #[test]
    fn chunks_are_bounded_in_time_and_size() {
        let file = TestFile::with(&recorded(&events(5)));
        let bytes = std::fs::read(&file.0).unwrap();
        let index = mcap::Summary::read(&bytes).unwrap().unwrap();
        assert!(index.chunk_indexes.len() >= 6);
        for chunk in &index.chunk_indexes {
            assert!(chunk.message_end_time - chunk.message_start_time <= CHUNK_NS as u64);
            assert!(chunk.uncompressed_size < 2 * CHUNK_BYTES as u64);
        }
        assert_eq!(index.metadata_indexes.len(), 6, "header and truth: first, behind the first chunk, last");
    }

    #[test]
    fn flushed_events_survive_a_crash() {
        let file = TestFile::new();
        let events = events(1);
        let mut writer = RecordingWriter::create_live(&file.0, &header()).unwrap();
        let second = RecordingWriter::create_live(&file.0, &header()).err().unwrap();
        assert!(matches!(second, RecordingError::AlreadyThere(_)), "{second}");
        for event in &events {
            writer.write(event).unwrap();
        }
        writer.flush().unwrap();
        let at_crash = TestFile::with(&std::fs::read(&file.0).unwrap());
        let mut recording = Recording::open(&at_crash.0).unwrap();
        assert_same(&recording.by_ref().collect::<Vec<_>>(), &events);
        assert!(recording.damage().ended_early.as_ref().unwrap().contains("without its closing index"));
    }

    #[test]
    fn writer_summary_equals_read_summary() {
        let file = TestFile::new();
        let mut writer = RecordingWriter::create(&file.0, &header(), Existing::Replace).unwrap();
        for event in &events(3) {
            writer.write(event).unwrap();
        }
        assert_eq!(writer.finish().unwrap(), RecordingSummary::read(&file.0).unwrap());
    }

    #[test]
    fn unwritable_path_is_named() {
        let error =
            RecordingWriter::create("/no/such/folder/x.mcap", &header(), Existing::Replace).err().unwrap().to_string();
        assert!(error.contains("cannot create /no/such/folder/x.mcap"), "{error}");
    }
}
