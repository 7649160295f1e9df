//! Slow pose drift in one axis as filter states: white noise through a Butterworth low-pass.
//!
//! Tracking drift has a fastest rate, about half a hertz, and almost no power above it: a flat
//! spectrum with a steep edge, 1/(1 + (f/f_c)¹⁶). The steepness matters as soon as phases are used.
//! Heads move about as fast as poses drift, and with a slowly falling spectrum the filter confuses
//! phases with drift, so that covariances are wrong both ways. The low-pass's eight poles form four
//! pairs of states. Each pair rotates and decays independently, all are driven by the same noise,
//! and the drift is a weighted sum of them. Stationary covariance and transition have closed forms.

use std::f64::consts::{PI, TAU};

use num_complex::Complex64;

use super::PositionErrors;

use crate::math;

/// Pairs of poles; the low-pass's order is twice as high. Choice: order eight is flat up to its
/// edge and lets little pass above, so that the drift does not contain the jitter; each pair costs
/// two states an axis.
const PAIRS: usize = 4;
/// States per axis: real and imaginary part of each pair.
pub(super) const WANDER_STATES: usize = 2 * PAIRS;

/// The process in one axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wander {
    /// 2π times the edge frequency of the spectrum, per second.
    rate: f64,
    /// Weights of the states in the drift.
    pub reads: [f64; WANDER_STATES],
    pub stationary: [[f64; WANDER_STATES]; WANDER_STATES],
}

/// Transition over a time interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    turns: [Complex64; PAIRS],
    /// Covariance added by the driving noise.
    pub added: [[f64; WANDER_STATES]; WANDER_STATES],
}

impl Wander {
    pub fn new(errors: &PositionErrors) -> Self {
        let poles = poles();
        let mut reads = [0.0; WANDER_STATES];
        for (k, pole) in poles.iter().enumerate() {
            // Residue of 1/Π(s − p) at the pole; the conjugate pole's is its conjugate.
            let others = poles.iter().enumerate().filter(|(n, _)| *n != k).map(|(_, p)| (pole - p) * (pole - p.conj()));
            let residue = (others.product::<Complex64>() * (pole - pole.conj())).inv();
            (reads[2 * k], reads[2 * k + 1]) = (2.0 * residue.re, -2.0 * residue.im);
        }
        // Modes k and l driven by the same noise: their covariance is −1/(p_k + p_l), with the
        // second pole conjugated or not.
        let mut stationary = [[0.0; WANDER_STATES]; WANDER_STATES];
        for (k, a) in poles.iter().enumerate() {
            for (l, b) in poles.iter().enumerate() {
                let (conjugated, plain) = (-(a + b.conj()).inv(), -(a + b).inv());
                let (sum, difference) = ((conjugated + plain) * 0.5, (conjugated - plain) * 0.5);
                stationary[2 * k][2 * l] = sum.re;
                stationary[2 * k + 1][2 * l] = sum.im;
                stationary[2 * k][2 * l + 1] = -difference.im;
                stationary[2 * k + 1][2 * l + 1] = difference.re;
            }
        }
        let drift: f64 = stationary.iter().zip(&reads).map(|(row, read)| read * dot(row, &reads)).sum();
        let scale = errors.slow_variance_m2() / drift;
        stationary.iter_mut().flatten().for_each(|value| *value *= scale);
        Self { rate: TAU * edge_hz(errors.wander_s), reads, stationary }
    }

    /// Transition over a time, seconds.
    pub fn step(&self, passed_s: f64) -> Step {
        let turns = poles().map(|pole| math::exp_complex(pole * self.rate * passed_s));
        // Stationary covariance minus what remains of it after the transition.
        let mut left = self.stationary;
        left.iter_mut().for_each(|row| turn_row(row, &turns));
        turn_rows(&mut left, &turns);
        let mut added = self.stationary;
        for (added, left) in added.iter_mut().flatten().zip(left.iter().flatten()) {
            *added -= left;
        }
        Step { turns, added }
    }
}

impl Step {
    /// Applies the transition to the states of one axis, or to a row of a covariance.
    pub fn turn_row(&self, row: &mut [f64]) {
        turn_row(row, &self.turns);
    }

    /// Applies the transition to the rows of a covariance that belong to the states of one axis.
    pub fn turn_rows<const N: usize>(&self, rows: &mut [[f64; N]]) {
        turn_rows(rows, &self.turns);
    }
}

fn turn_row(row: &mut [f64], turns: &[Complex64; PAIRS]) {
    for (pair, turn) in row.chunks_exact_mut(2).zip(turns) {
        (pair[0], pair[1]) = (turn.re * pair[0] - turn.im * pair[1], turn.im * pair[0] + turn.re * pair[1]);
    }
}

fn turn_rows<const N: usize>(rows: &mut [[f64; N]], turns: &[Complex64; PAIRS]) {
    for (pair, turn) in rows.chunks_exact_mut(2).zip(turns) {
        let (real, imaginary) = pair.split_at_mut(1);
        for (re, im) in real[0].iter_mut().zip(&mut imaginary[0]) {
            (*re, *im) = (turn.re * *re - turn.im * *im, turn.im * *re + turn.re * *im);
        }
    }
}

/// Poles in the upper half plane of a low-pass with its edge at 1 rad per unit of time
/// (Butterworth, 1930).
fn poles() -> [Complex64; PAIRS] {
    std::array::from_fn(|k| {
        let order = WANDER_STATES as f64;
        math::from_polar(1.0, 0.5 * PI * (2.0 * k as f64 + order + 1.0) / order)
    })
}

/// Edge of the spectrum: the drift's fastest half period is its correlation time. Raised by a
/// twentieth, because the low-pass passes only half of the power at its edge.
fn edge_hz(wander_s: f64) -> f64 {
    0.525 / wander_s
}

fn dot(a: &[f64; WANDER_STATES], b: &[f64; WANDER_STATES]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Correlation of the drift at two times, summed over the spectrum.
#[cfg(test)]
pub(crate) fn correlation(apart_s: f64, wander_s: f64) -> f64 {
    const PARTS: usize = 2000;
    let edge_hz = edge_hz(wander_s);
    let power = |n: usize| {
        let share = (n as f64 + 0.5) * 4.0 / PARTS as f64;
        (share * edge_hz, 1.0 / (1.0 + share.powi(2 * WANDER_STATES as i32)))
    };
    let whole: f64 = (0..PARTS).map(|n| power(n).1).sum();
    (0..PARTS).map(power).map(|(hz, power)| power * math::cos(TAU * hz * apart_s)).sum::<f64>() / whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlation_matches_the_spectrum() {
        let errors = PositionErrors { wander_s: 1.3, ..Default::default() };
        let wander = Wander::new(&errors);
        for apart_s in [0.0, 0.008, 0.1, 0.6, 1.3, 4.0, 20.0] {
            let step = wander.step(apart_s);
            let mut later = wander.stationary;
            step.turn_rows(&mut later);
            let alike: f64 = later.iter().zip(&wander.reads).map(|(row, read)| read * dot(row, &wander.reads)).sum();
            let expected = errors.slow_variance_m2() * correlation(apart_s, errors.wander_s);
            assert!((alike - expected).abs() < 1e-9 * errors.slow_variance_m2(), "{apart_s}: {alike:e} {expected:e}");
        }
    }

    #[test]
    fn two_steps_equal_one_longer_step() {
        let wander = Wander::new(&PositionErrors::default());
        // Two steps equal one: the covariance added by the first is transformed by the second.
        let (one, two, both) = (wander.step(0.3), wander.step(0.5), wander.step(0.8));
        let mut added = one.added;
        added.iter_mut().for_each(|row| two.turn_row(row));
        two.turn_rows(&mut added);
        let largest = wander.stationary.iter().flatten().fold(0.0f64, |a, b| a.max(b.abs()));
        for ((added, second), both) in
            added.iter().flatten().zip(two.added.iter().flatten()).zip(both.added.iter().flatten())
        {
            assert!((added + second - both).abs() < 1e-13 * largest);
        }
    }
}
