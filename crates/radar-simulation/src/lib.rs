//! Simulated rooms, motions, tracking errors and radar noise: frames and poses as the real devices
//! give them, and the ground truth.
//!
//! Seeded physics: the same seed gives the same recording. It shares constants with the
//! reconstruction (wavelength, pulse widths, loop gains), but no code. It is not an electromagnetic
//! solver. Scenes consist of point scatterers and specular walls, without multipath and shadows; play
//! sessions can also be played in rooms of panels, edges, tubes and bodies, with them, by
//! geometrical optics ([`PlayWorld`]).
//!
//! - [`Scenario`]: a scene of [`SCENES`], a motion of [`MOTIONS`], a sensor; [`Scenario::run`] gives
//!   a [`Simulated`] recording, [`Scenario::live`] an endless one.
//! - [`PlaySession`]: minutes of play in a furnished room, with hands and a visitor.
//! - [`Room`], [`Scatterer`], [`WallPanel`]: what returns echoes. [`SensorEffects`]: jitter, leakage and
//!   other imperfections of the sensor. [`Headset`], [`TrackingErrors`]: what is wrong with the poses.
//!
//! Frames and units: right-handed, +y up, −z forward, floor at y = 0, metres, as OpenVR; radar
//! cross-sections in dBsm, samples in LSB, phase growing with range; times in nanoseconds of the
//! host's clock.
//!
//! # Example
//!
//! ```
//! use radar_simulation::Scenario;
//!
//! let config = a121::preset("d16").expect("a preset");
//! let simulated = Scenario::new("chair", "natural", config, 1.0, 7).run()?;
//! assert_eq!(simulated.frames.len(), 66);
//! assert_eq!(simulated.frames[0].samples.len(), 16 * 50);
//! assert!(simulated.poses.iter().all(|pose| pose.valid));
//! assert_eq!(simulated.truth.obstacles[0].name, "chair");
//! # Ok::<(), radar_simulation::ScenarioError>(())
//! ```

#![deny(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod arm;
mod echoes;
mod furniture;
mod headset;
mod live;
mod motion;
mod receiver;
mod room;
mod sampler;
mod scenario;
mod scenes;
mod sensor;
mod session;
mod smooth;
mod strokes;
mod tracker;
mod true_path;
mod truth_builder;
mod world;

pub use arm::{ARM_M, ARM_REST_S};
pub use echoes::DiffuseEchoes;
pub use headset::{Headset, HeadsetError};
pub use live::LiveScenario;
pub use motion::{MOTIONS, Motion, MotionError};
pub use room::{Room, Scatterer, SceneObject, WallPanel};
pub use scenario::{Scenario, ScenarioError, Simulated};
pub use scenes::{SCENES, Scene, SceneError, scene};
pub use sensor::{EffectsError, RecordedSensor, RecordedSensorError, SensorEffects};
pub use session::{PlaySession, PlayWorld, PlayWorldError, Session, SessionError, SessionObject, SessionWall};
pub use strokes::{ChairWalk, ToAndFro};
pub use tracker::{TrackingErrors, normal_vector};
pub use true_path::TruePath;
