//! Sub-aperture scores of all voxels that were ever in the beam, in bricks of 8 × 8 × 8.
//!
//! Each voxel holds A, B and the time it was last in the beam; its score is A/√B. A voxel outside
//! the beam keeps its score. Evidence decays by weighting new evidence more: a sub-aperture at time
//! t has weight g = e^(t/memory), which leaves A/√B as if all older evidence had decayed. To keep g
//! small, time is divided into epochs in which it grows 256-fold. From epoch to epoch A and B are
//! divided by powers of two, which is exact. A voxel's state is therefore a function of the
//! sub-apertures that had it in the beam, and of nothing else: neither of when the field began, nor
//! of sub-apertures that missed it. A field rebuilt from the same sub-apertures is the same, bit
//! for bit.

mod layer;
mod maxima;
mod view;

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::brick::{Scratch, VoxelBox};
use super::{Subaperture, SubapertureSettings};
use crate::geometry::Aabb;
use crate::math;
use crate::simd::{LANES, on_widest};

use layer::{AddLayers, EPOCH_DOUBLINGS, Layer, Moment, TICKS_LOG2};
pub use maxima::Peak;
use maxima::{BrickPeaks, Neighbors, PeakQuery};
use view::{BeamView, Coverage};

/// Voxels along a brick's edge. Choice: 0.5 m at the default voxel, of which the beam mostly holds
/// all or nothing.
const EDGE: usize = 8;
const EDGE_LOG2: i32 = 3;
/// Voxels in a brick.
const VOXELS: usize = EDGE * EDGE * EDGE;
/// Layers of 4 × 4 voxels in a brick. Four stacked layers form a tile, and a brick's voxels are
/// stored tile by tile.
const LAYERS: usize = VOXELS / LANES;
const TILE_LAYERS: usize = 4;

#[derive(Debug)]
struct Brick {
    /// Brick coordinates: its lowest voxel is `key · EDGE`.
    key: IVec3,
    layers: Box<[Layer; LAYERS]>,
    /// Each layer's greatest score, squared with its sign; −∞ when never in the beam.
    greatest2: [f32; LAYERS],
    /// Latest time at which any of its voxels was in the beam, ticks.
    newest: i32,
    /// Result of the last search for maxima in it.
    found: BrickPeaks,
}

/// Scores over space.
#[derive(Debug)]
pub struct Field {
    settings: SubapertureSettings,
    min_cos: f64,
    /// Epoch of the first sub-aperture: ticks count from its beginning.
    first_epoch: Option<i64>,
    bricks: Vec<Brick>,
    index: BTreeMap<[i32; 3], usize>,
    /// Parameters of the last search for maxima, and every voxel's neighbours within its radius.
    last_query: Option<PeakQuery>,
    neighbors: Neighbors,
    /// (voxel, sweep) pairs summed so far.
    pub updates: u64,
}

impl Field {
    /// An empty field. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: SubapertureSettings, min_cos: f64) -> Self {
        let (bricks, index) = (Vec::new(), BTreeMap::new());
        let (last_query, neighbors) = (None, Neighbors::default());
        Self { settings, min_cos, first_epoch: None, bricks, index, last_query, neighbors, updates: 0 }
    }

    /// Number of bricks that were ever in the beam.
    pub fn brick_count(&self) -> usize {
        self.bricks.len()
    }

    /// Adds a sub-aperture to every voxel in its beam. Voxels are independent, so the bits are the
    /// same on any number of threads.
    pub fn add(&mut self, block: &Subaperture) {
        let moment = self.moment(block.mid_time_ns);
        let view = BeamView::new(block, &self.settings, self.min_cos);
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
        // Only those in reach, so that the parallel loop divides evenly.
        let reached = self.bricks.iter_mut().zip(in_reach).filter(|(_, is_in_reach)| *is_in_reach);
        let mut reached: Vec<&mut Brick> = reached.map(|(brick, _)| brick).collect();
        let add = |scratch: &mut Scratch, brick: &mut &mut Brick| brick.add(&view, moment, scratch);
        let visited: usize = reached.par_iter_mut().map_init(Scratch::default, add).sum();
        self.updates += (visited * block.sweep_count()) as u64;
    }

    /// Registers the time of a sub-aperture that is added later: ticks count from the first one.
    pub(super) fn register_time(&mut self, block: &Subaperture) {
        self.moment(block.mid_time_ns);
    }

    /// Inserts empty bricks; existing ones stay as they are.
    pub(super) fn insert_bricks(&mut self, keys: &[IVec3]) {
        for &key in keys {
            let next = self.bricks.len();
            if *self.index.entry(key.to_array()).or_insert(next) == next {
                self.bricks.push(Brick::new(key));
            }
        }
    }

    /// Adds to every existing brick the sub-apertures it is missing, given by its key as a range of
    /// `blocks` (in time order, all registered).
    pub(super) fn add_missing(&mut self, blocks: &[&Subaperture], missing: impl Fn(&[i32; 3]) -> Range<usize>) {
        let moments: Vec<Moment> = blocks.iter().map(|block| self.moment(block.mid_time_ns)).collect();
        let views: Vec<BeamView> =
            blocks.iter().map(|block| BeamView::new(block, &self.settings, self.min_cos)).collect();
        // Only those that lack something, so that the parallel loop divides evenly.
        let lacking = self.bricks.iter_mut().map(|brick| (missing(&brick.key.to_array()), brick));
        let mut lacking: Vec<(Range<usize>, &mut Brick)> = lacking.filter(|(blocks, _)| !blocks.is_empty()).collect();
        let add = |scratch: &mut Scratch, (blocks, brick): &mut (Range<usize>, &mut Brick)| -> usize {
            let each = views[blocks.clone()].iter().zip(&moments[blocks.clone()]);
            each.map(|(view, now)| brick.add(view, *now, scratch) * view.block.sweep_count()).sum()
        };
        let updates: usize = lacking.par_iter_mut().map_init(Scratch::default, add).sum();
        self.updates += updates as u64;
    }

    /// Removes bricks.
    pub(super) fn close(&mut self, keys: &[[i32; 3]]) {
        // Removing bricks can change maxima next to them.
        self.last_query = None;
        for key in keys {
            if let Some(at) = self.index.remove(key) {
                self.bricks.swap_remove(at);
                if let Some(moved) = self.bricks.get(at) {
                    self.index.insert(moved.key.to_array(), at);
                }
            }
        }
    }

    /// Empties a brick.
    pub(super) fn clear(&mut self, key: &[i32; 3]) {
        // That can change maxima next to it.
        self.last_query = None;
        if let Some(&at) = self.index.get(key) {
            self.bricks[at] = Brick::new(self.bricks[at].key);
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

    /// Voxels within a box with at least that score, in brick order.
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
        self.settings.decay_s * std::f64::consts::LN_2 * f64::from(EPOCH_DOUBLINGS) * 1e9
    }

    fn moment(&mut self, time_ns: i64) -> Moment {
        let epochs = time_ns as f64 / self.epoch_ns();
        let first_epoch = *self.first_epoch.get_or_insert(epochs.floor() as i64);
        let weight = math::exp2((epochs - epochs.floor()) * f64::from(EPOCH_DOUBLINGS)) as f32;
        Moment { ticks: ticks(epochs, first_epoch), weight }
    }

    /// Ticks at a time.
    fn ticks_at(&self, time_ns: i64) -> i32 {
        self.first_epoch.map_or(0, |first_epoch| ticks(time_ns as f64 / self.epoch_ns(), first_epoch))
    }

    /// Bricks that may have a voxel in the beam.
    fn keys_in_reach(&self, view: &BeamView) -> Vec<IVec3> {
        let edge_m = self.brick_edge_m();
        let around_m = edge_m * 3f64.sqrt() * 0.5;
        let sensor = &view.block.middle;
        let reach = DVec3::splat(self.settings.max_range_m);
        let low = ((sensor.translation - reach) / edge_m).floor().as_ivec3();
        let high = ((sensor.translation + reach) / edge_m).floor().as_ivec3();
        let may_see = |key: &IVec3| view.sphere_coverage((key.as_dvec3() + 0.5) * edge_m, around_m) != Coverage::None;
        let range = |a: i32, b: i32| a..=b;
        range(low.z, high.z)
            .flat_map(|z| {
                range(low.y, high.y).flat_map(move |y| range(low.x, high.x).map(move |x| IVec3::new(x, y, z)))
            })
            .filter(may_see)
            .collect()
    }

    /// Score of the voxel that contains a point; `None` where it was never in the beam.
    pub fn score_at(&self, place: DVec3) -> Option<f64> {
        let voxel = (place / self.settings.voxel_m).floor().as_ivec3();
        let key = voxel.map(|n| n.div_euclid(EDGE as i32));
        let brick = &self.bricks[*self.index.get(&key.to_array())?];
        brick.score(index_in_brick(voxel - key * EDGE as i32)).map(f64::from)
    }

    /// Where the scores around a voxel that is a maximum have theirs, to a quarter of a voxel: the summit of a parabola
    /// through three voxels along each axis. Rounded, so that it mostly stays where it is from update to update.
    pub fn summit(&self, peak: &Peak) -> DVec3 {
        const STEPS: f64 = 4.0;
        let voxel_m = self.settings.voxel_m;
        let along = |axis: DVec3| {
            let at = |steps: f64| self.score_at(peak.position_m + axis * (steps * voxel_m));
            let (Some(before), Some(after)) = (at(-1.0), at(1.0)) else { return 0.0 };
            let bend = 2.0 * peak.score - before - after;
            let off = if bend > 0.0 { 0.5 * (after - before) / bend } else { 0.0 };
            (off.clamp(-0.5, 0.5) * STEPS).round() / STEPS
        };
        peak.position_m + DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) * voxel_m
    }

    /// Every voxel in the beam since `since_ns` with a score of at least `min_score`: centre and
    /// score, in brick order.
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
}

/// Ticks since the beginning of an epoch; saturates after three days at the default decay.
fn ticks(epochs: f64, first_epoch: i64) -> i32 {
    ((epochs - first_epoch as f64) * f64::from(1u32 << TICKS_LOG2)).floor().clamp(0.0, f64::from(i32::MAX)) as i32
}

/// Storage index of a voxel in a brick: tile, layer, row, column.
fn index_in_brick(voxel: IVec3) -> usize {
    let [x, y, z] = voxel.to_array().map(|n| n as usize);
    ((z / 4 * 2 + y / 4) * 2 + x / 4) * 64 + z % 4 * 16 + y % 4 * 4 + x % 4
}

/// The voxel at a storage index.
fn in_brick(n: usize) -> IVec3 {
    let (tile, n) = (n / 64, n % 64);
    IVec3::new((tile % 2 * 4 + n % 4) as i32, (tile / 2 % 2 * 4 + n / 4 % 4) as i32, (tile / 4 * 4 + n / 16) as i32)
}

impl Brick {
    fn new(key: IVec3) -> Self {
        let (layers, greatest2) = (Box::new([Layer::EMPTY; LAYERS]), [f32::NEG_INFINITY; LAYERS]);
        Self { key, layers, greatest2, newest: -1, found: BrickPeaks::default() }
    }

    fn center(&self, n: usize, voxel_m: f64) -> DVec3 {
        (self.key.as_dvec3() * EDGE as f64 + in_brick(n).as_dvec3() + 0.5) * voxel_m
    }

    fn score(&self, n: usize) -> Option<f32> {
        let layer = &self.layers[n / LANES];
        let (a, b) = (layer.a[n % LANES], layer.b[n % LANES]);
        (b > 0.0).then(|| a / b.sqrt())
    }

    /// Adds a sub-aperture to the voxels in its beam; returns their number.
    fn add(&mut self, view: &BeamView, moment: Moment, scratch: &mut Scratch) -> usize {
        let tiles = tiles_in_box(view.block.box_reach_m(), view.settings.voxel_m);
        let each = (0..LAYERS / TILE_LAYERS).step_by(tiles);
        match tiles {
            1 => each.map(|tile| self.add_to_box::<TILE_LAYERS>(view, moment, scratch, tile)).sum(),
            4 => each.map(|tile| self.add_to_box::<{ 4 * TILE_LAYERS }>(view, moment, scratch, tile)).sum(),
            _ => each.map(|tile| self.add_to_box::<LAYERS>(view, moment, scratch, tile)).sum(),
        }
    }

    /// Adds to `N` layers from tile `first` on, as one box. Each `N` is compiled separately: most
    /// boxes have few layers, and initialising room for many would be wasted.
    fn add_to_box<const N: usize>(
        &mut self,
        view: &BeamView,
        moment: Moment,
        scratch: &mut Scratch,
        first: usize,
    ) -> usize {
        let voxel_m = view.settings.voxel_m;
        let first_layer = first * TILE_LAYERS;
        let low = self.center(first_layer * LANES, voxel_m);
        let high = self.center((first_layer + N) * LANES - 1, voxel_m);
        let (middle, radius_m) = ((low + high) * 0.5, low.distance(high) * 0.5);
        let of_box = view.sphere_coverage(middle, radius_m);
        if of_box == Coverage::None {
            return 0;
        }
        let mut seen = [([true; LANES], 0usize); N];
        let mut corners = [[0.0f32; 3]; N];
        let mut count = 0;
        let mut visited = 0;
        for layer in first_layer..first_layer + N {
            let corner = self.center(layer * LANES, voxel_m);
            let mask = if of_box == Coverage::All { [true; LANES] } else { view.layer_coverage(corner) };
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
        let (layers, greatest2) = (&mut self.layers, &mut self.greatest2);
        on_widest(AddLayers { layers, greatest2, seen: &seen[..count], m: &m, now: moment });
        self.newest = self.newest.max(moment.ticks);
        self.found.is_current = false;
        visited
    }
}

/// Tiles of 4³ voxels per box: all eight, the four of one half, or one.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Plane;
    use crate::subaperture::{MEAN_LOG_OF_NOISE, SubapertureBuilder};
    use crate::test_data::{Echo, conjugated, on_one_thread, sweeps, winding};
    use crate::{Beam, Observation};
    use crate::{Oracle, Statistic};

    const CHAIR: DVec3 = DVec3::new(0.225, 0.125, -1.175);

    fn blocks(observations: Vec<Observation>) -> Vec<Subaperture> {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        let mut blocks: Vec<_> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        blocks.extend(builder.close());
        blocks
    }

    fn field(observations: Vec<Observation>) -> Field {
        let settings = SubapertureSettings::default();
        let mut field = Field::new(settings, settings.min_cos(&Beam::Lensless));
        blocks(observations).iter().for_each(|block| field.add(block));
        field
    }

    #[test]
    fn scores_agree_with_the_oracle() {
        let echoes = [(Echo::Point(CHAIR), 1.0), (Echo::Point(DVec3::new(-0.4, -0.2, -1.6)), 3.0)];
        let observations = sweeps(0.3, winding, &echoes, 1);
        let oracle = Oracle::new(&observations, &Beam::Lensless, &SubapertureSettings::default());
        let mut field = field(observations.clone());
        let peaks = field.peaks(-9.0, 0.15, 0);
        assert!(peaks.len() > 50);
        // The field decays when a voxel is seen again, the oracle up to the newest sweep: both are
        // equal where a voxel is in the beam all the time.
        let most = peaks[0].score;
        for peak in peaks.iter().take(20).chain(peaks.iter().rev().take(20)) {
            let exact = oracle.value(Statistic::Subaperture, peak.position_m);
            assert!((peak.score - exact).abs() < 0.02 * most, "{peak:?} {exact}");
        }
        assert_eq!(oracle.value(Statistic::Subaperture, DVec3::Z), 0.0);
    }

    #[test]
    fn incremental_maxima_equal_those_of_a_fresh_search() {
        let blocks = blocks(sweeps(3.0, winding, &[(Echo::Point(CHAIR), 1.0), (Echo::Point(DVec3::NEG_Z), 0.5)], 5));
        let settings = SubapertureSettings::default();
        let new = || Field::new(settings, settings.min_cos(&Beam::Lensless));
        let mut field = new();
        let mut found = 0;
        for n in 0..blocks.len() {
            field.add(&blocks[n]);
            // Sometimes two sub-apertures between searches; a time limit; other search parameters
            // in between.
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

    #[test]
    fn summit_is_nearer_to_the_echo_than_the_voxel() {
        let voxel_m = SubapertureSettings::default().voxel_m;
        let (mut voxels_off_m, mut summits_off_m) = (0.0, 0.0);
        for share in [-0.4, -0.2, 0.0, 0.2, 0.4] {
            let at = ((CHAIR / voxel_m).floor() + 0.5 + DVec3::new(0.0, 0.0, share)) * voxel_m;
            let mut field = field(sweeps(0.9, winding, &[(Echo::Point(at), 3.0)], 9));
            let peak = field.peaks(6.0, 0.15, 0)[0];
            let summit = field.summit(&peak);
            let steps = (summit - peak.position_m) / voxel_m * 4.0;
            assert!((steps - steps.round()).abs().max_element() < 1e-9 && steps.abs().max_element() <= 2.0, "{steps}");
            voxels_off_m += (peak.position_m - at).z.abs();
            summits_off_m += (summit - at).z.abs();
        }
        assert!(summits_off_m < 0.6 * voxels_off_m, "{summits_off_m} {voxels_off_m}");
        let nowhere = Peak { position_m: DVec3::Z * 2.0, score: 5.0 };
        assert_eq!(field(sweeps(0.2, winding, &[], 1)).summit(&nowhere), nowhere.position_m);
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
    fn noise_and_conjugated_echoes_score_low() {
        for seed in 0..3 {
            let noise = field(sweeps(0.6, winding, &[], seed)).peaks(0.0, 0.15, 0);
            // Among a few thousand voxels the greatest may lie a few standard deviations up.
            assert!(noise[0].score < 4.5, "{:?}", noise[0]);
        }
        let echo = sweeps(0.6, winding, &[(Echo::Point(CHAIR), 1.0)], 4);
        let (mut straight, turned) = (field(echo.clone()), field(conjugated(echo)));
        assert!(straight.score_at(CHAIR).unwrap() > 6.0);
        let strongest = straight.peaks(6.0, 0.15, 0)[0];
        assert!(straight.summit(&strongest).distance(CHAIR) < 0.05, "{strongest:?}");
        assert!(turned.score_at(CHAIR).unwrap() < 3.0);
    }

    #[test]
    fn wall_20_db_stronger_keeps_most_of_a_chairs_score() {
        // Behind the chair. Where both share a range cell the wall does raise the chair's
        // normalisation.
        let wall = Plane { outward: DVec3::NEG_Z, offset_m: 1.7 };
        let score = |wall_snr: f64| {
            let echoes = [(Echo::Point(CHAIR), 1.0), (Echo::Plane(wall), wall_snr)];
            field(sweeps(0.6, winding, &echoes, 5)).score_at(CHAIR).unwrap()
        };
        let (weak, strong) = (score(2.0), score(20.0));
        assert!(weak > 5.0 && strong > 0.6 * weak, "{weak} {strong}");
    }

    #[test]
    fn score_depends_only_on_subapertures_that_cover_the_voxel() {
        // Head turned away for a while, over several epochs; another field begins in the middle of
        // it.
        let settings = SubapertureSettings { decay_s: 0.02, ..SubapertureSettings::default() };
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
        assert!(found.len() > 500);
        assert_eq!(found, fresh.above_within(&ahead, -99.0));
        // Sub-apertures before the start of a late field do not matter.
        let mut late = new();
        blocks[8..].iter().for_each(|block| late.add(block));
        let mut anew = new();
        anew.insert_bricks(&late.keys_around(&ahead));
        anew.register_time(&blocks[8]);
        anew.add_missing(&blocks[8..].iter().collect::<Vec<_>>(), |_| 0..blocks.len() - 8);
        assert_eq!(late.above_within(&ahead, -99.0), anew.above_within(&ahead, -99.0));
    }

    #[test]
    fn two_hundred_thousand_updates_with_bursts_agree_with_f64() {
        let mut field = Field::new(SubapertureSettings::default(), 0.5);
        let mut layer = Layer::EMPTY;
        let (mut a, mut b, mut before_ns) = ([0.0f64; LANES], [0.0f64; LANES], 0i64);
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let mut time_ns = 3_000_000_000_000;
        for n in 0..200_000u64 {
            // 90 ms, with occasional pauses of minutes; m exponential, with bursts.
            time_ns += if n % 5000 == 4999 { 200_000_000_000 } else { 90_909_091 };
            let burst = if n % 977 < 3 { 1e4 } else { 1.0 };
            let m: [f32; LANES] = std::array::from_fn(|_| (-(1.0 - uniform()).ln() * burst) as f32);
            layer.add(&m, &[true; LANES], field.moment(time_ns));
            let rho = (-((time_ns - before_ns) as f64 * 1e-9) / field.settings.decay_s).exp();
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
        // NaN never reaches a sum.
        let held = layer.a;
        layer.add(&[f32::NAN; LANES], &[true; LANES], field.moment(time_ns));
        let expected = held.map(|a| a - MEAN_LOG_OF_NOISE as f32 * field.moment(time_ns).weight);
        assert!(layer.a.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3 * b.abs().max(1.0)));
    }

    #[test]
    fn point_never_in_the_beam_has_no_score() {
        assert_eq!(field(sweeps(0.2, winding, &[], 1)).score_at(DVec3::Z * 2.0), None);
    }
}
