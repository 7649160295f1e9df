//! When the time offset between frames and poses and the sensor's mount are estimated, and when an estimate is applied.
//!
//! They are estimated once a second at first, later every three, and every ten while estimates confirm those in use.
//! An estimate is applied when it is accurate and differs significantly.

use radar_sar::geometry::Pose;
use radar_sar::{Beam, Calibration, CalibrationSettings, Observation, SelfCalibration, TimeOffset};
use serde::{Deserialize, Serialize};

use super::mount_control::MountControl;
use super::offset_guard::OffsetGuard;
use super::{MountInUse, SensorState, TrackingSettings};

/// Interval of the first estimates, nanoseconds. Choice: the map waits for them, and each second adds a tenth or more to what they have.
const FIRST_ESTIMATES_NS: i64 = 1_000_000_000;
/// Number of first estimates that have anything. Choice: after as many seconds, a further one adds less than a tenth.
const FIRST_ESTIMATES: u32 = 10;
/// Interval of later estimates, nanoseconds. Choice: an estimate remembers 20 s of sweeps, of which three seconds are a useful share.
const ESTIMATE_NS: i64 = 3_000_000_000;
/// Interval of estimates while what is in use is confirmed, nanoseconds. Choice: it seldom changes, and estimates take processor time.
const SETTLED_ESTIMATE_NS: i64 = 10_000_000_000;
/// Change of the time offset that makes the evidence so far useless, seconds. Measured: in
/// simulated rooms at 90 % detection an offset of 3 ms adds no false objects, one of 10 ms adds
/// eight a window.
const MAX_HARMLESS_OFFSET_CHANGE_S: f64 = 4e-3;
/// While it is confirmed, an estimate uses only sweeps of this time before it, nanoseconds. Choice:
/// a quarter of the interval, so that echoes are followed for a quarter of the time.
const SETTLED_WINDOW_NS: i64 = 2_500_000_000;
/// The offset is changed when it is wrong by this many 1σ and by this many seconds. Choice: 3σ;
/// half a millisecond moves an echo by half a millimetre at 1 m/s, within tracking error, and each
/// change gives the reflectors' observations new poses.
const SIGNIFICANT: f64 = 3.0;
const MIN_CHANGE_S: f64 = 0.5e-3;
/// An estimated offset is also refined once the 1σ has fallen to this share. Choice: halving bounds
/// the number of changes, while a 1σ can fall to a hundredth in hundreds of estimates.
const SHARPER_SIGMA_RATIO: f64 = 0.5;

/// Counters of the time offset between the streams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TimeOffsetCounters {
    /// Estimates made.
    pub estimates: u64,
    /// How often the offset in use was changed.
    pub changes: u64,
    /// Tracks used for the last estimate.
    pub tracks: u64,
    /// Tracks excluded from the last estimate: they moved, or contradicted the others.
    pub tracks_left_out: u64,
}

/// Counters of the mount.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MountCounters {
    /// How often the mount in use was changed.
    pub changes: u64,
}

/// By how much an applied estimate changes what poses are computed with.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct CalibrationChange {
    /// Of the time offset, seconds.
    pub time_offset_s: f64,
    /// Distance that the sensor moves on the head, metres, 0 when it only turns; `None` when the mount stays.
    pub mount_m: Option<f64>,
}

impl CalibrationChange {
    /// Whether evidence that was gathered before still fits evidence that comes now.
    pub fn is_harmless(&self) -> bool {
        self.time_offset_s.abs() < MAX_HARMLESS_OFFSET_CHANGE_S && self.mount_m.is_none()
    }
}

/// Estimates offset and mount, and decides what to do with the estimates.
#[derive(Debug)]
pub(crate) struct CalibrationControl {
    /// `None`: nothing is estimated.
    estimator: Option<SelfCalibration>,
    estimates_offset: bool,
    max_sigma_s: f64,
    /// The offset in use, seconds.
    in_use_s: f64,
    /// 1σ of the estimate in use; `None` while the settings' offset is in use.
    applied_sigma_s: Option<f64>,
    found: Option<Calibration>,
    guard: OffsetGuard,
    mount: MountControl,
    beam: Beam,
    next_estimate_ns: Option<i64>,
    /// First estimates still to come.
    first_estimates_left: u32,
    /// Sweeps from this time on are used for the next estimate.
    listen_from_ns: i64,
    counters: TimeOffsetCounters,
}

impl CalibrationControl {
    /// `head_from_sensor`: the assumed mount.
    pub fn new(tracking: &TrackingSettings, beam: &Beam, head_from_sensor: &Pose) -> Self {
        let settings = CalibrationSettings::new(tracking.time_offset_s, tracking.errors);
        let estimates = tracking.estimate_time_offset || tracking.estimate_mount;
        Self {
            estimator: estimates.then(|| SelfCalibration::new(settings)),
            estimates_offset: tracking.estimate_time_offset,
            max_sigma_s: tracking.max_time_offset_sigma_s,
            in_use_s: tracking.time_offset_s,
            applied_sigma_s: None,
            found: None,
            guard: OffsetGuard::default(),
            mount: MountControl::new(head_from_sensor, tracking.estimate_mount),
            beam: beam.clone(),
            next_estimate_ns: None,
            first_estimates_left: FIRST_ESTIMATES,
            listen_from_ns: i64::MIN,
            counters: TimeOffsetCounters::default(),
        }
    }

    /// Whether anything is estimated.
    pub fn is_active(&self) -> bool {
        self.estimator.is_some()
    }

    /// The offset in use, seconds.
    pub fn in_use_s(&self) -> f64 {
        self.in_use_s
    }

    /// The last estimate of the offset, applied or not; `None` when it is not to be estimated.
    pub fn estimate(&self) -> Option<TimeOffset> {
        self.found.filter(|_| self.estimates_offset).map(|found| found.time_offset)
    }

    /// Slow tracking error in each axis as last estimated, rms, metres.
    pub fn drift_m(&self) -> Option<f64> {
        self.found.map(|found| found.drift_m)
    }

    /// The mount in use.
    pub fn mount(&self) -> MountInUse {
        self.mount.state()
    }

    /// Begins from the mount of an earlier session.
    pub fn resume_mount(&mut self, earlier: &MountInUse) {
        self.mount.resume(earlier);
    }

    pub fn counters(&self) -> TimeOffsetCounters {
        self.counters
    }

    pub fn mount_counters(&self) -> MountCounters {
        self.mount.counters()
    }

    /// Takes the path of the sensor at its assumed mount, and new observations.
    pub fn push(&mut self, path: &[SensorState], observations: &[Observation]) {
        let Some(estimator) = &mut self.estimator else { return };
        for sensor in path {
            estimator.push_path(sensor.time_ns, &sensor.tracking_from_sensor, sensor.velocity_m_per_s);
        }
        let listened = observations.iter().filter(|observation| observation.mid_time_ns >= self.listen_from_ns);
        listened.for_each(|observation| estimator.push_sweep(observation));
    }

    /// Whether an estimate is due at the time of the newest pose; schedules the next one.
    pub fn is_due(&mut self, now_ns: i64) -> bool {
        // A wrong time that was taken back must not delay the next estimate.
        self.next_estimate_ns.take_if(|next_ns| next_ns.saturating_sub(now_ns) > SETTLED_ESTIMATE_NS);
        // The first estimate has no data yet; a leap in time must not trigger a burst of estimates.
        self.next_estimate_ns.is_none_or(|next_ns| now_ns >= next_ns)
    }

    /// Whether the first estimate has been scheduled.
    pub fn is_scheduled(&self) -> bool {
        self.next_estimate_ns.is_some()
    }

    /// Schedules the next estimate from the time of the newest pose.
    pub fn schedule(&mut self, now_ns: i64) {
        let settled = self.is_settled();
        let interval_ns = if settled {
            SETTLED_ESTIMATE_NS
        } else if self.first_estimates_left > 0 {
            FIRST_ESTIMATES_NS
        } else {
            ESTIMATE_NS
        };
        let next_ns = now_ns.saturating_add(interval_ns);
        self.listen_from_ns = if settled { next_ns.saturating_sub(SETTLED_WINDOW_NS) } else { i64::MIN };
        self.next_estimate_ns = Some(next_ns);
    }

    /// Estimates. Returns the change to apply; from then on the new values are in use.
    pub fn update(&mut self, now_ns: i64) -> Option<CalibrationChange> {
        self.found = self.estimator.as_mut()?.estimate();
        self.counters.estimates += 1;
        let found = self.found?;
        self.first_estimates_left = self.first_estimates_left.saturating_sub(1);
        let time_offset_s = if self.estimates_offset { self.update_offset(now_ns, &found.time_offset) } else { None };
        let directions = self.estimator.as_ref()?.echo_directions(&self.beam);
        let mount_m = self.mount.update(now_ns, &found, &directions);
        let is_changed = time_offset_s.is_some() || mount_m.is_some();
        is_changed.then(|| CalibrationChange { time_offset_s: time_offset_s.unwrap_or(0.0), mount_m })
    }

    /// By how much the offset in use changed, seconds.
    fn update_offset(&mut self, now_ns: i64, estimate: &TimeOffset) -> Option<f64> {
        self.counters.tracks = estimate.tracks as u64;
        self.counters.tracks_left_out = estimate.tracks_left_out as u64;
        let is_known = estimate.observable && estimate.sigma_s <= self.max_sigma_s;
        let change = CalibrationChange { time_offset_s: estimate.offset_s - self.in_use_s, mount_m: None };
        if !(self.guard.allows(now_ns, is_known, !change.is_harmless()) && self.is_better(estimate)) {
            return None;
        }
        self.in_use_s = estimate.offset_s;
        self.applied_sigma_s = Some(estimate.sigma_s);
        self.guard = OffsetGuard::default();
        self.counters.changes += 1;
        Some(change.time_offset_s)
    }

    /// Whether the last estimate is accurate and agrees with what is in use, so that estimates can be less frequent.
    fn is_settled(&self) -> bool {
        let agrees = |offset: &TimeOffset| {
            let wrong_s = (offset.offset_s - self.in_use_s).abs();
            offset.observable && offset.sigma_s <= 0.5 * self.max_sigma_s && wrong_s <= MIN_CHANGE_S.max(offset.sigma_s)
        };
        let is_settled = |found: &Calibration| {
            (!self.estimates_offset || agrees(&found.time_offset)) && self.mount.is_settled(found)
        };
        self.found.as_ref().is_some_and(is_settled)
    }

    /// Whether an estimate should replace the offset in use.
    fn is_better(&self, estimate: &TimeOffset) -> bool {
        let wrong_s = (estimate.offset_s - self.in_use_s).abs();
        let sharper = self.applied_sigma_s.is_some_and(|sigma_s| estimate.sigma_s <= SHARPER_SIGMA_RATIO * sigma_s);
        estimate.observable
            && estimate.sigma_s <= self.max_sigma_s
            && wrong_s >= MIN_CHANGE_S
            && (wrong_s >= SIGNIFICANT * estimate.sigma_s || sharper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::test_data::{Echo, sweeps, winding};

    const S: i64 = 1_000_000_000;

    fn control() -> CalibrationControl {
        CalibrationControl::new(&TrackingSettings::default(), &Beam::Lensless, &Pose::IDENTITY)
    }

    /// Seconds to the next estimate.
    fn interval_s(control: &mut CalibrationControl) -> i64 {
        control.schedule(100 * S);
        assert!(!control.is_due(100 * S) && control.is_due(110 * S));
        (control.next_estimate_ns.unwrap() - 100 * S) / S
    }

    #[test]
    fn first_estimates_are_frequent_and_those_that_confirm_are_rare() {
        let mut control = control();
        // Nothing was heard yet: these do not count.
        (0..20).for_each(|_| assert_eq!(control.update(0), None));
        assert_eq!((interval_s(&mut control), control.counters().estimates), (1, 20));
        let path = (-60..500).map(|step| {
            let at_m = winding(step as f64 * 5e-3);
            let velocity_m_per_s = (winding(step as f64 * 5e-3 + 1e-4) - at_m) / 1e-4;
            let tracking_from_sensor = Pose::from_translation(at_m);
            SensorState { time_ns: S + step * 5_000_000, tracking_from_sensor, velocity_m_per_s }
        });
        let point = Echo::Point(glam::DVec3::new(0.2, 0.1, -1.2));
        control.push(&path.collect::<Vec<_>>(), &sweeps(2.0, winding, &[(point, 8.0)], 1));
        for left in (0..FIRST_ESTIMATES).rev() {
            control.update(4 * S);
            assert!(control.found.is_some());
            assert_eq!(control.first_estimates_left, left);
        }
        let offset = control.found.unwrap().time_offset;
        let confirming = TimeOffset { offset_s: control.in_use_s, sigma_s: 1e-4, observable: true, ..offset };
        let found = Calibration { time_offset: confirming, mount_shift_m: glam::DVec3::ZERO, ..control.found.unwrap() };
        control.found = Some(found);
        assert_eq!(interval_s(&mut control), 10);
        control.found = None;
        assert_eq!(interval_s(&mut control), 3);
    }
}
