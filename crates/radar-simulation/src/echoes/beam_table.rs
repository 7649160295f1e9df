//! The beam tabulated over the cosine off the boresight: an echo scene asks for thousands of values a
//! frame, and an arc cosine and a power each time would cost more than everything else.

use radar_sar::Beam;

/// Intervals of the table over cosines from −1 to 1. Choice: linear interpolation is then within
/// 2e-4 for the narrowest lens.
const INTERVALS: usize = 2048;

/// Two-way amplitude over the cosine off the boresight.
#[derive(Debug, Clone)]
pub(crate) struct BeamTable {
    values: Vec<f64>,
}

impl BeamTable {
    pub fn new(beam: &Beam) -> Self {
        let cos = |n: usize| 2.0 * n as f64 / INTERVALS as f64 - 1.0;
        Self { values: (0..=INTERVALS).map(|n| beam.amplitude(cos(n))).collect() }
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

    /// Upper bound of the two-way amplitude for directions off the boresight by at least the angle with this
    /// cosine, for beams that fall with the angle.
    pub fn at_most(&self, cos_off_boresight: f64) -> f64 {
        let first = (0.5 * INTERVALS as f64 * (cos_off_boresight + 1.0)).clamp(0.0, INTERVALS as f64) as usize;
        self.values[(first + 1).min(INTERVALS)].max(self.values[first])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_agrees_with_the_beam() {
        for beam in [Beam::Uniform, Beam::Lensless, Beam::Fresnel, Beam::Hyperbolic] {
            let table = BeamTable::new(&beam);
            for deg in 0..1790 {
                let cos = (f64::from(deg) * 0.1f64).to_radians().cos();
                assert!((table.two_way(cos) - beam.amplitude(cos)).abs() < 3e-4, "{beam:?} at {deg}");
                assert!(table.at_most(cos) >= beam.amplitude(cos) - 1e-9);
            }
        }
    }
}
