//! Replies of the server: parses the JSON line that precedes every payload.

use serde::Deserialize;

use super::Calibration;

/// The board and its software.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SystemInfo {
    /// The software's version, see [`super::Version::parse`].
    pub rss_version: String,
    /// Type of the sensor: `a121`.
    pub sensor: Option<String>,
    /// Number of sensor connectors.
    pub sensor_count: u32,
    /// Ticks of the board's clock per second.
    pub ticks_per_second: u32,
    /// Name of the board, such as `xc120`.
    pub hw: Option<String>,
    /// Highest baud rate of the serial line, if it has one.
    pub max_baudrate: Option<u32>,
}

/// One sensor connector.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SensorInfo {
    /// Whether a sensor is connected.
    pub connected: bool,
    /// Its serial number.
    pub serial: Option<String>,
}

/// The server's metadata of one sensor's configuration.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SensorMetadata {
    /// Samples in a frame.
    pub frame_data_length: u64,
    /// Samples in a sweep.
    pub sweep_data_length: u64,
    /// Chip temperature at calibration, °C.
    pub calibration_temperature: Option<f64>,
    /// Distance between points at step length 1, metres.
    pub base_step_length_m: Option<f64>,
    /// Highest sweep rate by the server's calculation, Hz.
    pub max_sweep_rate: Option<f64>,
    /// Whether the sensor's high-speed mode is in use.
    pub high_speed_mode: Option<bool>,
}

/// Reply to a set-up.
#[derive(Debug, Clone, PartialEq)]
pub struct SetupReply {
    /// Ticks between results, 0 without an update rate.
    pub tick_period: u32,
    /// `[group][sensor]`, in the order of the set-up.
    pub metadata: Vec<Vec<SensorMetadata>>,
    /// Calibrations, for reuse.
    pub calibrations: Vec<Calibration>,
}

/// Metadata of one sensor's frame. Every field is required, so that a damaged key is noticed.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct ResultInfo {
    /// The board's clock at the END of the measurement; wraps.
    pub tick: u32,
    /// Whether a sample hit the limit of the converter.
    pub data_saturated: bool,
    /// Chip temperature, °C.
    pub temperature: i16,
    /// Whether the sensor requests a calibration.
    pub calibration_needed: bool,
    /// Whether the sensor could not keep its rate.
    pub frame_delayed: bool,
}

/// A line of the server's log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogLine {
    /// Level: `error`, `warning`, `info` …
    pub level: String,
    /// Module of the server.
    pub module: String,
    /// The message.
    pub text: String,
}

/// Anything but a result.
#[derive(Debug, Clone, PartialEq)]
pub enum Reply {
    /// To `get_system_info`.
    System(SystemInfo),
    /// To `get_sensor_info`; index 0 is sensor 1.
    Sensors(Vec<SensorInfo>),
    /// To `setup`.
    Setup(SetupReply),
    /// To a command without a specific reply.
    Ok,
    /// Streaming started.
    Started,
    /// Streaming stopped.
    Stopped,
    /// A log line; may come at any time.
    Log(LogLine),
    /// The server refuses; its message.
    Error(String),
    /// The server ended the session.
    SessionEnded,
}

/// A parsed line.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Header {
    Reply(Reply),
    /// Metadata as `[group][sensor]`, and the size of the payload that follows, bytes.
    Result(Vec<Vec<ResultInfo>>, u64),
}

/// The line as JSON; the fields that are present determine its type.
#[derive(Deserialize)]
struct Line {
    status: String,
    #[serde(default)]
    payload_size: u64,
    result_info: Option<Vec<Vec<ResultInfo>>>,
    system_info: Option<SystemInfo>,
    sensor_info: Option<Vec<SensorInfo>>,
    tick_period: Option<u32>,
    metadata: Option<Vec<Vec<SensorMetadata>>>,
    calibration_info: Option<Vec<Calibration>>,
    message: Option<String>,
    level: Option<String>,
    module: Option<String>,
    log: Option<String>,
}

impl Header {
    /// Parses a line without its newline; `None` if it is not part of the protocol.
    pub fn parse(line: &[u8]) -> Option<Self> {
        let line: Line = serde_json::from_slice(line).ok()?;
        if line.status == "ok"
            && let Some(info) = line.result_info
        {
            let ended = info.is_empty() && line.payload_size == 0;
            return Some(if ended { Self::Reply(Reply::SessionEnded) } else { Self::Result(info, line.payload_size) });
        }
        // Only results have a payload.
        (line.payload_size == 0).then_some(())?;
        let reply = match line.status.as_str() {
            "ok" => match (line.system_info, line.sensor_info, line.metadata) {
                (Some(info), None, None) => Reply::System(info),
                (None, Some(sensors), None) => Reply::Sensors(sensors),
                (None, None, Some(metadata)) => Reply::Setup(SetupReply {
                    tick_period: line.tick_period?,
                    metadata,
                    calibrations: line.calibration_info.unwrap_or_default(),
                }),
                (None, None, None) => Reply::Ok,
                _ => return None,
            },
            "start" => Reply::Started,
            "stop" => Reply::Stopped,
            "log" => Reply::Log(LogLine {
                level: line.level.unwrap_or_default(),
                module: line.module.unwrap_or_default(),
                text: line.log.unwrap_or_default(),
            }),
            "error" => Reply::Error(line.message.unwrap_or_default()),
            _ => return None,
        };
        Some(Self::Reply(reply))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reply(line: &str) -> Reply {
        match Header::parse(line.as_bytes()) {
            Some(Header::Reply(reply)) => reply,
            other => panic!("{line}: {other:?}"),
        }
    }

    #[test]
    fn replies_are_distinguished() {
        let system = r#"{"status":"ok","system_info":{"rss_version":"a121-v1.12.0","sensor":"a121","sensor_count":5,
            "ticks_per_second":1000000,"hw":"xc120","max_baudrate":3000000}}"#;
        assert!(matches!(reply(system), Reply::System(info) if info.max_baudrate == Some(3_000_000)));
        let old = r#"{"status":"ok","system_info":{"rss_version":"a121-v0.4.1","sensor":"a121","sensor_count":1,
            "ticks_per_second":1000},"unknown":[1,{}]}"#;
        assert!(matches!(reply(old), Reply::System(info) if info.hw.is_none() && info.ticks_per_second == 1000));
        let sensors = r#"{"status":"ok","sensor_info":[{"connected":true,"serial":"X1"},{"connected":false}]}"#;
        assert!(matches!(reply(sensors), Reply::Sensors(s) if s.len() == 2 && s[0].connected && !s[1].connected));
        let setup = r#"{"status":"ok","tick_period":0,"payload_size":0,"metadata":[[{"frame_data_length":800,
            "sweep_data_length":50,"subsweep_data_offset":[0],"subsweep_data_length":[50],"calibration_temperature":25,
            "base_step_length_m":0.0025,"max_sweep_rate":1120.5}]],
            "calibration_info":[{"sensor_id":1,"temperature":25,"data":"00ff"}]}"#;
        let Reply::Setup(setup) = reply(setup) else { panic!() };
        assert_eq!((setup.metadata[0][0].frame_data_length, setup.calibrations[0].data.as_str()), (800, "00ff"));
        assert_eq!(reply(r#"{"status":"ok"}"#), Reply::Ok);
        assert_eq!(reply(r#"{"status":"start"}"#), Reply::Started);
        assert_eq!(reply(r#"{"status":"stop","payload_size":0}"#), Reply::Stopped);
        assert_eq!(reply(r#"{"status":"error","message":"no"}"#), Reply::Error("no".into()));
        assert_eq!(reply(r#"{"status":"ok","result_info":[],"payload_size":0}"#), Reply::SessionEnded);
        let log = r#"{"status":"log","level":"info","timestamp":12,"module":"m","log":"l"}"#;
        assert_eq!(reply(log), Reply::Log(LogLine { level: "info".into(), module: "m".into(), text: "l".into() }));
    }

    #[test]
    fn non_protocol_lines_are_rejected() {
        let result = r#"{"result_info":[[{"tick":5,"data_saturated":false,"temperature":-3,"calibration_needed":false,
            "frame_delayed":true}]],"status":"ok","payload_size":4}"#;
        assert!(
            matches!(Header::parse(result.as_bytes()), Some(Header::Result(info, 4)) if info[0][0].temperature == -3)
        );
        let replacements = [
            ("\"tick\"", "\"tock\""),
            ("5,", "4294967296,"),
            ("5,", "-5,"),
            ("-3", "-40000"),
            ("true", "ture"),
            ("frame_delayed", "frame_delayfd"),
            ("\"ok\"", "\"oj\""),
            ("\"payload_size\":4", "\"payload_size\":-4"),
            ("\"payload_size\":4", "\"payload_size\":4,\"payload_size\":4"),
            ("result_info", "resultinfo"),
        ];
        for (old, new) in replacements {
            let damaged = result.replacen(old, new, 1);
            assert_ne!(damaged, result);
            assert_eq!(Header::parse(damaged.as_bytes()), None, "{damaged}");
        }
        assert_eq!(Header::parse(br#"{"status":"stop","payload_size":9}"#), None);
        assert_eq!(Header::parse(b"{}"), None);
        assert_eq!(Header::parse("[".repeat(10_000).as_bytes()), None);
    }
}
