//! Sensor background: what the sensor receives of itself and of its mounting (leakage, ringing), the same in every
//! sweep.
//!
//! While the sensor moves, the echoes of the room turn in phase by 720° per wavelength of 5 mm and cancel in the mean
//! over sweeps; what is left is the background. It is subtracted at near ranges, once it is known. Without that, it looks
//! like a wall that accompanies every straight path of the head, a few decimetres beside it. A sensor at rest changes
//! nothing: a room's echoes and the background are then alike.

use std::collections::BTreeMap;

use num_complex::Complex32;
use radar_sar::Observation;

/// Ranges beyond this are left alone, metres. Choice: the ringing of the mounting that was measured, 66 LSB at 0.2 m, has
/// fallen below the noise there, also that of the sub-apertures of some seconds together. Measured: with 0.6 m what was
/// left looked like walls at 0.63 m (`lab play --world dining --effects measured`).
const MAX_RANGE_M: f64 = 1.0;
/// Sweeps count while the sensor is at least this fast, m/s. Choice: a slowly turning head; the phase of an echo ahead
/// turns forty times a second.
const MIN_SPEED_M_PER_S: f64 = 0.1;
/// Sweeps of this much time are averaged before they count as one sample of the background, nanoseconds. Choice: longer
/// than echoes keep their phase, so that samples are independent.
const BLOCK_NS: i64 = 100_000_000;
/// Sweeps further apart belong to two blocks, nanoseconds. Choice: five times the slowest preset's period.
const MAX_PAUSE_NS: i64 = 200_000_000;
/// Memory of the mean, in blocks. Choice: 20 s of motion, in which a warming sensor's background turns by less than 0.01 rad.
const MEMORY_BLOCKS: f32 = 200.0;
/// Fewer blocks than these say nothing about their own spread. Choice: 2 s of motion.
const MIN_BLOCKS: f32 = 20.0;
/// A mean counts as background when its power exceeds its own variance by this factor. Choice: noise alone reaches it
/// with a probability of e⁻¹⁶.
const MIN_SIGNIFICANCE: f32 = 16.0;

/// Background of all subsweeps.
#[derive(Debug, Default)]
pub(super) struct SensorBackground {
    /// By subsweep.
    subsweeps: BTreeMap<usize, SubsweepBackground>,
}

/// Background of one subsweep's near points.
#[derive(Debug, Default)]
struct SubsweepBackground {
    block: Block,
    blocks: f32,
    /// End of the block with which it was known.
    known_since_ns: Option<i64>,
    points: Vec<PointBackground>,
}

/// Sweeps of the block that is being gathered.
#[derive(Debug, Default)]
struct Block {
    first_ns: i64,
    last_ns: i64,
    sweeps: u32,
    /// By point.
    sums: Vec<Complex32>,
}

/// Mean over blocks, and the blocks' variance about it, LSB and LSB².
#[derive(Debug, Clone, Copy, Default)]
struct PointBackground {
    mean: Complex32,
    variance: f32,
}

impl SensorBackground {
    /// Learns from a sweep, and subtracts from it the background that is known.
    pub fn subtract(&mut self, sweep: &mut Observation) {
        let axis = &sweep.geometry.axis;
        let near = (0..axis.points).take_while(|n| axis.first_m + *n as f64 * axis.step_m <= MAX_RANGE_M).count();
        let near = near.min(sweep.samples.len());
        if near == 0 {
            return;
        }
        let background = self.subsweeps.entry(sweep.geometry.subsweep).or_default();
        background.learn(sweep, near);
        for (sample, point) in sweep.samples[..near].iter_mut().zip(&background.points) {
            *sample -= point.significant(background.blocks);
        }
    }

    /// Time from which on the background of every subsweep with near points is known, host nanoseconds; `None` while it
    /// is not.
    pub fn known_since_ns(&self) -> Option<i64> {
        self.subsweeps.values().try_fold(i64::MIN, |since, background| Some(since.max(background.known_since_ns?)))
    }
}

impl SubsweepBackground {
    fn learn(&mut self, sweep: &Observation, near: usize) {
        let block = &self.block;
        let (age_ns, pause_ns) =
            (sweep.mid_time_ns.saturating_sub(block.first_ns), sweep.mid_time_ns.saturating_sub(block.last_ns));
        if block.sweeps > 0 && (age_ns >= BLOCK_NS || pause_ns > MAX_PAUSE_NS) {
            self.close_block();
        }
        if sweep.velocity_m_per_s.length() < MIN_SPEED_M_PER_S {
            return;
        }
        let block = &mut self.block;
        if block.sweeps == 0 {
            block.first_ns = sweep.mid_time_ns;
            block.sums.clear();
            block.sums.resize(near, Complex32::ZERO);
        }
        block.last_ns = sweep.mid_time_ns;
        block.sweeps += 1;
        block.sums.iter_mut().zip(&sweep.samples).for_each(|(sum, sample)| *sum += sample);
    }

    fn close_block(&mut self) {
        let sweeps = std::mem::take(&mut self.block.sweeps) as f32;
        // The same number of points in every sweep of a subsweep.
        self.points.resize(self.block.sums.len(), PointBackground::default());
        self.blocks = (self.blocks + 1.0).min(MEMORY_BLOCKS);
        if self.blocks >= MIN_BLOCKS {
            self.known_since_ns.get_or_insert(self.block.last_ns);
        }
        for (point, sum) in self.points.iter_mut().zip(&self.block.sums) {
            point.add(sum / sweeps, self.blocks);
        }
    }
}

impl PointBackground {
    /// Adds a block's mean; `blocks` counts it.
    fn add(&mut self, sample: Complex32, blocks: f32) {
        let share = 1.0 / blocks;
        let difference = sample - self.mean;
        self.mean += difference * share;
        self.variance = (1.0 - share) * (self.variance + share * difference.norm_sqr());
    }

    /// The mean, or zero while it may be chance.
    fn significant(&self, blocks: f32) -> Complex32 {
        let is_known = blocks >= MIN_BLOCKS && self.mean.norm_sqr() * blocks > MIN_SIGNIFICANCE * self.variance;
        if is_known { self.mean } else { Complex32::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::sync::Arc;

    use glam::DVec3;
    use radar_sar::geometry::Pose;
    use radar_sar::{RangeAxis, SweepGeometry, math};

    use super::*;

    const RING_LSB: f32 = 60.0;

    /// A sweep at a time: a ring at all points, a wall's echo that turns as the sensor moves.
    fn sweep(number: usize, speed_m_per_s: f64, ring: Complex32) -> Observation {
        let axis = RangeAxis { first_m: 0.2, step_m: 0.06, points: 50 };
        let geometry = SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.14, point_period_s: 1e-5 };
        let time_s = number as f64 * 1e-3;
        let (sin, cos) = math::sin_cos(TAU * speed_m_per_s * time_s / 0.0025 + (number % 7) as f64);
        let echo = Complex32::new(cos as f32, sin as f32) * 500.0;
        Observation {
            mid_time_ns: number as i64 * 1_000_000,
            tracking_from_sensor: Pose::IDENTITY,
            velocity_m_per_s: DVec3::X * speed_m_per_s,
            geometry: Arc::new(geometry),
            samples: vec![echo + ring; 50],
        }
    }

    /// Mean of the near and of the far points over the last second of some seconds.
    fn left(seconds: usize, speed_m_per_s: f64) -> [f32; 2] {
        let (mut background, ring) = (SensorBackground::default(), Complex32::new(0.0, RING_LSB));
        let mut sums = [Complex32::ZERO; 2];
        for number in 0..seconds * 1000 {
            let mut sweep = sweep(number, speed_m_per_s, ring);
            background.subtract(&mut sweep);
            if number >= (seconds - 1) * 1000 {
                sums[0] += sweep.samples[0];
                sums[1] += sweep.samples[40];
            }
        }
        sums.map(|sum| (sum / 1000.0).norm())
    }

    #[test]
    fn background_of_a_moving_sensor_is_subtracted_at_near_ranges() {
        let [near, far] = left(8, 0.37);
        assert!(near < 0.1 * RING_LSB && (far - RING_LSB).abs() < 0.1 * RING_LSB, "{near} {far}");
    }

    #[test]
    fn echoes_of_a_sensor_at_rest_stay() {
        let [near, far] = left(8, 0.0);
        assert_eq!(near, far);
        assert!(near >= RING_LSB, "{near}");
    }

    #[test]
    fn background_is_known_after_two_seconds_of_motion_and_never_at_rest() {
        let known_since_ns = |speed_m_per_s: f64| {
            let mut background = SensorBackground::default();
            (0..3000).for_each(|n| background.subtract(&mut sweep(n, speed_m_per_s, Complex32::ONE)));
            background.known_since_ns()
        };
        assert!((1_900_000_000..2_000_000_000).contains(&known_since_ns(0.37).unwrap()));
        assert_eq!(known_since_ns(0.0), None);
    }

    #[test]
    fn echoes_without_background_stay_bit_for_bit() {
        let mut background = SensorBackground::default();
        for number in 0..8000 {
            let before = sweep(number, 0.37, Complex32::ZERO);
            let mut after = before.clone();
            background.subtract(&mut after);
            assert_eq!(after.samples, before.samples, "{number}");
        }
    }
}
