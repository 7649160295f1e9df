//! Obstacles over time: confirmed when seen again, kept while unseen. `existence.rs` says when one is gone.

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::existence::ForgetSettings;
use super::explain::Explained;
use crate::geometry::Plane;
use crate::math;

/// Parameters of the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapSettings {
    /// Score that counts as a sighting.
    pub confirm_score: f64,
    /// Sightings among the last four updates that confirm a place.
    pub confirm_sightings: usize,
    /// Sightings among the last four updates that confirm a wall.
    pub confirm_wall_sightings: usize,
    /// Log odds, learned from simulated play, of being a thing and no artefact that a sighting must have.
    pub confirm_odds: f64,
    /// What was never seen from beyond this distance may be the player's own hand, elbow or knee and is not confirmed, metres. Also with
    /// tracked hands: in play that costs nothing, and a quarter less is reported near the body where nothing is.
    pub hands_reach_m: f64,
    /// A sighting this near belongs to a known place, metres.
    pub match_m: f64,
    /// When what is no longer there is forgotten.
    pub forget: ForgetSettings,
}

impl Default for MapSettings {
    fn default() -> Self {
        let forget = ForgetSettings::default();
        Self {
            confirm_score: 3.0,
            confirm_sightings: 1,
            confirm_wall_sightings: 3,
            confirm_odds: 1.7,
            hands_reach_m: 0.9,
            match_m: 0.15,
            forget,
        }
    }
}

impl MapSettings {
    /// The same for planes, which have demands of their own before they are believed.
    pub fn for_planes(&self) -> Self {
        let confirm_sightings = self.confirm_wall_sightings;
        Self { confirm_sightings, hands_reach_m: 0.0, ..*self }
    }

    /// Whether something that was believed counts as a sighting.
    pub fn is_sighting<T>(&self, believed: &Explained<T>) -> bool {
        believed.determined
            && believed.score >= self.confirm_score
            && believed.odds >= self.confirm_odds
            && believed.farthest_m >= self.hands_reach_m
    }
}

/// Updates that are looked back on: no more sightings can be asked for.
pub const RECENT_UPDATES: usize = 4;
/// A place that is not confirmed and not seen in this many updates is forgotten.
const FORGET_AFTER_UPDATES: u64 = 8;

/// No sighting is taken as better determined than this, metres.
const FINEST_SIGMA_M: f64 = 0.02;

/// A place that was sighted.
#[derive(Debug, Clone)]
pub struct Sighted<T> {
    /// Stays the same.
    pub id: u64,
    /// Where, as its best sighting says.
    pub thing: T,
    /// Best score.
    pub score: f64,
    /// Of the sighting that `thing` comes from: score over 1σ, per metre. A better one moves the thing.
    pub quality: f64,
    /// Log odds of the first sighting that it is a thing; infinite where that was not asked.
    pub odds: f64,
    /// Seen often enough.
    pub confirmed: bool,
    /// Remembered from before and neither sighted nor otherwise confirmed since.
    pub provisional: bool,
    /// First and last sighting, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
    recent: VecDeque<bool>,
    last_update: u64,
}

/// What was sighted, of one kind.
#[derive(Debug)]
pub struct Sightings<T> {
    known: Vec<Sighted<T>>,
    update: u64,
    next_id: u64,
}

impl<T> Default for Sightings<T> {
    fn default() -> Self {
        Self { known: Vec::new(), update: 0, next_id: 0 }
    }
}

impl<T: Copy> Sightings<T> {
    /// Takes one update's sightings, strongest first; those that are not determined are passed over; `same` tells whether two are the same thing.
    pub fn update(&mut self, found: &[Explained<T>], settings: &MapSettings, same: impl Fn(&T, &T) -> bool) {
        self.update += 1;
        for known in &mut self.known {
            known.recent.push_back(false);
            if known.recent.len() > RECENT_UPDATES {
                known.recent.pop_front();
            }
        }
        for sighting in found.iter().filter(|sighting| settings.is_sighting(sighting)) {
            match self.known.iter_mut().find(|k| same(&k.thing, &sighting.thing)) {
                Some(known) => known.see(sighting, self.update, settings),
                None => {
                    self.next_id += 1;
                    self.known.push(Sighted {
                        id: self.next_id,
                        thing: sighting.thing,
                        score: sighting.score,
                        quality: quality(sighting),
                        odds: sighting.odds,
                        confirmed: settings.confirm_sightings <= 1,
                        provisional: false,
                        first_ns: sighting.first_ns,
                        last_ns: sighting.last_ns,
                        recent: VecDeque::from([true]),
                        last_update: self.update,
                    });
                }
            }
        }
        let now = self.update;
        self.known.retain(|k| k.confirmed || now - k.last_update < FORGET_AFTER_UPDATES);
    }

    /// Takes up a thing that is remembered, unless it is known; under another id where its own is taken. Gives the id.
    pub fn remember(
        &mut self,
        id: u64,
        thing: T,
        score: f64,
        [first_ns, last_ns]: [i64; 2],
        same: impl Fn(&T, &T) -> bool,
    ) -> Option<u64> {
        if self.known.iter().any(|known| same(&known.thing, &thing)) {
            return None;
        }
        let id = if self.known.iter().any(|known| known.id == id) { self.next_id + 1 } else { id };
        self.next_id = self.next_id.max(id);
        self.known.push(Sighted {
            id,
            thing,
            score,
            // The first sighting says better where it is now.
            quality: 0.0,
            odds: f64::INFINITY,
            confirmed: true,
            provisional: true,
            first_ns,
            last_ns,
            recent: VecDeque::new(),
            last_update: self.update,
        });
        Some(id)
    }

    /// What is surely there is provisional no more.
    pub fn confirm_provisional(&mut self, is_surely_there: impl Fn(u64) -> bool) {
        self.known.iter_mut().for_each(|known| known.provisional &= !is_surely_there(known.id));
    }

    /// Forgets those that are not to be kept.
    pub fn keep(&mut self, keep: impl Fn(&Sighted<T>) -> bool) {
        self.known.retain(keep);
    }

    /// The confirmed ones.
    pub fn confirmed(&self) -> impl Iterator<Item = &Sighted<T>> {
        self.known.iter().filter(|k| k.confirmed)
    }
}

impl<T: Copy> Sighted<T> {
    fn see(&mut self, sighting: &Explained<T>, update: u64, settings: &MapSettings) {
        if let Some(newest) = self.recent.back_mut() {
            *newest = true;
        }
        self.score = if self.provisional { sighting.score } else { self.score.max(sighting.score) };
        self.provisional = false;
        if quality(sighting) > self.quality {
            (self.quality, self.thing) = (quality(sighting), sighting.thing);
        }
        self.first_ns = self.first_ns.min(sighting.first_ns);
        self.last_ns = self.last_ns.max(sighting.last_ns);
        self.last_update = update;
        self.confirmed |= self.recent.iter().filter(|seen| **seen).count() >= settings.confirm_sightings;
    }
}

/// Strong evidence from many sides says best where a thing is.
fn quality<T>(sighting: &Explained<T>) -> f64 {
    sighting.score / sighting.sigma_m.max(FINEST_SIGMA_M)
}

/// The same place: within the settings' distance.
pub fn same_place(match_m: f64) -> impl Fn(&DVec3, &DVec3) -> bool {
    move |a, b| a.distance(*b) <= match_m
}

/// The same plane: within 8° and 15 cm at a place near the middle of the room.
pub fn same_plane(middle: DVec3) -> impl Fn(&Plane, &Plane) -> bool {
    move |a, b| {
        a.outward.dot(b.outward) > math::cos(8f64.to_radians())
            && (a.distance(middle) - b.distance(middle)).abs() < 0.15
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obstacles::explain::Aspect;

    fn sighting(x: f64, score: f64, determined: bool) -> Explained<DVec3> {
        Explained {
            thing: DVec3::X * x,
            score,
            blocks: 5,
            determined,
            sigma_m: 0.05,
            lasting: score - 1.0,
            drowned: 0.0,
            farthest_m: 1.5,
            uneven: 0.0,
            silent: 0.0,
            rival: 0.0,
            aspect: Aspect::default(),
            odds: f64::INFINITY,
            first_ns: 1,
            last_ns: 2,
        }
    }

    fn after(updates: &[&[Explained<DVec3>]]) -> Vec<(u64, f64)> {
        let mut sightings = Sightings::default();
        let settings = MapSettings { confirm_score: 6.0, confirm_sightings: 2, ..Default::default() };
        updates.iter().for_each(|found| sightings.update(found, &settings, same_place(settings.match_m)));
        sightings.confirmed().map(|s| (s.id, s.thing.x)).collect()
    }

    #[test]
    fn what_is_likely_an_artefact_is_no_sighting() {
        let settings = MapSettings::default();
        let with = |odds: f64| settings.is_sighting(&Explained { odds, ..sighting(0.0, 60.0, true) });
        assert!(with(settings.confirm_odds) && !with(settings.confirm_odds - 0.1) && !with(f64::NAN));
        assert!(settings.for_planes().is_sighting(&sighting(0.0, 60.0, true)), "of planes it is not asked");
    }

    #[test]
    fn seen_twice_of_four_confirms_and_the_best_place_stays() {
        let (good, better) = (&[sighting(0.0, 7.0, true)][..], &[sighting(0.05, 9.0, true)][..]);
        assert_eq!(after(&[good]), []);
        assert_eq!(after(&[good, &[], &[], better]), [(1, 0.05)]);
        assert_eq!(after(&[better, good]), [(1, 0.05)]);
        // Five updates apart: the first one has left the four.
        assert_eq!(after(&[good, &[], &[], &[], good]), []);
    }

    #[test]
    fn the_confirmed_stay_and_the_others_are_forgotten() {
        let seen = &[sighting(0.0, 7.0, true)][..];
        let mut updates = vec![seen, seen];
        updates.extend(vec![&[][..]; 50]);
        assert_eq!(after(&updates).len(), 1);
        let mut once = vec![seen];
        once.extend(vec![&[][..]; FORGET_AFTER_UPDATES as usize]);
        once.extend([seen, seen]);
        // A new id: the first sighting is gone.
        assert_eq!(after(&once), [(2, 0.0)]);
    }

    #[test]
    fn what_is_remembered_is_confirmed_by_a_sighting_and_moves_to_it() {
        let mut sightings = Sightings::default();
        let settings = MapSettings { confirm_score: 6.0, confirm_sightings: 2, ..Default::default() };
        let same = same_place(settings.match_m);
        assert_eq!(sightings.remember(7, DVec3::ZERO, 30.0, [-9, -8], &same), Some(7));
        assert_eq!(sightings.remember(8, DVec3::X * 0.1, 30.0, [-9, -8], &same), None, "known already");
        assert_eq!(sightings.remember(7, DVec3::X, 30.0, [-9, -8], &same), Some(8), "another id");
        sightings.update(&[], &settings, &same);
        let told = |sightings: &Sightings<DVec3>| -> Vec<(u64, f64, bool)> {
            sightings.confirmed().map(|s| (s.id, s.thing.x, s.provisional)).collect()
        };
        assert_eq!(told(&sightings), [(7, 0.0, true), (8, 1.0, true)]);
        sightings.update(&[sighting(0.05, 7.0, true), sighting(3.0, 7.0, true)], &settings, &same);
        sightings.update(&[sighting(3.0, 7.0, true)], &settings, &same);
        assert_eq!(told(&sightings), [(7, 0.05, false), (8, 1.0, true), (9, 3.0, false)]);
        sightings.confirm_provisional(|id| id == 8);
        assert!(sightings.confirmed().all(|s| !s.provisional));
    }

    #[test]
    fn weak_and_undetermined_sightings_do_not_count() {
        let (weak, open) = (&[sighting(0.0, 5.9, true)][..], &[sighting(0.0, 20.0, false)][..]);
        assert_eq!(after(&[weak, weak, open, open]), []);
    }

    #[test]
    fn planes_are_the_same_by_direction_and_offset_in_the_room() {
        let same = same_plane(DVec3::Y);
        let wall = |yaw_deg: f64, offset_m| {
            let yaw = f64::to_radians(yaw_deg);
            Plane { outward: DVec3::new(yaw.sin(), 0.0, -yaw.cos()), offset_m }
        };
        assert!(same(&wall(0.0, 2.0), &wall(5.0, 2.1)));
        assert!(!same(&wall(0.0, 2.0), &wall(10.0, 2.0)));
        assert!(!same(&wall(0.0, 2.0), &wall(0.0, 2.2)));
    }
}
