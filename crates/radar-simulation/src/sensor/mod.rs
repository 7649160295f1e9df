//! The sensor behind the antenna: what happens to the echoes until they are samples. Jitter, leakage
//! from transmitter to receiver, ringing of the mounting, bias of the range, drift with temperature,
//! interference, noise, the converter. Jitter and noise can also be those of recordings.

mod background;
mod effects;
mod gain;
mod jitter;
mod model;
mod recorded;
mod synthesis;

pub use effects::{EffectsError, SensorEffects};
pub(crate) use model::SensorModel;
pub use recorded::{RecordedSensor, RecordedSensorError};
pub(crate) use synthesis::{SubsweepOfFrame, unit_amplitude_lsb};
