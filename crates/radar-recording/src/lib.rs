//! Recordings of radar frames, head poses and hands as MCAP files, which Foxglove opens; imports of
//! the vendor's .h5 files, which a121 reads, and of pose tracks; saved maps of rooms.
//!
//! Nothing in a file is trusted: a damaged or truncated file gives the events that can be read, and
//! a report of the rest. It is not a general MCAP library: it reads recordings of its own format
//! only.
//!
//! - [`RecordingWriter`] writes events, [`Recording`] iterates over them, [`Damage`] states what could
//!   not be read, [`RecordingSummary`] what a file holds.
//! - [`ResultsWriter`] adds what a mapper found.
//! - [`import_h5`], [`read_track`]: data of others. [`MapFolder`]: maps of rooms, by universe.
//!
//! Frames and units are those of the crates radar-mapping and a121: metres, +y up, −z forward,
//! quaternions as x, y, z, w; times in nanoseconds of one monotonic clock.
//!
//! # Format
//!
//! A file starts with metadata records (the [`Header`]), so that even a truncated file can be read. They have a checksum, and copies
//! behind the first chunk, which declares the topics, behind chunks of 256 kB before packing, and behind the last chunk. Chunks are of at most one
//! second, or 4 kB where that is more, with these topics (name, schema, content):
//!
//! - `/radar/frame`, `radar_chaperone.Frame`: raw frames.
//! - `/tracking/head_raw`, `radar_chaperone.TrackedPose`: every pose as received, valid or not.
//! - `/tracking/head`, `foxglove.FrameTransform`: the valid poses, tracking → head.
//! - `/tracking/mount`, `foxglove.FrameTransform`: head → sensor, once.
//! - `/tracking/hands_raw`, `radar_chaperone.TrackedHands`: positions of the player's hands; `none`
//!   if a hand is not tracked.
//! - `/tracking/left_hand` and `/tracking/right_hand`, `foxglove.PoseInFrame`: tracked hands,
//!   without rotation.
//!
//! The topics of hands exist only if there are hands. A recording with results ([`ResultsWriter`])
//! has more topics, which reading skips; the head of `results` lists them.
//!
//! # Example
//!
//! ```
//! use radar_mapping::Event;
//! use radar_recording::{Existing, Header, Recording, RecordingWriter};
//! use radar_sar::PoseSample;
//! use radar_sar::geometry::Pose;
//!
//! let path = std::env::temp_dir().join(format!("radar-recording-{}.mcap", std::process::id()));
//! let config = a121::preset("d16").expect("a preset");
//! let header = Header::new("an example", config, Pose::IDENTITY);
//! let mut writer = RecordingWriter::create(&path, &header, Existing::Replace)?;
//! let pose = Event::Pose(PoseSample::valid(1_000_000_000, &Pose::IDENTITY));
//! writer.write(&pose)?;
//! writer.finish()?;
//!
//! let mut recording = Recording::open(&path)?;
//! assert_eq!(recording.header().config.sweeps_per_frame, 16);
//! let events: Vec<Event> = recording.by_ref().collect();
//! assert_eq!(events, [pose]);
//! # std::fs::remove_file(path)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod chunk;
mod csv_track;
mod damage;
mod damaged_places;
mod disk;
mod disk_sync;
mod error;
mod foxglove_messages;
mod header;
mod import;
mod live_file;
mod map_file;
mod message;
mod reader;
#[cfg(test)]
mod real_scenes;
mod record;
mod record_source;
mod results;
mod small_file;
mod summary;
#[cfg(test)]
mod test_files;
mod track;
mod tum;
mod whole_file;
mod writer;

pub use damage::Damage;
pub use error::{ImportError, RecordingError};
pub use header::{FORMAT_VERSION, Header, SensorMetadata};
pub use import::{Import, ImportOptions, import_h5};
pub use map_file::{MAX_ROOMS, MapFile, MapFileError, MapFolder};
pub use reader::Recording;
pub use results::wire as results_messages;
pub use results::{BeamCone, ResultsCounters, ResultsWriter, Snapshot};
pub use small_file::{MAX_SMALL_BYTES, read_small_text};
pub use summary::{RecordingSummary, SparsePoses, StreamSummary};
pub use track::{MAX_TRACK_LINE_BYTES, TrackFormat, TrackParser, read_track, read_track_from};
pub use whole_file::{Existing, Readers, WholeFile, remove_unfinished, write_whole, write_whole_through_links};
pub use writer::RecordingWriter;
