//! Writing a sweep's tables.

use num_complex::Complex32;

use super::{Axis, LOG_STEP, parabolas};
use crate::compression::CompressionScratch;
use crate::math;
use crate::simd::{Kernel, Lanes, on_widest};
use crate::{Observation, Statistic, sweep_noise_rms};

/// Computes the tables of one sweep.
#[derive(Debug, Clone, Copy)]
pub(super) struct TableMaker {
    pub statistic: Statistic,
    pub step: f64,
    pub most_steps: f32,
    pub stride: usize,
}

impl TableMaker {
    /// Returns the greatest entry for integer statistics, else 0.
    pub fn write(
        self,
        axis: &Axis,
        observation: &Observation,
        [tables, coarse]: [&mut [f32]; 2],
        room: &mut CompressionScratch,
    ) -> i64 {
        let samples = &observation.samples;
        match self.statistic {
            Statistic::Thesis => {}
            Statistic::ThesisFull => {
                let magnitudes: Vec<f32> = samples.iter().map(magnitude).collect();
                axis.compressor.convolve_in(&magnitudes, room);
            }
            _ => axis.compressor.compress_in(samples, 1.0, room),
        }
        on_widest(WriteTables { maker: self, axis, samples, re: &room.re, im: &room.im, tables, coarse })
    }
}

/// Writes a sweep's tables from its compressed values; compiled for the widest instructions.
struct WriteTables<'a> {
    maker: TableMaker,
    axis: &'a Axis,
    samples: &'a [Complex32],
    re: &'a [f32],
    im: &'a [f32],
    tables: &'a mut [f32],
    coarse: &'a mut [f32],
}

impl Kernel for WriteTables<'_> {
    type Out = i64;

    #[inline(always)]
    fn run<S: Lanes>(self, _: S) -> i64 {
        let Self { maker, axis, samples, re, im, tables, coarse } = self;
        let TableMaker { statistic, step, most_steps, stride } = maker;
        let (falloff, entries) = (axis.falloff.as_slice(), axis.falloff.len());
        let (first, others) = tables.split_at_mut(2 * stride);
        match statistic {
            Statistic::Ls | Statistic::Subaperture => {
                let per = (1.0 / step) as f32;
                for ((to, re), im) in first[..entries].iter_mut().zip(re).zip(im) {
                    *to = ((re * re + im * im) * per).min(most_steps);
                }
                write_slopes(first, entries);
                parabolas::write(&first[..entries], axis.coarse_octaves, coarse);
                return greatest_integer(&first[..entries]);
            }
            Statistic::Log => {
                let noise = sweep_noise_rms(samples);
                let (per2, per) = ((1.0 / (noise * noise)) as f32, (1.0 / LOG_STEP) as f32);
                for ((to, re), im) in first[..entries].iter_mut().zip(re).zip(im) {
                    *to = (math::ln_1p((re * re + im * im) * per2) * per).min(most_steps);
                }
                write_slopes(first, entries);
                parabolas::write(&first[..entries], axis.coarse_octaves, coarse);
                return greatest_integer(&first[..entries]);
            }
            Statistic::Glrt => {
                for (((to, re), im), d) in first[..entries].iter_mut().zip(re).zip(im).zip(falloff) {
                    *to = magnitude(&Complex32::new(*re, *im)) * d;
                }
                write_slopes(first, entries);
                multiply(others, falloff, falloff);
            }
            Statistic::Coherent => {
                let (second, third) = others.split_at_mut(2 * stride);
                multiply(first, re, falloff);
                multiply(second, im, falloff);
                multiply(third, falloff, falloff);
            }
            Statistic::ThesisFull => multiply(first, re, falloff),
            Statistic::Thesis => {
                for (to, sample) in others.iter_mut().zip(samples) {
                    *to = magnitude(sample);
                }
                others[samples.len()..].fill(0.0);
                write_nearest(&others[..samples.len()], axis, first);
            }
        }
        0
    }
}

/// |x|, even where its square does not fit f32.
#[inline(always)]
fn magnitude(x: &Complex32) -> f32 {
    let (re, im) = (f64::from(x.re), f64::from(x.im));
    (re * re + im * im).sqrt() as f32
}

/// A plane of products, linear between entries.
#[inline(always)]
fn multiply(plane: &mut [f32], a: &[f32], b: &[f32]) {
    for ((to, a), b) in plane.iter_mut().zip(a).zip(b) {
        *to = a * b;
    }
    write_slopes(plane, b.len());
}

/// Computes the slopes of a plane whose values are written; zeros beyond its entries.
#[inline(always)]
fn write_slopes(plane: &mut [f32], entries: usize) {
    let (value, slope) = plane.split_at_mut(plane.len() / 2);
    value[entries..].fill(0.0);
    for ((to, here), next) in slope.iter_mut().zip(&value[..entries]).zip(&value[1..entries]) {
        *to = next - here;
    }
    slope[entries - 1..].fill(0.0);
}

/// Greatest integer that a sweep with these values may add to a voxel.
#[inline(always)]
fn greatest_integer(values: &[f32]) -> i64 {
    1 + (parabolas::OVERSHOOT * f64::from(greatest(values))) as i64
}

/// The greatest of non-negative values: their bits are ordered like the values.
#[inline(always)]
fn greatest(values: &[f32]) -> f32 {
    let mut most = 0;
    for value in values {
        most = most.max(value.to_bits());
    }
    f32::from_bits(most)
}

/// |x of the nearest point| · D. It jumps halfway between points, where the tables have entries.
#[inline(always)]
fn write_nearest(magnitudes: &[f32], axis: &Axis, plane: &mut [f32]) {
    let (value, slope) = plane.split_at_mut(plane.len() / 2);
    let phases = (axis.geometry.axis.step_m / axis.compressor.step_m()).round() as usize;
    let falloff = &axis.falloff;
    let last = falloff.len() - 1;
    let (mut begin, mut end) = (0, phases / 2);
    // Indexed loops: zipped iterators would be calls.
    for magnitude in magnitudes {
        let here = end.min(last).max(begin);
        let (value, slope) = (&mut value[begin..here], &mut slope[begin..here]);
        let falloff = &falloff[begin..here + 1];
        for n in 0..value.len().min(slope.len()) {
            (value[n], slope[n]) = (magnitude * falloff[n], magnitude * (falloff[n + 1] - falloff[n]));
        }
        (begin, end) = (here, end + phases);
    }
    value[begin..].fill(0.0);
    slope[begin..].fill(0.0);
    if let Some(magnitude) = magnitudes.last() {
        value[last] = magnitude * falloff[last];
    }
}
