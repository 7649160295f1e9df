//! Signal model of a point reflector, eq. 3.3 of the thesis.

use num_complex::Complex64;

use super::PHASE_RAD_PER_M;

use crate::math;

/// Gaussian amplitude envelope E at an offset from its centre: 1 at the centre, ½ at half the
/// profile's FWHM.
pub fn envelope(pulse_fwhm_m: f64, offset_m: f64) -> f64 {
    let x = offset_m / pulse_fwhm_m;
    math::exp(-4.0 * std::f64::consts::LN_2 * x * x)
}

/// Amplitude falloff D(d) = 1/d² (eq. 3.4). Infinite at 0; callers skip ranges at or below 0.
pub fn distance_falloff(distance_m: f64) -> f64 {
    1.0 / (distance_m * distance_m)
}

/// Sample at range `range_m` of a reflector at `distance_m`, with the beam's amplitude factor (eq.
/// 3.3). The phase grows with distance, as measured on the sensor.
pub fn template(pulse_fwhm_m: f64, range_m: f64, distance_m: f64, beam_amplitude: f64) -> Complex64 {
    let amplitude = envelope(pulse_fwhm_m, range_m - distance_m) * distance_falloff(distance_m) * beam_amplitude;
    math::from_polar(amplitude, PHASE_RAD_PER_M * distance_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn envelope_is_half_at_half_its_fwhm() {
        for fwhm_m in [0.04, 0.07, 0.14, 0.19, 0.32] {
            assert!((envelope(fwhm_m, fwhm_m / 2.0) - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn half_a_wavelength_of_range_turns_the_phase_once() {
        let a = template(0.14, 1.0, 1.0, 1.0);
        let b = template(0.14, 1.0, 1.0 + super::super::WAVELENGTH_M / 2.0, 1.0);
        assert!((a.arg() - b.arg()).abs() < 1e-9);
    }
}
