//! Incremental estimator of the corrections: tracks are fitted when they end, open ones at every query.

use std::collections::{BTreeMap, VecDeque};

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::boresight::{Directions, EchoDirections};
use super::combination::{Combination, TrackTerm, combine};
use super::corrections::{BIAS, CORRECTIONS, Corrections, Matrix, OFFSET, Quadratic, SHIFT};
use super::echoes::EchoReader;
use super::information::Information;
use super::path::SensorPath;
use super::track_fit::{MARGIN_NS, TrackFit};
use super::tracks::{Track, Tracks};
use crate::geometry::Pose;
use crate::math;
use crate::{Beam, Observation, PositionErrors};

/// Nearest range used, metres. Measured: in the vendor's recordings the antenna's leakage reaches
/// to 0.1 m, in profile 3 its tail to 0.2 m.
const MIN_RANGE_M: f64 = 0.2;
/// Greatest distance of the time offset from the middle of the search, seconds, and its 1σ before. Choice: delays of
/// headsets and lines are tens of milliseconds.
const REACH_S: f64 = 0.1;
/// 1σ of the range bias before, metres. Measured: the vendor's offset compensation
/// puts profile 3 at −6 to 0 mm.
const BIAS_SIGMA_M: f64 = 3e-3;
/// Time offsets that the first iterations start from, relative to the middle of the search, seconds. Choice: descents
/// begin at most 25 ms off.
const STARTS_S: [f64; 5] = [0.0, -0.05, 0.05, -0.09, 0.09];
/// A start other than the middle is taken when it explains this share more of the tracks better than worse, each clearly:
/// by more than this difference of minus twice the log likelihood. Choice: tracking errors let single tracks prefer any
/// offset; a likelihood ratio of e⁵.
const LEAD_OF_FAR_START: f64 = 0.5;
const CLEAR_GAIN: f64 = 10.0;
/// Greatest steps of an iteration. Choice: the second-order approximation holds about as far.
const MAX_STEP: Corrections = [0.02, 0.03, 0.03, 0.03, 0.01];
/// Iterations of an estimate, and of each start. Choice: three to five suffice from a good start.
const MAX_ITERATIONS: usize = 12;
const START_ITERATIONS: usize = 4;
/// The iteration ends when a step is smaller than this share of 1σ.
const SMALL_STEP: f64 = 0.1;
/// A track is fitted anew when the corrections are farther than this from those that it was fitted for, or the drift's
/// variance by more than this factor. Choice: within these the quadratic approximation changes by a few per cent.
const REFIT: Corrections = [0.3e-3, 1e-3, 1e-3, 1e-3, 3e-3];
const REFIT_DRIFT: f64 = 1.3;
/// Time after which the tracks' information on the time offset is dropped, nanoseconds; that on the rest is kept as a sum.
/// Choice: long enough to average over several movements, short enough that slow drifts of the offset are followed.
const MEMORY_NS: i64 = 20_000_000_000;
/// Time constant with which the sum is forgotten, seconds. Choice: a sensor that was knocked is found again in
/// minutes.
const FORGET_S: f64 = 600.0;
/// How many degrees of freedom the settings' drift is worth. Choice: as many as one good track of 5 s.
const DRIFT_PRIOR_FREEDOM: f64 = 20.0;
/// Share of the tracks, by degrees of freedom, that show less than the tracking's drift. Measured (`lab --example mount`, worlds
/// dining and office): at a half the estimate runs to its bound, because highlights slide over most surfaces, and the mount is
/// off by 4 mm instead of 1; at a fifth it is 0.8 mm of 1, and 2.4 mm of 4.
const DRIFT_QUANTILE: f64 = 0.2;
/// A track's own slow error is used when its variance is this many times the tracking's, which counts as so many degrees of
/// freedom in it. Measured (there): a factor of 1.3 or 4, or one degree, is worse in some worlds.
const OWN_EXCESS: f64 = 2.0;
const OWN_PRIOR_FREEDOM: f64 = 4.0;
/// Greatest change of the drift's variance in an iteration, as a factor, and its bounds relative to the settings'.
/// Choice: keeps a few odd tracks from running away with it.
const MAX_DRIFT_CHANGE: f64 = 4.0;
const DRIFT_SCALE_BOUNDS: (f64, f64) = (0.04, 64.0);
/// With more drift than this, metres, the tracks' variance grows with its square. Measured (`lab --example mount`, headsets
/// inside-out and poor): tracking that wanders by 4 or 5 mm jumps, has wrong stamps and a bent frame as well, its drift is
/// found to be 2.4 or 3 mm, and the errors are twice what the scatter of the tracks shows; with 1 mm they agree.
const TRUSTED_DRIFT_M: f64 = 1.3e-3;
/// 1σ of what a single track may deviate by beyond its own errors. Choice: ten times what matters.
const TRACK_SPREAD: Corrections = [10e-3, 30e-3, 30e-3, 30e-3, 5e-3];
/// An offset with a greater 1σ counts as unobserved, seconds. Choice: 5 ms misplace an echo by 5 mm
/// at 1 m/s; it would not improve anything.
const OBSERVED_S: f64 = 5e-3;
/// Greatest number of ended tracks that wait for the path to catch up, and of fitted ones. Choice: bounds memory when
/// the path stops, and the work of an estimate.
const MAX_WAITING: usize = 256;
const MAX_FITTED: usize = 256;

/// What is known before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationSettings {
    /// Middle of the search for the time offset, pose time minus sweep time, seconds; it extends 0.1 s to both sides.
    pub middle_s: f64,
    /// 1σ of the sensor's position on the head in each axis, metres.
    pub mount_sigma_m: f64,
    /// Pose errors. How large the drift is, is estimated from here on.
    pub errors: PositionErrors,
}

impl CalibrationSettings {
    /// For a mount that was measured by eye, or not at all: 5 cm.
    pub fn new(middle_s: f64, errors: PositionErrors) -> Self {
        Self { middle_s, mount_sigma_m: 0.05, errors }
    }
}

/// An estimate of the time offset.
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
    /// Number of tracks that contradict the others.
    pub tracks_left_out: usize,
}

/// The corrections as estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Time offset between the streams.
    pub time_offset: TimeOffset,
    /// Where the sensor is in the axes of the assumed sensor, metres.
    pub mount_shift_m: DVec3,
    /// Covariance of that, m². An axis that the motion did not make observable keeps its prior variance.
    pub mount_covariance_m2: DMat3,
    /// Measured minus true range, metres, and its 1σ.
    pub range_bias_m: f64,
    /// See `range_bias_m`.
    pub range_bias_sigma_m: f64,
    /// Slow tracking error in each axis, rms, metres.
    pub drift_m: f64,
}

/// A track with its information on corrections near `at`.
#[derive(Debug, Clone)]
struct FittedTrack {
    fit: TrackFit,
    at: Corrections,
    /// Variance of the slow error that it was fitted with, relative to the settings'.
    drift_scale: f64,
    /// That variance as the track alone shows it, and its degrees of freedom.
    own_drift: Option<(f64, f64)>,
    information: Option<Information>,
}

/// The corrections and the drift's variance that tracks are fitted for.
#[derive(Debug, Clone, Copy)]
struct Point {
    at: Corrections,
    drift_scale: f64,
}

/// Why it iterates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rounds {
    /// To compare starts.
    Start,
    /// For the result.
    Final,
}

/// Estimates the corrections from sweeps and the sensor's assumed path.
#[derive(Debug)]
pub struct SelfCalibration {
    settings: CalibrationSettings,
    path: SensorPath,
    subsweeps: BTreeMap<usize, (EchoReader, Tracks)>,
    waiting: VecDeque<Track>,
    fitted: VecDeque<FittedTrack>,
    /// Information of former tracks on the mount and the range bias, at the corrections `known_at`.
    known: Quadratic,
    known_at: Corrections,
    /// Where the echoes of former tracks came from.
    former_directions: VecDeque<Directions>,
    /// Where the last estimate ended; `None` before the first whose time offset was observed.
    last: Option<Point>,
}

impl SelfCalibration {
    /// An estimator without data.
    pub fn new(settings: CalibrationSettings) -> Self {
        Self {
            settings,
            path: SensorPath::default(),
            subsweeps: BTreeMap::new(),
            waiting: VecDeque::new(),
            fitted: VecDeque::new(),
            known: Quadratic::default(),
            known_at: Corrections::default(),
            former_directions: VecDeque::new(),
            last: None,
        }
    }

    /// Adds the assumed pose of the sensor, `tracking_from_sensor`, at a time of the pose stream, and its velocity;
    /// about every 5 ms, in rising time.
    pub fn push_path(&mut self, time_ns: i64, tracking_from_sensor: &Pose, velocity_m_per_s: DVec3) {
        self.path.push(time_ns, tracking_from_sensor, velocity_m_per_s);
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

    /// The corrections from the data so far; `None` while no track is usable.
    pub fn estimate(&mut self) -> Option<Calibration> {
        let end_ns = self.path.end_ns()?;
        self.take_ended(end_ns);
        let open = self.subsweeps.values().flat_map(|(_, tracks)| tracks.open()).chain(&self.waiting);
        let open: Vec<FittedTrack> = open.flat_map(|track| self.prepared(track)).collect();
        let ended = self.fitted.len();
        let mut tracks: Vec<FittedTrack> = self.fitted.drain(..).chain(open).collect();
        let found = self.solve(&mut tracks);
        tracks.truncate(ended);
        self.fitted = tracks.into();
        if let Some((point, combination)) = &found {
            self.forget(end_ns, point, combination);
        }
        self.forget_path(end_ns);
        let (point, combination) = found?;
        let calibration = calibration(&point, &combination, &self.settings.errors);
        if calibration.time_offset.observable {
            self.last = Some(point);
        }
        Some(calibration)
    }

    /// What the directions of the tracks' echoes show, as of the last estimate.
    pub fn echo_directions(&self, beam: &Beam) -> EchoDirections {
        let recent = self.fitted.iter().filter_map(|track| track.fit.directions.as_ref());
        EchoDirections::of(self.former_directions.iter().chain(recent), beam)
    }

    /// Moves tracks that the path covers to the fitted ones.
    fn take_ended(&mut self, end_ns: i64) {
        let until_ns = end_ns.saturating_sub(self.late_ns());
        while let Some(track) = self.waiting.pop_front_if(|track| track.last_ns() < until_ns) {
            self.fitted.extend(self.prepared(&track));
        }
        while self.fitted.len() > MAX_FITTED {
            self.fitted.pop_front();
        }
    }

    /// By how much the path must be newer than an echo, whatever the time offset.
    fn late_ns(&self) -> i64 {
        ((self.settings.middle_s + REACH_S) * 1e9) as i64 + MARGIN_NS
    }

    fn early_ns(&self) -> i64 {
        ((self.settings.middle_s - REACH_S) * 1e9) as i64 - MARGIN_NS
    }

    /// The parts of a track along which the path is known, whatever the time offset: a gap in it, or a jump of the
    /// tracking frame, parts the track.
    fn prepared(&self, track: &Track) -> Vec<FittedTrack> {
        let [early_ns, late_ns] = [self.early_ns(), self.late_ns()];
        let (from_ns, to_ns) = (track.first_ns().saturating_add(early_ns), track.last_ns().saturating_add(late_ns));
        let part = |(first_ns, last_ns): (i64, i64)| {
            let index = |time_ns: i64| track.echoes.partition_point(|echo| echo.time_ns < time_ns);
            let begin = index(first_ns.saturating_sub(early_ns));
            let end = index(last_ns.saturating_sub(late_ns)).max(begin);
            let fit = TrackFit::new(&track.echoes[begin..end], track.forward, &self.settings.errors)?;
            Some(FittedTrack { fit, at: Corrections::default(), drift_scale: 1.0, own_drift: None, information: None })
        };
        self.path.stretches(from_ns, to_ns).into_iter().filter_map(part).collect()
    }

    /// The best corrections: from those of the last estimate, or from the best of several starts.
    fn solve(&self, tracks: &mut [FittedTrack]) -> Option<(Point, Combination)> {
        if let Some(last) = self.last {
            return self.iterate(tracks, last, Rounds::Final);
        }
        let tried = STARTS_S.into_iter().filter_map(|offset_s| {
            let mut at = Corrections::default();
            at[OFFSET] = self.settings.middle_s + offset_s;
            let mut tracks = tracks.to_vec();
            let (point, _) = self.iterate(&mut tracks, Point { at, drift_scale: 1.0 }, Rounds::Start)?;
            Some((point, tracks))
        });
        let tried: Vec<(Point, Vec<FittedTrack>)> = tried.collect();
        let (near, near_tracks) = tried.first()?;
        let lead = |(_, tracks): &(Point, Vec<FittedTrack>)| lead(tracks, near_tracks);
        let best = tried.iter().map(|start| (lead(start), start.0)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let start = if best.0 >= LEAD_OF_FAR_START { best.1 } else { *near };
        self.iterate(tracks, start, Rounds::Final)
    }

    /// Gauss–Newton from a start.
    fn iterate(&self, tracks: &mut [FittedTrack], start: Point, rounds: Rounds) -> Option<(Point, Combination)> {
        let (mut point, mut found) = (start, None);
        let most = if rounds == Rounds::Start { START_ITERATIONS } else { MAX_ITERATIONS };
        for _ in 0..most {
            self.refit(tracks, &point, rounds);
            // A large drift explains any offset: starts are compared without it.
            let change = match rounds {
                Rounds::Start => 1.0,
                Rounds::Final => drift_change(tracks.iter().filter_map(|track| track.own_drift), point.drift_scale),
            };
            let terms = self.terms(tracks.iter(), &point);
            let combination =
                if terms.is_empty() { None } else { combine(&terms, &self.prior_at(&point.at), &TRACK_SPREAD) }?;
            let is_small = |k: usize| combination.step[k].abs() <= SMALL_STEP * combination.covariance[k][k].sqrt();
            let is_done = (0..CORRECTIONS).all(is_small) && (1.0 / REFIT_DRIFT..REFIT_DRIFT).contains(&change);
            for (at, (step, most)) in point.at.iter_mut().zip(combination.step.iter().zip(MAX_STEP)) {
                *at += step.clamp(-most, most);
            }
            let middle_s = self.settings.middle_s;
            point.at[OFFSET] = point.at[OFFSET].clamp(middle_s - REACH_S, middle_s + REACH_S);
            let (least, most) = DRIFT_SCALE_BOUNDS;
            point.drift_scale = (point.drift_scale * change).clamp(least, most);
            found = Some(combination);
            if is_done {
                break;
            }
        }
        found.map(|found| (point, found))
    }

    /// What the tracks say at a point.
    fn terms<'t>(&self, tracks: impl Iterator<Item = &'t FittedTrack>, point: &Point) -> Vec<TrackTerm> {
        let unmodelled = (drift_m(point, &self.settings.errors) / TRUSTED_DRIFT_M).max(1.0).powi(2);
        tracks.filter_map(|track| track.term_at(&point.at, unmodelled)).collect()
    }

    /// Fits the tracks that were fitted too far from a point.
    fn refit(&self, tracks: &mut [FittedTrack], point: &Point, rounds: Rounds) {
        let drift_scale = |track: &FittedTrack| match rounds {
            Rounds::Start => point.drift_scale,
            Rounds::Final => track.drift_scale_at(point.drift_scale),
        };
        let is_near = |track: &FittedTrack| {
            let ratio = track.drift_scale / drift_scale(track);
            let drift_is_near = (1.0 / REFIT_DRIFT..=REFIT_DRIFT).contains(&ratio);
            track.information.is_some()
                && drift_is_near
                && (0..CORRECTIONS).all(|k| (track.at[k] - point.at[k]).abs() <= REFIT[k])
        };
        if tracks.iter().all(is_near) {
            return;
        }
        let shift_m = DVec3::new(point.at[SHIFT], point.at[SHIFT + 1], point.at[SHIFT + 2]);
        let path = self.path.shifted(shift_m);
        tracks.par_iter_mut().filter(|track| !is_near(track)).for_each(|track| {
            (track.at, track.drift_scale) = (point.at, drift_scale(track));
            track.information = track.fit.information(&path, &point.at, track.drift_scale);
            let drift = track.information.and_then(|information| information.drift);
            let own = |(power, freedom): (f64, f64)| {
                let change = (power / freedom).clamp(1.0 / MAX_DRIFT_CHANGE, MAX_DRIFT_CHANGE);
                let (least, most) = DRIFT_SCALE_BOUNDS;
                ((track.drift_scale * change).clamp(least, most), freedom)
            };
            track.own_drift = drift.filter(|(_, freedom)| *freedom > 0.1).map(own).or(track.own_drift);
        });
    }

    /// The prior at these corrections, with the information of former tracks.
    fn prior_at(&self, at: &Corrections) -> Quadratic {
        let step = std::array::from_fn(|k| at[k] - self.known_at[k]);
        let mut known = self.known.after(&step);
        let CalibrationSettings { middle_s, mount_sigma_m, .. } = self.settings;
        known.expect(OFFSET, middle_s - at[OFFSET], REACH_S);
        (SHIFT..BIAS).for_each(|k| known.expect(k, -at[k], mount_sigma_m));
        known.expect(BIAS, -at[BIAS], BIAS_SIGMA_M);
        known
    }

    /// Keeps old tracks' information on the mount and the range bias as a sum. They go together, because they share a
    /// time offset, which is eliminated.
    fn forget(&mut self, end_ns: i64, point: &Point, combination: &Combination) {
        let is_old = |track: &FittedTrack| end_ns.saturating_sub(track.fit.last_ns) > 2 * MEMORY_NS;
        if !self.fitted.front().is_some_and(is_old) {
            return;
        }
        let since_ns = end_ns.saturating_sub(MEMORY_NS);
        let count = self.fitted.iter().take_while(|track| track.fit.last_ns < since_ns).count();
        let old: Vec<FittedTrack> = self.fitted.drain(..count).collect();
        self.former_directions.extend(old.iter().filter_map(|track| track.fit.directions.clone()));
        while self.former_directions.len() > MAX_FITTED {
            self.former_directions.pop_front();
        }
        let mut old_sum = Quadratic::default();
        for (term, weight) in self.terms(old.iter(), point).iter().zip(&combination.weights) {
            old_sum.add(&term.quadratic, weight / combination.disagreement);
        }
        let step = std::array::from_fn(|k| point.at[k] - self.known_at[k]);
        let kept = math::exp(-(MEMORY_NS as f64) * 1e-9 / FORGET_S);
        let former = self.known.after(&step);
        self.known = old_sum.without(OFFSET, f64::INFINITY);
        self.known.add(&former, kept);
        self.known_at = point.at;
    }

    fn forget_path(&mut self, end_ns: i64) {
        let open = self.subsweeps.values().flat_map(|(_, tracks)| tracks.open()).chain(&self.waiting);
        let fitted = self.fitted.iter().map(|track| track.fit.first_ns);
        let oldest_ns = open.map(Track::first_ns).chain(fitted).min().unwrap_or(end_ns);
        self.path.forget_before(oldest_ns.saturating_add(self.early_ns()).min(end_ns).saturating_sub(100_000_000));
    }
}

impl FittedTrack {
    /// Variance of its slow error: the tracking's, or its own where that is clearly more, as of a highlight that slides over
    /// a surface.
    fn drift_scale_at(&self, of_tracking: f64) -> f64 {
        let own = self.own_drift.map_or(of_tracking, |(own, freedom)| {
            (of_tracking * OWN_PRIOR_FREEDOM + own * freedom) / (OWN_PRIOR_FREEDOM + freedom)
        });
        if own > OWN_EXCESS * of_tracking { own } else { of_tracking }
    }

    fn term_at(&self, at: &Corrections, unmodelled: f64) -> Option<TrackTerm> {
        let Information { quadratic, variance_factor, middle_ns, .. } = self.information?;
        let step = std::array::from_fn(|k| at[k] - self.at[k]);
        let variance_factor = variance_factor * unmodelled;
        Some(TrackTerm { quadratic: quadratic.after(&step), variance_factor, middle_ns })
    }
}

/// Share of the tracks that are explained better than by other corrections, minus the share explained worse.
fn lead(tracks: &[FittedTrack], other: &[FittedTrack]) -> f64 {
    // Minus twice the log likelihood when the variance of a track's residuals is unknown.
    let misfit = |track: &FittedTrack| {
        let (squares, count) = track.information?.residuals;
        Some(count * math::ln((squares / count).max(0.1)))
    };
    let pairs = tracks.iter().zip(other).filter_map(|(a, b)| Some(misfit(b)? - misfit(a)?));
    let votes: Vec<f64> = pairs.map(|gain| if gain.abs() < CLEAR_GAIN { 0.0 } else { gain.signum() }).collect();
    votes.iter().sum::<f64>() / votes.len().max(1) as f64
}

/// By which factor the drift's variance should change. All tracks have the tracking's drift, some have more of their own: the
/// lower of them count, and the settings' value as some more. `own`: each track's variance and its degrees of freedom.
fn drift_change(own: impl Iterator<Item = (f64, f64)>, scale: f64) -> f64 {
    let mut ratios: Vec<(f64, f64)> = own.map(|(own, freedom)| (own / scale, freedom)).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let freedom: f64 = ratios.iter().map(|ratio| ratio.1).sum();
    let mut above = DRIFT_QUANTILE * freedom;
    let lower = ratios.iter().find(|ratio| {
        above -= ratio.1;
        above <= 0.0
    });
    let change =
        (lower.map_or(1.0, |ratio| ratio.0) * freedom + DRIFT_PRIOR_FREEDOM / scale) / (freedom + DRIFT_PRIOR_FREEDOM);
    change.clamp(1.0 / MAX_DRIFT_CHANGE, MAX_DRIFT_CHANGE)
}

/// Slow tracking error in each axis, rms, metres.
fn drift_m(point: &Point, errors: &PositionErrors) -> f64 {
    (point.drift_scale * errors.slow_variance_m2()).sqrt()
}

fn calibration(point: &Point, combination: &Combination, errors: &PositionErrors) -> Calibration {
    let covariance: &Matrix = &combination.covariance;
    let sigma_s = covariance[OFFSET][OFFSET].sqrt();
    let column = |k: usize| DVec3::from_array(std::array::from_fn(|row| covariance[SHIFT + row][SHIFT + k]));
    Calibration {
        time_offset: TimeOffset {
            offset_s: point.at[OFFSET],
            sigma_s,
            observable: sigma_s <= OBSERVED_S,
            tracks: combination.counts.0,
            tracks_left_out: combination.counts.1,
        },
        mount_shift_m: DVec3::new(point.at[SHIFT], point.at[SHIFT + 1], point.at[SHIFT + 2]),
        mount_covariance_m2: DMat3::from_cols(column(0), column(1), column(2)),
        range_bias_m: point.at[BIAS],
        range_bias_sigma_m: covariance[BIAS][BIAS].sqrt(),
        drift_m: drift_m(point, errors),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Plane;
    use crate::test_data::{Echo, sweeps, winding};
    use glam::DQuat;

    const AT: DVec3 = DVec3::new(0.2, 0.1, -1.2);
    const POINT: [(Echo, f64); 1] = [(Echo::Point(AT), 8.0)];

    fn settings() -> CalibrationSettings {
        CalibrationSettings::new(0.0, PositionErrors::default())
    }

    /// Sweeps along one path of the sensor, poses along another with time stamps late by the offset.
    fn estimated(
        seen: impl Fn(f64) -> DVec3,
        tracked: impl Fn(f64) -> Pose,
        echoes: &[(Echo, f64)],
        (duration_s, offset_s): (f64, f64),
    ) -> Option<Calibration> {
        let mut estimator = SelfCalibration::new(settings());
        for step in -60..(duration_s * 200.0) as i32 + 100 {
            let time_s = f64::from(step) * 5e-3;
            let velocity = (tracked(time_s + 1e-4).translation - tracked(time_s - 1e-4).translation) / 2e-4;
            estimator.push_path(1_000_000_000 + ((time_s + offset_s) * 1e9) as i64, &tracked(time_s), velocity);
        }
        sweeps(duration_s, seen, echoes, 1).iter().for_each(|sweep| estimator.push_sweep(sweep));
        estimator.estimate()
    }

    /// 90 cm across.
    fn wide(time_s: f64) -> DVec3 {
        winding(time_s) * 3.0
    }

    fn level(path: impl Fn(f64) -> DVec3) -> impl Fn(f64) -> Pose {
        move |time_s| Pose::from_translation(path(time_s))
    }

    fn is_right(estimate: Option<Calibration>, offset_s: f64) -> bool {
        let offset = estimate.map(|estimate| estimate.time_offset);
        offset.is_some_and(|e| e.observable && (e.offset_s - offset_s).abs() < 3.0 * e.sigma_s && e.sigma_s < 2e-3)
    }

    #[test]
    fn offset_is_estimated_from_a_point_and_from_a_plane() {
        let plane = Plane { outward: DVec3::new(0.36, 0.48, -0.8), offset_m: 1.3 };
        for echoes in [POINT, [(Echo::Plane(plane), 8.0)]] {
            for offset_s in [-0.07, 0.0, 0.02] {
                let estimate = estimated(wide, level(wide), &echoes, (2.0, offset_s));
                assert!(is_right(estimate, offset_s), "{offset_s}: {estimate:?} of {echoes:?}");
            }
        }
    }

    #[test]
    fn straight_approach_leaves_offset_unobservable() {
        let approach = |t: f64| DVec3::new(0.0, 0.0, -0.3 * t);
        let offset = |estimate: Option<Calibration>| estimate.map(|estimate| estimate.time_offset);
        let estimate = offset(estimated(approach, level(approach), &POINT, (2.0, 0.02)));
        assert!(estimate.is_none_or(|e| !e.observable && e.sigma_s > 0.01), "{estimate:?}");
        // At rest, pose jitter does not count as motion.
        let jitter = |t: f64| 0.12e-3 * DVec3::new((61.0 * t).sin(), (53.0 * t).cos(), (57.0 * t).sin());
        let estimate = offset(estimated(|_| DVec3::ZERO, level(jitter), &POINT, (2.0, 0.02)));
        assert!(estimate.is_none_or(|e| !e.observable), "{estimate:?}");
    }

    #[test]
    fn moving_target_gives_no_confident_wrong_offset() {
        // An object that swings by 6 cm is equivalent to a sensor that swings the other way.
        let swinging = |t: f64| winding(t) - 0.06 * DVec3::new((5.0 * t).sin(), 0.0, (4.0 * t).cos());
        let estimate = estimated(swinging, level(winding), &POINT, (2.0, 0.0)).map(|estimate| estimate.time_offset);
        assert!(estimate.is_none_or(|e| !e.observable || e.offset_s.abs() < 3.0 * e.sigma_s), "{estimate:?}");
    }

    #[test]
    fn tracks_that_slide_do_not_count_as_drift_of_the_tracking() {
        let honest = |n: usize| (1.0 + 0.1 * n as f64, 8.0);
        let own = || (0..6).map(honest).chain((0..14).map(|n| (20.0 + n as f64, 8.0)));
        let mut scale = 1.0;
        for _ in 0..20 {
            scale *= drift_change(own(), scale);
        }
        assert!((0.9..1.6).contains(&scale), "{scale}");
        // All of them: it is the tracking.
        for _ in 0..20 {
            scale *= drift_change((0..14).map(|n| (20.0 + f64::from(n), 8.0)), scale);
        }
        assert!((15.0..25.0).contains(&scale), "{scale}");
        assert!((drift_change(std::iter::empty(), 4.0) - 0.25).abs() < 1e-12, "the settings' alone");
    }

    #[test]
    fn noise_gives_no_estimate() {
        assert_eq!(estimated(winding, level(winding), &[], (2.0, 0.02)), None);
    }

    /// A head that moves and turns by half a radian.
    fn turning(time_s: f64) -> Pose {
        let (yaw, pitch) = (0.5 * (1.9 * time_s).sin(), 0.4 * (2.3 * time_s + 0.4).sin());
        let rotation = DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch);
        Pose { translation: winding(time_s), rotation }
    }

    #[test]
    fn mount_is_estimated_while_the_head_turns_and_left_unknown_while_it_does_not() {
        let shift_m = DVec3::new(0.03, -0.02, 0.025);
        let echoes = [(Echo::Point(AT), 8.0), (Echo::Point(DVec3::new(-0.6, 0.3, -1.9)), 8.0)];
        let seen = |pose: Pose| pose.transform_point(shift_m);
        let found = estimated(|t| seen(turning(t)), turning, &echoes, (12.0, 0.015)).unwrap();
        let error_m = found.mount_shift_m - shift_m;
        let squared = error_m.dot(found.mount_covariance_m2.inverse() * error_m);
        assert!(error_m.length() < 3e-3 && squared < 12.0, "{found:?}");
        assert!(is_right(Some(found), 0.015), "{found:?}");
        // Without rotation a shifted sensor sees a shifted room.
        let still = |t: f64| Pose::from_translation(winding(t));
        let found = estimated(|t| seen(still(t)), still, &echoes, (12.0, 0.015)).unwrap();
        let sigma_m = found.mount_covariance_m2.x_axis.x.sqrt();
        assert!(is_right(Some(found), 0.015) && sigma_m > 0.04, "{found:?}");
        // Turning to the sides makes the lateral position observable, not the height.
        let yaw = |t: f64| Pose { rotation: DQuat::from_rotation_y(0.5 * (1.9 * t).sin()), ..still(t) };
        let found = estimated(|t| seen(yaw(t)), yaw, &echoes, (12.0, 0.015)).unwrap();
        let sigma_m = DMat3::to_cols_array_2d(&found.mount_covariance_m2);
        assert!(sigma_m[0][0].sqrt() < 5e-3 && sigma_m[1][1].sqrt() > 0.02, "{found:?}");
        assert!((found.mount_shift_m.x - shift_m.x).abs() < 5e-3, "{found:?}");
    }
}
