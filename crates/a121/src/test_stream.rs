//! Server messages for the tests of this module, written by hand and not by the code under test.

use super::{ResultInfo, Setup};
use crate::{SensorConfig, Subsweep, preset};

/// A set-up with 40 samples per frame, otherwise the default preset.
pub(super) fn small_setup() -> Setup {
    let d16 = preset("d16").expect("a preset");
    let subsweeps = vec![Subsweep { num_points: 10, ..d16.subsweeps[0] }];
    Setup::single(1, SensorConfig { sweeps_per_frame: 4, subsweeps, ..d16 })
}

/// The bytes of a result of one sensor.
pub(super) fn result_bytes(info: &ResultInfo, payload: &[u8]) -> Vec<u8> {
    let line = format!(
        "{{\"result_info\":[[{{\"tick\":{},\"data_saturated\":{},\"temperature\":{},\"calibration_needed\":{},\
         \"frame_delayed\":{}}}]],\"status\":\"ok\",\"payload_size\":{}}}\n",
        info.tick,
        info.data_saturated,
        info.temperature,
        info.calibration_needed,
        info.frame_delayed,
        payload.len()
    );
    [line.as_bytes(), payload].concat()
}

/// A transmission fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// A byte is lost.
    Lose,
    /// A byte is doubled.
    Double,
    /// These bits of a byte are flipped.
    Flip(u8),
}

/// A result as the board sent it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sent {
    pub info: ResultInfo,
    /// End of its measurement, host nanoseconds.
    pub end_ns: i64,
    pub payload: Vec<u8>,
    /// Its fault, and the byte that it hit.
    pub fault: Option<(Fault, usize)>,
}

/// A simulated board with its own protocol state machine, and the faults that a test asks for.
pub(super) struct TestBoard {
    pub rss_version: String,
    pub max_baudrate: Option<u32>,
    pub ticks_per_second: u32,
    pub connected: bool,
    pub baud: u32,
    pub streaming: bool,
    /// The board sends nothing.
    pub dead: bool,
    /// Command that the board refuses with an error.
    pub refuses: Option<&'static str>,
    pub calibration_needed: bool,
    pub first_tick: u64,
    pub frames: Vec<Sent>,
    pub commands: Vec<serde_json::Value>,
    pub period_ns: i64,
    pub next_frame_ns: i64,
    pub setups: u32,
}

impl TestBoard {
    pub fn new() -> Self {
        Self {
            rss_version: "a121-v1.12.0".into(),
            max_baudrate: Some(2_000_000),
            ticks_per_second: 1_000_000,
            connected: true,
            baud: 115_200,
            streaming: false,
            dead: false,
            refuses: None,
            calibration_needed: false,
            first_tick: 5_000_000,
            frames: Vec::new(),
            commands: Vec::new(),
            period_ns: 15_151_515,
            next_frame_ns: i64::MAX,
            setups: 0,
        }
    }

    /// Resets the board, as a break does.
    pub fn reset(&mut self) {
        (self.baud, self.streaming, self.next_frame_ns) = (115_200, false, i64::MAX);
    }

    /// Answers one command.
    pub fn answer(&mut self, line: &[u8], now_ns: i64) -> Vec<u8> {
        let command: serde_json::Value = serde_json::from_slice(line).expect("a command is JSON");
        let name = command["cmd"].as_str().expect("a command has a name").to_owned();
        self.commands.push(command.clone());
        if self.dead {
            return Vec::new();
        }
        if self.refuses == Some(name.as_str()) {
            return b"{\"status\":\"error\",\"message\":\"I do not want to\"}\n".to_vec();
        }
        let text = match name.as_str() {
            "get_system_info" => format!(
                "{{\"status\":\"ok\",\"system_info\":{{\"rss_version\":\"{}\",\"sensor\":\"a121\",\"sensor_count\":2,\
                 \"ticks_per_second\":{}{}}}}}\n",
                self.rss_version,
                self.ticks_per_second,
                self.max_baudrate.map_or(String::new(), |max| format!(",\"max_baudrate\":{max}"))
            ),
            "get_sensor_info" => format!(
                "{{\"status\":\"ok\",\"sensor_info\":[{{\"connected\":{},\"serial\":null}},\
                 {{\"connected\":false}}]}}\n",
                self.connected
            ),
            "set_uart_baudrate" => "{\"status\":\"ok\"}\n".into(),
            "setup" => {
                self.setups += 1;
                let config = &command["groups"][0][0]["config"];
                let points = config["subsweeps"][0]["num_points"].as_u64().expect("points");
                let sweeps = config["sweeps_per_frame"].as_u64().expect("sweeps");
                format!(
                    "{{\"status\":\"ok\",\"tick_period\":0,\"payload_size\":0,\"metadata\":[[{{\
                     \"frame_data_length\":{},\
                     \"sweep_data_length\":{points}}}]],\"calibration_info\":[{{\"sensor_id\":1,\"temperature\":25,\
                     \"data\":\"cal{}\"}}]}}\n",
                    points * sweeps,
                    self.setups
                )
            }
            "start_streaming" => {
                (self.streaming, self.next_frame_ns) = (true, now_ns + self.period_ns);
                "{\"status\":\"start\"}\n".into()
            }
            "stop_streaming" => {
                (self.streaming, self.next_frame_ns) = (false, i64::MAX);
                "{\"status\":\"stop\"}\n".into()
            }
            _ => "{\"status\":\"error\",\"message\":\"unknown command\"}\n".into(),
        };
        if let Some(baud) = command["baudrate"].as_u64() {
            self.baud = baud as u32;
        }
        text.into_bytes()
    }

    /// The bytes of the frame that ends now; the samples differ between frames.
    pub fn frame(&mut self, fault: impl FnOnce(usize) -> Option<(Fault, usize)>) -> Vec<u8> {
        let end_ns = self.next_frame_ns;
        self.next_frame_ns += self.period_ns;
        let ticks = i128::from(end_ns) * i128::from(self.ticks_per_second) / 1_000_000_000;
        let info = ResultInfo {
            tick: (u128::from(self.first_tick) + ticks as u128) as u32,
            data_saturated: self.frames.len().is_multiple_of(3),
            temperature: 20 + (self.frames.len() % 20) as i16,
            calibration_needed: self.calibration_needed,
            frame_delayed: false,
        };
        let mut state = self.frames.len() as u32;
        let noise = (0..160).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        let payload: Vec<u8> = noise.collect();
        let mut bytes = result_bytes(&info, &payload);
        let fault = fault(bytes.len());
        match fault {
            Some((Fault::Lose, at)) => drop(bytes.remove(at)),
            Some((Fault::Double, at)) => bytes.insert(at, bytes[at]),
            Some((Fault::Flip(bits), at)) => bytes[at] ^= bits,
            None => {}
        }
        self.frames.push(Sent { info, end_ns, payload, fault });
        bytes
    }
}
