//! What is there: known places that nothing is at any more are forgotten, and what is newly believed is weighed.

use std::collections::VecDeque;

use glam::DVec3;

use super::super::acceptance::{Around, Earlier, Weighed, beyond_doubt_or, features, log_odds};
use super::super::existence::{Existence, Told};
use super::super::views::{View, information, sigma_m};
use super::super::{Believed, Explained, Sighted, same_place};
use super::RoomSearch;
use crate::imaging::blocks::Block;
use crate::math;

/// What is no higher than this may be the reflection of the floor, which is at height 0 of the standing universe, metres: at the beam's edge it
/// is placed badly.
const FLOOR_M: f64 = 0.3;
/// The floor's reflection is placed this near to the point below the sensor, seen from above, metres; and at the beam's edge, which has less
/// than this amplitude.
const BELOW_M: f64 = 0.35;
const BELOW_AT_EDGE_M: f64 = 0.8;
const EDGE_OF_BEAM: f64 = 0.4;
/// What is this near to a known wall, floor or ceiling may be its reflection, metres.
const AT_SURFACE_M: f64 = 0.25;
/// Nothing stands this near to where a hand was: palm, fingers, what it holds, and how well such a place is known, metres.
const HAND_REACHED_M: f64 = 0.25;
/// It has been away when it was not there for so long, nanoseconds.
const HAND_AWAY_NS: i64 = 10_000_000_000;
/// What is this near to each other, seen from above, may be of one piece, metres; what was seen so short a time before the other turned out to be
/// gone is not in doubt, nanoseconds.
const BESIDE_M: f64 = 0.6;
const SINCE_NS: i64 = 1_000_000_000;
/// Looks of which it is kept what they weighed: two seconds.
const LOOKS_BACK: usize = 8;

/// What blocks that have a place in their beam say of it.
fn of_blocks<'b>(
    window: &'b VecDeque<Block>,
    told: impl Iterator<Item = Option<Told>> + 'b,
) -> impl Iterator<Item = (&'b Block, Told)> {
    window.iter().zip(told).filter_map(|(block, told)| Some((block, told?)))
}

/// Of a place of which the blocks from before the window were not asked.
fn not_asked(place: &Explained<DVec3>) -> Earlier {
    Earlier { log_odds: 0.0, sigma_m: place.sigma_m, telling: 0 }
}

impl RoomSearch {
    /// Forgets known places that nothing is at any more, by what the blocks say of each.
    pub(super) fn forget(&mut self, ids: &[u64], told: &[Vec<Option<Told>>]) {
        let settings = &self.settings.map.forget;
        for (&id, told) in ids.iter().zip(told) {
            let is_new = !self.existences.contains_key(&id);
            let existence = self.existences.entry(id).or_insert_with(Existence::new);
            existence.look(of_blocks(&self.window, told.iter().copied()), settings);
            if let Some(new) = self.points.confirmed().find(|point| is_new && point.id == id) {
                existence.begin_with(settings.newly * new.odds);
            }
        }
        let gone: Vec<u64> = self.existences.iter().filter(|(_, e)| e.log_odds() <= 0.0).map(|(id, _)| *id).collect();
        self.counters.forgotten += gone.len() as u64;
        let now_ns = self.window.back().map_or(i64::MIN, |block| block.mid_time_ns);
        for known in self.points.confirmed().filter(|known| gone.contains(&known.id)) {
            self.past.is_gone(known.thing, now_ns);
            if !self.existences.get(&known.id).is_some_and(Existence::was_sure) {
                continue;
            }
            let is_beside = |other: &&Sighted<DVec3>| (other.thing - known.thing).with_y(0.0).length() <= BESIDE_M;
            for other in self.points.confirmed().filter(is_beside) {
                if let Some(existence) = self.existences.get_mut(&other.id) {
                    existence.doubt(now_ns.saturating_sub(SINCE_NS), settings);
                }
            }
        }
        self.points.keep(|point| !gone.contains(&point.id));
        for id in gone {
            self.existences.remove(&id);
            self.places.remove(&id);
        }
    }

    /// Those of what was known that still is: what has just been forgotten is not seen again by the blocks that it was forgotten for.
    pub(super) fn still_known(&self, believed: &Believed) -> Vec<(Explained<DVec3>, Weighed)> {
        let is_same = same_place(self.settings.map.match_m);
        let is_known = |place: DVec3| self.points.confirmed().any(|known| is_same(&known.thing, &place));
        let known = believed.places.iter().filter(|place| is_known(place.thing));
        known.map(|place| self.weigh(place, not_asked(place))).collect()
    }

    /// Those of what is newly believed that are still there by the newest blocks that could tell.
    pub(super) fn still_there(&self, new: &Believed) -> Vec<(Explained<DVec3>, Weighed)> {
        let settings = &self.settings.map.forget;
        let is_there = |views: &[Option<View>]| {
            let mut existence = Existence::new();
            let told = views.iter().map(|view| view.map(|view| Told { view, is_shadowed: false }));
            existence.look(of_blocks(&self.window, told), settings);
            existence.log_odds() >= settings.confirm
        };
        let places = new.places.iter().zip(&new.asked);
        let there = places.filter(|(place, asked)| {
            !self.is_floor_below(place.thing, place.aspect.beam)
                && !self.is_where_a_hand_was(place.thing)
                && is_there(&new.views[**asked])
        });
        let with_past = |(place, asked): (&Explained<DVec3>, &usize)| self.with_past(place, &new.views[*asked]);
        there.map(with_past).map(|(place, earlier)| self.weigh(&place, earlier)).collect()
    }

    /// The floor returns most from right below the sensor, and so near to other things that it may be taken for a part of them. Nothing else is
    /// there: the wearer stands on it. Farther away it is the floor when it was seen at the beam's edge alone.
    fn is_floor_below(&self, place: DVec3, beam: f64) -> bool {
        let reach_m = if beam < EDGE_OF_BEAM { BELOW_AT_EDGE_M } else { BELOW_M };
        let is_over = |block: &Block| (block.middle.translation - place).with_y(0.0).length() < reach_m;
        place.y.abs() < FLOOR_M && self.window.iter().any(is_over)
    }

    /// Where a tracked hand has just been nothing stands, and what is seen there was the hand, what it holds, or nothing at all. What is touched was
    /// mostly known before; if not it is when the hand has been away for a while.
    fn is_where_a_hand_was(&self, place: DVec3) -> bool {
        let now_ns = self.window.back().map_or(i64::MIN, |block| block.mid_time_ns);
        self.hands.came_near(place, HAND_REACHED_M, now_ns.saturating_sub(HAND_AWAY_NS))
    }

    /// A place with the odds that it is a thing, by what is around it and what is known from before the window.
    pub(super) fn weigh(&self, place: &Explained<DVec3>, earlier: Earlier) -> (Explained<DVec3>, Weighed) {
        let features = features(place, &self.around(place.thing, earlier));
        let at_surface = self.walls.confirmed().any(|wall| wall.thing.distance(place.thing).abs() < AT_SURFACE_M);
        let odds = beyond_doubt_or(log_odds(&features), place, at_surface);
        let place = Explained { odds, ..*place };
        (place, Weighed { place_m: place.thing, features, may_be_new: self.may_be_new(&place) })
    }

    fn around(&self, place: DVec3, earlier: Earlier) -> Around {
        let is_same = same_place(self.settings.map.match_m);
        let level = |to: DVec3| to.with_y(0.0).length();
        let others = || self.points.confirmed().filter(|known| !is_same(&known.thing, &place));
        let distance_m = |known: &&Sighted<DVec3>| known.thing.distance(place);
        let nearest = others().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        let strength = |known: &Sighted<DVec3>| self.existences.get(&known.id).map(Existence::greatest_strength);
        let upright = self.walls.confirmed().filter(|wall| wall.thing.is_upright());
        let to_sensor = self.window.back().map_or(DVec3::ZERO, |block| place - block.middle.translation);
        let times_ns = self.first_ns.zip(self.window.back().map(|block| block.mid_time_ns));
        Around {
            known_m: nearest.map_or(f64::INFINITY, |known| distance_m(&known)),
            known_level_m: others().map(|known| level(known.thing - place)).fold(f64::INFINITY, f64::min),
            wall_m: upright.map(|wall| wall.thing.distance(place)).fold(f64::INFINITY, f64::min),
            known_ln_strength: nearest.and_then(strength).map_or(0.0, |strength| math::ln(strength.max(1e-9))),
            earlier,
            sensor_m: to_sensor.length(),
            sensor_level_m: level(to_sensor),
            age_s: times_ns.map_or(0.0, |(first_ns, now_ns)| (now_ns - first_ns) as f64 * 1e-9),
            looks: self.tried.iter().filter(|look| look.iter().any(|other| is_same(other, &place))).count(),
        }
    }

    /// Whether a place that was believed may be a new thing, as far as the settings' bounds go.
    fn may_be_new(&self, place: &Explained<DVec3>) -> bool {
        self.is_new(place) && place.farthest_m >= self.settings.map.hands_reach_m
    }

    /// Whether it is well enough seen and nothing that is known.
    fn is_new(&self, place: &Explained<DVec3>) -> bool {
        place.determined && self.would_be_new(place)
    }

    /// Whether it would be new if it were determined.
    fn would_be_new(&self, place: &Explained<DVec3>) -> bool {
        let map = &self.settings.map;
        let is_same = same_place(map.match_m);
        place.score >= map.confirm_score && !self.points.confirmed().any(|known| is_same(&known.thing, &place.thing))
    }

    /// A place that would be new with what the past says of it: how likely it is, and, where the window leaves it open along its circle and the past
    /// agrees, whereabouts.
    fn with_past(&self, place: &Explained<DVec3>, views: &[Option<View>]) -> (Explained<DVec3>, Earlier) {
        if !self.would_be_new(place) {
            return (*place, not_asked(place));
        }
        let says = self.past.says(place.thing, views, (&self.settings.blocks, self.min_cos), &self.beam);
        let seen = self.window.iter().zip(views).filter_map(|(block, view)| Some((block, view.as_ref()?)));
        let telling = seen.filter(|(_, view)| view.is_telling());
        let sigma_m = sigma_m(&information(says.information, telling).inverse());
        let is_determined = says.log_odds > 0.0 && sigma_m <= self.settings.explain.max_sigma_m;
        let earlier = Earlier { log_odds: says.log_odds, sigma_m, telling: says.telling };
        (Explained { determined: place.determined || is_determined, ..*place }, earlier)
    }

    /// Keeps what a look has weighed that may be new.
    pub(super) fn note_weighed(&mut self, weighed: Vec<Weighed>) {
        let tried = weighed.iter().filter(|weighed| weighed.may_be_new).map(|weighed| weighed.place_m);
        self.tried.push_back(tried.collect());
        if self.tried.len() > LOOKS_BACK {
            self.tried.pop_front();
        }
        self.weighed = weighed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::PositionErrors;
    use crate::imaging::test_data::{Echo, sweeps, winding};
    use crate::obstacles::{RoomSettings, ViewMemory, Window};
    use crate::radar::Beam;

    #[test]
    fn nothing_stands_where_a_tracked_hand_has_just_been() {
        let mut search = RoomSearch::new(RoomSettings::default(), &Beam::Lensless, PositionErrors::default());
        let place = DVec3::new(0.2, -0.3, -0.5);
        for sweep in sweeps(1.0, winding, &[], 3) {
            search.push(sweep);
        }
        let now_ns = search.window.back().unwrap().mid_time_ns;
        search.take_hands(now_ns, [Some(place + DVec3::Y * 0.2), Some(place + DVec3::X * 0.5)]);
        assert!(search.is_where_a_hand_was(place));
        assert!(!search.is_where_a_hand_was(place + DVec3::Z), "elsewhere");
        search.window.iter_mut().for_each(|block| block.mid_time_ns += HAND_AWAY_NS + 1);
        assert!(!search.is_where_a_hand_was(place), "that was a while ago");
    }

    #[test]
    fn what_was_known_for_sure_takes_what_stood_beside_it_along_and_nothing_else() {
        let beside = |gone: Existence| {
            let mut search = RoomSearch::new(RoomSettings::default(), &Beam::Lensless, PositionErrors::default());
            for sweep in sweeps(1.0, winding, &[], 3) {
                search.push(sweep);
            }
            for (id, at_m) in [(1, 0.0), (2, 0.9 * BESIDE_M), (3, 1.1 * BESIDE_M)] {
                search.points.remember(id, DVec3::new(at_m, 0.5, -1.0), 5.0, [0, 0], same_place(0.1)).unwrap();
                search.existences.insert(id, Existence::remembered([1.0; 16]));
            }
            search.existences.insert(1, gone);
            search.forget(&[], &[]);
            assert!(search.points.confirmed().all(|point| point.id != 1), "it is gone");
            [2, 3].map(|id| search.existences[&id].log_odds())
        };
        let known = Existence::remembered([1.0; 16]).log_odds();
        assert_eq!(beside(Existence::known_and_gone()), [RoomSettings::default().map.forget.beside, known]);
        assert_eq!(beside(Existence::new()), [known, known], "it may have been nothing from the beginning");
    }

    #[test]
    fn two_glimpses_from_two_straight_ways_determine_a_place_that_neither_does() {
        let thing = DVec3::new(0.1, 0.1, -1.2);
        let (level, upright) = (|t: f64| DVec3::X * (0.15 * t), |t: f64| DVec3::Y * (0.15 * t));
        let glimpsed = |ways: [fn(f64) -> DVec3; 2]| {
            let mut search = RoomSearch::new(RoomSettings::default(), &Beam::Lensless, PositionErrors::default());
            for (n, way) in ways.into_iter().enumerate() {
                for mut sweep in sweeps(1.5, way, &[(Echo::Point(thing), 2.0)], 3) {
                    // The first glimpse has left the window by the second.
                    sweep.mid_time_ns += n as i64 * 6_000_000_000;
                    search.push(sweep);
                }
            }
            let (settings, mut memory) = (search.settings, ViewMemory::default());
            let window = search.window.iter();
            let mut window =
                Window::new(window, &search.hands, &settings.explain, &settings.blocks, &search.beam, &mut memory);
            let believed = window.explain(&[], &[thing]);
            let place = believed.places[0];
            (place.determined, search.with_past(&place, &believed.views[0]).0.determined)
        };
        assert_eq!(glimpsed([level, upright]), (false, true));
        assert_eq!(glimpsed([upright, upright]), (false, false), "the same circle twice");
    }

    #[test]
    fn the_floor_below_the_sensor_is_no_thing() {
        let mut search = RoomSearch::new(RoomSettings::default(), &Beam::Lensless, PositionErrors::default());
        let way = |t: f64| winding(t) + DVec3::Y * 1.6;
        let echoes = [(Echo::Point(DVec3::new(0.0, 1.5, -1.2)), 2.0)];
        sweeps(1.0, way, &echoes, 3).into_iter().for_each(|sweep| search.push(sweep));
        let below = way(0.9).with_y(0.0);
        assert!(search.is_floor_below(below, 0.9) && search.is_floor_below(below + DVec3::new(0.2, -0.1, 0.1), 0.9));
        let elsewhere = [DVec3::Y * 0.4, DVec3::X * 1.5, DVec3::NEG_Z * 1.5];
        assert!(elsewhere.iter().all(|offset| !search.is_floor_below(below + *offset, 0.2)));
        let ahead = below + DVec3::NEG_Z * 0.6;
        assert!(
            search.is_floor_below(ahead, 0.2) && !search.is_floor_below(ahead, 0.9),
            "a foot of a chair is seen from afar"
        );
    }
}
