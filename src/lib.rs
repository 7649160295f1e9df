//! Sees the room around a VR headset with a 60 GHz radar and warns of obstacles, chaperone-style.
//!
//! A121 sweeps and headset poses become observations. The engine images them by synthetic aperture
//! from arbitrary head motion, detects obstacles and passes them to the warnings. The modules below
//! depend only on modules further down; ARCHITECTURE.md shows the dependencies.
#![warn(missing_docs)]

/// Prints a line to standard output, like `println!`, and returns the error. A closed pipe (`… |
/// head`) is no error, so that the rest of the work is still done.
#[macro_export]
macro_rules! outln {
    ($($text:tt)*) => {
        $crate::app::print_line(&format!($($text)*))
    };
}

pub mod app;
pub mod cli;
pub mod gpu_imaging;
pub mod openvr;
pub mod panel;
pub mod render;
pub mod report;
pub mod settings;
pub mod viewer;
#[cfg_attr(not(test), warn(clippy::disallowed_methods))]
pub mod warning;

/// The examples of the README compile.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
