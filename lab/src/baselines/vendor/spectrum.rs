//! Range-velocity spectrum of a window of sweeps: a Fourier transform over the sweeps at each
//! range, without a window function. The phase of a moving object changes from sweep to sweep.

use std::collections::VecDeque;

use num_complex::Complex64;

use radar_sar::math;
use radar_sar::{RangeAxis, WAVELENGTH_M};

/// Range-velocity spectrum of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeVelocity {
    /// Ranges of the spectrum.
    pub axis: RangeAxis,
    /// Velocity step between bins, m/s.
    pub bin_m_per_s: f64,
    /// `[bin][range]`, not normalised. Positive velocities mean a growing distance; the second half
    /// of the bins has negative velocities.
    pub bins: Vec<Vec<Complex64>>,
}

impl RangeVelocity {
    /// Spectrum of filtered sweeps, all as long as the axis.
    pub(super) fn of(window: &VecDeque<Vec<Complex64>>, axis: &RangeAxis, sweep_rate_hz: f64) -> Self {
        let count = window.len();
        let turn = |bin: usize, sweep: usize| {
            let part = (bin * sweep % count) as f64 / count as f64;
            math::from_polar(1.0, -std::f64::consts::TAU * part)
        };
        let bin = |bin: usize| {
            let mut sums = vec![Complex64::ZERO; axis.points];
            for (number, sweep) in window.iter().enumerate() {
                let turn = turn(bin, number);
                sums.iter_mut().zip(sweep).for_each(|(sum, z)| *sum += z * turn);
            }
            sums
        };
        let bin_m_per_s = WAVELENGTH_M / 2.0 * sweep_rate_hz / count.max(1) as f64;
        Self { axis: *axis, bin_m_per_s, bins: (0..count).map(bin).collect() }
    }

    /// Velocity of a (fractional) bin, m/s; positive when the distance grows.
    pub fn velocity_m_per_s(&self, bin: f64) -> f64 {
        let count = self.bins.len() as f64;
        let half = count / 2.0;
        ((bin + half).rem_euclid(count) - half) * self.bin_m_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_cycle_per_window_is_one_bin_and_receding_is_positive() {
        let axis = RangeAxis { first_m: 0.2, step_m: 0.005, points: 2 };
        let tone = |sweep: usize| Complex64::from_polar(1.0, std::f64::consts::TAU * 3.0 * sweep as f64 / 16.0);
        let window: VecDeque<_> = (0..16).map(|sweep| vec![tone(sweep), tone(sweep).conj()]).collect();
        let spectrum = RangeVelocity::of(&window, &axis, 400.0);
        assert!((spectrum.bins[3][0].norm() - 16.0).abs() < 1e-9 && spectrum.bins[4][0].norm() < 1e-9);
        assert!((spectrum.bins[13][1].norm() - 16.0).abs() < 1e-9);
        // One cycle is half a wavelength of range; 25 windows per second.
        let expected = 3.0 * 25.0 * WAVELENGTH_M / 2.0;
        assert!((spectrum.velocity_m_per_s(3.0) - expected).abs() < 1e-12);
        assert!((spectrum.velocity_m_per_s(13.0) + expected).abs() < 1e-12);
    }
}
