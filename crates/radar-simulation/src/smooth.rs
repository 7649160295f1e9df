//! Smooth functions of time that motions are made of.

use std::f64::consts::TAU;

use glam::DVec3;
use radar_sar::math;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Smooth step from 0 to 1, with zero speed and acceleration at the ends (10x³ − 15x⁴ + 6x⁵).
pub(super) fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// Smooth random motion: a sum of sines per axis, mapped into a ball that it fills about evenly,
/// faded in from zero, and scaled so that it just reaches the ball's surface.
#[derive(Debug, Clone)]
pub struct Wander {
    /// Amplitude, angular frequency and phase of each sine, per axis.
    sines: Vec<[DVec3; 3]>,
    scale: f64,
}

/// Time to fade the motion in, seconds. Choice: the greatest acceleration is 5.8/T² of the offset,
/// 4 m/s² for 0.25 m, which a head reaches.
const FADE_IN_S: f64 = 0.6;

impl Wander {
    /// No motion.
    pub(super) fn none() -> Self {
        Self { sines: Vec::new(), scale: 0.0 }
    }

    /// A motion that reaches `reach` along the given axes.
    pub(super) fn new(reach: f64, axes: DVec3, duration_s: f64, rng: &mut ChaCha8Rng) -> Self {
        let sines = [0.13, 0.29, 0.47, 0.83].map(|middle_hz: f64| {
            let mut each = |low: f64, high: f64| DVec3::from_array([(); 3].map(|()| rng.random_range(low..high)));
            let hz = each(0.8, 1.25) * middle_hz;
            [axes * each(0.6, 1.4) * (0.25 / middle_hz).sqrt(), hz * TAU, each(0.0, TAU)]
        });
        let mut wander = Self { sines: sines.to_vec(), scale: 1.0 };
        let steps = (duration_s * 50.0).ceil() as usize;
        let largest = (0..=steps).map(|i| wander.at(i as f64 / 50.0).length()).fold(0.0, f64::max);
        wander.scale = if largest > 0.0 { reach / largest } else { 0.0 };
        wander
    }

    /// The offset at a time.
    pub(super) fn at(&self, time_s: f64) -> DVec3 {
        let fade = smoothstep(time_s / FADE_IN_S);
        let sum: DVec3 = self
            .sines
            .iter()
            .map(|[amplitude, omega, phase]| *amplitude * (*omega * time_s + *phase).map(math::sin))
            .sum();
        // The sines add up to about a normal distribution with σ = 0.5 per axis; this spreads it
        // over the ball.
        sum * (self.scale * fade / (sum.length_squared() + 0.36).sqrt())
    }
}
