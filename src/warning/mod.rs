//! How near, how bright, and the geometry to draw. No GPU here.

mod panel;

pub use panel::{Footprint, Panel, PanelKind, Warnings};
