//! Points: cached responses, and the hill climb between the voxels.

use std::collections::BTreeSet;

use glam::{DVec3, IVec3};

use super::candidate::{Candidate, Hypothesis};
use super::query::SubapertureQuery;
use super::residual::Residual;
use crate::existence::Likelihood;
use crate::responses::{CachedResponse, Response, ResponseCache};

/// Points with at least this score are moved uphill before they mask. `CLIMB_REACH_M` is the
/// greatest displacement, metres. Choice: weaker points mask little, and each climb queries dozens
/// of points; farther away than two voxels is another maximum.
const CLIMB_FROM_SCORE: f64 = 5.0;
/// First step of the hill climb in units of `CLIMB_UNIT_M`, metres. The last step is one unit. Choice: from
/// half a coarse voxel down to the fine field's voxel.
const CLIMB_UNITS: i32 = 4;
const CLIMB_UNIT_M: f64 = 0.01;
const CLIMB_REACH_M: f64 = 0.12;

/// Finds the responses to points: those of the updates before, and what it queries.
pub(super) struct PointSearch<'a> {
    query: SubapertureQuery<'a>,
    cache: &'a mut ResponseCache,
}

impl<'a> PointSearch<'a> {
    /// `cache`: already at this update.
    pub fn new(query: SubapertureQuery<'a>, cache: &'a mut ResponseCache) -> Self {
        Self { query, cache }
    }

    /// Queries the sub-apertures for points; masked points count as not queried.
    pub fn query(&mut self, places: &[DVec3], residual: &Residual) {
        let (query, subapertures, masks) = (self.query, residual.subapertures.all(), residual.masks());
        self.cache.query(places, |n, places| query.points(subapertures[n], masks.of(n), places));
    }

    /// The candidate at a queried point.
    pub fn candidate(&self, place: DVec3, residual: &Residual) -> Candidate {
        let responses = self.cache.cached(place).map(|cached| cached.flatten()).collect();
        residual.candidate(Hypothesis::Point(place), responses)
    }

    /// The score of a queried point; −∞ when too few sub-apertures are unmasked.
    fn score(&self, place: DVec3, residual: &Residual) -> f64 {
        let each = self.cache.cached(place).zip(residual.masks().iter());
        let unmasked = each.map(|(cached, masks)| {
            let response = cached.as_ref()?.as_ref()?;
            (!masks.iter().any(|mask| mask.covers(response.range_m, response.cos))).then_some(response)
        });
        let unmasked = residual.score(unmasked);
        unmasked.map_or(f64::NEG_INFINITY, |unmasked| unmasked.score)
    }

    /// Moves a strong point uphill between the voxels, in ever smaller steps. A mask beside the
    /// maximum would leave part of the object's echo unmasked. The points lie on a lattice around
    /// the first one, so most of them are in the cache.
    pub fn hill_climb(&mut self, candidate: &mut Candidate, residual: &Residual) {
        let (Hypothesis::Point(start), Some(unmasked)) = (candidate.hypothesis, candidate.unmasked) else { return };
        let mut score = unmasked.score;
        if score < CLIMB_FROM_SCORE {
            return;
        }
        let place = |at: IVec3| start + at.as_dvec3() * CLIMB_UNIT_M;
        let (mut here, mut step) = (IVec3::ZERO, CLIMB_UNITS);
        // `here` is the best point visited, so none of the others can be the next.
        let mut visited = BTreeSet::from([here.to_array()]);
        while step > 0 {
            let around = (0..27).map(|n| here + (IVec3::new(n % 3, n / 3 % 3, n / 9) - 1) * step);
            let within = around.filter(|at| place(*at).distance(start) <= CLIMB_REACH_M);
            let near: Vec<IVec3> = within.filter(|at| visited.insert(at.to_array())).collect();
            self.query(&near.iter().map(|at| place(*at)).collect::<Vec<_>>(), residual);
            let scores = near.iter().map(|at| (*at, self.score(place(*at), residual)));
            match scores.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((at, best)) if best > score => (here, score) = (at, best),
                _ => step /= 2,
            }
        }
        if here != IVec3::ZERO {
            *candidate = Candidate { query_index: candidate.query_index, ..self.candidate(place(here), residual) };
        }
    }

    /// Each sub-aperture's response to queried points, and whether it is masked. `unmasked` holds
    /// the unmasked responses.
    pub fn likelihoods(&self, places: &[DVec3], unmasked: &[Vec<Option<Response>>]) -> Vec<Vec<Option<Likelihood>>> {
        let of_point = |(place, unmasked): (&DVec3, &Vec<Option<Response>>)| {
            let of_one = |(cached, unmasked): (&CachedResponse, &Option<Response>)| match (unmasked, cached.flatten()) {
                (Some(response), _) => Some(Likelihood { response: *response, is_masked: false }),
                (None, Some(response)) => Some(Likelihood { response, is_masked: true }),
                (None, None) => None,
            };
            self.cache.cached(*place).zip(unmasked).map(of_one).collect()
        };
        places.iter().zip(unmasked).map(of_point).collect()
    }
}
