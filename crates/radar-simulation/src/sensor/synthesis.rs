//! The sum of echoes in the points of a frame's sweeps, from propagation paths whose length is a
//! quadratic function of time over the frame.
//!
//! Within a sweep the path's length is linear in time about the point nearest to the echo. A path's pulse
//! is a Gaussian on an even grid and its phase an arithmetic sequence, so both follow from point to
//! point by multiplications; so does the phase from sweep to sweep. What is left out is the
//! acceleration within a pulse: at 10 m/s² and the 70 µs of half a pulse of d16, 6·10⁻⁵ rad.

use num_complex::Complex64;

use a121::{FrameTiming, Subsweep, noise_rms_lsb, snr_db};
use radar_sar::math;
use radar_sar::{Beam, PHASE_RAD_PER_M};

use super::gain::from_db;
use crate::echoes::EchoPath;

/// Half the length of the pulse that is computed, widths of the envelope. Choice: beyond it the pulse
/// is 60 dB down.
const REACH_WIDTHS: f64 = 1.6;

/// Amplitude of a path of unit amplitude (0 dBsm at 1 m on the axis) at the envelope's peak, LSB.
pub(crate) fn unit_amplitude_lsb(subsweep: &Subsweep, beam: &Beam) -> f64 {
    let snr = snr_db(subsweep.profile, subsweep.hwaas, 0.0, 1.0) + beam.gain_db();
    noise_rms_lsb(subsweep) * from_db(snr)
}

/// One subsweep in all sweeps of a frame.
pub(crate) struct SubsweepOfFrame<'a> {
    pub subsweep: &'a Subsweep,
    /// Number of sweeps in the frame.
    pub sweeps: usize,
    /// Time of the first sweep's first point from the frame's start; of a sweep; of a point, seconds.
    pub first_s: f64,
    pub sweep_period_s: f64,
    pub point_period_s: f64,
    /// Length of the frame, over which the paths' lengths are given, seconds.
    pub frame_s: f64,
    /// Measured range minus true range, metres.
    pub range_bias_m: f64,
    /// LSB of a path of unit amplitude.
    pub unit_lsb: f64,
}

impl<'a> SubsweepOfFrame<'a> {
    /// Number `index` of a configuration's subsweeps.
    pub fn new(subsweep: &'a Subsweep, index: usize, sweeps: u32, timing: &FrameTiming, range_bias_m: f64) -> Self {
        let (first_s, point_period_s) = timing.subsweeps[index];
        Self {
            subsweep,
            sweeps: sweeps as usize,
            first_s,
            sweep_period_s: timing.sweep_period_s,
            point_period_s,
            frame_s: timing.frame_s,
            range_bias_m,
            unit_lsb: 1.0,
        }
    }

    /// Sum of the echoes, `[sweep][point]`, LSB.
    pub fn sum(&self, paths: &[EchoPath]) -> Vec<Vec<Complex64>> {
        let mut sums = vec![vec![Complex64::ZERO; self.subsweep.num_points as usize]; self.sweeps];
        paths.iter().for_each(|path| self.add(path, &mut sums));
        sums
    }

    fn add(&self, path: &EchoPath, sums: &mut [Vec<Complex64>]) {
        let (first_m, step_m) = (self.subsweep.first_m(), self.subsweep.step_m());
        let points = self.subsweep.num_points as usize;
        let length = Quadratic::over_frame(path.range_m, self.frame_s, self.range_bias_m);
        let middle_m = length.at(0.5 * self.frame_s);
        // All quantities refer to the point nearest to the echo in the frame's middle.
        let nearest = ((middle_m - first_m) / step_m).round();
        let moved_m = (path.range_m[2] - path.range_m[0]).abs() + (middle_m - length.at(0.0)).abs();
        let reach = ((REACH_WIDTHS * self.subsweep.profile.envelope_fwhm_m() + moved_m) / step_m + 0.5).ceil();
        let (from, to) = ((nearest - reach).max(0.0), (nearest + reach).min(points as f64 - 1.0));
        if from > to {
            return;
        }
        let amplitude = path.amplitude * self.unit_lsb;
        let at_s = self.first_s + nearest * self.point_period_s;
        let mut phases = SweepPhases::new(&length, at_s, self.sweep_period_s, self.point_period_s, path.phase_rad);
        for (k, sums) in sums.iter_mut().enumerate() {
            let time_s = at_s + k as f64 * self.sweep_period_s;
            let (range_m, slope_m) = (length.at(time_s), length.rate(time_s) * self.point_period_s);
            let offset_m = first_m + nearest * step_m - range_m;
            let pulse = Pulse { offset_m, step_m: step_m - slope_m, width_m: self.subsweep.profile.envelope_fwhm_m() };
            let (phasor, turn) = phases.next();
            pulse.add(amplitude, phasor, turn, nearest as i64, &mut sums[from as usize..=to as usize], from as i64);
        }
    }
}

/// A length over the frame: `at_zero + rate·t + bend·t²`.
struct Quadratic {
    at_zero: f64,
    rate: f64,
    bend: f64,
}

impl Quadratic {
    /// Through the values at the frame's start, middle and end.
    fn over_frame([first, middle, last]: [f64; 3], frame_s: f64, bias_m: f64) -> Self {
        let bend = 2.0 * (first + last - 2.0 * middle) / (frame_s * frame_s);
        Self { at_zero: first + bias_m, rate: (last - first) / frame_s - bend * frame_s, bend }
    }

    fn at(&self, t: f64) -> f64 {
        self.at_zero + (self.rate + self.bend * t) * t
    }

    fn rate(&self, t: f64) -> f64 {
        self.rate + 2.0 * self.bend * t
    }
}

/// Phasor at the reference point, and its turn from one point to the next, sweep by sweep.
struct SweepPhases {
    phasor: Complex64,
    step: Complex64,
    step_step: Complex64,
    turn: Complex64,
    turn_step: Complex64,
}

impl SweepPhases {
    fn new(length: &Quadratic, at_s: f64, sweep_s: f64, point_s: f64, phase_rad: f64) -> Self {
        let unit = |range_m: f64| {
            let turns = range_m * (PHASE_RAD_PER_M / std::f64::consts::TAU);
            math::from_polar(1.0, std::f64::consts::TAU * (turns - turns.floor()))
        };
        Self {
            phasor: unit(length.at(at_s)) * math::from_polar(1.0, phase_rad),
            step: unit(length.at(at_s + sweep_s) - length.at(at_s)),
            step_step: unit(2.0 * length.bend * sweep_s * sweep_s),
            turn: unit(length.rate(at_s) * point_s),
            turn_step: unit(2.0 * length.bend * sweep_s * point_s),
        }
    }

    fn next(&mut self) -> (Complex64, Complex64) {
        let now = (self.phasor, self.turn);
        self.phasor *= self.step;
        self.step *= self.step_step;
        self.turn *= self.turn_step;
        now
    }
}

/// A Gaussian pulse in the points of one sweep.
struct Pulse {
    /// Range of the reference point minus that of the echo, metres.
    offset_m: f64,
    /// Change of the offset from one point to the next, metres.
    step_m: f64,
    width_m: f64,
}

impl Pulse {
    /// Adds it to the points from `from` on, of which `reference` is the reference point.
    fn add(
        &self,
        amplitude: f64,
        phasor: Complex64,
        turn: Complex64,
        reference: i64,
        sums: &mut [Complex64],
        from: i64,
    ) {
        // 0.5^(4 x²/w²) = exp(−b x²).
        let b = 4.0 * std::f64::consts::LN_2 / (self.width_m * self.width_m);
        // Values before the start run backwards from there.
        let start = reference.clamp(from, from + sums.len() as i64 - 1);
        let shift = (start - reference) as f64;
        let x = self.offset_m + shift * self.step_m;
        let value = amplitude * math::exp(-b * x * x);
        let phasor = if shift == 0.0 { phasor } else { phasor * turn.powi(shift as i32) };
        let (before, after) = sums.split_at_mut((start - from) as usize);
        let curvature = math::exp(-2.0 * b * self.step_m * self.step_m);
        let ratio = |direction: f64| math::exp(-b * self.step_m * (self.step_m + direction * 2.0 * x));
        run(after.iter_mut(), phasor * value, turn, ratio(1.0), curvature);
        let back = (phasor * value) * turn.conj() * ratio(-1.0);
        run(before.iter_mut().rev(), back, turn.conj(), ratio(-1.0) * curvature, curvature);
    }
}

/// Adds a pulse along points: each value is the last one turned and damped by a falling ratio.
fn run<'s>(
    points: impl Iterator<Item = &'s mut Complex64>,
    mut value: Complex64,
    turn: Complex64,
    mut ratio: f64,
    curvature: f64,
) {
    for point in points {
        *point += value;
        value *= turn * ratio;
        ratio *= curvature;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::{frame_timing, preset};

    /// Straight evaluation of the same sum.
    fn direct(of: &SubsweepOfFrame, paths: &[EchoPath]) -> Vec<Vec<Complex64>> {
        let width_m = of.subsweep.profile.envelope_fwhm_m();
        let point = |k: usize, n: usize| {
            let time_s = of.first_s + k as f64 * of.sweep_period_s + n as f64 * of.point_period_s;
            let x = 2.0 * time_s / of.frame_s - 1.0;
            let each = paths.iter().map(|path| {
                let [a, b, c] = path.range_m;
                let range_m = b + x * (c - a) / 2.0 + x * x * (a + c - 2.0 * b) / 2.0 + of.range_bias_m;
                let off = (of.subsweep.first_m() + n as f64 * of.subsweep.step_m() - range_m) / width_m;
                let phase_rad = PHASE_RAD_PER_M * range_m + path.phase_rad;
                Complex64::from_polar(path.amplitude * of.unit_lsb * 0.5f64.powf(4.0 * off * off), phase_rad)
            });
            each.sum()
        };
        (0..of.sweeps).map(|k| (0..of.subsweep.num_points as usize).map(|n| point(k, n)).collect()).collect()
    }

    #[test]
    fn sums_equal_straight_evaluation() {
        for name in ["d16", "c16", "fine", "close", "far", "thesis"] {
            let config = preset(name).unwrap();
            let timing = frame_timing(&config);
            let subsweep = &config.subsweeps[0];
            let mut of = SubsweepOfFrame::new(subsweep, 0, config.sweeps_per_frame, &timing, -0.003);
            of.unit_lsb = 1000.0;
            let path = |range_m: f64, moved_m: f64, bent_m: f64, phase_rad: f64| EchoPath {
                range_m: [range_m, range_m + 0.5 * moved_m + bent_m, range_m + moved_m],
                amplitude: 1.0,
                phase_rad,
            };
            // At rest, moving at 1.5 m/s either way, accelerating by 10 m/s²; beside both ends, outside.
            let bend_m = 10.0 * of.frame_s * of.frame_s / 8.0;
            let motions = [(0.0, 0.0), (1.5, 0.0), (-1.5, bend_m), (0.1, -bend_m)].map(|(m, b)| (m * of.frame_s, b));
            let ranges = [0.75, 1.3337, subsweep.first_m() - 0.05, subsweep.last_m() + 0.1, 30.0];
            for range_m in ranges {
                for (n, &(moved_m, bent_m)) in motions.iter().enumerate() {
                    let paths = [path(range_m, moved_m, bent_m, n as f64)];
                    let (fast, slow) = (of.sum(&paths), direct(&of, &paths));
                    let pairs = fast.iter().flatten().zip(slow.iter().flatten());
                    let tails = pairs.filter(|(_, slow)| slow.norm() <= 2.0).map(|(a, b)| (a - b).norm());
                    // The pulse ends at 1.6 widths, where it is 61 dB down.
                    let error = tails.fold(0.0, f64::max);
                    assert!(error < 1.0, "{name} at {range_m} m moving {moved_m}: {error}");
                    let inside = |k: usize, n: usize| slow[k][n].norm() > 2.0;
                    for (k, sweep) in fast.iter().enumerate() {
                        for (n, value) in sweep.iter().enumerate().filter(|(n, _)| inside(k, *n)) {
                            let error = (value - slow[k][n]).norm();
                            let nearest = ((range_m - subsweep.first_m()) / subsweep.step_m()).round();
                            // The reference point is the one nearest in the frame's middle, and biased.
                            let shift = 1.0 + (moved_m.abs() + of.range_bias_m.abs()) / subsweep.step_m();
                            let from_nearest_s = ((n as f64 - nearest).abs() + shift) * of.point_period_s;
                            let acceleration_m_per_s2 = 8.0 * bent_m.abs() / (of.frame_s * of.frame_s);
                            let bent_rad = PHASE_RAD_PER_M * 0.5 * acceleration_m_per_s2 * from_nearest_s.powi(2);
                            let most = 1e-6 + 1.1 * bent_rad * slow[k][n].norm();
                            assert!(error < most, "{name} at {range_m} m, sweep {k}, point {n}: {error}, {most}");
                        }
                    }
                }
            }
        }
    }
}
