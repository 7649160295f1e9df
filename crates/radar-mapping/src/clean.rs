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
mod candidate;
mod detection;
mod masks;
mod plane;
mod points;
mod query;
mod residual;
mod scoring;
mod subapertures;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::existence::Likelihood;
use super::hands::HandTrail;
use super::responses::{Response, ResponseCache};
pub use aspect::Aspect;
use candidate::{Candidate, Hypothesis, take_best};
pub use detection::Detection;
use detection::covariance_m2;
pub(super) use masks::hand_masks;
use points::PointSearch;
pub(crate) use query::SubapertureQuery;
use radar_sar::geometry::Plane;
use radar_sar::subaperture::Subaperture;
use radar_sar::{BoundedSettings, SettingBound, bounds};
use residual::Residual;
use subapertures::WeightedSubapertures;

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
    /// A point is observable when its 1σ, all directions together, is at most this, metres.
    pub max_sigma_m: f64,
    /// A plane is observable when the feet of its perpendiculars spread by at least this, rms,
    /// metres, and `min_over_point` is met too.
    pub min_feet_rms_m: f64,
    /// A plane is observable only when its score exceeds that of the best single point by this.
    pub min_over_point: f64,
}

/// At the end of each interval that makes mapping hardest, as far as the other settings allow it, a furnished room gives obstacles and walls (`tests/program/settings_file.rs`).
impl BoundedSettings for CleanSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        window_s: 0.5, 20.0;
        min_score: 0.0, 15.0;
        min_candidate_score: 0.0, 15.0;
        max_candidates: 10.0, 1e4;
        plane_min_subapertures: 1.0, 1e4;
        plane_min_score: 0.0, 20.0;
        mask_range_m: 0.0, 10.0;
        mask_lobes: 0.0, 1e3;
        max_sigma_m: 0.05, 10.0;
        min_feet_rms_m: 0.0, 0.3;
        min_over_point: -1e6, 6.0;
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
            max_sigma_m: 0.25,
            min_feet_rms_m: 0.1,
            min_over_point: 2.0,
        }
    }
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

/// CLEAN over the sub-apertures of a window.
pub struct CleanWindow<'a> {
    residual: Residual<'a>,
    query: SubapertureQuery<'a>,
    points: PointSearch<'a>,
}

impl<'a> CleanWindow<'a> {
    /// A window in which only the wearer's tracked hands are masked. `subapertures`: in rising
    /// time.
    pub fn new(
        subapertures: impl Iterator<Item = &'a Subaperture>,
        hands: &HandTrail,
        settings: &'a CleanSettings,
        query: SubapertureQuery<'a>,
        cache: &'a mut ResponseCache,
    ) -> Self {
        let subapertures = WeightedSubapertures::new(subapertures, query.decay_s());
        cache.begin_update(subapertures.all());
        let residual = Residual::new(subapertures, hands, settings);
        Self { residual, query, points: PointSearch::new(query, cache) }
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
        let Self { residual, query, points } = self;
        let settings = residual.settings;
        let mut open = candidates(planes, places, *query, points, residual);
        let mut detections = Detections { responses: vec![Vec::new(); places.len()], ..Detections::default() };
        while let Some(mut best) = take_best(&mut open, settings, &mut detections.responses) {
            match best.hypothesis {
                Hypothesis::Plane(_) => plane::hill_climb(&mut best, *query, residual),
                Hypothesis::Point(_) => points.hill_climb(&mut best, residual),
            }
            best.store_responses(&mut detections.responses);
            let Some(unmasked) = best.unmasked else { continue };
            match best.hypothesis {
                Hypothesis::Plane(plane) => {
                    let is_plane = plane::is_plane(&residual.subapertures, &best.responses, settings);
                    if !(is_plane || known) {
                        continue;
                    }
                    let seen = Detection::new(plane, unmasked, None, &best, &open, residual);
                    let sigma_m = plane::sigma_m(&residual.subapertures, &best.responses);
                    detections.planes.push(Detection { observable: is_plane, sigma_m, ..seen });
                }
                Hypothesis::Point(place) => {
                    let covariance_m2 = covariance_m2(&best.responses, residual);
                    detections.places.push(Detection::new(
                        place,
                        unmasked,
                        Some(covariance_m2),
                        &best,
                        &open,
                        residual,
                    ));
                    detections.query_indices.extend(best.query_index);
                }
            }
            residual.subtract(&best, &mut open);
        }
        detections
    }

    /// Each sub-aperture's response to queried points, and whether it is masked. `unmasked` holds the
    /// unmasked responses.
    pub(super) fn likelihoods(
        &self,
        places: &[DVec3],
        unmasked: &[Vec<Option<Response>>],
    ) -> Vec<Vec<Option<Likelihood>>> {
        self.points.likelihoods(places, unmasked)
    }
}

/// The candidates at planes and points, with what is not masked yet.
fn candidates(
    planes: &[Plane],
    places: &[DVec3],
    query: SubapertureQuery,
    points: &mut PointSearch,
    residual: &Residual,
) -> Vec<Candidate> {
    points.query(places, residual);
    let of_planes = planes.par_iter().map(|plane| plane::candidate(*plane, query, residual));
    let mut open: Vec<Candidate> = of_planes.collect();
    let of_places = places.iter().enumerate();
    open.extend(of_places.map(|(n, place)| Candidate { query_index: Some(n), ..points.candidate(*place, residual) }));
    open
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::Beam;
    use radar_sar::subaperture::{SubapertureBuilder, SubapertureSettings};
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
        let query = SubapertureQuery::of(&subaperture_settings, &Beam::Lensless);
        let mut window = CleanWindow::new(subapertures.iter(), hands, &settings, query, &mut cache);
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
                SubapertureQuery::of(&subaperture_settings, &Beam::Lensless),
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
                SubapertureQuery::of(&subapertures, &Beam::Lensless),
                &mut ResponseCache::default()
            )
            .detect_points(&[STRONG])
            .is_empty()
        );
    }
}
