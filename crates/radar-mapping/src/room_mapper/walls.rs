//! Walls: reporting and removal.
//!
//! A wall is known by its specular reflections, from where the sensor faced it, with the wall's
//! normal within the beam. If the sensor faces it again, where it was seen, for some seconds
//! without any sign of it, it is not there: it was an artefact, or a door that is open now.

use std::collections::BTreeMap;

use glam::DVec3;

use super::window::Window;
use crate::clean::hand_masks;
use crate::{Detection, HandTrail, SavedMap, SavedWall, Track, TrackList, TrackSettings, Wall, same_plane};
use radar_sar::geometry::{Aabb, Plane};
use radar_sar::subaperture::Subaperture;

/// Missed updates after which a wall is removed. Choice: longer than the window, so that a real
/// wall would have been detected.
const MAX_MISSED_UPDATES: u32 = 24;
/// A wall is expected where it was seen, and this far beyond, metres. Choice: the foot moves with
/// the head, which goes farther than it has been; much farther along there may be a doorway.
const LATERAL_M: f64 = 0.6;
/// A point this far behind the seen part of a wall is hidden by it, metres, and the part reaches this far beyond where it
/// was seen. Choice: the pulse's width and a wall's error of position; a plane goes on where an L-shaped room or the
/// space beside a pillar is open, so its seen part ends soon.
const BEHIND_M: f64 = 0.25;
const SEEN_BEYOND_M: f64 = 0.3;

/// What walls are judged from: the window, the hands in it, and the cosine from which on a normal is in
/// the beam.
#[derive(Clone, Copy)]
pub(super) struct Facing<'a> {
    pub window: &'a Window,
    pub hands: &'a HandTrail,
    pub min_cos: f64,
}

impl Facing<'_> {
    /// The foot of the perpendicular on a wall that the newest sub-aperture faces, within range.
    fn foot_in_view(&self, wall: &Plane) -> Option<DVec3> {
        self.foot_seen_by(self.window.newest()?, wall)
    }

    /// Whether a tracked hand masks the wall in the newest sub-aperture.
    fn is_masked_by_hand(&self, wall: &Plane) -> bool {
        let is_hidden = |subaperture: &Subaperture| {
            let range_m = wall.distance(subaperture.middle.translation);
            hand_masks(subaperture, self.hands).iter().any(|mask| mask.covers(range_m, 0.0))
        };
        self.window.newest().is_some_and(is_hidden)
    }

    fn foot_seen_by(&self, subaperture: &Subaperture, wall: &Plane) -> Option<DVec3> {
        let squarely = wall.outward.dot(subaperture.middle.forward()) >= self.min_cos;
        let in_range = subaperture.geometry().axis.contains(wall.distance(subaperture.middle.translation));
        (squarely && in_range).then(|| wall.foot(subaperture.middle.translation))
    }
}

/// Plane tracks and where each was seen.
#[derive(Debug, Default)]
pub(super) struct WallMap {
    tracks: TrackList<Plane>,
    /// By wall: feet of the perpendiculars that it was seen at.
    feet: BTreeMap<u64, Aabb>,
    /// By wall: updates since its last detection in which it should have been seen.
    missed_updates: BTreeMap<u64, u32>,
}

impl WallMap {
    /// Confirmed tracks.
    pub fn confirmed(&self) -> impl Iterator<Item = &Track<Plane>> {
        self.tracks.confirmed()
    }

    /// The confirmed planes.
    pub fn planes(&self) -> Vec<Plane> {
        self.tracks.confirmed().map(|wall| wall.estimate).collect()
    }

    /// Whether a known wall, floor or ceiling is between a point and the room. What is detected there is a mirror image,
    /// or the end of a path by way of the wall.
    pub fn hides(&self, point: DVec3) -> bool {
        self.tracks.confirmed().filter(|wall| !wall.provisional).any(|wall| {
            let foot = wall.estimate.foot(point);
            // Walls were seen at the sensor's height alone, and reach down to the floor.
            let up_m = if wall.estimate.is_upright() { f64::INFINITY } else { SEEN_BEYOND_M };
            let beyond_m = DVec3::splat(SEEN_BEYOND_M).with_y(up_m);
            wall.estimate.distance(point) < -BEHIND_M && self.was_seen_within(wall.id, foot, beyond_m) == Some(true)
        })
    }

    /// Updates the tracks with an update's detections; returns how many of these counted as hits.
    pub fn update(&mut self, walls: &[Detection<Plane>], settings: &TrackSettings, middle: DVec3) -> usize {
        let settings = settings.for_planes();
        self.tracks.update(walls, &settings, same_plane(middle));
        walls.iter().filter(|wall| settings.is_hit(wall)).count()
    }

    /// Confirmed walls, by falling evidence.
    pub fn walls(&self, middle: DVec3) -> Vec<Wall> {
        let wall = |track: &Track<Plane>| {
            let foot = track.estimate.foot(middle);
            Wall {
                id: track.id,
                plane: track.estimate,
                evidence: track.score,
                seen_at: self.feet.get(&track.id).copied().unwrap_or(Aabb { min: foot, max: foot }),
                provisional: track.provisional,
                first_seen_ns: track.first_ns,
                last_seen_ns: track.last_ns,
            }
        };
        let mut walls: Vec<Wall> = self.tracks.confirmed().map(wall).collect();
        walls.sort_by(|a, b| b.evidence.total_cmp(&a.evidence).then(a.id.cmp(&b.id)));
        walls
    }

    /// Updates the extents of the known walls that were detected in this update.
    pub fn update_feet(&mut self, detections: &[Detection<Plane>], facing: Facing) {
        let is_same = same_plane(facing.window.middle());
        let is_seen = |wall: &&Track<Plane>| detections.iter().any(|other| is_same(&other.estimate, &wall.estimate));
        for wall in self.tracks.confirmed().filter(is_seen) {
            // A new wall was seen by any of the sub-apertures of the window.
            let subapertures = if self.feet.contains_key(&wall.id) { 1 } else { facing.window.len() };
            let wall_feet = facing
                .window
                .iter()
                .rev()
                .take(subapertures)
                .filter_map(|subaperture| facing.foot_seen_by(subaperture, &wall.estimate));
            let Some(seen) = Aabb::around(wall_feet) else { continue };
            let known = self.feet.entry(wall.id).or_insert(seen);
            *known = Aabb { min: known.min.min(seen.min), max: known.max.max(seen.max) };
        }
    }

    /// Removes walls that were faced in vain. `detections` are the planes detected in this update.
    pub fn remove_missed(&mut self, detections: &[Detection<Plane>], facing: Facing) {
        let is_same = same_plane(facing.window.middle());
        let known: Vec<(u64, Plane)> = self.tracks.confirmed().map(|wall| (wall.id, wall.estimate)).collect();
        for (id, plane) in &known {
            let is_believed = detections.iter().any(|other| is_same(&other.estimate, plane));
            let is_looked_at = facing.foot_in_view(plane).is_some_and(|foot| self.was_seen_near(*id, foot))
                && !facing.is_masked_by_hand(plane);
            let unseen = self.missed_updates.entry(*id).or_default();
            *unseen = if is_believed { 0 } else { *unseen + u32::from(is_looked_at) };
        }
        let missed_updates = &self.missed_updates;
        let stays = |id: u64| missed_updates.get(&id).is_none_or(|unseen| *unseen < MAX_MISSED_UPDATES);
        self.tracks.retain(|wall| stays(wall.id));
        self.feet.retain(|id, _| stays(*id));
        self.missed_updates
            .retain(|id, unseen| *unseen < MAX_MISSED_UPDATES && known.iter().any(|(other, _)| other == id));
    }

    /// Restores saved walls as provisional. Walls already known are left as they are.
    pub fn restore(&mut self, saved: &[SavedWall], middle: DVec3) {
        let is_same = same_plane(middle);
        for wall in saved {
            let times = [wall.first_ns, wall.last_ns];
            let Some(id) = self.tracks.restore(wall.id, wall.plane, wall.score, times, &is_same) else { continue };
            self.feet.insert(id, wall.seen_at);
        }
    }

    /// The walls to save, by id.
    pub fn saved(&self, middle: DVec3) -> Vec<SavedWall> {
        let walls = self.walls(middle).into_iter().take(SavedMap::MAX_WALLS).map(|wall| SavedWall {
            id: wall.id,
            plane: wall.plane,
            score: wall.evidence,
            seen_at: wall.seen_at,
            first_ns: wall.first_seen_ns,
            last_ns: wall.last_seen_ns,
        });
        let mut walls: Vec<SavedWall> = walls.collect();
        walls.sort_by_key(|wall| wall.id);
        walls
    }

    /// The poses that the walls were seen from had been wrong: the next hit moves a wall.
    pub fn distrust(&mut self) {
        self.tracks.distrust();
        self.missed_updates.clear();
    }

    /// Whether a wall was seen near a foot. A wall of unknown extent counts anywhere, else it would
    /// stay for ever.
    fn was_seen_near(&self, wall: u64, foot: DVec3) -> bool {
        self.was_seen_within(wall, foot, DVec3::splat(LATERAL_M)).unwrap_or(true)
    }

    /// Whether a foot lies where a wall was seen, or at most this far beyond; `None` for a wall of unknown extent.
    fn was_seen_within(&self, wall: u64, foot: DVec3, beyond_m: DVec3) -> Option<bool> {
        let seen_at = self.feet.get(&wall)?;
        Some(Aabb { min: seen_at.min - beyond_m, max: seen_at.max + beyond_m }.contains(foot))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RoomMapper, RoomMapperSettings};
    use radar_sar::Beam;
    use radar_sar::PositionErrors;
    use radar_sar::test_data::{Echo, sweeps, winding};

    #[test]
    fn opened_door_is_removed_and_closed_door_found_again() {
        let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
        let door = Plane { outward: DVec3::NEG_Z, offset_m: 1.5 };
        let mut push = |echoes: &[(Echo, f64)], from_s: i64, for_s: f64| {
            for mut sweep in sweeps(for_s, winding, echoes, 3) {
                sweep.mid_time_ns += from_s * 1_000_000_000;
                search.push(sweep);
            }
            search.walls().iter().filter(|wall| wall.plane.distance(DVec3::ZERO) > 1.4).count()
        };
        let shut = [(Echo::Plane(door), 3.0)];
        assert_eq!(push(&shut, 0, 4.0), 1);
        assert_eq!(push(&[], 4, 3.0), 1, "a short time without an echo is not enough");
        assert_eq!(push(&[], 7, 9.0), 0);
        assert_eq!(push(&shut, 16, 4.0), 1, "it is found again when shut");
    }

    #[test]
    fn wall_masked_by_tracked_hand_is_kept() {
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.0 };
        let known_after = |hand: Option<DVec3>| {
            let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
            sweeps(4.0, winding, &[(Echo::Plane(wall), 3.0)], 3).into_iter().for_each(|sweep| search.push(sweep));
            for mut sweep in sweeps(9.0, winding, &[], 3) {
                sweep.mid_time_ns += 4_000_000_000;
                search.push_hands(sweep.mid_time_ns, [hand, None]);
                search.push(sweep);
            }
            search.walls().iter().filter(|wall| wall.plane.distance(DVec3::ZERO) > 0.9).count()
        };
        assert_eq!([None, Some(DVec3::new(0.3, -0.4, -0.8))].map(known_after), [0, 1]);
    }

    #[test]
    fn echo_that_accompanies_the_sensor_is_no_wall() {
        let walls_at = |offset_m: f64, nearer_m_per_s: f64| {
            let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
            let along = |t: f64| DVec3::X * (0.3 * t) + DVec3::NEG_Z * (nearer_m_per_s * t);
            let wall = Echo::Plane(Plane { outward: DVec3::NEG_Z, offset_m });
            sweeps(4.0, along, &[(wall, 3.0)], 3).into_iter().for_each(|sweep| search.push(sweep));
            search.walls().len()
        };
        assert_eq!(walls_at(0.7, 0.0), 0, "what the wearer carries moves with the head too");
        assert_eq!(walls_at(0.7, 0.05), 1, "the head has come nearer");
        assert_eq!(walls_at(1.2, 0.0), 1, "the wearer does not reach so far");
    }

    #[test]
    fn mirror_image_behind_wall_is_not_reported() {
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.5 };
        let (object, image) = (DVec3::new(0.2, 0.1, -1.0), DVec3::new(0.2, 0.1, -2.0));
        let reported_behind = |echoes: &[(Echo, f64)]| {
            let mut search = RoomMapper::new(RoomMapperSettings::default(), &Beam::Lensless, PositionErrors::default());
            sweeps(6.0, winding, echoes, 3).into_iter().for_each(|sweep| search.push(sweep));
            let is_image = |at: &DVec3| at.distance(image) < 0.1;
            let detected = search.objects.confirmed().any(|track| is_image(&track.estimate));
            (detected, search.obstacles().iter().any(|obstacle| is_image(&obstacle.position_m)))
        };
        let points = [(Echo::Point(object), 8.0), (Echo::Point(image), 8.0)];
        assert_eq!(reported_behind(&points), (true, true));
        assert_eq!(reported_behind(&[&points[..], &[(Echo::Plane(wall), 3.0)]].concat()), (true, false));
    }

    #[test]
    fn only_seen_part_of_wall_hides() {
        let mut walls = WallMap::default();
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.0 };
        let seen_at = Aabb { min: DVec3::new(-0.5, 1.2, -1.0), max: DVec3::new(0.5, 1.7, -1.0) };
        let times = [0, 1];
        let id = walls.tracks.restore(1, wall, 9.0, times, same_plane(DVec3::ZERO)).unwrap();
        walls.feet.insert(id, seen_at);
        let behind = DVec3::new(0.0, 1.4, -1.5);
        assert!(!walls.hides(behind), "a restored wall may be gone");
        walls.tracks.confirm_provisional(|_| true);
        assert!(walls.hides(behind) && !walls.hides(behind + DVec3::Z * 0.4), "at the wall");
        assert!(walls.hides(behind - DVec3::Y), "the image of a low object");
        assert!(!walls.hides(behind + DVec3::X * 0.9), "the plane may go on through an open space");
        walls.feet.clear();
        assert!(!walls.hides(behind), "nobody knows where it was seen");
    }

    #[test]
    fn wall_without_recorded_feet_can_be_missed_anywhere() {
        let mut search = WallMap::default();
        assert!(search.was_seen_near(7, DVec3::new(3.0, 1.0, -2.0)), "else it would never be removed");
        search.feet.insert(7, Aabb { min: DVec3::ZERO, max: DVec3::X });
        assert!(search.was_seen_near(7, DVec3::new(1.0 + 0.9 * LATERAL_M, 0.0, 0.0)));
        assert!(!search.was_seen_near(7, DVec3::new(1.0 + 1.1 * LATERAL_M, 0.0, 0.0)));
    }
}
