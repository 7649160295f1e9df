//! Block scores of all voxels that were ever in the beam, in bricks of 8 × 8 × 8.
//!
//! Each voxel keeps A, B and when it was last seen; its score is A/√B. A voxel that is not looked at keeps its score. Evidence
//! fades by weighing what is new: block b counts g = e^(t/memory) times as much as one at time 0 would, which leaves A/√B as
//! if all older ones had faded. So that g stays small time is cut into epochs in which it grows 256-fold; from epoch to
//! epoch A and B are divided by powers of two, which rounds nothing. What a voxel holds is therefore a function of the blocks
//! that had it in the beam and of nothing else: not of when the field began, nor of blocks that passed it by. A field built
//! anew from the same blocks is the same, bit for bit.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::brick::{Scratch, VoxelBox};
use super::lanes::{LANES, Lanes, ln_1p};
use super::{Block, BlockSettings, MEAN_LOG_OF_NOISE};
use crate::geometry::Aabb;

/// Voxels along a brick's edge.
const EDGE: usize = 8;
const EDGE_LOG2: i32 = 3;
/// Voxels in a brick.
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Layers of 4 × 4 voxels in a brick; four on top of each other are a tile, and a brick's voxels are stored tile by tile.
const LAYERS: usize = VOXELS / LANES;
const TILE_LAYERS: usize = 4;
/// Neighbours that share a face.
const NEAREST: usize = 6;
/// Voxels of a layer's row, which lie one after the other.
const COLUMNS: usize = 4;
/// A grows by 2 to this power in an epoch.
const EPOCH_DOUBLINGS: i32 = 8;
/// Ticks in an epoch, as a power of two.
const TICKS_LOG2: u32 = 16;

/// A local maximum of the score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Voxel centre, tracking frame, metres.
    pub position_m: DVec3,
    /// A/√B.
    pub score: f64,
}

/// Sixteen voxels' evidence.
#[derive(Debug, Clone, Copy)]
struct Layer {
    a: Lanes,
    b: Lanes,
    /// Ticks of the field's clock; negative when never seen.
    seen: [i32; LANES],
}

#[derive(Debug)]
struct Brick {
    /// Brick coordinates: its lowest voxel is `key · EDGE`.
    key: IVec3,
    layers: Box<[Layer; LAYERS]>,
    /// Each layer's greatest score, squared with its sign; −∞ when never seen.
    greatest2: [f32; LAYERS],
    /// When any of its voxels was last seen.
    newest: i32,
    /// What was found in it when somebody last looked for maxima.
    found: Found,
}

/// Strong voxels and maxima of a brick, kept from one look to the next: a score changes only when a block adds to it.
#[derive(Debug, Default)]
struct Found {
    /// Nothing was added since.
    is_current: bool,
    /// Scores of at least the least score asked for, seen since the time asked for; `None` without any.
    strong: Option<Strong>,
    /// When the strong voxel was seen that was not seen for longest.
    oldest: i32,
    /// `strong` is not what it was in the look before.
    has_changed: bool,
    peaks: Vec<Peak>,
}

/// What maxima were looked for.
#[derive(Debug, Clone, Copy)]
struct Asked {
    min_score: f64,
    radius_m: f64,
    since: i32,
}

impl Asked {
    /// What was found for the one asked before can serve.
    fn follows(&self, before: &Self) -> bool {
        self.min_score == before.min_score && self.radius_m == before.radius_m && self.since >= before.since
    }
}

/// When a block was, for fading.
#[derive(Debug, Clone, Copy)]
struct Moment {
    ticks: i32,
    /// e^(time since the epoch began / memory).
    weight: f32,
}

/// Scores over space.
#[derive(Debug)]
pub struct Field {
    settings: BlockSettings,
    min_cos: f64,
    /// Epoch of the first block: ticks count from its beginning.
    first_epoch: Option<i64>,
    bricks: Vec<Brick>,
    index: BTreeMap<[i32; 3], usize>,
    /// Maxima that were last looked for, and every voxel's neighbours within their radius.
    asked: Option<Asked>,
    neighbors: Neighbors,
    /// (voxel, sweep) pairs summed so far.
    pub updates: u64,
}

impl Field {
    /// Empty. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: BlockSettings, min_cos: f64) -> Self {
        let (bricks, index) = (Vec::new(), BTreeMap::new());
        let (asked, neighbors) = (None, Neighbors::default());
        Self { settings, min_cos, first_epoch: None, bricks, index, asked, neighbors, updates: 0 }
    }

    /// Number of bricks that were ever in the beam.
    pub fn brick_count(&self) -> usize {
        self.bricks.len()
    }

    /// Adds a block to every voxel that it had in the beam. The same bits on any number of threads: voxels are independent.
    pub fn add(&mut self, block: &Block) {
        let moment = self.moment(block.mid_time_ns);
        let view = View::new(block, &self.settings, self.min_cos);
        let mut in_reach = vec![false; self.bricks.len()];
        for key in self.keys_in_reach(&view) {
            let next = self.bricks.len();
            let at = *self.index.entry(key.to_array()).or_insert(next);
            if at == next {
                self.bricks.push(Brick::new(key));
                in_reach.push(true);
            } else {
                in_reach[at] = true;
            }
        }
        let visited: usize = self
            .bricks
            .par_iter_mut()
            .zip(&in_reach)
            .filter(|(_, reach)| **reach)
            .map_init(Scratch::default, |scratch, (brick, _)| brick.add(&view, moment, scratch))
            .sum();
        self.updates += (visited * block.sweep_count()) as u64;
    }

    /// Takes note of a block that is to be added later: ticks count from the first one.
    pub(super) fn note(&mut self, block: &Block) {
        self.moment(block.mid_time_ns);
    }

    /// Makes empty bricks; those that are there stay as they are.
    pub(super) fn make(&mut self, keys: &[IVec3]) {
        for &key in keys {
            let next = self.bricks.len();
            if *self.index.entry(key.to_array()).or_insert(next) == next {
                self.bricks.push(Brick::new(key));
            }
        }
    }

    /// Adds to every brick there is those of the blocks (in time, all noted) that it lacks, by its key.
    pub(super) fn add_lacking(&mut self, blocks: &[&Block], lacks: impl Fn(&[i32; 3]) -> Range<usize> + Sync) {
        let moments: Vec<Moment> = blocks.iter().map(|block| self.moment(block.mid_time_ns)).collect();
        let views: Vec<View> = blocks.iter().map(|block| View::new(block, &self.settings, self.min_cos)).collect();
        let add = |scratch: &mut Scratch, brick: &mut Brick| -> usize {
            let lacking = lacks(&brick.key.to_array());
            let each = views[lacking.clone()].iter().zip(&moments[lacking]);
            each.map(|(view, now)| brick.add(view, *now, scratch) * view.block.sweep_count()).sum()
        };
        let updates: usize = self.bricks.par_iter_mut().map_init(Scratch::default, add).sum();
        self.updates += updates as u64;
    }

    /// Drops bricks.
    pub(super) fn close(&mut self, keys: &[[i32; 3]]) {
        for key in keys {
            if let Some(at) = self.index.remove(key) {
                self.bricks.swap_remove(at);
                if let Some(moved) = self.bricks.get(at) {
                    self.index.insert(moved.key.to_array(), at);
                }
            }
        }
    }

    /// Edge of a brick, metres.
    pub(super) fn brick_edge_m(&self) -> f64 {
        self.settings.voxel_m * EDGE as f64
    }

    /// Bricks that a box touches.
    pub(super) fn keys_around(&self, region: &Aabb) -> Vec<IVec3> {
        let edge_m = self.brick_edge_m();
        let (low, high) = ((region.min / edge_m).floor().as_ivec3(), (region.max / edge_m).floor().as_ivec3());
        let mut keys = Vec::new();
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                keys.extend((low.x..=high.x).map(|x| IVec3::new(x, y, z)));
            }
        }
        keys
    }

    /// Voxels in a box with at least that score, in brick order.
    pub(super) fn above_within(&self, region: &Aabb, min_score: f64) -> Vec<Peak> {
        let mut found = Vec::new();
        for key in self.keys_around(region) {
            let Some(&at) = self.index.get(&key.to_array()) else { continue };
            let brick = &self.bricks[at];
            let center = |n: usize| brick.center(n, self.settings.voxel_m);
            let strong = (0..VOXELS).filter_map(|n| Some((center(n), f64::from(brick.score(n)?))));
            let wanted = strong.filter(|(at, score)| *score >= min_score && region.contains(*at));
            found.extend(wanted.map(|(position_m, score)| Peak { position_m, score }));
        }
        found
    }

    fn epoch_ns(&self) -> f64 {
        self.settings.memory_s * std::f64::consts::LN_2 * f64::from(EPOCH_DOUBLINGS) * 1e9
    }

    fn moment(&mut self, time_ns: i64) -> Moment {
        let epochs = time_ns as f64 / self.epoch_ns();
        let first_epoch = *self.first_epoch.get_or_insert(epochs.floor() as i64);
        let weight = ((epochs - epochs.floor()) * f64::from(EPOCH_DOUBLINGS)).exp2() as f32;
        Moment { ticks: ticks(epochs, first_epoch), weight }
    }

    /// Ticks at a time.
    fn ticks_at(&self, time_ns: i64) -> i32 {
        self.first_epoch.map_or(0, |first_epoch| ticks(time_ns as f64 / self.epoch_ns(), first_epoch))
    }

    /// Bricks that may have a voxel in the beam.
    fn keys_in_reach(&self, view: &View) -> Vec<IVec3> {
        let edge_m = self.brick_edge_m();
        let around_m = edge_m * 3f64.sqrt() * 0.5;
        let sensor = &view.block.middle;
        let reach = DVec3::splat(self.settings.max_range_m);
        let low = ((sensor.translation - reach) / edge_m).floor().as_ivec3();
        let high = ((sensor.translation + reach) / edge_m).floor().as_ivec3();
        let may_see = |key: &IVec3| view.of_ball((key.as_dvec3() + 0.5) * edge_m, around_m) != Seen::None;
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
        brick.score(index_in_brick(voxel - key * EDGE as i32)).map(f64::from)
    }

    /// Every voxel seen since a time whose score is at least `min_score`: centre and score, in brick order.
    pub fn above(&self, min_score: f64, since_ns: i64) -> Vec<Peak> {
        let since = self.ticks_at(since_ns);
        let voxel_m = self.settings.voxel_m;
        let mut found = Vec::new();
        for brick in self.index.values().map(|&at| &self.bricks[at]) {
            let Some((scores, _)) = brick.strong_scores(min_score as f32, since) else { continue };
            for (n, &score) in scores.iter().enumerate().filter(|(_, score)| **score > f32::NEG_INFINITY) {
                found.push(Peak { position_m: brick.center(n, voxel_m), score: f64::from(score) });
            }
        }
        found
    }

    /// Local maxima: voxels of [`Field::above`] with no greater one within `radius_m`, by falling score. Bricks around which
    /// nothing changed since they were last asked for are not looked through again.
    pub fn peaks(&mut self, min_score: f64, radius_m: f64, since_ns: i64) -> Vec<Peak> {
        let since = self.ticks_at(since_ns);
        let asked = Asked { min_score, radius_m, since };
        if !self.asked.replace(asked).is_some_and(|before| asked.follows(&before)) {
            self.neighbors = Neighbors::at(&ball(radius_m / self.settings.voxel_m));
            self.bricks.iter_mut().for_each(|brick| brick.found = Found::default());
        }
        self.bricks.par_iter_mut().for_each(|brick| brick.find_strong(min_score as f32, since));
        let new: Vec<Option<Vec<Peak>>> = self.bricks.par_iter().map(|brick| self.new_peaks(brick)).collect();
        let mut peaks: Vec<Peak> = Vec::new();
        for (brick, new) in self.bricks.iter_mut().zip(new) {
            if let Some(new) = new {
                brick.found.peaks = new;
            }
            peaks.extend(&brick.found.peaks);
        }
        // Equal scores fall back to the place, so that the order is always the same.
        peaks.sort_by(|p, q| {
            let (a, b) = (p.position_m, q.position_m);
            let by_place = || a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z));
            q.score.total_cmp(&p.score).then_with(by_place)
        });
        peaks
    }

    fn brick_at(&self, key: IVec3) -> Option<&Brick> {
        Some(&self.bricks[*self.index.get(&key.to_array())?])
    }

    /// The brick's maxima, if they may be others than before.
    fn new_peaks(&self, brick: &Brick) -> Option<Vec<Peak>> {
        let Some(strong) = &brick.found.strong else {
            return (!brick.found.peaks.is_empty()).then(Vec::new);
        };
        let around: [Option<&Brick>; 27] = std::array::from_fn(|n| self.brick_at(brick.key + cube(n as i32)));
        around.iter().flatten().any(|brick| brick.found.has_changed).then(|| self.peaks_of(brick, strong, &around))
    }

    fn peaks_of(&self, brick: &Brick, mine: &Strong, around: &[Option<&Brick>; 27]) -> Vec<Peak> {
        let around = around.map(|brick| brick?.found.strong.as_deref());
        let mut peaks = Vec::new();
        let mut test = |n: usize, score: f32| {
            // Of equal neighbours the one that comes first counts as the greater.
            let greater = |neighbor: &Neighbor| {
                around[usize::from(neighbor.brick)].is_some_and(|scores| {
                    let other = scores[usize::from(neighbor.voxel)];
                    other > score || (other == score && neighbor.comes_first)
                })
            };
            if !self.neighbors.nearest[n].iter().any(greater) && !self.neighbors.others[n].iter().any(greater) {
                peaks.push(Peak { position_m: brick.center(n, self.settings.voxel_m), score: f64::from(score) });
            }
        };
        match self.neighbors.hold_cubes {
            true => greatest_of_cubes(mine, test),
            false => mine.iter().enumerate().filter(|(_, s)| **s > f32::NEG_INFINITY).for_each(|(n, s)| test(n, *s)),
        }
        peaks
    }
}

/// The greatest voxel of each 2 × 2 × 2 of a brick, of equal ones the first: no other can be a maximum over more than that.
fn greatest_of_cubes(scores: &[f32; VOXELS], mut each: impl FnMut(usize, f32)) {
    for (pair, layers) in scores.chunks_exact(2 * LANES).enumerate() {
        let (low, high) = layers.split_at(LANES);
        let of_both: Lanes = std::array::from_fn(|l| if low[l] > high[l] { low[l] } else { high[l] });
        for corner in [0, 2, 2 * COLUMNS, 2 * COLUMNS + 2] {
            let four = [0, 1, COLUMNS, COLUMNS + 1].map(|l| corner + l);
            let greatest = four.iter().fold(f32::NEG_INFINITY, |a, l| if of_both[*l] > a { of_both[*l] } else { a });
            if greatest > f32::NEG_INFINITY {
                let mut eight = four.into_iter().chain(four.map(|l| LANES + l));
                let at = eight.find(|l| layers[*l] == greatest).unwrap_or(corner);
                each(pair * 2 * LANES + at, greatest);
            }
        }
    }
}

/// Scores of a brick's voxels; −∞ below what is asked for.
type Strong = Box<[f32; VOXELS]>;

/// Ticks since the beginning of an epoch; as many as there are at most from some months on.
fn ticks(epochs: f64, first_epoch: i64) -> i32 {
    ((epochs - first_epoch as f64) * f64::from(1u32 << TICKS_LOG2)).floor().clamp(0.0, f64::from(i32::MAX)) as i32
}

/// Offset of neighbour `n` of 27, each axis −1 to 1.
fn cube(n: i32) -> IVec3 {
    IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)
}

/// Voxel offsets within a radius (at most a brick's edge), nearest first.
fn ball(radius: f64) -> Vec<IVec3> {
    let reach = (radius + 1e-9).floor().min(EDGE as f64) as i32;
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

/// A voxel near another: in which of the 27 bricks around (as [`cube`] numbers them), where there, and whether it comes first.
#[derive(Debug, Clone, Copy)]
struct Neighbor {
    brick: u8,
    voxel: u16,
    comes_first: bool,
}

/// Those near every voxel of a brick, in the order in which voxels are stored.
#[derive(Debug, Default)]
struct Neighbors {
    /// The nearest, apart from the others: most voxels have a greater one among them, and these few stay in the cache.
    nearest: Vec<[Neighbor; NEAREST]>,
    others: Vec<Vec<Neighbor>>,
    /// All of 2 × 2 × 2 voxels are neighbours of each other.
    hold_cubes: bool,
}

impl Neighbors {
    /// Those at these offsets, nearest first, each within a brick's edge; where there are too few, the voxel itself, which
    /// is not greater than itself.
    fn at(offsets: &[IVec3]) -> Self {
        let of = |n: usize| offsets.iter().map(move |offset| neighbor(n, *offset));
        let nearest = |n: usize| std::array::from_fn(|k| of(n).nth(k).unwrap_or_else(|| neighbor(n, IVec3::ZERO)));
        Self {
            nearest: (0..VOXELS).map(nearest).collect(),
            others: (0..VOXELS).map(|n| of(n).skip(NEAREST).collect()).collect(),
            hold_cubes: offsets.contains(&IVec3::ONE),
        }
    }
}

/// What lies at an offset of a voxel.
fn neighbor(n: usize, offset: IVec3) -> Neighbor {
    let voxel = (in_brick(n) + offset).to_array();
    // −1, 0 or 1 along each axis.
    let [x, y, z] = voxel.map(|n| n >> EDGE_LOG2);
    let inside = IVec3::from_array(voxel.map(|n| n & (EDGE as i32 - 1)));
    Neighbor {
        brick: ((z + 1) * 9 + (y + 1) * 3 + x + 1) as u8,
        voxel: index_in_brick(inside) as u16,
        comes_first: comes_first(offset),
    }
}

/// Where a voxel of a brick is stored: tile, layer, row, column.
fn index_in_brick(voxel: IVec3) -> usize {
    let [x, y, z] = voxel.to_array().map(|n| n as usize);
    ((z / 4 * 2 + y / 4) * 2 + x / 4) * 64 + z % 4 * 16 + y % 4 * 4 + x % 4
}

/// The voxel that is stored there.
fn in_brick(n: usize) -> IVec3 {
    let (tile, n) = (n / 64, n % 64);
    IVec3::new((tile % 2 * 4 + n % 4) as i32, (tile / 2 % 2 * 4 + n / 4 % 4) as i32, (tile / 4 * 4 + n / 16) as i32)
}

impl Layer {
    const EMPTY: Self = Self { a: [0.0; LANES], b: [0.0; LANES], seen: [-1; LANES] };

    /// Adds m to the lanes that were seen.
    #[inline(always)]
    fn add(&mut self, m: &Lanes, seen: &[bool; LANES], now: Moment) {
        for l in 0..LANES {
            // 2^(−doublings · epochs since), which is exact, or nothing.
            let epochs = (now.ticks >> TICKS_LOG2) - (self.seen[l] >> TICKS_LOG2);
            let exponent = (127 - EPOCH_DOUBLINGS * epochs.min(16)).max(0);
            let faded = f32::from_bits((exponent as u32) << 23);
            let log = ln_1p(m[l]) - MEAN_LOG_OF_NOISE as f32;
            let a = now.weight.mul_add(log, self.a[l] * faded);
            let b = now.weight.mul_add(now.weight, self.b[l] * (faded * faded));
            let ticks = now.ticks.max(self.seen[l]);
            (self.a[l], self.b[l], self.seen[l]) =
                if seen[l] { (a, b, ticks) } else { (self.a[l], self.b[l], self.seen[l]) };
        }
    }

    /// The greatest score, squared with its sign; −∞ when never seen.
    #[inline(always)]
    fn greatest2(&self) -> f32 {
        let mut scores2 = [f32::NEG_INFINITY; LANES];
        for ((score2, a), b) in scores2.iter_mut().zip(&self.a).zip(&self.b) {
            let of_seen = a * a.abs() / b;
            *score2 = if *b > 0.0 { of_seen } else { f32::NEG_INFINITY };
        }
        // By halves: whole vectors, where one after the other would be one lane at a time.
        let mut half = LANES / 2;
        while half > 0 {
            let (low, high) = scores2.split_at_mut(half);
            for (a, b) in low.iter_mut().zip(high) {
                *a = if *a > *b { *a } else { *b };
            }
            half /= 2;
        }
        scores2[0]
    }
}

/// Adds m to a brick's layers, each with the lanes that were seen and its number.
fn add_layers(brick: &mut Brick, seen: &[([bool; LANES], usize)], m: &[Lanes], now: Moment) {
    #[inline(always)]
    fn all(brick: &mut Brick, seen: &[([bool; LANES], usize)], m: &[Lanes], now: Moment) {
        for ((mask, at), m) in seen.iter().zip(m) {
            let layer = &mut brick.layers[*at];
            layer.add(m, mask, now);
            brick.greatest2[*at] = layer.greatest2();
        }
    }
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,fma")]
        fn avx512(brick: &mut Brick, seen: &[([bool; LANES], usize)], m: &[Lanes], now: Moment) {
            all(brick, seen, m, now);
        }
        #[target_feature(enable = "avx2,fma")]
        fn avx2(brick: &mut Brick, seen: &[([bool; LANES], usize)], m: &[Lanes], now: Moment) {
            all(brick, seen, m, now);
        }
        if is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("fma")
        {
            // SAFETY: the processor has the instructions that this copy of the code is compiled for.
            return unsafe { avx512(brick, seen, m, now) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: as above.
            return unsafe { avx2(brick, seen, m, now) };
        }
    }
    all(brick, seen, m, now);
}

/// How much of a ball a block has in its beam.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seen {
    None,
    Some,
    All,
}

/// A block and what it has in its beam.
struct View<'a> {
    block: &'a Block,
    settings: &'a BlockSettings,
    min_cos: f64,
    /// Sine of the widest angle in the beam.
    max_sin: f64,
    forward: DVec3,
}

impl<'a> View<'a> {
    fn new(block: &'a Block, settings: &'a BlockSettings, min_cos: f64) -> Self {
        let max_sin = (1.0 - min_cos * min_cos).max(0.0).sqrt();
        Self { block, settings, min_cos, max_sin, forward: block.middle.forward() }
    }

    /// Never says `None` or `All` wrongly.
    fn of_ball(&self, middle: DVec3, radius_m: f64) -> Seen {
        let radius_m = radius_m + 1e-9;
        let to = middle - self.block.middle.translation;
        let (distance_m, along_m) = (to.length(), to.dot(self.forward));
        let across_m = (distance_m * distance_m - along_m * along_m).max(0.0).sqrt();
        // How far outside the beam's cone, by its surface.
        let outside_m = across_m * self.min_cos - along_m * self.max_sin;
        let BlockSettings { min_range_m, max_range_m, .. } = *self.settings;
        if outside_m > radius_m || distance_m > max_range_m + radius_m || distance_m + radius_m < min_range_m {
            Seen::None
        } else if outside_m < -radius_m && distance_m + radius_m < max_range_m && distance_m - radius_m > min_range_m {
            Seen::All
        } else {
            Seen::Some
        }
    }
}

impl Brick {
    fn new(key: IVec3) -> Self {
        let (layers, greatest2) = (Box::new([Layer::EMPTY; LAYERS]), [f32::NEG_INFINITY; LAYERS]);
        Self { key, layers, greatest2, newest: -1, found: Found::default() }
    }

    fn center(&self, n: usize, voxel_m: f64) -> DVec3 {
        (self.key.as_dvec3() * EDGE as f64 + in_brick(n).as_dvec3() + 0.5) * voxel_m
    }

    fn score(&self, n: usize) -> Option<f32> {
        let layer = &self.layers[n / LANES];
        let (a, b) = (layer.a[n % LANES], layer.b[n % LANES]);
        (b > 0.0).then(|| a / b.sqrt())
    }

    /// Brings the strong voxels up to date.
    fn find_strong(&mut self, min_score: f32, since: i32) {
        let holds = self.found.is_current && (self.found.strong.is_none() || self.found.oldest >= since);
        self.found.has_changed = false;
        if !holds {
            let found = self.strong_scores(min_score, since);
            self.found.has_changed = found.is_some() || self.found.strong.is_some();
            (self.found.strong, self.found.oldest) = found.map_or((None, 0), |(strong, oldest)| (Some(strong), oldest));
            self.found.is_current = true;
        }
    }

    /// Scores of at least that much, seen since then, and when the one was seen that was not seen for longest; `None` without
    /// any.
    fn strong_scores(&self, min_score: f32, since: i32) -> Option<(Strong, i32)> {
        if self.newest < since {
            return None;
        }
        // Few layers have a strong voxel; the others' voxels are not even read.
        let least2 = min_score * min_score.abs();
        let may_be = |greatest2: f32| greatest2 + 1e-5 * (greatest2.abs() + least2.abs()) >= least2;
        if !self.greatest2.iter().any(|greatest2| may_be(*greatest2)) {
            return None;
        }
        let mut scores = [f32::NEG_INFINITY; VOXELS];
        let mut oldest = None;
        let layers = self.layers.iter().zip(&self.greatest2).zip(scores.chunks_exact_mut(LANES));
        for ((layer, _), scores) in layers.filter(|((_, greatest2), _)| may_be(**greatest2)) {
            for (l, held) in scores.iter_mut().enumerate() {
                let score = layer.a[l] / layer.b[l].sqrt();
                if (layer.b[l] > 0.0) & (score >= min_score) & (layer.seen[l] >= since) {
                    *held = score;
                    oldest = Some(oldest.map_or(layer.seen[l], |oldest: i32| oldest.min(layer.seen[l])));
                }
            }
        }
        oldest.map(|oldest| (Box::new(scores), oldest))
    }

    /// Adds a block to the voxels in its beam; returns how many there were.
    fn add(&mut self, view: &View, moment: Moment, scratch: &mut Scratch) -> usize {
        let tiles = tiles_in_box(view.block.box_reach_m(), view.settings.voxel_m);
        let each = (0..LAYERS / TILE_LAYERS).step_by(tiles);
        match tiles {
            1 => each.map(|tile| self.add_to_box::<TILE_LAYERS>(view, moment, scratch, tile)).sum(),
            4 => each.map(|tile| self.add_to_box::<{ 4 * TILE_LAYERS }>(view, moment, scratch, tile)).sum(),
            _ => each.map(|tile| self.add_to_box::<LAYERS>(view, moment, scratch, tile)).sum(),
        }
    }

    /// Adds to `N` layers from tile `first` on, as one box. (For each `N` a copy of its own: most boxes have few layers, and
    /// room for many would be cleared for nothing.)
    fn add_to_box<const N: usize>(
        &mut self,
        view: &View,
        moment: Moment,
        scratch: &mut Scratch,
        first: usize,
    ) -> usize {
        let voxel_m = view.settings.voxel_m;
        let first_layer = first * TILE_LAYERS;
        let low = self.center(first_layer * LANES, voxel_m);
        let high = self.center((first_layer + N) * LANES - 1, voxel_m);
        let (middle, radius_m) = ((low + high) * 0.5, low.distance(high) * 0.5);
        let of_box = view.of_ball(middle, radius_m);
        if of_box == Seen::None {
            return 0;
        }
        let mut seen = [([true; LANES], 0usize); N];
        let mut corners = [[0.0f32; 3]; N];
        let mut count = 0;
        let mut visited = 0;
        for layer in first_layer..first_layer + N {
            let corner = self.center(layer * LANES, voxel_m);
            let mask = if of_box == Seen::All { [true; LANES] } else { view.of_layer(corner) };
            let lanes = mask.iter().filter(|seen| **seen).count();
            if lanes > 0 {
                (seen[count], corners[count]) = ((mask, layer), (corner - middle).as_vec3().to_array());
                (count, visited) = (count + 1, visited + lanes);
            }
        }
        if count == 0 {
            return 0;
        }
        let mut m = [[0.0; LANES]; N];
        let distance_m = middle.distance(view.block.middle.translation);
        let nearest_m = (distance_m - radius_m).max(view.settings.min_range_m);
        let farthest_m = (distance_m + radius_m).min(view.settings.max_range_m);
        let middle_m = (middle - view.block.middle.translation).as_vec3().to_array();
        if radius_m as f32 <= view.block.box_reach_m() && view.block.covers(nearest_m as f32, farthest_m as f32) {
            let layers_m = &corners[..count];
            let voxels = VoxelBox { middle_m, voxel_m: voxel_m as f32, radius_m: radius_m as f32, layers_m };
            view.block.coherence_in_box(&voxels, scratch, &mut m[..count]);
        } else {
            for ((_, layer), m) in seen[..count].iter().zip(&mut m) {
                let place = |l: usize| self.center(layer * LANES + l, voxel_m) - view.block.middle.translation;
                let places: [_; LANES] = std::array::from_fn(|l| place(l).as_vec3().to_array());
                *m = std::array::from_fn(|_| 0.0);
                m.iter_mut().zip(view.block.coherence_at_points(&places)).for_each(|(m, c)| *m = c.m);
            }
        }
        add_layers(self, &seen[..count], &m, moment);
        self.newest = self.newest.max(moment.ticks);
        self.found.is_current = false;
        visited
    }
}

/// Tiles of 4³ voxels that one box may hold: all eight, the four of a storey, or one.
fn tiles_in_box(reach_m: f32, voxel_m: f64) -> usize {
    let radius = |x: f64, y: f64, z: f64| (DVec3::new(x, y, z) * voxel_m * 0.5).length() as f32 * 1.000_01;
    if radius(7.0, 7.0, 7.0) <= reach_m {
        8
    } else if radius(7.0, 7.0, 3.0) <= reach_m {
        4
    } else {
        1
    }
}

impl View<'_> {
    /// Which voxels of a layer are in the beam, lane 0 at `corner`: [`BlockSettings::sees`] sixteen at a time.
    #[inline(always)]
    fn lanes_seen(&self, corner: DVec3) -> [bool; LANES] {
        let BlockSettings { voxel_m, min_range_m, max_range_m, .. } = *self.settings;
        let (forward, to) = (self.forward, corner - self.block.middle.translation);
        let (min2, max2) = (min_range_m * min_range_m, max_range_m * max_range_m);
        let cos2 = self.min_cos * self.min_cos.abs();
        let mut seen = [false; LANES];
        for l in 0..LANES {
            let (x, y) = (to.x + COLUMN[l] * voxel_m, to.y + ROW[l] * voxel_m);
            let along = x * forward.x + y * forward.y + to.z * forward.z;
            let distance2 = x * x + y * y + to.z * to.z;
            seen[l] = (distance2 >= min2) & (distance2 <= max2) & (along * along.abs() >= cos2 * distance2);
        }
        seen
    }

    /// The same, compiled for what the processor has.
    fn of_layer(&self, corner: DVec3) -> [bool; LANES] {
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
            fn avx512(view: &View, corner: DVec3) -> [bool; LANES] {
                view.lanes_seen(corner)
            }
            if is_x86_feature_detected!("avx512dq") && is_x86_feature_detected!("avx512vl") {
                // SAFETY: the processor has the instructions that this copy of the code is compiled for.
                return unsafe { avx512(self, corner) };
            }
        }
        self.lanes_seen(corner)
    }
}

/// Where in a layer of 4 × 4 a lane lies.
const COLUMN: [f64; LANES] = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const ROW: [f64; LANES] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

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
        let mut field = field(observations.clone());
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
    fn maxima_found_look_by_look_are_those_of_a_first_look() {
        let blocks = blocks(sweeps(3.0, winding, &[(Echo::Point(CHAIR), 1.0), (Echo::Point(DVec3::NEG_Z), 0.5)], 5));
        let settings = BlockSettings::default();
        let new = || Field::new(settings, settings.min_cos(&Beam::Lensless));
        let mut field = new();
        let mut found = 0;
        for n in 0..blocks.len() {
            field.add(&blocks[n]);
            // Now and then two blocks between looks; what was seen long ago counts no more; other questions in between.
            if n % 3 == 1 {
                continue;
            }
            let since_ns = blocks[n].mid_time_ns - 800_000_000;
            let mut fresh = new();
            blocks[..=n].iter().for_each(|block| fresh.add(block));
            for (min_score, radius_m) in [(1.5, 0.15), (2.5, 0.2), (1.5, 0.05)].into_iter().take(1 + 2 * (n / 10 % 2)) {
                let peaks = field.peaks(min_score, radius_m, since_ns);
                let slow = slow_peaks(&fresh, min_score, radius_m, since_ns);
                assert_eq!(peaks, slow, "block {n}, from {min_score}, {radius_m} m");
                found += peaks.len();
            }
        }
        assert!(found > 500, "{found}");
    }

    /// Maxima by their definition.
    fn slow_peaks(field: &Field, min_score: f64, radius_m: f64, since_ns: i64) -> Vec<Peak> {
        let above = field.above(min_score, since_ns);
        let before = |a: DVec3, b: DVec3| (a.z, a.y, a.x) < (b.z, b.y, b.x);
        let greater = |p: &Peak, q: &Peak| {
            let apart_m = p.position_m.distance(q.position_m);
            let comes_first = before((q.position_m / 0.01).round(), (p.position_m / 0.01).round());
            (apart_m < radius_m + 1e-6 && apart_m > 0.0) && (q.score > p.score || (q.score == p.score && comes_first))
        };
        let is_peak = |p: &&Peak| !above.iter().any(|q| greater(p, q));
        let mut peaks: Vec<Peak> = above.iter().filter(is_peak).copied().collect();
        peaks.sort_by(|p, q| {
            let key = |p: &Peak| (p.position_m.x, p.position_m.y, p.position_m.z);
            q.score.total_cmp(&p.score).then_with(|| key(p).partial_cmp(&key(q)).unwrap())
        });
        peaks
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
        let (mut straight, turned) = (field(echo.clone()), field(conjugated(echo)));
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
    fn a_rolling_field_is_a_fresh_one_of_what_saw_the_voxel() {
        // Head turned away for a while, over several epochs; another field begins in the middle of it.
        let settings = BlockSettings { memory_s: 0.02, ..BlockSettings::default() };
        let new = || Field::new(settings, settings.min_cos(&Beam::Lensless));
        let blocks = blocks(sweeps(1.5, winding, &[(Echo::Point(CHAIR), 1.0)], 6));
        let mut away = blocks.clone();
        away.iter_mut().for_each(|b| b.middle.rotation = glam::DQuat::from_rotation_y(std::f64::consts::PI));
        let (mut rolling, mut fresh) = (new(), new());
        for n in 0..blocks.len() {
            if (5..10).contains(&n) {
                rolling.add(&away[n]);
            } else {
                rolling.add(&blocks[n]);
                fresh.add(&blocks[n]);
            }
        }
        let ahead = Aabb { min: CHAIR - 0.3, max: CHAIR + 0.3 };
        let found = rolling.above_within(&ahead, -99.0);
        assert!(found.len() > 1000);
        assert_eq!(found, fresh.above_within(&ahead, -99.0));
        // What lies before the head began to look there is forgotten, and does not matter.
        let mut late = new();
        blocks[8..].iter().for_each(|block| late.add(block));
        let mut anew = new();
        anew.make(&late.keys_around(&ahead));
        anew.note(&blocks[8]);
        anew.add_lacking(&blocks[8..].iter().collect::<Vec<_>>(), |_| 0..blocks.len() - 8);
        assert_eq!(late.above_within(&ahead, -99.0), anew.above_within(&ahead, -99.0));
    }

    #[test]
    fn a_hundred_thousand_blocks_with_bursts_agree_with_f64() {
        let mut field = Field::new(BlockSettings::default(), 0.5);
        let mut layer = Layer::EMPTY;
        let (mut a, mut b, mut before_ns) = ([0.0f64; LANES], [0.0f64; LANES], 0i64);
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut time_ns = 3_000_000_000_000;
        for n in 0..200_000u64 {
            // 90 ms, now and then a pause of minutes; m exponential, with bursts.
            time_ns += if n % 5000 == 4999 { 200_000_000_000 } else { 90_909_091 };
            let burst = if n % 977 < 3 { 1e4 } else { 1.0 };
            let m: Lanes = std::array::from_fn(|_| (-(1.0 - uniform()).ln() * burst) as f32);
            layer.add(&m, &[true; LANES], field.moment(time_ns));
            let rho = (-((time_ns - before_ns) as f64 * 1e-9) / field.settings.memory_s).exp();
            before_ns = time_ns;
            for l in 0..LANES {
                a[l] = rho * a[l] + f64::from(m[l]).ln_1p() - MEAN_LOG_OF_NOISE;
                b[l] = rho * rho * b[l] + 1.0;
                if n % 97 == 0 {
                    let (score, exact) = (f64::from(layer.a[l] / layer.b[l].sqrt()), a[l] / b[l].sqrt());
                    assert!((score - exact).abs() < 3e-5, "block {n}: {score} {exact}");
                }
            }
        }
        // What is no number never reaches a sum.
        let held = layer.a;
        layer.add(&[f32::NAN; LANES], &[true; LANES], field.moment(time_ns));
        let expected = held.map(|a| a - MEAN_LOG_OF_NOISE as f32 * field.moment(time_ns).weight);
        assert!(layer.a.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3 * b.abs().max(1.0)));
    }

    #[test]
    fn a_place_never_seen_has_no_score() {
        assert_eq!(field(sweeps(0.2, winding, &[], 1)).score_at(DVec3::Z * 2.0), None);
    }
}
