//! Timing of the points of a sweep (the vendor's timing model; see the presets for figures).
//!
//! A sweep takes n·τ_point + 3·τ_sample per subsweep, plus fixed overheads; τ_point =
//! HWAAS·τ_sample + τ_overhead. The values at 15.6 MHz are known for all profiles. For profiles 3–5
//! they scale with 1/PRF; the same scaling is assumed for profiles 1 and 2.

use super::{IdleState, Profile, SensorConfig, Subsweep};

/// Timing of a frame, seconds.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTiming {
    /// From the start of a sweep to the start of the next one in the frame.
    pub sweep_period_s: f64,
    /// Duration of a sweep.
    pub sweep_s: f64,
    /// For each subsweep: from the sweep's start to its first point, and between points.
    pub subsweeps: Vec<(f64, f64)>,
    /// From the first sweep's start to the frame's end.
    pub frame_s: f64,
    /// Frame period: by the configured rate, or as fast as possible.
    pub frame_period_s: f64,
}

/// τ_sample and τ_point, seconds.
fn sample_and_point_s(subsweep: &Subsweep) -> (f64, f64) {
    let (sample, overhead) = subsweep.profile.sample_and_overhead_s_at_15_6_mhz();
    let scale = 15.6e6 / subsweep.prf.hz();
    (sample * scale, (f64::from(subsweep.hwaas) * sample + overhead) * scale)
}

fn wake_s(state: IdleState) -> f64 {
    match state {
        IdleState::Ready => 0.0,
        IdleState::Sleep => 55e-6,
        IdleState::DeepSleep => 670e-6,
    }
}

/// Whether the sensor is in high-speed mode, which has smaller overheads and is entered
/// automatically.
fn high_speed_mode(config: &SensorConfig) -> bool {
    !config.continuous_sweep_mode
        && config.inter_sweep_idle_state == IdleState::Ready
        && config.subsweeps.len() == 1
        && config.subsweeps.iter().all(|s| s.profile >= Profile::P3)
}

/// The timing of a valid configuration.
pub fn frame_timing(config: &SensorConfig) -> FrameTiming {
    let fast = high_speed_mode(config);
    let mut subsweeps = Vec::with_capacity(config.subsweeps.len());
    let mut at_s = 0.0;
    for subsweep in &config.subsweeps {
        let (sample_s, point_s) = sample_and_point_s(subsweep);
        if !fast {
            at_s += 22e-6;
        }
        subsweeps.push((at_s, point_s));
        at_s += f64::from(subsweep.num_points) * point_s + 3.0 * sample_s;
    }
    if !fast {
        at_s += 10e-6 + wake_s(config.inter_sweep_idle_state);
    }
    let sweep_period_s = config.sweep_rate.map_or(at_s, |rate| (1.0 / rate).max(at_s));
    let sweeps = f64::from(config.sweeps_per_frame);
    let frame_s = (sweeps - 1.0) * sweep_period_s + at_s;
    let overhead_s = if fast { 36e-6 } else { 4e-6 } + wake_s(config.inter_frame_idle_state);
    let busy_s = if config.continuous_sweep_mode { sweeps * sweep_period_s } else { frame_s + overhead_s };
    let frame_period_s = config.frame_rate.map_or(busy_s, |rate| (1.0 / rate).max(busy_s));
    FrameTiming { sweep_period_s, sweep_s: at_s, subsweeps, frame_s, frame_period_s }
}

#[cfg(test)]
mod tests {
    use super::super::{Prf, preset};
    use super::*;

    #[test]
    fn thesis_sweep_takes_5_68_ms() {
        let timing = frame_timing(&preset("thesis").unwrap());
        assert!((timing.sweep_s - 5.68e-3).abs() < 0.02e-3, "{}", timing.sweep_s);
        assert!((timing.frame_period_s - 1.0 / 120.0).abs() < 1e-12);
    }

    #[test]
    fn d16_makes_1056_sweeps_per_second_at_94_percent_duty() {
        let timing = frame_timing(&preset("d16").unwrap());
        assert!((16.0 / timing.frame_period_s - 1056.0).abs() < 1e-6);
        assert!((timing.frame_s / timing.frame_period_s - 0.94).abs() < 0.005);
    }

    #[test]
    fn sweep_rates_match_board_reports_within_4_percent() {
        // 160 points, HWAAS 8, profile 3, PRF 13 MHz: an XC120 reported 531.6 sweeps per second.
        let mut config = SensorConfig::default();
        config.subsweeps[0].prf = Prf::Mhz13_0;
        let rate = 1.0 / frame_timing(&config).sweep_period_s;
        assert!((rate / 531.62 - 1.0).abs() < 0.04, "{rate}");
        // Four subsweeps of profiles 1, 3, 5, 5 at PRF 8.7 MHz: an XM125 reported 176.5.
        let rows = [(109, Profile::P1, 5), (68, Profile::P3, 3), (57, Profile::P5, 8), (53, Profile::P5, 19)];
        let subsweep = |&(num_points, profile, hwaas): &(u32, Profile, u32)| Subsweep {
            num_points,
            profile,
            hwaas,
            prf: Prf::Mhz8_7,
            ..Default::default()
        };
        config.subsweeps = rows.iter().map(subsweep).collect();
        let rate = 1.0 / frame_timing(&config).sweep_period_s;
        assert!((rate / 176.49 - 1.0).abs() < 0.04, "{rate}");
    }
}
