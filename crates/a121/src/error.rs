//! Errors of a session. Each message says what happened and what to do.

use super::Version;
use crate::ConfigError;

/// Why a session cannot start, or has to start again.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// The configuration breaks a rule of the sensor.
    #[error("sensor {sensor_id}: {source}")]
    Config {
        /// Sensor of the configuration.
        sensor_id: u32,
        /// The broken rule.
        source: ConfigError,
    },
    /// A set-up without sensors.
    #[error("no sensor is set up: give at least one in every group")]
    NoSensors,
    /// The same sensor appears twice in a group.
    #[error("sensor {0} appears twice in one group: put it into another group")]
    SensorTwice(u32),
    /// A sensor id outside 1 to `MAX_SENSORS`.
    #[error("sensor id {0} does not exist: ids are 1 to {max}", max = super::session::MAX_SENSORS)]
    SensorId(u32),
    /// Both the server and the sensor are asked to control the rate.
    #[error(
        "update_rate {update_rate_hz} with frame_rate {frame_rate_hz} of sensor {sensor_id}: leave one of them out"
    )]
    BothRates {
        /// Rate asked of the server, Hz.
        update_rate_hz: f64,
        /// Rate asked of the sensor, Hz.
        frame_rate_hz: f64,
        /// Which sensor.
        sensor_id: u32,
    },
    /// An update rate that is not positive.
    #[error("update_rate is {0}: it must be above 0, or left out")]
    UpdateRate(f64),
    /// The board did not answer a command.
    #[error(
        "no answer to {asked} within {seconds:.1} s: check the board's port and its flow control. \
         {hint}"
    )]
    NoAnswer {
        /// The command.
        asked: &'static str,
        /// How long the session waited, seconds.
        seconds: f64,
        /// Further advice.
        hint: &'static str,
    },
    /// Instead of an answer to a command came what is none.
    #[error(
        "no answer to {asked} within {seconds:.1} s, but {bytes} bytes that are no message of a board: another device is at \
         this port, or the line damages what the board sends; a slower baud rate may help"
    )]
    ForeignBytes {
        /// The command.
        asked: &'static str,
        /// How long the session waited, seconds.
        seconds: f64,
        /// How many bytes.
        bytes: u64,
    },
    /// No two answers about the board were the same.
    #[error("the board's answers about itself keep changing: check its cable, or try a slower baud rate")]
    AnswersDiffer,
    /// Frames stopped.
    #[error("no frame for {seconds:.1} s: the sensor is set up again; if this repeats, check its cable and power")]
    Silent {
        /// How long the session waited, seconds.
        seconds: f64,
    },
    /// The server ended the session.
    #[error("the board ended the session: it is set up again")]
    EndedByServer,
    /// The server refused a command.
    #[error("the board refuses {asked}: {message}")]
    Refused {
        /// The command, or streaming.
        asked: &'static str,
        /// The server's message.
        message: String,
    },
    /// The server is built for another sensor.
    #[error("the board's server is for a sensor \"{0}\", not for an A121: flash the A121 exploration server")]
    WrongSensor(String),
    /// A version that cannot be parsed.
    #[error("the board's version \"{0}\" is not understood: flash the A121 exploration server again")]
    UnknownVersion(String),
    /// The server's version is not supported.
    #[error("the board's version {found} is too old, {needed} is the first supported one: flash a newer one")]
    TooOld {
        /// Version of the server.
        found: Version,
        /// First supported version.
        needed: Version,
    },
    /// The server's version does not know the PRF.
    #[error(
        "the board's version {found} does not know prf {prf_mhz} MHz ({needed} does): flash a newer one or choose \
         another prf"
    )]
    TooOldForPrf {
        /// Version of the server.
        found: Version,
        /// First version that knows the PRF.
        needed: Version,
        /// Requested PRF, MHz.
        prf_mhz: f64,
    },
    /// The board reports 0 ticks per second.
    #[error("the board reports a clock with no ticks: flash the A121 exploration server again")]
    NoTicks,
    /// No sensor is connected where the set-up needs one.
    #[error(
        "no sensor is connected at connector {sensor_id} ({connected}): check the flat cable, both ends, contacts \
         facing the board"
    )]
    NotConnected {
        /// Sensor id without a sensor.
        sensor_id: u32,
        /// Text: where sensors are connected.
        connected: String,
    },
    /// A baud rate that the board does not offer.
    #[error("baud rate {asked} is not offered: choose 115200 to {max}")]
    Baud {
        /// Requested baud rate.
        asked: u32,
        /// Highest baud rate of the board.
        max: u32,
    },
    /// The server set up frames of another length.
    #[error(
        "the board set up frames of another length than the configuration has: its version and this program do not match"
    )]
    OtherFrames,
    /// The line was lost.
    #[error("the connection is lost ({0}): waiting for the board to come back")]
    LineLost(String),
}
