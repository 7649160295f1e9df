//! The A121 behind its exploration server: the protocol, its clock, its session, all pure; and the line to it.
//!
//! Bytes and host times in, bytes to send and events out. `port` (the line), `find` (the ports there are) and `remedy`
//! (what keeps one from being opened) are the only files with I/O; threads and clocks are `live`'s. The server stamps frames in ticks and checks nothing on the
//! line, so what a fault may look like is part of every file here.

mod clock;
#[cfg(test)]
mod clock_simulation;
mod command;
pub mod device;
mod error;
pub mod find;
mod layout;
mod parser;
mod port;
pub mod remedy;
mod reply;
mod session;
#[cfg(test)]
mod test_stream;
mod tick_dequantiser;
mod ticks;
mod version;

pub use clock::{Clock, ClockReport};
pub use command::{Calibration, Command, SensorSetup, Setup};
pub use error::SessionError;
pub use layout::ResultLayout;
pub use parser::{MAX_LINE_BYTES, Message, Parser, Received, ResultMessage, StreamCounters};
pub use port::{Address, Line, PortError, TCP_PORT};
pub use reply::{LogLine, Reply, ResultInfo, SensorInfo, SensorMetadata, SetupReply, SystemInfo};
pub use session::{Action, Event, FIRST_BAUD, Link, MAX_SENSORS, SensorFrame, Session, SessionCounters};
pub use ticks::{TickUnwrapper, TickVerdict};
pub use version::Version;
