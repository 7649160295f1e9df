//! Selection of sweeps when there are too many, and preselection before any imaging. One method per
//! file.

mod d_optimal;
mod farthest_point;
mod hull;
mod preselection;
mod random;
mod thesis;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Observation;
use crate::math;

pub use d_optimal::d_optimal;
pub use farthest_point::farthest_points;
pub use hull::hull_vertices;
pub use preselection::{Preselection, PreselectionCounters, Preselector};
pub use random::random;
pub use thesis::{THRESHOLD_COEFFICIENT, above_threshold, hull_above_threshold};

/// Selection method.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Selection {
    /// At random.
    Random,
    /// Eq. 3.6 of the thesis: sweeps with amplitudes of at least T · x_max, at random among these.
    Threshold,
    /// Eq. 3.7: vertices of the convex hull with amplitudes of at least T · x_max, at random among
    /// these. May be fewer than requested.
    ThesisHull,
    /// Repeatedly the sweep farthest from all that are selected.
    #[default]
    FarthestPoint,
    /// Repeatedly the sweep with most information about a point: greatest determinant of Σ u uᵀ.
    DOptimal,
}

/// Unknown name of a selection method.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("selection \"{0}\" is not known: use {list}", list = Selection::ALL.map(Selection::name).join(", "))]
pub struct UnknownSelection(pub String);

/// What a selection needs of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Position of the sensor, tracking frame.
    pub position_m: DVec3,
    /// Greatest amplitude of the sweep's points, LSB.
    pub peak_lsb: f64,
}

impl From<&Observation> for Candidate {
    fn from(observation: &Observation) -> Self {
        let amplitudes = observation.samples.iter().map(|x| f64::from(math::norm(*x)));
        Self { position_m: observation.tracking_from_sensor.translation, peak_lsb: amplitudes.fold(0.0, f64::max) }
    }
}

impl Selection {
    /// All methods.
    pub const ALL: [Selection; 5] =
        [Self::Random, Self::Threshold, Self::ThesisHull, Self::FarthestPoint, Self::DOptimal];

    /// Name in settings and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Threshold => "threshold",
            Self::ThesisHull => "thesis-hull",
            Self::FarthestPoint => "farthest-point",
            Self::DOptimal => "d-optimal",
        }
    }

    /// Indices of at most `count` sweeps, in rising order. `place` is the point of interest (the
    /// centre of the region will do). Random choices depend on `seed` alone.
    pub fn choose(self, candidates: &[Candidate], count: usize, place: DVec3, seed: u64) -> Vec<usize> {
        let positions: Vec<DVec3> = candidates.iter().map(|c| c.position_m).collect();
        let amplitudes = || candidates.iter().map(|c| c.peak_lsb).collect::<Vec<f64>>();
        let any_of = |from: Vec<usize>| random(from.len(), count, seed).into_iter().map(|n| from[n]).collect();
        match self {
            Self::Random => random(candidates.len(), count, seed),
            Self::Threshold => any_of(above_threshold(&amplitudes(), THRESHOLD_COEFFICIENT)),
            Self::ThesisHull => any_of(hull_above_threshold(&positions, &amplitudes(), THRESHOLD_COEFFICIENT)),
            Self::FarthestPoint => farthest_points(&positions, count),
            Self::DOptimal => d_optimal(&positions, place, count),
        }
    }
}

impl std::str::FromStr for Selection {
    type Err = UnknownSelection;
    fn from_str(name: &str) -> Result<Self, UnknownSelection> {
        Self::ALL.into_iter().find(|s| s.name() == name).ok_or_else(|| UnknownSelection(name.into()))
    }
}

/// Index of the first of the greatest values; 0 without values.
fn first_best(values: impl Iterator<Item = f64>) -> usize {
    values.enumerate().fold((0, f64::NEG_INFINITY), |best, (i, v)| if v > best.1 { (i, v) } else { best }).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo, sweeps, winding};

    #[test]
    fn every_way_keeps_no_more_than_asked_each_once_and_repeats() {
        let at = DVec3::new(0.2, 0.1, -1.2);
        let all: Vec<Candidate> =
            sweeps(0.3, winding, &[(Echo::Point(at), 10.0)], 1).iter().map(Candidate::from).collect();
        for way in Selection::ALL {
            assert_eq!(way.name().parse::<Selection>().unwrap(), way);
            for count in [0, 1, 20, all.len(), all.len() + 5] {
                let chosen = way.choose(&all, count, at, 7);
                assert!(chosen.len() <= count.min(all.len()), "{way:?}");
                assert!(chosen.windows(2).all(|w| w[0] < w[1]) && chosen.iter().all(|&n| n < all.len()), "{way:?}");
                assert_eq!(chosen, way.choose(&all, count, at, 7));
                assert!(way.choose(&[], count, at, 7).is_empty());
            }
        }
        assert_ne!(Selection::Random.choose(&all, 20, at, 7), Selection::Random.choose(&all, 20, at, 8));
        assert!("best".parse::<Selection>().unwrap_err().to_string().contains("farthest-point"));
    }
}
