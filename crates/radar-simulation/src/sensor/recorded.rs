//! Jitter and noise of a real sensor, from recordings of scenes at rest, to be laid over simulated echoes.
//!
//! In a scene at rest each point's sample is a constant echo times the jitter, plus noise. Where the echo is strong, a
//! sample divided by the mean is the jitter; where there is none, a sample less the mean is the noise. Both are
//! played back as they were recorded, sweep after sweep of a frame and point after point of a sweep, so that their
//! distributions and their correlations in time and range are the sensor's own.

use num_complex::{Complex, Complex64};

use a121::{Frame, SensorConfig, Subsweep, frame_timing, noise_rms_lsb};
use radar_sar::math;

use super::jitter::phase_rms_rad;

/// Amplitude of an echo from which on its jitter is seen, over the noise. Choice: noise then has 0.035 rad beside a
/// jitter of 0.09, 13 % of the power, which is taken off.
const MIN_ECHO_OVER_NOISE: f64 = 20.0;
/// Mean amplitude up to which a point has no echo, over the noise, and the most that its fluctuations may be over
/// the noise. Choice: an echo of that strength with a jitter of 10 % adds a twentieth to the noise's power; what
/// fluctuates more is no noise of the receiver.
const MAX_MEAN_OVER_NOISE: f64 = 3.0;
const MAX_FLUCTUATION_OVER_NOISE: f64 = 1.5;
/// Least number of sweeps in a frame, of frames, and of points of noise. Choice: a sub-aperture has a hundred sweeps;
/// fewer sweeps together say nothing of how jitter is correlated.
const MIN_SWEEPS: usize = 8;
const MIN_FRAMES: usize = 8;
const MIN_NOISE_POINTS: usize = 4;

/// What recordings say of a sensor; each part is played back instead of the model's.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedSensor {
    jitter: Option<Jitter>,
    noise: Option<Noise>,
}

/// Why recordings say nothing of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "no jitter and no noise can be taken from the recordings: they need {MIN_FRAMES} frames of {MIN_SWEEPS} sweeps of a \
     scene at rest, with an echo {MIN_ECHO_OVER_NOISE} times the noise, or with {MIN_NOISE_POINTS} points without an echo"
)]
pub struct RecordedSensorError;

/// Factors of an echo's amplitude and phase.
#[derive(Debug, Clone, PartialEq)]
struct Jitter {
    /// `[frame][sweep][point]`: amplitude and phase, radians.
    factors: Vec<Vec<Vec<(f64, f64)>>>,
    sweep_period_s: f64,
    step_m: f64,
    hwaas: u32,
}

/// Noise of unit power.
#[derive(Debug, Clone, PartialEq)]
struct Noise {
    /// `[point][sweep]`.
    samples: Vec<Vec<Complex64>>,
}

impl RecordedSensor {
    /// From recordings of scenes at rest: the jitter of the one with most points with a strong echo, the noise of the
    /// one with most points without.
    ///
    /// # Errors
    /// No recording shows either.
    pub fn of_scenes_at_rest<'r>(
        recordings: impl IntoIterator<Item = (&'r SensorConfig, &'r [Frame])>,
    ) -> Result<Self, RecordedSensorError> {
        let recordings = recordings.into_iter().collect::<Vec<_>>();
        let subsweeps = || recordings.iter().flat_map(|(config, frames)| RecordedSubsweep::all(config, frames));
        let jitters = subsweeps().filter_map(|recorded| recorded.jitter());
        let jitter = jitters.max_by_key(|jitter| jitter.factors[0][0].len());
        let noise = subsweeps().filter_map(|recorded| recorded.noise()).max_by_key(|noise| noise.samples.len());
        if jitter.is_none() && noise.is_none() { Err(RecordedSensorError) } else { Ok(Self { jitter, noise }) }
    }

    /// Jitter of the phase, radians rms, over all points and sweeps, with the HWAAS that it was recorded with.
    pub fn phase_jitter(&self) -> Option<(f64, u32)> {
        let jitter = self.jitter.as_ref()?;
        let phases: Vec<f64> = jitter.factors.iter().flatten().flatten().map(|factor| factor.1).collect();
        let power = phases.iter().map(|phase_rad| phase_rad * phase_rad).sum::<f64>() / phases.len() as f64;
        Some((power.sqrt(), jitter.hwaas))
    }

    /// Whether there is noise to play back.
    pub fn has_noise(&self) -> bool {
        self.noise.is_some()
    }

    /// Amplitude and phase, radians, of the factor of each point of a sweep that begins this long after the frame;
    /// `None`: there is no recorded jitter.
    pub(crate) fn jitter(&self, subsweep: &Subsweep, frame: u64, time_s: f64) -> Option<Vec<(f64, f64)>> {
        let jitter = self.jitter.as_ref()?;
        let of_frame = &jitter.factors[(frame % jitter.factors.len() as u64) as usize];
        let sweep = &of_frame[reflected(time_s / jitter.sweep_period_s, of_frame.len())];
        let scale = phase_rms_rad(subsweep.hwaas) / phase_rms_rad(jitter.hwaas);
        let at = |n: u32| {
            let (amplitude, phase_rad) =
                sweep[reflected(f64::from(n) * subsweep.step_m() / jitter.step_m, sweep.len())];
            (amplitude, phase_rad * scale)
        };
        Some((0..subsweep.num_points).map(at).collect())
    }

    /// Noise of unit power in a point of a sweep, by the number of the sweep from the start; `None`: there is none
    /// recorded.
    pub(crate) fn noise(&self, point: usize, sweep: u64) -> Option<Complex64> {
        let samples = &self.noise.as_ref()?.samples;
        let of_point = &samples[point % samples.len()];
        Some(of_point[(sweep % of_point.len() as u64) as usize])
    }
}

/// An index into `count` values that runs forwards and backwards in turn, so that neighbours stay neighbours.
fn reflected(at: f64, count: usize) -> usize {
    let period = (2 * (count - 1)).max(1);
    let at = at.max(0.0).round() as usize % period;
    at.min(period - at).min(count - 1)
}

/// A subsweep of a recording.
struct RecordedSubsweep<'r> {
    subsweep: &'r Subsweep,
    sweep_period_s: f64,
    /// `[frame][sweep]`.
    sweeps: Vec<Vec<&'r [Complex<i16>]>>,
    /// By point, over all sweeps.
    means: Vec<Complex64>,
}

impl<'r> RecordedSubsweep<'r> {
    /// The subsweeps with echoes, of recordings with enough sweeps.
    fn all(config: &'r SensorConfig, frames: &'r [Frame]) -> Vec<Self> {
        let whole = frames.iter().filter(|frame| frame.samples.len() == config.points_per_frame());
        if whole.count() < MIN_FRAMES || (config.sweeps_per_frame as usize) < MIN_SWEEPS {
            return Vec::new();
        }
        let hears = config.subsweeps.iter().enumerate().filter(|(_, s)| s.hears_echoes());
        hears.map(|(index, _)| Self::new(config, index, frames)).collect()
    }

    fn new(config: &'r SensorConfig, index: usize, frames: &'r [Frame]) -> Self {
        let points = |subsweeps: &[Subsweep]| subsweeps.iter().map(|s| s.num_points as usize).sum::<usize>();
        let (subsweep, before) = (&config.subsweeps[index], points(&config.subsweeps[..index]));
        let of_it = before..before + subsweep.num_points as usize;
        let whole = frames.iter().filter(|frame| frame.samples.len() == config.points_per_frame());
        let of_frame = |frame: &'r Frame| {
            frame.samples.chunks_exact(points(&config.subsweeps)).map(|sweep| &sweep[of_it.clone()]).collect()
        };
        let sweeps: Vec<Vec<&[Complex<i16>]>> = whole.map(of_frame).collect();
        let count = sweeps.iter().map(Vec::len).sum::<usize>() as f64;
        let mean = |n: usize| sweeps.iter().flatten().map(|sweep| complex(sweep[n])).sum::<Complex64>() / count;
        let means = (0..subsweep.num_points as usize).map(mean).collect();
        Self { subsweep, sweep_period_s: frame_timing(config).sweep_period_s, sweeps, means }
    }

    fn points(&self, is_wanted: impl Fn(f64) -> bool) -> Vec<usize> {
        let over_noise = |n: &usize| math::hypot(self.means[*n].re, self.means[*n].im) / noise_rms_lsb(self.subsweep);
        (0..self.means.len()).filter(|n| is_wanted(over_noise(n))).collect()
    }

    fn jitter(&self) -> Option<Jitter> {
        let points = self.points(|over_noise| over_noise >= MIN_ECHO_OVER_NOISE);
        let shares: Vec<[f64; 2]> = points.iter().map(|&n| self.share_of_jitter(n)).collect();
        let of_sweep = |sweep: &&[Complex<i16>]| {
            let factor = |(&n, [of_amplitude, of_phase]): (&usize, &[f64; 2])| {
                let (amplitude, phase_rad) = self.factor(sweep, n);
                (1.0 + of_amplitude * (amplitude - 1.0), of_phase * phase_rad)
            };
            points.iter().zip(&shares).map(factor).collect()
        };
        (!points.is_empty()).then(|| Jitter {
            factors: self.sweeps.iter().map(|frame| frame.iter().map(of_sweep).collect()).collect(),
            sweep_period_s: self.sweep_period_s,
            step_m: self.subsweep.step_m(),
            hwaas: self.subsweep.hwaas,
        })
    }

    /// Amplitude and phase, radians, of a sample relative to the mean of its point.
    fn factor(&self, sweep: &[Complex<i16>], n: usize) -> (f64, f64) {
        let factor = complex(sweep[n]) / self.means[n];
        (math::hypot(factor.re, factor.im), math::atan2(factor.im, factor.re))
    }

    /// Share of the jitter's rms in the fluctuation of amplitude and of phase at a point; the rest is noise, which has
    /// half of its power in either.
    fn share_of_jitter(&self, n: usize) -> [f64; 2] {
        let factors: Vec<(f64, f64)> = self.sweeps.iter().flatten().map(|sweep| self.factor(sweep, n)).collect();
        let mean = |values: &dyn Fn(&(f64, f64)) -> f64| factors.iter().map(values).sum::<f64>() / factors.len() as f64;
        let noise = 0.5 * noise_rms_lsb(self.subsweep).powi(2) / self.means[n].norm_sqr();
        let powers = [mean(&|factor| (factor.0 - 1.0).powi(2)), mean(&|factor| factor.1.powi(2))];
        powers.map(|power| (1.0 - noise / power.max(1e-12)).max(0.0).sqrt())
    }

    fn noise(&self) -> Option<Noise> {
        let samples = self.points(|over_noise| over_noise <= MAX_MEAN_OVER_NOISE).into_iter().filter_map(|n| {
            let off: Vec<Complex64> =
                self.sweeps.iter().flatten().map(|sweep| complex(sweep[n]) - self.means[n]).collect();
            let rms = (off.iter().map(Complex64::norm_sqr).sum::<f64>() / off.len() as f64).sqrt();
            let is_noise = rms > 0.0 && rms <= MAX_FLUCTUATION_OVER_NOISE * noise_rms_lsb(self.subsweep);
            is_noise.then(|| off.into_iter().map(|value| value / rms).collect())
        });
        let samples: Vec<Vec<Complex64>> = samples.collect();
        (samples.len() >= MIN_NOISE_POINTS).then_some(Noise { samples })
    }
}

fn complex(sample: Complex<i16>) -> Complex64 {
    Complex64::new(f64::from(sample.re), f64::from(sample.im))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{SensorEffects, SensorModel};
    use a121::preset;

    /// Frames of an echo at rest in the first points, by the model of the sensor.
    fn at_rest(config: &SensorConfig, echo_points: usize, frames: u64) -> Vec<Frame> {
        let sensor = SensorModel::new(config, SensorEffects { jitter: 1.0, ..SensorEffects::NONE }, 7);
        let points = config.subsweeps[0].num_points as usize;
        let period_s = frame_timing(config).sweep_period_s;
        let frame = |number: u64| {
            let start_s = number as f64 * 0.2;
            let (mut state, mut samples) = (sensor.frame(number, start_s), Vec::new());
            for sweep in 0..config.sweeps_per_frame {
                let echo = |n: usize| if n < echo_points { Complex64::from(20_000.0) } else { Complex64::ZERO };
                let time_s = start_s + f64::from(sweep) * period_s;
                state.convert(0, time_s, (0..points).map(echo).collect(), &mut samples);
            }
            Frame {
                tick: number as i64,
                host_time_ns: number as i64,
                temperature_c: 25,
                data_saturated: false,
                frame_delayed: false,
                calibration_needed: false,
                samples,
            }
        };
        (0..frames).map(frame).collect()
    }

    fn recorded(config: &SensorConfig, echo_points: usize) -> Result<RecordedSensor, RecordedSensorError> {
        RecordedSensor::of_scenes_at_rest([(config, at_rest(config, echo_points, 300).as_slice())])
    }

    fn rms(values: &[f64]) -> f64 {
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn jitter_and_noise_come_back_as_they_were() {
        let config = preset("d16").unwrap();
        let subsweep = &config.subsweeps[0];
        let recorded = recorded(&config, 20).unwrap();
        assert!(recorded.has_noise());
        let period_s = frame_timing(&config).sweep_period_s;
        let phases = |frame: u64, sweep: usize| -> Vec<f64> {
            let factors = recorded.jitter(subsweep, frame, sweep as f64 * period_s).unwrap();
            factors.iter().map(|factor| factor.1).collect()
        };
        let all: Vec<f64> =
            (0..300).flat_map(|frame| (0..16).map(move |sweep| (frame, sweep))).map(|(f, s)| phases(f, s)[3]).collect();
        // The model's jitter with HWAAS 16 and its slow part; the mean of all frames has none of either.
        assert!((rms(&all) - 0.0906).abs() < 0.008, "{}", rms(&all));
        let products: f64 = all.chunks(16).flat_map(|frame| frame.windows(2)).map(|pair| pair[0] * pair[1]).sum();
        assert!(products > 0.0, "sweeps of a frame are correlated");
        assert_eq!(phases(5, 2)[..20], phases(305, 2)[..20], "it begins again");
        assert_eq!(
            (phases(0, 0)[21], phases(0, 0)[19]),
            (phases(0, 0)[17], phases(0, 0)[19]),
            "backwards after the last point"
        );
        let noise: Vec<f64> = (0..4000).map(|n| recorded.noise(n % 50, (n / 50) as u64).unwrap().norm()).collect();
        assert!((rms(&noise) - 1.0).abs() < 0.05, "{}", rms(&noise));
    }

    #[test]
    fn a_recording_without_echoes_gives_noise_alone_and_a_short_one_nothing() {
        let config = preset("d16").unwrap();
        let parts = |echo_points: usize| {
            let recorded = recorded(&config, echo_points).unwrap();
            (recorded.phase_jitter().is_some(), recorded.has_noise())
        };
        assert_eq!([0, 20, 50].map(parts), [(false, true), (true, true), (true, false)]);
        let few = at_rest(&config, 20, MIN_FRAMES as u64 - 1);
        assert_eq!(RecordedSensor::of_scenes_at_rest([(&config, few.as_slice())]), Err(RecordedSensorError));
        let mut damaged = at_rest(&config, 20, MIN_FRAMES as u64);
        damaged[0].samples.pop();
        assert_eq!(RecordedSensor::of_scenes_at_rest([(&config, damaged.as_slice())]), Err(RecordedSensorError));
        assert_eq!(RecordedSensor::of_scenes_at_rest([]), Err(RecordedSensorError));
    }

    #[test]
    fn indices_run_forwards_and_backwards() {
        let run: Vec<usize> = (0..9).map(|n| reflected(f64::from(n), 4)).collect();
        assert_eq!(run, [0, 1, 2, 3, 2, 1, 0, 1, 2]);
        assert_eq!((0..3).map(|n| reflected(f64::from(n), 1)).collect::<Vec<_>>(), [0; 3]);
    }
}
