//! The estimate while data come in: tracks are fitted when they end, those that go on whenever it is asked for.

use std::collections::{BTreeMap, VecDeque};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::echoes::EchoReader;
use super::fit::{REACH_S, TrackFit, fit};
use super::path::SensorPath;
use super::tracks::{Track, Tracks};
use crate::Observation;
use crate::PositionErrors;

/// Time from which tracks count, seconds: slow drifts of the offset are followed.
const MEMORY_S: f64 = 20.0;
/// A track follows one thing that stands still when the fit carries this share of its phases and leaves no more of them
/// than this, metres; interference may then pull its ranges by so much, metres.
const COHERENT_SHARE: f64 = 0.8;
const COHERENT_RMS_M: f64 = 0.3e-3;
const COHERENT_EXCESS_M: f64 = 0.015;
/// Or, without phases, when its ranges leave no more than this unexplained, metres; not when phases contradict by this.
const INCOHERENT_EXCESS_M: f64 = 0.004;
const CONTRADICTING_RMS_M: f64 = 0.6e-3;
/// Nearest range read, metres: the antenna's own leakage lies below.
const MIN_RANGE_M: f64 = 0.2;
/// Tracks that disagree by more than this many of their standard deviations are left out.
const MAX_DEVIATION: f64 = 3.0;
/// From this 1σ on an offset counts as not observed, seconds: it would heal nothing.
const OBSERVED_S: f64 = 5e-3;
/// Ended tracks that wait for the path's end, at most.
const MAX_WAITING: usize = 256;

/// Where the offset is looked for, and what is known of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeOffsetSettings {
    /// Middle of the search, pose time minus sweep time, seconds; it reaches 0.1 s to both sides.
    pub middle_s: f64,
    /// How well the poses are known.
    pub errors: PositionErrors,
}

/// The offset as far as the data tell it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimeOffset {
    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// Whether the motion told the offset apart from everything else, to 5 ms or better.
    pub observable: bool,
    /// Tracks that it rests on.
    pub tracks: usize,
    /// Tracks that were left out: what they follow moves, or they contradict the others.
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
    /// Nothing known yet.
    pub fn new(settings: TimeOffsetSettings) -> Self {
        Self {
            settings,
            path: SensorPath::default(),
            subsweeps: BTreeMap::new(),
            waiting: VecDeque::new(),
            fits: VecDeque::new(),
        }
    }

    /// Takes the sensor's place and velocity at a time of the pose stream, about every 5 ms, in rising time.
    pub fn push_path(&mut self, time_ns: i64, position_m: DVec3, velocity_m_per_s: DVec3) {
        self.path.push(time_ns, position_m, velocity_m_per_s);
    }

    /// Takes a sweep; of its pose only the boresight serves, so an offset in it does no harm.
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

    /// The offset from what came so far; `None` while no track tells anything.
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

/// Whether a track's phases, or its ranges, agree on one thing that does not move.
fn is_stationary(fit: &TrackFit) -> bool {
    let carried = fit.carried_share >= COHERENT_SHARE;
    match carried && fit.phase_rms_m <= COHERENT_RMS_M {
        true => fit.excess_m <= COHERENT_EXCESS_M,
        false if carried && fit.phase_rms_m > CONTRADICTING_RMS_M => false,
        false => fit.excess_m <= INCOHERENT_EXCESS_M,
    }
}

/// The mean of what stands still, weighed by variance; tracks that contradict the others go, the worst first.
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

    /// Sweeps along one path, poses along another that are stamped later by the offset.
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
        // At rest the poses' jitter is no motion.
        let jitter = |t: f64| 0.12e-3 * DVec3::new((61.0 * t).sin(), (53.0 * t).cos(), (57.0 * t).sin());
        let estimate = estimated(|_| DVec3::ZERO, jitter, &POINT, 0.02);
        assert!(estimate.is_none_or(|e| !e.observable), "{estimate:?}");
    }

    #[test]
    fn moving_target_gives_no_confident_wrong_offset() {
        // That the thing swings by 6 cm is as if the sensor swung the other way.
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
        // Two that contradict each other: nobody knows which is right.
        let two = combined(&[track(20.0, 1.0), track(-20.0, 1.0)]).unwrap();
        assert!(!two.observable, "{two:?}");
        assert_eq!(combined(&[TrackFit { excess_m: 0.02, ..track(5.0, 0.1) }]), None);
        assert_eq!(combined(&[TrackFit { phase_rms_m: 0.001, ..track(5.0, 0.1) }]), None);
    }
}
