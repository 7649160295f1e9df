//! What a sensor sees of itself: the direct leakage from transmitter to receiver, the ringing of the
//! shell that it is mounted behind, and the loopback.

use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use a121::{Profile, Subsweep};
use radar_sar::math;

use super::SensorEffects;
use super::gain::{amplitude_db, from_db};

/// Range, metres, and amplitude relative to the peak of the direct leakage with profile 1. Measured:
/// a recording with gain 10: 8655, 17454, 5389, 698, 167, 48 LSB; gone by 0.08 to 0.10 m.
const LEAKAGE_P1: [(f64, f64); 7] =
    [(-0.02, 0.496), (0.0, 1.0), (0.02, 0.309), (0.04, 0.0400), (0.06, 0.0096), (0.08, 0.00275), (0.10, 0.0008)];
/// The same with profile 3. Measured: recordings with gain 5 (14288, 6024, 490 LSB) and 16 (321, 139,
/// 80, 52 LSB from 0.20 m on).
const LEAKAGE_P3: [(f64, f64); 7] =
    [(0.0, 1.0), (0.06, 0.4216), (0.12, 0.0343), (0.20, 0.00145), (0.253, 0.00063), (0.275, 0.00036), (0.298, 0.00024)];
/// Peak of the leakage, LSB: profile 1 at gain 10, profile 3 at gain 5. Measured as above.
const PEAK_P1_GAIN_10_LSB: f64 = 17_454.0;
const PEAK_P3_GAIN_5_LSB: f64 = 14_288.0;
/// Range, metres, and amplitude of the ringing relative to the leakage's peak. Measured on one
/// mounting: 467, 149, 88, 66 LSB; from 0.20 m on, where nothing was measured, it falls as before.
const RINGING: [(f64, f64); 5] = [(0.07, 0.0268), (0.10, 0.00854), (0.16, 0.00504), (0.20, 0.00378), (0.60, 0.00022)];
/// Distance of the single reflections that make up the ringing, metres. Choice: less than the width
/// of the shortest pulse.
const RING_SPACING_M: f64 = 0.03;
/// Turn of the background's phase with temperature, rad/K. Choice: a close-range calibration holds
/// ±15 K, so over these it turns by no more than what leaves a tenth of the leakage.
const TURN_RAD_PER_K: f64 = 0.007;
/// Peak of the loopback, LSB. Measured: a recording of profile 4 with gain 15.
const LOOPBACK_GAIN_15_LSB: f64 = 3474.0;
/// Position of the loopback's peak in range, metres; it differs between modules. Measured: four
/// modules.
const LOOPBACK_M: (f64, f64) = (-0.0239, -0.0175);

/// One module in its mounting.
#[derive(Debug, Clone, PartialEq)]
pub struct Module {
    /// Position of the loopback's peak, metres.
    pub loopback_m: f64,
    leakage_rad: f64,
    rings_rad: Vec<f64>,
}

impl Module {
    /// The module with this seed.
    pub fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x0D01_E000);
        let mut turn = || rng.random_range(0.0..std::f64::consts::TAU);
        let leakage_rad = turn();
        let rings_rad = rings_m().map(|_| turn()).collect();
        Self { loopback_m: rng.random_range(LOOPBACK_M.0..LOOPBACK_M.1), leakage_rad, rings_rad }
    }

    /// Bias of the range, metres: measured range minus true range. Source: the vendor's offset
    /// compensation at room temperature, slope · loopback peak + constant (acconeer-python-exploration,
    /// `get_distance_offset`).
    pub fn range_bias_m(&self, profile: Profile) -> f64 {
        let (slope, constant) = match profile {
            Profile::P1 => (0.919, 0.0178),
            Profile::P2 => (0.595, 0.0193),
            Profile::P3 => (0.850, 0.0148),
            Profile::P4 => (1.003, 0.0231),
            Profile::P5 => (0.982, 0.0079),
        };
        slope * self.loopback_m + constant
    }

    /// The sensor's own signal in the points of a subsweep, LSB, at the reference temperature.
    pub fn background(&self, subsweep: &Subsweep, effects: &SensorEffects) -> Vec<Complex64> {
        let width_m = subsweep.profile.envelope_fwhm_m();
        let range_m = |n: usize| subsweep.first_m() + n as f64 * subsweep.step_m();
        if subsweep.enable_loopback {
            let peak = LOOPBACK_GAIN_15_LSB * from_db(amplitude_db(subsweep.receiver_gain) - amplitude_db(15));
            let pulse = |n: usize| Complex64::from(peak * envelope((range_m(n) - self.loopback_m) / width_m));
            return (0..subsweep.num_points as usize).map(pulse).collect();
        }
        let peak = leakage_peak_lsb(subsweep);
        let leakage = math::from_polar(effects.leakage * peak, self.leakage_rad);
        let point = |n: usize| {
            let rings = rings_m().zip(&self.rings_rad).map(|(at_m, &rad)| {
                let amplitude = peak * effects.ringing * interpolated(&RINGING, at_m);
                math::from_polar(amplitude * envelope((range_m(n) - at_m) / width_m), rad)
            });
            leakage * leakage_share(subsweep.profile, range_m(n)) + rings.sum::<Complex64>()
        };
        (0..subsweep.num_points as usize).map(point).collect()
    }

    /// Factor by which the background turns at a temperature above the reference.
    pub fn turn(rise_k: f64) -> Complex64 {
        math::from_polar(1.0, TURN_RAD_PER_K * rise_k)
    }
}

fn rings_m() -> impl Iterator<Item = f64> {
    let (first, last) = (RINGING[0].0, RINGING[RINGING.len() - 1].0);
    (0..).map(move |n| first + f64::from(n) * RING_SPACING_M).take_while(move |m| *m <= last)
}

/// Peak of the leakage at a subsweep's gain, LSB. Profile 2 is as 1, profiles 4 and 5 as 3.
fn leakage_peak_lsb(subsweep: &Subsweep) -> f64 {
    let (peak, gain) = match subsweep.profile {
        Profile::P1 | Profile::P2 => (PEAK_P1_GAIN_10_LSB, 10),
        Profile::P3 | Profile::P4 | Profile::P5 => (PEAK_P3_GAIN_5_LSB, 5),
    };
    peak * from_db(amplitude_db(subsweep.receiver_gain) - amplitude_db(gain))
}

/// Leakage at a range relative to its peak. Of profiles without a measurement: that of the next
/// shorter one with it, stretched by the length of the pulse.
fn leakage_share(profile: Profile, range_m: f64) -> f64 {
    let (table, of): (&[(f64, f64)], Profile) = match profile {
        Profile::P1 | Profile::P2 => (&LEAKAGE_P1, Profile::P1),
        Profile::P3 | Profile::P4 | Profile::P5 => (&LEAKAGE_P3, Profile::P3),
    };
    let range_m = range_m * of.envelope_fwhm_m() / profile.envelope_fwhm_m();
    // Before the peak it rises as the pulse does.
    let before_m = (table[0].0 - range_m).max(0.0);
    interpolated(table, range_m) * envelope(before_m / of.envelope_fwhm_m())
}

/// Amplitude of the pulse's envelope at an offset in widths.
fn envelope(widths: f64) -> f64 {
    math::powf(0.5, 4.0 * widths * widths)
}

/// Value of a falling table at a range: straight lines in dB, the last one goes on.
fn interpolated(table: &[(f64, f64)], range_m: f64) -> f64 {
    let later = table.partition_point(|(m, _)| *m < range_m).clamp(1, table.len() - 1);
    let ((from_m, from), (to_m, to)) = (table[later - 1], table[later]);
    let share = ((range_m - from_m) / (to_m - from_m)).max(0.0);
    from * math::powf(to / from, share)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subsweep(profile: Profile, receiver_gain: u32, first: i32) -> Subsweep {
        Subsweep {
            profile,
            receiver_gain,
            start_point: first,
            num_points: 40,
            step_length: 8,
            phase_enhancement: true,
            ..Default::default()
        }
    }

    #[test]
    fn leakage_is_as_measured() {
        let of = |subsweep: &Subsweep, range_m: f64| {
            let effects = SensorEffects { leakage: 1.0, ..SensorEffects::NONE };
            let n = ((range_m - subsweep.first_m()) / subsweep.step_m()).round() as usize;
            Module::new(1).background(subsweep, &effects)[n].norm()
        };
        let near = |is: f64, measured: f64| (is / measured - 1.0).abs() < 0.1;
        let p1 = subsweep(Profile::P1, 10, -8);
        assert!(near(of(&p1, 0.0), 17_454.0) && near(of(&p1, 0.02), 5389.0) && near(of(&p1, -0.02), 8655.0));
        assert!(near(of(&p1, 0.06), 167.0));
        let p3 = subsweep(Profile::P3, 5, 0);
        assert!(near(of(&p3, 0.0), 14_288.0) && near(of(&p3, 0.06), 6024.0) && near(of(&p3, 0.12), 490.0));
        // Recorded with gain 16, in another scene; the step of the gain is known to a few tenths of a
        // dB.
        let loud = subsweep(Profile::P3, 16, 80);
        assert!((of(&loud, 0.2) / 321.0).log10().abs() < 0.05, "{}", of(&loud, 0.2));
    }

    #[test]
    fn rings_follow_the_measured_decay() {
        let effects = SensorEffects { ringing: 1.0, ..SensorEffects::NONE };
        let p1 = subsweep(Profile::P1, 10, 20);
        let power = |from_m: f64, to_m: f64| {
            let each = (0..60).flat_map(|seed| {
                let points = Module::new(seed).background(&p1, &effects);
                let range_m = |n: usize| p1.first_m() + n as f64 * p1.step_m();
                let inside = move |n: &usize| (from_m..to_m).contains(&range_m(*n));
                (0..points.len()).filter(inside).map(move |n| points[n].norm_sqr()).collect::<Vec<_>>()
            });
            let each: Vec<f64> = each.collect();
            (each.iter().sum::<f64>() / each.len() as f64).sqrt()
        };
        // 467 LSB at 0.07 m and 66 at 0.20 m; several rings overlap in a pulse.
        assert!((230.0..700.0).contains(&power(0.06, 0.08)), "{}", power(0.06, 0.08));
        assert!((45.0..130.0).contains(&power(0.18, 0.22)), "{}", power(0.18, 0.22));
    }

    #[test]
    fn modules_differ_in_their_range_bias() {
        let biases: Vec<f64> = (0..50).map(|seed| Module::new(seed).range_bias_m(Profile::P3)).collect();
        assert!(biases.iter().all(|m| (-0.0056..0.0001).contains(m)), "{biases:?}");
        let spread =
            biases.iter().copied().fold(f64::NEG_INFINITY, f64::max) - biases.iter().copied().fold(0.0, f64::min);
        assert!(spread > 0.003);
    }
}
