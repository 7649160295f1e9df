//! What blocks say of places, remembered from one look to the next: most places and most blocks are the same as the last
//! time. A place that is not remembered is asked for block by block, many places of a block at once.

use std::collections::{BTreeMap, VecDeque};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::subaperture::{Coherence, MEAN_LOG_OF_NOISE, Subaperture};
use radar_sar::{Beam, SweepGeometry, WAVELENGTH_M};

/// A place that was not asked for is remembered for so many looks: maxima move to the voxel beside and back again.
const CACHED_UPDATES: u32 = 4;

/// A view of lower m does not say where something is.
pub(super) const SIGNIFICANT_COHERENCE: f64 = 3.0;

/// What a block says of one thing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Response {
    pub m: f64,
    /// ln(1 + m) less its mean under noise.
    pub evidence: f64,
    pub power: f64,
    pub range_m: f64,
    /// Direction towards it, unit length.
    pub toward: DVec3,
    /// Cosine of that to the sensor's way.
    pub cos: f64,
    /// Two-way power gain of beam and distance, 1 at 1 m on the axis.
    pub gain: f64,
    /// Logarithm of what a thing there returns at 1 m on the axis, over the noise; only where the view [tells](Self::is_significant).
    pub ln_strength: Option<f64>,
}

impl Response {
    /// From the block's middle pose and its way.
    pub fn new(
        (middle, motion): (&Pose, DVec3),
        coherence: Coherence,
        range_m: f64,
        toward: DVec3,
        beam: &Beam,
    ) -> Self {
        let (m, power) = (f64::from(coherence.m), f64::from(coherence.power));
        let evidence = Self::evidence_of(coherence.m);
        let amplitude = beam.amplitude(toward.dot(middle.forward()));
        let gain = (amplitude / range_m.max(0.1).powi(2)).powi(2);
        let ln_strength = (m >= SIGNIFICANT_COHERENCE).then(|| math::ln((power / gain.max(1e-12)).max(1e-12)));
        Self { m, evidence, power, range_m, toward, cos: toward.dot(motion), gain, ln_strength }
    }

    /// ln(1 + m) less its mean under noise.
    pub fn evidence_of(m: f32) -> f64 {
        math::ln_1p(f64::from(m)) - MEAN_LOG_OF_NOISE
    }

    /// The part of the power that adds up, over the noise.
    pub fn net_coherent_power(&self) -> f64 {
        self.power * self.m / (1.0 + self.m)
    }

    /// Whether it says where something is.
    pub fn is_significant(&self) -> bool {
        self.ln_strength.is_some()
    }

    /// What range and direction to the sensor's way tell of where the thing is, 1/m²: of a block that moved this way over this aperture.
    pub fn information(&self, motion: DVec3, geometry: &SweepGeometry, aperture_m: f64) -> DMat3 {
        let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        let across = (motion - self.toward * self.cos) / self.range_m.max(1e-3);
        let range_sigma_m = geometry.pulse_fwhm_m * 0.5;
        let cos_sigma = WAVELENGTH_M / (4.0 * aperture_m.max(1e-4));
        outer(self.toward) * range_sigma_m.powi(-2) + outer(across) * cos_sigma.powi(-2)
    }

    /// How far a thing of that strength would stand out of the noise and of what else there is.
    pub fn expected_m(&self, strength: f64) -> f64 {
        strength * self.gain / self.clutter()
    }

    /// How much likelier m is where there is a thing of that strength than where there is none: echoes fluctuate (Swerling's first case), so
    /// m is exponential with mean 1 + m̂ or 1. What else is in this range drowns m̂ as it drowned m.
    pub fn likelihood_ratio(&self, strength: f64) -> f64 {
        let expected_m = self.expected_m(strength);
        math::exp((self.m * expected_m / (1.0 + expected_m)).min(30.0)) / (1.0 + expected_m)
    }

    /// What else there is at the same range: energy that does not add up for this thing, over the noise; at least 1.
    pub fn clutter(&self) -> f64 {
        (self.power / self.m.max(1e-9)).max(1.0)
    }

    /// Its logarithm.
    pub fn ln_clutter(&self) -> f64 {
        math::ln(self.clutter())
    }
}

/// What is known of where a thing is, 1/m², and what these blocks' telling views add.
pub(super) fn information<'v>(
    known: DMat3,
    significant: impl Iterator<Item = (&'v Subaperture, &'v Response)>,
) -> DMat3 {
    let of_view = |(block, response): (&Subaperture, &Response)| {
        response.information(block.motion, block.geometry(), block.aperture_m)
    };
    significant.map(of_view).fold(known, |sum, one| sum + one)
}

/// 1σ of a place, all directions together, metres.
pub(super) fn sigma_m(covariance_m2: &DMat3) -> f64 {
    (covariance_m2.x_axis.x + covariance_m2.y_axis.y + covariance_m2.z_axis.z).sqrt()
}

/// What a block says of a place: a view, or nothing since the place is not in its beam; `None`: not asked.
pub(super) type CachedResponse = Option<Option<Response>>;

/// Time and subsweep tell a block.
type SubapertureKey = (i64, usize);

/// What blocks said of a place, from the block of a number on.
#[derive(Debug, Default)]
struct Row {
    updates_unqueried: u32,
    first: u64,
    cached: Vec<CachedResponse>,
}

/// What blocks said of places.
#[derive(Debug, Default)]
pub struct ResponseCache {
    /// The blocks at hand, in time, and the number of the first: blocks leave at the beginning and come at the end.
    keys: VecDeque<SubapertureKey>,
    first: u64,
    rows: BTreeMap<[u64; 3], Row>,
    /// (place, block) pairs that were looked up, and computed.
    pub hits: u64,
    /// See `hits`.
    pub misses: u64,
}

/// A place as a key.
fn key(place: DVec3) -> [u64; 3] {
    place.to_array().map(f64::to_bits)
}

impl ResponseCache {
    /// A new look at these blocks, in time.
    pub(super) fn begin_update(&mut self, blocks: &[&Subaperture]) {
        let names: VecDeque<SubapertureKey> = blocks.iter().map(|b| (b.mid_time_ns, b.geometry().subsweep)).collect();
        let gone = self.keys.iter().take_while(|name| names.front() != Some(name)).count();
        let stay = self.keys.len() - gone;
        if self.keys.range(gone..).ne(names.range(..stay.min(names.len()))) {
            self.rows.clear();
        }
        self.first += gone as u64;
        self.keys = names;
        self.rows.retain(|_, row| {
            row.updates_unqueried += 1;
            row.updates_unqueried <= CACHED_UPDATES
        });
    }

    /// What was said of a place, block by block; nothing before [`Self::query`].
    pub(super) fn cached(&self, place: DVec3) -> &[CachedResponse] {
        self.rows.get(&key(place)).map_or(&[], |row| &row.cached)
    }

    /// Asks all blocks for all places. `look`: what a block, by its place in the window, says of some.
    pub(super) fn query(&mut self, places: &[DVec3], evaluate: impl Fn(usize, &[DVec3]) -> Vec<CachedResponse> + Sync) {
        let mut rows: Vec<Row> = places.iter().map(|&place| self.take_row(place)).collect();
        let missing: Vec<Vec<usize>> = (0..self.keys.len())
            .map(|block| (0..rows.len()).filter(|&n| rows[n].cached[block].is_none()).collect())
            .collect();
        let query = |(block, missing): (usize, &Vec<usize>)| match missing.is_empty() {
            true => Vec::new(),
            false => evaluate(block, &missing.iter().map(|&n| places[n]).collect::<Vec<_>>()),
        };
        let answers: Vec<Vec<CachedResponse>> = missing.par_iter().enumerate().map(query).collect();
        self.hits += (rows.len() * missing.len() - missing.iter().map(Vec::len).sum::<usize>()) as u64;
        for (block, (missing, cached)) in missing.iter().zip(answers).enumerate() {
            self.misses += cached.iter().flatten().count() as u64;
            missing.iter().zip(cached).for_each(|(&n, cached)| rows[n].cached[block] = cached);
        }
        self.rows.extend(places.iter().map(|place| key(*place)).zip(rows));
    }

    /// The row of a place, as long as there are blocks.
    fn take_row(&mut self, place: DVec3) -> Row {
        let mut row = self.rows.remove(&key(place)).unwrap_or_default();
        let gone = self.first.saturating_sub(row.first).min(row.cached.len() as u64);
        row.cached.drain(..gone as usize);
        row.cached.resize(self.keys.len(), None);
        Row { updates_unqueried: 0, first: self.first, ..row }
    }
}
