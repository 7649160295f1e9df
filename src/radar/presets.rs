//! Configurations that serve, by name.
//!
//! - `d16`: the default. Speed counts more than range samples, since the 14 cm envelope needs a sample only every 60 mm;
//!   1056 sweeps a second follow the phase up to 1.31 m/s. 211 kB/s: USB.
//! - `c16`: the same points once a frame, 500 sweeps a second, 100 kB/s: slower links.
//! - `fine`: 10 mm points to 3.2 m, 120 sweeps a second, for single reflectors and range-only sums.
//! - `thesis`: Table 3.1 of the thesis, 0.20–1.00 m at 2.5 mm, 120 sweeps a second.

use super::{IdleState, Profile, SensorConfig, Subsweep};

/// Names that [`preset`] knows.
pub const PRESETS: [&str; 4] = ["d16", "c16", "fine", "thesis"];

fn one_subsweep(num_points: u32, step_length: u32, sweeps_per_frame: u32, frame_rate: f64) -> SensorConfig {
    SensorConfig {
        sweeps_per_frame,
        frame_rate: Some(frame_rate),
        inter_frame_idle_state: IdleState::Ready,
        inter_sweep_idle_state: IdleState::Ready,
        subsweeps: vec![Subsweep {
            start_point: 80,
            num_points,
            step_length,
            profile: Profile::P3,
            hwaas: 16,
            phase_enhancement: true,
            ..Default::default()
        }],
        ..Default::default()
    }
}

/// The configuration of that name.
pub fn preset(name: &str) -> Option<SensorConfig> {
    match name {
        "d16" => Some(one_subsweep(50, 24, 16, 66.0)),
        "c16" => Some(one_subsweep(50, 24, 1, 500.0)),
        "fine" => Some(one_subsweep(300, 4, 1, 120.0)),
        "thesis" => Some(one_subsweep(321, 1, 1, 120.0)),
        _ => None,
    }
}
