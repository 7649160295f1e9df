//! Generalised least squares along the path: a Kalman filter whose state holds the position and all
//! correlated range errors.
//!
//! A sweep's range is |s − p| plus u·(R m + b + j): s is the position, u the direction to it, m the
//! mount's error (rotating with the sensor's rotation R), b slow drift (noise through a steep
//! low-pass in each axis, see `wander`), j the jitter left by smoothing (an Ornstein–Uhlenbeck
//! process in each axis). A phase measures the same length with an unknown offset. The filter
//! estimates all of them jointly, so the position's covariance is consistent by construction, at a
//! cost linear in the number of sweeps. Tested against the same model with dense matrices in
//! `bound`.

use glam::{DMat3, DVec3};

use super::PositionErrors;
use super::wander::{Step, WANDER_STATES, Wander};

use crate::math;

/// State layout: position 0..3, mount 3..6, phase offset 6, jitter 7..10, then the drift's states,
/// axis by axis.
const STATES: usize = WANDER + 3 * WANDER_STATES;
const MOUNT: usize = 3;
const OFFSET: usize = 6;
const JITTER: usize = 7;
const WANDER: usize = 10;

/// Correlation time of a smoothed pose's error, seconds. Choice: a fifth of the default smoothing
/// window, 0.1 s, for a local quadratic fit.
pub(crate) const JITTER_S: f64 = 0.02;
/// 1σ of an unknown offset, metres. Choice: far beyond λ/2, so that the first phase is free, small
/// enough for f64's matrices.
const OPEN_OFFSET_M: f64 = 0.1;
/// Innovations beyond this many sigma are limited to it. Choice: one in 2000 of regular
/// innovations; a larger one is interference or another echo.
pub(crate) const OUTLIER_SIGMA: f64 = 3.5;

/// One sweep's geometry as the filter needs it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sight {
    /// Time since an arbitrary fixed moment, seconds.
    pub time_s: f64,
    /// Unit vector from the sensor to the position, tracking frame.
    pub toward: DVec3,
    /// The same in the sensor frame.
    pub toward_in_sensor: DVec3,
}

/// The filter after the sweeps so far. It can carry several hypotheses that differ in the measured
/// values they assume. The covariance does not depend on the values and is shared.
#[derive(Debug, Clone)]
pub(crate) struct PathFilter {
    states: Vec<[f64; STATES]>,
    covariance: [[f64; STATES]; STATES],
    wander: Wander,
    jitter_variance_m2: f64,
    time_s: Option<f64>,
}

/// A predicted measurement.
#[derive(Debug, Clone)]
pub(crate) struct Innovation {
    /// Each hypothesis's prediction, metres.
    pub expected_m: Vec<f64>,
    /// Variance of the measurement around the prediction, m².
    pub variance_m2: f64,
    /// Covariance of the measurement with the state.
    shared: [f64; STATES],
}

impl PathFilter {
    /// Before the first sweep: the position is 0 with this covariance.
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
        Self { states: vec![[0.0; STATES]], covariance, wander, jitter_variance_m2, time_s: None }
    }

    /// The same, with the position at `place_m`, metres.
    pub fn starting_at(mut self, place_m: DVec3) -> Self {
        self.states.iter_mut().for_each(|state| state[..3].copy_from_slice(&place_m.to_array()));
        self
    }

    /// Each hypothesis's position, relative to the point at which the sweeps were linearised,
    /// metres.
    pub fn places_m(&self) -> impl Iterator<Item = DVec3> {
        self.states.iter().map(|state| DVec3::new(state[0], state[1], state[2]))
    }

    /// Replaces the hypotheses by copies of those numbered; each may occur any number of times.
    pub fn branch(&mut self, from: impl Iterator<Item = usize>) {
        self.states = from.map(|n| self.states[n]).collect();
    }

    /// The position's covariance in each hypothesis, m².
    pub fn place_covariance_m2(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&[0, 1, 2].map(|col| [0, 1, 2].map(|row| self.covariance[row][col])))
    }

    /// Advances the time to a sweep.
    pub fn advance(&mut self, sight: &Sight) {
        let passed_s = self.time_s.map_or(0.0, |before| (sight.time_s - before).max(0.0));
        self.time_s = Some(sight.time_s);
        if passed_s <= 0.0 {
            return;
        }
        let step = self.wander.step(passed_s);
        let keep = math::exp(-passed_s / JITTER_S);
        for row in self.states.iter_mut().chain(&mut self.covariance) {
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

    /// Resets the phase offset to unknown.
    pub fn open_offset(&mut self) {
        for other in 0..STATES {
            self.covariance[OFFSET][other] = 0.0;
            self.covariance[other][OFFSET] = 0.0;
        }
        self.states.iter_mut().for_each(|state| state[OFFSET] = 0.0);
        self.covariance[OFFSET][OFFSET] = OPEN_OFFSET_M * OPEN_OFFSET_M;
    }
    /// Predicts a measured length; `phase`: it includes the unknown offset.
    pub fn predict(&self, sight: &Sight, phase: bool, variance_m2: f64) -> Innovation {
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
        let expected_m = self.states.iter().map(|state| dot(&reads, state)).collect();
        Innovation { expected_m, variance_m2: dot(&reads, &shared) + variance_m2, shared }
    }

    /// Updates with a measured length: `off_m` holds, for each hypothesis, its difference from the
    /// linearisation's length. Its effect is limited if it is an outlier to hypothesis `likeliest`.
    /// Returns each hypothesis's squared innovation over its variance.
    pub fn update(&mut self, innovation: &Innovation, off_m: &[f64], likeliest: usize) -> Vec<f64> {
        let surprises_m: Vec<f64> =
            off_m.iter().zip(&innovation.expected_m).map(|(off, expected)| off - expected).collect();
        let sigmas = surprises_m[likeliest].abs() / innovation.variance_m2.sqrt();
        let variance_m2 = innovation.variance_m2 * (sigmas / OUTLIER_SIGMA).max(1.0);
        for (state, surprise_m) in self.states.iter_mut().zip(&surprises_m) {
            for (value, shared) in state.iter_mut().zip(&innovation.shared) {
                *value += shared * (surprise_m / variance_m2);
            }
        }
        for (row, mine) in self.covariance.iter_mut().zip(&innovation.shared) {
            for (value, other) in row.iter_mut().zip(&innovation.shared) {
                *value -= mine / variance_m2 * other;
            }
        }
        surprises_m.iter().map(|surprise_m| surprise_m * surprise_m / innovation.variance_m2).collect()
    }
}

/// Advances one row of the covariance, or a state, by a time step.
fn advance_row(row: &mut [f64; STATES], step: &Step, keep: f64) {
    row[JITTER..JITTER + 3].iter_mut().for_each(|value| *value *= keep);
    row[WANDER..].chunks_exact_mut(WANDER_STATES).for_each(|axis| step.turn_row(axis));
}

fn dot(a: &[f64; STATES], b: &[f64; STATES]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
