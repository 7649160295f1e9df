//! The beam tabulated over the cosine off the boresight: an echo scene asks for thousands of values a
//! frame, and an arc cosine and a power each time would cost more than everything else.

use radar_sar::Beam;

/// Intervals of the table over cosines from −1 to 1. Choice: linear interpolation is then within
/// 3e-4 for the narrowest lens.
const INTERVALS: usize = 2048;

/// Two-way amplitude over the cosine off the boresight.
#[derive(Debug, Clone)]
pub(crate) struct BeamTable {
    values: Vec<f64>,
    /// Largest value at this cosine and all smaller ones.
    bounds: Vec<f64>,
}

impl BeamTable {
    pub fn new(beam: &Beam) -> Self {
        let cos = |n: usize| 2.0 * n as f64 / INTERVALS as f64 - 1.0;
        let values: Vec<f64> = (0..=INTERVALS).map(|n| beam.amplitude(cos(n))).collect();
        let largest = values.iter().scan(0.0, |largest: &mut f64, &value| {
            *largest = largest.max(value);
            Some(*largest)
        });
        let bounds = largest.collect();
        Self { values, bounds }
    }

    /// Amplitude of an echo that leaves and arrives in the same direction.
    pub fn two_way(&self, cos_off_boresight: f64) -> f64 {
        let at = (0.5 * INTERVALS as f64 * (cos_off_boresight + 1.0)).clamp(0.0, INTERVALS as f64);
        let n = (at as usize).min(INTERVALS - 1);
        let share = at - n as f64;
        self.values[n] + (self.values[n + 1] - self.values[n]) * share
    }

    /// Amplitude of an echo that leaves in one direction and arrives from another.
    pub fn between(&self, cos_out: f64, cos_in: f64) -> f64 {
        (self.two_way(cos_out) * self.two_way(cos_in)).sqrt()
    }

    /// Upper bound of the two-way amplitude for directions off the boresight by at least the angle with this cosine.
    pub fn at_most(&self, cos_off_boresight: f64) -> f64 {
        let at = (0.5 * INTERVALS as f64 * (cos_off_boresight + 1.0)).clamp(0.0, INTERVALS as f64);
        self.bounds[(at as usize + 1).min(INTERVALS)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cos(tenths_deg: i32) -> f64 {
        (f64::from(tenths_deg) * 0.1f64).to_radians().cos()
    }

    #[test]
    fn table_agrees_with_the_beam() {
        // A measured table has kinks, at the boresight too.
        let measured = Beam::from_table(vec![[0.0, 1.0], [25.0, 0.02], [40.0, 0.12], [60.0, 0.0]]).unwrap();
        let smooth = [Beam::Uniform, Beam::Lensless, Beam::Fresnel, Beam::Hyperbolic].map(|beam| (beam, 3e-4));
        for (beam, tolerance) in smooth.into_iter().chain([(measured, 0.03)]) {
            let table = BeamTable::new(&beam);
            for n in 0..1790 {
                assert!((table.two_way(cos(n)) - beam.amplitude(cos(n))).abs() < tolerance, "{beam:?} at {n}");
            }
        }
    }

    #[test]
    fn bound_covers_sidelobes_beyond() {
        let sidelobe = Beam::from_table(vec![[0.0, 1.0], [25.0, 0.02], [40.0, 0.12], [60.0, 0.0]]).unwrap();
        for beam in [Beam::Lensless, Beam::Thesis, sidelobe] {
            let table = BeamTable::new(&beam);
            for n in 0..900 {
                let beyond = (n..900).step_by(20).map(|n| beam.amplitude(cos(n))).fold(0.0, f64::max);
                // A peak between two values of the table is cut by less than this.
                assert!(table.at_most(cos(n)) >= beyond - 1e-3, "{beam:?} at {n}");
            }
        }
    }
}
