//! What a session exchanges with its caller: link, actions, events, counters.

use crate::{Frame, LogLine, SensorInfo, SessionError, SetupReply, StreamCounters, SystemInfo};

/// Link to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link {
    /// A serial port.
    Serial {
        /// Baud rate to switch to; `None` for the highest one of the board.
        baud: Option<u32>,
    },
    /// A socket to the server on a Raspberry Pi.
    Tcp,
}

/// What the caller has to do with the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Action {
    /// Write these bytes.
    Send(Vec<u8>),
    /// Send a break.
    SendBreak,
    /// Discard bytes that were received but not yet passed to the session.
    FlushInput,
    /// Switch the local port to this speed.
    SetBaud(u32),
    /// Close the socket, open it again, and call [`Session::line_opened`].
    ///
    /// [`Session::line_opened`]: crate::Session::line_opened
    Reopen,
}

/// A frame of one sensor, with its host time.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorFrame {
    /// Group within the set-up.
    pub group: usize,
    /// Sensor on the board, from 1.
    pub sensor_id: u32,
    /// The frame; its host time is the end of the measurement.
    pub frame: Frame,
}

/// An event of the session.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The board answered.
    Connected(SystemInfo, Vec<SensorInfo>),
    /// The sensors are set up.
    SetUp(SetupReply),
    /// Streaming started.
    Streaming,
    /// The frames of one result, group by group.
    Frames(Vec<SensorFrame>),
    /// A line of the board's log.
    Log(LogLine),
    /// A sensor requested a calibration; all sensors are set up again.
    Recalibrating,
    /// A problem; the session retries.
    Trouble(SessionError),
    /// A problem that a retry cannot solve; the session is over.
    Failed(SessionError),
    /// Stopped on request.
    Stopped,
}

/// Counters of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SessionCounters {
    /// Counters of the byte stream.
    pub stream: StreamCounters,
    /// Results emitted as frames.
    pub results: u64,
    /// Results that only served to confirm the first tick.
    pub unconfirmed: u64,
    /// Results rejected because of their tick.
    pub refused_ticks: u64,
    /// Jumps of the sensor's clock.
    pub tick_jumps: u64,
    /// Connection attempts.
    pub connects: u64,
    /// Missing replies.
    pub unanswered: u64,
    /// Times that frames stopped.
    pub silences: u64,
    /// Replies without a request.
    pub unexpected_replies: u64,
    /// New set-ups after a calibration request.
    pub recalibrations: u64,
    /// Events dropped because they were not read.
    pub dropped_events: u64,
}
