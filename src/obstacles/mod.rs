//! What stands in the room: obstacles with position, covariance and extent; walls as planes.

mod reflectors;
mod scene;

pub use reflectors::{ReflectorSettings, find_reflectors};
pub use scene::{Observed, Obstacle, Scene, Wall};
