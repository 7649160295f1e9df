//! Simulation of rooms, motions, tracking errors and radar noise. Gives frames and poses as the
//! real devices do, and the ground truth.
//!
//! Seeded physics: it shares constants with the reconstruction (wavelength, pulse widths, loop
//! gains), but no code. Not simulated: multipath, leakage from transmitter to receiver, timing
//! drift, shadowing.

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
mod smooth;
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
