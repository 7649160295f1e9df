//! Saved map of a room as plain data: kept from one start to the next, and restored as provisional
//! until confirmed.
//!
//! A point comes with the power that it reflected by sector (`existence.rs`), so that it can be
//! missed. Its log odds begin low, and a chair that was moved is removed within a second of looking
//! at where it stood. Only objects that are observable in all three coordinates are in the map, so
//! there is no [`super::Observed`] here.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::existence::AZIMUTH_SECTORS;
use radar_sar::geometry::{Aabb, Plane, Pose};

/// Most points and walls that are restored. Choice: many times what a room holds (a furnished one
/// has some dozens), and a file of bounded size.
const MAX_PLACES: usize = 2000;
const MAX_WALLS: usize = 200;
/// Most cells of a point's shape. Choice: the strongest ones, as many as leave a full map small
/// enough for its file.
const MAX_SHAPE: usize = 48;
/// Farthest that a cell of a shape lies from its point, metres. Choice: a voxel and a half of the largest edge, 0.5 m, and two
/// cells in each direction.
const MAX_SHAPE_RADIUS_M: f64 = 1.5;
/// Greatest valid id. Choice: far below 2⁵³, up to which every JSON reader keeps integers, and out
/// of reach of counting.
const MAX_ID: u64 = 1 << 48;
/// Greatest distance of a coordinate from the origin, metres. Choice: beyond any tracking frame; a
/// damaged file cannot put objects kilometres away.
const MAX_COORDINATE_M: f64 = 1000.0;
/// Greatest valid strength and score. Choice: 120 dB over noise, beyond what the sensor can
/// measure.
const MAX_STRENGTH: f64 = 1e12;

/// Why a map is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SavedMapError {
    /// More than a room holds.
    #[error("{places} points and {walls} walls are more than {MAX_PLACES} and {MAX_WALLS}")]
    TooMany {
        /// Number of points.
        places: usize,
        /// Number of walls.
        walls: usize,
    },
    /// Two of one id, or an invalid id.
    #[error("id {0} is duplicated or invalid")]
    Id(u64),
    /// A number that is not finite, or out of range.
    #[error("{what} of {id} is not a valid value for a room")]
    Number {
        /// Which number.
        what: &'static str,
        /// The point's or the wall's id.
        id: u64,
    },
}

/// A point of an object.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedPoint {
    /// Stays the same.
    pub id: u64,
    /// Refined position, tracking frame, metres.
    pub position_m: DVec3,
    /// Covariance of the position, m².
    pub covariance_m2: DMat3,
    /// Best score.
    pub score: f64,
    /// Power that it reflected at 1 m on the axis, relative to noise, by sector around the
    /// vertical; 0: never seen from there.
    pub strengths: [f64; AZIMUTH_SECTORS],
    /// Cells around it that have evidence, and their scores.
    pub shape: Vec<(DVec3, f32)>,
    /// First and last time with evidence, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

/// A wall, floor or ceiling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedWall {
    /// Stays the same.
    pub id: u64,
    /// The plane.
    pub plane: Plane,
    /// Best score.
    pub score: f64,
    /// Box around the feet of the perpendiculars that it was seen at.
    pub seen_at: Aabb,
    /// First and last time with evidence, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

/// Saved map of a room.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedMap {
    /// Confirmed points, and restored ones that were not observed since, by id.
    pub places: Vec<SavedPoint>,
    /// The same of walls.
    pub walls: Vec<SavedWall>,
}

impl SavedMap {
    pub(super) const MAX_PLACES: usize = MAX_PLACES;
    pub(super) const MAX_WALLS: usize = MAX_WALLS;
    pub(super) const MAX_SHAPE: usize = MAX_SHAPE;

    /// Of these points and walls, those that [`check`](Self::check) accepts: a single other one would make the whole map unreadable.
    pub(super) fn of(mut places: Vec<SavedPoint>, mut walls: Vec<SavedWall>) -> Self {
        places.retain(|point| is_id(point.id) && point.check().is_ok());
        walls.retain(|wall| is_id(wall.id) && wall.check().is_ok());
        Self { places, walls }
    }

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty() && self.walls.is_empty()
    }

    /// Checks that every number can be valid for a room.
    ///
    /// # Errors
    /// The first one that cannot.
    pub fn check(&self) -> Result<(), SavedMapError> {
        let (places, walls) = (self.places.len(), self.walls.len());
        if places > MAX_PLACES || walls > MAX_WALLS {
            return Err(SavedMapError::TooMany { places, walls });
        }
        check_ids(self.places.iter().map(|point| point.id))?;
        check_ids(self.walls.iter().map(|wall| wall.id))?;
        self.places.iter().try_for_each(SavedPoint::check)?;
        self.walls.iter().try_for_each(SavedWall::check)
    }

    /// The same in another frame with the same vertical: `to_from` transforms from this frame's
    /// coordinates. What lies too far from that frame's origin is left out.
    pub fn moved(&self, to_from: &Pose) -> Self {
        let places = self.places.iter().map(|point| point.moved(to_from));
        Self::of(places.collect(), self.walls.iter().map(|wall| wall.moved(to_from)).collect())
    }

    /// The same by another clock, on which all times are later by this.
    pub fn later_by_ns(mut self, by_ns: i64) -> Self {
        let places = self.places.iter_mut().map(|point| [&mut point.first_ns, &mut point.last_ns]);
        let walls = self.walls.iter_mut().map(|wall| [&mut wall.first_ns, &mut wall.last_ns]);
        places.chain(walls).flatten().for_each(|time_ns| *time_ns = time_ns.saturating_add(by_ns));
        self
    }
}

impl SavedPoint {
    fn check(&self) -> Result<(), SavedMapError> {
        let columns = [self.covariance_m2.x_axis, self.covariance_m2.y_axis, self.covariance_m2.z_axis];
        let variances = self.covariance_m2.to_cols_array_2d();
        let is_shape = |(cell, score): &(DVec3, f32)| {
            cell.distance(self.position_m) <= MAX_SHAPE_RADIUS_M && is_strength(f64::from(*score))
        };
        let sound = [
            ("the position", is_position(self.position_m)),
            ("the covariance", columns.into_iter().all(is_position) && (0..3).all(|n| variances[n][n] >= 0.0)),
            ("the score", is_strength(self.score)),
            ("the strength", self.strengths.iter().all(|s| is_strength(*s)) && self.strengths.iter().any(|s| *s > 0.0)),
            ("the shape", self.shape.len() <= MAX_SHAPE && self.shape.iter().all(is_shape)),
        ];
        check_all(self.id, &sound)
    }

    fn moved(&self, to_from: &Pose) -> Self {
        let turn = DMat3::from_quat(to_from.rotation);
        let from_to = to_from.inverse();
        let mut strengths = [0.0; AZIMUTH_SECTORS];
        for (side, strength) in strengths.iter_mut().enumerate() {
            let there = super::existence::sector_direction(side);
            *strength = self.strengths[super::existence::sector_of(from_to.transform_vector(there))];
        }
        Self {
            position_m: to_from.transform_point(self.position_m),
            covariance_m2: turn * self.covariance_m2 * turn.transpose(),
            strengths,
            shape: self.shape.iter().map(|(point, score)| (to_from.transform_point(*point), *score)).collect(),
            ..self.clone()
        }
    }
}

impl SavedWall {
    fn check(&self) -> Result<(), SavedMapError> {
        let (plane, seen_at) = (&self.plane, &self.seen_at);
        let is_unit = plane.outward.is_finite() && (plane.outward.length() - 1.0).abs() < 1e-6;
        let sound = [
            ("the plane", is_unit && plane.offset_m.abs() <= MAX_COORDINATE_M),
            ("the score", is_strength(self.score)),
            (
                "the position",
                is_position(seen_at.min) && is_position(seen_at.max) && seen_at.size().min_element() >= 0.0,
            ),
        ];
        check_all(self.id, &sound)
    }

    fn moved(&self, to_from: &Pose) -> Self {
        let seen_at = self.plane.patch_moved(&self.seen_at, to_from);
        Self { plane: self.plane.moved(to_from), seen_at, ..self.clone() }
    }
}

fn check_ids(ids: impl Iterator<Item = u64>) -> Result<(), SavedMapError> {
    let mut known = BTreeSet::new();
    for id in ids {
        if !is_id(id) || !known.insert(id) {
            return Err(SavedMapError::Id(id));
        }
    }
    Ok(())
}

fn is_id(id: u64) -> bool {
    (1..=MAX_ID).contains(&id)
}

fn check_all(id: u64, sound: &[(&'static str, bool)]) -> Result<(), SavedMapError> {
    match sound.iter().find(|(_, is_sound)| !is_sound) {
        Some((what, _)) => Err(SavedMapError::Number { what, id }),
        None => Ok(()),
    }
}

fn is_position(point: DVec3) -> bool {
    point.is_finite() && point.abs().max_element() <= MAX_COORDINATE_M
}

fn is_strength(value: f64) -> bool {
    (0.0..=MAX_STRENGTH).contains(&value)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use glam::DQuat;

    pub fn some() -> SavedMap {
        let mut strengths = [0.0; AZIMUTH_SECTORS];
        strengths[3] = 40.0;
        let position_m = DVec3::new(0.5, 0.4, -1.0);
        let point = SavedPoint {
            id: 3,
            position_m,
            covariance_m2: DMat3::from_diagonal(DVec3::new(1e-4, 4e-4, 9e-4)),
            score: 8.0,
            strengths,
            shape: vec![(position_m, 8.0)],
            first_ns: 5,
            last_ns: 7,
        };
        let wall = SavedWall {
            id: 2,
            plane: Plane { outward: DVec3::NEG_Z, offset_m: 2.0 },
            score: 20.0,
            seen_at: Aabb { min: DVec3::new(-1.0, 1.5, -2.0), max: DVec3::new(1.0, 1.7, -2.0) },
            first_ns: 5,
            last_ns: 6,
        };
        SavedMap { places: vec![point], walls: vec![wall] }
    }

    #[test]
    fn moved_by_pose_and_inverse_is_identity() {
        // A quarter of a turn keeps boxes along the axes, and sectors.
        let to_from = Pose::new(DVec3::new(0.3, -0.1, 2.0), DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
        let (before, there) = (some(), some().moved(&to_from));
        assert_ne!(there.places[0].strengths, before.places[0].strengths, "sectors rotate too");
        let back = there.moved(&to_from.inverse());
        let (point, wall) = (&back.places[0], &back.walls[0]);
        assert_eq!(point.strengths, before.places[0].strengths);
        assert!((point.position_m - before.places[0].position_m).length() < 1e-12);
        assert!((point.covariance_m2 - before.places[0].covariance_m2).x_axis.length() < 1e-15);
        assert!((wall.plane.outward - DVec3::NEG_Z).length() < 1e-12 && (wall.plane.offset_m - 2.0).abs() < 1e-12);
        assert!((wall.seen_at.min - before.walls[0].seen_at.min).length() < 1e-12);
    }

    #[test]
    fn repeated_moves_do_not_grow_walls() {
        let to_from = Pose::new(DVec3::new(0.3, -0.1, 2.0), DQuat::from_rotation_y(0.5));
        let mut kept = some();
        for _ in 0..5 {
            kept = kept.moved(&to_from).moved(&to_from.inverse());
        }
        let (before, after) = (some().walls[0].seen_at, kept.walls[0].seen_at);
        assert!((before.min - after.min).length() < 1e-9 && (before.max - after.max).length() < 1e-9, "{after:?}");
    }

    #[test]
    fn check_names_invalid_values() {
        assert_eq!(some().check(), Ok(()));
        type Spurious = fn(&mut SavedMap);
        let spoils: [(Spurious, &str); 9] = [
            (|r| r.places[0].position_m.x = f64::NAN, "the position of 3"),
            (|r| r.places[0].covariance_m2.y_axis.y = -1.0, "the covariance of 3"),
            (|r| r.places[0].strengths[1] = f64::INFINITY, "the strength of 3"),
            (|r| r.places[0].shape = vec![(DVec3::ZERO, 1.0); MAX_SHAPE + 1], "the shape of 3"),
            (|r| r.places[0].shape[0].0.y += 1.6, "the shape of 3"),
            (|r| r.places[0].id = u64::MAX, "or invalid"),
            (|r| r.places.push(r.places[0].clone()), "id 3"),
            (|r| r.walls[0].plane.outward = DVec3::ONE, "the plane of 2"),
            (|r| r.walls = vec![r.walls[0].clone(); MAX_WALLS + 1], "201 walls"),
        ];
        for (spoil, message) in spoils {
            let mut spoilt = some();
            spoil(&mut spoilt);
            let error = spoilt.check().unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    #[test]
    fn what_is_moved_too_far_is_left_out_and_the_rest_stays_readable() {
        let mut map = some();
        map.places.push(SavedPoint {
            id: 4,
            position_m: DVec3::new(-1.5, 0.4, 0.0),
            shape: vec![],
            ..map.places[0].clone()
        });
        let there = map.moved(&Pose::from_translation(DVec3::X * (MAX_COORDINATE_M - 0.2)));
        assert_eq!(there.check(), Ok(()));
        assert_eq!(there.places.iter().map(|point| point.id).collect::<Vec<_>>(), [4]);
        assert!(there.walls.is_empty(), "half of it is too far away");
    }

    #[test]
    fn later_by_ns_shifts_all_times_and_saturates() {
        let later = some().later_by_ns(10);
        assert_eq!((later.places[0].first_ns, later.places[0].last_ns, later.walls[0].last_ns), (15, 17, 16));
        assert_eq!(some().later_by_ns(i64::MAX).walls[0].last_ns, i64::MAX);
    }
}
