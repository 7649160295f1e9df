//! The beam's amplitude over the cosine to the boresight, as kernels look it up.

use std::sync::{Arc, OnceLock};

use super::lanes::WIDE_WINDOW;
use crate::radar::Beam;

/// Steps of the table over cosines −1 to 1; linear between them, within 1e-4 of every beam that has a name.
const STEPS: usize = 4096;

/// A(cos) between −1 and 1, and from which cosine on it counts.
#[derive(Debug, Clone)]
pub(super) struct BeamTable {
    /// Places at a smaller cosine are out of the beam.
    pub cut_cos: f32,
    /// Every place within the cut is in the beam; otherwise an amplitude of 0 is out of it too.
    pub whole: bool,
    /// The same amplitude everywhere: nothing to look up.
    pub uniform: bool,
    /// A at `index · 2 / STEPS − 1`; beyond the cut the amplitude goes on, so that lookups beside it are right.
    pub amplitudes: Vec<f32>,
    /// A table that fits registers, where that is good enough.
    pub short: Option<Box<ShortTable>>,
}

/// A at equal steps from the cut to the axis, and at the step after each; linear between them.
#[derive(Debug, Clone)]
pub(super) struct ShortTable {
    pub amplitudes: [f32; WIDE_WINDOW],
    pub next: [f32; WIDE_WINDOW],
    pub entries_per_cos: f32,
}

/// Largest error that a short table may have.
const SHORT_TABLE_ERROR: f64 = 5e-4;

impl ShortTable {
    /// `None` where its error would be too large halfway between two entries.
    fn of(beam: &Beam, cut_cos: f64) -> Option<Box<Self>> {
        let step = (1.0 - cut_cos) / WIDE_WINDOW as f64;
        let at = |entry: f64| beam.amplitude((cut_cos + entry * step).clamp(cut_cos, 1.0));
        let mut table =
            Self { amplitudes: [0.0; WIDE_WINDOW], next: [0.0; WIDE_WINDOW], entries_per_cos: (1.0 / step) as f32 };
        for n in 0..WIDE_WINDOW {
            let (here, next) = (at(n as f64), at((n + 1) as f64));
            let off = [0.25, 0.5, 0.75].map(|part| (at(n as f64 + part) - here - (next - here) * part).abs());
            if off.iter().any(|off| *off > SHORT_TABLE_ERROR) {
                return None;
            }
            (table.amplitudes[n], table.next[n]) = (here as f32, next as f32);
        }
        (step > 0.0).then(|| Box::new(table))
    }
}

/// Table entries per unit of cosine.
pub(super) const ENTRIES_PER_COS: f32 = STEPS as f32 * 0.5;

/// Tables of the beams that have a name, made once: four thousand arc cosines each.
static NAMED: [OnceLock<Arc<BeamTable>>; 5] = [const { OnceLock::new() }; 5];

impl BeamTable {
    pub(super) fn of(beam: &Beam) -> Arc<Self> {
        let named = match beam {
            Beam::Uniform => 0,
            Beam::Thesis => 1,
            Beam::Lensless => 2,
            Beam::Fresnel => 3,
            Beam::Hyperbolic => 4,
            Beam::Table(_) => return Arc::new(Self::new(beam)),
        };
        Arc::clone(NAMED[named].get_or_init(|| Arc::new(Self::new(beam))))
    }

    fn new(beam: &Beam) -> Self {
        let step = 2.0 / STEPS as f64;
        let exact: Vec<f64> = (0..=STEPS).map(|n| beam.amplitude(n as f64 * step - 1.0)).collect();
        let first_in = exact.iter().position(|&a| a > 0.0).unwrap_or(STEPS);
        let cut_cos = cut(beam, first_in as f64 * step - 1.0, step);
        let at_cut = beam.amplitude(cut_cos);
        let amplitudes: Vec<f32> =
            exact.iter().enumerate().map(|(n, &a)| if n < first_in { at_cut as f32 } else { a as f32 }).collect();
        let whole = amplitudes.iter().all(|&a| a > 0.0);
        Self {
            short: if whole { ShortTable::of(beam, cut_cos) } else { None },
            cut_cos: cut_cos as f32,
            whole,
            uniform: *beam == Beam::Uniform,
            amplitudes,
        }
    }
}

/// The least cosine in the beam, to 1e-12, between the entry found and the one before.
fn cut(beam: &Beam, found: f64, step: f64) -> f64 {
    if found <= -1.0 {
        return -1.0;
    }
    let (mut out, mut inside) = (found - step, found);
    while inside - out > 1e-12 {
        let middle = 0.5 * (out + inside);
        if beam.amplitude(middle) > 0.0 { inside = middle } else { out = middle }
    }
    inside.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cut_is_where_the_beam_ends() {
        let cut = |beam: &Beam| BeamTable::new(beam).cut_cos;
        assert_eq!(cut(&Beam::Uniform), -1.0);
        assert!((cut(&Beam::Thesis) - 0.5f32.sqrt()).abs() < 1e-6);
        assert!(cut(&Beam::Lensless).abs() < 1e-6);
        let hollow = Beam::from_table(vec![[0.0, 0.0], [10.0, 0.0], [20.0, 1.0], [30.0, 0.5]]).unwrap();
        assert!((cut(&hollow) - 30f32.to_radians().cos()).abs() < 1e-6);
        assert!(!BeamTable::new(&hollow).whole && BeamTable::new(&Beam::Thesis).whole);
    }

    #[test]
    fn short_tables_are_close_where_there_are_any() {
        assert!(BeamTable::new(&Beam::Fresnel).short.is_none());
        for beam in [Beam::Thesis, Beam::Lensless] {
            let table = BeamTable::new(&beam);
            let short = table.short.unwrap();
            for i in 1..3000 {
                let at = WIDE_WINDOW as f64 * f64::from(i) / 3000.0;
                let (n, w) = (at.floor() as usize, at.fract() as f32);
                let near = short.amplitudes[n] * (1.0 - w) + short.next[n] * w;
                let cos = f64::from(table.cut_cos) + at / f64::from(short.entries_per_cos);
                assert!((f64::from(near) - beam.amplitude(cos)).abs() < 6e-4, "{beam:?} {cos}");
            }
        }
    }

    #[test]
    fn lookups_are_close_to_every_named_beam() {
        for beam in [Beam::Uniform, Beam::Thesis, Beam::Lensless, Beam::Fresnel, Beam::Hyperbolic] {
            let table = BeamTable::new(&beam);
            for i in 1..9000 {
                let cos = f64::from(table.cut_cos) + (1.0 - f64::from(table.cut_cos)) * f64::from(i) / 9000.0;
                let at = (cos + 1.0) * f64::from(ENTRIES_PER_COS);
                let (n, w) = (at.floor() as usize, at.fract() as f32);
                let near = table.amplitudes[n] * (1.0 - w) + table.amplitudes[(n + 1).min(STEPS)] * w;
                assert!((f64::from(near) - beam.amplitude(cos)).abs() < 1e-4, "{beam:?} {cos}");
            }
        }
    }
}
