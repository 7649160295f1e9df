//! The sensor from the sum of the echoes to samples.

use std::sync::Arc;

use num_complex::{Complex, Complex64};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use a121::{SensorConfig, Subsweep};
use radar_sar::math;

use super::background::Module;
use super::gain::{Levels, REFERENCE_C, from_db, temperature_c};
use super::jitter::{FrameJitter, slow_phase_rad};
use super::{RecordedSensor, SensorEffects};

/// Share of the points that another radar disturbs, and by how much the noise of these is above the
/// receiver's, dB. Source: TI SWRA662A, an FMCW radar 5 m away with 1 % of the time in the receiver's
/// band.
const INTERFERENCE_SHARE: f64 = 0.01;
const INTERFERENCE_DB: f64 = 12.0;

/// A sensor with a configuration and its imperfections.
#[derive(Debug, Clone)]
pub(crate) struct SensorModel {
    effects: SensorEffects,
    recorded: Option<Arc<RecordedSensor>>,
    seed: u64,
    subsweeps: Vec<SubsweepModel>,
    sweeps_per_frame: u64,
}

#[derive(Debug, Clone)]
struct SubsweepModel {
    subsweep: Subsweep,
    levels: Levels,
    range_bias_m: f64,
    background: Vec<Complex64>,
}

impl SensorModel {
    /// The sensor with this seed.
    pub fn new(config: &SensorConfig, effects: SensorEffects, seed: u64) -> Self {
        let module = Module::new(seed);
        let model = |subsweep: &Subsweep| SubsweepModel {
            subsweep: *subsweep,
            levels: Levels::of(subsweep, effects.profile_noise),
            range_bias_m: effects.range_bias * module.range_bias_m(subsweep.profile),
            background: if subsweep.enable_tx || subsweep.enable_loopback {
                module.background(subsweep, &effects)
            } else {
                Vec::new()
            },
        };
        let subsweeps = config.subsweeps.iter().map(model).collect();
        Self { effects, recorded: None, seed, subsweeps, sweeps_per_frame: u64::from(config.sweeps_per_frame) }
    }

    /// What was recorded is played back instead of the model's jitter and noise.
    pub fn with_recorded(self, recorded: Option<Arc<RecordedSensor>>) -> Self {
        Self { recorded, ..self }
    }

    /// Temperature at a time after the start, °C.
    pub fn temperature_c(&self, time_s: f64) -> f64 {
        temperature_c(time_s, self.effects.warm_up)
    }

    /// Measured range minus true range, metres.
    pub fn range_bias_m(&self, subsweep: usize) -> f64 {
        self.subsweeps[subsweep].range_bias_m
    }

    /// Whether echoes reach the receiver in this subsweep.
    pub fn hears_echoes(&self, subsweep: usize) -> bool {
        self.subsweeps[subsweep].subsweep.hears_echoes()
    }

    /// A frame that starts at a time after the start, seconds.
    pub fn frame(&self, number: u64, start_s: f64) -> FrameState<'_> {
        let stream = |salt: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ salt);
            rng.set_stream(number);
            rng
        };
        FrameState {
            sensor: self,
            number,
            start_s,
            sweeps: 0,
            temperature_c: self.temperature_c(start_s),
            slow_rad: self.effects.jitter * slow_phase_rad(self.seed, start_s),
            noise: stream(0x0CC0_4E12),
            interference: stream(0x0A66_2E55),
            jitter: FrameJitter::new(stream(0x0717_7E42)),
        }
    }
}

/// The sensor during one frame.
#[derive(Debug)]
pub(crate) struct FrameState<'s> {
    sensor: &'s SensorModel,
    number: u64,
    start_s: f64,
    /// Sweeps of the first subsweep so far.
    sweeps: u64,
    temperature_c: f64,
    slow_rad: f64,
    noise: ChaCha8Rng,
    interference: ChaCha8Rng,
    jitter: FrameJitter,
}

impl FrameState<'_> {
    /// Appends the samples of a sweep of one subsweep that starts at `time_s`. `echoes` has the sum of
    /// the echoes in each point, LSB, as the radar equation and [`a121::noise_rms_lsb`] give it.
    /// Returns whether a sample saturated.
    pub fn convert(
        &mut self,
        number: usize,
        time_s: f64,
        mut echoes: Vec<Complex64>,
        samples: &mut Vec<Complex<i16>>,
    ) -> bool {
        let SubsweepModel { subsweep, levels, background, .. } = &self.sensor.subsweeps[number];
        let at_rest = levels.echo_factor;
        let levels = levels.at(subsweep.profile, self.temperature_c);
        let fading = Module::turn(self.temperature_c - REFERENCE_C) * (levels.echo_factor / at_rest);
        for (n, value) in echoes.iter_mut().enumerate() {
            *value = *value * levels.echo_factor + background.get(n).map_or(Complex64::ZERO, |own| own * fading);
        }
        self.shake(subsweep, time_s, &mut echoes);
        self.disturb(levels.noise_rms_lsb, &mut echoes);
        self.add_noise(levels.noise_rms_lsb, &mut echoes);
        self.sweeps += u64::from(number == 0);
        digitise(&echoes, samples)
    }

    /// Jitter.
    fn shake(&mut self, subsweep: &Subsweep, time_s: f64, signal: &mut [Complex64]) {
        let strength = self.sensor.effects.jitter;
        if strength == 0.0 {
            return;
        }
        let recorded = self.sensor.recorded.as_ref();
        let recorded = recorded.and_then(|of| of.jitter(subsweep, self.number, time_s - self.start_s));
        let slow_rad = if recorded.is_some() { 0.0 } else { self.slow_rad };
        let factors = recorded.unwrap_or_else(|| self.jitter.next(subsweep, time_s));
        for (value, (amplitude, phase_rad)) in signal.iter_mut().zip(factors) {
            *value *= math::from_polar(1.0 + strength * (amplitude - 1.0), strength * phase_rad + slow_rad);
        }
    }

    /// Interference by another radar.
    fn disturb(&mut self, noise_rms_lsb: f64, signal: &mut [Complex64]) {
        let share = INTERFERENCE_SHARE * self.sensor.effects.interference;
        if share == 0.0 {
            return;
        }
        let per_axis = noise_rms_lsb * from_db(INTERFERENCE_DB) * std::f64::consts::FRAC_1_SQRT_2;
        for value in signal {
            if self.interference.random_range(0.0..1.0) < share {
                let mut part = || per_axis * Distribution::<f64>::sample(&StandardNormal, &mut self.interference);
                *value += Complex64::new(part(), part());
            }
        }
    }

    fn add_noise(&mut self, noise_rms_lsb: f64, signal: &mut [Complex64]) {
        let sweep = self.number * self.sensor.sweeps_per_frame + self.sweeps;
        let per_axis = noise_rms_lsb / 2f64.sqrt();
        for (n, value) in signal.iter_mut().enumerate() {
            if let Some(noise) = self.sensor.recorded.as_ref().and_then(|of| of.noise(n, sweep)) {
                *value += noise_rms_lsb * noise;
                continue;
            }
            let mut part = || -> f64 { per_axis * Distribution::<f64>::sample(&StandardNormal, &mut self.noise) };
            let re = part();
            *value += Complex64::new(re, part());
        }
    }
}

/// The converter's 16 bits; returns whether a sample saturated. There is no recovery after saturation: each point is
/// measured by its own pulses, of which the last point's are long gone.
fn digitise(signal: &[Complex64], samples: &mut Vec<Complex<i16>>) -> bool {
    let mut saturated = false;
    let mut convert = |v: f64| {
        let level = v.round();
        saturated |= !(f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&level);
        level as i16
    };
    samples.extend(signal.iter().map(|value| Complex::new(convert(value.re), convert(value.im))));
    saturated
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::{Profile, preset};

    fn only(name: &str) -> SensorEffects {
        let mut effects = SensorEffects::NONE;
        *effects.strength_mut(name).unwrap() = 1.0;
        effects
    }

    /// Samples of frames with the same echo in every point.
    fn samples(effects: SensorEffects, echo_lsb: f64, frames: u64) -> Vec<Complex<i16>> {
        let config = preset("d16").unwrap();
        let sensor = SensorModel::new(&config, effects, 3);
        let mut samples = Vec::new();
        for number in 0..frames {
            let mut frame = sensor.frame(number, number as f64 / 66.0);
            for sweep in 0..16 {
                let time_s = number as f64 / 66.0 + f64::from(sweep) * 0.9e-3;
                frame.convert(0, time_s, vec![Complex64::from(echo_lsb); 50], &mut samples);
            }
        }
        samples
    }

    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let values: Vec<f64> = values.collect();
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn noise_has_expected_rms() {
        let noise = rms(samples(SensorEffects::NONE, 0.0, 20).iter().map(|s| f64::from(s.re).hypot(f64::from(s.im))));
        assert!((noise / a121::noise_rms_lsb(&preset("d16").unwrap().subsweeps[0]) - 1.0).abs() < 0.03);
    }

    #[test]
    fn strong_echoes_show_jitter_and_weak_ones_do_not() {
        let phase = |effects, echo_lsb| {
            rms(samples(effects, echo_lsb, 200).iter().map(|s| f64::from(s.im).atan2(f64::from(s.re))))
        };
        // 0.078 rad of sweeps and 0.046 rad of the slow part, with HWAAS 16.
        assert!((phase(only("jitter"), 20_000.0) - 0.0906).abs() < 0.01, "{}", phase(only("jitter"), 20_000.0));
        assert!(phase(SensorEffects::NONE, 20_000.0) < 0.01);
    }

    #[test]
    fn interference_raises_the_tail_of_the_noise_alone() {
        let above = |effects| {
            let limit = 4.0 * a121::noise_rms_lsb(&preset("d16").unwrap().subsweeps[0]);
            let samples = samples(effects, 0.0, 50);
            samples.iter().filter(|s| f64::from(s.re).hypot(f64::from(s.im)) > limit).count() as f64
                / samples.len() as f64
        };
        assert!(above(SensorEffects::NONE) < 1e-4);
        // A Rayleigh amplitude four times the receiver's exceeds the limit in 39 % of the cases.
        assert!((above(only("interference")) - 0.0039).abs() < 0.001, "{}", above(only("interference")));
    }

    #[test]
    fn loopback_shares_part_of_the_jitter() {
        let mut config = preset("d16").unwrap();
        let echo = Subsweep { profile: Profile::P1, hwaas: 2, num_points: 8, ..config.subsweeps[0] };
        let loopback = Subsweep {
            profile: Profile::P4,
            hwaas: 2,
            start_point: 0,
            num_points: 1,
            receiver_gain: 15,
            enable_loopback: true,
            ..config.subsweeps[0]
        };
        config.subsweeps = vec![loopback, echo];
        let sensor = SensorModel::new(&config, only("jitter"), 5);
        assert!(!sensor.hears_echoes(0) && sensor.hears_echoes(1));
        let mut sweeps = Vec::new();
        for number in 0..300 {
            let mut frame = sensor.frame(number, number as f64 * 0.02);
            for sweep in 0..10 {
                let time_s = number as f64 * 0.02 + f64::from(sweep) * 0.86e-3;
                let mut samples = Vec::new();
                frame.convert(0, time_s, vec![Complex64::ZERO], &mut samples);
                frame.convert(1, time_s + 0.1e-3, vec![Complex64::from(20_000.0); 8], &mut samples);
                sweeps.push([0, 4].map(|n| f64::from(samples[n].im).atan2(f64::from(samples[n].re))));
            }
        }
        let correlation = |pairs: &[[f64; 2]]| {
            let product = pairs.iter().map(|p| p[0] * p[1]).sum::<f64>() / pairs.len() as f64;
            product / (rms(pairs.iter().map(|p| p[0])) * rms(pairs.iter().map(|p| p[1])))
        };
        // Recorded: 0.4 for sweeps, 0.80 to 0.87 for the means of ten of them.
        assert!((0.35..0.55).contains(&correlation(&sweeps)), "{}", correlation(&sweeps));
        let means: Vec<[f64; 2]> =
            sweeps.chunks(10).map(|ten| [0, 1].map(|n| ten.iter().map(|p| p[n]).sum::<f64>() / 10.0)).collect();
        assert!((0.75..0.9).contains(&correlation(&means)), "{}", correlation(&means));
    }

    #[test]
    fn range_bias_belongs_to_the_module() {
        let config = preset("d16").unwrap();
        let bias = |effects, seed| SensorModel::new(&config, effects, seed).range_bias_m(0);
        assert_eq!(bias(SensorEffects::NONE, 1), 0.0);
        assert!(bias(only("range_bias"), 1) != bias(only("range_bias"), 2));
    }
}
