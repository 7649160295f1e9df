//! Amplitude and noise of a subsweep by profile, gain and temperature.

use a121::{Subsweep, noise_rms_lsb};
use radar_sar::math;

/// Complex rms of the noise at gain 16 times √HWAAS, LSB, by profile. Measured: static scenes of the
/// vendor's recordings; profile 4, of which there is none, is the mean of its neighbours.
const NOISE_AT_GAIN_16_LSB: [f64; 5] = [222.0, 237.0, 181.0, 170.0, 159.0];
/// Step of the noise from one gain to the next above gain 10, dB, by profile. Measured: recordings at
/// gain 10 and 16; profiles 2 and 4 as their neighbours.
const NOISE_STEP_DB: [f64; 5] = [2.5, 2.4, 2.24, 2.5, 2.8];
/// Step of the amplitude of echoes from one gain to the next, above gain 10 and up to it, dB.
/// Measured: the same scenes at gain 5, 10 and 16.
const STEP_ABOVE_10_DB: f64 = 2.8;
const STEP_UP_TO_10_DB: f64 = 1.4;
/// Rise of temperature that halves all amplitudes, kelvin, by profile. Source: the vendor's handbook.
const HALVING_K: [f64; 5] = [67.0, 85.0, 86.0, 99.0, 104.0];
/// Change of the noise with temperature, 1/K. Source: the vendor's handbook.
const NOISE_PER_K: f64 = -0.00275;

/// Temperature at which the radar equation holds, and at the start, °C. Choice: within the 18 to
/// 34 °C of the vendor's recordings, from which the levels come.
pub const REFERENCE_C: f64 = 30.0;
/// Rise of the temperature after the start, kelvin, and its time constant, seconds. Choice: a module
/// in a headset's warm air; the recordings of seconds show none of it.
const WARM_UP_K: f64 = 12.0;
const WARM_UP_S: f64 = 300.0;

/// Amplitude of echoes at a receiver gain against gain 16, dB.
pub fn amplitude_db(receiver_gain: u32) -> f64 {
    let gain = f64::from(receiver_gain);
    STEP_ABOVE_10_DB * (gain.max(10.0) - 16.0) + STEP_UP_TO_10_DB * (gain.min(10.0) - 10.0)
}

/// Levels of one subsweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Complex rms of the noise, LSB.
    pub noise_rms_lsb: f64,
    /// Factor of the amplitudes that the radar equation gives for the noise of
    /// [`a121::noise_rms_lsb`].
    pub echo_factor: f64,
}

impl Levels {
    /// At the reference temperature. `share` 0: noise and gain as of profile 3; 1: as measured for
    /// the profile.
    pub fn of(subsweep: &Subsweep, share: f64) -> Self {
        let usual = noise_rms_lsb(subsweep);
        let profile = subsweep.profile as usize;
        let gain = f64::from(subsweep.receiver_gain);
        let noise_db = NOISE_STEP_DB[profile] * (gain.max(10.0) - 16.0) + STEP_UP_TO_10_DB * (gain.min(10.0) - 10.0);
        let at_16 = NOISE_AT_GAIN_16_LSB[profile] / f64::from(subsweep.hwaas).sqrt();
        let measured = at_16 * from_db(noise_db);
        // The radar equation's SNR holds at gain 16; lower gains lose less noise than signal.
        let echo = at_16 * from_db(amplitude_db(subsweep.receiver_gain)) / usual;
        Self { noise_rms_lsb: usual * math::powf(measured / usual, share), echo_factor: math::powf(echo, share) }
    }

    /// The same at another temperature.
    pub fn at(self, profile: a121::Profile, temperature_c: f64) -> Self {
        let rise_k = temperature_c - REFERENCE_C;
        Self {
            noise_rms_lsb: self.noise_rms_lsb * (1.0 + NOISE_PER_K * rise_k).max(0.5),
            echo_factor: self.echo_factor * math::powf(2.0, -rise_k / HALVING_K[profile as usize]),
        }
    }
}

/// Temperature of the sensor at a time after its start, °C.
pub fn temperature_c(time_s: f64, warm_up: f64) -> f64 {
    REFERENCE_C + warm_up * WARM_UP_K * (1.0 - math::exp(-time_s.max(0.0) / WARM_UP_S))
}

/// Factor of an amplitude.
pub fn from_db(db: f64) -> f64 {
    math::powf(10.0, db / 20.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::Profile;

    fn subsweep(profile: Profile, receiver_gain: u32) -> Subsweep {
        Subsweep { profile, receiver_gain, hwaas: 1, ..Default::default() }
    }

    #[test]
    fn noise_is_as_measured_at_both_gains() {
        // reality.md's table of recordings: profile 1 222 and 39, profile 3 173 to 190 and 37 to 40,
        // profile 5 157 to 161 and 22 to 24 LSB.
        for (profile, at_16, at_10) in [
            (Profile::P1, 221.0..223.0, 38.0..40.0),
            (Profile::P3, 173.0..190.0, 37.0..40.0),
            (Profile::P5, 157.0..161.0, 22.0..24.0),
        ] {
            let noise = |gain: u32| Levels::of(&subsweep(profile, gain), 1.0).noise_rms_lsb;
            assert!(
                at_16.contains(&noise(16)) && at_10.contains(&noise(10)),
                "{profile:?} {} {}",
                noise(16),
                noise(10)
            );
        }
    }

    #[test]
    fn without_the_effect_levels_are_those_of_the_radar_equation() {
        let plain = subsweep(Profile::P1, 7);
        assert_eq!(Levels::of(&plain, 0.0), Levels { noise_rms_lsb: noise_rms_lsb(&plain), echo_factor: 1.0 });
    }

    #[test]
    fn warmth_halves_the_amplitude() {
        let levels = Levels::of(&subsweep(Profile::P3, 16), 1.0);
        let warm = levels.at(Profile::P3, REFERENCE_C + 86.0);
        assert!((warm.echo_factor / levels.echo_factor - 0.5).abs() < 1e-9);
        assert!((warm.noise_rms_lsb / levels.noise_rms_lsb - (1.0 - 0.00275 * 86.0)).abs() < 1e-9);
        assert_eq!(temperature_c(0.0, 1.0), REFERENCE_C);
        assert!((temperature_c(1e4, 1.0) - REFERENCE_C - WARM_UP_K).abs() < 1e-6);
    }
}
