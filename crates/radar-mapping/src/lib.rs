//! Obstacles, walls and moving targets around a moving radar: frames and poses in, a scene out.
//!
//! A [`Mapper`] detects what returns echoes, gives each obstacle a position, a covariance and an
//! extent, finds walls as planes, follows what moves, and removes what was carried away. It has no
//! clock, no I/O and no randomness: the same events and settings give the same scene, byte for
//! byte. It is not a SLAM system: the poses must come from tracking, to about a centimetre. A scene
//! is no free-space map: what the beam has not seen is missing from it.
//!
//! - [`Event`]: a frame of the sensor (crate a121), a pose of the head (crate radar-sar), or the
//!   positions of the wearer's hands, whose echoes are not obstacles. [`in_time_order`] merges
//!   streams.
//! - [`Mapper`]: takes events with [`Mapper::push`] and refuses wrong ones with a [`Refusal`].
//!   [`MappingSettings`]: what it works by; check external ones with [`MappingSettings::check`].
//! - [`Scene`]: [`Obstacle`]s, [`Wall`]s, [`MovingTarget`]s. [`SavedMap`]: what a next run starts
//!   from.
//! - [`Observer`], [`RoomMapper`], [`find_reflectors`]: the parts of a mapper, usable alone.
//!   [`synchronisation`]: whether a recording's two streams belong together in time.
//!
//! Frames and units: right-handed, +y up, −z forward, metres, as OpenVR. Places are in the tracking
//! frame unless the name says otherwise; `head_from_sensor` (the mount) maps the sensor's frame to
//! the head's. Times are nanoseconds of one monotonic clock for all events; a frame's is the end of
//! its measurement.
//!
//! # Example
//!
//! A simulated sensor moves in front of a chair:
//!
//! ```
//! use radar_mapping::{Mapper, MappingSettings, in_time_order};
//! use radar_simulation::Scenario;
//!
//! let config = a121::preset("d16").expect("a preset");
//! let scenario = Scenario::new("chair", "sphere-50cm", config, 4.0, 1);
//! let simulated = scenario.run()?;
//!
//! let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default());
//! for event in in_time_order(simulated.frames, simulated.poses) {
//!     mapper.push(event)?;
//!     if let Some(scene) = mapper.poll_scene() {
//!         println!("{} obstacles, {} walls", scene.obstacles.len(), scene.walls.len());
//!     }
//! }
//! mapper.finish();
//!
//! let scene = mapper.scene();
//! assert!(!scene.obstacles.is_empty());
//! for obstacle in &scene.obstacles {
//!     let points = simulated.truth.obstacles.iter().flat_map(|truth| &truth.points_m);
//!     let nearest_m = points.map(|point| point.distance(obstacle.position_m)).fold(f64::INFINITY, f64::min);
//!     assert!(nearest_m < 0.25, "{:?}", obstacle.position_m);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod calibration_control;
mod calibration_in_use;
mod classifier;
mod clean;
mod event;
mod evidence;
mod existence;
mod hands;
mod history;
mod mapper;
mod mount_control;
mod mount_estimate;
mod moving_targets;
mod observer;
mod offset_guard;
mod range_axis;
mod range_bias;
mod reflector_mapper;
mod reflectors;
mod refusal;
mod responses;
mod room_mapper;
mod saved_map;
mod scene;
mod search;
mod settings;
mod synchronisation;
mod timestamps;
mod tracks;

pub use calibration_control::{MountCounters, TimeOffsetCounters};
pub use calibration_in_use::CalibrationInUse;
pub use classifier::{FEATURES, HeldOutScore, Model, ModelCard, ModelError, ScoredCandidate, Tree};
pub use clean::{CleanSettings, Detection};
pub(crate) use clean::{CleanWindow, Detections};
pub use event::{Event, in_time_order};
pub use evidence::Evidence;
pub use existence::ExistenceSettings;
pub use hands::{HandTrail, HandsM, HandsSample};
pub use mapper::{Mapper, MapperCounters, SearchCounters};
pub use mount_estimate::{BoresightEstimate, MountEstimate, MountInUse};
pub use moving_targets::{MovingTarget, MovingTargetTracker, MtiSettings};
pub use observer::{Observer, ObserverCounters, ObserverSettings, SensorState, observe_all, observe_each};
pub use range_axis::range_axis;
pub(crate) use reflectors::reflector_evidence;
pub use reflectors::{ReflectorSettings, find_reflectors};
pub use refusal::{Accepted, Refusal};
pub(crate) use responses::ResponseCache;
pub use room_mapper::{RoomMapper, RoomMapperCounters, RoomMapperSettings, Update};
pub use saved_map::{SavedMap, SavedMapError, SavedPoint, SavedWall};
pub use scene::{Observed, Obstacle, Scene, Wall};
pub use search::{DEFAULT_CUBE_M, MapperKind, cube_ahead};
pub use settings::{MappingSettings, MappingSettingsError, Mode, ProcessingSettings, RadarSettings, TrackingSettings};
pub use synchronisation::{
    Lag, LagCurve, OffsetWindow, RateOffset, ReflectorSeries, StartLag, Synchronisation, SynchronisationError,
    reflector_series, synchronisation,
};
pub use tracks::{RECENT_UPDATES, TrackSettings};
pub(crate) use tracks::{Track, TrackList, same_plane, same_point};
