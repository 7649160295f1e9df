//! Moving target indication: detects echoes in a sub-aperture whose Doppler lies outside that of
//! all stationary clutter.
//!
//! For a sensor moving with velocity v, a stationary point in direction u has a range rate of −v·u.
//! The beam bounds u, so stationary clutter occupies one interval of range rates. Energy outside it
//! comes from a target with its own velocity, at least as fast as its distance from the interval.
//!
//! Clutter is up to 55 dB stronger than the targets, and sweeps come in frames with pauses between
//! them. A windowed FFT does not tolerate that: one missing sweep in seventeen puts copies 24 dB
//! down all over the spectrum. Clutter is therefore removed by projection, not by a window. Tones
//! over the interval, sampled at the actual sweep times, are orthonormalised (up to a rotation, the
//! discrete prolate functions of the band) and projected out of every range's sweeps. The residual
//! is correlated with tones outside the interval, at each range. For noise of mean power 1, a
//! tone's power |sᴴe|²/K is exponential with mean at most 1, so the threshold follows from the
//! number of cells and the permitted false alarms per sub-aperture. Where the mean residual at a
//! range, without the tones near the strongest one, exceeds the noise, the echo is measured against
//! that mean instead. So modelling errors do not become targets.
//!
//! The interval extends to where the beam is [`BEAM_EDGE_AMPLITUDE`], −40 dB: a wall there returns about
//! as much as noise. Range rates are ambiguous modulo λ/2 divided by the sweep period. They are
//! reported within half of that on either side of the interval's middle, which is correct for
//! targets whose own speed is below it. Motion across the line of sight, or within the interval,
//! cannot be distinguished from clutter.
//!
//! Longer than other files: the projection and its tests of tones share the basis of the clutter.

use glam::DVec3;

use super::{Subaperture, taper};
use crate::math;
use crate::simd::{Kernel, LANES, Lanes, on_widest};
use crate::{Beam, WAVELENGTH_M};

/// Two-way beam amplitude at the edge of the directions treated as clutter. Choice: −40 dB, where a
/// wall returns about as much as noise; a lower edge hides slow targets.
const BEAM_EDGE_AMPLITUDE: f64 = 0.01;
/// Error of the sensor's speed, metres a second. Choice: twice the 15 mm/s that jitter of the
/// smoothed path may appear as.
const SPEED_ERROR_M_PER_S: f64 = 0.03;
/// Spacing of the clutter tones, and their margin beyond the interval, in units of 1/T, with T the
/// sub-aperture's duration. Choice: closer than the resolution 1/T, so that every tone of the
/// interval is spanned, and no closer, as each takes a degree of freedom.
const TONE_STEP: f64 = 0.6;
const CLUTTER_BAND_MARGIN: f64 = 1.0;
/// A tone whose orthogonal residual is below this share is dropped. Choice: it would represent
/// signals outside the interval.
const MIN_RESIDUAL_AMPLITUDE: f32 = 0.1;
/// Guard band beyond the interval, in units of 1/T. Choice: past it, most of a tone survives the
/// projection.
const GUARD_BAND: f64 = 2.5;
/// Spacing of the tones searched for targets, in units of 1/T. Choice: a tone between two loses at
/// most 1.3 dB.
const DOPPLER_STEP: f64 = 0.6;
/// Limits: clutter tones, Doppler cells, and the share of the sweeps' degrees of freedom that
/// clutter may take. Beyond these limits there is no result. Choice: the work grows with the tones'
/// square; with a fifth of the freedom left, the noise is still known.
const MAX_CLUTTER_TONES: usize = 160;
const MAX_DOPPLER_CELLS: usize = 1024;
const MAX_CLUTTER_SHARE: f64 = 0.8;
/// Echoes nearer in range to a stronger one count as part of it: the same body, and the pulse's
/// sidelobes, metres. Choice: a body's depth, twice the width of the pulse.
const MIN_TARGET_SEPARATION_M: f64 = 0.3;
/// Most echoes reported for one sub-aperture. Choice: two people, or one with both hands; it bounds
/// the tracks that false echoes begin.
const MAX_ECHOES: usize = 4;
/// Tones within this distance of the strongest one belong to it, metres a second. Choice: parts of
/// a torso differ by as much; limbs are echoes of their own.
const TARGET_DOPPLER_HALF_WIDTH_M_PER_S: f64 = 0.2;

/// An echo of a moving target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MtiEcho {
    /// Range from the sub-aperture's middle, metres.
    pub range_m: f64,
    /// Range rate, metres a second, positive when receding; includes the sensor's own motion.
    pub range_rate_m_per_s: f64,
    /// Power of its tone over the rest of the residual at its range.
    pub power: f64,
}

/// MTI result of one sub-aperture.
#[derive(Debug, Clone, PartialEq)]
pub struct MtiResult {
    /// Detected echoes, strongest first.
    pub echoes: Vec<MtiEcho>,
    /// Least and greatest range rate of stationary clutter, metres a second. The part of an echo's
    /// range rate beyond the interval is the target's own.
    pub clutter_m_per_s: [f64; 2],
    /// Width of the guard band on either side of it, metres a second, in which nothing is detected.
    pub guard_m_per_s: f64,
    /// Range rate of stationary clutter straight ahead, metres a second.
    pub ahead_m_per_s: f64,
    /// Range rates that differ by this are ambiguous, metres a second.
    pub ambiguity_m_per_s: f64,
    /// First and last range searched, metres.
    pub ranges_m: [f64; 2],
}

impl MtiResult {
    /// Whether a target of a range rate can be distinguished from stationary clutter.
    pub fn is_observable(&self, range_rate_m_per_s: f64) -> bool {
        let [least, greatest] = self.clutter_m_per_s;
        let off = range_rate_m_per_s - 0.5 * (least + greatest);
        let off = off - (off / self.ambiguity_m_per_s).round() * self.ambiguity_m_per_s;
        off.abs() > 0.5 * (greatest - least) + self.guard_m_per_s
    }
}

/// MTI filter, with everything that depends on the beam alone.
#[derive(Debug, Clone)]
pub struct MtiFilter {
    edge_cos: f64,
    alarms_per_subaperture: f64,
}

impl MtiFilter {
    /// `alarms_per_subaperture`: upper bound of the mean number of false alarms per sub-aperture of
    /// noise.
    pub fn new(beam: &Beam, alarms_per_subaperture: f64) -> Self {
        Self { edge_cos: beam.cut_off_cos(BEAM_EDGE_AMPLITUDE), alarms_per_subaperture }
    }

    /// Moving targets in a sub-aperture; `None` where clutter leaves no usable Doppler interval.
    pub fn detect(&self, block: &Subaperture) -> Option<MtiResult> {
        let slow = SlowTime::of(block)?;
        let ([least, greatest], ahead) = self.clutter_rates(block);
        let middle = 0.5 * (least + greatest);
        let half = 0.5 * (greatest - least) + SPEED_ERROR_M_PER_S;
        let guard = GUARD_BAND * slow.resolution_m_per_s();
        let cells = slow.cells(half + guard)?;
        let mut data = slow.demodulated(block, middle);
        let basis = slow.clutter_basis(half)?;
        on_widest(Project { basis: &basis, sweeps: slow.sweeps(), width: data.width, data: &mut data.values });
        let spectrum = Spectrum::of(&slow, &data, &cells, basis.len() / slow.padded());
        let bound = math::ln(cells.len() as f64 * data.ranges as f64 / self.alarms_per_subaperture);
        let range_m = |bin: f64| f64::from(block.axis.first_m) + bin * data.step_m;
        let echoes = spectrum.echoes(bound, data.step_m).into_iter().map(|(bin, rate, power)| MtiEcho {
            range_m: range_m(bin),
            range_rate_m_per_s: middle + rate,
            power,
        });
        Some(MtiResult {
            echoes: echoes.collect(),
            clutter_m_per_s: [middle - half, middle + half],
            guard_m_per_s: guard,
            ahead_m_per_s: ahead,
            ambiguity_m_per_s: slow.ambiguity_m_per_s(),
            ranges_m: [range_m(0.0), range_m((data.ranges - 1) as f64)],
        })
    }

    /// Least and greatest range rate of stationary clutter in the beam during the sub-aperture; and
    /// the mean range rate straight ahead.
    fn clutter_rates(&self, block: &Subaperture) -> ([f64; 2], f64) {
        let ahead = block.middle.forward();
        let edge_rad = math::acos(self.edge_cos.clamp(-1.0, 1.0));
        let (mut rates, mut straight) = ([f64::INFINITY, f64::NEG_INFINITY], 0.0);
        for k in 0..block.path.sweep_count {
            let [x, y, z] = block.path.groups[k / LANES].velocity_m_per_s.map(|axis| f64::from(axis[k % LANES]));
            let velocity = DVec3::new(x, y, z);
            let speed = velocity.length();
            let off_rad = math::acos((velocity.dot(ahead) / speed.max(1e-9)).clamp(-1.0, 1.0));
            // A point straight ahead along the motion approaches fastest.
            let nearing = speed * math::cos((off_rad - edge_rad).max(0.0));
            let leaving = -speed * math::cos((off_rad + edge_rad).min(std::f64::consts::PI));
            rates = [rates[0].min(-nearing), rates[1].max(leaving)];
            straight -= velocity.dot(ahead) / block.path.sweep_count as f64;
        }
        (rates, straight)
    }
}

/// The times of a sub-aperture's sweeps (slow time).
struct SlowTime {
    /// Relative to the middle of the sub-aperture, seconds.
    times_s: Vec<f32>,
    /// Duration of all sweeps, with one sweep's share after the last, seconds.
    length_s: f64,
    /// Sweep period within a frame (median), seconds.
    step_s: f64,
}

/// Sweeps as columns of ranges, demodulated so that clutter is centred on 0 Hz.
struct Demodulated {
    /// `[sweep][re, im][range]`, `width` floats per row.
    values: Vec<f32>,
    width: usize,
    ranges: usize,
    step_m: f64,
}

/// Doppler frequency of a range rate, Hz.
fn hz(rate_m_per_s: f64) -> f64 {
    2.0 * rate_m_per_s / WAVELENGTH_M
}

impl SlowTime {
    /// `None` with fewer than eight sweeps, or times that do not increase.
    fn of(block: &Subaperture) -> Option<Self> {
        let (first, last) = (*block.path.times_s.first()?, *block.path.times_s.last()?);
        let (count, middle) = (block.path.times_s.len(), 0.5 * (first + last));
        let mut steps: Vec<f32> = block.path.times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let is_sound = count >= 8 && last > first && steps.iter().all(|step| *step > 0.0);
        if !is_sound {
            return None;
        }
        let (_, step_s, _) = steps.select_nth_unstable_by((count - 1) / 2, f32::total_cmp);
        Some(Self {
            length_s: f64::from(last - first) * count as f64 / (count - 1) as f64,
            step_s: f64::from(*step_s),
            times_s: block.path.times_s.iter().map(|time_s| time_s - middle).collect(),
        })
    }

    fn sweeps(&self) -> usize {
        self.times_s.len()
    }

    /// Number of sweeps, rounded up to whole vectors.
    fn padded(&self) -> usize {
        self.sweeps().next_multiple_of(LANES)
    }

    /// Doppler resolution as a range rate.
    fn resolution_m_per_s(&self) -> f64 {
        WAVELENGTH_M / (2.0 * self.length_s)
    }

    fn ambiguity_m_per_s(&self) -> f64 {
        WAVELENGTH_M / (2.0 * self.step_s)
    }

    /// Range rates searched, relative to the middle of the clutter, at least `from_m_per_s` from
    /// it; `None` where there are none.
    fn cells(&self, from_m_per_s: f64) -> Option<Vec<f64>> {
        let step = DOPPLER_STEP * self.resolution_m_per_s();
        let count = (0.5 * self.ambiguity_m_per_s() / step).floor();
        let first = (from_m_per_s / step).ceil();
        let is_some = first <= count && count <= MAX_DOPPLER_CELLS as f64 / 2.0;
        let side = move |sign: f64| (first as i64..=count as i64).map(move |n| sign * n as f64 * step);
        is_some.then(|| side(-1.0).collect::<Vec<_>>().into_iter().rev().chain(side(1.0)).collect())
    }

    /// Orthonormal basis of signals within ±`half_m_per_s` of the clutter's middle,
    /// `[tone][sweep]`, sweeps zero-padded; `None` where it would take up too much.
    fn clutter_basis(&self, half_m_per_s: f64) -> Option<Vec<f32>> {
        let most = MAX_CLUTTER_TONES.min((MAX_CLUTTER_SHARE * self.sweeps() as f64) as usize);
        let step_hz = TONE_STEP / self.length_s;
        let tones = ((hz(half_m_per_s) + CLUTTER_BAND_MARGIN / self.length_s) / step_hz).ceil();
        if tones > 2.0 * most as f64 {
            return None;
        }
        let mut basis = Vec::with_capacity((most + 1) * self.padded());
        // From tone to tone each sweep's phase grows by a constant.
        let step_rad = |time_s: &f32| std::f64::consts::TAU * step_hz * f64::from(*time_s);
        let turns: Vec<(f32, f32)> =
            self.times_s.iter().map(|t| (math::cos(step_rad(t)) as f32, math::sin(step_rad(t)) as f32)).collect();
        let mut phasors = vec![(1.0f32, 0.0f32); turns.len()];
        for n in 0..=tones as usize {
            for part in [0, 1].into_iter().take(if n == 0 { 1 } else { 2 }) {
                let at = basis.len();
                basis.extend(phasors.iter().map(|(cos, sin)| if part == 0 { *cos } else { *sin }));
                basis.resize(at + self.padded(), 0.0);
                if !on_widest(Orthonormal { basis: &mut basis, row: self.padded() }) {
                    basis.truncate(at);
                }
                if basis.len() > most * self.padded() {
                    return None;
                }
            }
            for ((cos, sin), (c, s)) in phasors.iter_mut().zip(&turns) {
                (*cos, *sin) = (*cos * c - *sin * s, *cos * s + *sin * c);
            }
        }
        Some(basis)
    }

    /// The sub-aperture's sweeps with the taper removed, at ranges half a pulse apart, demodulated
    /// by a range rate.
    fn demodulated(&self, block: &Subaperture, rate_m_per_s: f64) -> Demodulated {
        let pulse_m = block.geometry().pulse_fwhm_m;
        let stride = ((0.5 * pulse_m * f64::from(block.axis.entries_per_m)).round() as usize).max(1);
        let ranges = (block.axis.entries - 1) / stride + 1;
        let width = ranges.next_multiple_of(LANES);
        let groups = block.path.groups.len();
        let mut values = vec![0.0; 2 * width * self.sweeps()];
        for (k, row) in values.chunks_exact_mut(2 * width).enumerate() {
            let turns = -hz(rate_m_per_s) * f64::from(self.times_s[k]);
            let (sin, cos) = math::sin_cos(std::f64::consts::TAU * turns.fract());
            let scale = 1.0 / taper(k, self.sweeps());
            let (cos, sin) = ((cos * scale) as f32, (sin * scale) as f32);
            let (re_row, im_row) = row.split_at_mut(width);
            let of_ranges = block.z.iter().skip(k / LANES).step_by(groups * stride);
            for ((re, im), [z_re, z_im]) in re_row.iter_mut().zip(im_row).zip(of_ranges) {
                let (a, b) = (z_re[k % LANES], z_im[k % LANES]);
                (*re, *im) = (a * cos - b * sin, a * sin + b * cos);
            }
        }
        Demodulated { values, width, ranges, step_m: stride as f64 * f64::from(block.axis.entry_step_m) }
    }
}

/// Orthonormalises the last row against those before it; false where too little of it remains.
struct Orthonormal<'a> {
    basis: &'a mut [f32],
    row: usize,
}

impl Kernel for Orthonormal<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) -> bool {
        let (before, last) = self.basis.split_at_mut(self.basis.len() - self.row);
        let length2 = dot(s, last, last);
        // Gram–Schmidt twice is enough.
        for _ in 0..2 {
            for row in before.chunks_exact(self.row) {
                let along = s.splat(dot(s, row, last));
                for (to, from) in last.as_chunks_mut::<LANES>().0.iter_mut().zip(row.as_chunks::<LANES>().0) {
                    *to = s.store(s.neg_mul_add(s.load(from), along, s.load(to)));
                }
            }
        }
        let left2 = dot(s, last, last);
        let scale = s.splat(1.0 / left2.max(f32::MIN_POSITIVE).sqrt());
        for to in last.as_chunks_mut::<LANES>().0 {
            *to = s.store(s.mul(s.load(to), scale));
        }
        left2 > MIN_RESIDUAL_AMPLITUDE * MIN_RESIDUAL_AMPLITUDE * length2
    }
}

#[inline(always)]
fn dot<S: Lanes>(s: S, a: &[f32], b: &[f32]) -> f32 {
    let mut sum = s.splat(0.0);
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        sum = s.mul_add(s.load(a), s.load(b), sum);
    }
    s.store(sum).iter().sum()
}

/// Projects a basis out of every column.
struct Project<'a> {
    basis: &'a [f32],
    sweeps: usize,
    width: usize,
    data: &'a mut [f32],
}

impl Kernel for Project<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) {
        let Self { basis, sweeps, width, data } = self;
        let row = sweeps.next_multiple_of(LANES);
        for tone in basis.chunks_exact(row) {
            for at in (0..2 * width).step_by(LANES) {
                let mut sum = s.splat(0.0);
                for (k, value) in tone[..sweeps].iter().enumerate() {
                    sum = s.mul_add(s.splat(*value), s.load_at(data, k * 2 * width + at), sum);
                }
                for (k, value) in tone[..sweeps].iter().enumerate() {
                    let from = k * 2 * width + at;
                    let residual = s.neg_mul_add(s.splat(*value), sum, s.load_at(data, from));
                    data[from..from + LANES].copy_from_slice(&s.store(residual));
                }
            }
        }
    }
}

/// Power of one tone at every range.
struct Tone<'a> {
    data: &'a [f32],
    width: usize,
    /// `[sweep]`: the tone's conjugate.
    cos: &'a [f32],
    sin: &'a [f32],
    /// Divisor of the power.
    count: f32,
    power: &'a mut [f32],
}

impl Kernel for Tone<'_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Lanes>(self, s: S) {
        let Self { data, width, cos, sin, count, power } = self;
        for at in (0..width).step_by(LANES) {
            let (mut re, mut im) = (s.splat(0.0), s.splat(0.0));
            for k in 0..cos.len().min(sin.len()) {
                let (c, d) = (s.splat(cos[k]), s.splat(sin[k]));
                let (x, y) = (s.load_at(data, k * 2 * width + at), s.load_at(data, k * 2 * width + width + at));
                (re, im) = (s.mul_add(x, c, re), s.mul_add(y, c, im));
                (re, im) = (s.neg_mul_add(y, d, re), s.mul_add(x, d, im));
            }
            let sum = s.mul_add(re, re, s.mul(im, im));
            power[at..at + LANES].copy_from_slice(&s.store(s.div(sum, s.splat(count))));
        }
    }
}

/// Power over range rate and range.
struct Spectrum<'a> {
    /// Range rates relative to the clutter's middle, rising, metres a second.
    rates: &'a [f64],
    /// `[rate][range]`, `width` floats per row.
    powers: Vec<f32>,
    width: usize,
    /// `[range]`: residual energy, and its number of degrees of freedom.
    residual: Vec<f32>,
    degrees_of_freedom: f64,
}

impl<'a> Spectrum<'a> {
    fn of(slow: &SlowTime, data: &Demodulated, rates: &'a [f64], taken: usize) -> Self {
        let width = data.width;
        let mut powers = vec![0.0; rates.len() * width];
        let phasors = |rate: f64| -> (Vec<f32>, Vec<f32>) {
            let turn = -std::f64::consts::TAU * hz(rate);
            slow.times_s
                .iter()
                .map(|time_s| math::sin_cos(turn * f64::from(*time_s)))
                .map(|(s, c)| (c as f32, s as f32))
                .unzip()
        };
        // From tone to tone the phasors turn by a constant, except across the excluded interval.
        let step = rates.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let (turn_cos, turn_sin) = if step.is_finite() { phasors(step) } else { phasors(0.0) };
        let (mut cos, mut sin) = (Vec::new(), Vec::new());
        for (n, (rate, power)) in rates.iter().zip(powers.chunks_exact_mut(width)).enumerate() {
            if n == 0 || rate - rates[n - 1] > 1.5 * step {
                (cos, sin) = phasors(*rate);
            } else {
                for k in 0..cos.len() {
                    let (c, s) = (cos[k], sin[k]);
                    (cos[k], sin[k]) = (c * turn_cos[k] - s * turn_sin[k], c * turn_sin[k] + s * turn_cos[k]);
                }
            }
            let count = slow.sweeps() as f32;
            on_widest(Tone { data: &data.values, width, cos: &cos, sin: &sin, count, power });
        }
        let mut residual = vec![0.0; data.ranges];
        for part in data.values.chunks_exact(width) {
            residual.iter_mut().zip(part).for_each(|(residual, value)| *residual += value * value);
        }
        Self { rates, powers, width, residual, degrees_of_freedom: (slow.sweeps() - taken) as f64 }
    }

    fn power(&self, rate: usize, range: usize) -> f64 {
        f64::from(self.powers[rate * self.width + range])
    }

    /// The strongest tone at a range, and its power over the level there.
    fn strongest(&self, range: usize) -> (usize, f64) {
        let at =
            (0..self.rates.len()).max_by(|a, b| self.power(*a, range).total_cmp(&self.power(*b, range))).unwrap_or(0);
        // A body is not a single tone: neighbouring range rates belong to it.
        let own = self.around(at).map(|n| self.power(n, range)).sum::<f64>() * DOPPLER_STEP;
        let degrees_of_freedom = self.degrees_of_freedom - self.around(at).count() as f64 * DOPPLER_STEP;
        let level = (f64::from(self.residual[range]) - own) / degrees_of_freedom.max(1.0);
        (at, self.power(at, range) / level.max(1.0))
    }

    /// Fractional range index, range rate and strength of echoes above the threshold, strongest
    /// first.
    fn echoes(&self, bound: f64, step_m: f64) -> Vec<(f64, f64, f64)> {
        let mut open: Vec<(usize, usize, f64)> = Vec::new();
        for range in 0..self.residual.len() {
            let (rate, power) = self.strongest(range);
            if power >= bound {
                open.push((range, rate, power));
            }
        }
        open.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
        let mut echoes: Vec<(f64, f64, f64)> = Vec::new();
        let mut taken: Vec<usize> = Vec::new();
        for (range, rate, power) in open {
            let is_near = |other: &usize| (other.abs_diff(range) as f64) * step_m < MIN_TARGET_SEPARATION_M;
            if echoes.len() < MAX_ECHOES && !taken.iter().any(is_near) {
                taken.push(range);
                echoes.push((self.middle_of_range(range, step_m), self.middle_of_rate(rate, range), power));
            }
        }
        echoes
    }

    /// Centre of a body in range: mean of nearby ranges, weighted by each range's strongest tone.
    fn middle_of_range(&self, range: usize, step_m: f64) -> f64 {
        let reach = (0.5 * MIN_TARGET_SEPARATION_M / step_m).round() as usize;
        let around = range.saturating_sub(reach)..=(range + reach).min(self.residual.len() - 1);
        let weigh = |n: usize| (0..self.rates.len()).map(|rate| self.power(rate, n)).fold(0.0, f64::max);
        mean(around.map(|n| (n as f64, weigh(n))))
    }

    /// Centre of its range rate, from the tones around the strongest.
    fn middle_of_rate(&self, rate: usize, range: usize) -> f64 {
        mean(self.around(rate).map(|n| (self.rates[n], self.power(n, range))))
    }

    /// Indices of range rates attributed to the same body.
    fn around(&self, rate: usize) -> impl Iterator<Item = usize> {
        let is_near = move |n: &usize| (self.rates[*n] - self.rates[rate]).abs() <= TARGET_DOPPLER_HALF_WIDTH_M_PER_S;
        (0..self.rates.len()).filter(is_near)
    }
}

/// Weighted mean.
fn mean(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (sum, weight) = values.fold((0.0, 0.0), |(sum, total), (value, weight)| (sum + value * weight, total + weight));
    sum / weight.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Observation;
    use crate::geometry::Plane;
    use crate::subaperture::{SubapertureBuilder, SubapertureSettings};
    use crate::test_data::{Echo, sweeps, winding};

    fn blocks(observations: Vec<Observation>) -> Vec<Subaperture> {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        observations.into_iter().filter_map(|o| builder.push(o)).collect()
    }

    fn finder() -> MtiFilter {
        MtiFilter::new(&Beam::Lensless, 0.1)
    }

    /// Strong points all over the beam, and a wall.
    fn clutter() -> Vec<(Echo, f64)> {
        let place = |azimuth: f64, range_m: f64| {
            Echo::Point(DVec3::new(azimuth.sin(), 0.3 * azimuth.cos(), -azimuth.cos()).normalize() * range_m)
        };
        let points = (0..12).map(|n| (place(f64::from(n) * 0.2 - 1.1, 0.7 + 0.13 * f64::from(n)), 30.0));
        points.chain([(Echo::Plane(Plane { outward: DVec3::NEG_Z, offset_m: 2.2 }), 40.0)]).collect()
    }

    #[test]
    fn false_alarm_rate_on_noise_is_within_bound() {
        let blocks = blocks(sweeps(30.0, |t| winding(t) * 0.3, &[], 5));
        let count: usize = blocks.iter().map(|block| finder().detect(block).unwrap().echoes.len()).sum();
        let allowed = 0.1 * blocks.len() as f64;
        assert!((count as f64) < allowed + 3.0 * allowed.sqrt(), "{count} in {} blocks", blocks.len());
        // The threshold is effective: at a permitted rate a thousand times as high, echoes appear.
        let often = MtiFilter::new(&Beam::Lensless, 100.0);
        assert!(blocks.iter().any(|block| !often.detect(block).unwrap().echoes.is_empty()));
    }

    #[test]
    fn strong_stationary_clutter_raises_no_alarms_for_any_sensor_motion() {
        let paths: [fn(f64) -> DVec3; 4] = [
            |_| DVec3::ZERO,
            |t| winding(t) * 0.8,
            |t| DVec3::X * (0.25 * (2.5 * t).sin()),
            |t| DVec3::NEG_Z * (0.2 * (3.0 * t).sin()),
        ];
        for (n, path) in paths.into_iter().enumerate() {
            let blocks = blocks(sweeps(6.0, path, &clutter(), 11 + n as u64));
            let told: Vec<MtiResult> = blocks.iter().filter_map(|block| finder().detect(block)).collect();
            let echoes: Vec<_> = told.iter().flat_map(|movers| &movers.echoes).collect();
            let allowed = 0.1 * blocks.len() as f64;
            assert!((echoes.len() as f64) < allowed + 3.0 * allowed.sqrt(), "path {n}: {echoes:?}");
            assert!(told.len() * 3 > blocks.len(), "path {n}: {} of {} blocks tell anything", told.len(), blocks.len());
        }
    }

    #[test]
    fn moving_point_in_strong_clutter_is_found_with_range_and_rate() {
        let path = |t: f64| winding(t) * 0.2;
        let goes = |t: f64| DVec3::new(0.2, 0.1, -1.2 - 0.6 * t);
        let mut all = sweeps(1.5, path, &clutter(), 21);
        let alone = sweeps(1.5, |t| path(t) - goes(t), &[(Echo::Point(DVec3::ZERO), 1.0)], 22);
        all.iter_mut().zip(alone).for_each(|(one, more)| {
            one.samples.iter_mut().zip(more.samples).for_each(|(a, b)| *a += b);
        });
        let blocks = blocks(all);
        let mut found = 0;
        for block in &blocks {
            let time_s = (block.mid_time_ns - 1_000_000_000) as f64 * 1e-9;
            let at = |t: f64| goes(t).distance(path(t));
            let rate = (at(time_s + 1e-3) - at(time_s - 1e-3)) / 2e-3;
            let Some(echo) = finder().detect(block).and_then(|movers| movers.echoes.first().copied()) else { continue };
            assert!((echo.range_m - at(time_s)).abs() < 0.08, "{} {echo:?}", at(time_s));
            assert!((echo.range_rate_m_per_s - rate).abs() < 0.06, "{rate} {echo:?}");
            found += 1;
        }
        assert!(found * 10 >= blocks.len() * 8, "{found} of {}", blocks.len());
    }

    #[test]
    fn no_result_when_clutter_fills_the_doppler_interval() {
        let fast = |t: f64| DVec3::X * (1.6 * t);
        assert!(blocks(sweeps(0.5, fast, &clutter(), 3)).iter().all(|block| finder().detect(block).is_none()));
        let slow = blocks(sweeps(0.5, |t| DVec3::NEG_Z * (0.3 * t), &[], 3));
        let movers = finder().detect(&slow[2]).unwrap();
        // Moving forwards: everything approaches, at most as fast as the sensor moves.
        let [least, greatest] = movers.clutter_m_per_s;
        assert!((-0.36..-0.3).contains(&least) && (-0.1..0.0).contains(&greatest), "{movers:?}");
        assert!((movers.ahead_m_per_s + 0.3).abs() < 0.01);
        assert!(movers.is_observable(1.0) && movers.is_observable(-0.6) && !movers.is_observable(-0.2));
        assert!(!movers.is_observable(-0.2 + movers.ambiguity_m_per_s), "it looks like what stands still");
        assert!((movers.ambiguity_m_per_s - 0.5 * WAVELENGTH_M / 1e-3).abs() < 1e-3, "a sweep each millisecond");
    }

    #[test]
    fn missing_sweeps_do_not_spread_clutter() {
        let mut observations = sweeps(2.0, |t| winding(t) * 0.3, &clutter(), 31);
        let mut n = 0;
        observations.retain(|_| {
            n += 1;
            n % 17 != 0
        });
        let blocks = blocks(observations);
        let echoes: usize = blocks.iter().filter_map(|block| Some(finder().detect(block)?.echoes.len())).sum();
        assert!(echoes <= 4, "{echoes} in {} blocks", blocks.len());
    }
}
