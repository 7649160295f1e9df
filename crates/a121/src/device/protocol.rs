//! Parses commands and writes replies, as a server does. Written from the protocol, independently
//! of the session's code.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use serde_json::{Value, json};

use super::Board;
use super::stream::Timing;
use crate::{BASE_STEP_M, IdleState, Profile, SensorConfig, frame_timing};

/// One sensor of a set-up.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct SensorEntry {
    pub sensor_id: u32,
    pub config: SensorConfig,
}

#[derive(Debug, Deserialize)]
struct CalibrationEntry {
    sensor_id: u32,
    data: String,
}

/// The set-up command.
#[derive(Debug, Deserialize)]
pub(super) struct SetupCommand {
    groups: Vec<Vec<SensorEntry>>,
    update_rate: Option<f64>,
    #[serde(default)]
    calibration_info: Vec<CalibrationEntry>,
}

/// An accepted set-up.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BoardSetup {
    pub groups: Vec<Vec<SensorEntry>>,
    pub timing: Timing,
    /// Whether a sensor had to be calibrated, which takes time.
    pub calibrated: bool,
}

/// Size of a calibration, bytes. Choice: sessions must not depend on it.
const CALIBRATION_BYTES: usize = 192;
/// Chip temperature at calibration, °C. Choice: a chip a little above room temperature.
const CALIBRATION_TEMPERATURE: i32 = 31;

pub(super) fn error(message: &str) -> Value {
    json!({"status": "error", "message": message})
}

pub(super) fn system_info(board: Board) -> Value {
    let mut info = json!({
        "rss_version": "a121-v1.12.0", "sensor": "a121", "sensor_count": board.sensor_count(),
        "ticks_per_second": board.ticks_per_second(), "hw": board.hardware(),
    });
    if let Some(baud) = board.max_baudrate() {
        info["max_baudrate"] = json!(baud);
    }
    json!({"status": "ok", "system_info": info})
}

pub(super) fn sensor_info(board: Board) -> Value {
    let place = |place| match place < board.connected() {
        true => json!({"connected": true, "serial": format!("SIM-{:04}", place + 1)}),
        false => json!({"connected": false}),
    };
    json!({"status": "ok", "sensor_info": (0..board.sensor_count()).map(place).collect::<Vec<_>>()})
}

/// Checks a set-up; returns it with the reply, or the reason for refusing it.
pub(super) fn set_up(command: Value, board: Board, seed: u64) -> Result<(BoardSetup, Value), String> {
    let mut command: SetupCommand = serde_json::from_value(command).map_err(|error| error.to_string())?;
    if command.groups.is_empty() || command.groups.iter().any(Vec::is_empty) {
        return Err("no sensors configured".into());
    }
    for group in &mut command.groups {
        for index in 0..group.len() {
            let entry = &mut group[index];
            // In the protocol, 0 stands for "as fast as possible".
            entry.config.sweep_rate = entry.config.sweep_rate.filter(|rate| *rate != 0.0);
            entry.config.frame_rate = entry.config.frame_rate.filter(|rate| *rate != 0.0);
            entry.config.validate().map_err(|rule| format!("invalid config: {rule}"))?;
            let sensor_id = entry.sensor_id;
            if !(1..=board.connected()).contains(&sensor_id) {
                return Err(format!("sensor {sensor_id} is not connected"));
            }
            if group[..index].iter().any(|other| other.sensor_id == sensor_id) {
                return Err(format!("sensor {sensor_id} is configured twice in a group"));
            }
        }
    }
    if let Some(rate) = command.update_rate {
        let has_frame_rate = command.groups.iter().flatten().any(|entry| entry.config.frame_rate.is_some());
        if has_frame_rate || !(rate.is_finite() && rate > 0.0) {
            return Err("invalid update_rate".into());
        }
    }
    for known in &command.calibration_info {
        if known.data != calibration(known.sensor_id, seed) {
            return Err(format!("calibration of sensor {} is not valid", known.sensor_id));
        }
    }
    let reply = setup_reply(&command, board, seed);
    let is_known = |entry: &SensorEntry| command.calibration_info.iter().any(|c| c.sensor_id == entry.sensor_id);
    let calibrated = !command.groups.iter().flatten().all(is_known);
    let timing = Timing::of(&command.groups, command.update_rate);
    Ok((BoardSetup { groups: command.groups, timing, calibrated }, reply))
}

fn setup_reply(command: &SetupCommand, board: Board, seed: u64) -> Value {
    let groups: Vec<Vec<Value>> =
        command.groups.iter().map(|group| group.iter().map(|entry| metadata(&entry.config)).collect()).collect();
    let mut ids: Vec<u32> = command.groups.iter().flatten().map(|entry| entry.sensor_id).collect();
    ids.sort_unstable();
    ids.dedup();
    let one = |id| json!({"sensor_id": id, "temperature": CALIBRATION_TEMPERATURE, "data": calibration(id, seed)});
    let calibrations: Vec<Value> = ids.into_iter().map(one).collect();
    let tick_period = command.update_rate.map_or(0, |rate| (f64::from(board.ticks_per_second()) / rate).round() as u32);
    json!({
        "status": "ok", "tick_period": tick_period, "payload_size": 0, "metadata": groups,
        "calibration_info": calibrations,
    })
}

fn metadata(config: &SensorConfig) -> Value {
    let lengths: Vec<u32> = config.subsweeps.iter().map(|subsweep| subsweep.num_points).collect();
    let sweep_points: u32 = lengths.iter().sum();
    let offsets: Vec<u32> = lengths.iter().scan(0, |sum, length| Some(std::mem::replace(sum, *sum + length))).collect();
    let is_fast = !config.continuous_sweep_mode
        && config.inter_sweep_idle_state == IdleState::Ready
        && config.subsweeps.len() == 1
        && config.subsweeps.iter().all(|subsweep| subsweep.profile >= Profile::P3);
    let as_fast_as_it_goes = frame_timing(&SensorConfig { sweep_rate: None, ..config.clone() });
    json!({
        "frame_data_length": sweep_points * config.sweeps_per_frame, "sweep_data_length": sweep_points,
        "subsweep_data_offset": offsets, "subsweep_data_length": lengths,
        "calibration_temperature": CALIBRATION_TEMPERATURE, "base_step_length_m": BASE_STEP_M,
        "max_sweep_rate": 1.0 / as_fast_as_it_goes.sweep_period_s, "high_speed_mode": is_fast,
    })
}

/// A sensor's calibration, which depends only on sensor and seed; any other is refused.
fn calibration(sensor_id: u32, seed: u64) -> String {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xCA11_0000 ^ u64::from(sensor_id));
    (0..CALIBRATION_BYTES).map(|_| format!("{:02x}", rng.random::<u8>())).collect()
}
