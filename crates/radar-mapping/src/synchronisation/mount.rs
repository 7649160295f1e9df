//! The sensor's position and direction on the head, from a whole recording.

use radar_sar::geometry::Pose;
use radar_sar::{CalibrationSettings, SelfCalibration};

use super::JoinedStreams;
use crate::{MappingSettings, MountEstimate};

/// Interval of intermediate estimates, nanoseconds. Choice: half of the estimator's memory of single tracks, so that it
/// sums up older ones in time.
const INTERVAL_NS: i64 = 10_000_000_000;

/// Estimates it; `middle_s` is the middle of the search for the time offset. `None` without usable echoes.
pub(super) fn mount(
    joined: &JoinedStreams,
    head_from_sensor: &Pose,
    settings: &MappingSettings,
    middle_s: f64,
) -> Option<MountEstimate> {
    let mut estimator = SelfCalibration::new(CalibrationSettings::new(middle_s, settings.tracking.errors));
    let mut path = joined.path.iter().peekable();
    let mut next_ns = joined.observations.first()?.mid_time_ns.saturating_add(INTERVAL_NS);
    for observation in &joined.observations {
        while let Some(at) = path.next_if(|at| at.time_ns <= observation.mid_time_ns) {
            estimator.push_path(at.time_ns, &at.tracking_from_sensor, at.velocity_m_per_s);
        }
        estimator.push_sweep(observation);
        if observation.mid_time_ns >= next_ns {
            next_ns = observation.mid_time_ns.saturating_add(INTERVAL_NS);
            estimator.estimate();
        }
    }
    path.for_each(|at| estimator.push_path(at.time_ns, &at.tracking_from_sensor, at.velocity_m_per_s));
    let found = estimator.estimate()?;
    let assumed = settings.tracking.mount.unwrap_or(*head_from_sensor);
    Some(MountEstimate::new(&assumed, &found, &estimator.echo_directions(&settings.radar.beam)))
}
