//! Where the head of a scenario really is at any time: what tracking errors are measured against.

use radar_sar::geometry::Pose;

use super::scenario::{POSE_MARGIN_S, PreparedScenario, host_ns};

/// The true path of the head.
#[derive(Debug, Clone)]
pub struct TruePath {
    prepared: PreparedScenario,
}

impl TruePath {
    pub(super) fn new(prepared: PreparedScenario) -> Self {
        Self { prepared }
    }

    /// `tracking_from_head` at a time of the scenario, seconds from its first sweep.
    pub fn tracking_from_head(&self, time_s: f64) -> Pose {
        self.prepared.head_at(time_s)
    }

    /// First and last time that poses are simulated for, seconds from the first sweep.
    pub fn span_s(&self) -> (f64, f64) {
        (-POSE_MARGIN_S, self.prepared.scenario.duration_s + POSE_MARGIN_S)
    }

    /// The scenario's seed.
    pub fn seed(&self) -> u64 {
        self.prepared.scenario.seed
    }

    /// Host time of a time of the scenario, nanoseconds.
    pub fn host_ns(&self, time_s: f64) -> i64 {
        host_ns(time_s)
    }
}
