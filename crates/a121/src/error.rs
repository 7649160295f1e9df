//! What can go wrong with a session: each message says what happened and what to do.

use super::Version;
use crate::ConfigError;

/// Why a session cannot begin, or begins anew.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// A configuration that no sensor takes.
    #[error("sensor {sensor_id}: {source}")]
    Config {
        /// Whose.
        sensor_id: u32,
        /// The rule.
        source: ConfigError,
    },
    /// Nothing to measure.
    #[error("no sensor is set up: give at least one in every group")]
    NoSensors,
    /// A sensor cannot measure twice at once.
    #[error("sensor {0} stands twice in one group: put it into another group")]
    SensorTwice(u32),
    /// Sensors are counted from 1.
    #[error("sensor id {0} does not exist: ids are 1 to {max}", max = super::session::MAX_SENSORS)]
    SensorId(u32),
    /// Either the server or the sensor keeps the rate.
    #[error(
        "update_rate {update_rate_hz} with frame_rate {frame_rate_hz} of sensor {sensor_id}: leave one of them out"
    )]
    BothRates {
        /// What the server should keep.
        update_rate_hz: f64,
        /// What the sensor should keep.
        frame_rate_hz: f64,
        /// Which sensor.
        sensor_id: u32,
    },
    /// A rate that is no rate.
    #[error("update_rate is {0}: it must be above 0, or left out")]
    UpdateRate(f64),
    /// No answer.
    #[error(
        "no answer to {asked} within {seconds:.1} s: is it the board's right port, and is flow control as it needs \
         it? {hint}"
    )]
    NoAnswer {
        /// Which command.
        asked: &'static str,
        /// How long was waited.
        seconds: f64,
        /// What else to look at.
        hint: &'static str,
    },
    /// No two answers were the same.
    #[error("the board never says the same twice of itself: check its cable, or try a slower baud rate")]
    AnswersDiffer,
    /// Frames stopped.
    #[error("no frame for {seconds:.1} s: the sensor is set up again; if this repeats, check its cable and power")]
    Silent {
        /// How long was waited.
        seconds: f64,
    },
    /// The server gave up by itself.
    #[error("the board ended the session by itself: it is set up again")]
    EndedByServer,
    /// The server refuses.
    #[error("the board refuses {asked}: {message}")]
    Refused {
        /// Which command, or streaming.
        asked: &'static str,
        /// In its words.
        message: String,
    },
    /// Another sensor's server.
    #[error("the board speaks to a sensor \"{0}\", not to an A121: flash the A121 exploration server")]
    WrongSensor(String),
    /// A version that is none.
    #[error("the board's version \"{0}\" is not understood: flash the A121 exploration server anew")]
    UnknownVersion(String),
    /// Too old for anything.
    #[error("the board's version {found} is too old, {needed} is the first that is understood: flash a newer one")]
    TooOld {
        /// What it has.
        found: Version,
        /// First that serves.
        needed: Version,
    },
    /// Too old for the configuration.
    #[error(
        "the board's version {found} does not know prf {prf_mhz} MHz ({needed} does): flash a newer one or choose \
         another prf"
    )]
    TooOldForPrf {
        /// What it has.
        found: Version,
        /// First that serves.
        needed: Version,
        /// What was asked for.
        prf_mhz: f64,
    },
    /// A clock without ticks.
    #[error("the board says that its clock makes no ticks: flash the A121 exploration server anew")]
    NoTicks,
    /// No sensor where one should be.
    #[error(
        "no sensor is connected at place {sensor_id} ({connected}): check the flat cable, both ends, contacts \
         facing the board"
    )]
    NotConnected {
        /// Where it should be.
        sensor_id: u32,
        /// Where there are some.
        connected: String,
    },
    /// A speed that the board does not offer.
    #[error("baud rate {asked} is not offered: choose 115200 to {max}")]
    Baud {
        /// What was asked for.
        asked: u32,
        /// The board's fastest.
        max: u32,
    },
    /// The server would send other frames.
    #[error(
        "the board set up frames of another length than the configuration has: its version and this program do not fit"
    )]
    OtherFrames,
    /// The line is gone.
    #[error("the connection is lost ({0}): waiting for the board to come back")]
    LineLost(String),
}
