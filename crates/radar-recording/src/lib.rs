//! Recordings: writing and reading MCAP files, importing the vendor's .h5 and pose tracks, and
//! saved maps of rooms.
//!
//! A file starts with metadata records (the [`Header`]), so that even a truncated file can be read.
//! Then come chunks of at most one second, with these topics (name, schema, content):
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

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod chunk;
mod csv_track;
mod damage;
mod error;
mod foxglove_messages;
mod header;
mod import;
mod map_file;
mod message;
mod reader;
mod record;
mod results;
mod summary;
#[cfg(test)]
mod test_files;
mod track;
mod tum;
mod vendor_h5;
mod writer;

pub use damage::Damage;
pub use error::{ImportError, RecordingError};
pub use header::{FORMAT_VERSION, Header, SensorMetadata};
pub use import::{ImportOptions, Imported, import_h5};
pub use map_file::{MAX_ROOMS, MapFile, MapFileError, MapFolder};
pub use reader::Recording;
pub use results::wire as results_messages;
pub use results::{BeamCone, OffsetEstimate, ResultsCounters, ResultsWriter, Snapshot};
pub use summary::{RecordingSummary, StreamSummary};
pub use track::{MAX_TRACK_LINE_BYTES, TrackFormat, TrackParser, read_track, read_track_from};
pub use writer::RecordingWriter;
