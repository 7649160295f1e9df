//! Responses of sub-apertures to points, cached from one update to the next, because most points
//! and most sub-apertures are the same as the last time. A point that is not in the cache is
//! queried for each sub-aperture, several points at once.

use std::collections::{BTreeMap, VecDeque, vec_deque};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::subaperture::{Coherence, MEAN_LOG_OF_NOISE, Subaperture};
use radar_sar::{Beam, SweepGeometry, WAVELENGTH_M, outer};

/// Updates that a point is kept for without a query. Choice: maxima move to the next voxel and
/// back.
const CACHED_UPDATES: u32 = 4;

/// Points that one task queries. Choice: the 26 neighbours of a point are divided among four threads, and each sub-aperture is
/// still queried for several at once.
const POINTS_AT_ONCE: usize = 7;

/// A response of lower m does not measure a position. Choice: noise reaches 3 in 5 % of the
/// sub-apertures (e⁻³); higher values lose weak objects.
pub(super) const SIGNIFICANT_COHERENCE: f64 = 3.0;

/// A sub-aperture's response to a point or plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Response {
    pub m: f64,
    /// ln(1 + m) less its mean under noise.
    pub evidence: f64,
    pub power: f64,
    pub range_m: f64,
    /// Direction towards it, unit length.
    pub toward: DVec3,
    /// Cosine of that direction to the sensor's motion.
    pub cos: f64,
    /// Two-way power gain of beam and distance, 1 at 1 m on the axis.
    pub gain: f64,
    /// Logarithm of the strength that an object there has at 1 m on the axis, relative to noise;
    /// only where the response [is significant](Self::is_significant).
    pub ln_strength: Option<f64>,
}

impl Response {
    /// From the pose and the direction of motion at the middle of the sub-aperture.
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

    /// The part of the coherent power that adds up, relative to noise.
    pub fn net_coherent_power(&self) -> f64 {
        self.power * self.m / (1.0 + self.m)
    }

    /// Whether the response is significant, so that it measures a position.
    pub fn is_significant(&self) -> bool {
        self.ln_strength.is_some()
    }

    /// Information on the object's position, 1/m², from the range and from the direction relative
    /// to the sensor's motion, for a sub-aperture with this motion and aperture.
    pub fn information(&self, motion: DVec3, geometry: &SweepGeometry, aperture_m: f64) -> DMat3 {
        let across = (motion - self.toward * self.cos) / self.range_m.max(1e-3);
        let range_sigma_m = geometry.pulse_fwhm_m * 0.5;
        let cos_sigma = WAVELENGTH_M / (4.0 * aperture_m.max(1e-4));
        outer(self.toward) * range_sigma_m.powi(-2) + outer(across) * cos_sigma.powi(-2)
    }

    /// Expected m̂ of an object of that strength, relative to noise and clutter.
    pub fn expected_m(&self, strength: f64) -> f64 {
        strength * self.gain / self.clutter()
    }

    /// Likelihood of m with an object of that strength, relative to that without one. Echoes
    /// fluctuate (Swerling case 1), so m is exponential with mean 1 + m̂ or 1. Clutter at the same
    /// range lowers m̂ as it lowers m.
    pub fn likelihood_ratio(&self, strength: f64) -> f64 {
        let expected_m = self.expected_m(strength);
        math::exp((self.m * expected_m / (1.0 + expected_m)).min(30.0)) / (1.0 + expected_m)
    }

    /// Clutter at the same range: energy that does not add up for this object, relative to noise;
    /// at least 1.
    pub fn clutter(&self) -> f64 {
        (self.power / self.m.max(1e-9)).max(1.0)
    }

    /// Logarithm of the clutter.
    pub fn ln_clutter(&self) -> f64 {
        math::ln(self.clutter())
    }
}

/// Adds the information of these sub-apertures' significant responses to `known`, 1/m².
pub(super) fn information<'v>(
    known: DMat3,
    significant: impl Iterator<Item = (&'v Subaperture, &'v Response)>,
) -> DMat3 {
    let of_view = |(subaperture, response): (&Subaperture, &Response)| {
        response.information(subaperture.motion, subaperture.geometry(), subaperture.aperture_m)
    };
    significant.map(of_view).fold(known, |sum, one| sum + one)
}

/// 1σ of a point, all directions together, metres.
pub(super) fn sigma_m(covariance_m2: &DMat3) -> f64 {
    (covariance_m2.x_axis.x + covariance_m2.y_axis.y + covariance_m2.z_axis.z).sqrt()
}

/// A sub-aperture's response to a point; inner `None`: the point is not in its beam; outer `None`:
/// not queried.
pub(super) type CachedResponse = Option<Option<Response>>;

/// Time and subsweep identify a sub-aperture.
type SubapertureKey = (i64, usize);

/// The cached responses to one point, beginning at the sub-aperture of a number.
#[derive(Debug, Default)]
struct Row {
    updates_unqueried: u32,
    first: u64,
    cached: VecDeque<CachedResponse>,
}

/// The cached responses to all points.
#[derive(Debug, Default)]
pub struct ResponseCache {
    /// The sub-apertures of the window, in time, and the number of the first one. They leave at the front
    /// and come at the back.
    keys: VecDeque<SubapertureKey>,
    first: u64,
    rows: BTreeMap<[u64; 3], Row>,
    /// (point, sub-aperture) pairs found in the cache, and computed.
    pub hits: u64,
    /// See `hits`.
    pub misses: u64,
}

/// A point as a key.
fn key(point: DVec3) -> [u64; 3] {
    point.to_array().map(f64::to_bits)
}

impl ResponseCache {
    /// Begins an update with these sub-apertures, in time.
    pub(super) fn begin_update(&mut self, subapertures: &[&Subaperture]) {
        let names: VecDeque<SubapertureKey> =
            subapertures.iter().map(|b| (b.mid_time_ns, b.geometry().subsweep)).collect();
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

    /// Responses to a point, one for each sub-aperture; none before [`Self::query`].
    pub(super) fn cached(&self, point: DVec3) -> vec_deque::Iter<'_, CachedResponse> {
        self.rows.get(&key(point)).map(|row| row.cached.iter()).unwrap_or_default()
    }

    /// Queries all sub-apertures for all points. The function evaluates some points in one
    /// sub-aperture, given by its index in the window.
    pub(super) fn query(&mut self, points: &[DVec3], evaluate: impl Fn(usize, &[DVec3]) -> Vec<CachedResponse> + Sync) {
        let (first, subapertures) = (self.first, self.keys.len());
        let mut rows: Vec<Row> =
            points.iter().map(|point| self.rows.remove(&key(*point)).unwrap_or_default()).collect();
        let parts = rows.par_chunks_mut(POINTS_AT_ONCE).zip(points.par_chunks(POINTS_AT_ONCE));
        let count = |(rows, points): (&mut [Row], &[DVec3])| {
            rows.iter_mut().for_each(|row| row.move_to(first, subapertures));
            let mut lacking = Lacking::default();
            (0..subapertures).map(|index| lacking.query(rows, points, index, &evaluate)).fold([0; 2], add)
        };
        let [missing, found] = parts.map(count).reduce(|| [0; 2], add);
        self.hits += (points.len() * subapertures) as u64 - missing;
        self.misses += found;
        self.rows.extend(points.iter().map(|point| key(*point)).zip(rows));
    }
}

impl Row {
    /// Drops the sub-apertures before the first of the window, and makes room for new ones.
    fn move_to(&mut self, first: u64, subapertures: usize) {
        let gone = first.saturating_sub(self.first).min(self.cached.len() as u64);
        self.cached.drain(..gone as usize);
        self.cached.resize(subapertures, None);
        (self.first, self.updates_unqueried) = (first, 0);
    }
}

/// Points that lack a sub-aperture, in memory that is reused.
#[derive(Default)]
struct Lacking {
    rows: Vec<usize>,
    points: Vec<DVec3>,
}

impl Lacking {
    /// Queries a sub-aperture for those of the points whose rows lack it; returns how many these are, and how many were not
    /// masked.
    fn query(
        &mut self,
        rows: &mut [Row],
        points: &[DVec3],
        index: usize,
        evaluate: impl Fn(usize, &[DVec3]) -> Vec<CachedResponse>,
    ) -> [u64; 2] {
        self.rows.clear();
        self.rows.extend((0..rows.len()).filter(|&n| rows[n].cached[index].is_none()));
        if self.rows.is_empty() {
            return [0; 2];
        }
        self.points.clear();
        self.points.extend(self.rows.iter().map(|&n| points[n]));
        let answers = evaluate(index, &self.points);
        let found = answers.iter().flatten().count();
        self.rows.iter().zip(answers).for_each(|(&n, answer)| rows[n].cached[index] = answer);
        [self.rows.len(), found].map(|count| count as u64)
    }
}

fn add(a: [u64; 2], b: [u64; 2]) -> [u64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::subaperture::{SubapertureBuilder, SubapertureSettings};
    use radar_sar::test_data::{sweeps, winding};

    /// Masked in every sub-aperture.
    const MASKED: usize = 5;
    const POINTS: usize = 20;

    fn point(n: usize) -> DVec3 {
        DVec3::new(n as f64, 0.0, 0.0)
    }

    /// An answer that shows which sub-aperture and point it is of.
    fn answer(subaperture: &Subaperture, point: DVec3) -> CachedResponse {
        let coherence = Coherence { m: 4.0, power: 4.0 };
        let range_m = subaperture.mid_time_ns as f64 + point.x;
        let response =
            Response::new((&subaperture.middle, subaperture.motion), coherence, range_m, DVec3::X, &Beam::Uniform);
        (point.x != MASKED as f64).then_some(Some(response))
    }

    #[test]
    fn each_pair_is_queried_once_while_both_stay() {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        let all: Vec<Subaperture> = sweeps(1.0, winding, &[], 3).into_iter().filter_map(|o| builder.push(o)).collect();
        let all: Vec<&Subaperture> = all.iter().collect();
        let points: Vec<DVec3> = (0..POINTS).map(point).collect();
        let mut cache = ResponseCache::default();
        let mut update = |window: &[&Subaperture], points: &[DVec3]| {
            let before = (cache.hits, cache.misses);
            cache.begin_update(window);
            cache.query(points, |index, some| some.iter().map(|&at| answer(window[index], at)).collect());
            for &at in points {
                let ranges_m = cache.cached(at).map(|cached| cached.flatten().map(|response| response.range_m));
                let expected = window.iter().map(|one| answer(one, at).flatten().map(|response| response.range_m));
                assert!(ranges_m.eq(expected), "{at}");
            }
            (cache.hits - before.0, cache.misses - before.1)
        };
        let seen = POINTS as u64 - 1;
        assert_eq!(update(&all[..6], &points), (0, 6 * seen));
        // Two sub-apertures go and come; one point is asked for twice, and another one is new.
        let more = [&points[..], &[point(3), point(POINTS)]].concat();
        assert_eq!(update(&all[2..8], &more), (4 * seen, 2 * seen + 6 + 6));
        assert_eq!(update(&all[2..8], &points), (6 * seen, 0));
    }
}
