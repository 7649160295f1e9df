//! A minimal board, written from the protocol and apart from the program's own simulation of one.

use std::time::{Duration, Instant};

use serde_json::Value;

/// Answers commands, and sends results while it streams.
#[derive(Default)]
pub struct TinyBoard {
    period: Duration,
    samples: u64,
    next: Option<Instant>,
    count: u32,
}

impl TinyBoard {
    /// The answer to a command's line.
    pub fn answer(&mut self, line: &[u8]) -> Vec<u8> {
        let command: Value = serde_json::from_slice(line).unwrap();
        let config = &command["groups"][0][0]["config"];
        let answer = match command["cmd"].as_str().unwrap() {
            "get_system_info" => r#"{"status":"ok","system_info":{"rss_version":"a121-v1.12.0","sensor":"a121",
                "sensor_count":1,"ticks_per_second":1000000,"hw":"tiny"}}"#
                .replace('\n', " "),
            "get_sensor_info" => r#"{"status":"ok","sensor_info":[{"connected":true}]}"#.to_owned(),
            "setup" => {
                let points = config["subsweeps"][0]["num_points"].as_u64().unwrap();
                self.period = Duration::from_secs_f64(1.0 / config["frame_rate"].as_f64().unwrap());
                self.samples = points * config["sweeps_per_frame"].as_u64().unwrap();
                let samples = self.samples;
                format!(
                    "{{\"status\":\"ok\",\"tick_period\":0,\"metadata\":[[{{\"frame_data_length\":{samples},\
                     \"sweep_data_length\":{points},\"base_step_length_m\":0.0025}}]],\"calibration_info\":\
                     [{{\"sensor_id\":1,\"temperature\":25,\"data\":\"00ff\"}}]}}"
                )
            }
            "start_streaming" => {
                self.next = Some(Instant::now());
                r#"{"status":"start"}"#.to_owned()
            }
            _ => {
                self.next = None;
                r#"{"status":"stop"}"#.to_owned()
            }
        };
        (answer + "\n").into_bytes()
    }

    pub fn is_streaming(&self) -> bool {
        self.next.is_some()
    }

    /// The result that is due.
    pub fn result(&mut self) -> Option<Vec<u8>> {
        let due = self.next.filter(|at| Instant::now() >= *at)?;
        self.next = Some(due + self.period);
        self.count += 1;
        let head = format!(
            "{{\"result_info\":[[{{\"tick\":{},\"data_saturated\":false,\"temperature\":25,\
             \"calibration_needed\":false,\"frame_delayed\":false}}]],\"status\":\"ok\",\"payload_size\":{}}}\n",
            self.count * self.period.as_micros() as u32,
            4 * self.samples
        );
        let payload = (0..2 * self.samples).flat_map(|n| (n as i16).to_le_bytes());
        Some(head.into_bytes().into_iter().chain(payload).collect())
    }
}
