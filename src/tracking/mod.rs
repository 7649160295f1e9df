//! Where the sensor was: pose history, interpolation to a sweep's own time, mount, time offset between the streams; poses by inertia.

mod history;
pub mod inertial;
mod local_fit;
mod observer;
mod sample;
mod timestamps;

pub use history::{HistorySettings, NoPose, PoseHistory, SmoothPose};
pub use observer::{Observer, ObserverCounters, ObserverSettings, SensorState, observe_all};
pub use sample::{PoseRefusal, PoseSample, TrackingResult};
