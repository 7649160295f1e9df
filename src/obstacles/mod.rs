//! What stands in the room: obstacles with position, covariance and extent; walls as planes.

mod acceptance;
mod evidence;
mod existence;
mod explain;
mod hands;
mod map;
mod moving;
mod past;
mod reflectors;
mod remembered;
mod rooms;
mod scene;
mod views;

pub use acceptance::{FEATURES, HeldOutScore, Model, ModelCard, ModelError, Tree, Weighed};
pub use evidence::Evidence;
pub use existence::ForgetSettings;
pub use explain::{Believed, ExplainSettings, Explained, SEGMENT_NS, Window};
pub use hands::{HandTrail, HandsM, HandsSample};
pub use map::{MapSettings, RECENT_UPDATES, Sighted, Sightings, same_place, same_plane};
pub use moving::{Moving, MovingSettings, MovingTracks};
pub use reflectors::{ReflectorSettings, find_reflectors, reflector_evidence};
pub use remembered::{Remembered, RememberedError, RememberedPlace, RememberedWall};
pub use rooms::{Look, RoomCounters, RoomSearch, RoomSettings};
pub use scene::{Observed, Obstacle, Scene, Wall};
pub use views::ViewMemory;
