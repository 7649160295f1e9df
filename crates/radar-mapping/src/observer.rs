//! Observer: joins the stream of frames with that of poses, and gives observations.
//!
//! A frame waits until the poses around its sweeps have arrived: half the smoothing window past its
//! end, or less by the settings. Each sweep then gets the sensor's pose at its own time: pose time
//! = sweep time + time offset. A frame that waits behind 256 others uses the poses known so far. Frames
//! without any pose are counted.
//!
//! Poses arrive in the tracking frame and leave in the map frame, the tracking frame of the first pose: a jump of the
//! tracking frame moves neither the path nor the map.

use std::collections::VecDeque;
use std::sync::Arc;

use glam::DVec3;
use num_complex::Complex32;
use serde::{Deserialize, Serialize};

use super::range_bias::{RangeBias, loopback_peak_m};
use super::timestamps::{TimestampFilter, TimestampVerdict};
use super::{Event, MappingSettings, Refusal, TrackingSettings, in_time_order, range_axis};
use a121::{Frame, FrameLayout, SensorConfig, Subsweep, Sweep};
use radar_sar::geometry::Pose;
use radar_sar::{FollowedJump, HistorySettings, NoPose, PoseHistory, PoseRefusal, PoseSample};
use radar_sar::{Observation, RangeAxis, SweepGeometry};

/// Most frames that wait for poses. Choice: half a second of the fastest ones.
const MAX_WAITING_FRAMES: usize = 256;
/// Time step of the sensor's path, nanoseconds. Choice: between steps the path is off by a·t²/8,
/// 0.03 mm at 10 m/s², far below λ/4.
const PATH_STEP_NS: i64 = 5_000_000;
/// The path is not computed across longer pauses, nanoseconds; poses are not joined across them
/// either. Choice: a leap in time costs at most 400 steps of the path.
const MAX_PATH_PAUSE_NS: i64 = 2_000_000_000;
/// Most poses kept. Choice: 14 minutes at 120 Hz.
const MAX_POSES: usize = 100_000;

/// How the streams are joined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObserverSettings {
    /// How poses become a path.
    pub history: HistorySettings,
    /// Pose of the sensor's phase centre on the head, a full rigid transform.
    pub head_from_sensor: Pose,
    /// Added to a sweep's time to get the time of its pose, seconds.
    pub time_offset_s: f64,
    /// See [`RadarSettings::range_bias_m`](crate::RadarSettings::range_bias_m).
    pub range_bias_m: Option<f64>,
}

impl ObserverSettings {
    /// Those of mapping, with the assumed mount: as set, or as recorded.
    pub fn new(settings: &MappingSettings, recorded: &Pose) -> Self {
        let TrackingSettings { history, mount, time_offset_s, .. } = settings.tracking;
        let head_from_sensor = mount.unwrap_or(*recorded);
        Self { history, head_from_sensor, time_offset_s, range_bias_m: settings.radar.range_bias_m }
    }
}

/// State of the sensor at a time of the pose stream, in the map frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorState {
    /// Time of the pose stream, host nanoseconds.
    pub time_ns: i64,
    /// Pose of the phase centre, `tracking_from_sensor`.
    pub tracking_from_sensor: Pose,
    /// Velocity of the phase centre, tracking frame, m/s.
    pub velocity_m_per_s: DVec3,
}

/// What arrived and what was skipped, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObserverCounters {
    /// Frames received.
    pub frames: u64,
    /// Observations given out (sweeps × subsweeps).
    pub observations: u64,
    /// Poses received.
    pub poses: u64,
    /// Poses marked invalid, out of range or not tracking.
    pub poses_invalid: u64,
    /// Poses with invalid numbers: NaN, infinite, zero quaternion.
    pub poses_bad_numbers: u64,
    /// Poses not later than the one before.
    pub poses_time_not_rising: u64,
    /// Poses far ahead in time of the one before, with no other pose to confirm it; or a first one
    /// that none confirmed.
    pub poses_time_leapt: u64,
    /// Frames skipped: saturated samples.
    pub frames_saturated: u64,
    /// Frames skipped: not as long as configured.
    pub frames_wrong_length: u64,
    /// Frames skipped: not later than the one before.
    pub frames_time_not_rising: u64,
    /// Frames skipped: far ahead in time of the one before, with no other to confirm it; or a first
    /// one that none confirmed.
    pub frames_time_leapt: u64,
    /// Frames without a pose for any sweep.
    pub frames_without_pose: u64,
    /// Jumps of the tracking frame that the map does not have.
    #[serde(default)]
    pub tracking_jumps: u64,
    /// Sweeps skipped: before the first or after the last pose.
    pub sweeps_outside_poses: u64,
    /// Sweeps skipped: in a gap between poses.
    pub sweeps_in_pose_gap: u64,
    /// Sweeps skipped: next to an invalid pose.
    pub sweeps_at_invalid_pose: u64,
}

/// Joins the frames and poses of one configuration.
#[derive(Debug)]
pub struct Observer {
    settings: ObserverSettings,
    /// The mount of the beginning, which the path is that of.
    assumed_mount: Pose,
    layout: FrameLayout,
    config: SensorConfig,
    /// Of each subsweep; `None` for those that hear no echoes.
    geometries: Vec<Option<Arc<SweepGeometry>>>,
    range_bias: RangeBias,
    history: PoseHistory,
    waiting: VecDeque<Frame>,
    ready: Vec<Observation>,
    /// Time of the newest observation.
    observed_until_ns: Option<i64>,
    frame_timestamps: TimestampFilter,
    pose_timestamps: TimestampFilter,
    next_path_ns: Option<i64>,
    keep_s: f64,
    counters: ObserverCounters,
}

impl Observer {
    /// For frames of a valid configuration.
    pub fn new(config: &SensorConfig, settings: ObserverSettings) -> Self {
        let layout = FrameLayout::of(config);
        let range_bias = settings.range_bias_m.map_or(RangeBias::Unknown, RangeBias::Set);
        Self {
            geometries: geometries(config, &layout, range_bias),
            layout,
            config: config.clone(),
            range_bias,
            history: PoseHistory::new(settings.history),
            assumed_mount: settings.head_from_sensor,
            settings,
            waiting: VecDeque::new(),
            ready: Vec::new(),
            observed_until_ns: None,
            frame_timestamps: TimestampFilter::default(),
            pose_timestamps: TimestampFilter::default(),
            next_path_ns: None,
            // Poses older than the window before a frame are not used, unless requested.
            keep_s: settings.history.smoothing_window_s + settings.history.max_gap_s + 0.5,
            counters: ObserverCounters::default(),
        }
    }

    /// Counters so far.
    pub fn counters(&self) -> &ObserverCounters {
        &self.counters
    }

    /// The newest valid pose of the head, in its own tracking frame, and its time.
    pub fn head(&self) -> Option<(i64, Pose)> {
        let tracking_from_map = self.map_from_tracking().inverse();
        self.history.last_pose().map(|(time_ns, map_from_head)| (time_ns, tracking_from_map * map_from_head))
    }

    /// Transforms from the tracking frame of the newest pose to the map frame.
    pub fn map_from_tracking(&self) -> Pose {
        self.history.map_from_tracking()
    }

    /// Time of the newest pose that was accepted, valid or not.
    pub fn newest_pose_ns(&self) -> Option<i64> {
        self.history.last_time_ns()
    }

    /// Keeps poses for this long before the newest frame, seconds, for
    /// [`sensor_at`](Self::sensor_at). The number kept is bounded.
    pub fn keep_poses_s(&mut self, keep_s: f64) {
        self.keep_s = self.keep_s.max(keep_s);
    }

    /// Time of a sweep's pose minus time of the sweep, seconds.
    pub fn time_offset_s(&self) -> f64 {
        self.settings.time_offset_s
    }

    /// Changes the time offset for the frames that still wait and those to come.
    pub fn set_time_offset_s(&mut self, time_offset_s: f64) {
        self.settings.time_offset_s = time_offset_s;
    }

    /// Changes the mount, `head_from_sensor`, for the frames that still wait and those to come.
    pub fn set_mount(&mut self, head_from_sensor: Pose) {
        self.settings.head_from_sensor = head_from_sensor;
    }

    /// The sensor at a time of the pose stream, in the same way as for a sweep.
    ///
    /// # Errors
    /// Outside the poses still kept, in a gap, or next to an invalid pose.
    pub fn sensor_at(&self, time_ns: i64) -> Result<SensorState, NoPose> {
        sensor_at(&self.history, time_ns, &self.settings.head_from_sensor, i64::MIN)
    }

    /// The sensor at the time of a sweep, fitted to the poses known when a later sweep has its own.
    /// This is smoother than the sweep's own pose when poses are not waited for long.
    ///
    /// # Errors
    /// As [`sensor_at`](Self::sensor_at).
    pub fn smoothed_sensor_at(&self, sweep_ns: i64, later_sweep_ns: i64) -> Result<SensorState, NoPose> {
        let [at_ns, later_ns] = [sweep_ns, later_sweep_ns].map(|time_ns| time_ns.saturating_add(self.offset_ns()));
        let known_until_ns = later_ns.saturating_add(self.settings.history.ahead_ns());
        sensor_at(&self.history, at_ns, &self.settings.head_from_sensor, known_until_ns)
    }

    /// The path since the last call of a sensor at the mount of the beginning, every 5 ms, up to where no later pose makes
    /// it smoother. This does not depend on how early sweeps get their poses.
    pub fn take_path(&mut self) -> Vec<SensorState> {
        let smooth_ns = self.settings.history.smooth_ns();
        let Some(settled_ns) = self.history.settled_until_ns() else { return Vec::new() };
        let until_ns = settled_ns.saturating_sub(smooth_ns);
        let first_ns = self.next_path_ns.unwrap_or(i64::MIN).max(until_ns.saturating_sub(MAX_PATH_PAUSE_NS));
        let first_step = first_ns.div_euclid(PATH_STEP_NS) + i64::from(first_ns.rem_euclid(PATH_STEP_NS) > 0);
        let times = (first_step..=until_ns.div_euclid(PATH_STEP_NS)).map(|step| step * PATH_STEP_NS);
        let smooth = |time_ns: i64| {
            sensor_at(&self.history, time_ns, &self.assumed_mount, time_ns.saturating_add(smooth_ns)).ok()
        };
        let path = times.filter_map(smooth).collect();
        self.next_path_ns = Some(first_ns.max(until_ns.saturating_add(1)));
        path
    }

    /// The last jump of the tracking frame that the path does not have.
    pub fn last_jump(&self) -> Option<FollowedJump> {
        self.history.last_jump()
    }

    /// Adds a pose. A bad one is counted and ignored.
    ///
    /// # Errors
    /// Why it is ignored.
    pub fn push_pose(&mut self, sample: &PoseSample) -> Result<(), Refusal> {
        self.counters.poses += 1;
        match self.pose_timestamps.classify(sample.time_ns) {
            TimestampVerdict::Next => {}
            TimestampVerdict::NotRising => {
                self.counters.poses_time_not_rising += 1;
                return Err(Refusal::PoseTimeNotRising(sample.time_ns));
            }
            TimestampVerdict::Leap => {
                self.counters.poses_time_leapt += 1;
                return Err(Refusal::PoseTimeLeapt(sample.time_ns));
            }
            TimestampVerdict::Restart if self.is_mapped_since(sample.time_ns) => {
                self.counters.poses_time_not_rising += 1;
                return Err(Refusal::PoseTimeNotRising(sample.time_ns));
            }
            TimestampVerdict::Restart => {
                self.counters.poses_time_leapt += 1;
                self.history.keep_newest(0);
                self.next_path_ns = None;
            }
        }
        let pushed = self.history.push(sample);
        self.history.keep_newest(MAX_POSES);
        self.counters.tracking_jumps = self.history.jumps_followed();
        match pushed {
            Ok(()) => {}
            Err(PoseRefusal::Invalid | PoseRefusal::Result(_)) => self.counters.poses_invalid += 1,
            Err(PoseRefusal::Numbers(_)) => self.counters.poses_bad_numbers += 1,
            Err(PoseRefusal::TimeNotRising { .. }) => self.counters.poses_time_not_rising += 1,
        }
        Ok(pushed?)
    }

    /// Adds a frame. A bad one is counted and ignored.
    ///
    /// # Errors
    /// Why it is ignored.
    pub fn push_frame(&mut self, frame: Frame) -> Result<(), Refusal> {
        self.counters.frames += 1;
        let (samples, expected) = (frame.samples.len(), self.layout.samples_per_frame());
        if samples != expected {
            self.counters.frames_wrong_length += 1;
            return Err(Refusal::FrameLength { samples, expected });
        }
        match self.frame_timestamps.classify(frame.host_time_ns) {
            TimestampVerdict::Next => {}
            TimestampVerdict::NotRising => {
                self.counters.frames_time_not_rising += 1;
                return Err(Refusal::FrameTimeNotRising(frame.host_time_ns));
            }
            TimestampVerdict::Leap => {
                self.counters.frames_time_leapt += 1;
                return Err(Refusal::FrameTimeLeapt(frame.host_time_ns));
            }
            TimestampVerdict::Restart if self.is_mapped_since(frame.host_time_ns) => {
                self.counters.frames_time_not_rising += 1;
                return Err(Refusal::FrameTimeNotRising(frame.host_time_ns));
            }
            TimestampVerdict::Restart => {
                self.counters.frames_time_leapt += 1;
                self.waiting.clear();
            }
        }
        if frame.data_saturated {
            self.counters.frames_saturated += 1;
            return Err(Refusal::FrameSaturated(frame.host_time_ns));
        }
        self.measure_loopback(&frame);
        self.waiting.push_back(frame);
        if self.waiting.len() > MAX_WAITING_FRAMES
            && let Some(oldest) = self.waiting.pop_front()
        {
            self.observe(&oldest);
        }
        Ok(())
    }

    /// Whether an observation later than this was given out: times do not go back behind what is mapped.
    fn is_mapped_since(&self, time_ns: i64) -> bool {
        self.observed_until_ns.is_some_and(|until_ns| until_ns >= time_ns)
    }

    /// Corrects the ranges by the first loopback, before any observation has them, unless their bias is set.
    fn measure_loopback(&mut self, frame: &Frame) {
        if self.range_bias == RangeBias::Unknown
            && self.counters.observations == 0
            && let Some(peak_m) = loopback_peak_m(&self.config, &self.layout, frame)
        {
            self.range_bias = RangeBias::Loopback { peak_m };
            self.geometries = geometries(&self.config, &self.layout, self.range_bias);
        }
    }

    /// See [`CalibrationInUse::range_bias_m`](crate::CalibrationInUse::range_bias_m).
    pub fn range_bias_m(&self) -> Option<Vec<f64>> {
        let of_echoes = self.config.subsweeps.iter().filter(|subsweep| subsweep.hears_echoes());
        let biases_m: Vec<f64> = of_echoes.filter_map(|subsweep| self.range_bias.of(subsweep)).collect();
        (!biases_m.is_empty()).then_some(biases_m)
    }

    /// Observations of all frames whose poses are complete.
    pub fn take_ready(&mut self) -> Vec<Observation> {
        let Some(until_ns) = self.complete_until_ns() else { return std::mem::take(&mut self.ready) };
        let complete_until_ns = until_ns.saturating_sub(self.offset_ns());
        while let Some(frame) = self.waiting.pop_front_if(|f| f.host_time_ns <= complete_until_ns) {
            self.observe(&frame);
        }
        std::mem::take(&mut self.ready)
    }

    /// Observations of all frames that still wait, when no more poses will come.
    pub fn take_rest(&mut self) -> Vec<Observation> {
        for frame in std::mem::take(&mut self.waiting) {
            self.observe(&frame);
        }
        std::mem::take(&mut self.ready)
    }

    /// Time of the pose stream up to which sweeps get their poses: where no later pose changes these, or, when poses are not
    /// waited for long, where a jump may change them that is not suspected yet.
    fn complete_until_ns(&self) -> Option<i64> {
        let history = &self.settings.history;
        let known_ns = match history.is_early() && !self.history.is_measuring_jump() {
            true => self.history.last_time_ns(),
            false => self.history.settled_until_ns(),
        };
        Some(known_ns?.saturating_sub(history.ahead_ns()))
    }

    fn offset_ns(&self) -> i64 {
        (self.settings.time_offset_s * 1e9).round() as i64
    }

    fn observe(&mut self, frame: &Frame) {
        let before = self.ready.len();
        let offset_ns = self.offset_ns();
        if let Some(sweeps) = self.layout.sweeps(frame) {
            for sweep in sweeps {
                let Some(geometry) = &self.geometries[sweep.subsweep] else { continue };
                match observe_sweep(&sweep, geometry, &self.history, offset_ns, &self.settings.head_from_sensor) {
                    Ok(observation) => {
                        self.observed_until_ns = Some(observation.mid_time_ns);
                        self.ready.push(observation);
                    }
                    Err(NoPose::Outside) => self.counters.sweeps_outside_poses += 1,
                    Err(NoPose::Gap(_)) => self.counters.sweeps_in_pose_gap += 1,
                    Err(NoPose::Invalid) => self.counters.sweeps_at_invalid_pose += 1,
                }
            }
        }
        let made = (self.ready.len() - before) as u64;
        self.counters.observations += made;
        self.counters.frames_without_pose += u64::from(made == 0);
        let keep_ns = (self.keep_s * 1e9) as i64;
        self.history.remove_before(frame.host_time_ns.saturating_add(offset_ns).saturating_sub(keep_ns));
    }
}

/// Geometry of each subsweep that hears echoes, its ranges corrected.
fn geometries(config: &SensorConfig, layout: &FrameLayout, range_bias: RangeBias) -> Vec<Option<Arc<SweepGeometry>>> {
    let of = |(index, (subsweep, &(_, point_period_s))): (usize, (&Subsweep, &(f64, f64)))| {
        let bias_m = range_bias.of(subsweep).unwrap_or(0.0);
        let axis = range_axis(subsweep);
        let geometry = || SweepGeometry {
            subsweep: index,
            axis: RangeAxis { first_m: axis.first_m - bias_m, ..axis },
            pulse_fwhm_m: subsweep.profile.envelope_fwhm_m(),
            point_period_s,
        };
        subsweep.hears_echoes().then(|| Arc::new(geometry()))
    };
    config.subsweeps.iter().zip(&layout.timing().subsweeps).enumerate().map(of).collect()
}

/// All observations of complete streams, in rising time and in the tracking frame of the first pose, with the counters.
pub fn observe_all(
    config: &SensorConfig,
    settings: ObserverSettings,
    frames: &[Frame],
    poses: &[PoseSample],
) -> (Vec<Observation>, ObserverCounters) {
    let mut observations = Vec::new();
    let counters = observe_each(config, settings, frames.iter().cloned(), poses.iter().copied(), |observation| {
        observations.push(observation);
    });
    (observations, counters)
}

/// The same one by one, for streams that need not fit into memory: what waits for poses is all that is held.
pub fn observe_each(
    config: &SensorConfig,
    settings: ObserverSettings,
    frames: impl IntoIterator<Item = Frame>,
    poses: impl IntoIterator<Item = PoseSample>,
    mut with: impl FnMut(Observation),
) -> ObserverCounters {
    let mut observer = Observer::new(config, settings);
    for event in in_time_order(frames, poses) {
        // What is refused is counted.
        let _ = match event {
            Event::Frame(frame) => observer.push_frame(frame),
            Event::Pose(pose) => observer.push_pose(&pose),
            Event::Hands(_) => Ok(()),
        };
        observer.take_ready().into_iter().for_each(&mut with);
    }
    observer.take_rest().into_iter().for_each(&mut with);
    *observer.counters()
}

fn observe_sweep(
    sweep: &Sweep,
    geometry: &Arc<SweepGeometry>,
    history: &PoseHistory,
    offset_ns: i64,
    head_from_sensor: &Pose,
) -> Result<Observation, NoPose> {
    let half_s = (sweep.samples.len() as f64 - 1.0) * 0.5 * sweep.point_period_s;
    let mid_time_ns = sweep.first_point_time_ns.saturating_add((half_s * 1e9).round() as i64);
    let sensor = sensor_at(history, mid_time_ns.saturating_add(offset_ns), head_from_sensor, i64::MIN)?;
    Ok(Observation {
        mid_time_ns,
        tracking_from_sensor: sensor.tracking_from_sensor,
        velocity_m_per_s: sensor.velocity_m_per_s,
        geometry: Arc::clone(geometry),
        samples: sweep.samples.iter().map(|s| Complex32::new(f32::from(s.re), f32::from(s.im))).collect(),
    })
}

fn sensor_at(
    history: &PoseHistory,
    time_ns: i64,
    head_from_sensor: &Pose,
    known_until_ns: i64,
) -> Result<SensorState, NoPose> {
    let head = history.at_with_poses_until(time_ns, known_until_ns)?;
    let arm = head.tracking_from_head.transform_vector(head_from_sensor.translation);
    Ok(SensorState {
        time_ns,
        tracking_from_sensor: head.tracking_from_head * *head_from_sensor,
        velocity_m_per_s: head.velocity_m_per_s + head.angular_velocity_rad_per_s.cross(arm),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;
    use glam::DQuat;
    use num_complex::Complex;
    use std::collections::BTreeMap;

    const MS: i64 = 1_000_000;

    fn frame(host_time_ns: i64) -> Frame {
        Frame {
            tick: host_time_ns / 1000,
            host_time_ns,
            temperature_c: 30,
            data_saturated: false,
            frame_delayed: false,
            calibration_needed: false,
            samples: vec![Complex::new(3, -4); 300],
        }
    }

    fn observer(head_from_sensor: Pose, time_offset_s: f64) -> Observer {
        let settings = ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor,
            time_offset_s,
            range_bias_m: None,
        };
        Observer::new(&preset("fine").unwrap(), settings)
    }

    #[test]
    fn a_bias_that_is_set_shortens_the_ranges() {
        let first_m = |range_bias_m| {
            let settings = ObserverSettings { range_bias_m, ..observer(Pose::IDENTITY, 0.0).settings };
            let mut observer = Observer::new(&preset("fine").unwrap(), settings);
            for i in 0..60 {
                observer.push_pose(&PoseSample::valid(i * 10 * MS, &Pose::IDENTITY)).unwrap();
            }
            observer.push_frame(frame(300 * MS)).unwrap();
            observer.take_ready()[0].geometry.axis.first_m
        };
        assert!((first_m(None) - first_m(Some(4e-3)) - 4e-3).abs() < 1e-12);
    }

    #[test]
    fn mount_and_time_offset_apply_at_sweep_time() {
        let mount = Pose::new(DVec3::new(0.0, 0.02, -0.1), DQuat::from_rotation_x(-0.2));
        let mut observer = observer(mount, 0.020);
        for i in 0..60 {
            let head = Pose::new(DVec3::new(i as f64 * 0.01, 1.6, 0.0), DQuat::from_rotation_y(0.5));
            observer.push_pose(&PoseSample::valid(i * 10 * MS, &head)).unwrap();
        }
        observer.push_frame(frame(300 * MS)).unwrap();
        let observed = observer.take_ready();
        assert_eq!(observed.len(), 1);
        let observation = &observed[0];
        let pose_time_s = observation.mid_time_ns as f64 * 1e-9 + 0.020;
        let head = Pose::new(DVec3::new(pose_time_s, 1.6, 0.0), DQuat::from_rotation_y(0.5));
        let expected = head * mount;
        assert!((observation.tracking_from_sensor.translation - expected.translation).length() < 1e-6);
        assert!((observation.velocity_m_per_s - DVec3::X).length() < 1e-6);
        assert!(observation.mid_time_ns < 300 * MS);
    }

    #[test]
    fn sweeps_and_path_about_a_jump_are_those_of_a_tracker_that_does_not_jump() {
        let jump = Pose::new(DVec3::new(0.08, -0.02, 0.06), DQuat::from_rotation_y(0.087));
        let head = |i: i64| Pose::new(DVec3::new((i as f64 * 0.05).sin() * 0.2, 1.6, 0.0), DQuat::IDENTITY);
        let run = |frame: &dyn Fn(i64) -> Pose| {
            let mut observer = observer(Pose::IDENTITY, 0.0);
            let (mut sweeps, mut path) = (Vec::new(), Vec::new());
            for i in 0..120 {
                observer.push_frame(self::frame(i * 10 * MS + 3 * MS)).unwrap();
                observer.push_pose(&PoseSample::valid(i * 10 * MS, &(frame(i) * head(i)))).unwrap();
                let ready = observer.take_ready();
                sweeps.extend(ready.iter().map(|o| (o.mid_time_ns, o.tracking_from_sensor.translation)));
                path.extend(observer.take_path().iter().map(|at| (at.time_ns, at.tracking_from_sensor.translation)));
            }
            [sweeps, path]
        };
        let steady = run(&|_| Pose::IDENTITY);
        let jumping = run(&|i| if i < 60 { Pose::IDENTITY } else { jump });
        for (steady, jumping) in steady.iter().zip(&jumping) {
            let expected: BTreeMap<i64, DVec3> = steady.iter().copied().collect();
            assert!(jumping.len() + 4 >= steady.len(), "{} of {}", jumping.len(), steady.len());
            for (time_ns, at_m) in jumping {
                let off_m = expected[time_ns].distance(*at_m);
                assert!(off_m < 0.5e-3, "{off_m} m at {} ms", time_ns / MS);
            }
        }
    }

    #[test]
    fn bad_frames_are_refused_with_their_reason_and_counted() {
        let mut observer = observer(Pose::IDENTITY, 0.0);
        for i in 0..60 {
            observer.push_pose(&PoseSample::valid(i * 10 * MS, &Pose::IDENTITY)).unwrap();
        }
        let frames = [
            Frame { samples: vec![], ..frame(100 * MS) },
            Frame { data_saturated: true, ..frame(110 * MS) },
            frame(120 * MS),
            frame(120 * MS),
            frame(90 * MS),
            frame(900 * MS),
        ];
        let expected = frame(0).samples.len();
        let results = frames.map(|frame| observer.push_frame(frame).err());
        let refusals = [
            Some(Refusal::FrameLength { samples: 0, expected }),
            Some(Refusal::FrameSaturated(110 * MS)),
            None,
            Some(Refusal::FrameTimeNotRising(120 * MS)),
            Some(Refusal::FrameTimeNotRising(90 * MS)),
            None,
        ];
        assert_eq!(results, refusals);
        assert_eq!(observer.take_ready().len(), 1);
        assert_eq!(observer.take_rest().len(), 0);
        let counters = observer.counters();
        assert_eq!(counters.frames_wrong_length, 1);
        assert_eq!(counters.frames_saturated, 1);
        assert_eq!(counters.frames_time_not_rising, 2);
        assert_eq!(counters.frames_without_pose, 1);
        assert_eq!(counters.sweeps_outside_poses, 1);
    }

    #[test]
    fn single_future_timestamps_do_not_block_streams() {
        let far = 86_400_000 * MS;
        for (bad_pose, bad_frame) in [(0, 0), (30, 25), (0, 25), (30, 0)] {
            let mut observer = observer(Pose::IDENTITY, 0.0);
            let (mut observed, mut path) = (0, 0);
            for i in 0..60 {
                if i == bad_frame {
                    let _ = observer.push_frame(frame(far));
                }
                if i == bad_pose {
                    let _ = observer.push_pose(&PoseSample::valid(far + MS, &Pose::IDENTITY));
                    observed += observer.take_ready().len();
                    path += observer.take_path().len();
                }
                let _ = observer.push_frame(frame(1000 * MS + i * 10 * MS));
                let _ = observer.push_pose(&PoseSample::valid(1000 * MS + i * 10 * MS, &Pose::IDENTITY));
                observed += observer.take_ready().len();
                path += observer.take_path().len();
            }
            observed += observer.take_rest().len();
            let counters = observer.counters();
            assert_eq!((counters.frames_time_leapt, counters.poses_time_leapt), (1, 1), "{counters:?}");
            // The first frame begins before the first pose, and the second before the second.
            assert_eq!(observed, if bad_pose == 0 { 58 } else { 59 }, "{bad_pose} {bad_frame} {counters:?}");
            assert!(path > 90, "{path}");
        }
    }

    #[test]
    fn single_wrong_time_costs_what_it_belongs_to_alone() {
        let settings = || ObserverSettings {
            history: HistorySettings::default(),
            head_from_sensor: Pose::IDENTITY,
            time_offset_s: 0.0,
            range_bias_m: None,
        };
        let frames: Vec<Frame> = (10..190).map(|i| frame(i * 20 * MS)).collect();
        let poses: Vec<PoseSample> = (0..480).map(|i| PoseSample::valid(i * 8 * MS, &Pose::IDENTITY)).collect();
        let config = preset("fine").unwrap();
        let (sound, _) = observe_all(&config, settings(), &frames, &poses);
        let per_frame = sound.len() / frames.len();
        for leap_ns in [30_000 * MS, -30_000 * MS, 400 * MS] {
            let mut poses = poses.clone();
            poses[200].time_ns += leap_ns;
            let (found, _) = observe_all(&config, settings(), &frames, &poses);
            // Sweeps whose poses are the wrong one's neighbours may be lost, or those until the times rise again.
            let most_lost = if leap_ns == 400 * MS { 25 } else { 2 };
            assert!(
                found.len() + most_lost * per_frame >= sound.len(),
                "{leap_ns}: {} of {}",
                found.len(),
                sound.len()
            );
        }
    }

    #[test]
    fn waiting_frames_are_bounded_and_counted() {
        let mut observer = observer(Pose::IDENTITY, 0.0);
        for i in 0..1000 {
            observer.push_frame(frame((i + 1) * MS)).unwrap();
        }
        assert_eq!(observer.waiting.len(), MAX_WAITING_FRAMES);
        assert_eq!(observer.counters().frames_without_pose, 1000 - MAX_WAITING_FRAMES as u64);
        assert_eq!(observer.take_rest().len(), 0);
        assert_eq!(observer.counters().frames_without_pose, 1000);
    }
}
