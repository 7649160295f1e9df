//! What in a block cannot be at rest: echoes whose Doppler lies beyond that of everything that stands still.
//!
//! A sensor that moves with v sees what stands still in direction u at a range rate of −v·u. The beam bounds u, so one interval of
//! range rates holds all of it; energy beyond is of something that moves by itself, and at least as fast as it lies beyond.
//!
//! What stands still is up to 55 dB stronger than what is looked for, and sweeps come in frames with pauses between, which no window
//! over an FFT forgives: a missing sweep in seventeen puts copies 24 dB down all over the spectrum. So it is not windowed away but
//! projected away: tones over the interval, at the times at which sweeps really were measured, made orthonormal (the discrete
//! prolate functions of the band, but for a rotation), and taken out of every range's sweeps. What is left is held against tones
//! beyond the interval, at each range. Of noise of mean power 1 a tone's power |sᴴe|²/K is exponential with mean 1 at most, so a bound
//! follows from the number of cells and the false alarms that are allowed in a block. Where more is left at a range than noise and
//! what moves as fast account for, it must stand out of that instead: no two terms of wrong modelling make a mover.
//!
//! The interval reaches to where the beam is down to [`BEAM_EDGE_AMPLITUDE`], −40 dB: a wall there returns as much as noise does. Range
//! rates are known modulo λ/2 over the time between sweeps; they are told within ± half of that around the interval's middle, which
//! is right for whatever moves slower than that by itself. What moves across the line of sight, or within the interval, is not told
//! from what is at rest.

use glam::DVec3;

use super::lanes::LANES;
use super::{Subaperture, taper};
use crate::backprojection::dispatch::{Kernel, on_widest};
use crate::backprojection::lanes::Lanes;
use crate::math;
use crate::{Beam, WAVELENGTH_M};

/// Two-way amplitude of the beam at the edge of what is looked for at rest.
const BEAM_EDGE_AMPLITUDE: f64 = 0.01;
/// How wrong the sensor's speed may be, metres a second.
const SPEED_ERROR_M_PER_S: f64 = 0.03;
/// Tones of what stands still lie so far apart, and reach so far beyond the interval, in units of 1/T, T the block's length.
const TONE_STEP: f64 = 0.6;
const CLUTTER_BAND_MARGIN: f64 = 1.0;
/// A tone of which less than this is left by those before is left out: it would stand for what lies outside of the interval.
const MIN_RESIDUAL_AMPLITUDE: f32 = 0.1;
/// From so far beyond the interval on most of a tone is left, in units of 1/T.
const GUARD_BAND: f64 = 2.5;
/// Distance of the tones that are looked for, in units of 1/T.
const DOPPLER_STEP: f64 = 0.6;
/// Most tones of either kind; and the share of the sweeps' freedom that what stands still may take up. Beyond, nothing is said.
const MAX_CLUTTER_TONES: usize = 160;
const MAX_DOPPLER_CELLS: usize = 1024;
const MAX_CLUTTER_SHARE: f64 = 0.8;
/// Echoes nearer in range to a stronger one are its own: parts of one body, and the pulse's skirt, metres.
const MIN_TARGET_SEPARATION_M: f64 = 0.3;
/// Most echoes of one block.
const MAX_ECHOES: usize = 4;
/// Around the strongest tone these belong to it, metres a second.
const TARGET_DOPPLER_HALF_WIDTH_M_PER_S: f64 = 0.2;

/// An echo of something that moves by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MtiEcho {
    /// Its range from the block's middle, metres.
    pub range_m: f64,
    /// How fast that grows, metres a second; the sensor's own motion included.
    pub range_rate_m_per_s: f64,
    /// Power of its tone over what else there is at its range.
    pub power: f64,
}

/// What a block says of what moves.
#[derive(Debug, Clone, PartialEq)]
pub struct MtiResult {
    /// Strongest first.
    pub echoes: Vec<MtiEcho>,
    /// Least and greatest range rate of what stands still, metres a second; what an echo's lies beyond it is a speed of its own.
    pub clutter_m_per_s: [f64; 2],
    /// So far beyond it nothing is told yet, metres a second.
    pub guard_m_per_s: f64,
    /// Range rate of what stands still straight ahead, metres a second.
    pub ahead_m_per_s: f64,
    /// Range rates that differ by this look alike, metres a second.
    pub ambiguity_m_per_s: f64,
    /// First and last range looked at, metres.
    pub ranges_m: [f64; 2],
}

impl MtiResult {
    /// Whether something of a range rate would be told from what stands still.
    pub fn is_observable(&self, range_rate_m_per_s: f64) -> bool {
        let [least, greatest] = self.clutter_m_per_s;
        let off = range_rate_m_per_s - 0.5 * (least + greatest);
        let off = off - (off / self.ambiguity_m_per_s).round() * self.ambiguity_m_per_s;
        off.abs() > 0.5 * (greatest - least) + self.guard_m_per_s
    }
}

/// Finds them, with what depends on the beam alone.
#[derive(Debug, Clone)]
pub struct MtiFilter {
    edge_cos: f64,
    alarms_per_block: f64,
}

impl MtiFilter {
    /// Of noise it makes a false echo in this share of the blocks at most.
    pub fn new(beam: &Beam, alarms_per_block: f64) -> Self {
        Self { edge_cos: beam.cut_off_cos(BEAM_EDGE_AMPLITUDE), alarms_per_block }
    }

    /// What moves in a block; `None` where what stands still may have any Doppler, so that nothing can be said.
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
        let bound = math::ln(cells.len() as f64 * data.ranges as f64 / self.alarms_per_block);
        let range_m = |bin: f64| f64::from(block.first_m) + bin * data.step_m;
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

    /// Least and greatest range rate of what stands still in the beam, while the block was measured; and the mean of what stands straight
    /// ahead.
    fn clutter_rates(&self, block: &Subaperture) -> ([f64; 2], f64) {
        let ahead = block.middle.forward();
        let edge_rad = math::acos(self.edge_cos.clamp(-1.0, 1.0));
        let (mut rates, mut straight) = ([f64::INFINITY, f64::NEG_INFINITY], 0.0);
        for k in 0..block.sweep_count {
            let [x, y, z] = block.groups[k / LANES].velocity_m_per_s.map(|axis| f64::from(axis[k % LANES]));
            let velocity = DVec3::new(x, y, z);
            let speed = velocity.length();
            let off_rad = math::acos((velocity.dot(ahead) / speed.max(1e-9)).clamp(-1.0, 1.0));
            // What lies straight ahead of the way comes nearest the fastest.
            let nearing = speed * math::cos((off_rad - edge_rad).max(0.0));
            let leaving = -speed * math::cos((off_rad + edge_rad).min(std::f64::consts::PI));
            rates = [rates[0].min(-nearing), rates[1].max(leaving)];
            straight -= velocity.dot(ahead) / block.sweep_count as f64;
        }
        (rates, straight)
    }
}

/// The times of a block's sweeps.
struct SlowTime {
    /// From the middle of the block, seconds.
    times_s: Vec<f32>,
    /// How long all sweeps together last, with a sweep's share after the last.
    length_s: f64,
    /// Between sweeps of a frame.
    step_s: f64,
}

/// Sweeps as columns of ranges, what stands still turned to around 0 Hz.
struct Demodulated {
    /// `[sweep][re, im][range]`, `width` floats a row.
    values: Vec<f32>,
    width: usize,
    ranges: usize,
    step_m: f64,
}

/// Turns a second of a range rate.
fn hz(rate_m_per_s: f64) -> f64 {
    2.0 * rate_m_per_s / WAVELENGTH_M
}

impl SlowTime {
    /// `None` where there are too few sweeps to tell anything, or times that are none.
    fn of(block: &Subaperture) -> Option<Self> {
        let (first, last) = (*block.times_s.first()?, *block.times_s.last()?);
        let (count, middle) = (block.times_s.len(), 0.5 * (first + last));
        let mut steps: Vec<f32> = block.times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let is_sound = count >= 8 && last > first && steps.iter().all(|step| *step > 0.0);
        if !is_sound {
            return None;
        }
        let (_, step_s, _) = steps.select_nth_unstable_by((count - 1) / 2, f32::total_cmp);
        Some(Self {
            length_s: f64::from(last - first) * count as f64 / (count - 1) as f64,
            step_s: f64::from(*step_s),
            times_s: block.times_s.iter().map(|time_s| time_s - middle).collect(),
        })
    }

    fn sweeps(&self) -> usize {
        self.times_s.len()
    }

    /// Sweeps in whole vectors.
    fn padded(&self) -> usize {
        self.sweeps().next_multiple_of(LANES)
    }

    /// Range rates that differ by this are a cell apart.
    fn resolution_m_per_s(&self) -> f64 {
        WAVELENGTH_M / (2.0 * self.length_s)
    }

    fn ambiguity_m_per_s(&self) -> f64 {
        WAVELENGTH_M / (2.0 * self.step_s)
    }

    /// Range rates that are looked at, from the middle of what stands still: at least so far from it; `None` where none is left.
    fn cells(&self, from_m_per_s: f64) -> Option<Vec<f64>> {
        let step = DOPPLER_STEP * self.resolution_m_per_s();
        let count = (0.5 * self.ambiguity_m_per_s() / step).floor();
        let first = (from_m_per_s / step).ceil();
        let is_some = first <= count && count <= MAX_DOPPLER_CELLS as f64 / 2.0;
        let side = move |sign: f64| (first as i64..=count as i64).map(move |n| sign * n as f64 * step);
        is_some.then(|| side(-1.0).collect::<Vec<_>>().into_iter().rev().chain(side(1.0)).collect())
    }

    /// An orthonormal basis of what has a range rate up to that of the middle, `[tone][sweep]`, sweeps padded with zeros; `None`
    /// where it would take up too much.
    fn clutter_basis(&self, half_m_per_s: f64) -> Option<Vec<f32>> {
        let most = MAX_CLUTTER_TONES.min((MAX_CLUTTER_SHARE * self.sweeps() as f64) as usize);
        let step_hz = TONE_STEP / self.length_s;
        let tones = ((hz(half_m_per_s) + CLUTTER_BAND_MARGIN / self.length_s) / step_hz).ceil();
        if tones > 2.0 * most as f64 {
            return None;
        }
        let mut basis = Vec::with_capacity((most + 1) * self.padded());
        // From tone to tone every sweep's phase grows by the same.
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

    /// The block's sweeps without their taper, at ranges half a pulse apart, turned back by a range rate.
    fn demodulated(&self, block: &Subaperture, rate_m_per_s: f64) -> Demodulated {
        let pulse_m = block.geometry().pulse_fwhm_m;
        let stride = ((0.5 * pulse_m * f64::from(block.entries_per_m)).round() as usize).max(1);
        let ranges = (block.entries - 1) / stride + 1;
        let width = ranges.next_multiple_of(LANES);
        let groups = block.groups.len();
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
        Demodulated { values, width, ranges, step_m: stride as f64 * f64::from(block.entry_step_m) }
    }
}

/// Makes the last row orthogonal to those before and of length 1; false where too little of it is left.
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
        // Twice is enough.
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

/// Takes a basis out of every column.
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
                    sum = s.mul_add(s.splat(*value), sixteen(s, data, k * 2 * width + at), sum);
                }
                for (k, value) in tone[..sweeps].iter().enumerate() {
                    let from = k * 2 * width + at;
                    let residual = s.neg_mul_add(s.splat(*value), sum, sixteen(s, data, from));
                    data[from..from + LANES].copy_from_slice(&s.store(residual));
                }
            }
        }
    }
}

/// Sixteen values from an index on, which all exist.
#[inline(always)]
fn sixteen<S: Lanes>(s: S, values: &[f32], at: usize) -> S::F {
    match values[at..].first_chunk() {
        Some(values) => s.load(values),
        None => s.splat(0.0),
    }
}

/// Power of one tone at every range.
struct Tone<'a> {
    data: &'a [f32],
    width: usize,
    /// `[sweep]`: the tone's conjugate.
    cos: &'a [f32],
    sin: &'a [f32],
    /// What the power is divided by.
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
                let (x, y) = (sixteen(s, data, k * 2 * width + at), sixteen(s, data, k * 2 * width + width + at));
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
    /// Range rates from the middle of what stands still, rising, metres a second.
    rates: &'a [f64],
    /// `[rate][range]`, `width` floats a row.
    powers: Vec<f32>,
    width: usize,
    /// `[range]`: all that is left at it, and how many noise values that would be.
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
        // From tone to tone they turn by the same, but where the interval is left out.
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

    /// The strongest tone at a range and how far it stands out.
    fn strongest(&self, range: usize) -> (usize, f64) {
        let at =
            (0..self.rates.len()).max_by(|a, b| self.power(*a, range).total_cmp(&self.power(*b, range))).unwrap_or(0);
        // A body is no tone: what is near in speed is of it.
        let own = self.around(at).map(|n| self.power(n, range)).sum::<f64>() * DOPPLER_STEP;
        let degrees_of_freedom = self.degrees_of_freedom - self.around(at).count() as f64 * DOPPLER_STEP;
        let level = (f64::from(self.residual[range]) - own) / degrees_of_freedom.max(1.0);
        (at, self.power(at, range) / level.max(1.0))
    }

    /// Fractional range, range rate and strength of what stands out by the bound, strongest first.
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

    /// Where the middle of a body is, by the strongest tone at each range around.
    fn middle_of_range(&self, range: usize, step_m: f64) -> f64 {
        let reach = (0.5 * MIN_TARGET_SEPARATION_M / step_m).round() as usize;
        let around = range.saturating_sub(reach)..=(range + reach).min(self.residual.len() - 1);
        let weigh = |n: usize| (0..self.rates.len()).map(|rate| self.power(rate, n)).fold(0.0, f64::max);
        mean(around.map(|n| (n as f64, weigh(n))))
    }

    /// How fast it is, by the tones around the strongest.
    fn middle_of_rate(&self, rate: usize, range: usize) -> f64 {
        mean(self.around(rate).map(|n| (self.rates[n], self.power(n, range))))
    }

    /// Range rates of the same body.
    fn around(&self, rate: usize) -> impl Iterator<Item = usize> {
        let is_near = move |n: &usize| (self.rates[*n] - self.rates[rate]).abs() <= TARGET_DOPPLER_HALF_WIDTH_M_PER_S;
        (0..self.rates.len()).filter(is_near)
    }
}

/// The weighted mean.
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

    /// Strong things all over the beam and a wall.
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
        // The bound is one: with ten times as many allowed some come.
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
        // Towards what is ahead: things come nearer, at most as fast as the sensor goes.
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
