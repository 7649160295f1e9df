//! Block scores of all voxels that were ever in the beam, in bricks of 8 × 8 × 8.
//!
//! Each voxel keeps A, B and when it was last seen; its score is A/√B. A voxel that is not looked at keeps its score.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::{Block, BlockSettings, MEAN_LOG_OF_NOISE};
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
        let brick = &self.bricks[*self.index.get(&key.to_array())?];
        brick.voxels[index_in_brick(voxel - key * EDGE as i32)].score().map(f64::from)
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
        let since_s = self.start_ns.map_or(0.0, |start| (since_ns - start) as f64 * 1e-9) as f32;
        let offsets = ball(radius_m / self.settings.voxel_m);
        let each =
            self.bricks.par_iter().flat_map_iter(|brick| self.peaks_of(brick, min_score as f32, &offsets, since_s));
        let mut peaks: Vec<Peak> = each.collect();
        // Equal scores fall back to the place, so that the order is always the same.
        peaks.sort_by(|p, q| {
            let (a, b) = (p.position_m, q.position_m);
            let by_place = || a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z));
            q.score.total_cmp(&p.score).then_with(by_place)
        });
        peaks
    }

    fn peaks_of(&self, brick: &Brick, min_score: f32, offsets: &[IVec3], since_s: f32) -> Vec<Peak> {
        let neighbor = |n: i32| self.index.get(&(brick.key + cube(n)).to_array()).map(|&at| &self.bricks[at]);
        let around: [Option<&Brick>; 27] = std::array::from_fn(|n| neighbor(n as i32));
        let score = |voxel: IVec3| {
            let block = (voxel + EDGE as i32) / EDGE as i32;
            let brick = around[(block.z * 9 + block.y * 3 + block.x) as usize]?;
            let voxel = &brick.voxels[index_in_brick(voxel - (block - 1) * EDGE as i32)];
            voxel.score().filter(|_| voxel.seen_s >= since_s)
        };
        let is_peak = |&n: &usize| {
            let here = IVec3::new((n % EDGE) as i32, (n / EDGE % EDGE) as i32, (n / (EDGE * EDGE)) as i32);
            let mine = score(here).unwrap_or(f32::NEG_INFINITY);
            // Of equal neighbours the one that comes first counts as the greater.
            let greater = |offset: &IVec3| {
                score(here + *offset).is_some_and(|other| other > mine || (other == mine && comes_first(*offset)))
            };
            mine >= min_score && !offsets.iter().any(greater)
        };
        let peak = |n: usize| Peak {
            position_m: brick.center(n, self.settings.voxel_m),
            score: f64::from(brick.voxels[n].score().unwrap_or(0.0)),
        };
        (0..VOXELS).filter(is_peak).map(peak).collect()
    }
}

/// Offset of neighbour `n` of 27, each axis −1 to 1.
fn cube(n: i32) -> IVec3 {
    IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)
}

/// Voxel offsets within a radius (at most a brick's edge), nearest first.
fn ball(radius: f64) -> Vec<IVec3> {
    let reach = radius.floor().min(EDGE as f64) as i32;
    let axis = || -reach..=reach;
    let all = axis().flat_map(|z| axis().flat_map(move |y| axis().map(move |x| IVec3::new(x, y, z))));
    let inside = |o: &IVec3| *o != IVec3::ZERO && f64::from(o.length_squared()) <= radius * radius + 1e-9;
    let mut offsets: Vec<_> = all.filter(inside).collect();
    offsets.sort_by_key(|o| o.length_squared());
    offsets
}

fn comes_first(offset: IVec3) -> bool {
    (offset.z, offset.y, offset.x) < (0, 0, 0)
}

fn index_in_brick(voxel: IVec3) -> usize {
    (voxel.z as usize * EDGE + voxel.y as usize) * EDGE + voxel.x as usize
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
        let coherences = block.coherence_at_points(&places[..count]);
        for (&n, coherence) in seen.iter().zip(coherences) {
            self.voxels[n].add(coherence.m, now_s, settings.memory_s as f32);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Plane;
    use crate::imaging::blocks::BlockBuilder;
    use crate::imaging::test_data::{Echo, conjugated, on_one_thread, sweeps, winding};
    use crate::imaging::{Oracle, Statistic};
    use crate::radar::{Beam, Observation};

    const CHAIR: DVec3 = DVec3::new(0.225, 0.125, -1.175);

    fn blocks(observations: Vec<Observation>) -> Vec<Block> {
        let mut builder = BlockBuilder::new(BlockSettings::default());
        let mut blocks: Vec<_> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        blocks.extend(builder.close());
        blocks
    }

    fn field(observations: Vec<Observation>) -> Field {
        let settings = BlockSettings::default();
        let mut field = Field::new(settings, settings.min_cos(&Beam::Lensless));
        blocks(observations).iter().for_each(|block| field.add(block));
        field
    }

    #[test]
    fn scores_agree_with_the_oracle() {
        let echoes = [(Echo::Point(CHAIR), 1.0), (Echo::Point(DVec3::new(-0.4, -0.2, -1.6)), 3.0)];
        let observations = sweeps(0.3, winding, &echoes, 1);
        let oracle = Oracle::new(&observations, &Beam::Lensless, &BlockSettings::default());
        let field = field(observations.clone());
        let peaks = field.peaks(-9.0, 0.15, 0);
        assert!(peaks.len() > 50);
        // The field fades when a voxel is seen again, the oracle up to the newest sweep: equal where seen all the time.
        let most = peaks[0].score;
        for peak in peaks.iter().take(20).chain(peaks.iter().rev().take(20)) {
            let exact = oracle.value(Statistic::Blocks, peak.position_m);
            assert!((peak.score - exact).abs() < 0.02 * most, "{peak:?} {exact}");
        }
        assert_eq!(oracle.value(Statistic::Blocks, DVec3::Z), 0.0);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let observations = sweeps(0.3, winding, &[(Echo::Point(CHAIR), 1.0)], 2);
        let many = field(observations.clone()).peaks(-9.0, 0.15, 0);
        assert_eq!(on_one_thread(|| field(observations).peaks(-9.0, 0.15, 0)), many);
    }

    #[test]
    fn noise_scores_low_and_conjugated_echoes_are_not_where_the_thing_is() {
        for seed in 0..3 {
            let noise = field(sweeps(0.6, winding, &[], seed)).peaks(0.0, 0.15, 0);
            // Of some thousand voxels the greatest may lie a few standard deviations up.
            assert!(noise[0].score < 4.5, "{:?}", noise[0]);
        }
        let echo = sweeps(0.6, winding, &[(Echo::Point(CHAIR), 1.0)], 4);
        let (straight, turned) = (field(echo.clone()), field(conjugated(echo)));
        assert!(straight.score_at(CHAIR).unwrap() > 6.0);
        assert!(straight.peaks(6.0, 0.15, 0)[0].position_m.distance(CHAIR) < 0.05);
        assert!(turned.score_at(CHAIR).unwrap() < 3.0);
    }

    #[test]
    fn a_wall_twenty_decibels_stronger_hardly_changes_a_chair() {
        // Behind the chair; where both share a range cell the wall does raise what the chair is measured against.
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.7 };
        let score = |wall_snr: f64| {
            let echoes = [(Echo::Point(CHAIR), 1.0), (Echo::Mirror(wall), wall_snr)];
            field(sweeps(0.6, winding, &echoes, 5)).score_at(CHAIR).unwrap()
        };
        let (weak, strong) = (score(2.0), score(20.0));
        assert!(weak > 5.0 && strong > 0.6 * weak, "{weak} {strong}");
    }

    #[test]
    fn a_place_never_seen_has_no_score() {
        assert_eq!(field(sweeps(0.2, winding, &[], 1)).score_at(DVec3::Z * 2.0), None);
    }
}
