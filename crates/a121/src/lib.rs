//! Host-side client of the Acconeer A121 exploration server: sensor configurations, the protocol,
//! a session that recovers from faults, and frame times on the host's clock.
//!
//! It speaks to boards that run the vendor's server (XC120 over USB, XE125 and SparkFun's XM125
//! over serial lines, a Raspberry Pi over TCP). It is not the vendor's C library (RSS), contains
//! none of its code, and does no signal processing: it delivers raw frames.
//!
//! - [`SensorConfig`]: what one sensor measures; from [`preset`], checked by
//!   [`SensorConfig::validate`], timed by [`frame_timing`]. [`LinkRequirement`]: whether a line can
//!   carry it.
//! - [`Session`]: the conversation with a board. Pure: takes bytes and host times, returns each
//!   [`Action`] that the line has to perform and each [`Event`].
//! - [`Frame`]: the samples of one measurement; [`FrameLayout`] splits it into sweeps.
//! - [`find`] chooses the port, [`Line`] opens it, [`remedy`] says why it does not open. Only these
//!   do I/O; threads and clocks are the program's.
//! - [`Parser`], [`TickUnwrapper`] and [`Clock`]: the parts of a session, usable alone. The server
//!   stamps frames with ticks of its own clock and sends no checksums, so all of them consider
//!   transmission faults.
//!
//! Units: metres, seconds, and nanoseconds of the host's monotonic clock; the unit is part of the
//! name (`_m`, `_s`, `_ns`). Samples are complex, in LSB of the converter, as the server sends
//! them; their phase grows with range (+4πr/λ, measured).
//!
//! The feature `simulated-board` adds the module `device`: a board, with faults on request, for
//! tests without hardware. The feature `vendor-h5` adds the module `vendor_h5`: reading the `.h5`
//! recordings of the vendor's exploration tool.
//!
//! # Example
//!
//! A whole session with a simulated board, in simulated time. A program does the same with a
//! [`Line`] and a clock; see the crate's example `ranges`.
//!
#![cfg_attr(feature = "simulated-board", doc = "```")]
#![cfg_attr(not(feature = "simulated-board"), doc = "```ignore")]
//! use a121::device::{Board, Device, FaultPlan, Output, TickSeededNoise};
//! use a121::{Action, Event, FrameLayout, Link, Session, Setup, preset};
//!
//! let config = preset("d16").expect("a preset");
//! let layout = FrameLayout::of(&config);
//! let mut board = Device::new(Board::Xc120, Box::new(TickSeededNoise), FaultPlan::default(), 1, 0);
//! let mut session = Session::new(Setup::single(1, config), Link::Tcp, 0)?;
//! let (mut now_ns, mut sweeps, mut arriving) = (0, 0, Vec::new());
//! while !session.is_over() {
//!     while let Some(action) = session.next_action() {
//!         if let Action::Send(bytes) = action {
//!             board.receive(&bytes, now_ns);
//!         }
//!     }
//!     now_ns = now_ns.max(board.next_ns().min(session.next_deadline_ns()));
//!     board.poll(now_ns, &mut arriving);
//!     for output in arriving.drain(..) {
//!         if let Output::Bytes { bytes, .. } = output {
//!             session.receive(&bytes, now_ns);
//!         }
//!     }
//!     session.poll(now_ns);
//!     while let Some(event) = session.next_event() {
//!         match event {
//!             Event::Frames(of_sensors) => {
//!                 sweeps += layout.sweeps(&of_sensors[0].frame).map_or(0, Iterator::count);
//!                 if sweeps >= 160 {
//!                     session.stop(now_ns);
//!                 }
//!             }
//!             Event::Trouble(error) | Event::Failed(error) => return Err(error),
//!             other => println!("{other:?}"),
//!         }
//!     }
//! }
//! assert!(sweeps >= 160 && session.counters().results >= 10);
//! # Ok::<(), a121::SessionError>(())
//! ```

#![deny(missing_docs)]
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
mod platform;
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
#[cfg(any(test, windows))]
mod usb_nodes;
#[cfg(feature = "vendor-h5")]
pub mod vendor_h5;
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
pub use platform::monotonic_ns;
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

/// Distance between neighbouring range points at step 1, metres. Measured: the metadata of every
/// recording of the vendor.
pub const BASE_STEP_M: f64 = 0.002_502_274_001_017_21;
