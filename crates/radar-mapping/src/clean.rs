//! Detection by CLEAN: strong returns account for their echoes before weak ones are tested.
//!
//! Input: the sub-apertures of the last seconds (the window) and candidate planes and points. The
//! candidate with the highest score is taken first. It then masks its range and direction in every
//! sub-aperture, and the scores of the other candidates are computed again without the masked
//! responses. This repeats until no candidate scores enough. A sub-aperture measures a range and
//! the cosine between the direction to the object and the sensor's direction of motion. The widths
//! of a mask in these two follow from the pulse length and the aperture.
//!
//! Limits: a sensor at rest or on a straight path measures only a circle around the path, so a
//! point on it could lie anywhere on that circle. Most false detections of the first experiments
//! came from this. A point therefore counts only when its sub-apertures distinguish it from the
//! rest of the circle, and a plane only when the feet of its perpendiculars have moved. What is
//! known already masks first, because most of the echoes on a new circle belong to it.

mod aspect;
mod masks;
mod plane;
mod scoring;

use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::existence::Likelihood;
use super::hands::HandTrail;
use super::responses::{CachedResponse, Response, ResponseCache, information, sigma_m};
pub use aspect::Aspect;
use masks::Mask;
pub(super) use masks::hand_masks;
use radar_sar::Beam;
use radar_sar::geometry::Plane;
use radar_sar::subaperture::{Subaperture, SubapertureSettings};
use radar_sar::{BoundedSettings, SettingBound, bounds, math};
use scoring::{Score, WeightedResponse, amplitude_spread_of, robust_score};

/// Parameters of CLEAN.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CleanSettings {
    /// Length of the window, seconds.
    pub window_s: f64,
    /// Least score of a point detection, computed on its unmasked responses.
    pub min_score: f64,
    /// Least score of a maximum of the field that becomes a candidate. Receiver noise alone reaches
    /// it less than three times an hour in every preset, and it never reaches what confirms
    /// (measured: `lab/examples/room_false_alarms.rs`).
    pub min_candidate_score: f64,
    /// Most candidates per update; the ones with the highest scores are used.
    pub max_candidates: usize,
    /// Least number of sub-apertures that a plane must have been seen in.
    pub plane_min_subapertures: u32,
    /// Least score of a plane detection.
    pub plane_min_score: f64,
    /// Least half-width of a mask in range, metres.
    pub mask_range_m: f64,
    /// Half-width of a mask in cosine, in units of λ/2L, where L is the sub-aperture's aperture.
    pub mask_lobes: f64,
    /// Evidence that a point loses for the squared deviation, in e-folds, of each sub-aperture's
    /// implied reflected power from their mean.
    pub amplitude_spread_cost: f64,
    /// A point is observable when its 1σ, all directions together, is at most this, metres.
    pub max_sigma_m: f64,
    /// A plane is observable when the feet of its perpendiculars spread by at least this, rms,
    /// metres, and `min_over_point` is met too.
    pub min_feet_rms_m: f64,
    /// A plane is observable only when its score exceeds that of the best single point by this.
    pub min_over_point: f64,
}

impl BoundedSettings for CleanSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        window_s: 0.5, 20.0;
        min_score: 0.0, 1e6;
        min_candidate_score: 0.0, 1e6;
        max_candidates: 1.0, 1e4;
        plane_min_subapertures: 1.0, 1e4;
        plane_min_score: 0.0, 1e6;
        mask_range_m: 0.0, 10.0;
        mask_lobes: 0.0, 1e3;
        amplitude_spread_cost: 0.0, 1e6;
        max_sigma_m: 0.01, 10.0;
        min_feet_rms_m: 0.0, 10.0;
        min_over_point: -1e6, 1e6;
    ];
}

impl Default for CleanSettings {
    fn default() -> Self {
        Self {
            window_s: 4.0,
            min_score: 2.5,
            min_candidate_score: 2.5,
            max_candidates: 400,
            plane_min_subapertures: 13,
            plane_min_score: 14.0,
            mask_range_m: 0.15,
            mask_lobes: 1.5,
            amplitude_spread_cost: 1.0,
            max_sigma_m: 0.25,
            min_feet_rms_m: 0.1,
            min_over_point: 2.0,
        }
    }
}

/// A detected plane or point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection<T> {
    /// Estimated plane or point.
    pub estimate: T,
    /// A/√B over the unmasked sub-apertures; for a point, A is reduced by what its uneven strengths
    /// cost.
    pub score: f64,
    /// Number of unmasked sub-apertures.
    pub subapertures: usize,
    /// Observable: a point is distinguishable from the rest of its range circle, a plane from a
    /// point. This holds for these sub-apertures or, once the mapper has queried the history, for
    /// them together with those from before the window.
    pub observable: bool,
    /// For a point: 1σ, all directions together, from ranges and directions, metres. For a plane:
    /// 1σ of its position 1 m beside where it was seen, metres.
    pub sigma_m: f64,
    /// The score without the best `ROBUST_SEGMENT_NS` of the window. An object that is present for
    /// longer than a passing hand, or than an artefact of one movement, keeps most of its score.
    pub robust_score: f64,
    /// Mean of the logarithm of the clutter at its range, relative to noise, over the significant
    /// responses. Artefacts need such clutter.
    pub ln_clutter: f64,
    /// Greatest range among the significant responses, metres.
    pub farthest_m: f64,
    /// Spread of the reflected powers that the significant responses imply, 1σ in e-folds of power.
    pub amplitude_spread: f64,
    /// Share of the unmasked sub-apertures whose response is not significant.
    pub miss_fraction: f64,
    /// The highest score of a point elsewhere that the same echoes would support, relative to its
    /// own score. At 1 the two cannot be distinguished.
    pub ambiguity: f64,
    /// Geometry and strength at which it was seen.
    pub aspect: Aspect,
    /// Log odds that it is a real object and not an artefact; infinite where the classifier was not
    /// asked.
    pub log_odds: f64,
    /// Middle times of the first and last of these sub-apertures, host nanoseconds.
    pub first_ns: i64,
    /// See `first_ns`.
    pub last_ns: i64,
}

/// The sub-apertures of a window and what is masked in each.
pub struct CleanWindow<'a> {
    subapertures: Vec<&'a Subaperture>,
    weights: Vec<f64>,
    /// `[sub-aperture]`
    masks: Vec<Vec<Mask>>,
    settings: &'a CleanSettings,
    subaperture_settings: &'a SubapertureSettings,
    beam: &'a Beam,
    min_cos: f64,
    plane_min_cos: f64,
    cache: &'a mut ResponseCache,
}

/// A candidate's geometry.
#[derive(Debug, Clone, Copy)]
enum Hypothesis {
    Plane(Plane),
    Point(DVec3),
}

/// A candidate and the response of each sub-aperture to it; masked responses are removed.
struct Candidate {
    hypothesis: Hypothesis,
    /// Index of the queried point that it started from.
    query_index: Option<usize>,
    /// `[sub-aperture]`
    responses: Vec<Option<Response>>,
    unmasked: Option<Score>,
}

/// Detected planes and points, each strongest first.
#[derive(Debug, Clone, Default)]
pub struct Detections {
    /// Walls, floor, ceiling. New ones are all observable.
    pub planes: Vec<Detection<Plane>>,
    /// Points.
    pub places: Vec<Detection<DVec3>>,
    /// For each queried point, in the order of the query: its unmasked responses,
    /// `[point][sub-aperture]`.
    pub(super) responses: Vec<Vec<Option<Response>>>,
    /// For each of `places`: the index of the queried point that it was before the hill climb.
    pub(super) query_indices: Vec<usize>,
}

impl<'a> CleanWindow<'a> {
    /// A window in which only the wearer's tracked hands are masked. `subapertures`: in rising time.
    pub fn new(
        subapertures: impl Iterator<Item = &'a Subaperture>,
        hands: &HandTrail,
        settings: &'a CleanSettings,
        subaperture_settings: &'a SubapertureSettings,
        beam: &'a Beam,
        cache: &'a mut ResponseCache,
    ) -> Self {
        let (min_cos, plane_min_cos) = (subaperture_settings.min_cos(beam), subaperture_settings.plane_min_cos(beam));
        let subapertures: Vec<_> = subapertures.collect();
        let newest_ns = subapertures.last().map_or(0, |b| b.mid_time_ns);
        let age_s = |b: &&Subaperture| (newest_ns - b.mid_time_ns) as f64 * 1e-9;
        let weights = subapertures.iter().map(|b| math::exp(-age_s(b) / subaperture_settings.decay_s)).collect();
        cache.begin_update(&subapertures);
        let masks = subapertures.iter().map(|subaperture| hand_masks(subaperture, hands)).collect();
        Self { masks, weights, subapertures, settings, subaperture_settings, beam, min_cos, plane_min_cos, cache }
    }

    /// Detects points alone.
    #[cfg(test)]
    pub fn detect_points(&mut self, candidates: &[DVec3]) -> Vec<Detection<DVec3>> {
        self.detect(&[], candidates).places
    }

    /// Detects planes and points in the order of falling score, so the better explanation of the
    /// same sub-apertures wins. Masks of earlier calls stay, so a first call with what is known
    /// gives it precedence.
    pub fn detect(&mut self, planes: &[Plane], places: &[DVec3]) -> Detections {
        self.detect_with(planes, places, false)
    }

    /// Does the same for known objects. A known plane masks its echoes even when these
    /// sub-apertures cannot distinguish it from a point.
    pub fn detect_known(&mut self, planes: &[Plane], places: &[DVec3]) -> Detections {
        self.detect_with(planes, places, true)
    }

    fn detect_with(&mut self, planes: &[Plane], places: &[DVec3], known: bool) -> Detections {
        self.query(places);
        let of_planes = planes
            .par_iter()
            .map(|plane| self.masked_candidate(Hypothesis::Plane(*plane), self.plane_responses(plane)));
        let mut open: Vec<Candidate> = of_planes.collect();
        let of_places = places.iter().enumerate();
        open.extend(of_places.map(|(n, point)| Candidate { query_index: Some(n), ..self.point_candidate(*point) }));
        let mut detections = Detections { responses: vec![Vec::new(); places.len()], ..Detections::default() };
        while let Some(mut best) = self.take_best(&mut open, &mut detections.responses) {
            match best.hypothesis {
                Hypothesis::Plane(_) => self.hill_climb_plane(&mut best),
                Hypothesis::Point(_) => self.hill_climb(&mut best),
            }
            best.store_responses(&mut detections.responses);
            let Some(unmasked) = best.unmasked else { continue };
            match best.hypothesis {
                Hypothesis::Plane(plane) => {
                    let is_plane = self.is_plane(&best.responses);
                    if !(is_plane || known) {
                        continue;
                    }
                    let seen = self.detection(plane, unmasked, None, &best, &open);
                    let sigma_m = self.plane_sigma_m(&best.responses);
                    detections.planes.push(Detection { observable: is_plane, sigma_m, ..seen });
                }
                Hypothesis::Point(point) => {
                    let covariance_m2 = self.covariance_m2(&best.responses);
                    detections.places.push(self.detection(point, unmasked, Some(covariance_m2), &best, &open));
                    detections.query_indices.extend(best.query_index);
                }
            }
            self.mask(&best, &mut open);
        }
        detections
    }

    /// A candidate without its masked responses.
    fn masked_candidate(&self, hypothesis: Hypothesis, responses: Vec<Option<Response>>) -> Candidate {
        let mut candidate = Candidate { hypothesis, query_index: None, responses, unmasked: None };
        let responses = candidate.responses.iter_mut().zip(&self.masks);
        responses.for_each(|(response, masks)| masks.iter().for_each(|mask| mask.apply(response)));
        candidate.unmasked = self.unmasked_score(candidate.hypothesis, candidate.responses.iter().map(Option::as_ref));
        candidate
    }

    /// The candidate at a queried point.
    fn point_candidate(&self, point: DVec3) -> Candidate {
        let responses = self.cache.cached(point).iter().map(|cached| cached.flatten()).collect();
        self.masked_candidate(Hypothesis::Point(point), responses)
    }

    /// The score of a queried point; −∞ when too few sub-apertures are unmasked.
    fn score_of_point(&self, point: DVec3) -> f64 {
        let unmasked = |(cached, masks): (&'_ CachedResponse, &Vec<Mask>)| -> Option<Response> {
            let is_masked = |v: &Response| masks.iter().any(|mask| mask.covers(v.range_m, v.cos));
            cached.flatten().filter(|response| !is_masked(response))
        };
        let responses: Vec<Option<Response>> = self.cache.cached(point).iter().zip(&self.masks).map(unmasked).collect();
        let unmasked = self.unmasked_score(Hypothesis::Point(point), responses.iter().map(Option::as_ref));
        unmasked.map_or(f64::NEG_INFINITY, |unmasked| unmasked.score)
    }

    /// Moves a strong point uphill between the voxels, in ever smaller steps. A mask beside the
    /// maximum would leave part of the object's echo unmasked. The points lie on a lattice around
    /// the first one, so most of them are in the cache.
    fn hill_climb(&mut self, candidate: &mut Candidate) {
        let (Hypothesis::Point(start), Some(unmasked)) = (candidate.hypothesis, candidate.unmasked) else { return };
        let mut score = unmasked.score;
        if score < CLIMB_FROM_SCORE {
            return;
        }
        let unit_m = self.subaperture_settings.voxel_m * CLIMB_UNIT;
        let point = |at: IVec3| start + at.as_dvec3() * unit_m;
        let (mut here, mut step) = (IVec3::ZERO, CLIMB_UNITS);
        while step > 0 {
            let around = (0..27).filter(|n| *n != 13).map(|n| here + (IVec3::new(n % 3, n / 3 % 3, n / 9) - 1) * step);
            let near: Vec<IVec3> = around.filter(|at| point(*at).distance(start) <= CLIMB_REACH_M).collect();
            self.query(&near.iter().map(|at| point(*at)).collect::<Vec<_>>());
            let scores = near.iter().map(|at| (*at, self.score_of_point(point(*at))));
            match scores.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((at, best)) if best > score => (here, score) = (at, best),
                _ => step /= 2,
            }
        }
        if here != IVec3::ZERO {
            *candidate = Candidate { query_index: candidate.query_index, ..self.point_candidate(point(here)) };
        }
    }

    /// Removes the candidate with the highest score, if that suffices. Masks only remove responses,
    /// so a candidate that falls short now is dropped for good.
    fn take_best(&self, open: &mut Vec<Candidate>, responses: &mut [Vec<Option<Response>>]) -> Option<Candidate> {
        let min_score = |c: &Candidate| match c.hypothesis {
            Hypothesis::Plane(_) => self.settings.plane_min_score,
            Hypothesis::Point(_) => self.settings.min_score,
        };
        open.retain_mut(|c| {
            let suffices = c.unmasked.is_some_and(|unmasked| unmasked.score >= min_score(c));
            if !suffices {
                c.store_responses(responses);
            }
            suffices
        });
        let score = |c: &Candidate| c.unmasked.map_or(f64::NEG_INFINITY, |unmasked| unmasked.score);
        let best = (0..open.len()).max_by(|&a, &b| score(&open[a]).total_cmp(&score(&open[b])).then(b.cmp(&a)));
        best.map(|n| open.remove(n))
    }

    /// Score of a hypothesis over its unmasked responses.
    fn unmasked_score<'v>(
        &'v self,
        hypothesis: Hypothesis,
        responses: impl Iterator<Item = Option<&'v Response>>,
    ) -> Option<Score> {
        let responses = self.weighted(responses);
        match hypothesis {
            Hypothesis::Plane(_) => Score::of_plane(responses),
            Hypothesis::Point(_) => Score::of_point(responses, self.settings),
        }
    }

    /// Responses with the weights and times of their sub-apertures.
    fn weighted<'v>(
        &'v self,
        responses: impl Iterator<Item = Option<&'v Response>>,
    ) -> impl Iterator<Item = WeightedResponse<'v>> {
        let subapertures = self.subapertures.iter().zip(&self.weights);
        responses.zip(subapertures).filter_map(|(response, (subaperture, &weight))| {
            Some(WeightedResponse { response: response?, weight, time_ns: subaperture.mid_time_ns })
        })
    }

    /// The detection of a candidate, with its features.
    fn detection<T>(
        &self,
        estimate: T,
        unmasked: Score,
        covariance_m2: Option<DMat3>,
        best: &Candidate,
        open: &[Candidate],
    ) -> Detection<T> {
        let significant = || self.significant(&best.responses).map(|(_, response)| response);
        let count = significant().count();
        let sigma_m = covariance_m2.as_ref().map_or(0.0, sigma_m);
        Detection {
            estimate,
            score: unmasked.score,
            subapertures: unmasked.subapertures,
            observable: sigma_m <= self.settings.max_sigma_m,
            sigma_m,
            robust_score: robust_score(self.weighted(best.responses.iter().map(Option::as_ref))),
            ln_clutter: significant().map(Response::ln_clutter).sum::<f64>() / count.max(1) as f64,
            farthest_m: significant().map(|response| response.range_m).fold(0.0, f64::max),
            amplitude_spread: amplitude_spread_of(significant()),
            miss_fraction: 1.0 - count as f64 / unmasked.subapertures.max(1) as f64,
            ambiguity: self.ambiguity(best, open) / unmasked.score.max(1e-9),
            aspect: Aspect::of(significant(), covariance_m2.map_or(0.0, |c| c.y_axis.y.sqrt())),
            log_odds: f64::INFINITY,
            first_ns: unmasked.first_ns,
            last_ns: unmasked.last_ns,
        }
    }

    /// The highest score of a point elsewhere that would lose more than half of it to this
    /// candidate's masks; 0 when there is none.
    fn ambiguity(&self, best: &Candidate, open: &[Candidate]) -> f64 {
        let Hypothesis::Point(point) = best.hypothesis else { return 0.0 };
        let masks = self.masks_of(best);
        let after = |candidate: &Candidate| {
            let unmasked = candidate.responses.iter().zip(&masks).map(|(response, mask)| {
                response.as_ref().filter(|v| !mask.is_some_and(|mask| mask.covers(v.range_m, v.cos)))
            });
            self.unmasked_score(candidate.hypothesis, unmasked).map_or(0.0, |unmasked| unmasked.score)
        };
        let mut greatest = 0.0;
        for candidate in open {
            let (Hypothesis::Point(other), Some(unmasked)) = (candidate.hypothesis, candidate.unmasked) else {
                continue;
            };
            let may_be = unmasked.score > greatest && other.distance(point) >= MIN_AMBIGUITY_DISTANCE_M;
            if may_be && after(candidate) < 0.5 * unmasked.score {
                greatest = unmasked.score;
            }
        }
        greatest
    }

    /// Each sub-aperture's response to queried points, and whether it is masked. `unmasked` holds the
    /// unmasked responses.
    pub(super) fn likelihoods(
        &self,
        places: &[DVec3],
        unmasked: &[Vec<Option<Response>>],
    ) -> Vec<Vec<Option<Likelihood>>> {
        let of_point = |(point, unmasked): (&DVec3, &Vec<Option<Response>>)| {
            let of_subaperture =
                |(cached, unmasked): (&CachedResponse, &Option<Response>)| match (unmasked, cached.flatten()) {
                    (Some(response), _) => Some(Likelihood { response: *response, is_masked: false }),
                    (None, Some(response)) => Some(Likelihood { response, is_masked: true }),
                    (None, None) => None,
                };
            self.cache.cached(*point).iter().zip(unmasked).map(of_subaperture).collect()
        };
        places.iter().zip(unmasked).map(of_point).collect()
    }

    /// Significant responses, each with its sub-aperture.
    fn significant<'v>(
        &'v self,
        responses: &'v [Option<Response>],
    ) -> impl Iterator<Item = (&'a Subaperture, &'v Response)> {
        let seen = self
            .subapertures
            .iter()
            .zip(responses)
            .filter_map(|(subaperture, response)| Some((*subaperture, response.as_ref()?)));
        seen.filter(|(_, response)| response.is_significant())
    }

    /// Covariance of a point, m², from ranges and from directions relative to the sensor's motion.
    fn covariance_m2(&self, responses: &[Option<Response>]) -> DMat3 {
        information(DMat3::IDENTITY * 1e-6, self.significant(responses)).inverse()
    }

    /// Queries the sub-apertures for points; masked points count as not queried.
    fn query(&mut self, places: &[DVec3]) {
        let mut cache = std::mem::take(self.cache);
        cache.query(places, |subaperture, places| self.subaperture_responses(subaperture, places));
        *self.cache = cache;
    }

    fn subaperture_responses(&self, b: usize, places: &[DVec3]) -> Vec<CachedResponse> {
        let (subaperture, masks) = (self.subapertures[b], &self.masks[b]);
        let settings = self.subaperture_settings.within(&subaperture.geometry().axis);
        let origin = subaperture.middle.translation;
        let mut cached = vec![Some(None); places.len()];
        let (mut seen, mut relative) = (Vec::new(), Vec::new());
        for (n, &point) in places.iter().enumerate() {
            if !settings.sees(&subaperture.middle, self.min_cos, point) {
                continue;
            }
            let (range_m, toward, cos) = range_and_direction(subaperture, point);
            if masks.iter().any(|mask| mask.covers(range_m, cos)) {
                cached[n] = None;
                continue;
            }
            seen.push((n, range_m, toward));
            relative.push((point - origin).as_vec3().to_array());
        }
        for ((n, range_m, toward), coherence) in seen.into_iter().zip(subaperture.coherence_at_points(&relative)) {
            cached[n] = Some(Some(Response::new(
                (&subaperture.middle, subaperture.motion),
                coherence,
                range_m,
                toward,
                self.beam,
            )));
        }
        cached
    }
}

impl Candidate {
    /// Stores its responses for the caller.
    fn store_responses(&self, responses: &mut [Vec<Option<Response>>]) {
        if let Some(query_index) = self.query_index.and_then(|n| responses.get_mut(n)) {
            query_index.clone_from(&self.responses);
        }
    }
}

/// Range of a point, the direction towards it, and the cosine of that direction to the sensor's
/// motion.
fn range_and_direction(subaperture: &Subaperture, point: DVec3) -> (f64, DVec3, f64) {
    let range_m = subaperture.distance_m(point);
    let toward = (point - subaperture.middle.translation) / range_m.max(1e-9);
    (range_m, toward, toward.dot(subaperture.motion))
}

/// Points with at least this score are moved uphill before they mask. `CLIMB_REACH_M` is the
/// greatest displacement, metres. Choice: weaker points mask little, and each climb queries dozens
/// of points; farther away than two voxels is another maximum.
const CLIMB_FROM_SCORE: f64 = 5.0;
/// First step of the hill climb in units of `CLIMB_UNIT`, which is in voxels. The last step is one
/// unit. Choice: from a voxel of 5 cm down to 1 cm, the fine field's voxel.
const CLIMB_UNITS: i32 = 4;
const CLIMB_UNIT: f64 = 0.2;
const CLIMB_REACH_M: f64 = 0.12;
/// Points closer than this are the same object and so not ambiguous, metres. Choice: twice the
/// pulse's width; parts of one object live on the same echoes.
const MIN_AMBIGUITY_DISTANCE_M: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::Beam;
    use radar_sar::subaperture::SubapertureBuilder;
    use radar_sar::test_data::{Echo, on_one_thread, sweeps, winding};

    const STRONG: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const WEAK: DVec3 = DVec3::new(-0.5, -0.2, -1.5);
    const WALL: Plane = Plane { outward: DVec3::NEG_Z, offset_m: 1.9 };

    fn detected(path: impl Fn(f64) -> DVec3, echoes: &[(Echo, f64)], planes: &[Plane], places: &[DVec3]) -> Detections {
        detected_by(path, echoes, |window| window.detect(planes, places))
    }

    fn detected_by(
        path: impl Fn(f64) -> DVec3,
        echoes: &[(Echo, f64)],
        explain: impl Fn(&mut CleanWindow) -> Detections,
    ) -> Detections {
        detected_with_hands(&HandTrail::default(), path, echoes, explain)
    }

    fn detected_with_hands(
        hands: &HandTrail,
        path: impl Fn(f64) -> DVec3,
        echoes: &[(Echo, f64)],
        explain: impl Fn(&mut CleanWindow) -> Detections,
    ) -> Detections {
        let (settings, subaperture_settings) = (CleanSettings::default(), SubapertureSettings::default());
        let mut builder = SubapertureBuilder::new(subaperture_settings);
        let subapertures: Vec<_> = sweeps(3.0, path, echoes, 3).into_iter().filter_map(|o| builder.push(o)).collect();
        let mut cache = ResponseCache::default();
        let mut window =
            CleanWindow::new(subapertures.iter(), hands, &settings, &subaperture_settings, &Beam::Lensless, &mut cache);
        explain(&mut window)
    }

    #[test]
    fn weak_point_is_found_beside_strong_one() {
        let beside = STRONG + DVec3::new(0.0, 0.03, 0.0);
        let echoes = [(Echo::Point(STRONG), 4.0), (Echo::Point(WEAK), 0.7)];
        let found = detected(winding, &echoes, &[], &[WEAK, beside, STRONG, DVec3::new(0.3, -0.4, -0.8)]).places;
        let estimates: Vec<_> = found.iter().map(|e| e.estimate).collect();
        assert_eq!(estimates, [STRONG, WEAK], "{found:?}");
        assert!(found.iter().all(|e| e.observable && e.score > 6.0), "{found:?}");
        let alone = on_one_thread(|| detected(winding, &echoes, &[], &[WEAK, STRONG]).places);
        assert_eq!(alone, found);
    }

    #[test]
    fn wall_masks_its_foot_points_and_point_is_not_a_wall() {
        let foot = DVec3::new(0.0, 0.0, -1.9);
        let detections = detected(winding, &[(Echo::Plane(WALL), 5.0)], &[WALL], &[foot]);
        assert_eq!((detections.planes.len(), detections.places.len()), (1, 0), "{detections:?}");
        let detections = detected(winding, &[(Echo::Point(foot), 2.0)], &[WALL], &[foot]);
        assert_eq!((detections.planes.len(), detections.places.len()), (0, 1), "{detections:?}");
    }

    #[test]
    fn wall_between_search_directions_is_refined() {
        let turned = |deg: f64| DVec3::new(deg.to_radians().sin(), 0.0, -deg.to_radians().cos());
        let wall = Plane { outward: turned(3.1), offset_m: 1.9 };
        let searched = Plane { outward: turned(2.4), offset_m: 1.875 };
        let found = detected(winding, &[(Echo::Plane(wall), 5.0)], &[searched], &[]).planes;
        let off_deg = found[0].estimate.outward.dot(wall.outward).acos().to_degrees();
        let off_m = (found[0].estimate.distance(DVec3::ZERO) - 1.9).abs();
        assert!(off_deg < 0.5 && off_m < 0.015, "{off_deg}° {off_m} m");
    }

    #[test]
    fn plane_needs_wide_foot_spread() {
        let nearly = |t: f64| 0.4 * winding(t);
        let point = DVec3::new(0.0, 0.0, -1.9);
        for (echo, planes) in [(Echo::Point(point), 0), (Echo::Plane(WALL), 1)] {
            let wide = detected(winding, &[(echo, 5.0)], &[WALL], &[]);
            let narrow = detected(nearly, &[(echo, 5.0)], &[WALL], &[]);
            assert_eq!((wide.planes.len(), narrow.planes.len()), (planes, 0));
        }
    }

    #[test]
    fn known_wall_masks_its_echoes_with_small_motion() {
        let nearly = |t: f64| 0.4 * winding(t);
        let foot = [DVec3::new(0.0, 0.0, -1.9)];
        let echoes = [(Echo::Plane(WALL), 5.0)];
        let known = detected_by(nearly, &echoes, |window| {
            let walls = window.detect_known(&[WALL], &[]).planes;
            Detections { planes: walls, ..window.detect(&[WALL], &foot) }
        });
        assert!(known.planes.len() == 1 && !known.planes[0].observable && known.places.is_empty(), "{known:?}");
        assert_eq!(
            detected(nearly, &echoes, &[], &foot).places.len(),
            1,
            "without the known wall it is detected as a point"
        );
    }

    #[test]
    fn tracked_hand_and_forearm_are_masked_and_object_behind_is_found() {
        let (palm, elbow) = (DVec3::new(0.1, -0.3, -0.5), DVec3::new(0.15, -0.3, -0.3));
        let echoes = [palm, elbow, STRONG].map(|point| (Echo::Point(point), 4.0));
        let detections = |hand: Option<DVec3>| {
            let mut hands = HandTrail::default();
            (0..450).for_each(|n| hands.push(n * 10_000_000, [hand, None], None));
            let explain = |window: &mut CleanWindow| window.detect(&[], &[palm, elbow, STRONG]);
            let places = detected_with_hands(&hands, winding, &echoes, explain).places;
            places.into_iter().map(|point| point.estimate).collect::<Vec<_>>()
        };
        assert_eq!((detections(None).len(), detections(Some(palm))), (3, vec![STRONG]));
    }

    #[test]
    fn straight_path_leaves_point_unobservable() {
        let straight = |t: f64| DVec3::X * (0.1 * t);
        let found = detected(straight, &[(Echo::Point(STRONG), 2.0)], &[], &[STRONG]).places;
        assert!(found[0].score > 6.0 && !found[0].observable, "{found:?}");
    }

    #[test]
    fn response_cache_does_not_change_results() {
        let (settings, subaperture_settings) = (CleanSettings::default(), SubapertureSettings::default());
        let mut builder = SubapertureBuilder::new(subaperture_settings);
        let observations = sweeps(2.5, winding, &[(Echo::Point(STRONG), 2.0), (Echo::Point(WEAK), 1.0)], 4);
        let subapertures: Vec<_> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        let places = [STRONG, WEAK, DVec3::new(0.3, -0.4, -0.8)];
        let detect_in = |range: std::ops::Range<usize>, cache: &mut ResponseCache, places: &[DVec3]| {
            CleanWindow::new(
                subapertures[range].iter(),
                &HandTrail::default(),
                &settings,
                &subaperture_settings,
                &Beam::Lensless,
                cache,
            )
            .detect_points(places)
        };
        let mut cache = ResponseCache::default();
        // Sub-apertures and points both come and go.
        for (range, places) in [(0..12, &places[..]), (3..15, &places[1..]), (3..18, &places), (9..24, &places)] {
            let found = detect_in(range.clone(), &mut cache, places);
            assert_eq!(found, detect_in(range, &mut ResponseCache::default(), places));
        }
        // The hill climb queries points around those given; most of them stay cached between
        // updates.
        let fresh = |range: std::ops::Range<usize>, places: &[DVec3]| {
            let mut cache = ResponseCache::default();
            detect_in(range, &mut cache, places);
            cache.misses
        };
        let afresh = fresh(0..12, &places) + fresh(3..15, &places[1..]) + fresh(3..18, &places) + fresh(9..24, &places);
        assert!(cache.misses * 3 < afresh * 2 && cache.misses > 0, "{} of {afresh}", cache.misses);
    }

    #[test]
    fn noise_and_empty_window_give_no_detections() {
        let detections = detected(winding, &[], &[WALL], &[STRONG, WEAK]);
        assert!(detections.planes.is_empty() && detections.places.is_empty(), "{detections:?}");
        let (settings, subapertures) = (CleanSettings::default(), SubapertureSettings::default());
        assert!(
            CleanWindow::new(
                [].iter(),
                &HandTrail::default(),
                &settings,
                &subapertures,
                &Beam::Lensless,
                &mut ResponseCache::default()
            )
            .detect_points(&[STRONG])
            .is_empty()
        );
    }
}
