//! Poses, boxes and planes, in f64 and metres. A transform named `tracking_from_sensor` takes
//! sensor coordinates and gives tracking coordinates, so neighbours in a product share a name.

mod aabb;
mod mount;
mod plane;
mod pose;

pub use aabb::Aabb;
pub use mount::{MountError, mount};
pub use plane::Plane;
pub(crate) use pose::rotation_vector;
pub use pose::{Pose, PoseError};
