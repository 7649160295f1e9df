//! Sees the room around a VR headset with a 60 GHz radar and warns of obstacles, chaperone-style.
//!
//! A121 sweeps and headset poses become observations; the engine images them by synthetic aperture from arbitrary head
//! motion, finds obstacles and hands on warnings. The rooms below only use rooms further down; ARCHITECTURE.md draws it.
#![warn(missing_docs)]

#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod a121;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod baselines;
pub mod cli;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod engine;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod experiments;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod geometry;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod imaging;
pub mod live;
pub mod math;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod obstacles;
pub mod openvr;
pub mod panel;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod radar;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod recording;
pub mod render;
pub mod report;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod simulation;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod tracking;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod truth;
pub mod view;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod warning;
