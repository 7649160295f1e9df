//! What the caller asked for: sensors, link, and the times that follow from them.

use super::MAX_SENSORS;
use super::event::Link;
use crate::{FrameTiming, SensorConfig, SensorInfo, SensorSetup, SessionError, Setup, frame_timing};

/// A valid set-up and its link; constant over the session.
pub(super) struct Plan {
    pub setup: Setup,
    pub link: Link,
    timings: Vec<FrameTiming>,
}

impl Plan {
    pub fn new(setup: Setup, link: Link) -> Result<Self, SessionError> {
        check(&setup)?;
        let timings = setup.sensors().map(|s| frame_timing(&s.config)).collect();
        Ok(Self { setup, link, timings })
    }

    /// Timing of each sensor's frames, by group.
    pub fn timings(&self) -> &[FrameTiming] {
        &self.timings
    }

    /// Time between results, seconds: as configured, but at least the time that the groups need one
    /// after the other.
    pub fn result_period_s(&self) -> f64 {
        let busy_s =
            |s: &SensorSetup| frame_timing(&SensorConfig { frame_rate: None, ..s.config.clone() }).frame_period_s;
        let groups_s: f64 = self.setup.groups.iter().map(|g| g.iter().map(busy_s).fold(0.0, f64::max)).sum();
        let update_s = self.setup.update_rate_hz.map_or(0.0, |rate| 1.0 / rate);
        self.timings.iter().map(|t| t.frame_period_s).fold(groups_s.max(update_s), f64::max)
    }

    /// Checks that every sensor of the set-up is connected.
    pub fn check_sensors(&self, sensors: &[SensorInfo]) -> Result<(), SessionError> {
        let is_connected = |id: u32| sensors.get(id as usize - 1).is_some_and(|sensor| sensor.connected);
        let Some(sensor_id) = self.setup.sensors().map(|s| s.sensor_id).find(|&id| !is_connected(id)) else {
            return Ok(());
        };
        let connected: Vec<String> =
            (1..=sensors.len() as u32).filter(|&id| is_connected(id)).map(|id| id.to_string()).collect();
        let connected = match connected.is_empty() {
            true => "none is connected at all".to_owned(),
            false => format!("connected: {}", connected.join(", ")),
        };
        Err(SessionError::NotConnected { sensor_id, connected })
    }
}

/// Checks all rules that do not depend on the board.
fn check(setup: &Setup) -> Result<(), SessionError> {
    if setup.groups.is_empty() || setup.groups.iter().any(Vec::is_empty) {
        return Err(SessionError::NoSensors);
    }
    for group in &setup.groups {
        for (index, sensor) in group.iter().enumerate() {
            let sensor_id = sensor.sensor_id;
            if !(1..=MAX_SENSORS).contains(&sensor_id) {
                return Err(SessionError::SensorId(sensor_id));
            }
            if group[..index].iter().any(|other| other.sensor_id == sensor_id) {
                return Err(SessionError::SensorTwice(sensor_id));
            }
            sensor.config.validate().map_err(|source| SessionError::Config { sensor_id, source })?;
            if let (Some(update_rate_hz), Some(frame_rate_hz)) = (setup.update_rate_hz, sensor.config.frame_rate) {
                return Err(SessionError::BothRates { update_rate_hz, frame_rate_hz, sensor_id });
            }
        }
    }
    match setup.update_rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        Some(rate) => Err(SessionError::UpdateRate(rate)),
        None => Ok(()),
    }
}
