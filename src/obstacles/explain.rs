//! Explaining away: strong things claim what they account for before weak things are believed.
//!
//! Over the last seconds of blocks, planes and places by falling score: each is scored again on the blocks in which nothing
//! stronger claims its range and direction, and if enough is left it claims these itself. A block sees a thing at a range
//! and at a cosine to the sensor's way; both are known as well as pulse and aperture allow, and that is the claim.
//!
//! What a still head or a straight path sees could lie anywhere on a circle around the path, and did, as most ghosts of the
//! first experiments. So a place counts only when its blocks tell it from the rest of the circle, and a plane only when its
//! mirror points have moved; and what is known already claims first, since it is what most of a new circle belongs to.

mod aspect;
mod claims;
mod plane;
mod tally;

use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::existence::Told;
use super::hands::HandTrail;
use super::views::{Said, View, ViewMemory, information, sigma_m};
use crate::geometry::Plane;
use crate::imaging::blocks::{Block, BlockSettings};
use crate::math;
use crate::radar::Beam;
pub use aspect::Aspect;
use claims::Claim;
pub(super) use claims::hand_claims;
pub use tally::SEGMENT_NS;
use tally::{Tally, Weighed, lasting, unevenness};

/// Parameters of explaining away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExplainSettings {
    /// Blocks of this last time are explained, seconds.
    pub window_s: f64,
    /// Score that is left and still counts as a thing.
    pub min_score: f64,
    /// Score of the field from which on a place is looked at. A receiver's noise alone gets there less than three times an hour in every
    /// preset, and never to what confirms: `examples/room_false_alarms.rs`.
    pub min_candidate_score: f64,
    /// Candidates at most, the strongest.
    pub max_candidates: usize,
    /// Blocks that a plane must have been seen in.
    pub plane_min_blocks: u32,
    /// Score from which on a plane is believed.
    pub plane_min_score: f64,
    /// Least half-length of a claim in range, metres.
    pub claim_range_m: f64,
    /// Half-width of a claim in direction, in units of λ/2L, L the block's aperture.
    pub claim_lobes: f64,
    /// Evidence that a place loses for the square of every e-fold by which a block's echo is stronger or weaker than the others tell.
    pub uneven_cost: f64,
    /// A place is determined when its 1σ is at most this in every direction, metres.
    pub max_sigma_m: f64,
    /// A plane is determined when the feet of its perpendiculars spread by at least this, rms, metres.
    pub min_feet_rms_m: f64,
    /// And when its score is by this much greater than that of the best single place.
    pub min_over_point: f64,
}

impl Default for ExplainSettings {
    fn default() -> Self {
        Self {
            window_s: 4.0,
            min_score: 2.5,
            min_candidate_score: 2.5,
            max_candidates: 400,
            plane_min_blocks: 13,
            plane_min_score: 14.0,
            claim_range_m: 0.15,
            claim_lobes: 1.5,
            uneven_cost: 1.0,
            max_sigma_m: 0.25,
            min_feet_rms_m: 0.1,
            min_over_point: 2.0,
        }
    }
}

/// A thing that was believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explained<T> {
    /// Plane or place.
    pub thing: T,
    /// A/√B over the blocks that nothing stronger claimed; of a place less what speaks against it.
    pub score: f64,
    /// Number of these blocks.
    pub blocks: usize,
    /// It is told from others like it, a place from the rest of its circle, a plane from a point: by these blocks, or, once the search has asked
    /// them, together with those from before the window.
    pub determined: bool,
    /// 1σ of a place, all directions together, as far as ranges and directions can tell it from others, metres; of a plane, of where it is 1 m
    /// beside where it was seen.
    pub sigma_m: f64,
    /// The score without the best [`SEGMENT_NS`] of them: what is there longer than a hand that passes, or an artefact of one movement,
    /// keeps most of its score.
    pub lasting: f64,
    /// Mean of the logarithm of what else there was at its range, over the noise, in the blocks that tell of it: artefacts live on what
    /// else there is.
    pub drowned: f64,
    /// Greatest distance at which it was seen, metres.
    pub farthest_m: f64,
    /// How far the strengths differ that the blocks imply which tell of it, 1σ in e-folds of power.
    pub uneven: f64,
    /// Share of the blocks that do not tell of it.
    pub silent: f64,
    /// The score of the best place elsewhere that the same echoes would have spoken for, as a part of its own: 1 where one cannot tell
    /// which of the two it is.
    pub rival: f64,
    /// How it was seen.
    pub aspect: Aspect,
    /// Log odds that it is a thing and no artefact; infinite where that was not asked.
    pub odds: f64,
    /// First and last of these blocks, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

/// The blocks of a window and what is claimed in them.
pub struct Window<'a> {
    blocks: Vec<&'a Block>,
    weights: Vec<f64>,
    /// `[block]`
    claims: Vec<Vec<Claim>>,
    settings: &'a ExplainSettings,
    block_settings: &'a BlockSettings,
    beam: &'a Beam,
    min_cos: f64,
    mirror_min_cos: f64,
    memory: &'a mut ViewMemory,
}

/// What a candidate is.
#[derive(Debug, Clone, Copy)]
enum Thing {
    Plane(Plane),
    Place(DVec3),
}

/// Something that may be there, and what each block says of it; views that a claim covers are taken out.
struct Candidate {
    thing: Thing,
    /// Which of the places that were asked for.
    asked: Option<usize>,
    /// `[block]`
    views: Vec<Option<View>>,
    left: Option<Tally>,
}

/// What is believed, each strongest first.
#[derive(Debug, Clone, Default)]
pub struct Believed {
    /// Walls, floor, ceiling; new ones are all determined.
    pub planes: Vec<Explained<Plane>>,
    /// Places.
    pub places: Vec<Explained<DVec3>>,
    /// Of each place that was asked for, in that order: what the blocks say of it in which nothing stronger claims it, `[place][block]`.
    pub(super) views: Vec<Vec<Option<View>>>,
    /// Which of the places that were asked for each of `places` was, before it was moved uphill.
    pub(super) asked: Vec<usize>,
}

impl<'a> Window<'a> {
    /// Nothing claimed yet but by the player's own hands, where they were tracked. `blocks` in time.
    pub fn new(
        blocks: impl Iterator<Item = &'a Block>,
        hands: &HandTrail,
        settings: &'a ExplainSettings,
        block_settings: &'a BlockSettings,
        beam: &'a Beam,
        memory: &'a mut ViewMemory,
    ) -> Self {
        let (min_cos, mirror_min_cos) = (block_settings.min_cos(beam), block_settings.mirror_min_cos(beam));
        let blocks: Vec<_> = blocks.collect();
        let newest_ns = blocks.last().map_or(0, |b| b.mid_time_ns);
        let age_s = |b: &&Block| (newest_ns - b.mid_time_ns) as f64 * 1e-9;
        let weights = blocks.iter().map(|b| math::exp(-age_s(b) / block_settings.memory_s)).collect();
        memory.begin(&blocks);
        let claims = blocks.iter().map(|block| hand_claims(block, hands)).collect();
        Self { claims, weights, blocks, settings, block_settings, beam, min_cos, mirror_min_cos, memory }
    }

    /// Believes places alone.
    pub fn explain_points(&mut self, candidates: &[DVec3]) -> Vec<Explained<DVec3>> {
        self.explain(&[], candidates).places
    }

    /// Believes planes and places by falling score: what explains the same blocks better wins. Claims of earlier calls hold,
    /// so a call with what is known already gives it precedence.
    pub fn explain(&mut self, planes: &[Plane], places: &[DVec3]) -> Believed {
        self.explain_these(planes, places, false)
    }

    /// The same of what is known: a known plane accounts for its echoes, whether or not these blocks can tell it from a point.
    pub fn explain_known(&mut self, planes: &[Plane], places: &[DVec3]) -> Believed {
        self.explain_these(planes, places, true)
    }

    fn explain_these(&mut self, planes: &[Plane], places: &[DVec3], known: bool) -> Believed {
        self.ask(places);
        let of_planes = planes.par_iter().map(|plane| self.unclaimed(Thing::Plane(*plane), self.views_of_plane(plane)));
        let mut open: Vec<Candidate> = of_planes.collect();
        let of_places = places.iter().enumerate();
        open.extend(of_places.map(|(n, place)| Candidate { asked: Some(n), ..self.place(*place) }));
        let mut believed = Believed { views: vec![Vec::new(); places.len()], ..Believed::default() };
        while let Some(mut best) = self.take_best(&mut open, &mut believed.views) {
            match best.thing {
                Thing::Plane(_) => self.climb_plane(&mut best),
                Thing::Place(_) => self.climb(&mut best),
            }
            best.hand_over(&mut believed.views);
            let Some(left) = best.left else { continue };
            match best.thing {
                Thing::Plane(plane) => {
                    let is_plane = self.is_plane(&best.views);
                    if !(is_plane || known) {
                        continue;
                    }
                    let seen = self.looked_into(plane, left, None, &best, &open);
                    let sigma_m = self.plane_sigma_m(&best.views);
                    believed.planes.push(Explained { determined: is_plane, sigma_m, ..seen });
                }
                Thing::Place(place) => {
                    let covariance_m2 = self.covariance_m2(&best.views);
                    believed.places.push(self.looked_into(place, left, Some(covariance_m2), &best, &open));
                    believed.asked.extend(best.asked);
                }
            }
            self.claim(&best, &mut open);
        }
        believed
    }

    /// A candidate with what is claimed already taken out.
    fn unclaimed(&self, thing: Thing, views: Vec<Option<View>>) -> Candidate {
        let mut candidate = Candidate { thing, asked: None, views, left: None };
        let views = candidate.views.iter_mut().zip(&self.claims);
        views.for_each(|(view, claims)| claims.iter().for_each(|claim| claim.take(view)));
        candidate.left = self.left_of(candidate.thing, candidate.views.iter().map(Option::as_ref));
        candidate
    }

    /// A place that was asked for.
    fn place(&self, place: DVec3) -> Candidate {
        let views = self.memory.said(place).iter().map(|said| said.flatten()).collect();
        self.unclaimed(Thing::Place(place), views)
    }

    /// The score of a place that was asked for; −∞ when too few blocks are left to it.
    fn score_of_place(&self, place: DVec3) -> f64 {
        let unclaimed = |(said, claims): (&'_ Said, &Vec<Claim>)| -> Option<View> {
            let is_claimed = |v: &View| claims.iter().any(|claim| claim.covers(v.range_m, v.cos));
            said.flatten().filter(|view| !is_claimed(view))
        };
        let views: Vec<Option<View>> = self.memory.said(place).iter().zip(&self.claims).map(unclaimed).collect();
        let left = self.left_of(Thing::Place(place), views.iter().map(Option::as_ref));
        left.map_or(f64::NEG_INFINITY, |left| left.score)
    }

    /// Moves a strong place uphill between the voxels, in ever smaller steps: a claim from beside the maximum would leave
    /// some of the thing unexplained. Places lie on a lattice around the first, so that most were asked for before.
    fn climb(&mut self, candidate: &mut Candidate) {
        let (Thing::Place(start), Some(left)) = (candidate.thing, candidate.left) else { return };
        let mut score = left.score;
        if score < CLIMB_FROM_SCORE {
            return;
        }
        let unit_m = self.block_settings.voxel_m * CLIMB_UNIT;
        let place = |at: IVec3| start + at.as_dvec3() * unit_m;
        let (mut here, mut step) = (IVec3::ZERO, CLIMB_UNITS);
        while step > 0 {
            let around = (0..27).filter(|n| *n != 13).map(|n| here + (IVec3::new(n % 3, n / 3 % 3, n / 9) - 1) * step);
            let near: Vec<IVec3> = around.filter(|at| place(*at).distance(start) <= CLIMB_REACH_M).collect();
            self.ask(&near.iter().map(|at| place(*at)).collect::<Vec<_>>());
            let scores = near.iter().map(|at| (*at, self.score_of_place(place(*at))));
            match scores.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((at, best)) if best > score => (here, score) = (at, best),
                _ => step /= 2,
            }
        }
        if here != IVec3::ZERO {
            *candidate = Candidate { asked: candidate.asked, ..self.place(place(here)) };
        }
    }

    /// The candidate with the greatest score, if that suffices. Claims only take away: what falls short now always will.
    fn take_best(&self, open: &mut Vec<Candidate>, views: &mut [Vec<Option<View>>]) -> Option<Candidate> {
        let min_score = |c: &Candidate| match c.thing {
            Thing::Plane(_) => self.settings.plane_min_score,
            Thing::Place(_) => self.settings.min_score,
        };
        open.retain_mut(|c| {
            let suffices = c.left.is_some_and(|left| left.score >= min_score(c));
            if !suffices {
                c.hand_over(views);
            }
            suffices
        });
        let score = |c: &Candidate| c.left.map_or(f64::NEG_INFINITY, |left| left.score);
        let best = (0..open.len()).max_by(|&a, &b| score(&open[a]).total_cmp(&score(&open[b])).then(b.cmp(&a)));
        best.map(|n| open.remove(n))
    }

    /// What is left of a thing: the blocks in which nothing claims it.
    fn left_of<'v>(&'v self, thing: Thing, views: impl Iterator<Item = Option<&'v View>>) -> Option<Tally> {
        let views = self.weighed(views);
        match thing {
            Thing::Plane(_) => Tally::of_plane(views),
            Thing::Place(_) => Tally::of_place(views, self.settings),
        }
    }

    /// Views with their blocks' weights and times.
    fn weighed<'v>(&'v self, views: impl Iterator<Item = Option<&'v View>>) -> impl Iterator<Item = Weighed<'v>> {
        let blocks = self.blocks.iter().zip(&self.weights);
        views
            .zip(blocks)
            .filter_map(|(view, (block, &weight))| Some(Weighed { view: view?, weight, time_ns: block.mid_time_ns }))
    }

    /// What is believed, with what else the blocks say of it.
    fn looked_into<T>(
        &self,
        thing: T,
        left: Tally,
        covariance_m2: Option<DMat3>,
        best: &Candidate,
        open: &[Candidate],
    ) -> Explained<T> {
        let telling = || self.telling(&best.views).map(|(_, view)| view);
        let count = telling().count();
        let sigma_m = covariance_m2.as_ref().map_or(0.0, sigma_m);
        Explained {
            thing,
            score: left.score,
            blocks: left.blocks,
            determined: sigma_m <= self.settings.max_sigma_m,
            sigma_m,
            lasting: lasting(self.weighed(best.views.iter().map(Option::as_ref))),
            drowned: telling().map(View::drowned_by).sum::<f64>() / count.max(1) as f64,
            farthest_m: telling().map(|view| view.range_m).fold(0.0, f64::max),
            uneven: unevenness(telling()),
            silent: 1.0 - count as f64 / left.blocks.max(1) as f64,
            rival: self.rival(best, open) / left.score.max(1e-9),
            aspect: Aspect::of(telling(), covariance_m2.map_or(0.0, |c| c.y_axis.y.sqrt())),
            odds: f64::INFINITY,
            first_ns: left.first_ns,
            last_ns: left.last_ns,
        }
    }

    /// The greatest score of a place elsewhere that would lose most of it to this one; 0 when there is none.
    fn rival(&self, best: &Candidate, open: &[Candidate]) -> f64 {
        let Thing::Place(place) = best.thing else { return 0.0 };
        let claims = self.claims_of(best);
        let after = |candidate: &Candidate| {
            let unclaimed = candidate.views.iter().zip(&claims).map(|(view, claim)| {
                view.as_ref().filter(|v| !claim.is_some_and(|claim| claim.covers(v.range_m, v.cos)))
            });
            self.left_of(candidate.thing, unclaimed).map_or(0.0, |left| left.score)
        };
        let mut greatest = 0.0;
        for candidate in open {
            let (Thing::Place(other), Some(left)) = (candidate.thing, candidate.left) else { continue };
            let may_be = left.score > greatest && other.distance(place) >= RIVAL_M;
            if may_be && after(candidate) < 0.5 * left.score {
                greatest = left.score;
            }
        }
        greatest
    }

    /// What each block says of places that were asked for, and whether something else accounts for it: what is not `left` to them is
    /// claimed.
    pub(super) fn told(&self, places: &[DVec3], left: &[Vec<Option<View>>]) -> Vec<Vec<Option<Told>>> {
        let of_place = |(place, left): (&DVec3, &Vec<Option<View>>)| {
            let of_block = |(said, left): (&Said, &Option<View>)| match (left, said.flatten()) {
                (Some(view), _) => Some(Told { view: *view, is_shadowed: false }),
                (None, Some(view)) => Some(Told { view, is_shadowed: true }),
                (None, None) => None,
            };
            self.memory.said(*place).iter().zip(left).map(of_block).collect()
        };
        places.iter().zip(left).map(of_place).collect()
    }

    /// Views that say something, each with its block.
    fn telling<'v>(&'v self, views: &'v [Option<View>]) -> impl Iterator<Item = (&'a Block, &'v View)> {
        let seen = self.blocks.iter().zip(views).filter_map(|(block, view)| Some((*block, view.as_ref()?)));
        seen.filter(|(_, view)| view.is_telling())
    }

    /// Covariance of a place, m², from what ranges and directions to the sensor's way can tell apart.
    fn covariance_m2(&self, views: &[Option<View>]) -> DMat3 {
        information(DMat3::IDENTITY * 1e-6, self.telling(views)).inverse()
    }

    /// Asks the blocks for places, but where things are claimed already.
    fn ask(&mut self, places: &[DVec3]) {
        let mut memory = std::mem::take(self.memory);
        memory.ask(places, |block, places| self.block_views(block, places));
        *self.memory = memory;
    }

    fn block_views(&self, b: usize, places: &[DVec3]) -> Vec<Said> {
        let (block, claims) = (self.blocks[b], &self.claims[b]);
        let settings = self.block_settings.within(&block.geometry().axis);
        let origin = block.middle.translation;
        let mut said = vec![Some(None); places.len()];
        let (mut seen, mut relative) = (Vec::new(), Vec::new());
        for (n, &place) in places.iter().enumerate() {
            if !settings.sees(&block.middle, self.min_cos, place) {
                continue;
            }
            let (range_m, toward, cos) = sight(block, place);
            if claims.iter().any(|claim| claim.covers(range_m, cos)) {
                said[n] = None;
                continue;
            }
            seen.push((n, range_m, toward));
            relative.push((place - origin).as_vec3().to_array());
        }
        for ((n, range_m, toward), coherence) in seen.into_iter().zip(block.coherence_at_points(&relative)) {
            said[n] = Some(Some(View::new((&block.middle, block.motion), coherence, range_m, toward, self.beam)));
        }
        said
    }
}

impl Candidate {
    /// Gives what the blocks say of it to who asked.
    fn hand_over(&self, views: &mut [Vec<Option<View>>]) {
        if let Some(asked) = self.asked.and_then(|n| views.get_mut(n)) {
            asked.clone_from(&self.views);
        }
    }
}

/// Range of a place, the direction towards it, and that direction's cosine to the sensor's way.
fn sight(block: &Block, place: DVec3) -> (f64, DVec3, f64) {
    let range_m = block.distance_m(place);
    let toward = (place - block.middle.translation) / range_m.max(1e-9);
    (range_m, toward, toward.dot(block.motion))
}

/// Places from this score on are moved uphill before they claim, at most by this much, metres.
const CLIMB_FROM_SCORE: f64 = 5.0;
/// Climbing begins with steps of so many units, voxels, and ends with one.
const CLIMB_UNITS: i32 = 4;
const CLIMB_UNIT: f64 = 0.2;
const CLIMB_REACH_M: f64 = 0.12;
/// Places nearer to each other than this are no rivals: they are the same thing, metres.
const RIVAL_M: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::blocks::BlockBuilder;
    use crate::imaging::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::radar::Beam;

    const STRONG: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const WEAK: DVec3 = DVec3::new(-0.5, -0.2, -1.5);
    const WALL: Plane = Plane { outward: DVec3::NEG_Z, offset_m: 1.9 };

    fn explained(path: impl Fn(f64) -> DVec3, echoes: &[(Echo, f64)], planes: &[Plane], places: &[DVec3]) -> Believed {
        explained_by(path, echoes, |window| window.explain(planes, places))
    }

    fn explained_by(
        path: impl Fn(f64) -> DVec3,
        echoes: &[(Echo, f64)],
        explain: impl Fn(&mut Window) -> Believed,
    ) -> Believed {
        explained_beside(&HandTrail::default(), path, echoes, explain)
    }

    fn explained_beside(
        hands: &HandTrail,
        path: impl Fn(f64) -> DVec3,
        echoes: &[(Echo, f64)],
        explain: impl Fn(&mut Window) -> Believed,
    ) -> Believed {
        let (settings, block_settings) = (ExplainSettings::default(), BlockSettings::default());
        let mut builder = BlockBuilder::new(block_settings);
        let blocks: Vec<_> = sweeps(3.0, path, echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect();
        let mut memory = ViewMemory::default();
        let mut window = Window::new(blocks.iter(), hands, &settings, &block_settings, &Beam::Lensless, &mut memory);
        explain(&mut window)
    }

    #[test]
    fn the_stronger_claims_and_the_weaker_is_still_found() {
        let beside = STRONG + DVec3::new(0.0, 0.03, 0.0);
        let echoes = [(Echo::Point(STRONG), 4.0), (Echo::Point(WEAK), 0.7)];
        let found = explained(winding, &echoes, &[], &[WEAK, beside, STRONG, DVec3::new(0.3, -0.4, -0.8)]).places;
        let things: Vec<_> = found.iter().map(|e| e.thing).collect();
        assert_eq!(things, [STRONG, WEAK], "{found:?}");
        assert!(found.iter().all(|e| e.determined && e.score > 6.0), "{found:?}");
        let alone = on_one_thread(|| explained(winding, &echoes, &[], &[WEAK, STRONG]).places);
        assert_eq!(alone, found);
    }

    #[test]
    fn a_wall_explains_its_mirror_points_and_a_point_is_no_wall() {
        let foot = DVec3::new(0.0, 0.0, -1.9);
        let believed = explained(winding, &[(Echo::Mirror(WALL), 5.0)], &[WALL], &[foot]);
        assert_eq!((believed.planes.len(), believed.places.len()), (1, 0), "{believed:?}");
        let believed = explained(winding, &[(Echo::Point(foot), 2.0)], &[WALL], &[foot]);
        assert_eq!((believed.planes.len(), believed.places.len()), (0, 1), "{believed:?}");
    }

    #[test]
    fn a_wall_between_the_directions_that_are_searched_is_moved_to_where_it_is() {
        let turned = |deg: f64| DVec3::new(deg.to_radians().sin(), 0.0, -deg.to_radians().cos());
        let wall = Plane { outward: turned(3.1), offset_m: 1.9 };
        let searched = Plane { outward: turned(2.4), offset_m: 1.875 };
        let found = explained(winding, &[(Echo::Mirror(wall), 5.0)], &[searched], &[]).planes;
        let off_deg = found[0].thing.outward.dot(wall.outward).acos().to_degrees();
        let off_m = (found[0].thing.distance(DVec3::ZERO) - 1.9).abs();
        assert!(off_deg < 0.5 && off_m < 0.015, "{off_deg}° {off_m} m");
    }

    #[test]
    fn a_point_that_looks_like_a_plane_from_nearly_one_place_is_none() {
        let nearly = |t: f64| 0.4 * winding(t);
        let point = DVec3::new(0.0, 0.0, -1.9);
        for (echo, planes) in [(Echo::Point(point), 0), (Echo::Mirror(WALL), 1)] {
            let wide = explained(winding, &[(echo, 5.0)], &[WALL], &[]);
            let narrow = explained(nearly, &[(echo, 5.0)], &[WALL], &[]);
            assert_eq!((wide.planes.len(), narrow.planes.len()), (planes, 0));
        }
    }

    #[test]
    fn a_known_wall_claims_its_echoes_though_the_head_hardly_moves() {
        let nearly = |t: f64| 0.4 * winding(t);
        let foot = [DVec3::new(0.0, 0.0, -1.9)];
        let echoes = [(Echo::Mirror(WALL), 5.0)];
        let known = explained_by(nearly, &echoes, |window| {
            let walls = window.explain_known(&[WALL], &[]).planes;
            Believed { planes: walls, ..window.explain(&[WALL], &foot) }
        });
        assert!(known.planes.len() == 1 && !known.planes[0].determined && known.places.is_empty(), "{known:?}");
        assert_eq!(explained(nearly, &echoes, &[], &foot).places.len(), 1, "else it passes for a place");
    }

    #[test]
    fn a_tracked_hand_and_its_forearm_are_not_believed_and_what_is_behind_is() {
        let (palm, elbow) = (DVec3::new(0.1, -0.3, -0.5), DVec3::new(0.15, -0.3, -0.3));
        let echoes = [palm, elbow, STRONG].map(|place| (Echo::Point(place), 4.0));
        let believed = |hand: Option<DVec3>| {
            let mut hands = HandTrail::default();
            (0..450).for_each(|n| hands.push(n * 10_000_000, [hand, None], None));
            let explain = |window: &mut Window| window.explain(&[], &[palm, elbow, STRONG]);
            let places = explained_beside(&hands, winding, &echoes, explain).places;
            places.into_iter().map(|place| place.thing).collect::<Vec<_>>()
        };
        assert_eq!((believed(None).len(), believed(Some(palm))), (3, vec![STRONG]));
    }

    #[test]
    fn a_straight_path_determines_no_place() {
        let straight = |t: f64| DVec3::X * (0.1 * t);
        let found = explained(straight, &[(Echo::Point(STRONG), 2.0)], &[], &[STRONG]).places;
        assert!(found[0].score > 6.0 && !found[0].determined, "{found:?}");
    }

    #[test]
    fn what_is_remembered_changes_nothing() {
        let (settings, block_settings) = (ExplainSettings::default(), BlockSettings::default());
        let mut builder = BlockBuilder::new(block_settings);
        let observations = sweeps(2.5, winding, &[(Echo::Point(STRONG), 2.0), (Echo::Point(WEAK), 1.0)], 4);
        let blocks: Vec<_> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        let places = [STRONG, WEAK, DVec3::new(0.3, -0.4, -0.8)];
        let look = |range: std::ops::Range<usize>, memory: &mut ViewMemory, places: &[DVec3]| {
            Window::new(
                blocks[range].iter(),
                &HandTrail::default(),
                &settings,
                &block_settings,
                &Beam::Lensless,
                memory,
            )
            .explain_points(places)
        };
        let mut memory = ViewMemory::default();
        // Blocks come and go, and so do places.
        for (range, places) in [(0..12, &places[..]), (3..15, &places[1..]), (3..18, &places), (9..24, &places)] {
            let found = look(range.clone(), &mut memory, places);
            assert_eq!(found, look(range, &mut ViewMemory::default(), places));
        }
        // Climbing asks for places around those that were given; most of it is remembered from look to look too.
        let fresh = |range: std::ops::Range<usize>, places: &[DVec3]| {
            let mut memory = ViewMemory::default();
            look(range, &mut memory, places);
            memory.computed
        };
        let afresh = fresh(0..12, &places) + fresh(3..15, &places[1..]) + fresh(3..18, &places) + fresh(9..24, &places);
        assert!(memory.computed * 3 < afresh * 2 && memory.computed > 0, "{} of {afresh}", memory.computed);
    }

    #[test]
    fn noise_is_not_believed_and_nothing_comes_of_nothing() {
        let believed = explained(winding, &[], &[WALL], &[STRONG, WEAK]);
        assert!(believed.planes.is_empty() && believed.places.is_empty(), "{believed:?}");
        let (settings, blocks) = (ExplainSettings::default(), BlockSettings::default());
        assert!(
            Window::new(
                [].iter(),
                &HandTrail::default(),
                &settings,
                &blocks,
                &Beam::Lensless,
                &mut ViewMemory::default()
            )
            .explain_points(&[STRONG])
            .is_empty()
        );
    }
}
