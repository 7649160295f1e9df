//! Frames and poses in, scene out: the observer and the engine in one, as replay, demo and the headset use them.

use serde::{Deserialize, Serialize};

use super::{Engine, EngineCounters, Settings};
use crate::geometry::Pose;
use crate::obstacles::Scene;
use crate::radar::{Frame, SensorConfig};
use crate::tracking::{Observer, ObserverCounters, ObserverSettings, PoseSample};

/// Everything that was taken, left out and done.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Joining the streams.
    pub streams: ObserverCounters,
    /// The engine.
    pub engine: EngineCounters,
}

/// The whole way from raw streams to the scene.
#[derive(Debug)]
pub struct Pipeline {
    observer: Observer,
    engine: Engine,
    sensor_path: Vec<(i64, Pose)>,
}

/// Time between two noted places of the sensor, nanoseconds.
const PATH_STEP_NS: i64 = 20_000_000;

impl Pipeline {
    /// For a sound configuration. The settings' mount goes before the one given.
    pub fn new(config: &SensorConfig, head_from_sensor: &Pose, settings: &Settings) -> Self {
        let observer = ObserverSettings {
            history: settings.tracking.history,
            head_from_sensor: settings.tracking.mount.unwrap_or(*head_from_sensor),
            time_offset_s: settings.tracking.time_offset_s,
        };
        Self {
            observer: Observer::new(config, observer),
            engine: Engine::new(config, settings),
            sensor_path: Vec::new(),
        }
    }

    /// Takes a pose of the head.
    pub fn push_pose(&mut self, sample: &PoseSample) {
        self.observer.push_pose(sample);
        self.work_off(false);
    }

    /// Takes a frame.
    pub fn push_frame(&mut self, frame: Frame) {
        self.observer.push_frame(frame);
    }

    /// Both streams have ended.
    pub fn finish(&mut self) {
        self.work_off(true);
        self.engine.finish();
    }

    fn work_off(&mut self, rest: bool) {
        let observations = if rest { self.observer.take_rest() } else { self.observer.take_ready() };
        for observation in observations {
            let time_ns = observation.mid_time_ns;
            if self.sensor_path.last().is_none_or(|last| time_ns.saturating_sub(last.0) >= PATH_STEP_NS) {
                self.sensor_path.push((time_ns, observation.tracking_from_sensor));
            }
            self.engine.push(observation);
        }
    }

    /// The engine.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// The newest valid pose of the head and its time.
    pub fn head(&self) -> Option<(i64, Pose)> {
        self.observer.head()
    }

    /// Where the sensor was, every 20 ms: time and `tracking_from_sensor`.
    pub fn sensor_path(&self) -> &[(i64, Pose)] {
        &self.sensor_path
    }

    /// What stands in the room, as far as seen.
    pub fn scene(&self) -> Scene {
        self.engine.scene()
    }

    /// What was taken, left out and done so far.
    pub fn counters(&self) -> Counters {
        Counters { streams: *self.observer.counters(), engine: self.engine.counters() }
    }
}
