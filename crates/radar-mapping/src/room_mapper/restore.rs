//! Restores a saved map into the mapper, and makes the map to save.

use glam::DVec3;

use super::shapes::Shape;
use super::{Existence, RefinedPoint, RoomMapper, same_plane, same_point};
use crate::saved_map::{SavedMap, SavedMapError, SavedPoint, SavedWall};

impl RoomMapper {
    /// Restores a saved map of this room as provisional. Objects already known are left as they
    /// are.
    ///
    /// # Errors
    /// A value is not valid for a room; nothing is restored then.
    pub fn restore(&mut self, remembered: &SavedMap) -> Result<(), SavedMapError> {
        remembered.check()?;
        let is_same = same_point(self.settings.map.match_m);
        for place in &remembered.places {
            let times = [place.first_ns, place.last_ns];
            let taken = self.points.restore(place.id, place.position_m, place.score, times, &is_same);
            let Some(id) = taken else { continue };
            self.existences.insert(id, Existence::restored(place.strengths));
            let (position_m, covariance_m2) = (place.position_m, place.covariance_m2);
            let shape = Shape { cells: place.shape.clone() };
            self.refined.insert(id, (0.0, RefinedPoint { position_m, covariance_m2, shape }));
            self.restored.places.push(SavedPoint { id, ..place.clone() });
        }
        let is_same = same_plane(self.middle.unwrap_or(DVec3::ZERO));
        for wall in &remembered.walls {
            let times = [wall.first_ns, wall.last_ns];
            let Some(id) = self.walls.restore(wall.id, wall.plane, wall.score, times, &is_same) else { continue };
            self.wall_feet.insert(id, wall.seen_at);
            self.restored.walls.push(SavedWall { id, ..wall.clone() });
        }
        Ok(())
    }

    /// What is known of the room, by id: confirmed objects observed since, and restored ones that
    /// still exist.
    pub fn saved_map(&self) -> SavedMap {
        let place = |track: &crate::Track<DVec3>| {
            // An object that was never observed again cannot be missed either.
            let strengths = self.existences.get(&track.id)?.strengths();
            strengths.iter().any(|strength| *strength > 0.0).then(|| {
                let place = self.refined_point_of(track);
                SavedPoint {
                    id: track.id,
                    position_m: place.position_m,
                    covariance_m2: place.covariance_m2,
                    score: track.score,
                    strengths,
                    shape: place.shape.strongest(SavedMap::MAX_SHAPE),
                    first_ns: track.first_ns,
                    last_ns: track.last_ns,
                }
            })
        };
        let mut places: Vec<SavedPoint> = self.points.confirmed().filter_map(place).collect();
        places.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
        places.truncate(SavedMap::MAX_PLACES);
        places.sort_by_key(|place| place.id);
        let walls = self.walls().into_iter().take(SavedMap::MAX_WALLS).map(|wall| SavedWall {
            id: wall.id,
            plane: wall.plane,
            score: wall.evidence,
            seen_at: wall.seen_at,
            first_ns: wall.first_seen_ns,
            last_ns: wall.last_seen_ns,
        });
        let mut walls: Vec<SavedWall> = walls.collect();
        walls.sort_by_key(|wall| wall.id);
        SavedMap { places, walls }
    }

    /// The restored objects that still exist, as they were, for a restart.
    pub(super) fn still_saved(&mut self) -> SavedMap {
        let mut rest = std::mem::take(&mut self.restored);
        rest.places.retain(|place| self.points.confirmed().any(|known| known.id == place.id));
        rest.walls.retain(|wall| self.walls.confirmed().any(|known| known.id == wall.id));
        rest
    }

    /// After an update: clears the provisional flag of objects that exist with certainty.
    pub(super) fn confirm_provisional_tracks(&mut self) {
        let enough = self.settings.map.forget.confirm;
        let existences = &self.existences;
        self.points.confirm_provisional(|id| existences.get(&id).is_some_and(|e| e.log_odds() >= enough));
    }
}
