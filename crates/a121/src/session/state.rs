//! States of the conversation with a board.

use super::event::Link;

/// State of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Waits before a retry.
    Pausing,
    /// The line is closed.
    Closed,
    Breaking,
    Awaiting(Request),
    Streaming,
    /// Stopping, either to end or to set up again.
    Stopping {
        ends: bool,
    },
    Over,
}

/// The request whose reply is awaited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Request {
    System,
    Sensors,
    Baud(u32),
    Setup,
    Start,
}

impl Request {
    pub fn name(self) -> &'static str {
        match self {
            Self::System => "get_system_info",
            Self::Sensors => "get_sensor_info",
            Self::Baud(_) => "set_uart_baudrate",
            Self::Setup => "setup",
            Self::Start => "start_streaming",
        }
    }

    /// What to do if the reply is missing.
    pub fn hint(self, link: Link) -> &'static str {
        match (self, link) {
            (Self::System, Link::Serial { .. }) => "XE125: use the port named Enhanced. SparkFun: flow control off",
            (Self::System, Link::Tcp) => "Is the exploration server running?",
            _ => STOP_HINT,
        }
    }
}

/// What to do if the reply to a stop command is missing.
pub(super) const STOP_HINT: &str = "A slower baud rate may help";

/// The stop command for a stream that an earlier client left running; it is sent once a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum StaleStop {
    #[default]
    NotSent,
    ReplyPending,
    Answered,
}
