//! The trial of the thesis' 3.5.4 on a recording: are poses and sweeps stamped with the same time, from the start and later?
//!
//! The sensor moves towards something that stands still and away from it. Its distance by the tracked poses and its range by
//! radar, laid over each other, coincide when the streams do. The offset is told twice, over the whole recording and in
//! windows: by the estimator that the pipeline uses (ranges and phases of all echoes), and, as a check that shares nothing
//! with it but the ranges of one reflector, by correlating how fast distance and range change.
//!
//! The first window holds the first two seconds of motion, so that a lag at the start shows. Limits: the estimator reaches
//! 0.1 s around where it looks; where the rates correlate well farther off, up to a second, it looks there. Both take the offset to be
//! constant within a window; [`LagCurve`] follows one that changes.

mod lag_curve;
mod ranges;
mod rates;

use glam::DVec3;
use serde::Serialize;

use super::Pipeline;
use crate::MappingSettings;
use crate::{Observer, ObserverSettings, SensorState};
use a121::{Frame, SensorConfig};
pub use lag_curve::{Lag, LagCurve};
use radar_sar::Observation;
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::{TimeOffset, TimeOffsetEstimator, TimeOffsetSettings};
use ranges::RangeReader;
use rates::{RateSeries, offset_by_rates};

/// Length of the first window, and of the others where there are not too many, seconds.
const WINDOW_S: f64 = 2.0;
/// Windows after the first at most: longer recordings have longer ones.
const MAX_WINDOWS: f64 = 20.0;
/// Estimates of the whole are made of parts of at most this length, seconds: the estimator's memory.
const MAX_PART_S: f64 = 20.0;
/// Things that are tried as the reflector.
const MAX_REFLECTORS: usize = 6;
/// Faster than this is motion, m/s.
const MOVING_M_PER_S: f64 = 0.1;
/// The path around a window that its sweeps may belong to, seconds.
const PATH_MARGIN_S: f64 = 0.25;
/// Rates that correlate so well say where to look, when that is farther off than the estimator sees well, seconds.
const TRUSTED_CORRELATION: f64 = 0.9;
const NEAR_S: f64 = 0.07;
/// A lag is told when it is this many 1σ, and this much, seconds.
const SIGNIFICANT: f64 = 3.0;
const MIN_SIGNIFICANT_LAG_S: f64 = 1e-3;

/// Why a recording tells nothing.
#[derive(Debug, thiserror::Error)]
pub enum SynchronisationError {
    /// No sweep has a pose.
    #[error("no sweep has a pose, so nothing can be compared: `radar-chaperone info` tells what the recording holds")]
    NoPoses,
    /// Nothing to measure to.
    #[error(
        "nothing that stands still was found to measure the range of: move the sensor towards a strong reflector and back"
    )]
    NoReflector,
    /// Its echo is hardly ever there.
    #[error("the reflector's echo was read {0} times: too few to compare")]
    FewRanges(usize),
}

/// An offset by rates of change.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RateOffset {
    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub offset_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// How well the rates agree there: 1 wholly.
    pub correlation: f64,
}

/// What a part of the recording says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OffsetWindow {
    /// Since the recording's first sweep, seconds.
    pub from_s: f64,
    /// See `from_s`.
    pub to_s: f64,
    /// By ranges and phases of all echoes; `None`: they tell nothing.
    pub estimate: Option<TimeOffset>,
    /// By the rates of one reflector; `None`: they tell nothing.
    pub by_rates: Option<RateOffset>,
}

/// How far the first seconds of motion are off from the rest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StartLag {
    /// Offset of the first window minus offset of the others, seconds.
    pub lag_s: f64,
    /// Its 1σ, seconds.
    pub sigma_s: f64,
    /// Beyond what chance makes.
    pub is_significant: bool,
}

/// What the trial shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Synchronisation {
    /// Place of the reflector, tracking frame, metres.
    pub reflector_m: DVec3,
    /// The offset that the settings name, seconds.
    pub set_offset_s: f64,
    /// The whole recording.
    pub whole: OffsetWindow,
    /// The first two seconds of motion, then the rest, window by window.
    pub windows: Vec<OffsetWindow>,
    /// The first window against the others; `None`: not both tell.
    pub start_lag: Option<StartLag>,
    /// Spread of radar range minus pose distance, as a standard deviation, with the offset set and with the one found, metres.
    pub spread_as_set_m: f64,
    /// See `spread_as_set_m`; `None`: none was found.
    pub spread_corrected_m: Option<f64>,
    /// Range of the reflector by radar: seconds since the first sweep, metres.
    #[serde(skip)]
    pub radar_range_m: Vec<[f64; 2]>,
    /// Distance of the reflector by poses, at the poses' own times as they are stamped.
    #[serde(skip)]
    pub pose_range_m: Vec<[f64; 2]>,
}

/// Streams joined: what is compared.
struct JoinedStreams {
    path: Vec<SensorState>,
    observations: Vec<Observation>,
}

/// Holds the trial over a recording at hand as a whole.
///
/// # Errors
/// No sweep has a pose; nothing stands still; its echo is hardly ever there.
pub fn synchronisation(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Result<Synchronisation, SynchronisationError> {
    let joined = join_streams(config, head_from_sensor, settings, frames, poses);
    let (start_ns, end_ns) = span(&joined)?;
    let TrackedReflector { place, radar, by_poses } =
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
    let found_s = whole.estimate.filter(|e| e.observable).map(|e| e.offset_s);
    Ok(Synchronisation {
        reflector_m: place,
        set_offset_s: set_s,
        start_lag: start_lag(&windows),
        windows,
        whole,
        spread_as_set_m: ranges::spread_m(&radar, &by_poses, set_s),
        spread_corrected_m: found_s.map(|offset_s| ranges::spread_m(&radar, &by_poses, offset_s)),
        radar_range_m: since(start_ns, &radar),
        pose_range_m: since(start_ns, &by_poses),
    })
}

/// One reflector by radar and by poses: what a [`LagCurve`] is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct ReflectorSeries {
    /// Its range by radar: seconds since the first sweep, metres.
    pub radar_range_m: Vec<[f64; 2]>,
    /// Its distance by poses, at the poses' own times as they are stamped.
    pub pose_range_m: Vec<[f64; 2]>,
}

/// The two series that [`synchronisation`] compares, without comparing them. The reflector is placed by the later half alone, so that streams
/// that are out of step at the start do not misplace it.
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

/// From the first sweep with a pose to the last.
fn span(joined: &JoinedStreams) -> Result<(i64, i64), SynchronisationError> {
    let (Some(first), Some(last)) = (joined.observations.first(), joined.observations.last()) else {
        return Err(SynchronisationError::NoPoses);
    };
    Ok((first.mid_time_ns, last.mid_time_ns))
}

/// The reflector that is followed best, with ranges enough to compare.
fn track_reflector(
    joined: &JoinedStreams,
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Result<TrackedReflector, SynchronisationError> {
    let places = reflectors(config, head_from_sensor, settings, frames, poses);
    let reflector = best_reflector(&places, joined, settings).ok_or(SynchronisationError::NoReflector)?;
    match reflector.radar.len() {
        count if count < ranges::MIN_RANGES => Err(SynchronisationError::FewRanges(count)),
        _ => Ok(reflector),
    }
}

fn join_streams(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> JoinedStreams {
    let tracking = &settings.tracking;
    let mut observer = Observer::new(
        config,
        ObserverSettings {
            history: tracking.history,
            head_from_sensor: tracking.mount.unwrap_or(*head_from_sensor),
            time_offset_s: tracking.time_offset_s,
        },
    );
    let mut joined = JoinedStreams { path: Vec::new(), observations: Vec::new() };
    let mut frames = frames.iter().peekable();
    for pose in poses {
        while let Some(frame) = frames.next_if(|frame| frame.host_time_ns <= pose.time_ns) {
            observer.push_frame(frame.clone());
        }
        observer.push_pose(pose);
        joined.path.append(&mut observer.take_path());
        joined.observations.append(&mut observer.take_ready());
    }
    frames.for_each(|frame| observer.push_frame(frame.clone()));
    joined.observations.append(&mut observer.take_rest());
    joined
}

/// A place, its range by radar and its distance by poses.
struct TrackedReflector {
    place: DVec3,
    radar: Vec<(i64, f64)>,
    by_poses: Vec<(i64, f64)>,
}

/// The place whose strongest echo follows its distance most often: what stands out from all around it.
fn best_reflector(places: &[DVec3], joined: &JoinedStreams, settings: &MappingSettings) -> Option<TrackedReflector> {
    let followed = |place: &DVec3| {
        let distance_m = |at: &SensorState| (at.time_ns, at.tracking_from_sensor.translation.distance(*place));
        let by_poses: Vec<(i64, f64)> = joined.path.iter().map(distance_m).collect();
        let radar = RangeReader::new(*place, settings).read(&joined.observations);
        let count = ranges::count_following(&radar, &by_poses, settings.tracking.time_offset_s);
        (count, TrackedReflector { place: *place, radar, by_poses })
    };
    // Of equals the first, which is the strongest.
    let best = places.iter().map(followed).reduce(|best, next| if next.0 > best.0 { next } else { best });
    best.map(|(_, followed)| followed)
}

/// The strongest things that the pipeline finds.
fn reflectors(
    config: &SensorConfig,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> Vec<DVec3> {
    let mut pipeline = Pipeline::new(config, head_from_sensor, settings);
    let mut frames = frames.iter().peekable();
    for pose in poses {
        while let Some(frame) = frames.next_if(|frame| frame.host_time_ns <= pose.time_ns) {
            pipeline.push_frame(frame.clone());
        }
        pipeline.push_pose(pose);
    }
    frames.for_each(|frame| pipeline.push_frame(frame.clone()));
    pipeline.finish();
    // By falling evidence.
    pipeline.scene().obstacles.iter().take(MAX_REFLECTORS).map(|obstacle| obstacle.position_m).collect()
}

/// A part of the recording, in the sweeps' time.
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

/// The whole, the first two seconds of motion, and what comes after in equal parts.
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

/// Puts the estimates of windows into them.
fn estimate(windows: &mut [OffsetWindow], joined: &JoinedStreams, start_ns: i64, settings: &MappingSettings) {
    for window in windows {
        let middle_s = middle_s(window, settings.tracking.time_offset_s);
        let at_ns = |since_s: f64| start_ns.saturating_add((since_s * 1e9).round() as i64);
        let (from_ns, to_ns) = (at_ns(window.from_s), at_ns(window.to_s));
        let mut estimator = TimeOffsetEstimator::new(TimeOffsetSettings { middle_s, errors: settings.tracking.errors });
        let [early_ns, late_ns] = [middle_s - PATH_MARGIN_S, middle_s + PATH_MARGIN_S].map(|s| (s * 1e9) as i64);
        let (path_from_ns, path_to_ns) = (from_ns.saturating_add(early_ns), to_ns.saturating_add(late_ns));
        let first = joined.path.partition_point(|at| at.time_ns < path_from_ns);
        for at in joined.path[first..].iter().take_while(|at| at.time_ns <= path_to_ns) {
            estimator.push_path(at.time_ns, at.tracking_from_sensor.translation, at.velocity_m_per_s);
        }
        let first = joined.observations.partition_point(|o| o.mid_time_ns < from_ns);
        let within = joined.observations[first..].iter().take_while(|o| o.mid_time_ns <= to_ns);
        within.for_each(|observation| estimator.push_sweep(observation));
        window.estimate = estimator.estimate();
    }
}

/// Where the estimator looks.
fn middle_s(window: &OffsetWindow, set_s: f64) -> f64 {
    let far = |rates: &RateOffset| rates.correlation >= TRUSTED_CORRELATION && (rates.offset_s - set_s).abs() > NEAR_S;
    window.by_rates.filter(far).map_or(set_s, |rates| rates.offset_s)
}

/// The estimate of the whole: of parts that the estimator remembers, weighed by their variances.
fn estimate_whole(whole: &mut OffsetWindow, joined: &JoinedStreams, start_ns: i64, settings: &MappingSettings) {
    let parts = ((whole.to_s - whole.from_s) / MAX_PART_S).ceil().max(1.0);
    let edge_s = |n: f64| whole.from_s + (whole.to_s - whole.from_s) * n / parts;
    let part = |n: usize| OffsetWindow { from_s: edge_s(n as f64), to_s: edge_s(n as f64 + 1.0), ..*whole };
    let mut parts: Vec<OffsetWindow> = (0..parts as usize).map(part).collect();
    estimate(&mut parts, joined, start_ns, settings);
    let told: Vec<TimeOffset> = parts.iter().filter_map(|part| part.estimate).filter(|e| e.observable).collect();
    whole.estimate = match parts.as_slice() {
        [only] => only.estimate,
        _ => mean(told.iter().map(|e| (e.offset_s, e.sigma_s))).map(|(offset_s, sigma_s)| TimeOffset {
            offset_s,
            sigma_s,
            observable: true,
            tracks: told.iter().map(|e| e.tracks).sum(),
            tracks_left_out: told.iter().map(|e| e.tracks_left_out).sum(),
        }),
    };
}

/// Mean by variance with its 1σ, which is no less than the values' own spread says; `None` without values.
fn mean(values: impl Iterator<Item = (f64, f64)> + Clone) -> Option<(f64, f64)> {
    let weight = |sigma_s: f64| sigma_s.max(1e-9).powi(-2);
    let total: f64 = values.clone().map(|(_, sigma_s)| weight(sigma_s)).sum();
    let count = values.clone().count() as f64;
    let mean = values.clone().map(|(value, sigma_s)| value * weight(sigma_s)).sum::<f64>() / total;
    let misfit = values.map(|(value, sigma_s)| (value - mean).powi(2) * weight(sigma_s)).sum::<f64>();
    let spread = (misfit / (count - 1.0).max(1.0)).max(1.0);
    (count > 0.0).then(|| (mean, (spread / total).sqrt()))
}

/// The first window against the others.
fn start_lag(windows: &[OffsetWindow]) -> Option<StartLag> {
    let told = |window: &OffsetWindow| -> Option<(f64, f64)> {
        let by_rates =
            || window.by_rates.filter(|r| r.correlation >= TRUSTED_CORRELATION).map(|r| (r.offset_s, r.sigma_s));
        window.estimate.filter(|e| e.observable).map(|e| (e.offset_s, e.sigma_s)).or_else(by_rates)
    };
    let (first, others) = windows.split_first()?;
    let others: Vec<(f64, f64)> = others.iter().filter_map(told).collect();
    let ((first_s, first_sigma_s), (rest_s, rest_sigma_s)) = (told(first)?, mean(others.iter().copied())?);
    let (lag_s, sigma_s) = (first_s - rest_s, math::hypot(first_sigma_s, rest_sigma_s));
    Some(StartLag { lag_s, sigma_s, is_significant: lag_s.abs() > (SIGNIFICANT * sigma_s).max(MIN_SIGNIFICANT_LAG_S) })
}
