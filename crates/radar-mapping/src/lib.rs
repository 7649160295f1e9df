//! Detection and mapping of a room: obstacles with position, covariance and extent, walls as
//! planes.

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod classifier;
mod clean;
mod event;
mod evidence;
mod existence;
mod hands;
mod history;
mod mapper;
mod moving_targets;
mod observer;
mod offset_guard;
mod range_axis;
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
mod time_offset_control;
mod timestamps;
mod tracks;

pub use classifier::{FEATURES, HeldOutScore, Model, ModelCard, ModelError, ScoredCandidate, Tree};
pub use clean::{CleanSettings, CleanWindow, Detection, Detections, ROBUST_SEGMENT_NS};
pub use event::{Event, in_time_order};
pub use evidence::Evidence;
pub use existence::ExistenceSettings;
pub use hands::{HandTrail, HandsM, HandsSample};
pub use mapper::{Mapper, MapperCounters, SearchCounters};
pub use moving_targets::{MovingTarget, MovingTargetTracker, MtiSettings};
pub use observer::{Observer, ObserverCounters, ObserverSettings, SensorState, observe_all};
pub use range_axis::range_axis;
pub use reflectors::{ReflectorSettings, find_reflectors, reflector_evidence};
pub use refusal::{Accepted, Refusal};
pub use responses::ResponseCache;
pub use room_mapper::{RoomMapper, RoomMapperCounters, RoomMapperSettings, Update};
pub use saved_map::{SavedMap, SavedMapError, SavedPoint, SavedWall};
pub use scene::{Observed, Obstacle, Scene, Wall};
pub use search::{DEFAULT_CUBE_M, MapperKind, cube_ahead};
pub use settings::{MappingSettings, MappingSettingsError, Mode, ProcessingSettings, RadarSettings, TrackingSettings};
pub use synchronisation::{
    Lag, LagCurve, OffsetWindow, RateOffset, ReflectorSeries, StartLag, Synchronisation, SynchronisationError,
    reflector_series, synchronisation,
};
pub use time_offset_control::TimeOffsetCounters;
pub use tracks::{MapSettings, RECENT_UPDATES, Track, TrackList, same_plane, same_point};
