//! A table as parabolas over wider entries: coarse voxels then look up fewer of them.

use super::{WINDOW, window};
use crate::simd::LANES;

/// a, b and c.
const PLANES: usize = 3;

/// Greatest value of a parabola between values from 0 to 1, and a thousandth more for the rounding of
/// lookups. Physics: 9/8 with the middle value halfway; 4/3 with it at a third, as in a last entry of
/// three steps.
pub(super) const OVERSHOOT: f64 = 1.001 * 4.0 / 3.0;

/// A sweep's steps over range as parabolas.
#[derive(Clone, Copy)]
pub(in super::super) struct Parabolas<'a> {
    /// a, b and c of a + b·t + c·t² with t from 0 to 1 over a coarse entry.
    planes: [&'a [f32]; 3],
    /// Coarse entries per table entry.
    pub per_entry: f32,
}

impl<'a> Parabolas<'a> {
    #[inline(always)]
    pub(super) fn new(planes: &'a [f32], per_entry: f32) -> Self {
        let (a, others) = planes.split_at(planes.len() / PLANES);
        let (b, c) = others.split_at(others.len() / 2);
        Self { planes: [a, b, c], per_entry }
    }

    /// Those from a coarse entry on; `None` beyond the table.
    #[inline(always)]
    pub fn window<const N: usize>(&self, first: usize) -> Option<[&'a [f32; N]; 3]> {
        let [a, b, c] = self.planes;
        Some([window(a, first)?, window(b, first)?, window(c, first)?])
    }

    /// Upper bound of the values between a table entry and the next.
    pub fn greatest_between(&self, entry: usize) -> f64 {
        let share = f64::from(self.per_entry);
        let at = entry as f64 * share;
        let (n, t) = (at.floor() as usize, at.fract());
        let [a, b, c] = self.planes.map(|plane| f64::from(plane[n]));
        let value = |t: f64| a + t * (b + t * c);
        // Between two points, a parabola rises above their chord by at most this.
        let bulge = 0.25 * share * share * (-c).max(0.0);
        value(t).max(value(t + share)) + bulge + rounding_of_lookup([a, b, c])
    }
}

/// By how much a lookup's value may exceed that of its curve a + b·t + c·t². Curves over eight entries
/// are polynomials from the first on, up to |a| + 16|b| + 192|c|, and take up to eight roundings.
pub(in super::super) fn rounding_of_lookup([a, b, c]: [f64; 3]) -> f64 {
    4.0 * f64::from(f32::EPSILON) * (a.abs() + 16.0 * b.abs() + 192.0 * c.abs())
}

/// Writes a table's values as parabolas over 2^`octaves` entries each, through the first, the middle
/// and the last. Planes of a, b and c, zeros beyond.
#[inline(always)]
pub(super) fn write(values: &[f32], octaves: u32, coarse: &mut [f32]) {
    let each = 1usize << octaves;
    let (a, others) = coarse.split_at_mut(coarse.len() / PLANES);
    let (b, c) = others.split_at_mut(others.len() / 2);
    let whole = (values.len() - 1) / each;
    let of_entry = values.chunks_exact(each).zip(values[each.min(values.len())..].iter().step_by(each));
    for (((a, b), c), (from, end)) in a.iter_mut().zip(&mut *b).zip(&mut *c).zip(of_entry) {
        (*a, *b, *c) = parabola([from[0], from[each / 2], *end], [0.5, 1.0]);
    }
    for plane in [&mut *a, &mut *b, &mut *c] {
        plane[whole..].fill(0.0);
    }
    // The last one has fewer entries: its middle and its end are elsewhere.
    let rest = &values[whole * each..];
    (a[whole], b[whole], c[whole]) = match rest {
        [only] => (*only, 0.0, 0.0),
        [from, end] => (*from, (end - from) * each as f32, 0.0),
        _ => {
            let (middle, end) = ((rest.len() - 1) / 2, rest.len() - 1);
            parabola([rest[0], rest[middle], rest[end]], [middle as f32 / each as f32, end as f32 / each as f32])
        }
    };
}

/// Number of values in the planes of a table's parabolas over 2^`octaves` entries each, with a window of
/// zeros beyond the last. Planes are an odd number of cache lines long, so that those of many sweeps do not
/// share sets of the cache.
pub(super) fn len(entries: usize, octaves: u32) -> usize {
    PLANES * (((entries >> octaves) + 1 + WINDOW).div_ceil(LANES) | 1) * LANES
}

/// a, b and c of the parabola through three values, the first at 0.
#[inline(always)]
fn parabola([from, middle, end]: [f32; 3], at: [f32; 2]) -> (f32, f32, f32) {
    let (slope, slope_on) = ((middle - from) / at[0], (end - middle) / (at[1] - at[0]));
    let c = (slope_on - slope) / at[1];
    (from, slope - c * at[0], c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backprojection::curves::Curves;
    use crate::simd::{Lanes, Portable};

    /// Entries of a Gaussian with so many per width, and its parabolas over 2^`octaves` entries.
    fn gaussian(entries: usize, per_width: f64, octaves: u32) -> (Vec<f32>, Vec<f32>) {
        let value = |n: usize| crate::envelope(per_width, n as f64 - 0.45 * entries as f64) as f32;
        let values: Vec<f32> = (0..entries).map(value).collect();
        let mut planes = vec![f32::NAN; len(entries, octaves)];
        write(&values, octaves, &mut planes);
        (values, planes)
    }

    fn at(planes: &[f32], octaves: u32, place: f64) -> f64 {
        let (apart, place) = (planes.len() / PLANES, place / f64::from(1 << octaves));
        let (n, t) = (place.floor() as usize, place.fract());
        let [a, b, c] = [0, 1, 2].map(|plane| f64::from(planes[plane * apart + n]));
        a + t * (b + t * c)
    }

    #[test]
    fn parabolas_follow_a_pulse_to_its_last_entry() {
        for (octaves, per_width) in [(1, 14.0), (2, 28.0), (3, 56.0)] {
            for entries in 90..110 {
                let (_, planes) = gaussian(entries, per_width, octaves);
                for n in 0..=20 * (entries - 1) {
                    let place = n as f64 / 20.0;
                    let exact = crate::envelope(per_width, place - 0.45 * entries as f64);
                    assert!((at(&planes, octaves, place) - exact).abs() < 5e-4, "{octaves} {entries} {place}");
                }
            }
        }
    }

    #[test]
    fn short_tables_and_what_lies_beyond_are_handled() {
        for entries in 1..12 {
            for octaves in 1..=3 {
                let (values, planes) = gaussian(entries, 3.0, octaves);
                for (n, value) in values.iter().enumerate().step_by(1 << octaves) {
                    assert!((at(&planes, octaves, n as f64) - f64::from(*value)).abs() < 1e-6);
                }
                let last = at(&planes, octaves, (entries - 1) as f64);
                assert!((last - f64::from(values[entries - 1])).abs() < 1e-6, "{entries} {octaves}");
                assert_eq!(at(&planes, octaves, (entries + 20) as f64), 0.0);
            }
        }
    }

    #[test]
    fn nothing_between_two_entries_exceeds_its_bound() {
        // As rough as data can be, and a step at the end, whose last entry overshoots most.
        let rough = |n: u32| (n.wrapping_mul(2_654_435_761) % 1000) as f32;
        let step = |entries: u32| (0..entries).map(move |n| if n > (entries - 1) / 4 * 4 { 999.0 } else { 0.0 });
        let lengths = 90..=98;
        let all = lengths.flat_map(|entries| [(0..entries).map(rough).collect(), step(entries).collect()]);
        for (values, octaves) in all.flat_map(|values: Vec<f32>| (1..=3).map(move |octaves| (values.clone(), octaves)))
        {
            let mut planes = vec![0.0; len(values.len(), octaves)];
            write(&values, octaves, &mut planes);
            let parabolas = Parabolas::new(&planes, 1.0 / (1 << octaves) as f32);
            for n in 0..(values.len() - 1) * 16 {
                let place = n as f64 / 16.0;
                let (value, bound) = (at(&planes, octaves, place), parabolas.greatest_between(place as usize));
                assert!(value <= bound + 1e-6, "{octaves} {place}: {value} {bound}");
                // What a sweep can add to a voxel at most.
                assert!(value <= OVERSHOOT * 999.0 + 1e-3, "{octaves} {place} of {}: {value}", values.len());
            }
        }
    }

    #[test]
    fn no_lookup_of_loud_sweeps_exceeds_its_bound() {
        let entries = 97;
        let loud = |n: u32| (n.wrapping_mul(2_654_435_761) % 1000) as f32 * 1e6;
        let values: Vec<f32> = (0..entries).map(loud).collect();
        let mut planes = vec![0.0; len(values.len(), 2)];
        write(&values, 2, &mut planes);
        let parabolas = Parabolas::new(&planes, 0.25);
        for first in 0..entries as usize / 4 - 8 {
            let curves = Curves::parabolas(Portable, parabolas.window(first).unwrap());
            for step in 0..8 * 64 {
                let place = step as f32 / 64.0;
                let value = f64::from(curves.at(Portable, Portable.splat(place))[0]);
                let bound = parabolas.greatest_between(first * 4 + (place * 4.0) as usize);
                assert!(value <= bound + 1e-3, "{first} {place}: {value} {bound}");
            }
        }
    }
}
