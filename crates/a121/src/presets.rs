//! Named configurations for common uses.
//!
//! - `d16`: the default. Sweep rate matters more than range samples, since the 14 cm envelope needs
//!   a sample only every 60 mm; 1056 sweeps per second follow the phase up to 1.31 m/s. 211 kB/s:
//!   USB.
//! - `c16`: the same points with one sweep per frame, 500 sweeps per second, 100 kB/s: slower
//!   links.
//! - `slow-link`: the same points with one sweep per frame, 25 sweeps per second, for boards at
//!   115200 baud, of which it uses eight tenths. The line is the bottleneck, so each point has
//!   eight times the averages: 9 dB more signal.
//! - `close`: 0.15–0.61 m, for objects that nearly touch the head. Profile 1: its 4 cm pulse is
//!   over before echoes from 0.15 m come back, and it resolves what longer pulses blur; points
//!   every 20 mm. 1200 sweeps per second follow the phase up to 1.48 m/s. All of it is within reach
//!   of the hands: little is confirmed unless `rooms.tracks.hands_reach_m` is 0, and tracked hands
//!   explain nearly all echoes while they are in the beam.
//! - `far`: 0.4–6.5 m, for halls. Profile 5 has the highest loop gain (21.6 dB), and its 32 cm
//!   envelope needs a sample only every 120 mm; a PRF of 13 MHz measures to 7 m. 440 sweeps per
//!   second follow the phase up to 0.54 m/s. 101 kB/s.
//! - `fine`: points every 10 mm to 3.2 m, 120 sweeps per second, for single reflectors and
//!   range-only backprojection.
//! - `thesis`: Table 3.1 of the thesis, 0.20–1.00 m at 2.5 mm, 120 sweeps per second.

use super::{IdleState, Prf, Profile, SensorConfig, Subsweep};

/// Names of all presets.
pub const PRESETS: [&str; 7] = ["d16", "c16", "slow-link", "close", "far", "fine", "thesis"];

fn one_subsweep(sweeps_per_frame: u32, frame_rate: f64, subsweep: Subsweep) -> SensorConfig {
    SensorConfig {
        sweeps_per_frame,
        frame_rate: Some(frame_rate),
        inter_frame_idle_state: IdleState::Ready,
        inter_sweep_idle_state: IdleState::Ready,
        subsweeps: vec![subsweep],
        ..Default::default()
    }
}

/// Points from 0.2 m on.
fn points(num_points: u32, step_length: u32) -> Subsweep {
    Subsweep { start_point: 80, num_points, step_length, hwaas: 16, phase_enhancement: true, ..Default::default() }
}

/// The preset with this name.
pub fn preset(name: &str) -> Option<SensorConfig> {
    match name {
        "d16" => Some(one_subsweep(16, 66.0, points(50, 24))),
        "c16" => Some(one_subsweep(1, 500.0, points(50, 24))),
        "slow-link" => Some(one_subsweep(1, 25.0, Subsweep { hwaas: 128, ..points(50, 24) })),
        "close" => Some(one_subsweep(16, 75.0, Subsweep { start_point: 60, profile: Profile::P1, ..points(24, 8) })),
        "far" => {
            let far =
                Subsweep { start_point: 160, profile: Profile::P5, prf: Prf::Mhz13_0, hwaas: 32, ..points(52, 48) };
            Some(one_subsweep(8, 55.0, far))
        }
        "fine" => Some(one_subsweep(1, 120.0, points(300, 4))),
        "thesis" => Some(one_subsweep(1, 120.0, points(321, 1))),
        _ => None,
    }
}

/// Purpose of a preset, in a few words.
pub fn preset_purpose(name: &str) -> &'static str {
    match name {
        "d16" => "rooms, over USB or network",
        "c16" => "rooms, over a fast UART",
        "slow-link" => "boards limited to 115200 baud",
        "close" => "0.15 to 0.6 m, hands away",
        "far" => "to 6.5 m",
        "fine" => "single reflectors",
        "thesis" => "the thesis' Table 3.1",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame_timing;
    use super::*;

    #[test]
    fn presets_cover_their_documented_range_and_speed() {
        // Name, first and last point in metres, fastest motion whose phase is followed in m/s.
        for (name, first_m, last_m, speed_m_per_s) in
            [("d16", 0.20, 3.143, 1.31), ("close", 0.15, 0.61, 1.48), ("far", 0.40, 6.53, 0.54)]
        {
            let config = preset(name).unwrap();
            let axis = config.subsweeps[0];
            assert!((axis.first_m() - first_m).abs() < 0.005 && (axis.last_m() - last_m).abs() < 0.01, "{name}");
            let timing = frame_timing(&config);
            let sweeps_hz = f64::from(config.sweeps_per_frame) / timing.frame_period_s;
            assert!((sweeps_hz * (299_792_458.0 / 60.5e9) / 4.0 - speed_m_per_s).abs() < 0.01, "{name}: {sweeps_hz}");
            assert!(timing.frame_s / timing.frame_period_s < 0.97, "{name}: no time to spare");
            // At least two samples per envelope.
            let subsweep = config.subsweeps[0];
            let step_m = f64::from(subsweep.step_length) * super::super::BASE_STEP_M;
            assert!(step_m <= subsweep.profile.envelope_fwhm_m() / 2.0 + 1e-3, "{name}");
        }
        assert!(PRESETS.iter().all(|name| !preset_purpose(name).is_empty()) && preset("none").is_none());
    }
}
