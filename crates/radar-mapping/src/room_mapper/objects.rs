//! The objects of the map: tracks with their existence and their refined positions.
//!
//! Tracks near each other are one obstacle, with the shapes of all.

use std::collections::{BTreeMap, HashSet};

use glam::{DMat3, DVec3};
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::Subaperture;

use super::imaging::Imaging;
use super::shapes::{CELL_M, Shape, by_falling_score, cell_of, center_of};
use super::window::Window;
use crate::calibration_control::CalibrationChange;
use crate::existence::{Existence, Likelihood};
use crate::{
    Detection, ExistenceSettings, Observed, Obstacle, SavedMap, SavedPoint, Track, TrackList, TrackSettings, same_point,
};

/// Tracks nearer to each other than this are one obstacle, metres. Choice: legs of one chair are
/// about 0.4 m apart and parts between them reflect as well; wider clusters join an obstacle to its
/// neighbour.
const CLUSTER_M: f64 = 0.30;
/// Objects this near to each other horizontally may be of one piece, metres; one that was seen
/// within this time before the other turned out to be gone is not weakened, nanoseconds. Choice:
/// the width of a chair, which is carried away whole; its parts are seen within a second of each
/// other as the head turns.
const LATERAL_M: f64 = 0.6;
const RECENT_SUPPORT_NS: i64 = 1_000_000_000;

/// A time offset that was wrong displaced what was seen by this speed times its error, m/s. Choice: a head that looks around.
const TYPICAL_SPEED_M_PER_S: f64 = 0.5;
/// Most cells of all restored shapes together; a full map keeps four of each point. Choice: whole shapes of 160 points. The work
/// of each frame's warnings grows with the cells within reach. These take some 0.2 ms, those of a full map take 7 ms, and 13 ms when
/// the scene changes (measured).
const MAX_RESTORED_CELLS: usize = 8000;

/// The refined position of a track.
#[derive(Debug, Clone)]
pub(super) struct RefinedPoint {
    pub position_m: DVec3,
    pub covariance_m2: DMat3,
    pub shape: Shape,
}

/// Objects that an update found gone.
#[derive(Debug)]
pub(super) struct Removed {
    /// How many.
    pub count: u64,
    /// Where they were.
    pub positions_m: Vec<DVec3>,
    /// Positions of those that were established.
    pub established_m: Vec<DVec3>,
}

/// Point tracks and what is known of each.
#[derive(Debug, Default)]
pub(super) struct ObjectMap {
    tracks: TrackList<DVec3>,
    /// By confirmed track: whether it still exists.
    existences: BTreeMap<u64, Existence>,
    /// By track: its refined position and the quality that it was refined at.
    refined: BTreeMap<u64, (f64, RefinedPoint)>,
}

/// The responses of sub-apertures that have a point in their beam.
pub(super) fn with_subaperture<'b>(
    window: &'b Window,
    likelihoods: impl Iterator<Item = Option<Likelihood>> + 'b,
) -> impl Iterator<Item = (&'b Subaperture, Likelihood)> {
    window.iter().zip(likelihoods).filter_map(|(subaperture, likelihood)| Some((subaperture, likelihood?)))
}

impl ObjectMap {
    /// Confirmed tracks.
    pub fn confirmed(&self) -> impl Iterator<Item = &Track<DVec3>> {
        self.tracks.confirmed()
    }

    /// Greatest strength that an object showed to any side, if it is known.
    pub fn greatest_strength(&self, id: u64) -> Option<f64> {
        self.existences.get(&id).map(Existence::greatest_strength)
    }

    /// Updates the tracks with an update's detections; returns how many of these counted as hits.
    pub fn update(&mut self, points: &[Detection<DVec3>], settings: &TrackSettings) -> usize {
        self.tracks.update(points, settings, same_point(settings.match_m));
        // Objects that exist with certainty are no longer provisional.
        let (enough, existences) = (settings.existence.confirm_log_odds, &self.existences);
        self.tracks.confirm_provisional(|id| existences.get(&id).is_some_and(|e| e.log_odds() >= enough));
        points.iter().filter(|point| settings.is_hit(point)).count()
    }

    /// Removes known objects that no longer exist, by the sub-apertures' responses to each. `is_established`: of a position,
    /// whether something was detected there again in a later window.
    pub fn update_existence(
        &mut self,
        ids: &[u64],
        likelihoods: &[Vec<Option<Likelihood>>],
        window: &Window,
        is_established: impl Fn(DVec3) -> bool,
        settings: &ExistenceSettings,
    ) -> Removed {
        for (&id, likelihoods) in ids.iter().zip(likelihoods) {
            let Some(known) = self.tracks.confirmed().find(|known| known.id == id) else { continue };
            let is_new = !self.existences.contains_key(&id);
            let existence = self.existences.entry(id).or_insert_with(Existence::new);
            if is_established(known.estimate) {
                existence.establish();
            }
            existence.update(with_subaperture(window, likelihoods.iter().copied()), settings);
            if is_new {
                existence.limit_initial_log_odds(settings.initial_share * known.log_odds);
            }
        }
        let gone: Vec<u64> = self.existences.iter().filter(|(_, e)| e.log_odds() <= 0.0).map(|(id, _)| *id).collect();
        let mut removed = Removed { count: gone.len() as u64, positions_m: Vec::new(), established_m: Vec::new() };
        let now_ns = window.now_ns();
        for known in self.tracks.confirmed().filter(|known| gone.contains(&known.id)) {
            removed.positions_m.push(known.estimate);
            if self.existences.get(&known.id).is_some_and(Existence::is_established) {
                removed.established_m.push(known.estimate);
            }
            if !self.existences.get(&known.id).is_some_and(Existence::reached_max_log_odds) {
                continue;
            }
            let is_beside = |other: &&Track<DVec3>| (other.estimate - known.estimate).with_y(0.0).length() <= LATERAL_M;
            for other in self.tracks.confirmed().filter(is_beside) {
                if let Some(existence) = self.existences.get_mut(&other.id) {
                    existence.weaken(now_ns.saturating_sub(RECENT_SUPPORT_NS), settings);
                }
            }
        }
        self.tracks.retain(|point| !gone.contains(&point.id));
        for id in gone {
            self.existences.remove(&id);
            self.refined.remove(&id);
        }
        removed
    }

    /// Confirmed tracks whose quality has improved since they were refined.
    pub fn stale(&self) -> Vec<Track<DVec3>> {
        let is_stale =
            |track: &&Track<DVec3>| self.refined.get(&track.id).is_none_or(|(quality, _)| *quality < track.quality);
        self.tracks.confirmed().filter(is_stale).cloned().collect()
    }

    /// Stores the refined position of a track.
    pub fn set_refined(&mut self, track: &Track<DVec3>, refined: RefinedPoint) {
        self.refined.insert(track.id, (track.quality, refined));
    }

    /// The refined position of a track, or a coarse one if it was not refined.
    fn refined_point_of(&self, track: &Track<DVec3>, imaging: &Imaging) -> RefinedPoint {
        let unrefined = || RefinedPoint {
            position_m: track.estimate,
            covariance_m2: DMat3::from_diagonal(DVec3::splat(imaging.voxel_m().powi(2))),
            shape: imaging.coarse_shape(track.estimate, track.score),
        };
        self.refined.get(&track.id).map_or_else(unrefined, |(_, point)| point.clone())
    }

    /// Confirmed obstacles, by falling evidence. Tracks near each other belong to one obstacle,
    /// which has the position of the strongest. Those that `is_hidden` holds for account for their echoes and are no
    /// obstacles.
    pub fn obstacles(&self, imaging: &Imaging, is_hidden: impl Fn(DVec3) -> bool) -> Vec<Obstacle> {
        let mut tracks: Vec<_> = self.tracks.confirmed().filter(|track| !is_hidden(track.estimate)).collect();
        tracks.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
        let mut obstacles: Vec<Obstacle> = Vec::new();
        for track in tracks {
            let point = self.refined_point_of(track, imaging);
            let near = |o: &&mut Obstacle| o.position_m.distance(point.position_m) <= CLUSTER_M;
            let Some(obstacle) = obstacles.iter_mut().find(near) else {
                obstacles.push(obstacle_from_track(track, point));
                continue;
            };
            obstacle.provisional &= track.provisional;
            obstacle.shape.extend(cells(track, &point));
            obstacle.first_seen_ns = obstacle.first_seen_ns.min(track.first_ns);
            obstacle.last_seen_ns = obstacle.last_seen_ns.max(track.last_ns);
        }
        obstacles.into_iter().map(with_extent).collect()
    }

    /// Restores saved objects as provisional, the strongest cells of each where there are many. Objects already known are left
    /// as they are.
    pub fn restore(&mut self, saved: &[SavedPoint], match_m: f64) {
        let is_same = same_point(match_m);
        let most_cells = (MAX_RESTORED_CELLS / saved.len().max(1)).max(1);
        for point in saved {
            let times = [point.first_ns, point.last_ns];
            let taken = self.tracks.restore(point.id, point.position_m, point.score, times, &is_same);
            let Some(id) = taken else { continue };
            self.existences.insert(id, Existence::restored(point.strengths));
            let (position_m, covariance_m2) = (point.position_m, point.covariance_m2);
            let shape = Shape { cells: Shape { cells: point.shape.clone() }.strongest(most_cells) };
            self.refined.insert(id, (0.0, RefinedPoint { position_m, covariance_m2, shape }));
        }
    }

    /// The objects to save, by id: confirmed ones observed since, and restored ones that still
    /// exist.
    pub fn saved(&self, imaging: &Imaging) -> Vec<SavedPoint> {
        let saved = |track: &Track<DVec3>| {
            // An object that was never observed again cannot be missed either.
            let strengths = self.existences.get(&track.id)?.strengths();
            strengths.iter().any(|strength| *strength > 0.0).then(|| {
                let point = self.refined_point_of(track, imaging);
                SavedPoint {
                    id: track.id,
                    position_m: point.position_m,
                    covariance_m2: point.covariance_m2,
                    score: track.score,
                    strengths,
                    shape: point.shape.strongest(SavedMap::MAX_SHAPE),
                    first_ns: track.first_ns,
                    last_ns: track.last_ns,
                }
            })
        };
        let mut points: Vec<SavedPoint> = self.tracks.confirmed().filter_map(saved).collect();
        points.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
        points.truncate(SavedMap::MAX_PLACES);
        points.sort_by_key(|point| point.id);
        points
    }

    /// The poses that the objects were seen from had been wrong: the next hit moves an object, and misses remove it soon.
    pub fn distrust(&mut self, change: &CalibrationChange) {
        self.tracks.distrust();
        self.existences.values_mut().for_each(Existence::distrust);
        let off_m = change.mount_m.unwrap_or(0.0) + change.time_offset_s.abs() * TYPICAL_SPEED_M_PER_S;
        for (quality, refined) in self.refined.values_mut() {
            *quality = 0.0;
            refined.covariance_m2 += DMat3::from_diagonal(DVec3::splat(off_m * off_m / 3.0));
        }
    }
}

/// The obstacle of a single track.
fn obstacle_from_track(track: &Track<DVec3>, point: RefinedPoint) -> Obstacle {
    Obstacle {
        id: track.id,
        position_m: point.position_m,
        covariance_m2: point.covariance_m2,
        observed: Observed::Position,
        extent_m: DVec3::ZERO,
        evidence: track.score,
        shape: cells(track, &point),
        provisional: track.provisional,
        first_seen_ns: track.first_ns,
        last_seen_ns: track.last_ns,
    }
}

/// A track's cells; the one that contains its position when it has none.
fn cells(track: &Track<DVec3>, point: &RefinedPoint) -> Vec<(DVec3, f32)> {
    match point.shape.cells.is_empty() {
        true => vec![(center_of(cell_of(point.position_m)), track.score as f32)],
        false => point.shape.cells.clone(),
    }
}

/// With each cell once, the highest score first, and the box around all cells.
fn with_extent(mut obstacle: Obstacle) -> Obstacle {
    obstacle.shape.sort_by(by_falling_score);
    let mut taken = HashSet::new();
    obstacle.shape.retain(|(center, _)| taken.insert(cell_of(*center)));
    if let Some(around) = Aabb::around(obstacle.shape.iter().map(|s| s.0)) {
        obstacle.extent_m = around.size() + CELL_M;
    }
    obstacle
}

#[cfg(test)]
mod tests {
    use radar_sar::subaperture::{SubapertureBuilder, SubapertureSettings};
    use radar_sar::test_data::{sweeps, winding};

    use super::*;

    #[test]
    fn removing_certain_object_weakens_only_its_neighbours() {
        let settings = TrackSettings::default();
        let beside = |gone: Existence| {
            let mut objects = ObjectMap::default();
            for (id, at_m) in [(1, 0.0), (2, 0.9 * LATERAL_M), (3, 1.1 * LATERAL_M)] {
                objects.tracks.restore(id, DVec3::new(at_m, 0.5, -1.0), 5.0, [0, 0], same_point(0.1)).unwrap();
                objects.existences.insert(id, Existence::restored([1.0; 16]));
            }
            objects.existences.insert(1, gone);
            let mut window = Window::default();
            let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
            sweeps(1.0, winding, &[], 3).into_iter().filter_map(|o| builder.push(o)).for_each(|s| window.push(s));
            let removed = objects.update_existence(&[], &[], &window, |_| false, &settings.existence);
            assert_eq!((removed.count, removed.positions_m.len()), (1, 1));
            assert!(objects.confirmed().all(|point| point.id != 1), "it is gone");
            [2, 3].map(|id| objects.existences[&id].log_odds())
        };
        let known = Existence::restored([1.0; 16]).log_odds();
        assert_eq!(beside(Existence::known_and_gone()), [settings.existence.neighbour_log_odds, known]);
        assert_eq!(beside(Existence::new()), [known, known], "it may never have been a real object");
    }
}
