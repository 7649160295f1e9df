//! Measurements of radar-chaperone, needed neither to build nor to run it: the thesis'
//! experiments, run time against error, simulated play, training of the classifier, the vendor's
//! detector as a baseline, and poses from an inertial sensor.
#![warn(missing_docs)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod baselines;
pub mod experiments;
pub mod inertial;
pub mod results;
