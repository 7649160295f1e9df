//! The recordings of all cases: a corner reflector at 1 m, preset `fine` for 10 s, 20 dB at 1 m,
//! default tracking errors.

use super::BenchmarkError;
use crate::experiments::trial_recording::{CUBE_M, TrialRecording};
use a121::preset;
use radar_simulation::Scenario;

const PRESET: &str = "fine";
/// Length, seconds, and SNR at 1 m, dB. Choice: every motion passes several times; the SNR of the
/// accuracy study.
const DURATION_S: f64 = 10.0;
const SNR_DB: f64 = 20.0;

/// The workload as text.
pub(super) fn workload(motion: &str) -> String {
    format!("corner reflector at 1 m, {motion}, {DURATION_S:.0} s, {PRESET}, {SNR_DB:.0} dB, {CUBE_M:.0} m cube")
}

pub(super) fn record(motion: &str, seed: u64) -> Result<TrialRecording, BenchmarkError> {
    let config = preset(PRESET).ok_or(BenchmarkError::Preset(PRESET))?;
    let mut scenario = Scenario::new("corner-reflector", motion, config, DURATION_S, seed);
    scenario.snr_db = Some(SNR_DB);
    Ok(TrialRecording::of(&scenario)?)
}
