//! Rooms, motions, tracking error and radar noise → the same frames and poses that the real ones give, with the truth.
//!
//! Physics with seeds: it shares constants with the reconstruction (wavelength, pulse widths, loop gains), not its code.
//! Not simulated: multipath, leakage from transmitter to receiver, timing drift, shadows.

#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod arm;
mod furniture;
mod live;
mod motion;
mod receiver;
mod room;
mod sampler;
mod scenario;
mod scenes;
mod session;
mod strokes;
mod tracker;
mod true_path;
mod truth_builder;

pub use arm::{ARM_M, ARM_REST_S};
pub use live::LiveScenario;
pub use motion::{MOTIONS, Motion, MotionError};
pub use room::{Room, Scatterer, SceneObject, WallPanel};
pub use scenario::{Scenario, ScenarioError, Simulated};
pub use scenes::{SCENES, Scene, SceneError, scene};
pub use session::{PlaySession, Session, SessionError, SessionObject, SessionWall};
pub use strokes::{ChairWalk, ToAndFro};
pub use tracker::{TrackingErrors, normal_vector};
pub use true_path::TruePath;
