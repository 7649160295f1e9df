//! Commands of the exploration protocol: one line of JSON each.

use serde_json::{Map, Value, json};

use super::Version;
use crate::{SensorConfig, Subsweep};

/// One sensor of a group and its configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorSetup {
    /// Sensor on the board, from 1.
    pub sensor_id: u32,
    /// A valid configuration, see [`SensorConfig::validate`].
    pub config: SensorConfig,
}

/// A sensor's calibration as the server sent it. Sending it back saves the next set-up a
/// calibration.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Calibration {
    /// Sensor on the board, from 1.
    pub sensor_id: u32,
    /// Chip temperature at calibration, °C.
    #[serde(default, skip_serializing)]
    pub temperature: Option<f64>,
    /// The server's own text, not interpreted.
    pub data: String,
}

/// What to measure: groups run one after the other, the sensors of a group at the same time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Setup {
    /// `[group][sensor]`.
    pub groups: Vec<Vec<SensorSetup>>,
    /// Results per second, timed by the server; excludes `frame_rate` in the configurations.
    pub update_rate_hz: Option<f64>,
    /// Calibrations to reuse.
    pub calibrations: Vec<Calibration>,
}

impl Setup {
    /// One sensor alone.
    pub fn single(sensor_id: u32, config: SensorConfig) -> Self {
        Self { groups: vec![vec![SensorSetup { sensor_id, config }]], ..Default::default() }
    }

    /// All sensors, group by group.
    pub fn sensors(&self) -> impl Iterator<Item = &SensorSetup> {
        self.groups.iter().flatten()
    }
}

/// First version whose server knows the key `iq_imbalance_compensation`.
const IQ_IMBALANCE_SINCE: Version = Version::development(1, 9, 1, 84);

/// A command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command<'a> {
    /// Asks for board, version and tick rate.
    GetSystemInfo,
    /// Asks which sensors are connected.
    GetSensorInfo,
    /// Sets the baud rate of the serial line, valid after the reply.
    SetUartBaudrate(u32),
    /// Sets up the measurement, for a server of this version.
    Setup(&'a Setup, Version),
    /// Starts streaming.
    StartStreaming,
    /// Stops streaming.
    StopStreaming,
}

impl Command<'_> {
    /// The command as a line, with its newline.
    pub fn to_bytes(self) -> Vec<u8> {
        let message = match self {
            Self::GetSystemInfo => json!({"cmd": "get_system_info"}),
            Self::GetSensorInfo => json!({"cmd": "get_sensor_info"}),
            Self::SetUartBaudrate(baud) => json!({"cmd": "set_uart_baudrate", "baudrate": baud}),
            Self::Setup(setup, version) => setup_message(setup, version),
            Self::StartStreaming => json!({"cmd": "start_streaming"}),
            Self::StopStreaming => json!({"cmd": "stop_streaming"}),
        };
        let mut line = message.to_string().into_bytes();
        line.push(b'\n');
        line
    }
}

fn setup_message(setup: &Setup, version: Version) -> Value {
    let sensor = |s: &SensorSetup| json!({"sensor_id": s.sensor_id, "config": config_message(&s.config, version)});
    let groups: Vec<Vec<Value>> = setup.groups.iter().map(|group| group.iter().map(sensor).collect()).collect();
    let mut message = json!({"cmd": "setup", "groups": groups});
    if let Some(rate) = setup.update_rate_hz {
        message["update_rate"] = json!(rate);
    }
    if !setup.calibrations.is_empty() {
        message["calibration_info"] = json!(setup.calibrations);
    }
    message
}

/// A configuration as the protocol writes it: same names and enumerations, but 0 for "no rate".
fn config_message(config: &SensorConfig, version: Version) -> Value {
    json!({
        "sweeps_per_frame": config.sweeps_per_frame,
        "sweep_rate": config.sweep_rate.unwrap_or(0.0),
        "frame_rate": config.frame_rate.unwrap_or(0.0),
        "continuous_sweep_mode": config.continuous_sweep_mode,
        "double_buffering": config.double_buffering,
        "inter_frame_idle_state": config.inter_frame_idle_state,
        "inter_sweep_idle_state": config.inter_sweep_idle_state,
        "subsweeps": config.subsweeps.iter().map(|s| subsweep_message(s, version)).collect::<Vec<_>>(),
    })
}

fn subsweep_message(subsweep: &Subsweep, version: Version) -> Value {
    let mut message = Map::new();
    let mut put = |key: &str, value: Value| message.insert(key.to_owned(), value);
    put("start_point", json!(subsweep.start_point));
    put("num_points", json!(subsweep.num_points));
    put("step_length", json!(subsweep.step_length));
    put("profile", json!(u8::from(subsweep.profile)));
    put("hwaas", json!(subsweep.hwaas));
    put("receiver_gain", json!(subsweep.receiver_gain));
    put("enable_tx", json!(subsweep.enable_tx));
    put("enable_loopback", json!(subsweep.enable_loopback));
    put("phase_enhancement", json!(subsweep.phase_enhancement));
    if version >= IQ_IMBALANCE_SINCE {
        put("iq_imbalance_compensation", json!(subsweep.iq_imbalance_compensation));
    }
    put("prf", json!(subsweep.prf));
    Value::Object(message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PRESETS, preset};

    const NEW: Version = Version::release(1, 12, 0);

    fn sent(command: Command) -> Value {
        let bytes = command.to_bytes();
        let (end, line) = bytes.split_last().unwrap();
        assert!(*end == b'\n' && !line.contains(&b'\n'));
        serde_json::from_slice(line).unwrap()
    }

    #[test]
    fn plain_commands_match_the_protocol() {
        assert_eq!(Command::GetSystemInfo.to_bytes(), b"{\"cmd\":\"get_system_info\"}\n");
        assert_eq!(sent(Command::GetSensorInfo), json!({"cmd": "get_sensor_info"}));
        assert_eq!(sent(Command::SetUartBaudrate(2_000_000)), json!({"cmd": "set_uart_baudrate", "baudrate": 2000000}));
        assert_eq!(sent(Command::StartStreaming), json!({"cmd": "start_streaming"}));
        assert_eq!(sent(Command::StopStreaming), json!({"cmd": "stop_streaming"}));
    }

    #[test]
    fn setup_message_round_trips_the_configuration() {
        for name in PRESETS {
            let config = preset(name).unwrap();
            let message = sent(Command::Setup(&Setup::single(1, config.clone()), NEW));
            let mut said = message["groups"][0][0]["config"].clone();
            assert_eq!(message["groups"][0][0]["sensor_id"], 1);
            let prf = if name == "far" { "13_0_MHz" } else { "15_6_MHz" };
            assert_eq!(said["subsweeps"][0]["prf"], prf);
            assert_eq!(said["inter_frame_idle_state"], "ready");
            assert_eq!(said["subsweeps"][0].as_object().unwrap().len(), 11);
            assert_eq!(said["sweep_rate"], 0.0);
            said["sweep_rate"] = Value::Null;
            assert_eq!(serde_json::from_value::<SensorConfig>(said).unwrap(), config);
            assert!(message.get("update_rate").is_none() && message.get("calibration_info").is_none());
        }
    }

    #[test]
    fn old_servers_do_not_get_unknown_keys() {
        let setup = Setup::single(1, preset("d16").unwrap());
        let message = sent(Command::Setup(&setup, Version::development(1, 9, 1, 83)));
        assert!(message["groups"][0][0]["config"]["subsweeps"][0].get("iq_imbalance_compensation").is_none());
        let message = sent(Command::Setup(&setup, IQ_IMBALANCE_SINCE));
        assert_eq!(message["groups"][0][0]["config"]["subsweeps"][0]["iq_imbalance_compensation"], false);
    }

    #[test]
    fn setup_message_has_groups_rate_and_calibrations() {
        let sensor = |sensor_id| SensorSetup { sensor_id, config: SensorConfig::default() };
        let setup = Setup {
            groups: vec![vec![sensor(1), sensor(2)], vec![sensor(3)]],
            update_rate_hz: Some(50.0),
            calibrations: vec![Calibration { sensor_id: 2, temperature: Some(30.0), data: "abc".into() }],
        };
        let message = sent(Command::Setup(&setup, NEW));
        assert_eq!(message["groups"][0].as_array().unwrap().len(), 2);
        assert_eq!(message["groups"][1][0]["sensor_id"], 3);
        assert_eq!(message["update_rate"], 50.0);
        assert_eq!(message["calibration_info"], json!([{"sensor_id": 2, "data": "abc"}]));
    }
}
