//! Radar equation with the sensor's figures.

use super::{Profile, Subsweep};

/// Power SNR of a point in one sweep on the beam's axis, dB: loop gain + 10·log10(HWAAS) + RCS −
/// 40·log10(d).
pub fn snr_db(profile: Profile, hwaas: u32, rcs_dbsm: f64, distance_m: f64) -> f64 {
    profile.loop_gain_db() + 10.0 * libm::log10(f64::from(hwaas)) + rcs_dbsm - 40.0 * libm::log10(distance_m)
}

/// Radar cross-section that gives this SNR at a distance on the axis, dBsm: the inverse of
/// [`snr_db`].
pub fn rcs_dbsm_for_snr(profile: Profile, hwaas: u32, snr: f64, distance_m: f64) -> f64 {
    snr - snr_db(profile, hwaas, 0.0, distance_m)
}

/// Complex rms of the receiver's noise in one point, LSB: 175/√HWAAS at gain 16 and 41/√HWAAS at
/// gain 10, exponential in the gain. Measured: the middle of the values of profile 3 in recordings.
pub fn noise_rms_lsb(subsweep: &Subsweep) -> f64 {
    let per_gain_step = libm::pow(175.0f64 / 41.0, 1.0 / 6.0);
    175.0 * libm::pow(per_gain_step, f64::from(subsweep.receiver_gain) - 16.0) / f64::from(subsweep.hwaas).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubling_the_distance_costs_12_db() {
        let near = snr_db(Profile::P3, 16, -10.0, 1.0);
        assert!((near - (19.0 + 12.04 - 10.0)).abs() < 0.01);
        assert!((near - snr_db(Profile::P3, 16, -10.0, 2.0) - 12.04).abs() < 0.01);
        assert!((rcs_dbsm_for_snr(Profile::P3, 16, near, 1.0) + 10.0).abs() < 1e-9);
    }
}
