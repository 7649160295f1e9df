//! A search that begins with what is remembered of its room, and what it remembers itself. See `obstacles/remembered.rs`.

use glam::DVec3;

use super::shapes::Shape;
use super::{Existence, Place, RoomSearch, same_place, same_plane};
use crate::obstacles::remembered::{Remembered, RememberedError, RememberedPlace, RememberedWall};

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
            let shape = Shape { cells: place.shape.clone() };
            self.places.insert(id, (0.0, Place { position_m, covariance_m2, shape }));
            self.taken_up.places.push(RememberedPlace { id, ..place.clone() });
        }
        let is_same = same_plane(self.middle.unwrap_or(DVec3::ZERO));
        for wall in &remembered.walls {
            let times = [wall.first_ns, wall.last_ns];
            let Some(id) = self.walls.remember(wall.id, wall.plane, wall.score, times, &is_same) else { continue };
            self.feet.insert(id, wall.seen_at);
            self.taken_up.walls.push(RememberedWall { id, ..wall.clone() });
        }
        Ok(())
    }

    /// What is known of the room, by id: what was confirmed and looked at since, and what was taken up and is not gone.
    pub fn remembered(&self) -> Remembered {
        let place = |sighted: &crate::obstacles::Sighted<DVec3>| {
            // What was never looked at again cannot be missed either.
            let strengths = self.existences.get(&sighted.id)?.strengths();
            strengths.iter().any(|strength| *strength > 0.0).then(|| {
                let place = self.place_of(sighted);
                RememberedPlace {
                    id: sighted.id,
                    position_m: place.position_m,
                    covariance_m2: place.covariance_m2,
                    score: sighted.score,
                    strengths,
                    shape: place.shape.strongest(Remembered::MAX_SHAPE),
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
        let mut rest = std::mem::take(&mut self.taken_up);
        rest.places.retain(|place| self.points.confirmed().any(|known| known.id == place.id));
        rest.walls.retain(|wall| self.walls.confirmed().any(|known| known.id == wall.id));
        rest
    }

    /// After a look: what is surely there is provisional no more.
    pub(super) fn settle_remembered(&mut self) {
        let enough = self.settings.map.forget.confirm;
        let existences = &self.existences;
        self.points.confirm_provisional(|id| existences.get(&id).is_some_and(|e| e.log_odds() >= enough));
    }
}
