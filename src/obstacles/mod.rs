//! What stands in the room: obstacles with position, covariance and extent; walls as planes.

mod scene;

pub use scene::{Observed, Obstacle, Scene, Wall};
