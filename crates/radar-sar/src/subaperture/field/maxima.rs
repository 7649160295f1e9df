//! Local maxima of a field, found incrementally: bricks in whose neighbourhood nothing changed
//! since the last search are not searched again.
//!
//! A brick's strong voxels are extracted, then each is compared with its neighbours within the
//! radius. Most have a greater one next to them: of each 2 × 2 × 2 voxels only the greatest is
//! compared at all, and with its nearest neighbours first.

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::{Brick, EDGE, EDGE_LOG2, Field, VOXELS, in_brick, index_in_brick};
use crate::simd::LANES;

/// Neighbours that share a face.
const NEAREST: usize = 6;
/// Voxels in a row of a layer; they are contiguous.
const COLUMNS: usize = 4;

/// A local maximum of the score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Voxel centre, tracking frame, metres.
    pub position_m: DVec3,
    /// A/√B.
    pub score: f64,
}

/// Scores of a brick's voxels; −∞ below the least score searched.
type Strong = Box<[f32; VOXELS]>;

/// Strong voxels and maxima of a brick, kept between searches: a score changes only when a
/// sub-aperture is added.
#[derive(Debug, Default)]
pub(super) struct BrickPeaks {
    /// Nothing was added since the last search.
    pub is_current: bool,
    /// Scores of at least the least score searched, in the beam since the time searched; `None`
    /// without any.
    strong: Option<Strong>,
    /// Earliest last-seen time among the strong voxels, ticks.
    oldest: i32,
    /// `strong` changed in the last search.
    has_changed: bool,
    peaks: Vec<Peak>,
}

/// Parameters of a search for maxima.
#[derive(Debug, Clone, Copy)]
pub(super) struct PeakQuery {
    min_score: f64,
    radius_m: f64,
    since: i32,
}

impl PeakQuery {
    /// Whether the results of search `before` can be reused.
    fn follows(&self, before: &Self) -> bool {
        self.min_score == before.min_score && self.radius_m == before.radius_m && self.since >= before.since
    }
}

impl Field {
    /// Local maxima: voxels of [`Field::above`] with no greater one within `radius_m`, by falling
    /// score. Bricks in whose neighbourhood nothing changed since the last search are not searched
    /// again.
    pub fn peaks(&mut self, min_score: f64, radius_m: f64, since_ns: i64) -> Vec<Peak> {
        let since = self.ticks_at(since_ns);
        let asked = PeakQuery { min_score, radius_m, since };
        if !self.last_query.replace(asked).is_some_and(|before| asked.follows(&before)) {
            self.neighbors = Neighbors::at(&ball(radius_m / self.settings.voxel_m));
            self.bricks.iter_mut().for_each(|brick| brick.found = BrickPeaks::default());
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
        // Ties are broken by position, so the order is deterministic.
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

    /// The brick's maxima, if they may have changed.
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
            // Of equal neighbours the first one counts as the greater.
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

impl Brick {
    /// Updates the strong voxels.
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

    /// Scores of at least `min_score` in the beam since then, and the earliest last-seen time among
    /// them; `None` without any.
    pub(super) fn strong_scores(&self, min_score: f32, since: i32) -> Option<(Strong, i32)> {
        if self.newest < since {
            return None;
        }
        // Few layers have a strong voxel; voxels of the others are not read.
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
}

/// The greatest voxel of each 2 × 2 × 2 of a brick, the first of equals: no other can be a maximum
/// within a larger radius.
fn greatest_of_cubes(scores: &[f32; VOXELS], mut each: impl FnMut(usize, f32)) {
    for (pair, layers) in scores.chunks_exact(2 * LANES).enumerate() {
        let (low, high) = layers.split_at(LANES);
        let of_both: [f32; LANES] = std::array::from_fn(|l| if low[l] > high[l] { low[l] } else { high[l] });
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

/// A voxel near another: in which of the 27 surrounding bricks (as [`cube`] numbers them), its
/// index there, and whether it comes first.
#[derive(Debug, Clone, Copy)]
struct Neighbor {
    brick: u8,
    voxel: u16,
    comes_first: bool,
}

/// Neighbours of every voxel of a brick, in storage order.
#[derive(Debug, Default)]
pub(super) struct Neighbors {
    /// The nearest ones, separate from the others: most voxels have a greater one among them, and
    /// these few stay in the cache.
    nearest: Vec<[Neighbor; NEAREST]>,
    others: Vec<Vec<Neighbor>>,
    /// All of 2 × 2 × 2 voxels are neighbours of each other.
    hold_cubes: bool,
}

impl Neighbors {
    /// Neighbours at these offsets, nearest first, each within a brick's edge. Where there are too
    /// few, the voxel itself fills up: it is not greater than itself.
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

/// The neighbour at an offset of a voxel.
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
