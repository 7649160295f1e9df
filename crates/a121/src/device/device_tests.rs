//! Tests of the simulated board against the protocol, with messages written by hand.

use serde_json::{Value, json};

use super::*;

const S: i64 = 1_000_000_000;

/// A board and its client.
struct Bench {
    device: Device,
    now_ns: i64,
    heard: Vec<u8>,
    /// For each piece: arrival (host ns), bytes, baud rate.
    pieces: Vec<(i64, usize, Option<u32>)>,
    plugs: Vec<Output>,
}

impl Bench {
    fn new(board: Board) -> Self {
        Self::with_faults(board, "")
    }

    fn with_faults(board: Board, plan: &str) -> Self {
        let plan = FaultPlan::parse(plan).unwrap();
        let mut device = Device::new(board, Box::new(TickSeededNoise), plan, 5, 10 * S);
        device.record_sent();
        Self { device, now_ns: 10 * S, heard: Vec::new(), pieces: Vec::new(), plugs: Vec::new() }
    }

    fn run_s(&mut self, seconds: f64) {
        let end_ns = self.now_ns + (seconds * 1e9) as i64;
        while self.device.next_ns() <= end_ns {
            self.now_ns = self.now_ns.max(self.device.next_ns());
            let mut out = Vec::new();
            self.device.poll(self.now_ns, &mut out);
            for output in out {
                match output {
                    Output::Bytes { bytes, baud } => {
                        self.pieces.push((self.now_ns, bytes.len(), baud));
                        self.heard.extend(bytes);
                    }
                    plug => self.plugs.push(plug),
                }
            }
        }
        self.now_ns = end_ns;
    }

    /// Sends a command and returns the first reply within 0.5 s that is not a log line.
    fn ask(&mut self, command: Value) -> Value {
        self.heard.clear();
        self.device.receive(format!("{command}\n").as_bytes(), self.now_ns);
        self.run_s(0.5);
        let lines: Vec<Value> =
            self.heard.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
        lines.into_iter().find(|line: &Value| line["status"] != "log").unwrap_or(Value::Null)
    }

    fn set_up(&mut self, frame_rate: f64) -> Value {
        let subsweep = json!({"start_point": 80, "num_points": 10, "step_length": 24, "profile": 3, "hwaas": 16,
            "phase_enhancement": true, "prf": "15_6_MHz"});
        let config = json!({"sweeps_per_frame": 4, "sweep_rate": 0.0, "frame_rate": frame_rate,
            "inter_frame_idle_state": "ready", "inter_sweep_idle_state": "ready", "subsweeps": [subsweep]});
        self.ask(json!({"cmd": "setup", "groups": [[{"sensor_id": 1, "config": config}]]}))
    }

    fn start(&mut self) -> Value {
        self.ask(json!({"cmd": "start_streaming"}))
    }
}

#[test]
fn commands_are_answered_by_the_protocol() {
    let mut bench = Bench::new(Board::Xm125);
    let info = &bench.ask(json!({"cmd": "get_system_info"}))["system_info"];
    assert_eq!((&info["sensor"], &info["ticks_per_second"]), (&json!("a121"), &json!(1000)));
    assert_eq!(info["max_baudrate"], 2_000_000);
    assert_eq!(bench.ask(json!({"cmd": "get_sensor_info"}))["sensor_info"][0]["connected"], true);
    assert_eq!(bench.ask(json!({"cmd": "set_uart_baudrate", "baudrate": 3_000_000}))["status"], "error");
    assert_eq!(bench.device.baud(), Some(115_200));
    assert_eq!(bench.ask(json!({"cmd": "set_uart_baudrate", "baudrate": 1_000_000}))["status"], "ok");
    assert_eq!(bench.device.baud(), Some(1_000_000));
    // The reply itself has the old baud rate.
    assert_eq!(bench.pieces.last().unwrap().2, Some(115_200));
    assert_eq!(bench.start()["message"], "not set up");
    let reply = bench.set_up(66.0);
    assert_eq!((&reply["status"], &reply["tick_period"]), (&json!("ok"), &json!(0)));
    assert_eq!(reply["metadata"][0][0]["frame_data_length"], 40);
    assert_eq!(reply["calibration_info"][0]["sensor_id"], 1);
    assert_eq!(bench.start()["status"], "start");
    assert_eq!(bench.ask(json!({"cmd": "get_system_info"}))["message"], "streaming");
    bench.device.receive_break();
    assert!(!bench.device.is_streaming() && bench.device.baud() == Some(115_200));
    let none = Bench::new(Board::Xc120).ask(json!({"cmd": "get_system_info"}));
    assert!(none["system_info"].get("max_baudrate").is_none());
}

#[test]
fn invalid_commands_are_refused() {
    let mut bench = Bench::new(Board::Xc120);
    let refused = |bench: &mut Bench, command: Value, says: &str| {
        let answer = bench.ask(command);
        assert!(answer["status"] == "error" && answer["message"].as_str().unwrap().contains(says), "{answer}");
    };
    let setup = |id: u32, points: u32| {
        let config = json!({"subsweeps": [{"num_points": points}]});
        json!({"cmd": "setup", "groups": [[{"sensor_id": id, "config": config}]]})
    };
    refused(&mut bench, setup(1, 5000), "num_points");
    refused(&mut bench, setup(3, 50), "sensor 3 is not connected");
    refused(&mut bench, json!({"cmd": "setup", "groups": []}), "no sensors");
    let mut with = setup(1, 50);
    with["calibration_info"] = json!([{"sensor_id": 1, "data": "00ff"}]);
    refused(&mut bench, with, "calibration");
    let mut with = setup(1, 50);
    with["update_rate"] = json!(-1.0);
    refused(&mut bench, with, "update_rate");
    refused(&mut bench, json!({"cmd": "dance"}), "unknown command");
    refused(&mut bench, json!("x".repeat(100_000)), "not a command");
    bench.heard.clear();
    bench.device.receive(b"\xff\x00{{\n", bench.now_ns);
    bench.run_s(0.1);
    assert!(bench.heard.starts_with(b"{\"message\":\"not a command\""));
}

#[test]
fn frames_have_the_rate_rising_ticks_and_own_samples() {
    let mut bench = Bench::new(Board::Xc120);
    bench.set_up(66.0);
    bench.start();
    bench.run_s(10.0);
    let sent = bench.device.take_sent();
    assert!((685..=695).contains(&sent.len()), "{}", sent.len());
    for pair in sent.windows(2) {
        let step = pair[1].infos[0].tick.wrapping_sub(pair[0].infos[0].tick);
        assert!((i64::from(step) - 15_152).abs() < 15, "{step}");
        let true_step_ns = pair[1].ends_ns[0] - pair[0].ends_ns[0];
        assert!((true_step_ns - 15_151_515).abs() < 3_000);
        assert!(pair[0].samples != pair[1].samples && pair[0].samples.len() == 40);
        assert!(!pair[0].infos[0].frame_delayed);
    }
    let mut again = Vec::new();
    let config = crate::SensorConfig { sweeps_per_frame: 4, ..Default::default() };
    let config =
        crate::SensorConfig { subsweeps: vec![crate::Subsweep { num_points: 10, ..config.subsweeps[0] }], ..config };
    let request = FrameRequest { sensor_id: 1, config: &config, index: 0, tick: sent[7].infos[0].tick, end_ns: 0 };
    TickSeededNoise.frame(&request, &mut again);
    assert_eq!(again, sent[7].samples);
}

#[test]
fn slow_line_delays_and_marks_frames() {
    let mut bench = Bench::new(Board::Sparkfun);
    bench.set_up(66.0);
    bench.start();
    let before = bench.heard.len();
    bench.pieces.clear();
    bench.run_s(5.0);
    let bytes: usize = bench.pieces.iter().map(|(_, count, _)| count).sum();
    assert!((bytes as f64 / 5.0 / 11_520.0 - 1.0).abs() < 0.02 && before > 0, "{bytes}");
    let sent = bench.device.take_sent();
    assert!(sent[10..].iter().all(|result| result.infos[0].frame_delayed));
    // While nobody reads, nothing is measured and memory stays bounded.
    bench.device.set_blocked(true, bench.now_ns);
    bench.run_s(100.0);
    assert!(bench.device.take_sent().len() <= transmitter::KEPT_RESULTS);
    bench.device.set_blocked(false, bench.now_ns);
    bench.run_s(1.0);
    assert!(bench.device.take_sent().len() > 20);
}

#[test]
fn each_fault_has_its_effect() {
    let inject = |bench: &mut Bench, fault| {
        let mut out = Vec::new();
        bench.device.inject(fault, bench.now_ns, &mut out);
        bench.plugs.extend(out);
    };
    let streaming = || {
        let mut bench = Bench::new(Board::Xc120);
        bench.set_up(66.0);
        bench.start();
        bench.run_s(0.5);
        bench.device.take_sent();
        bench
    };
    let mut bench = streaming();
    inject(&mut bench, Fault::Saturate);
    bench.run_s(0.2);
    let saturated: Vec<_> = bench.device.take_sent().into_iter().filter(|r| r.infos[0].data_saturated).collect();
    let full = |value: i16| value == i16::MIN || value == i16::MAX;
    assert!(saturated.len() == 1 && saturated[0].samples.iter().all(|s| full(s.re) && full(s.im)));
    inject(&mut bench, Fault::Calibrate);
    bench.run_s(0.2);
    assert!(bench.device.take_sent().last().unwrap().infos[0].calibration_needed);
    bench.ask(json!({"cmd": "stop_streaming"}));
    bench.set_up(66.0);
    inject(&mut bench, Fault::Wrap);
    bench.start();
    bench.run_s(2.0);
    let ticks: Vec<u32> = bench.device.take_sent().iter().map(|r| r.infos[0].tick).collect();
    assert!(ticks.windows(2).filter(|t| t[1] < t[0]).count() == 1 && !ticks.is_empty());

    let mut bench = streaming();
    inject(&mut bench, Fault::Stall);
    bench.run_s(6.0);
    let pauses = bench.pieces.windows(2).map(|p| p[1].0 - p[0].0);
    let longest_ns = pauses.max().unwrap();
    assert!(bench.device.counters().lost > 0 && (50_000_000..5_100_000_000).contains(&longest_ns), "{longest_ns}");

    let mut bench = streaming();
    bench.pieces.clear();
    inject(&mut bench, Fault::Burst);
    bench.run_s(0.9);
    assert!(bench.pieces.iter().skip(2).all(|(at, ..)| at % 30_000_000 == 0));

    for (fault, plugs) in [(Fault::Unplug, 2), (Fault::Reboot, 0)] {
        let mut bench = streaming();
        inject(&mut bench, fault);
        bench.run_s(5.0);
        assert!(bench.plugs.len() == plugs && !bench.device.is_streaming());
        bench.set_up(66.0);
        bench.start();
        bench.run_s(0.2);
        // The tick counter restarted.
        assert!(bench.device.take_sent().last().unwrap().infos[0].tick < 7_000_000);
    }
    let mut bench = streaming();
    inject(&mut bench, Fault::Refuse);
    assert_eq!(bench.ask(json!({"cmd": "stop_streaming"}))["status"], "error");
}

#[test]
fn same_seed_gives_same_bytes_and_faults() {
    let run = || {
        let mut bench = Bench::with_faults(Board::Xm125, "flip=200,drop=100,stall=5,unplug=2,jump=10,delay=30");
        for _ in 0..20 {
            bench.set_up(66.0);
            bench.start();
            bench.run_s(1.0);
        }
        (bench.heard, bench.pieces, bench.device.counters())
    };
    let (first, second) = (run(), run());
    assert!(first == second && first.2.faults.values().sum::<u64>() > 30, "{:?}", first.2);
}
