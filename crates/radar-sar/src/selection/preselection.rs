//! Preselection before imaging: drops sweeps without signal, and sweeps from the position of the
//! last kept one.
//!
//! A stationary sensor keeps contributing one sweep every tenth of a second, so that its data stay
//! current and noise averages out.

use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Observation, SweepGeometry};
use crate::{RangeCompressor, sweep_noise_rms};

/// A sweep is kept after this time even without motion, nanoseconds. Choice: ten sweeps a second
/// keep the time covered, for noise and for objects that move.
const STILL_NS: i64 = 100_000_000;

/// Requirements for keeping a sweep. Zeros keep all.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Preselection {
    /// Least peak of |z|²/σ² over range. Noise alone reaches 5 to 10.
    pub min_peak_power: f64,
    /// Least distance from the last kept sweep's position, metres.
    pub min_move_m: f64,
}

/// Number of dropped sweeps, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PreselectionCounters {
    /// Nothing in them exceeded the noise.
    pub without_signal: u64,
    /// The sensor had not moved.
    pub without_motion: u64,
}

/// Decides sweep by sweep, in time order.
#[derive(Debug, Default)]
pub struct Preselector {
    settings: Preselection,
    compressors: Vec<(Arc<SweepGeometry>, RangeCompressor)>,
    /// Per subsweep: time and position of the last kept sweep.
    last: Vec<(usize, i64, DVec3)>,
    counters: PreselectionCounters,
}

impl Preselector {
    /// Nothing kept yet.
    pub fn new(settings: Preselection) -> Self {
        Self { settings, ..Self::default() }
    }

    /// Number of dropped sweeps so far.
    pub fn counters(&self) -> PreselectionCounters {
        self.counters
    }

    /// Whether a sweep is kept.
    pub fn keeps(&mut self, observation: &Observation) -> bool {
        let subsweep = observation.geometry.subsweep;
        let (time_ns, place) = (observation.mid_time_ns, observation.tracking_from_sensor.translation);
        let known = self.last.iter().position(|(of, ..)| *of == subsweep);
        let stands = known.map(|at| self.last[at]).is_some_and(|(_, last_ns, last)| {
            place.distance(last) < self.settings.min_move_m && time_ns.saturating_sub(last_ns) < STILL_NS
        });
        if stands {
            self.counters.without_motion += 1;
            return false;
        }
        if self.settings.min_peak_power > 0.0 && self.peak_power(observation) < self.settings.min_peak_power {
            self.counters.without_signal += 1;
            return false;
        }
        match known {
            Some(at) => self.last[at] = (subsweep, time_ns, place),
            None => self.last.push((subsweep, time_ns, place)),
        }
        true
    }

    fn peak_power(&mut self, observation: &Observation) -> f64 {
        let Observation { geometry, samples, .. } = observation;
        let at = self.compressors.iter().position(|(of, _)| Arc::ptr_eq(of, geometry)).unwrap_or_else(|| {
            // One geometry per subsweep; a new one replaces the old one.
            self.compressors.retain(|(of, _)| of.subsweep != geometry.subsweep);
            self.compressors.push((Arc::clone(geometry), RangeCompressor::new(geometry)));
            self.compressors.len() - 1
        });
        let compressed = self.compressors[at].1.compress(samples, (1.0 / sweep_noise_rms(samples)) as f32);
        compressed.z.iter().map(|z| f64::from(z.norm_sqr())).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{Echo, sweeps};

    /// Moves for half a second at 0.2 m/s, then stops.
    fn path(t: f64) -> DVec3 {
        DVec3::X * 0.2 * t.min(0.5)
    }

    fn kept(settings: Preselection, echoes: &[(Echo, f64)]) -> (Vec<usize>, PreselectionCounters) {
        let mut preselector = Preselector::new(settings);
        let all = sweeps(1.0, path, echoes, 5);
        let kept = (0..all.len()).filter(|&n| preselector.keeps(&all[n])).collect();
        (kept, preselector.counters())
    }

    #[test]
    fn without_motion_ten_a_second_are_kept() {
        let (kept, counters) = kept(Preselection { min_move_m: 1e-3, min_peak_power: 0.0 }, &[]);
        let moving = kept.iter().filter(|n| **n <= 500).count();
        assert!((95..=101).contains(&moving) && (4..=6).contains(&(kept.len() - moving)), "{}", kept.len());
        assert_eq!(counters.without_motion as usize, 1000 - kept.len());
    }

    #[test]
    fn noise_is_left_out_and_echoes_are_kept() {
        let settings = Preselection { min_move_m: 0.0, min_peak_power: 12.0 };
        let (noise, counters) = kept(settings, &[]);
        assert!(noise.len() < 20 && counters.without_signal as usize == 1000 - noise.len(), "{}", noise.len());
        let (echo, _) = kept(settings, &[(Echo::Point(DVec3::NEG_Z), 6.0)]);
        assert!(echo.len() > 980, "{}", echo.len());
        assert_eq!(kept(Preselection::default(), &[]).0.len(), 1000);
    }
}
