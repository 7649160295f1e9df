//! Incremental time-offset estimator: tracks are fitted when they end, open ones at every query.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::echoes::EchoReader;
use super::fit::{REACH_S, TrackFit, fit};
use super::path::SensorPath;
use super::tracks::{Track, Tracks};
use crate::Observation;
use crate::PositionErrors;

/// Age up to which tracks count, seconds. Choice: long enough to average over several movements,
/// short enough that slow drifts of the offset are followed.
const MEMORY_S: f64 = 20.0;
/// A track follows one stationary object when the fit unwraps at least this share of its phases
/// with at most this rms residual, metres; interference may then shift its ranges by at most this,
/// metres. Choice: a body that sways or two interfering parts lose the phase or leave more than
/// λ/16 of it.
const COHERENT_SHARE: f64 = 0.8;
const COHERENT_RMS_M: f64 = 0.3e-3;
const COHERENT_EXCESS_M: f64 = 0.015;
/// Without phases, the ranges' unexplained rms must be at most this, metres; the track is rejected
/// when unwrapped phases contradict it by more than this rms, metres. Choice: four times the
/// default drift of the tracking, 1 mm; and λ/8, at which phases add up no longer.
const INCOHERENT_EXCESS_M: f64 = 0.004;
const CONTRADICTING_RMS_M: f64 = 0.6e-3;
/// Nearest range used, metres. Measured: in the vendor's recordings the antenna's leakage reaches
/// to 0.1 m, in profile 3 its tail to 0.2 m.
const MIN_RANGE_M: f64 = 0.2;
/// Tracks that deviate by more than this many of their standard deviations are rejected. Choice: 3σ
/// rejects one honest track of 370.
const MAX_DEVIATION: f64 = 3.0;
/// An offset with a greater 1σ counts as unobserved, seconds. Choice: 5 ms misplace an echo by 5 mm
/// at 1 m/s; it would not improve anything.
const OBSERVED_S: f64 = 5e-3;
/// Greatest number of ended tracks that wait for the path to catch up. Choice: bounds memory when
/// the path stops; each estimate takes those that are covered.
const MAX_WAITING: usize = 256;

/// Search interval of the offset, and the pose errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeOffsetSettings {
    /// Middle of the search, pose time minus sweep time, seconds; it extends 0.1 s to both sides.
    pub middle_s: f64,
    /// Pose error model.
    pub errors: PositionErrors,
}

/// An estimate of the offset.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimeOffset {
    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// Whether the motion made the offset observable, to 5 ms or better.
    pub observable: bool,
    /// Number of tracks used.
    pub tracks: usize,
    /// Number of rejected tracks: their object moves, or they contradict the others.
    pub tracks_left_out: usize,
}

/// Estimates the offset from sweeps and the sensor's path.
#[derive(Debug)]
pub struct TimeOffsetEstimator {
    settings: TimeOffsetSettings,
    path: SensorPath,
    subsweeps: BTreeMap<usize, (EchoReader, Tracks)>,
    waiting: VecDeque<Track>,
    fits: VecDeque<TrackFit>,
}

impl TimeOffsetEstimator {
    /// An estimator without data.
    pub fn new(settings: TimeOffsetSettings) -> Self {
        Self {
            settings,
            path: SensorPath::default(),
            subsweeps: BTreeMap::new(),
            waiting: VecDeque::new(),
            fits: VecDeque::new(),
        }
    }

    /// Adds the sensor's position and velocity at a time of the pose stream, about every 5 ms, in
    /// rising time.
    pub fn push_path(&mut self, time_ns: i64, position_m: DVec3, velocity_m_per_s: DVec3) {
        self.path.push(time_ns, position_m, velocity_m_per_s);
    }

    /// Adds a sweep. Only the boresight of its pose is used, so a time offset in it does no harm.
    pub fn push_sweep(&mut self, observation: &Observation) {
        let geometry = &observation.geometry;
        let new = || (EchoReader::new(geometry, MIN_RANGE_M), Tracks::default());
        let (reader, tracks) = self.subsweeps.entry(geometry.subsweep).or_insert_with(new);
        if let Some(echoes) = reader.push(observation) {
            let done = tracks.push(&echoes, observation.mid_time_ns, &observation.tracking_from_sensor);
            self.waiting.extend(done);
            while self.waiting.len() > MAX_WAITING {
                self.waiting.pop_front();
            }
        }
    }

    /// The offset from the data so far; `None` while no track is usable.
    pub fn estimate(&mut self) -> Option<TimeOffset> {
        let TimeOffsetSettings { middle_s, errors } = self.settings;
        let end_ns = self.path.end_ns()?;
        let late_ns = ((middle_s + REACH_S) * 1e9) as i64;
        while let Some(track) = self.waiting.pop_front_if(|t| t.last_ns().saturating_add(late_ns) < end_ns) {
            self.fits.extend(fit(&track, &self.path, middle_s, &errors));
        }
        let since_ns = end_ns.saturating_sub((MEMORY_S * 1e9) as i64);
        self.fits.retain(|f| f.last_ns >= since_ns);
        let open = self.subsweeps.values().flat_map(|(_, tracks)| tracks.open()).chain(&self.waiting);
        let mut fits: Vec<TrackFit> = open.clone().filter_map(|t| fit(t, &self.path, middle_s, &errors)).collect();
        fits.extend(&self.fits);
        let oldest_ns = open.map(Track::first_ns).min().unwrap_or(end_ns);
        let early_ns = ((middle_s - REACH_S) * 1e9) as i64;
        self.path.forget_before(oldest_ns.saturating_add(early_ns).min(end_ns).saturating_sub(100_000_000));
        combined(&fits)
    }
}

/// Whether a track's phases, or its ranges, are consistent with one stationary object.
fn is_stationary(fit: &TrackFit) -> bool {
    let carried = fit.carried_share >= COHERENT_SHARE;
    match carried && fit.phase_rms_m <= COHERENT_RMS_M {
        true => fit.excess_m <= COHERENT_EXCESS_M,
        false if carried && fit.phase_rms_m > CONTRADICTING_RMS_M => false,
        false => fit.excess_m <= INCOHERENT_EXCESS_M,
    }
}

/// Mean over the stationary tracks, weighted by inverse variance; tracks that contradict the others
/// are rejected, the worst first.
fn combined(fits: &[TrackFit]) -> Option<TimeOffset> {
    let mut kept: Vec<&TrackFit> = fits.iter().filter(|f| is_stationary(f)).collect();
    loop {
        let weight: f64 = kept.iter().map(|f| 1.0 / f.variance_s2).sum();
        let offset_s = kept.iter().map(|f| f.offset_s / f.variance_s2).sum::<f64>() / weight;
        let deviation2 = |f: &TrackFit| (f.offset_s - offset_s).powi(2) / f.variance_s2;
        let worst = (0..kept.len()).max_by(|&a, &b| deviation2(kept[a]).total_cmp(&deviation2(kept[b])))?;
        if kept.len() > 2 && deviation2(kept[worst]) > MAX_DEVIATION * MAX_DEVIATION {
            kept.remove(worst);
            continue;
        }
        let freedom = (kept.len() as f64 - 1.0).max(1.0);
        let spread = (kept.iter().map(|f| deviation2(f)).sum::<f64>() / freedom).max(1.0);
        let sigma_s = (spread / weight).sqrt();
        return Some(TimeOffset {
            offset_s,
            sigma_s,
            observable: sigma_s <= OBSERVED_S,
            tracks: kept.len(),
            tracks_left_out: fits.len() - kept.len(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Plane;
    use crate::test_data::{Echo, sweeps, winding};

    const AT: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const POINT: [(Echo, f64); 1] = [(Echo::Point(AT), 8.0)];

    /// Sweeps along one path, poses along another with time stamps late by the offset.
    fn estimated(
        seen: impl Fn(f64) -> DVec3,
        told: impl Fn(f64) -> DVec3,
        echoes: &[(Echo, f64)],
        offset_s: f64,
    ) -> Option<TimeOffset> {
        let errors = PositionErrors::default();
        let mut estimator = TimeOffsetEstimator::new(TimeOffsetSettings { middle_s: 0.0, errors });
        for step in -60..500 {
            let time_s = f64::from(step) * 5e-3;
            let velocity = (told(time_s + 1e-4) - told(time_s - 1e-4)) / 2e-4;
            estimator.push_path(1_000_000_000 + ((time_s + offset_s) * 1e9) as i64, told(time_s), velocity);
        }
        sweeps(2.0, seen, echoes, 1).iter().for_each(|sweep| estimator.push_sweep(sweep));
        estimator.estimate()
    }

    /// 90 cm across.
    fn wide(time_s: f64) -> DVec3 {
        winding(time_s) * 3.0
    }

    fn is_right(estimate: Option<TimeOffset>, offset_s: f64) -> bool {
        estimate.is_some_and(|e| e.observable && (e.offset_s - offset_s).abs() < 3.0 * e.sigma_s && e.sigma_s < 2e-3)
    }

    #[test]
    fn offset_is_estimated_from_a_point_and_from_a_plane() {
        let plane = Plane { outward: DVec3::new(0.36, 0.48, -0.8), offset_m: 1.3 };
        for echoes in [POINT, [(Echo::Plane(plane), 8.0)]] {
            for offset_s in [-0.07, 0.0, 0.02] {
                let estimate = estimated(wide, wide, &echoes, offset_s);
                assert!(is_right(estimate, offset_s), "{offset_s}: {estimate:?} of {echoes:?}");
            }
        }
    }

    #[test]
    fn straight_approach_leaves_offset_unobservable() {
        let approach = |t: f64| DVec3::new(0.0, 0.0, -0.3 * t);
        let estimate = estimated(approach, approach, &POINT, 0.02);
        assert!(estimate.is_none_or(|e| !e.observable && e.sigma_s > 0.01), "{estimate:?}");
        // At rest, pose jitter does not count as motion.
        let jitter = |t: f64| 0.12e-3 * DVec3::new((61.0 * t).sin(), (53.0 * t).cos(), (57.0 * t).sin());
        let estimate = estimated(|_| DVec3::ZERO, jitter, &POINT, 0.02);
        assert!(estimate.is_none_or(|e| !e.observable), "{estimate:?}");
    }

    #[test]
    fn moving_target_gives_no_confident_wrong_offset() {
        // An object that swings by 6 cm is equivalent to a sensor that swings the other way.
        let swinging = |t: f64| winding(t) - 0.06 * DVec3::new((5.0 * t).sin(), 0.0, (4.0 * t).cos());
        let estimate = estimated(swinging, winding, &POINT, 0.0);
        assert!(estimate.is_none_or(|e| !e.observable || e.offset_s.abs() < 3.0 * e.sigma_s), "{estimate:?}");
    }

    #[test]
    fn noise_gives_no_estimate() {
        assert_eq!(estimated(winding, winding, &[], 0.02), None);
    }

    fn track(offset_ms: f64, sigma_ms: f64) -> TrackFit {
        TrackFit {
            offset_s: offset_ms * 1e-3,
            variance_s2: (sigma_ms * 1e-3).powi(2),
            excess_m: 0.005,
            carried_share: 0.9,
            phase_rms_m: 0.2e-3,
            last_ns: 0,
        }
    }

    #[test]
    fn tracks_are_weighted_and_outliers_removed() {
        let fits = [track(20.0, 1.0), track(21.0, 1.0), track(-30.0, 2.0), track(19.0, 1.0)];
        let all = combined(&fits).unwrap();
        assert!((all.offset_s - 0.020).abs() < 1e-9 && (all.sigma_s - 1e-3 / 3f64.sqrt()).abs() < 1e-9, "{all:?}");
        assert_eq!((all.tracks, all.tracks_left_out), (3, 1));
        // Two that contradict each other: neither can be preferred.
        let two = combined(&[track(20.0, 1.0), track(-20.0, 1.0)]).unwrap();
        assert!(!two.observable, "{two:?}");
        assert_eq!(combined(&[TrackFit { excess_m: 0.02, ..track(5.0, 0.1) }]), None);
        assert_eq!(combined(&[TrackFit { phase_rms_m: 0.001, ..track(5.0, 0.1) }]), None);
    }
}
