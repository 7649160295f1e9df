//! The mean direction of all echoes, from how ranges change as the sensor moves.
//!
//! Δr = −u · Δp for an echo from direction u, whatever reflects it: a point, an edge, a highlight that slides over a
//! surface (Fermat's principle). A track of any length counts, without a model of its reflector. The directions lie in the
//! beam, about their mean m: u ~ N(m, σ²). A track's u is eliminated; m is common to all tracks and comes from all
//! of them, robustly. Its length is near 1 when echoes come from one side of the head, and near 0 when the poses do not
//! explain the ranges.

use std::collections::BTreeMap;
use std::fmt;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::combination::{TrackTerm, combine};
use super::corrections::{Quadratic, dot, solution};
use crate::symmetric::{eigen, outer};

/// Echoes within this time are averaged, nanoseconds. Choice: the head moves by centimetres, and the range's error falls
/// to millimetres.
const BIN_NS: i64 = 100_000_000;
/// Error of a range's change from one average to the next, metres. Choice: noise, slow tracking errors, and highlights that
/// leap along edges.
const CHANGE_ERROR_M: f64 = 5e-3;
/// 1σ of an echo's direction about the mean in each axis. Choice: the lensless beam is 34° wide to each side, two-way.
const SPREAD: f64 = 0.4;
/// An echo moves with the head when that is likelier than any stationary object by this difference of minus twice the log
/// likelihood. Choice: a likelihood ratio of e¹².
const CLEARLY_WORSE: f64 = 25.0;
/// An object moves when its range changes deviate by more than this, squared, on average. Choice: 1 cm in 0.1 s.
const MOVING: f64 = 4.0;
/// Bisections of a factor of 10¹⁸, to a millionth.
const BISECTIONS: usize = 45;
/// A mistake is taken when it is likelier by this difference of twice the log likelihood. Choice: a likelihood ratio of e⁷.
const CLEAR_GAIN: f64 = 14.0;
/// 1σ of the mean in each axis before. Choice: a mean of unit vectors is no longer than 1.
const PRIOR: f64 = 1.0;
/// A side is shown up to this 1σ, rad. Choice: 30°, so that 90° are clear.
const MAX_SIGMA_RAD: f64 = 0.5;

/// What is likeliest wrong with poses that do not fit the ranges. A world that is mirrored or turned as a whole, positions and
/// rotations alike, fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PoseMistake {
    /// The x axis of positions points the other way than that of rotations.
    MirroredX,
    /// The y axis does.
    MirroredY,
    /// The z axis does.
    MirroredZ,
    /// Rotations lead from the tracking frame to the head's, not back.
    InvertedRotations,
}

impl PoseMistake {
    const ALL: [Self; 4] = [Self::MirroredX, Self::MirroredY, Self::MirroredZ, Self::InvertedRotations];
}

impl fmt::Display for PoseMistake {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::MirroredX => "the x axis of positions points the other way than that of rotations",
            Self::MirroredY => "the y axis of positions points the other way than that of rotations",
            Self::MirroredZ => "the z axis of positions points the other way than that of rotations",
            Self::InvertedRotations => "rotations are from the tracking frame to the head, inverted",
        })
    }
}

/// The mean of the directions that echoes come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeanDirection {
    /// Unit vector in the axes of the assumed sensor.
    pub direction: DVec3,
    /// 1σ of a turn about the less certain axis, rad.
    pub sigma_rad: f64,
}

/// An echo's range and where the sensor was.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    pub time_ns: i64,
    pub range_m: f64,
    pub position_m: DVec3,
    pub tracking_from_sensor: DMat3,
}

/// What a track's range changes say about the direction of its echoes.
#[derive(Debug, Clone)]
pub(super) struct RangeChanges {
    /// Log likelihood of the direction as a vector in the tracking frame: its information matrix and the matrix times its
    /// maximum.
    information: DMat3,
    right: DVec3,
    /// Its value at no direction at all, as minus twice the log likelihood, and at the likeliest unit vector, where there is one.
    squares: f64,
    stationary_squares: Option<f64>,
    /// Number of changes.
    count: usize,
    tracking_from_sensor: DMat3,
    middle_ns: i64,
}

impl RangeChanges {
    /// Of one track's echoes in rising time.
    pub fn new(sightings: impl Iterator<Item = Sighting>) -> Option<Self> {
        let mut bins: BTreeMap<i64, Vec<Sighting>> = BTreeMap::new();
        sightings.for_each(|sighting| bins.entry(sighting.time_ns.div_euclid(BIN_NS)).or_default().push(sighting));
        let averages: Vec<Sighting> = bins.values().map(|bin| average(bin)).collect();
        let (mut information, mut right, mut squares) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for pair in averages.windows(2) {
            let way_m = pair[1].position_m - pair[0].position_m;
            let weighted = way_m / (CHANGE_ERROR_M * CHANGE_ERROR_M);
            information += DMat3::from_cols(way_m * weighted.x, way_m * weighted.y, way_m * weighted.z);
            let change_m = pair[1].range_m - pair[0].range_m;
            right -= weighted * change_m;
            squares += (change_m / CHANGE_ERROR_M).powi(2);
        }
        let Sighting { time_ns: middle_ns, tracking_from_sensor, .. } = *averages.get(averages.len() / 2)?;
        let count = averages.len() - 1;
        let squares_of = |u: DVec3| squares + u.dot(information * u) - 2.0 * u.dot(right);
        let stationary_squares = likeliest_unit_vector(&information, right).map(squares_of);
        Some(Self { information, right, squares, stationary_squares, count, tracking_from_sensor, middle_ns })
    }

    /// Whether the echo moves with the head, as that of a shoulder: its range changes by less than that of a
    /// stationary object in any direction.
    pub fn moves_with_head(&self) -> bool {
        self.stationary_squares.is_some_and(|squares| squares > self.squares + CLEARLY_WORSE)
    }

    /// Whether no stationary object explains the range changes.
    fn is_moving(&self) -> bool {
        self.stationary_squares.is_none_or(|squares| squares > MOVING * self.count as f64)
    }

    /// Information on the mean direction in the sensor's axes when the poses have this mistake, with the track's own direction
    /// eliminated: (H⁻¹ + σ²)⁻¹, which is (1 + σ² H)⁻¹ H, also where H is singular.
    fn term(&self, mistake: Option<PoseMistake>) -> TrackTerm<3> {
        let misfit = self.stationary_squares.map_or(1.0, |squares| squares / (self.count as f64 - 2.0).max(1.0));
        let weight = 1.0 / misfit.max(1.0);
        let sensor_from_stated = sensor_from_stated(&self.tracking_from_sensor, mistake);
        let information = sensor_from_stated * self.information * sensor_from_stated.transpose() * weight;
        let eliminated = (DMat3::IDENTITY + information * (SPREAD * SPREAD)).inverse();
        let matrix = eliminated * information;
        let matrix = (matrix + matrix.transpose()) * 0.5;
        let gradient = eliminated * (sensor_from_stated * self.right * weight);
        let quadratic = Quadratic { matrix: matrix.to_cols_array_2d(), gradient: gradient.to_array() };
        TrackTerm { quadratic, variance_factor: 1.0, middle_ns: self.middle_ns }
    }
}

/// The sensor's axes from those of the positions as stated.
fn sensor_from_stated(stated: &DMat3, mistake: Option<PoseMistake>) -> DMat3 {
    let mirrored = |axis: DVec3| stated.transpose() * (DMat3::IDENTITY - outer(axis) * 2.0);
    match mistake {
        None => stated.transpose(),
        Some(PoseMistake::MirroredX) => mirrored(DVec3::X),
        Some(PoseMistake::MirroredY) => mirrored(DVec3::Y),
        Some(PoseMistake::MirroredZ) => mirrored(DVec3::Z),
        // Exact for a sensor along the head's axes; another mount turns all tracks nearly alike.
        Some(PoseMistake::InvertedRotations) => *stated,
    }
}

/// The likeliest unit vector for an information matrix H and H û: (H + λ)⁻¹ H û with the λ that makes its length 1.
fn likeliest_unit_vector(information: &DMat3, right: DVec3) -> Option<DVec3> {
    let (values, vectors) = eigen(information);
    let along = vectors.transpose() * right;
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let at = |raised: f64| DVec3::from_array(std::array::from_fn(|k| along[k] / (values[k] - least + raised)));
    let (mut low, mut high) = (1e-9, 1e9);
    for _ in 0..BISECTIONS {
        let middle = f64::sqrt(low * high);
        if at(middle).length_squared() > 1.0 { low = middle } else { high = middle }
    }
    (vectors * at(high)).try_normalize()
}

fn average(bin: &[Sighting]) -> Sighting {
    let count = bin.len() as f64;
    Sighting {
        range_m: bin.iter().map(|sighting| sighting.range_m).sum::<f64>() / count,
        position_m: bin.iter().map(|sighting| sighting.position_m).sum::<DVec3>() / count,
        ..bin[bin.len() / 2]
    }
}

/// The mean over the tracks; `None` while they do not come from one side.
pub(super) fn mean_direction<'a>(tracks: impl Iterator<Item = &'a RangeChanges>) -> Option<MeanDirection> {
    let stationary = tracks.filter(|track| !track.is_moving());
    let terms: Vec<TrackTerm<3>> = stationary.map(|track| track.term(None)).collect();
    let combination = combine(&terms, &prior(), &[SPREAD; 3])?;
    let mean = DVec3::from_array(combination.step);
    let covariance = DMat3::from_cols_array_2d(&combination.covariance);
    let direction = mean.try_normalize()?;
    let (a, b) = direction.any_orthonormal_pair();
    let variance = a.dot(covariance * a).max(b.dot(covariance * b)) / mean.length_squared();
    Some(MeanDirection { direction, sigma_rad: variance.sqrt() }).filter(|found| found.sigma_rad <= MAX_SIGMA_RAD)
}

fn prior() -> Quadratic<3> {
    let mut prior = Quadratic::default();
    (0..3).for_each(|k| prior.expect(k, 0.0, PRIOR));
    prior
}

/// The mistake with which the echoes come from one side, when they clearly do not without it.
pub(super) fn pose_mistake<'a>(tracks: impl Iterator<Item = &'a RangeChanges>) -> Option<PoseMistake> {
    let stationary: Vec<&RangeChanges> = tracks.filter(|track| !track.is_moving()).collect();
    // Twice the log likelihood with the best mean, above that with none.
    let gain = |mistake: Option<PoseMistake>| {
        let mut sum = prior();
        stationary.iter().for_each(|track| sum.add(&track.term(mistake).quadratic, 1.0));
        Some(dot(&sum.gradient, &solution(&sum.factor()?, &sum.gradient)))
    };
    let gains = PoseMistake::ALL.into_iter().filter_map(|mistake| Some((gain(Some(mistake))?, mistake)));
    let (most, mistake) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (most > gain(None)? + CLEAR_GAIN).then_some(mistake)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Pose of the head at a time: it looks around by 1 rad and sways by 15 cm.
    fn head(time_s: f64) -> (DVec3, DMat3) {
        let sway = DVec3::new((1.3 * time_s).sin(), 0.6 * (2.1 * time_s).cos(), (2.7 * time_s + 1.0).sin());
        let turn = DQuat::from_rotation_y((0.4 * time_s).sin()) * DQuat::from_rotation_x(0.3 * (0.7 * time_s).cos());
        (sway * 0.15, DMat3::from_quat(turn))
    }

    /// Tracks of 2 s of points that lie about `facing` in the sensor's axes when the track begins; `stated` is what the
    /// tracking system makes of a pose.
    fn tracks(facing: DVec3, stated: impl Fn(DVec3, DMat3) -> (DVec3, DMat3)) -> Vec<RangeChanges> {
        let (a, b) = facing.any_orthonormal_pair();
        let track = |n: u32| {
            let first_s = f64::from(n);
            let angle = 2.4 * first_s;
            let towards = (facing + (a * angle.cos() + b * angle.sin()) * 0.5).normalize();
            let (position_m, tracking_from_sensor) = head(first_s);
            let point_m = position_m + tracking_from_sensor * towards * 1.5;
            let sighting = |k: i64| {
                let (at_m, rotation) = head(first_s + k as f64 * 0.02);
                let (position_m, tracking_from_sensor) = stated(at_m, rotation);
                let time_ns = (first_s * 1e9) as i64 + k * 20_000_000;
                Sighting { time_ns, range_m: at_m.distance(point_m), position_m, tracking_from_sensor }
            };
            RangeChanges::new((0..100).map(sighting)).unwrap()
        };
        (0..20).map(track).collect()
    }

    #[test]
    fn the_mean_lies_where_the_sensor_faces() {
        for facing in [DVec3::NEG_Z, DVec3::X, DVec3::Z, DVec3::NEG_Y] {
            let tracks = tracks(facing, |position_m, rotation| (position_m, rotation));
            let found = mean_direction(tracks.iter()).unwrap();
            assert!(found.direction.angle_between(facing) < 0.2, "{facing}: {found:?}");
            assert!(found.sigma_rad < 0.2, "{found:?}");
            assert_eq!(pose_mistake(tracks.iter()), None);
        }
        assert_eq!(mean_direction([].iter()), None);
        assert_eq!(pose_mistake([].iter()), None);
    }

    #[test]
    fn mistakes_of_the_poses_are_recognised() {
        // Which mistake it is shows only as far as the head nods: turns about the vertical mirror as they invert.
        for axis in [DVec3::X, DVec3::Z] {
            let mirrored = |at_m: DVec3| at_m - axis * 2.0 * at_m.dot(axis);
            let tracks = tracks(DVec3::NEG_Z, |at_m, rotation| (mirrored(at_m), rotation));
            assert!(pose_mistake(tracks.iter()).is_some(), "{axis}");
        }
        let inverted = tracks(DVec3::NEG_Z, |at_m, rotation| (at_m, rotation.transpose()));
        assert!(pose_mistake(inverted.iter()).is_some());
        let flip = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let world = tracks(DVec3::NEG_Z, |at_m, rotation| (flip * at_m, flip * rotation * flip));
        assert_eq!(pose_mistake(world.iter()), None, "a mirrored world fits");
    }

    #[test]
    fn a_shoulder_moves_with_the_head_and_furniture_does_not() {
        let changes = |range_m: &dyn Fn(f64) -> f64| {
            let sighting = |k: i64| {
                let time_s = k as f64 * 0.02;
                let (position_m, tracking_from_sensor) = head(time_s);
                Sighting { time_ns: k * 20_000_000, range_m: range_m(time_s), position_m, tracking_from_sensor }
            };
            RangeChanges::new((0..250).map(sighting)).unwrap()
        };
        assert!(changes(&|time_s| 0.35 + 0.01 * (3.0 * time_s).sin()).moves_with_head());
        for towards in [DVec3::X, DVec3::Y, DVec3::NEG_Z] {
            let stationary = changes(&|time_s| head(time_s).0.distance(towards * 1.2));
            assert!(!stationary.moves_with_head() && !stationary.is_moving(), "{towards}");
        }
        let walking = changes(&|time_s| 1.5 + 0.8 * (2.0 * time_s).sin());
        assert!(walking.is_moving() && !walking.moves_with_head());
    }

    #[test]
    fn at_rest_nothing_is_known() {
        let sighting = |k: i64| {
            let (position_m, tracking_from_sensor) = (DVec3::ZERO, DMat3::IDENTITY);
            Sighting { time_ns: k * 20_000_000, range_m: 1.0, position_m, tracking_from_sensor }
        };
        let at_rest = RangeChanges::new((0..100).map(sighting)).unwrap();
        assert!(!at_rest.moves_with_head());
        assert_eq!(mean_direction([at_rest].iter()), None);
        assert!(RangeChanges::new([].into_iter()).is_none());
    }
}
