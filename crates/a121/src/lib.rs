//! The A121 sensor behind its exploration server: protocol, clock and session (pure), and the line
//! to the board.
//!
//! The pure part takes bytes and host times, and returns bytes to send and events. Only `port` (the
//! line), `find` (available ports) and `remedy` (why a port cannot be opened) do I/O; threads and
//! clocks are the program's. The server stamps frames with ticks and sends no checksums, so every
//! file here considers transmission faults.

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod clock;
#[cfg(test)]
mod clock_simulation;
mod command;
mod concave;
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
