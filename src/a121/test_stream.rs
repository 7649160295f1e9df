//! What a server sends, for the tests of this room: spelt by hand, not by the code under test.

use super::{ResultInfo, Setup};
use crate::radar::{SensorConfig, Subsweep, preset};

/// Forty samples a frame, otherwise as the default preset.
pub(super) fn small_setup() -> Setup {
    let d16 = preset("d16").expect("a preset");
    let subsweeps = vec![Subsweep { num_points: 10, ..d16.subsweeps[0].clone() }];
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
