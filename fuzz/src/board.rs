//! A correct board, and set-ups for it. Written from the protocol, independently of the code under
//! test.

use a121::{IdleState, SensorConfig, Subsweep};
use a121::{SensorSetup, Setup};

/// Ticks of the board's clock per second.
pub const TICKS_PER_SECOND: u32 = 1_000_000;

fn config(sweeps_per_frame: u32, num_points: u32) -> SensorConfig {
    SensorConfig {
        sweeps_per_frame,
        inter_frame_idle_state: IdleState::Ready,
        subsweeps: vec![Subsweep { num_points, ..Default::default() }],
        ..Default::default()
    }
}

/// One of four set-ups: one sensor; two groups; an update rate; a single sample.
pub fn setup(choice: u8) -> Setup {
    let sensor = |sensor_id, config| SensorSetup { sensor_id, config };
    match choice % 4 {
        0 => Setup::single(1, SensorConfig { frame_rate: Some(50.0), ..config(2, 5) }),
        1 => Setup {
            groups: vec![vec![sensor(1, config(1, 3)), sensor(2, config(2, 2))], vec![sensor(1, config(1, 7))]],
            ..Default::default()
        },
        2 => Setup { update_rate_hz: Some(20.0), ..Setup::single(2, config(1, 30)) },
        _ => Setup::single(1, config(1, 1)),
    }
}

/// Samples per frame, `[group][sensor]`.
pub fn samples(setup: &Setup) -> Vec<Vec<usize>> {
    let points = |s: &SensorSetup| {
        s.config.subsweeps.iter().map(|s| s.num_points as usize).sum::<usize>() * s.config.sweeps_per_frame as usize
    };
    setup.groups.iter().map(|group| group.iter().map(points).collect()).collect()
}

/// A result with these ticks and flags; every byte of its payload is `fill`.
pub fn result(setup: &Setup, tick: u32, flags: u8, fill: u8) -> Vec<u8> {
    let flag = |bit: u8| flags >> bit & 1 == 1;
    let info = format!(
        "{{\"tick\":{tick},\"data_saturated\":{},\"temperature\":31,\"calibration_needed\":{},\"frame_delayed\":{}}}",
        flag(0),
        flag(1),
        flag(2)
    );
    let groups: Vec<String> =
        setup.groups.iter().map(|group| format!("[{}]", vec![info.clone(); group.len()].join(","))).collect();
    let bytes = 4 * samples(setup).iter().flatten().sum::<usize>();
    let line = format!("{{\"result_info\":[{}],\"status\":\"ok\",\"payload_size\":{bytes}}}\n", groups.join(","));
    [line.into_bytes(), vec![fill; bytes]].concat()
}

/// State of a board.
pub struct Board {
    pub setup: Setup,
    pub streaming: bool,
    pub baud: u32,
    pub is_serial: bool,
}

impl Board {
    pub fn new(setup: Setup, is_serial: bool) -> Self {
        Self { setup, streaming: false, baud: 115_200, is_serial }
    }

    /// Resets the board, as a break or a new connection does.
    pub fn reset(&mut self) {
        (self.streaming, self.baud) = (false, 115_200);
    }

    /// The reply to a command.
    pub fn answer(&mut self, command: &[u8]) -> Vec<u8> {
        let text = std::str::from_utf8(command).expect("commands are text");
        assert!(text.ends_with('\n') && text.trim_end().lines().count() == 1, "a command is a line: {text}");
        let has = |name: &str| text.contains(&format!("\"{name}\""));
        let answer = if has("get_system_info") {
            let baud = if self.is_serial { ",\"max_baudrate\":2000000" } else { "" };
            format!(
                "{{\"status\":\"ok\",\"system_info\":{{\"rss_version\":\"a121-v1.12.0\",\"sensor\":\"a121\",\
                 \"sensor_count\":5,\"ticks_per_second\":{TICKS_PER_SECOND}{baud}}}}}"
            )
        } else if has("get_sensor_info") {
            "{\"status\":\"ok\",\"sensor_info\":[{\"connected\":true},{\"connected\":true}]}".into()
        } else if has("set_uart_baudrate") {
            self.baud = 2_000_000;
            "{\"status\":\"ok\"}".into()
        } else if has("setup") {
            let samples = samples(&self.setup);
            let metadata = samples.iter().map(|group| {
                let sensors: Vec<String> = group
                    .iter()
                    .map(|samples| format!("{{\"frame_data_length\":{samples},\"sweep_data_length\":{samples}}}"))
                    .collect();
                format!("[{}]", sensors.join(","))
            });
            let metadata = metadata.collect::<Vec<_>>().join(",");
            format!(
                "{{\"status\":\"ok\",\"tick_period\":0,\"payload_size\":0,\"metadata\":[{metadata}],\
                 \"calibration_info\":[{{\"sensor_id\":1,\"temperature\":25,\"data\":\"0011\"}}]}}"
            )
        } else if has("start_streaming") {
            self.streaming = true;
            "{\"status\":\"start\"}".into()
        } else if has("stop_streaming") {
            self.streaming = false;
            "{\"status\":\"stop\"}".into()
        } else {
            panic!("an unknown command: {text}")
        };
        format!("{answer}\n").into_bytes()
    }
}
