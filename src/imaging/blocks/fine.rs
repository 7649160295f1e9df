//! The block score on fine voxels wherever something is.
//!
//! A second field, of 1 cm, holds the bricks alone that are asked for: those around strong places and
//! around what is known. Every new block is added to them; a brick that is newly asked for is computed from the blocks at
//! hand, so that it holds what a dense fine field of those blocks holds, bit for bit. A look opens so many bricks at most;
//! the others wait, and are counted. Bricks that nobody asked for in a while go.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

use super::{Block, BlockSettings, Field, Peak};
use crate::geometry::Aabb;

/// Parameters of the fine field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FineSettings {
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Score that is left of a place from which on it is looked at finely.
    pub min_score: f64,
    /// Bricks of 8³ voxels that one look opens at most.
    pub max_opened: usize,
    /// Bricks held at most.
    pub max_bricks: usize,
    /// Looks after which a brick that nobody asks for is dropped.
    pub keep_looks: u32,
}

impl Default for FineSettings {
    fn default() -> Self {
        Self { voxel_m: 0.01, min_score: 3.5, max_opened: 150, max_bricks: 4000, keep_looks: 4 }
    }
}

/// What was done, and what waits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FineCounters {
    /// Bricks opened.
    pub opened: u64,
    /// Bricks dropped.
    pub dropped: u64,
    /// Bricks that a look asked for and left for a later one, summed over the looks.
    pub put_off: u64,
    /// Bricks asked for that would not have fitted, summed over the looks.
    pub refused: u64,
    /// (voxel, sweep) pairs summed.
    pub updates: u64,
}

impl FineCounters {
    /// Both together.
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

/// The score on fine voxels, where it was asked for.
#[derive(Debug)]
pub struct FineField {
    settings: FineSettings,
    field: Field,
    /// By brick: looks since it was last asked for.
    idle: BTreeMap<[i32; 3], u32>,
    counters: FineCounters,
}

impl FineField {
    /// Empty. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: FineSettings, blocks: BlockSettings, min_cos: f64) -> Self {
        let field = Field::new(BlockSettings { voxel_m: settings.voxel_m, ..blocks }, min_cos);
        Self { settings, field, idle: BTreeMap::new(), counters: FineCounters::default() }
    }

    /// What was done so far.
    pub fn counters(&self) -> FineCounters {
        FineCounters { updates: self.field.updates, ..self.counters }
    }

    /// The field itself.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Adds a block to the bricks that are open.
    pub fn add(&mut self, block: &Block) {
        self.field.add_to_known(block);
    }

    /// Asks for places, each a cube of `edge_m`, the most important first; opens what is new as far as the settings go, from
    /// the blocks at hand (in time, the newest already added to what was open), and drops what was not asked for in a while.
    pub fn ask_for(&mut self, places: &[DVec3], edge_m: f64, blocks: &[&Block]) {
        self.idle.values_mut().for_each(|looks| *looks += 1);
        let mut wanted: Vec<IVec3> = Vec::new();
        let mut waiting: BTreeMap<[i32; 3], ()> = BTreeMap::new();
        for place in places {
            let around = Aabb { min: *place - edge_m * 0.5, max: *place + edge_m * 0.5 };
            for key in self.field.keys_around(&around) {
                match self.idle.get_mut(&key.to_array()) {
                    Some(looks) => *looks = 0,
                    None if waiting.insert(key.to_array(), ()).is_none() => wanted.push(key),
                    None => {}
                }
            }
        }
        let keep = self.settings.keep_looks;
        let gone: Vec<[i32; 3]> = self.idle.iter().filter(|(_, looks)| **looks > keep).map(|(key, _)| *key).collect();
        gone.iter().for_each(|key| {
            self.idle.remove(key);
        });
        self.field.close(&gone);
        let room = self.settings.max_bricks.saturating_sub(self.idle.len());
        self.counters.dropped += gone.len() as u64;
        self.counters.refused += wanted.len().saturating_sub(room) as u64;
        wanted.truncate(room);
        self.counters.put_off += wanted.len().saturating_sub(self.settings.max_opened) as u64;
        wanted.truncate(self.settings.max_opened);
        self.counters.opened += wanted.len() as u64;
        self.field.open(&wanted, blocks);
        self.idle.extend(wanted.iter().map(|key| (key.to_array(), 0)));
    }

    /// Fine voxels within a box of at least that score, in brick order.
    pub fn above_within(&self, region: &Aabb, min_score: f64) -> Vec<Peak> {
        self.field.above_within(region, min_score)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::blocks::{BlockBuilder, blocks_volume};
    use crate::imaging::test_data::{Echo, on_one_thread, sweeps, winding};
    use crate::radar::{Beam, Observation};

    const CHAIR: DVec3 = DVec3::new(0.225, 0.125, -1.175);
    const LAMP: DVec3 = DVec3::new(-0.4, -0.2, -1.6);

    fn observations() -> Vec<Observation> {
        sweeps(0.8, winding, &[(Echo::Point(CHAIR), 1.0), (Echo::Point(LAMP), 1.0)], 1)
    }

    fn blocks() -> Vec<Block> {
        let mut builder = BlockBuilder::new(BlockSettings::default());
        let mut blocks: Vec<_> = observations().into_iter().filter_map(|o| builder.push(o)).collect();
        blocks.extend(builder.close());
        blocks
    }

    fn fine(settings: FineSettings) -> FineField {
        let blocks = BlockSettings::default();
        FineField::new(settings, blocks, blocks.min_cos(&Beam::Lensless))
    }

    fn around(at: DVec3) -> Aabb {
        let on_grid = (at / 0.01).round() * 0.01;
        Aabb { min: on_grid - 0.05, max: on_grid + 0.05 }
    }

    #[test]
    fn what_is_open_is_the_dense_field_bit_for_bit_and_the_volume() {
        let blocks = blocks();
        let settings = BlockSettings { voxel_m: 0.01, ..BlockSettings::default() };
        let mut dense = Field::new(settings, settings.min_cos(&Beam::Lensless));
        blocks.iter().for_each(|block| dense.add(block));
        let run = || {
            let mut fine = fine(FineSettings::default());
            // One place from the third block on, the other from the sixth.
            for (n, block) in blocks.iter().enumerate() {
                fine.add(block);
                let seen: Vec<&Block> = blocks[..=n].iter().collect();
                match n {
                    2 => fine.ask_for(&[CHAIR], 0.1, &seen),
                    5 => fine.ask_for(&[CHAIR, LAMP], 0.1, &seen),
                    _ => {}
                }
            }
            fine
        };
        let fine = run();
        for at in [CHAIR, LAMP] {
            let (found, exact) = (fine.above_within(&around(at), -9.0), dense.above_within(&around(at), -9.0));
            assert!(found.len() == 1000, "{}", found.len());
            assert_eq!(found, exact);
            let volume = blocks_volume(&observations(), &Beam::Lensless, &settings, &around(at), 0.01);
            let peak = f64::from(volume.peak().unwrap().1);
            for voxel in &found {
                let at = ((voxel.position_m - volume.origin_m) / 0.01).floor().to_array().map(|n| n as usize);
                assert!(volume.center(at).distance(voxel.position_m) < 1e-9);
                let other = f64::from(volume.values[volume.index(at)]);
                assert!((voxel.score - other).abs() < 0.01 * peak, "{voxel:?} {other}");
            }
        }
        assert_eq!(on_one_thread(run).above_within(&around(LAMP), -9.0), fine.above_within(&around(LAMP), -9.0));
    }

    #[test]
    fn work_is_bounded_carried_over_and_counted() {
        let blocks = blocks();
        let seen: Vec<&Block> = blocks.iter().collect();
        let mut fine = fine(FineSettings { max_opened: 5, max_bricks: 12, keep_looks: 1, ..FineSettings::default() });
        let asked = fine.field().keys_around(&Aabb { min: CHAIR - 0.05, max: CHAIR + 0.05 }).len() as u64;
        assert!(asked >= 8);
        fine.ask_for(&[CHAIR], 0.1, &seen);
        assert_eq!((fine.counters().opened, fine.counters().put_off), (5, asked.min(12) - 5));
        fine.ask_for(&[CHAIR], 0.1, &seen);
        fine.ask_for(&[CHAIR], 0.1, &seen);
        assert_eq!(fine.counters().opened, asked.min(12));
        // Nobody asks any more: after two looks all of it goes.
        fine.ask_for(&[], 0.1, &seen);
        assert_eq!(fine.counters().dropped, 0);
        fine.ask_for(&[], 0.1, &seen);
        assert_eq!((fine.counters().dropped, fine.field().brick_count()), (asked.min(12), 0));
    }
}
