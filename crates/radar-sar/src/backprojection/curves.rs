//! A sweep's table over a window of eight entries, for lookups in registers.

use super::sweep_stack::window;
use crate::simd::{LANES, Lanes};

/// 0 to 7, twice.
const ENTRIES: [f32; LANES] = [0., 1., 2., 3., 4., 5., 6., 7., 0., 1., 2., 3., 4., 5., 6., 7.];

/// The curves between eight entries and their next: polynomials of the place from the window's start
/// on, so that a lookup needs no fraction of it. One term per power, the constant first, with the
/// entries in both halves of the lanes.
pub(super) struct Curves<S: Lanes, const TERMS: usize>([S::F; TERMS]);

/// A window of a table that is linear between its entries.
pub(super) trait LinearWindow<'a, S: Lanes>: Sized {
    /// Of a table's values, followed by as many slopes; `None` beyond the table.
    fn new(s: S, table: &'a [f32], first: usize) -> Option<Self>;
    /// Values at places in the window.
    fn value(&self, s: S, place: S::F) -> S::F;
}

impl<'a, S: Lanes> LinearWindow<'a, S> for Curves<S, 2> {
    #[inline(always)]
    fn new(s: S, table: &'a [f32], first: usize) -> Option<Self> {
        let (values, slopes) = table.split_at(table.len() / 2);
        Some(Self::lines(s, [window(values, first)?, window(slopes, first)?]))
    }
    #[inline(always)]
    fn value(&self, s: S, place: S::F) -> S::F {
        self.at(s, place)
    }
}

/// Values and slopes at N entries.
pub(super) struct Lines<'a, const N: usize>(&'a [f32; N], &'a [f32; N]);

impl<'a, S: Lanes, const N: usize> LinearWindow<'a, S> for Lines<'a, N> {
    #[inline(always)]
    fn new(_: S, table: &'a [f32], first: usize) -> Option<Self> {
        let (values, slopes) = table.split_at(table.len() / 2);
        Some(Self(window(values, first)?, window(slopes, first)?))
    }
    #[inline(always)]
    fn value(&self, s: S, place: S::F) -> S::F {
        let whole = s.floor(place);
        let (n, rest) = (s.to_int(whole), s.sub(place, whole));
        s.mul_add(rest, s.look_up(self.1, n), s.look_up(self.0, n))
    }
}

impl<S: Lanes> Curves<S, 2> {
    /// Of lines with these values at their entries, and slopes.
    #[inline(always)]
    pub fn lines(s: S, [values, slopes]: [&[f32; 8]; 2]) -> Self {
        let slopes = s.load_twice(slopes);
        Self([s.neg_mul_add(slopes, s.load(&ENTRIES), s.load_twice(values)), slopes])
    }
}

impl<S: Lanes> Curves<S, 3> {
    /// Of a + b·t + c·t², with t from 0 to 1 between an entry and the next.
    #[inline(always)]
    pub fn parabolas(s: S, [a, b, c]: [&[f32; 8]; 3]) -> Self {
        let (a, b, c, entries) = (s.load_twice(a), s.load_twice(b), s.load_twice(c), s.load(&ENTRIES));
        let slope = s.neg_mul_add(c, entries, b);
        Self([s.neg_mul_add(slope, entries, a), s.neg_mul_add(c, entries, slope), c])
    }
}

impl<S: Lanes, const TERMS: usize> Curves<S, TERMS> {
    /// Values at places from 0 to 8.
    #[inline(always)]
    pub fn at(&self, s: S, place: S::F) -> S::F {
        let n = s.to_int_toward_zero(place);
        let mut value = s.permute_eight(self.0[TERMS - 1], n);
        for term in self.0[..TERMS - 1].iter().rev() {
            value = s.mul_add(value, place, s.permute_eight(*term, n));
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Portable;

    #[test]
    fn curves_pass_through_their_entries_and_between() {
        let [a, b, c] = [3.0, -1.7, 0.6].map(|scale| std::array::from_fn::<f32, 8, _>(|n| scale * (n as f32).cos()));
        let (lines, parabolas) = (Curves::lines(Portable, [&a, &b]), Curves::parabolas(Portable, [&a, &b, &c]));
        for step in 0..8 * 16 {
            let place = step as f32 / 16.0;
            let (n, t) = (place as usize, place.fract());
            let line = a[n] + t * b[n];
            assert!((lines.at(Portable, Portable.splat(place))[0] - line).abs() < 1e-5, "{place}");
            let parabola = line + t * t * c[n];
            assert!((parabolas.at(Portable, Portable.splat(place))[0] - parabola).abs() < 1e-5, "{place}");
        }
    }
}
