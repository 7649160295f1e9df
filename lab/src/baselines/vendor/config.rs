//! Configuration of the vendor's detector and of the sensor for it.

use a121::{BASE_STEP_M, IdleState, Profile, SensorConfig, Subsweep};
use radar_mapping::range_axis;
use radar_sar::{RangeAxis, WAVELENGTH_M};

/// Sampling of the detector's sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Ranges of the points.
    pub axis: RangeAxis,
    /// Pulse profile.
    pub profile: Profile,
    /// Sweep rate, Hz; constant.
    pub sweep_rate_hz: f64,
    /// Sweeps per window.
    pub sweeps: usize,
}

/// Settings of the detector; the defaults are the vendor's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorConfig {
    /// Nearest and farthest range, metres. The sensor measures one pulse width more at either end,
    /// which the range filter removes.
    pub range_m: [f64; 2],
    /// Base steps between points.
    pub step_length: u32,
    /// Hardware averages per point.
    pub hwaas: u32,
    /// Pulse profile.
    pub profile: Profile,
    /// Sweeps per window.
    pub sweeps: u32,
    /// Wanted updates per second.
    pub update_hz: f64,
    /// Highest unambiguous speed, m/s.
    pub max_speed_m_per_s: f64,
}

impl Default for DetectorConfig {
    fn default() -> Self {
        Self {
            range_m: [0.15, 0.6],
            step_length: 2,
            hwaas: 12,
            profile: Profile::P3,
            sweeps: 16,
            update_hz: 50.0,
            max_speed_m_per_s: 0.5,
        }
    }
}

impl DetectorConfig {
    /// Sweep rate, Hz: at the highest speed the phase changes by π per sweep, which is λ/4 of
    /// range.
    pub fn sweep_rate_hz(&self) -> f64 {
        self.max_speed_m_per_s / (WAVELENGTH_M / 4.0)
    }

    /// The sensor's configuration. A window is longer than an update (16 sweeps at 404 Hz are 40
    /// ms, an update comes every 20 ms), so sweeps are continuous, in frames of one update.
    pub fn sensor(&self) -> SensorConfig {
        let step_m = f64::from(self.step_length) * BASE_STEP_M;
        let margin_m = self.profile.envelope_fwhm_m();
        let start_point = ((self.range_m[0] - margin_m) / BASE_STEP_M).floor();
        let num_points = ((self.range_m[1] + margin_m - start_point * BASE_STEP_M) / step_m).ceil() + 1.0;
        let subsweep = Subsweep {
            start_point: start_point as i32,
            num_points: num_points as u32,
            step_length: self.step_length,
            profile: self.profile,
            hwaas: self.hwaas,
            phase_enhancement: true,
            ..Subsweep::default()
        };
        let a_look = (self.sweep_rate_hz() / self.update_hz).round().clamp(1.0, f64::from(self.sweeps));
        SensorConfig {
            sweeps_per_frame: a_look as u32,
            sweep_rate: Some(self.sweep_rate_hz()),
            continuous_sweep_mode: true,
            inter_frame_idle_state: IdleState::Ready,
            inter_sweep_idle_state: IdleState::Ready,
            subsweeps: vec![subsweep],
            ..SensorConfig::default()
        }
    }

    /// The sampling of this configuration.
    pub fn sampling(&self) -> Sampling {
        Sampling {
            axis: range_axis(&self.sensor().subsweeps[0]),
            profile: self.profile,
            sweep_rate_hz: self.sweep_rate_hz(),
            sweeps: self.sweeps as usize,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::frame_timing;

    #[test]
    fn vendor_configuration_is_valid_and_keeps_its_rate() {
        let config = DetectorConfig::default();
        let sensor = config.sensor();
        sensor.validate().unwrap();
        assert!((config.sweep_rate_hz() - 403.6).abs() < 0.1 && sensor.sweeps_per_frame == 8);
        let timing = frame_timing(&sensor);
        assert!((timing.sweep_period_s * config.sweep_rate_hz() - 1.0).abs() < 1e-9, "{timing:?}");
        assert!((1.0 / timing.frame_period_s - 50.0).abs() < 1.0, "{timing:?}");
        let axis = config.sampling().axis;
        assert!(axis.first_m <= 0.01 && axis.last_m() >= 0.74, "{axis:?}");
    }
}
