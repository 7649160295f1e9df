//! Explaining away: strong things claim what they account for before weak things are believed.
//!
//! Over the last seconds of blocks, planes and places by falling score: each is scored again on the blocks in which nothing
//! stronger claims its range and direction, and if enough is left it claims these itself. A block sees a thing at a range
//! and at a cosine to the sensor's way; both are known as well as pulse and aperture allow, and that is the claim.
//!
//! What a still head or a straight path sees could lie anywhere on a circle around the path, and did, as most ghosts of the
//! first experiments. So a place counts only when its blocks tell it from the rest of the circle, and a plane only when its
//! mirror points have moved; and what is known already claims first, since it is what most of a new circle belongs to.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::Plane;
use crate::imaging::blocks::{Block, BlockSettings, Coherence, MEAN_LOG_OF_NOISE, PlaneAt};
use crate::radar::WAVELENGTH_M;

/// Parameters of explaining away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExplainSettings {
    /// Blocks of this last time are explained, seconds.
    pub window_s: f64,
    /// Score that is left and still counts as a thing.
    pub min_score: f64,
    /// Score of the field from which on a place is looked at.
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
    /// A place is determined when its 1σ is at most this in every direction, metres.
    pub max_sigma_m: f64,
    /// A plane is determined when the feet of its perpendiculars spread by at least this, rms, metres.
    pub min_feet_rms_m: f64,
}

impl Default for ExplainSettings {
    fn default() -> Self {
        Self {
            window_s: 4.0,
            min_score: 2.5,
            min_candidate_score: 2.5,
            max_candidates: 400,
            plane_min_blocks: 13,
            plane_min_score: 12.0,
            claim_range_m: 0.15,
            claim_lobes: 1.5,
            max_sigma_m: 0.2,
            min_feet_rms_m: 0.1,
        }
    }
}

/// A thing that was believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explained<T> {
    /// Plane or place.
    pub thing: T,
    /// A/√B over the blocks that nothing stronger claimed.
    pub score: f64,
    /// Number of these blocks.
    pub blocks: usize,
    /// These blocks tell it from others like it: a place from the rest of its circle, a plane from a point.
    pub determined: bool,
    /// 1σ of a place, all directions together, as far as ranges and directions can tell it from others, metres; 0 of a plane.
    pub sigma_m: f64,
    /// First and last of them, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

/// What a block says of one thing.
#[derive(Debug, Clone, Copy)]
struct View {
    m: f64,
    /// ln(1 + m) less its mean under noise.
    evidence: f64,
    power: f64,
    range_m: f64,
    /// Direction towards it, unit length.
    toward: DVec3,
    /// Cosine of that to the sensor's way.
    cos: f64,
}

/// Range and direction in one block that are accounted for.
#[derive(Debug, Clone, Copy)]
struct Claim {
    range_m: f64,
    half_range_m: f64,
    cos: f64,
    half_cos: f64,
}

/// What blocks said of places, from one look to the next: most candidates and most blocks are the same as the last time.
#[derive(Debug, Default)]
pub struct ViewMemory {
    /// By place: looks since it was last asked for; its views and the blocks that they are of, in time.
    views: BTreeMap<[u64; 3], (u32, Remembered)>,
    /// (place, block) pairs that were looked up, and computed.
    pub remembered: u64,
    /// See `remembered`.
    pub computed: u64,
}

/// Time and subsweep tell a block.
type BlockName = (i64, usize);

/// What blocks said of a place, in time.
type Remembered = Vec<(BlockName, Option<View>)>;

/// A place as a key.
fn key(place: DVec3) -> [u64; 3] {
    place.to_array().map(f64::to_bits)
}

/// The blocks of a window and what is claimed in them.
pub struct Window<'a> {
    blocks: Vec<&'a Block>,
    weights: Vec<f64>,
    /// `[block]`
    claims: Vec<Vec<Claim>>,
    settings: &'a ExplainSettings,
    block_settings: &'a BlockSettings,
    min_cos: f64,
    memory: &'a mut ViewMemory,
    /// What was asked for in this look.
    asked: BTreeMap<[u64; 3], Remembered>,
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
    /// `[block]`
    views: Vec<Option<View>>,
    left: Option<Explained<Thing>>,
}

/// What is believed, each strongest first.
#[derive(Debug, Clone, Default)]
pub struct Believed {
    /// Walls, floor, ceiling; all of them determined.
    pub planes: Vec<Explained<Plane>>,
    /// Places.
    pub places: Vec<Explained<DVec3>>,
}

impl<'a> Window<'a> {
    /// Nothing claimed yet. `blocks` in time; `min_cos`: cosine of the widest angle in the beam.
    pub fn new(
        blocks: impl Iterator<Item = &'a Block>,
        settings: &'a ExplainSettings,
        block_settings: &'a BlockSettings,
        min_cos: f64,
        memory: &'a mut ViewMemory,
    ) -> Self {
        let blocks: Vec<_> = blocks.collect();
        let newest_ns = blocks.last().map_or(0, |b| b.mid_time_ns);
        let age_s = |b: &&Block| (newest_ns - b.mid_time_ns) as f64 * 1e-9;
        let weights = blocks.iter().map(|b| (-age_s(b) / block_settings.memory_s).exp()).collect();
        let (claims, asked) = (vec![Vec::new(); blocks.len()], BTreeMap::new());
        Self { claims, weights, blocks, settings, block_settings, min_cos, memory, asked }
    }

    /// Believes places alone.
    pub fn explain_points(&mut self, candidates: &[DVec3]) -> Vec<Explained<DVec3>> {
        self.explain(&[], candidates).places
    }

    /// Believes planes and places by falling score: what explains the same blocks better wins. Claims of earlier calls hold,
    /// so a call with what is known already gives it precedence.
    pub fn explain(&mut self, planes: &[Plane], places: &[DVec3]) -> Believed {
        let of_planes = planes.par_iter().map(|plane| (Thing::Plane(*plane), self.views_of_plane(plane)));
        let mut open: Vec<(Thing, Vec<Option<View>>)> = of_planes.collect();
        open.extend(places.iter().map(|place| Thing::Place(*place)).zip(self.remembered_views(places)));
        let mut open: Vec<Candidate> = open.into_iter().map(|(thing, views)| self.unclaimed(thing, views)).collect();
        let mut believed = Believed::default();
        while let Some(mut best) = self.take_best(&mut open) {
            self.climb(&mut best);
            let Some(left) = best.left else { continue };
            match best.thing {
                Thing::Plane(plane) => {
                    if self.feet_rms_m(&best.views) < self.settings.min_feet_rms_m {
                        continue;
                    }
                    believed.planes.push(left.of(plane, true, 0.0));
                }
                Thing::Place(place) => {
                    let sigma_m = self.sigma_m(&best.views);
                    believed.places.push(left.of(place, sigma_m <= self.settings.max_sigma_m, sigma_m));
                }
            }
            self.claim(&best, &mut open);
        }
        believed
    }

    /// A candidate with what is claimed already taken out.
    fn unclaimed(&self, thing: Thing, views: Vec<Option<View>>) -> Candidate {
        let mut candidate = Candidate { thing, views, left: None };
        let views = candidate.views.iter_mut().zip(&self.claims);
        views.for_each(|(view, claims)| claims.iter().for_each(|claim| claim.take(view)));
        candidate.left = self.left_of(&candidate);
        candidate
    }

    /// Moves a strong place uphill between the voxels, in ever smaller steps: a claim from beside the maximum would leave
    /// some of the thing unexplained.
    fn climb(&self, candidate: &mut Candidate) {
        let score = |c: &Candidate| c.left.map_or(f64::NEG_INFINITY, |left| left.score);
        let Thing::Place(start) = candidate.thing else { return };
        if score(candidate) < CLIMB_FROM_SCORE {
            return;
        }
        let mut step_m = self.block_settings.voxel_m * 0.8;
        while step_m > self.block_settings.voxel_m * 0.15 {
            let Thing::Place(here) = candidate.thing else { return };
            let around =
                (0..27).filter(|n| *n != 13).map(|n| DVec3::new((n % 3) as f64, (n / 3 % 3) as f64, (n / 9) as f64));
            let around: Vec<DVec3> = around.map(|n| here + (n - 1.0) * step_m).collect();
            let near: Vec<DVec3> = around.into_iter().filter(|p| p.distance(start) <= CLIMB_REACH_M).collect();
            let views = self.views_of_points(&near).into_iter();
            let moved = near.iter().zip(views).map(|(place, views)| self.unclaimed(Thing::Place(*place), views));
            match moved.max_by(|a, b| score(a).total_cmp(&score(b))) {
                Some(best) if score(&best) > score(candidate) => *candidate = best,
                _ => step_m *= 0.5,
            }
        }
    }

    /// The candidate with the greatest score, if that suffices. Claims only take away: what falls short now always will.
    fn take_best(&self, open: &mut Vec<Candidate>) -> Option<Candidate> {
        let min_score = |c: &Candidate| match c.thing {
            Thing::Plane(_) => self.settings.plane_min_score,
            Thing::Place(_) => self.settings.min_score,
        };
        open.retain(|c| c.left.is_some_and(|left| left.score >= min_score(c)));
        let score = |c: &Candidate| c.left.map_or(f64::NEG_INFINITY, |left| left.score);
        let best = (0..open.len()).max_by(|&a, &b| score(&open[a]).total_cmp(&score(&open[b])).then(b.cmp(&a)));
        best.map(|n| open.remove(n))
    }

    /// Claims what a thing accounts for and takes it from the others.
    fn claim(&mut self, best: &Candidate, open: &mut [Candidate]) {
        let claims: Vec<_> = (0..self.blocks.len()).map(|n| best.views[n].map(|v| self.claim_of(n, &v))).collect();
        for candidate in open {
            let seen_before = candidate.views.iter().flatten().count();
            let views = candidate.views.iter_mut().zip(&claims);
            views.for_each(|(view, claim)| claim.iter().for_each(|claim| claim.take(view)));
            if candidate.views.iter().flatten().count() < seen_before {
                candidate.left = self.left_of(candidate);
            }
        }
        self.claims.iter_mut().zip(claims).for_each(|(all, claim)| all.extend(claim));
    }

    /// The score over the blocks in which nothing claims the thing.
    fn left_of(&self, candidate: &Candidate) -> Option<Explained<Thing>> {
        let (mut a, mut b, mut blocks) = (0.0, 0.0, 0);
        let (mut first_ns, mut last_ns) = (i64::MAX, i64::MIN);
        for (n, view) in candidate.views.iter().enumerate() {
            let Some(view) = view else { continue };
            a += self.weights[n] * view.evidence;
            b += self.weights[n] * self.weights[n];
            blocks += 1;
            first_ns = first_ns.min(self.blocks[n].mid_time_ns);
            last_ns = last_ns.max(self.blocks[n].mid_time_ns);
        }
        let (thing, determined, sigma_m) = (candidate.thing, false, 0.0);
        let score = a / b.sqrt();
        (blocks >= MIN_BLOCKS).then_some(Explained { thing, score, blocks, determined, sigma_m, first_ns, last_ns })
    }

    /// Views that say something, each with its block.
    fn telling<'v>(&'v self, views: &'v [Option<View>]) -> impl Iterator<Item = (&'a Block, &'v View)> {
        let seen = self.blocks.iter().zip(views).filter_map(|(block, view)| Some((*block, view.as_ref()?)));
        seen.filter(|(_, view)| view.m >= TELLING_COHERENCE)
    }

    /// 1σ of a place, all directions together, from what ranges and directions to the sensor's way can tell apart.
    fn sigma_m(&self, views: &[Option<View>]) -> f64 {
        let mut information = DMat3::IDENTITY * 1e-6;
        for (block, view) in self.telling(views) {
            let across = (block.motion - view.toward * view.cos) / view.range_m.max(1e-3);
            let range_sigma_m = block.geometry().profile.envelope_fwhm_m() * 0.5;
            let cos_sigma = WAVELENGTH_M / (4.0 * block.aperture_m.max(1e-4));
            information += outer(view.toward) * range_sigma_m.powi(-2) + outer(across) * cos_sigma.powi(-2);
        }
        let covariance = information.inverse();
        (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt()
    }

    /// How far the feet of a plane's perpendiculars spread.
    fn feet_rms_m(&self, views: &[Option<View>]) -> f64 {
        let foot = |(block, view): (&Block, &View)| block.middle.translation + view.toward * view.range_m;
        let count = self.telling(views).count().max(1) as f64;
        let mean = self.telling(views).map(foot).sum::<DVec3>() / count;
        (self.telling(views).map(|seen| foot(seen).distance_squared(mean)).sum::<f64>() / count).sqrt()
    }

    fn claim_of(&self, n: usize, view: &View) -> Claim {
        let block = self.blocks[n];
        let half_width_m = block.geometry().profile.envelope_fwhm_m() * 0.5;
        // As far as the pulse's skirt still stands out of the noise.
        let skirt_m = half_width_m * view.power.max(1.0).log2().sqrt();
        Claim {
            range_m: view.range_m,
            half_range_m: skirt_m.max(self.settings.claim_range_m),
            cos: view.cos,
            half_cos: self.settings.claim_lobes * WAVELENGTH_M / (2.0 * block.aperture_m.max(1e-4)),
        }
    }

    /// `[place][block]`: what is remembered, and the rest computed and remembered.
    fn remembered_views(&mut self, places: &[DVec3]) -> Vec<Vec<Option<View>>> {
        let names: Vec<BlockName> = self.blocks.iter().map(|b| (b.mid_time_ns, b.geometry().subsweep)).collect();
        // `[place][block]`, the outer option for what must be computed.
        let mut known: Vec<Vec<Option<Option<View>>>> = Vec::with_capacity(places.len());
        for &place in places {
            let remembered = self.memory.views.remove(&key(place)).map(|(_, views)| views);
            let mut before = remembered.or_else(|| self.asked.remove(&key(place)));
            let mut before = before.iter_mut().flatten().peekable();
            let mut find = |name: &BlockName| {
                // Both lie in time, and blocks only ever leave at the beginning.
                while before.next_if(|(known, _)| known.0 < name.0).is_some() {}
                before.next_if(|(known, _)| known == name).map(|(_, view)| *view)
            };
            known.push(names.iter().map(&mut find).collect());
        }
        let compute = |b: usize| {
            let missing: Vec<usize> = (0..places.len()).filter(|&n| known[n][b].is_none()).collect();
            let places: Vec<DVec3> = missing.iter().map(|&n| places[n]).collect();
            let views = self.block_views(self.blocks[b], &places);
            missing.into_iter().zip(views).collect::<Vec<_>>()
        };
        let computed: Vec<Vec<(usize, Option<View>)>> = (0..names.len()).into_par_iter().map(compute).collect();
        self.memory.computed += computed.iter().map(Vec::len).sum::<usize>() as u64;
        self.memory.remembered += known.iter().flatten().flatten().count() as u64;
        let mut views: Vec<Vec<Option<View>>> =
            known.into_iter().map(|of_place| of_place.into_iter().map(Option::flatten).collect()).collect();
        for (b, of_block) in computed.into_iter().enumerate() {
            of_block.into_iter().for_each(|(n, view)| views[n][b] = view);
        }
        for (place, views) in places.iter().zip(&views) {
            self.asked.insert(key(*place), names.iter().copied().zip(views.iter().copied()).collect());
        }
        views
    }

    /// `[place][block]`
    fn views_of_points(&self, places: &[DVec3]) -> Vec<Vec<Option<View>>> {
        let by_block: Vec<_> = self.blocks.par_iter().map(|block| self.block_views(block, places)).collect();
        (0..places.len()).map(|n| by_block.iter().map(|views| views[n]).collect()).collect()
    }

    fn block_views(&self, block: &Block, places: &[DVec3]) -> Vec<Option<View>> {
        let origin = block.middle.translation;
        let sees = |n: &usize| self.block_settings.sees(&block.middle, self.min_cos, places[*n]);
        let seen: Vec<usize> = (0..places.len()).filter(sees).collect();
        let relative: Vec<[f32; 3]> = seen.iter().map(|&n| (places[n] - origin).as_vec3().to_array()).collect();
        let mut views = vec![None; places.len()];
        for (&n, coherence) in seen.iter().zip(block.coherence_at_points(&relative)) {
            let range_m = block.distance_m(places[n]);
            let toward = (places[n] - origin) / range_m.max(1e-9);
            views[n] = Some(View::new(block, coherence, range_m, toward));
        }
        views
    }

    fn views_of_plane(&self, plane: &Plane) -> Vec<Option<View>> {
        let view = |block: &&Block| {
            let range_m = plane.distance(block.middle.translation);
            let in_range = range_m >= self.block_settings.min_range_m && range_m <= block.geometry().axis.last_m();
            if !in_range || plane.outward.dot(block.middle.forward()) < self.min_cos {
                return None;
            }
            let toward = plane.outward.as_vec3().to_array();
            let coherence = block.coherence_of_planes(&[PlaneAt { toward, distance_m: range_m as f32 }])[0];
            Some(View::new(block, coherence, range_m, plane.outward))
        };
        self.blocks.iter().map(view).collect()
    }
}

impl<T> Explained<T> {
    fn of<U>(self, thing: U, determined: bool, sigma_m: f64) -> Explained<U> {
        let Self { score, blocks, first_ns, last_ns, .. } = self;
        Explained { thing, score, blocks, determined, sigma_m, first_ns, last_ns }
    }
}

impl View {
    fn new(block: &Block, coherence: Coherence, range_m: f64, toward: DVec3) -> Self {
        let (m, power) = (f64::from(coherence.m), f64::from(coherence.power));
        let evidence = m.ln_1p() - MEAN_LOG_OF_NOISE;
        Self { m, evidence, power, range_m, toward, cos: toward.dot(block.motion) }
    }
}

impl Claim {
    /// Takes a view out that it covers.
    fn take(&self, view: &mut Option<View>) {
        let covers =
            |v: &View| (v.range_m - self.range_m).abs() < self.half_range_m && (v.cos - self.cos).abs() < self.half_cos;
        if view.as_ref().is_some_and(covers) {
            *view = None;
        }
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        let views = &mut self.memory.views;
        views.retain(|_, (looks, _)| {
            *looks += 1;
            *looks <= REMEMBERED_LOOKS
        });
        views.extend(std::mem::take(&mut self.asked).into_iter().map(|(place, views)| (place, (0, views))));
    }
}

/// A place that was not asked for is remembered for so many looks: maxima move to the voxel beside and back again.
const REMEMBERED_LOOKS: u32 = 4;
/// Places from this score on are moved uphill before they claim, at most by this much, metres.
const CLIMB_FROM_SCORE: f64 = 5.0;
const CLIMB_REACH_M: f64 = 0.12;
/// Fewer blocks than this say nothing.
const MIN_BLOCKS: usize = 3;
/// A view of lower m does not say where something is.
const TELLING_COHERENCE: f64 = 3.0;

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

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
        let (settings, block_settings) = (ExplainSettings::default(), BlockSettings::default());
        let mut builder = BlockBuilder::new(block_settings);
        let blocks: Vec<_> = sweeps(3.0, path, echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect();
        let min_cos = block_settings.min_cos(&Beam::Lensless);
        Window::new(blocks.iter(), &settings, &block_settings, min_cos, &mut ViewMemory::default())
            .explain(planes, places)
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
        let min_cos = block_settings.min_cos(&Beam::Lensless);
        let places = [STRONG, WEAK, DVec3::new(0.3, -0.4, -0.8)];
        let look = |range: std::ops::Range<usize>, memory: &mut ViewMemory, places: &[DVec3]| {
            Window::new(blocks[range].iter(), &settings, &block_settings, min_cos, memory).explain_points(places)
        };
        let mut memory = ViewMemory::default();
        // Blocks come and go, and so do places.
        for (range, places) in [(0..12, &places[..]), (3..15, &places[1..]), (3..18, &places), (9..24, &places)] {
            let found = look(range.clone(), &mut memory, places);
            assert_eq!(found, look(range, &mut ViewMemory::default(), places));
        }
        assert_eq!((memory.computed, memory.remembered), (36 + 6 + 6 + 6 + 18, 18 + 33 + 27));
    }

    #[test]
    fn noise_is_not_believed_and_nothing_comes_of_nothing() {
        let believed = explained(winding, &[], &[WALL], &[STRONG, WEAK]);
        assert!(believed.planes.is_empty() && believed.places.is_empty(), "{believed:?}");
        let (settings, blocks) = (ExplainSettings::default(), BlockSettings::default());
        assert!(
            Window::new([].iter(), &settings, &blocks, 0.5, &mut ViewMemory::default())
                .explain_points(&[STRONG])
                .is_empty()
        );
    }
}
