//! Generalised least squares along the path: a Kalman filter whose state holds the place and everything that makes ranges
//! err alike.
//!
//! A sweep's range is |s − p| plus u·(R m + b + j): s the place, u the direction to it, m the mount's error (turns with the
//! sensor's rotation R), b slow wander (noise through a steep low-pass in each axis, see `wander`), j what jitter the
//! smoothing leaves (an Ornstein–Uhlenbeck process in each axis). A phase reads the same length with an offset that nobody knows. The filter
//! carries all of them jointly, so the place's covariance is right by construction, at a cost linear in the sweeps. Tested
//! against the same sum with dense matrices in `bound`.

use glam::{DMat3, DVec3};

use super::PositionErrors;
use super::wander::{Step, WANDER_STATES, Wander};

/// Place 0..3, mount 3..6, phase offset 6, jitter 7..10, then the states of the wander, axis by axis.
const STATES: usize = WANDER + 3 * WANDER_STATES;
const MOUNT: usize = 3;
const OFFSET: usize = 6;
const JITTER: usize = 7;
const WANDER: usize = 10;

/// Time over which the error of a smoothed pose stays alike, seconds: a fifth of the smoothing's window.
pub(in crate::imaging) const JITTER_S: f64 = 0.02;
/// 1σ of an offset that nobody knows, metres.
const OPEN_OFFSET_M: f64 = 0.1;
/// Innovations beyond this many sigmas count as if they lay there.
const OUTLIER_SIGMA: f64 = 3.5;

/// Where a sweep looked: what the filter needs of its geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Sight {
    /// Seconds from any fixed moment.
    pub time_s: f64,
    /// Unit vector from the sensor to the place, tracking frame.
    pub toward: DVec3,
    /// The same in the sensor's frame.
    pub toward_in_sensor: DVec3,
}

/// The filter, after the sweeps so far.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct PathFilter {
    state: [f64; STATES],
    covariance: [[f64; STATES]; STATES],
    wander: Wander,
    jitter_variance_m2: f64,
    time_s: Option<f64>,
}

/// How one measurement fared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Innovation {
    /// Measured minus expected, metres.
    pub off_m: f64,
    /// Variance that it was expected to have, m².
    pub variance_m2: f64,
}

impl Innovation {
    /// Its square in units of its variance.
    pub fn normalised(&self) -> f64 {
        self.off_m * self.off_m / self.variance_m2
    }
}

impl PathFilter {
    /// Before the first sweep: the place lies at 0 with this covariance.
    pub fn new(place_covariance_m2: &DMat3, errors: &PositionErrors) -> Self {
        let wander = Wander::new(errors);
        let jitter_variance_m2 = errors.jitter_m * errors.jitter_m;
        let mut covariance = [[0.0; STATES]; STATES];
        for (row, place) in place_covariance_m2.to_cols_array_2d().iter().enumerate() {
            covariance[row][..3].copy_from_slice(place);
            covariance[MOUNT + row][MOUNT + row] = errors.mount_variance_m2();
            covariance[JITTER + row][JITTER + row] = jitter_variance_m2;
            let at = WANDER + WANDER_STATES * row;
            for (i, stationary) in wander.stationary.iter().enumerate() {
                covariance[at + i][at..at + WANDER_STATES].copy_from_slice(stationary);
            }
        }
        covariance[OFFSET][OFFSET] = OPEN_OFFSET_M * OPEN_OFFSET_M;
        Self { state: [0.0; STATES], covariance, wander, jitter_variance_m2, time_s: None }
    }

    /// The place's offset from where the sights were taken, metres.
    pub fn place_m(&self) -> DVec3 {
        DVec3::new(self.state[0], self.state[1], self.state[2])
    }

    /// The place's covariance, m².
    pub fn place_covariance_m2(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&[0, 1, 2].map(|col| [0, 1, 2].map(|row| self.covariance[row][col])))
    }

    /// Lets time pass until a sight.
    pub fn advance(&mut self, sight: &Sight) {
        let passed_s = self.time_s.map_or(0.0, |before| (sight.time_s - before).max(0.0));
        self.time_s = Some(sight.time_s);
        if passed_s <= 0.0 {
            return;
        }
        let step = self.wander.step(passed_s);
        let keep = (-passed_s / JITTER_S).exp();
        advance_row(&mut self.state, &step, keep);
        for row in &mut self.covariance {
            advance_row(row, &step, keep);
        }
        for axis in 0..3 {
            let at = WANDER + WANDER_STATES * axis;
            step.turn_rows(&mut self.covariance[at..at + WANDER_STATES]);
            for (row, added) in self.covariance[at..].iter_mut().zip(&step.added) {
                for (value, added) in row[at..].iter_mut().zip(added) {
                    *value += added;
                }
            }
            self.covariance[JITTER + axis].iter_mut().for_each(|value| *value *= keep);
            self.covariance[JITTER + axis][JITTER + axis] += self.jitter_variance_m2 * (1.0 - keep * keep);
        }
    }

    /// Forgets the phase's offset: a new one begins.
    pub fn open_offset(&mut self) {
        for other in 0..STATES {
            self.covariance[OFFSET][other] = 0.0;
            self.covariance[other][OFFSET] = 0.0;
        }
        self.state[OFFSET] = 0.0;
        self.covariance[OFFSET][OFFSET] = OPEN_OFFSET_M * OPEN_OFFSET_M;
    }

    /// How a phase's length would fare.
    pub fn expect(&self, sight: &Sight, off_m: f64, variance_m2: f64) -> Innovation {
        self.weigh(sight, true, off_m, variance_m2).1
    }

    fn weigh(&self, sight: &Sight, phase: bool, off_m: f64, variance_m2: f64) -> ([f64; STATES], Innovation) {
        let mut reads = [0.0; STATES];
        let (toward, in_sensor) = (sight.toward.to_array(), sight.toward_in_sensor.to_array());
        for axis in 0..3 {
            reads[axis] = toward[axis];
            reads[MOUNT + axis] = in_sensor[axis];
            let at = WANDER + WANDER_STATES * axis;
            for (read, share) in reads[at..].iter_mut().zip(&self.wander.reads) {
                *read = toward[axis] * share;
            }
            reads[JITTER + axis] = toward[axis];
        }
        reads[OFFSET] = if phase { 1.0 } else { 0.0 };
        let shared = self.covariance.map(|row| dot(&row, &reads));
        let innovation =
            Innovation { off_m: off_m - dot(&reads, &self.state), variance_m2: dot(&reads, &shared) + variance_m2 };
        (shared, innovation)
    }

    /// Takes a measured length, its offset from the length that the sight was taken at; `phase`: it has the unknown offset.
    /// Outliers are held back.
    pub fn take(&mut self, sight: &Sight, phase: bool, off_m: f64, variance_m2: f64) -> Innovation {
        let (shared, innovation) = self.weigh(sight, phase, off_m, variance_m2);
        let sigmas = innovation.normalised().sqrt();
        let variance_m2 = innovation.variance_m2 * (sigmas / OUTLIER_SIGMA).max(1.0);
        for (row, mine) in shared.iter().enumerate() {
            let gain = mine / variance_m2;
            self.state[row] += gain * innovation.off_m;
            for (value, other) in self.covariance[row].iter_mut().zip(&shared) {
                *value -= gain * other;
            }
        }
        innovation
    }
}

/// A row of the covariance, or the state, after some time: what is measured along it.
fn advance_row(row: &mut [f64; STATES], step: &Step, keep: f64) {
    row[JITTER..JITTER + 3].iter_mut().for_each(|value| *value *= keep);
    row[WANDER..].chunks_exact_mut(WANDER_STATES).for_each(|axis| step.turn_row(axis));
}

fn dot(a: &[f64; STATES], b: &[f64; STATES]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
