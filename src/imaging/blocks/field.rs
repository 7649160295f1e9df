//! Block scores of all voxels that were ever in the beam, in bricks of 8 × 8 × 8.
//!
//! Each voxel keeps A, B and when it was last seen; its score is A/√B. A voxel that is not looked at keeps its score.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::{Block, BlockSettings, LANES, MEAN_LOG_OF_NOISE, Points};
use crate::geometry::Pose;

/// Voxels along a brick's edge.
const EDGE: usize = 8;
/// Voxels in a brick.
const VOXELS: usize = EDGE * EDGE * EDGE;

/// A local maximum of the score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Voxel centre, tracking frame, metres.
    pub position_m: DVec3,
    /// A/√B.
    pub score: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Voxel {
    a: f32,
    b: f32,
    /// Seconds since the field began.
    seen_s: f32,
}

#[derive(Debug)]
struct Brick {
    /// Brick coordinates: its lowest voxel is `key · EDGE`.
    key: IVec3,
    voxels: Box<[Voxel; VOXELS]>,
}

/// Scores over space.
#[derive(Debug)]
pub struct Field {
    settings: BlockSettings,
    min_cos: f64,
    start_ns: Option<i64>,
    bricks: Vec<Brick>,
    index: BTreeMap<[i32; 3], usize>,
    /// (voxel, sweep) pairs summed so far.
    pub updates: u64,
}

impl Field {
    /// Empty. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: BlockSettings, min_cos: f64) -> Self {
        Self { settings, min_cos, start_ns: None, bricks: Vec::new(), index: BTreeMap::new(), updates: 0 }
    }

    /// Number of bricks that were ever in the beam.
    pub fn brick_count(&self) -> usize {
        self.bricks.len()
    }

    /// Adds a block to every voxel that it had in the beam. The same bits on any number of threads: voxels are independent.
    pub fn add(&mut self, block: &Block) {
        let start_ns = *self.start_ns.get_or_insert(block.mid_time_ns);
        let now_s = ((block.mid_time_ns - start_ns) as f64 * 1e-9) as f32;
        let mut in_reach = vec![false; self.bricks.len()];
        for key in self.keys_in_reach(&block.middle) {
            let next = self.bricks.len();
            let at = *self.index.entry(key.to_array()).or_insert(next);
            if at == next {
                self.bricks.push(Brick { key, voxels: Box::new([Voxel::default(); VOXELS]) });
                in_reach.push(true);
            } else {
                in_reach[at] = true;
            }
        }
        let (settings, min_cos) = (&self.settings, self.min_cos);
        let visited: usize = self
            .bricks
            .par_iter_mut()
            .zip(&in_reach)
            .filter(|(_, reach)| **reach)
            .map(|(brick, _)| brick.add(block, settings, min_cos, now_s))
            .sum();
        self.updates += (visited * block.sweep_count()) as u64;
    }

    /// Bricks that may have a voxel in the beam.
    fn keys_in_reach(&self, sensor: &Pose) -> Vec<IVec3> {
        let edge_m = self.settings.voxel_m * EDGE as f64;
        let around_m = edge_m * 3f64.sqrt() * 0.5;
        let reach = DVec3::splat(self.settings.max_range_m);
        let low = ((sensor.translation - reach) / edge_m).floor().as_ivec3();
        let high = ((sensor.translation + reach) / edge_m).floor().as_ivec3();
        let may_see = |key: &IVec3| {
            let to = (key.as_dvec3() + 0.5) * edge_m - sensor.translation;
            let distance_m = to.length();
            if distance_m > self.settings.max_range_m + around_m || distance_m + around_m < self.settings.min_range_m {
                return false;
            }
            // The brick's ball against the cone, by the angle that the ball fills.
            let half_angle = (around_m / distance_m.max(around_m)).asin();
            let off = (to.dot(sensor.forward()) / distance_m.max(1e-9)).clamp(-1.0, 1.0).acos();
            distance_m <= around_m || off - half_angle <= self.min_cos.acos()
        };
        let range = |a: i32, b: i32| a..=b;
        range(low.z, high.z)
            .flat_map(|z| {
                range(low.y, high.y).flat_map(move |y| range(low.x, high.x).map(move |x| IVec3::new(x, y, z)))
            })
            .filter(may_see)
            .collect()
    }

    /// Score at the voxel that holds a place; `None` where nothing was ever seen.
    pub fn score_at(&self, place: DVec3) -> Option<f64> {
        let voxel = (place / self.settings.voxel_m).floor().as_ivec3();
        let key = voxel.map(|n| n.div_euclid(EDGE as i32));
        let inside = (voxel - key * EDGE as i32).as_uvec3();
        let brick = &self.bricks[*self.index.get(&key.to_array())?];
        brick.voxels[(inside.z as usize * EDGE + inside.y as usize) * EDGE + inside.x as usize].score().map(f64::from)
    }

    /// Every voxel seen since a time whose score is at least `min_score`: centre and score, in brick order.
    pub fn above(&self, min_score: f64, since_ns: i64) -> Vec<Peak> {
        let since_s = self.start_ns.map_or(0.0, |start| (since_ns - start) as f64 * 1e-9) as f32;
        let voxel_m = self.settings.voxel_m;
        let mut found = Vec::new();
        for brick in self.index.values().map(|&at| &self.bricks[at]) {
            for (n, voxel) in brick.voxels.iter().enumerate() {
                if voxel.seen_s >= since_s
                    && let Some(score) = voxel.score().map(f64::from)
                    && score >= min_score
                {
                    found.push(Peak { position_m: brick.center(n, voxel_m), score });
                }
            }
        }
        found
    }

    /// Local maxima: voxels of [`Field::above`] with no greater one within `radius_m`, by falling score.
    pub fn peaks(&self, min_score: f64, radius_m: f64, since_ns: i64) -> Vec<Peak> {
        let mut voxels = self.above(min_score, since_ns);
        // Equal scores fall back to the place, so that the order is always the same.
        voxels.sort_by(|p, q| {
            q.score.total_cmp(&p.score).then_with(|| {
                let (a, b) = (p.position_m, q.position_m);
                a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
            })
        });
        let cell = |p: DVec3| (p / radius_m).floor().as_ivec3();
        let mut greater: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
        let mut peaks = Vec::new();
        for voxel in voxels {
            let here = cell(voxel.position_m);
            let near = (0..27).flat_map(|n| {
                let offset = IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
                greater.get(&(here + offset).to_array()).into_iter().flatten()
            });
            if near.into_iter().all(|p| p.distance(voxel.position_m) > radius_m) {
                peaks.push(voxel);
            }
            greater.entry(here.to_array()).or_default().push(voxel.position_m);
        }
        peaks
    }
}

impl Voxel {
    fn score(&self) -> Option<f32> {
        (self.b > 0.0).then(|| self.a / self.b.sqrt())
    }
}

impl Brick {
    fn center(&self, n: usize, voxel_m: f64) -> DVec3 {
        let inside = DVec3::new((n % EDGE) as f64, (n / EDGE % EDGE) as f64, (n / (EDGE * EDGE)) as f64);
        (self.key.as_dvec3() * EDGE as f64 + inside + 0.5) * voxel_m
    }

    /// Adds a block to the voxels in its beam; returns how many there were.
    fn add(&mut self, block: &Block, settings: &BlockSettings, min_cos: f64, now_s: f32) -> usize {
        let mut seen = [0usize; VOXELS];
        let mut count = 0;
        let mut places = [[0.0f32; 3]; VOXELS];
        for n in 0..VOXELS {
            let center = self.center(n, settings.voxel_m);
            if settings.sees(&block.middle, min_cos, center) {
                seen[count] = n;
                places[count] = (center - block.middle.translation).as_vec3().to_array();
                count += 1;
            }
        }
        for (indices, places) in seen[..count].chunks(LANES).zip(places[..count].chunks(LANES)) {
            let coherence = block.coherence_at_points(&Points::of(places));
            for (&n, m) in indices.iter().zip(coherence.m) {
                self.voxels[n].add(m, now_s, settings.memory_s as f32);
            }
        }
        count
    }
}

impl Voxel {
    fn add(&mut self, m: f32, now_s: f32, memory_s: f32) {
        let rho = (-(now_s - self.seen_s) / memory_s).exp();
        self.a = rho * self.a + m.ln_1p() - MEAN_LOG_OF_NOISE as f32;
        self.b = rho * rho * self.b + 1.0;
        self.seen_s = now_s;
    }
}

impl Points {
    /// From up to sixteen places; missing lanes repeat the first.
    pub fn of(places: &[[f32; 3]]) -> Self {
        let at = |l: usize| places.get(l).or(places.first()).copied().unwrap_or([0.0, 0.0, -1.0]);
        let axis = |k: usize| std::array::from_fn(|l| at(l)[k]);
        Self { x: axis(0), y: axis(1), z: axis(2) }
    }
}
