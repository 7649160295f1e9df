//! The A121 behind its exploration server: the protocol, its clock, its session, all pure; and the line to it.
//!
//! Bytes and host times in, bytes to send and events out. `port` (the line), `find` (the ports there are) and `remedy`
//! (what keeps one from being opened) are the only files with I/O; threads and clocks are `live`'s. The server stamps frames in ticks and checks nothing on the
//! line, so what a fault may look like is part of every file here.

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod clock;
#[cfg(test)]
mod clock_simulation;
mod command;
mod config;
#[cfg(any(test, feature = "simulated-board"))]
pub mod device;
mod equation;
mod error;
pub mod find;
mod frame;
mod layout;
mod link;
mod parser;
mod port;
mod presets;
mod prf;
mod profile;
pub mod remedy;
mod reply;
mod rules;
mod session;
#[cfg(test)]
mod test_stream;
mod tick_dequantiser;
mod ticks;
mod timing;
mod version;

pub use clock::{Clock, ClockReport};
pub use command::{Calibration, Command, SensorSetup, Setup};
pub use config::{IdleState, SensorConfig, Subsweep};
pub use equation::{noise_rms_lsb, rcs_dbsm_for_snr, snr_db};
pub use error::SessionError;
pub use frame::{Frame, FrameLayout, Sweep};
pub use layout::ResultLayout;
pub use link::{LineSpeed, LinkCapacity, LinkPrediction, LinkRequirement};
pub use parser::{MAX_LINE_BYTES, Message, Parser, Received, ResultMessage, StreamCounters};
pub use port::{Address, Line, PortError, TCP_PORT};
pub use presets::{PRESETS, preset, preset_purpose};
pub use prf::Prf;
pub use profile::Profile;
pub use reply::{LogLine, Reply, ResultInfo, SensorInfo, SensorMetadata, SetupReply, SystemInfo};
pub use rules::ConfigError;
pub use session::{Action, Event, FIRST_BAUD, Link, MAX_SENSORS, SensorFrame, Session, SessionCounters};
pub use ticks::{TickUnwrapper, TickVerdict};
pub use timing::{FrameTiming, frame_timing};
pub use version::Version;

/// Distance between neighbouring range points at step 1, metres (every recording of the vendor).
pub const BASE_STEP_M: f64 = 0.002_502_274_001_017_21;
