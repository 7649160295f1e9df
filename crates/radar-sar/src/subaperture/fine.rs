//! The sub-aperture score on fine voxels, only where it is needed.
//!
//! A second field, of 1 cm, holds only requested bricks: those around strong points and around
//! known objects. A brick's value covers the current sub-apertures and, as long as none expires
//! unread, all back to those that were current at its request, bit for bit as in a dense fine field
//! of the same sub-apertures. A sub-aperture is added to a brick only when the brick is read: most
//! requested bricks are dropped before anybody reads them, or wait for long, and cost next to
//! nothing. Where one expires unread, the brick begins anew with those that are current; what it
//! held is older, and with the scores' decay hardly counts. Each update opens and reads a bounded
//! number of bricks; the others are deferred and counted. Bricks not requested for a while are
//! dropped.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

use super::{Field, Peak, Subaperture, SubapertureSettings};
use crate::geometry::Aabb;
use crate::{BoundedSettings, SettingBound, bounds};

/// Parameters of the fine field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FineSettings {
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Least remaining score of a point at which it is examined on fine voxels.
    pub min_score: f64,
    /// Bricks of 8³ voxels that one update opens at most, and brings up to date at most.
    pub max_opened: usize,
    /// Greatest number of bricks held.
    pub max_bricks: usize,
    /// Updates after which a brick that is not requested is dropped.
    pub keep_updates: u32,
}

impl BoundedSettings for FineSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        voxel_m: 0.005, 0.05;
        min_score: 0.0, 1e6;
        max_opened: 0.0, 1e4;
        max_bricks: 0.0, 1e5;
        keep_updates: 0.0, 1e4;
    ];
}

impl Default for FineSettings {
    fn default() -> Self {
        Self { voxel_m: 0.01, min_score: 3.5, max_opened: 150, max_bricks: 4000, keep_updates: 4 }
    }
}

/// Work done and deferred.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FineCounters {
    /// Bricks opened.
    pub opened: u64,
    /// Bricks dropped.
    pub dropped: u64,
    /// Bricks that an update requested, or wanted to read, and deferred; summed over the updates.
    pub put_off: u64,
    /// Requested bricks that exceeded the limit, summed over the updates.
    pub refused: u64,
    /// (voxel, sweep) pairs summed.
    pub updates: u64,
}

impl FineCounters {
    /// Sum of both.
    pub fn and(&self, more: &Self) -> Self {
        Self {
            opened: self.opened + more.opened,
            dropped: self.dropped + more.dropped,
            put_off: self.put_off + more.put_off,
            refused: self.refused + more.refused,
            updates: self.updates + more.updates,
        }
    }
}

/// An open brick.
#[derive(Debug, Clone, Copy)]
struct Open {
    /// Updates since its last request.
    idle: u32,
    /// Number of the first sub-aperture missing from it.
    missing: u64,
    /// Whether no sub-aperture was added to it yet.
    is_empty: bool,
}

/// The score on requested fine voxels.
#[derive(Debug)]
pub struct FineField {
    settings: FineSettings,
    field: Field,
    open: BTreeMap<[i32; 3], Open>,
    /// Numbers of sub-apertures added and expired so far; those between are current.
    pushed: u64,
    popped: u64,
    /// Bricks that may still be brought up to date in this update.
    updates_left: usize,
    counters: FineCounters,
}

impl FineField {
    /// An empty field. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: FineSettings, blocks: SubapertureSettings, min_cos: f64) -> Self {
        let field = Field::new(SubapertureSettings { voxel_m: settings.voxel_m, ..blocks }, min_cos);
        let (open, counters) = (BTreeMap::new(), FineCounters::default());
        Self { settings, field, open, pushed: 0, popped: 0, updates_left: settings.max_opened, counters }
    }

    /// Work done so far.
    pub fn counters(&self) -> FineCounters {
        FineCounters { updates: self.field.updates, ..self.counters }
    }

    /// The underlying field.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Adds a sub-aperture, which is current from now on. Sub-apertures must come in time order.
    pub fn push_subaperture(&mut self, block: &Subaperture) {
        self.field.register_time(block);
        self.pushed += 1;
    }

    /// Expires the oldest current sub-aperture; bricks missing it begin anew.
    pub fn pop_subaperture(&mut self) {
        self.popped += 1;
        for (key, open) in self.open.iter_mut().filter(|(_, open)| open.missing < self.popped) {
            if !open.is_empty {
                self.field.clear(key);
            }
            *open = Open { missing: self.popped, is_empty: true, ..*open };
        }
    }

    /// Requests points, each as a cube of `edge_m`, the most important first. Opens new bricks
    /// within the limits and drops those not requested for a while. Begins an update.
    pub fn request(&mut self, places: &[DVec3], edge_m: f64) {
        self.updates_left = self.settings.max_opened;
        self.open.values_mut().for_each(|o| o.idle += 1);
        let mut wanted: Vec<IVec3> = Vec::new();
        let mut waiting: BTreeMap<[i32; 3], ()> = BTreeMap::new();
        for place in places {
            let around = Aabb { min: *place - edge_m * 0.5, max: *place + edge_m * 0.5 };
            for key in self.field.keys_around(&around) {
                match self.open.get_mut(&key.to_array()) {
                    Some(open) => open.idle = 0,
                    None if waiting.insert(key.to_array(), ()).is_none() => wanted.push(key),
                    None => {}
                }
            }
        }
        let keep = self.settings.keep_updates;
        let dropped: Vec<[i32; 3]> = self.open.iter().filter(|(_, o)| o.idle > keep).map(|(key, _)| *key).collect();
        dropped.iter().for_each(|key| {
            self.open.remove(key);
        });
        self.field.close(&dropped);
        let room = self.settings.max_bricks.saturating_sub(self.open.len());
        self.counters.dropped += dropped.len() as u64;
        self.counters.refused += wanted.len().saturating_sub(room) as u64;
        wanted.truncate(room);
        self.counters.put_off += wanted.len().saturating_sub(self.settings.max_opened) as u64;
        wanted.truncate(self.settings.max_opened);
        self.counters.opened += wanted.len() as u64;
        self.field.insert_bricks(&wanted);
        self.open
            .extend(wanted.iter().map(|key| (key.to_array(), Open { idle: 0, missing: self.popped, is_empty: true })));
    }

    /// Brings the open bricks that these boxes touch up to date, box by box; false for a box for which this update would read
    /// too many bricks. `at_hand`: all current sub-apertures, in time order.
    pub fn update_around(&mut self, regions: &[Aabb], at_hand: &[&Subaperture]) -> Vec<bool> {
        debug_assert_eq!(at_hand.len() as u64, self.pushed - self.popped);
        let mut behind = BTreeMap::new();
        let is_updated = regions.iter().map(|region| {
            let keys = self.field.keys_around(region).into_iter().map(|key| key.to_array());
            let lacking =
                |key: &[i32; 3]| self.open.get(key).map(|o| o.missing).filter(|missing| *missing < self.pushed);
            let more = keys.filter(|key| !behind.contains_key(key)).filter_map(|key| Some((key, lacking(&key)?)));
            let more: Vec<([i32; 3], u64)> = more.collect();
            let Some(updates_left) = self.updates_left.checked_sub(more.len()) else {
                self.counters.put_off += more.len() as u64;
                return false;
            };
            self.updates_left = updates_left;
            behind.extend(more);
            true
        });
        let is_updated = is_updated.collect();
        self.catch_up(&behind, at_hand);
        is_updated
    }

    /// Open voxels within a box of at least that score, in brick order, as of their last
    /// [`update_around`](Self::update_around): outdated, where that returned false.
    pub fn above_within(&self, region: &Aabb, min_score: f64) -> Vec<Peak> {
        self.field.above_within(region, min_score)
    }

    /// Brings every open brick up to date, without a limit.
    pub fn update_all(&mut self, at_hand: &[&Subaperture]) {
        let behind =
            self.open.iter().filter(|(_, o)| o.missing < self.pushed).map(|(key, o)| (*key, o.missing)).collect();
        self.catch_up(&behind, at_hand);
    }

    /// Adds to bricks the sub-apertures from their given number on.
    fn catch_up(&mut self, behind: &BTreeMap<[i32; 3], u64>, at_hand: &[&Subaperture]) {
        let all = at_hand.len();
        if behind.is_empty() {
            return;
        }
        let missing = |key: &[i32; 3]| behind.get(key).map_or(all, |missing| (missing - self.popped) as usize)..all;
        self.field.add_missing(at_hand, missing);
        for key in behind.keys() {
            if let Some(open) = self.open.get_mut(key) {
                *open = Open { missing: self.pushed, is_empty: false, ..*open };
            }
        }
    }

    /// Centres of the open bricks.
    pub fn open_bricks(&self) -> Vec<DVec3> {
        let edge_m = self.field.brick_edge_m();
        self.open.keys().map(|key| (IVec3::from_array(*key).as_dvec3() + 0.5) * edge_m).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subaperture::{SubapertureBuilder, subaperture_volume};
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::{Beam, Observation};

    const CHAIR: DVec3 = DVec3::new(0.225, 0.125, -1.175);
    const LAMP: DVec3 = DVec3::new(-0.4, -0.2, -1.6);

    fn observations() -> Vec<Observation> {
        sweeps(0.8, winding, &[(Echo::Point(CHAIR), 1.0), (Echo::Point(LAMP), 1.0)], 1)
    }

    fn blocks() -> Vec<Subaperture> {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        let mut blocks: Vec<_> = observations().into_iter().filter_map(|o| builder.push(o)).collect();
        blocks.extend(builder.close());
        blocks
    }

    fn fine(settings: FineSettings) -> FineField {
        let blocks = SubapertureSettings::default();
        FineField::new(settings, blocks, blocks.min_cos(&Beam::Lensless))
    }

    fn around(at: DVec3) -> Aabb {
        let on_grid = (at / 0.01).round() * 0.01;
        Aabb { min: on_grid - 0.05, max: on_grid + 0.05 }
    }

    #[test]
    fn open_bricks_equal_the_dense_field_bit_for_bit() {
        let blocks = blocks();
        let settings = SubapertureSettings { voxel_m: 0.01, ..SubapertureSettings::default() };
        let dense = |since: usize| {
            let mut dense = Field::new(settings, settings.min_cos(&Beam::Lensless));
            blocks[since..].iter().for_each(|block| dense.add(block));
            dense
        };
        let run = || {
            let mut fine = fine(FineSettings::default());
            // One point from the third sub-aperture on, the other from the sixth. The first two sub-apertures expire before the
            // end; the first point is read before that, the other is not.
            for (n, block) in blocks.iter().enumerate() {
                fine.push_subaperture(block);
                match n {
                    2 => fine.request(&[CHAIR], 0.1),
                    4 => assert!(fine.update_around(&[around(CHAIR)], &blocks[..=n].iter().collect::<Vec<_>>())[0]),
                    5 => fine.request(&[CHAIR, LAMP], 0.1),
                    6 => (0..2).for_each(|_| fine.pop_subaperture()),
                    _ => {}
                }
            }
            let at_hand: Vec<&Subaperture> = blocks[2..].iter().collect();
            assert_eq!(fine.update_around(&[CHAIR, LAMP].map(around), &at_hand), [true, true]);
            [CHAIR, LAMP].map(|at| fine.above_within(&around(at), -9.0))
        };
        let found = run();
        for ((at, since), found) in [(CHAIR, 0), (LAMP, 2)].into_iter().zip(&found) {
            let exact = &dense(since).above_within(&around(at), -9.0);
            assert!(found.len() == 1000, "{}", found.len());
            assert_eq!(found, exact);
            if since > 0 {
                continue;
            }
            let volume = subaperture_volume(&observations(), &Beam::Lensless, &settings, &around(at), 0.01);
            let peak = f64::from(volume.peak().unwrap().1);
            for voxel in found {
                let at = ((voxel.position_m - volume.origin_m) / 0.01).floor().to_array().map(|n| n as usize);
                assert!(volume.center(at).distance(voxel.position_m) < 1e-9);
                let other = f64::from(volume.values[volume.index(at)]);
                assert!((voxel.score - other).abs() < 0.01 * peak, "{voxel:?} {other}");
            }
        }
        assert_eq!(on_one_thread(run), found);
    }

    #[test]
    fn work_is_bounded_carried_over_and_counted() {
        let blocks = blocks();
        let mut fine = fine(FineSettings { max_opened: 5, max_bricks: 12, keep_updates: 1, ..FineSettings::default() });
        blocks.iter().for_each(|block| fine.push_subaperture(block));
        let cube = Aabb { min: CHAIR - 0.05, max: CHAIR + 0.05 };
        let asked = fine.field().keys_around(&cube).len() as u64;
        assert!(asked >= 8);
        fine.request(&[CHAIR], 0.1);
        assert_eq!((fine.counters().opened, fine.counters().put_off), (5, asked.min(12) - 5));
        fine.request(&[CHAIR], 0.1);
        fine.request(&[CHAIR], 0.1);
        assert_eq!(fine.counters().opened, asked.min(12));
        assert_eq!(fine.open_bricks().len() as u64, asked.min(12));
        // Nothing has been read yet, and at most five bricks are read at once.
        assert_eq!(fine.counters().updates, 0);
        let at_hand: Vec<&Subaperture> = blocks.iter().collect();
        let within = Aabb { min: CHAIR, max: CHAIR };
        // Bricks that two boxes share count once.
        assert_eq!(fine.update_around(&[cube, within, within], &at_hand), [false, true, true]);
        assert!(fine.counters().updates > 0);
        // Without requests everything is dropped after two updates.
        fine.request(&[], 0.1);
        assert_eq!(fine.counters().dropped, 0);
        fine.request(&[], 0.1);
        assert_eq!((fine.counters().dropped, fine.field().brick_count()), (asked.min(12), 0));
    }

    #[test]
    fn bricks_begin_anew_where_subapertures_expire_unread() {
        let blocks = blocks();
        let at_hand: Vec<&Subaperture> = blocks.iter().collect();
        let mut fine = fine(FineSettings::default());
        blocks[..3].iter().for_each(|block| fine.push_subaperture(block));
        fine.request(&[CHAIR], 0.1);
        fine.update_around(&[around(CHAIR)], &at_hand[..3]);
        let first = fine.above_within(&around(CHAIR), -9.0);
        blocks[3..].iter().for_each(|block| fine.push_subaperture(block));
        let of_three = fine.counters().updates;
        (0..4).for_each(|_| fine.pop_subaperture());
        assert_eq!(fine.counters().updates, of_three, "what expires is not added");
        fine.update_around(&[around(CHAIR)], &at_hand[4..]);
        let second = fine.above_within(&around(CHAIR), -9.0);
        let settings = SubapertureSettings { voxel_m: 0.01, ..SubapertureSettings::default() };
        let exact = |blocks: &[Subaperture]| {
            let mut dense = Field::new(settings, settings.min_cos(&Beam::Lensless));
            blocks.iter().for_each(|block| dense.add(block));
            dense.above_within(&around(CHAIR), -9.0)
        };
        assert_eq!([first, second], [exact(&blocks[..3]), exact(&blocks[4..])]);
    }
}
