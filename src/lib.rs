//! Sees the room around a VR headset with a 60 GHz radar and warns of obstacles, chaperone-style.
//!
//! A121 sweeps and headset poses become observations; the engine images them by synthetic aperture from arbitrary head
//! motion, finds obstacles and hands on warnings. The rooms below only use rooms further down; ARCHITECTURE.md draws it.
#![warn(missing_docs)]

pub mod a121;
pub mod cli;
pub mod engine;
pub mod experiments;
pub mod geometry;
pub mod imaging;
pub mod live;
pub mod math;
pub mod obstacles;
pub mod panel;
pub mod peers;
pub mod radar;
pub mod recording;
pub mod render;
pub mod report;
pub mod simulation;
pub mod steamvr;
pub mod tracking;
pub mod truth;
pub mod view;
pub mod warning;
