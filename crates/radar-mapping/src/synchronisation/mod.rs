//! The synchronisation test of the thesis (3.5.4) on a recording: do the timestamps of poses and
//! sweeps agree, at the start and later?
//!
//! The sensor moves towards a stationary reflector and away from it. Its distance by poses and its
//! radar range coincide over time when the streams are synchronous. The offset is estimated in two
//! ways, over the whole recording and in windows: by the pipeline's estimator (ranges and phases of
//! all echoes), and, as a check that shares only the ranges of one reflector with it, by
//! correlating the rates of distance and range.
//!
//! The first window contains the first two seconds of motion, so that a lag at the start becomes
//! visible.
//!
//! Limits: the estimator searches 0.1 s around its centre. Where the rates correlate well farther
//! off, up to a second, the centre is moved there. Both methods assume a constant offset within a
//! window; [`LagCurve`] follows a changing one.

mod lag_curve;
mod mount;
mod ranges;
mod rates;

use glam::DVec3;
use serde::Serialize;

use crate::{Event, Mapper, in_time_order};
use crate::{MappingSettings, MountEstimate};
use crate::{Observer, ObserverSettings, SensorState};
use a121::{Frame, SensorConfig};
pub use lag_curve::{Lag, LagCurve};
use radar_sar::Observation;
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::{CalibrationSettings, SelfCalibration, TimeOffset};
use ranges::RangeReader;
use rates::{RateSeries, offset_by_rates};

/// Length of the first window, and of the others where there are not too many, seconds. Choice: the
/// start that the thesis examines (4.1.3), and time for a stroke to and fro.
const WINDOW_S: f64 = 2.0;
/// Largest number of windows after the first; longer recordings get longer windows. Choice: as many
/// as a table or a chart shows; each costs an estimate.
const MAX_WINDOWS: f64 = 20.0;
/// The estimate of the whole recording combines parts of at most this length, seconds. Choice: the
/// estimator's memory, `MEMORY_S` of its module, beyond which it forgets.
const MAX_PART_S: f64 = 20.0;
/// Obstacles tried as the reflector. Choice: the test is made before one strong reflector, rarely
/// after more than a few others in evidence, and each costs a pass over all sweeps.
const MAX_REFLECTORS: usize = 6;
/// Least speed that counts as motion, m/s. Choice: well above the noise of a resting head's speed,
/// well below a stroke's.
const MOVING_M_PER_S: f64 = 0.1;
/// Margin of the path around a window, seconds: its sweeps may belong to it. Choice: the
/// estimator's reach of 0.1 s, and the smoothing of the poses.
const PATH_MARGIN_S: f64 = 0.25;
/// Correlation from which on the rates move the estimator's centre, when they differ by more than
/// this, seconds. Choice: r = 0.9 explains 81 % of the variance, which another echo's rates do not;
/// nearer offsets are within the estimator's own reach of 0.1 s.
const TRUSTED_CORRELATION: f64 = 0.9;
const NEAR_S: f64 = 0.07;
/// A lag is significant from this many 1σ and from this many seconds on. Choice: 3σ; 1 ms moves an
/// echo by a millimetre at 1 m/s, which tracking errors hide.
const SIGNIFICANT: f64 = 3.0;
const MIN_SIGNIFICANT_LAG_S: f64 = 1e-3;

/// Why a recording gives no result.
#[derive(Debug, thiserror::Error)]
pub enum SynchronisationError {
    /// No sweep has a pose.
    #[error("no sweep has a pose, so nothing can be compared: `radar-chaperone info` shows what the recording holds")]
    NoPoses,
    /// There is no reflector.
    #[error(
        "no stationary reflector was found to measure the range of: move the sensor towards a strong reflector and back"
    )]
    NoReflector,
    /// Its echo is rarely visible.
    #[error("the reflector's echo was read {0} times: too few to compare")]
    FewRanges(usize),
}

/// An offset estimated from rates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RateOffset {
    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// Correlation of the rates at this offset; 1 is perfect.
    pub correlation: f64,
}

/// Offset of a part of the recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OffsetWindow {
    /// Start since the recording's first sweep, seconds.
    pub from_s: f64,
    /// End, likewise.
    pub to_s: f64,
    /// From ranges and phases of all echoes; `None`: no result.
    pub estimate: Option<TimeOffset>,
    /// From the rates of one reflector; `None`: no result.
    pub by_rates: Option<RateOffset>,
}

/// Lag of the first seconds of motion relative to the rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StartLag {
    /// Offset of the first window minus offset of the others, seconds.
    pub lag_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// Larger than chance explains.
    pub is_significant: bool,
}

/// Result of the synchronisation test.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Synchronisation {
    /// Position of the reflector, tracking frame, metres.
    pub reflector_m: DVec3,
    /// The offset in the settings, seconds.
    pub set_offset_s: f64,
    /// The whole recording.
    pub whole: OffsetWindow,
    /// The first two seconds of motion, then the rest in windows.
    pub windows: Vec<OffsetWindow>,
    /// The first window relative to the others; `None`: not both have a result.
    pub start_lag: Option<StartLag>,
    /// The sensor's position on the head; `None`: no result.
    pub mount: Option<MountEstimate>,
    /// Spread of radar range minus pose distance with the offset in the settings, as a standard
    /// deviation, metres.
    pub spread_as_set_m: f64,
    /// The same with the estimated offset; `None`: there is none.
    pub spread_corrected_m: Option<f64>,
    /// Range of the reflector by radar: seconds since the first sweep, metres.
    #[serde(skip)]
    pub radar_range_m: Vec<[f64; 2]>,
    /// Distance of the reflector by poses, at the timestamps of the poses.
    #[serde(skip)]
    pub pose_range_m: Vec<[f64; 2]>,
}

/// The joined streams, in the map frame.
struct JoinedStreams {
    path: Vec<SensorState>,
    observations: Vec<Observation>,
    /// From the tracking frame at the end.
    map_from_tracking: Pose,
}

/// Runs the test on a recording in memory.
///
/// # Errors
/// No sweep has a pose; there is no stationary reflector; its echo is rarely visible.
pub fn synchronisation(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Result<Synchronisation, SynchronisationError> {
    let joined = join_streams(config, head_from_sensor, settings, frames, poses);
    let (start_ns, end_ns) = span(&joined)?;
    let TrackedReflector { position_m, radar, by_poses } =
        track_reflector(&joined, config, head_from_sensor, settings, frames, poses)?;
    let rates = [RateSeries::of(&radar), RateSeries::of(&by_poses)];
    let set_s = settings.tracking.time_offset_s;
    let spans = spans(&joined.path, start_ns, end_ns);
    let [mut whole, windows] = [&spans[..1], &spans[1..]].map(|spans| -> Vec<OffsetWindow> {
        let by_rates = |span: &Span| offset_by_rates(&rates[0], &rates[1], (span.from_ns, span.to_ns), set_s);
        spans.iter().map(|span| span.window(start_ns, by_rates(span))).collect()
    });
    let mut windows = windows;
    estimate(&mut windows, &joined, start_ns, settings);
    estimate_whole(&mut whole[0], &joined, start_ns, settings);
    let whole = whole[0];
    let mount = mount::mount(&joined, head_from_sensor, settings, middle_s(&whole, set_s));
    let found_s = whole.estimate.filter(|e| e.observable).map(|e| e.offset_s);
    Ok(Synchronisation {
        reflector_m: joined.map_from_tracking.inverse().transform_point(position_m),
        set_offset_s: set_s,
        start_lag: start_lag(&windows),
        mount,
        windows,
        whole,
        spread_as_set_m: ranges::spread_m(&radar, &by_poses, set_s),
        spread_corrected_m: found_s.map(|offset_s| ranges::spread_m(&radar, &by_poses, offset_s)),
        radar_range_m: since(start_ns, &radar),
        pose_range_m: since(start_ns, &by_poses),
    })
}

/// One reflector by radar and by poses: the input of a [`LagCurve`].
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectorSeries {
    /// Its range by radar: seconds since the first sweep, metres.
    pub radar_range_m: Vec<[f64; 2]>,
    /// Its distance by poses, at the timestamps of the poses.
    pub pose_range_m: Vec<[f64; 2]>,
}

/// The two series that [`synchronisation`] compares, without the comparison. The reflector's
/// position comes from the later half only, so that streams out of step at the start do not
/// displace it.
///
/// # Errors
/// As [`synchronisation`].
pub fn reflector_series(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Result<ReflectorSeries, SynchronisationError> {
    let joined = join_streams(config, head_from_sensor, settings, frames, poses);
    let (start_ns, _) = span(&joined)?;
    let TrackedReflector { radar, by_poses, .. } =
        track_reflector(&joined, config, head_from_sensor, settings, &frames[frames.len() / 2..], poses)?;
    Ok(ReflectorSeries { radar_range_m: since(start_ns, &radar), pose_range_m: since(start_ns, &by_poses) })
}

fn since(start_ns: i64, series: &[(i64, f64)]) -> Vec<[f64; 2]> {
    series.iter().map(|(time_ns, range_m)| [(time_ns - start_ns) as f64 * 1e-9, *range_m]).collect()
}

/// Times of the first and the last sweep with a pose.
fn span(joined: &JoinedStreams) -> Result<(i64, i64), SynchronisationError> {
    let (Some(first), Some(last)) = (joined.observations.first(), joined.observations.last()) else {
        return Err(SynchronisationError::NoPoses);
    };
    Ok((first.mid_time_ns, last.mid_time_ns))
}

/// The reflector whose echo is tracked best, with enough ranges to compare.
fn track_reflector(
    joined: &JoinedStreams,
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Result<TrackedReflector, SynchronisationError> {
    let mut positions_m = reflectors(config, head_from_sensor, settings, frames, poses);
    positions_m.iter_mut().for_each(|at_m| *at_m = joined.map_from_tracking.transform_point(*at_m));
    let reflector = best_reflector(&positions_m, joined, settings).ok_or(SynchronisationError::NoReflector)?;
    match reflector.radar.len() {
        count if count < ranges::MIN_RANGES => Err(SynchronisationError::FewRanges(count)),
        _ => Ok(reflector),
    }
}

/// Most steps of the path, 5 ms each; what comes later is not used. Choice: half an hour, 35 MB. Poses two
/// seconds apart give 400 steps each.
const MAX_PATH: usize = 360_000;

fn join_streams(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> JoinedStreams {
    let mut observer = Observer::new(config, ObserverSettings::new(settings, head_from_sensor));
    let (mut path, mut observations) = (Vec::new(), Vec::new());
    for event in in_time_order(frames.iter().cloned(), poses.iter().copied()) {
        // What is refused is counted.
        let _ = match event {
            Event::Frame(frame) => observer.push_frame(frame),
            Event::Pose(pose) => observer.push_pose(&pose),
            Event::Hands(_) => Ok(()),
        };
        path.append(&mut observer.take_path());
        observations.append(&mut observer.take_ready());
        if path.len() > MAX_PATH {
            break;
        }
    }
    observations.append(&mut observer.take_rest());
    JoinedStreams { path, observations, map_from_tracking: observer.map_from_tracking() }
}

/// A position with its radar ranges and its distances by poses.
struct TrackedReflector {
    position_m: DVec3,
    radar: Vec<(i64, f64)>,
    by_poses: Vec<(i64, f64)>,
}

/// The position whose strongest echo follows its distance most often, so that it stands out from
/// its surroundings.
fn best_reflector(
    positions_m: &[DVec3],
    joined: &JoinedStreams,
    settings: &MappingSettings,
) -> Option<TrackedReflector> {
    let followed = |position_m: &DVec3| {
        let distance_m = |at: &SensorState| (at.time_ns, at.tracking_from_sensor.translation.distance(*position_m));
        let by_poses: Vec<(i64, f64)> = joined.path.iter().map(distance_m).collect();
        let radar = RangeReader::new(*position_m, settings).read(&joined.observations);
        let count = ranges::count_following(&radar, &by_poses, settings.tracking.time_offset_s);
        (count, TrackedReflector { position_m: *position_m, radar, by_poses })
    };
    // Among equals the first, which is the strongest.
    let best = positions_m.iter().map(followed).reduce(|best, next| if next.0 > best.0 { next } else { best });
    best.map(|(_, followed)| followed)
}

/// The strongest obstacles that the pipeline finds.
fn reflectors(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Vec<DVec3> {
    let mut mapper = Mapper::new(config, head_from_sensor, settings);
    mapper.push_all(in_time_order(frames.iter().cloned(), poses.iter().copied()));
    // Obstacles are sorted by falling evidence.
    mapper.scene().obstacles.iter().take(MAX_REFLECTORS).map(|obstacle| obstacle.position_m).collect()
}

/// A part of the recording, in sweep time.
#[derive(Debug, Clone, Copy)]
struct Span {
    from_ns: i64,
    to_ns: i64,
}

impl Span {
    fn window(&self, start_ns: i64, by_rates: Option<RateOffset>) -> OffsetWindow {
        let since_s = |time_ns: i64| (time_ns - start_ns) as f64 * 1e-9;
        OffsetWindow { from_s: since_s(self.from_ns), to_s: since_s(self.to_ns), estimate: None, by_rates }
    }
}

/// The whole, the first two seconds of motion, and the rest in equal parts.
fn spans(path: &[SensorState], start_ns: i64, end_ns: i64) -> Vec<Span> {
    let is_motion = |at: &&SensorState| at.time_ns >= start_ns && at.velocity_m_per_s.length() > MOVING_M_PER_S;
    let moving_ns = path.iter().find(is_motion).map_or(start_ns, |at| at.time_ns).min(end_ns);
    let window_ns = (WINDOW_S * 1e9) as i64;
    let first = Span { from_ns: moving_ns, to_ns: moving_ns.saturating_add(window_ns).min(end_ns) };
    let mut spans = vec![Span { from_ns: start_ns, to_ns: end_ns }, first];
    let left_s = (end_ns - first.to_ns) as f64 * 1e-9;
    let parts = (left_s / WINDOW_S).floor().clamp(0.0, MAX_WINDOWS) as i64;
    let edge = |n: i64| first.to_ns + (end_ns - first.to_ns) / parts.max(1) * n;
    spans.extend((0..parts).map(|n| Span { from_ns: edge(n), to_ns: edge(n + 1) }));
    spans
}

/// Estimates the offset of each window.
fn estimate(windows: &mut [OffsetWindow], joined: &JoinedStreams, start_ns: i64, settings: &MappingSettings) {
    for window in windows {
        let middle_s = middle_s(window, settings.tracking.time_offset_s);
        let at_ns = |since_s: f64| start_ns.saturating_add((since_s * 1e9).round() as i64);
        let (from_ns, to_ns) = (at_ns(window.from_s), at_ns(window.to_s));
        let mut estimator = SelfCalibration::new(CalibrationSettings::new(middle_s, settings.tracking.errors));
        let [early_ns, late_ns] = [middle_s - PATH_MARGIN_S, middle_s + PATH_MARGIN_S].map(|s| (s * 1e9) as i64);
        let (path_from_ns, path_to_ns) = (from_ns.saturating_add(early_ns), to_ns.saturating_add(late_ns));
        let first = joined.path.partition_point(|at| at.time_ns < path_from_ns);
        for at in joined.path[first..].iter().take_while(|at| at.time_ns <= path_to_ns) {
            estimator.push_path(at.time_ns, &at.tracking_from_sensor, at.velocity_m_per_s);
        }
        let first = joined.observations.partition_point(|o| o.mid_time_ns < from_ns);
        let within = joined.observations[first..].iter().take_while(|o| o.mid_time_ns <= to_ns);
        within.for_each(|observation| estimator.push_sweep(observation));
        window.estimate = estimator.estimate().map(|calibration| calibration.time_offset);
    }
}

/// Centre of the estimator's search.
fn middle_s(window: &OffsetWindow, set_s: f64) -> f64 {
    let far = |rates: &RateOffset| rates.correlation >= TRUSTED_CORRELATION && (rates.offset_s - set_s).abs() > NEAR_S;
    window.by_rates.filter(far).map_or(set_s, |rates| rates.offset_s)
}

/// The estimate of the whole: of parts as long as the estimator's memory, weighted by their
/// variances.
fn estimate_whole(whole: &mut OffsetWindow, joined: &JoinedStreams, start_ns: i64, settings: &MappingSettings) {
    let parts = ((whole.to_s - whole.from_s) / MAX_PART_S).ceil().max(1.0);
    let edge_s = |n: f64| whole.from_s + (whole.to_s - whole.from_s) * n / parts;
    let part = |n: usize| OffsetWindow { from_s: edge_s(n as f64), to_s: edge_s(n as f64 + 1.0), ..*whole };
    let mut parts: Vec<OffsetWindow> = (0..parts as usize).map(part).collect();
    estimate(&mut parts, joined, start_ns, settings);
    let observable: Vec<TimeOffset> = parts.iter().filter_map(|part| part.estimate).filter(|e| e.observable).collect();
    whole.estimate = match parts.as_slice() {
        [only] => only.estimate,
        _ => mean(observable.iter().map(|e| (e.offset_s, e.sigma_s))).map(|(offset_s, sigma_s)| TimeOffset {
            offset_s,
            sigma_s,
            observable: true,
            tracks: observable.iter().map(|e| e.tracks).sum(),
            tracks_left_out: observable.iter().map(|e| e.tracks_left_out).sum(),
        }),
    };
}

/// Inverse-variance weighted mean and its 1σ, which is at least what the spread of the values
/// implies; `None` without values.
fn mean(values: impl Iterator<Item = (f64, f64)> + Clone) -> Option<(f64, f64)> {
    let weight = |sigma_s: f64| sigma_s.max(1e-9).powi(-2);
    let total: f64 = values.clone().map(|(_, sigma_s)| weight(sigma_s)).sum();
    let count = values.clone().count() as f64;
    let mean = values.clone().map(|(value, sigma_s)| value * weight(sigma_s)).sum::<f64>() / total;
    let misfit = values.map(|(value, sigma_s)| (value - mean).powi(2) * weight(sigma_s)).sum::<f64>();
    let spread = (misfit / (count - 1.0).max(1.0)).max(1.0);
    (count > 0.0).then(|| (mean, (spread / total).sqrt()))
}

/// The first window relative to the others.
fn start_lag(windows: &[OffsetWindow]) -> Option<StartLag> {
    let estimate_of = |window: &OffsetWindow| -> Option<(f64, f64)> {
        let by_rates =
            || window.by_rates.filter(|r| r.correlation >= TRUSTED_CORRELATION).map(|r| (r.offset_s, r.sigma_s));
        window.estimate.filter(|e| e.observable).map(|e| (e.offset_s, e.sigma_s)).or_else(by_rates)
    };
    let (first, others) = windows.split_first()?;
    let others: Vec<(f64, f64)> = others.iter().filter_map(estimate_of).collect();
    let ((first_s, first_sigma_s), (rest_s, rest_sigma_s)) = (estimate_of(first)?, mean(others.iter().copied())?);
    let (lag_s, sigma_s) = (first_s - rest_s, math::hypot(first_sigma_s, rest_sigma_s));
    Some(StartLag { lag_s, sigma_s, is_significant: lag_s.abs() > (SIGNIFICANT * sigma_s).max(MIN_SIGNIFICANT_LAG_S) })
}
