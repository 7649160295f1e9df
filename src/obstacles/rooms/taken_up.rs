//! A search that begins with what is remembered of its room, and what it remembers itself. See `obstacles/remembered.rs`.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use super::{Existence, Explained, Place, RoomSearch, same_place, same_plane};
use crate::geometry::Plane;
use crate::obstacles::remembered::{Remembered, RememberedError, RememberedPlace, RememberedWall};

/// A remembered wall goes after so many looks at where it was seen without any sign of it: longer than the window is, so that it would
/// have been believed.
const UNSEEN_LOOKS: u32 = 24;
/// A wall is looked at where it was seen, and so far beyond, metres.
const BESIDE_M: f64 = 0.3;

/// What was taken up.
#[derive(Debug, Default)]
pub(super) struct TakenUp {
    all: Remembered,
    /// By place that was not sighted since: its shape, which the field does not know.
    shapes: BTreeMap<u64, Vec<(DVec3, f32)>>,
    /// By wall that was not sighted since: looks at where it should be.
    unseen_looks: BTreeMap<u64, u32>,
}

impl TakenUp {
    /// What is remembered of a place's shape.
    pub fn shape_of(&self, id: u64) -> &[(DVec3, f32)] {
        self.shapes.get(&id).map_or(&[], Vec::as_slice)
    }
}

impl RoomSearch {
    /// Takes up what is remembered of this room, as provisional: what was seen already is left as it is.
    ///
    /// # Errors
    /// Numbers that are none of a room; nothing is taken up then.
    pub fn begin_with(&mut self, remembered: &Remembered) -> Result<(), RememberedError> {
        remembered.check()?;
        let is_same = same_place(self.settings.map.match_m);
        for place in &remembered.places {
            let times = [place.first_ns, place.last_ns];
            let taken = self.points.remember(place.id, place.position_m, place.score, times, &is_same);
            let Some(id) = taken else { continue };
            self.existences.insert(id, Existence::remembered(place.strengths));
            let (position_m, covariance_m2) = (place.position_m, place.covariance_m2);
            self.places.insert(id, (0.0, Place { position_m, covariance_m2 }));
            self.taken_up.shapes.insert(id, place.shape.clone());
            self.taken_up.all.places.push(RememberedPlace { id, ..place.clone() });
        }
        let is_same = same_plane(self.middle.unwrap_or(DVec3::ZERO));
        for wall in &remembered.walls {
            let times = [wall.first_ns, wall.last_ns];
            let Some(id) = self.walls.remember(wall.id, wall.plane, wall.score, times, &is_same) else { continue };
            self.feet.insert(id, wall.seen_at);
            self.taken_up.unseen_looks.insert(id, 0);
            self.taken_up.all.walls.push(RememberedWall { id, ..wall.clone() });
        }
        Ok(())
    }

    /// What is known of the room, by id: what was confirmed and looked at since, and what was taken up and is not gone.
    pub fn remembered(&self) -> Remembered {
        let place = |sighted: &crate::obstacles::Sighted<DVec3>| {
            // What was never looked at again cannot be missed either.
            let strengths = self.existences.get(&sighted.id)?.strengths();
            strengths.iter().any(|strength| *strength > 0.0).then(|| {
                let voxel_m2 = self.settings.blocks.voxel_m.powi(2);
                let known = self.places.get(&sighted.id).map(|(_, place)| (place.position_m, place.covariance_m2));
                let unrefined = (sighted.thing, DMat3::from_diagonal(DVec3::splat(voxel_m2)));
                let (position_m, covariance_m2) = known.unwrap_or(unrefined);
                let mut shape = self.voxels_around(position_m, sighted.score);
                if shape.is_empty() {
                    shape = self.taken_up.shape_of(sighted.id).to_vec();
                }
                RememberedPlace {
                    id: sighted.id,
                    position_m,
                    covariance_m2,
                    score: sighted.score,
                    strengths,
                    shape,
                    first_ns: sighted.first_ns,
                    last_ns: sighted.last_ns,
                }
            })
        };
        let mut places: Vec<RememberedPlace> = self.points.confirmed().filter_map(place).collect();
        places.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
        places.truncate(Remembered::MAX_PLACES);
        places.sort_by_key(|place| place.id);
        let walls = self.walls().into_iter().take(Remembered::MAX_WALLS).map(|wall| RememberedWall {
            id: wall.id,
            plane: wall.plane,
            score: wall.evidence,
            seen_at: wall.seen_at,
            first_ns: wall.first_seen_ns,
            last_ns: wall.last_seen_ns,
        });
        let mut walls: Vec<RememberedWall> = walls.collect();
        walls.sort_by_key(|wall| wall.id);
        Remembered { places, walls }
    }

    /// What was taken up and is not gone, as it was: for a search that begins again.
    pub(super) fn still_remembered(&mut self) -> Remembered {
        let mut rest = std::mem::take(&mut self.taken_up.all);
        rest.places.retain(|place| self.points.confirmed().any(|known| known.id == place.id));
        rest.walls.retain(|wall| self.walls.confirmed().any(|known| known.id == wall.id));
        rest
    }

    /// After a look: what is surely there is provisional no more, and walls that were looked at in vain go.
    pub(super) fn settle_remembered(&mut self, believed: &[Explained<Plane>]) {
        let enough = self.settings.map.forget.confirm;
        let existences = &self.existences;
        self.points.confirm_provisional(|id| existences.get(&id).is_some_and(|e| e.log_odds() >= enough));
        let points = &self.points;
        self.taken_up.shapes.retain(|id, _| points.confirmed().any(|known| known.id == *id && known.quality <= 0.0));
        let gone = self.walls_in_vain(believed);
        self.walls.keep(|wall| !gone.contains(&wall.id));
        for id in gone {
            self.feet.remove(&id);
            self.taken_up.unseen_looks.remove(&id);
        }
    }

    fn walls_in_vain(&mut self, believed: &[Explained<Plane>]) -> Vec<u64> {
        let Some(block) = self.window.back() else { return Vec::new() };
        let is_same = same_plane(self.middle.unwrap_or(DVec3::ZERO));
        let mut gone = Vec::new();
        for wall in self.walls.confirmed().filter(|wall| wall.provisional) {
            let squarely = wall.thing.outward.dot(block.middle.forward()) >= self.min_cos;
            let in_range = block.geometry().axis.contains(wall.thing.distance(block.middle.translation));
            let foot = wall.thing.foot(block.middle.translation);
            let where_seen = self.feet.get(&wall.id).is_some_and(|seen_at| {
                seen_at.min.cmple(foot + BESIDE_M).all() && seen_at.max.cmpge(foot - BESIDE_M).all()
            });
            let unseen = self.taken_up.unseen_looks.entry(wall.id).or_default();
            if believed.iter().any(|plane| is_same(&plane.thing, &wall.thing)) {
                *unseen = 0;
            } else if squarely && in_range && where_seen {
                *unseen += 1;
            }
            if *unseen >= UNSEEN_LOOKS {
                gone.push(wall.id);
            }
        }
        gone
    }
}
