//! What stands in the room: obstacles with position, covariance and extent; walls as planes.

mod classifier;
mod clean;
mod evidence;
mod existence;
mod hands;
mod history;
mod moving_targets;
mod reflectors;
mod responses;
mod room_mapper;
mod saved_map;
mod scene;
mod tracks;

pub use classifier::{FEATURES, HeldOutScore, Model, ModelCard, ModelError, ScoredCandidate, Tree};
pub use clean::{CleanSettings, CleanWindow, Detection, Detections, ROBUST_SEGMENT_NS};
pub use evidence::Evidence;
pub use existence::ExistenceSettings;
pub use hands::{HandTrail, HandsM, HandsSample};
pub use moving_targets::{MovingTarget, MovingTargetTracker, MtiSettings};
pub use reflectors::{ReflectorSettings, find_reflectors, reflector_evidence};
pub use responses::ResponseCache;
pub use room_mapper::{RoomMapper, RoomMapperCounters, RoomMapperSettings, Update};
pub use saved_map::{SavedMap, SavedMapError, SavedPoint, SavedWall};
pub use scene::{Observed, Obstacle, Scene, Wall};
pub use tracks::{MapSettings, RECENT_UPDATES, Track, TrackList, same_plane, same_point};
