//! Tracks reflections over updates with a Kalman filter on distance and velocity. A track without
//! detections coasts for half a second.
//!
//! The description gives no noise values. Here the velocity changes by 3 cm/s (1σ) between updates
//! (20 ms), as when passing an object, and a detection has an error of 1 cm and 1 cm/s (1σ).

use super::Reflection;

/// Process noise: growth of the velocity's variance, m²/s³. Choice: 3 cm/s between updates at 50
/// Hz, as a robot accelerates.
const SPEED_NOISE_M2_PER_S3: f64 = 0.05;
/// 1σ of a detection, m and m/s. Choice: a fraction of the merge distance, as interpolated peaks
/// scatter.
const DISTANCE_SIGMA_M: f64 = 0.01;
const VELOCITY_SIGMA_M_PER_S: f64 = 0.01;
/// Gate: squared Mahalanobis distance within which a reflection belongs to a track. Choice: 99 % of
/// a two-dimensional normal distribution.
const GATE: f64 = 9.2;
/// Time that a track coasts without detections, seconds (source: the vendor's description).
const DEAD_RECKONING_S: f64 = 0.5;

/// A track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Distance, metres.
    pub distance_m: f64,
    /// Radial velocity, m/s; positive when the distance grows.
    pub velocity_m_per_s: f64,
    /// Variance of the distance, covariance, variance of the velocity; m², m²/s, m²/s².
    pub covariance: [f64; 3],
    /// Number of detections.
    pub detections: u32,
    /// Time since the last detection, seconds.
    pub unseen_s: f64,
}

impl Track {
    fn from_reflection(at: &Reflection) -> Self {
        Self {
            distance_m: at.distance_m,
            velocity_m_per_s: at.velocity_m_per_s,
            covariance: [DISTANCE_SIGMA_M.powi(2), 0.0, VELOCITY_SIGMA_M_PER_S.powi(2)],
            detections: 1,
            unseen_s: 0.0,
        }
    }

    fn predict(&mut self, dt_s: f64) {
        let [dd, dv, vv] = self.covariance;
        let q = SPEED_NOISE_M2_PER_S3;
        self.distance_m += self.velocity_m_per_s * dt_s;
        self.covariance = [
            dd + 2.0 * dt_s * dv + dt_s * dt_s * vv + q * dt_s.powi(3) / 3.0,
            dv + dt_s * vv + q * dt_s * dt_s / 2.0,
            vv + q * dt_s,
        ];
        self.unseen_s += dt_s;
    }

    /// Innovation of a detection: its covariance and its value.
    fn innovation(&self, seen: &Reflection) -> ([f64; 3], [f64; 2]) {
        let [dd, dv, vv] = self.covariance;
        let spread = [dd + DISTANCE_SIGMA_M.powi(2), dv, vv + VELOCITY_SIGMA_M_PER_S.powi(2)];
        (spread, [seen.distance_m - self.distance_m, seen.velocity_m_per_s - self.velocity_m_per_s])
    }

    fn mahalanobis_squared(&self, seen: &Reflection) -> f64 {
        let ([a, b, c], [d, v]) = self.innovation(seen);
        (c * d * d - 2.0 * b * d * v + a * v * v) / (a * c - b * b)
    }

    fn update(&mut self, seen: &Reflection) {
        let ([a, b, c], [d, v]) = self.innovation(seen);
        let [dd, dv, vv] = self.covariance;
        let det = a * c - b * b;
        // Gain: covariance times the inverse of the innovation's covariance.
        let row = |x: f64, y: f64| [(x * c - y * b) / det, (y * a - x * b) / det];
        let (first, second) = (row(dd, dv), row(dv, vv));
        self.distance_m += first[0] * d + first[1] * v;
        self.velocity_m_per_s += second[0] * d + second[1] * v;
        self.covariance = [
            dd - first[0] * dd - first[1] * dv,
            dv - first[0] * dv - first[1] * vv,
            vv - second[0] * dv - second[1] * vv,
        ];
        self.detections += 1;
        self.unseen_s = 0.0;
    }
}

/// All tracks.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracks(Vec<Track>);

impl Tracks {
    /// Advances all tracks by `elapsed_s` and updates them with the reflections; returns them by
    /// rising distance. Each reflection, strongest first, goes to the track that it fits best.
    pub fn step(&mut self, seen: &[Reflection], elapsed_s: f64) -> Vec<Track> {
        self.0.iter_mut().for_each(|track| track.predict(elapsed_s));
        let mut free: Vec<usize> = (0..self.0.len()).collect();
        for reflection in seen {
            let fit = |&n: &usize| self.0[n].mahalanobis_squared(reflection);
            let best = free.iter().copied().min_by(|a, b| fit(a).total_cmp(&fit(b))).filter(|n| fit(n) < GATE);
            match best {
                Some(n) => {
                    self.0[n].update(reflection);
                    free.retain(|other| *other != n);
                }
                None => self.0.push(Track::from_reflection(reflection)),
            }
        }
        self.0.retain(|track| track.unseen_s <= DEAD_RECKONING_S);
        self.0.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        self.0.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(distance_m: f64) -> Reflection {
        Reflection { distance_m, velocity_m_per_s: -0.3, magnitude: 1.0 }
    }

    #[test]
    fn unseen_track_coasts_for_half_a_second() {
        let mut tracks = Tracks::default();
        for n in 0..10 {
            tracks.step(&[at(0.6 - 0.006 * f64::from(n))], 0.02);
        }
        let mut last = tracks.step(&[], 0.02);
        for _ in 1..24 {
            last = tracks.step(&[], 0.02);
        }
        assert_eq!(last.len(), 1);
        assert!((last[0].distance_m - (0.6 - 0.006 * 9.0 - 0.144)).abs() < 1e-3, "{last:?}");
        assert!(tracks.step(&[], 0.03).is_empty());
    }

    #[test]
    fn detections_reduce_variance_and_reflectors_get_own_tracks() {
        let mut tracks = Tracks::default();
        for n in 0..20 {
            let way = 0.006 * f64::from(n);
            tracks.step(&[at(0.6 - way), at(0.3 - way)], 0.02);
        }
        let last = tracks.step(&[], 1e-9);
        assert_eq!(last.len(), 2);
        assert!(
            last.iter().all(|track| track.detections == 20 && track.covariance[0].sqrt() < 0.7 * DISTANCE_SIGMA_M),
            "{last:?}"
        );
    }
}
