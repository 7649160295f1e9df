//! Recordings: MCAP out and in, import of the vendor's .h5 and of pose tracks; and the maps of rooms that are kept.
//!
//! A file begins with metadata records (the [`Header`]), so that even a cut one can be read; then come chunks of at most
//! one second with these topics:
//!
//! | topic | schema | what |
//! |---|---|---|
//! | `/radar/frame` | `radar_chaperone.Frame` | raw frames |
//! | `/tracking/head_raw` | `radar_chaperone.TrackedPose` | every pose as it came, sound or not |
//! | `/tracking/head` | `foxglove.FrameTransform` | the sound poses, tracking → head |
//! | `/tracking/mount` | `foxglove.FrameTransform` | head → sensor, once |
//! | `/tracking/hands_raw` | `radar_chaperone.TrackedHands` | where the player's hands are; `none` where a hand is not tracked |
//! | `/tracking/left_hand`, `/tracking/right_hand` | `foxglove.PoseInFrame` | the tracked ones, without a turn |
//!
//! Topics of hands are there when there are some. A recording with results ([`ResultsWriter`]) has more, which reading skips: the table is
//! at the head of `results`.

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
pub use message::Event;
pub use reader::Recording;
pub use results::wire as results_messages;
pub use results::{BeamCone, OffsetEstimate, ResultsCounters, ResultsWriter, Snapshot};
pub use summary::{RecordingSummary, StreamSummary};
pub use track::{MAX_TRACK_LINE_BYTES, TrackFormat, TrackParser, read_track, read_track_from};
pub use writer::RecordingWriter;
