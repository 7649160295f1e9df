//! Incremental estimator of the corrections: tracks are fitted when they end, open ones at every query.

use std::collections::{BTreeMap, VecDeque};

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::boresight::{Directions, EchoDirections};
use super::combination::Combination;
use super::corrections::{BIAS, Matrix, OFFSET, Quadratic, SHIFT};
use super::echoes::EchoReader;
use super::fitted_track::FittedTrack;
use super::path::{SensorPath, Unsteadiness};
use super::solver::{FormerTracks, Point, REACH_S, Solver};
use super::track_fit::{MARGIN_NS, TrackFit};
use super::tracks::{Track, Tracks};
use crate::geometry::Pose;
use crate::math;
use crate::{Beam, Observation, PositionErrors};

/// Nearest range used, metres. Measured: in the vendor's recordings the antenna's leakage reaches
/// to 0.1 m, in profile 3 its tail to 0.2 m.
const MIN_RANGE_M: f64 = 0.2;
/// Time after which the tracks' information on the time offset is dropped, nanoseconds; that on the rest is kept as a sum.
/// Choice: long enough to average over several movements, short enough that slow drifts of the offset are followed.
const MEMORY_NS: i64 = 20_000_000_000;
/// Time constant with which the sum is forgotten, seconds. Choice: a sensor that was knocked is found again in
/// minutes.
const FORGET_S: f64 = 600.0;
/// An offset with a greater 1σ counts as unobserved, seconds. Choice: 5 ms misplace an echo by 5 mm
/// at 1 m/s; it would not improve anything.
const OBSERVED_S: f64 = 5e-3;
/// Less than this from rest is rest, and from uniform motion is uniform, metres. Choice: as far as a slow tracking error of 1 mm
/// strays within a track, from which such a motion cannot be distinguished.
const STEADY_M: f64 = 4e-3;
/// Starts are compared again when this share of the tracks of other than uniform motion ended since. Choice: a track is then fitted
/// for them about twice, however long the motion leaves the offset unobserved.
const COMPARE_AFTER_SHARE: f64 = 0.5;
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

/// Estimates the corrections from sweeps and the sensor's assumed path.
#[derive(Debug)]
pub struct SelfCalibration {
    settings: CalibrationSettings,
    path: SensorPath,
    subsweeps: BTreeMap<usize, (EchoReader, Tracks)>,
    waiting: VecDeque<Track>,
    fitted: VecDeque<FittedTrack>,
    former: FormerTracks,
    /// Where the echoes of former tracks came from.
    former_directions: VecDeque<Directions>,
    /// Where the last estimate ended.
    last: Option<Point>,
    /// Whether a comparison of starts found a time offset that was observed; then there is no further one.
    is_start_known: bool,
    /// Tracks of other than uniform motion that ended since starts were compared; `None` before that.
    varied_since_comparison: Option<usize>,
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
            former: FormerTracks::default(),
            former_directions: VecDeque::new(),
            last: None,
            is_start_known: false,
            varied_since_comparison: None,
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
            self.waiting.extend(done.into_iter().filter(|track| TrackFit::is_possible(&track.echoes)));
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
        Some(calibration(&point, &combination, &self.settings.errors))
    }

    /// Begins at the last estimate. Until the time offset is known, that may be the wrong one of several optima: starts are
    /// compared before an offset counts as known, and from time to time, since from a wrong one it may never be observed.
    fn solve(&mut self, tracks: &mut [FittedTrack]) -> Option<(Point, Combination)> {
        let solver = Solver { settings: &self.settings, path: &self.path, former: &self.former };
        let observed = |found: &Option<(Point, Combination)>| found.as_ref().is_some_and(|found| is_observed(&found.1));
        let varied = tracks.iter().filter(|track| !track.is_uniform).count();
        let are_new = |count: usize| count as f64 >= COMPARE_AFTER_SHARE * varied as f64;
        let is_open = !self.is_start_known && varied > 0;
        let is_due = is_open && self.varied_since_comparison.is_none_or(are_new);
        let mut found = match is_due {
            true => None,
            false => solver.near(tracks, self.last.unwrap_or_else(|| solver.start(0.0))),
        };
        if is_due || (is_open && observed(&found)) {
            found = solver.of_best_start(tracks);
            (self.varied_since_comparison, self.is_start_known) = (Some(0), observed(&found));
        }
        // From where the offset was observed, it does not wander off while it is not.
        if !self.is_start_known || observed(&found) {
            self.last = found.as_ref().map(|(point, _)| *point).or(self.last);
        }
        found
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
            let parts = self.prepared(&track);
            if let Some(count) = &mut self.varied_since_comparison {
                *count += parts.iter().filter(|part| !part.is_uniform).count();
            }
            self.fitted.extend(parts);
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
    /// tracking frame, parts the track. Those at rest show nothing.
    fn prepared(&self, track: &Track) -> Vec<FittedTrack> {
        let [early_ns, late_ns] = [self.early_ns(), self.late_ns()];
        let (from_ns, to_ns) = (track.first_ns().saturating_add(early_ns), track.last_ns().saturating_add(late_ns));
        let part = |(first_ns, last_ns): (i64, i64)| {
            let index = |time_ns: i64| track.echoes.partition_point(|echo| echo.time_ns < time_ns);
            let begin = index(first_ns.saturating_sub(early_ns));
            let end = index(last_ns.saturating_sub(late_ns)).max(begin);
            let Unsteadiness { from_rest_m, from_uniform_m } =
                self.path.unsteadiness(first_ns.max(from_ns), last_ns.min(to_ns));
            if from_rest_m < STEADY_M {
                return None;
            }
            let fit = TrackFit::new(&track.echoes[begin..end], track.forward, &self.settings.errors)?;
            Some(FittedTrack::new(fit, from_uniform_m < STEADY_M))
        };
        self.path.stretches(from_ns, to_ns).into_iter().filter_map(part).collect()
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
        for (term, weight) in point.terms(old.iter(), &self.settings.errors).iter().zip(&combination.weights) {
            old_sum.add(&term.quadratic, weight / combination.disagreement);
        }
        let mut quadratic = old_sum.without(OFFSET, f64::INFINITY);
        quadratic.add(&self.former.seen_from(&point.at), math::exp(-(MEMORY_NS as f64) * 1e-9 / FORGET_S));
        self.former = FormerTracks { quadratic, at: point.at };
    }

    fn forget_path(&mut self, end_ns: i64) {
        let open = self.subsweeps.values().flat_map(|(_, tracks)| tracks.open()).chain(&self.waiting);
        let fitted = self.fitted.iter().map(|track| track.fit.first_ns);
        let oldest_ns = open.map(Track::first_ns).chain(fitted).min().unwrap_or(end_ns);
        self.path.forget_before(oldest_ns.saturating_add(self.early_ns()).min(end_ns).saturating_sub(100_000_000));
    }
}

fn is_observed(combination: &Combination) -> bool {
    combination.covariance[OFFSET][OFFSET].sqrt() <= OBSERVED_S
}

fn calibration(point: &Point, combination: &Combination, errors: &PositionErrors) -> Calibration {
    let covariance: &Matrix = &combination.covariance;
    let sigma_s = covariance[OFFSET][OFFSET].sqrt();
    let column = |k: usize| DVec3::from_array(std::array::from_fn(|row| covariance[SHIFT + row][SHIFT + k]));
    Calibration {
        time_offset: TimeOffset {
            offset_s: point.at[OFFSET],
            sigma_s,
            observable: is_observed(combination),
            tracks: combination.counts.0,
            tracks_left_out: combination.counts.1,
        },
        mount_shift_m: point.shift_m(),
        mount_covariance_m2: DMat3::from_cols(column(0), column(1), column(2)),
        range_bias_m: point.at[BIAS],
        range_bias_sigma_m: covariance[BIAS][BIAS].sqrt(),
        drift_m: point.drift_m(errors),
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
        assert_eq!(estimated(|_| DVec3::ZERO, level(jitter), &POINT, (2.0, 0.02)), None);
        let sway = |t: f64| 40.0 * jitter(0.02 * t);
        let estimate = offset(estimated(sway, level(sway), &POINT, (2.0, 0.02))).unwrap();
        assert!(!estimate.observable, "{estimate:?}");
    }

    #[test]
    fn moving_target_gives_no_confident_wrong_offset() {
        // An object that swings by 6 cm is equivalent to a sensor that swings the other way.
        let swinging = |t: f64| winding(t) - 0.06 * DVec3::new((5.0 * t).sin(), 0.0, (4.0 * t).cos());
        let estimate = estimated(swinging, level(winding), &POINT, (2.0, 0.0)).map(|estimate| estimate.time_offset);
        assert!(estimate.is_none_or(|e| !e.observable || e.offset_s.abs() < 3.0 * e.sigma_s), "{estimate:?}");
    }

    #[test]
    fn noise_gives_no_estimate() {
        assert_eq!(estimated(winding, level(winding), &[], (2.0, 0.02)), None);
    }

    /// Estimates once a second along a path whose poses have another offset than the middle of the search.
    fn estimates(
        path: impl Fn(f64) -> Pose,
        duration_s: i32,
        middle_s: f64,
        offset_s: f64,
    ) -> Vec<Option<Calibration>> {
        let mut estimator = SelfCalibration::new(CalibrationSettings { middle_s, ..settings() });
        let sweeps = sweeps(f64::from(duration_s), |t| path(t).translation, &POINT, 1);
        let mut sweeps = sweeps.iter().peekable();
        let mut found = Vec::new();
        for step in -60..duration_s * 200 + 60 {
            let time_s = f64::from(step) * 5e-3;
            let velocity = (path(time_s + 1e-4).translation - path(time_s - 1e-4).translation) / 2e-4;
            estimator.push_path(1_000_000_000 + ((time_s + offset_s) * 1e9) as i64, &path(time_s), velocity);
            let until_ns = 1_000_000_000 + (time_s * 1e9) as i64;
            while let Some(sweep) = sweeps.next_if(|sweep| sweep.mid_time_ns < until_ns) {
                estimator.push_sweep(sweep);
            }
            if step > 0 && step % 200 == 0 {
                found.push(estimator.estimate());
            }
        }
        found
    }

    #[test]
    fn far_offset_is_found_after_motion_that_left_it_open() {
        // Straight on for 8 s, then to and fro.
        let path =
            |t: f64| Pose::from_translation(DVec3::Z * (-0.03 * t.min(8.0)) + wide((t - 8.0).max(0.0)) - wide(0.0));
        let found = estimates(path, 16, 0.02, -0.06);
        let observed = |estimate: &Option<Calibration>| estimate.is_some_and(|e| e.time_offset.observable);
        assert!(!found[..7].iter().any(observed), "{found:?}");
        assert!(is_right(found[found.len() - 1], -0.06), "{:?}", found[found.len() - 1]);
    }

    #[test]
    fn what_was_found_outlasts_a_long_rest() {
        // The head moves for 8 s and lies still for 50 s.
        let path = |t: f64| turning(t.min(8.0));
        let found = estimates(path, 58, 0.0, 0.0);
        let [moving, rested] = [found[8], found[found.len() - 1]].map(Option::unwrap);
        assert!(moving.time_offset.observable && !rested.time_offset.observable);
        assert!(rested.mount_shift_m.distance(moving.mount_shift_m) < 3e-3, "{moving:?} {rested:?}");
        let sigma_m = |found: &Calibration| found.mount_covariance_m2.x_axis.x.sqrt();
        assert!(sigma_m(&rested) < 2.0 * sigma_m(&moving), "{moving:?} {rested:?}");
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
