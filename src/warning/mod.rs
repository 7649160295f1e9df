//! Warnings: which obstacles to warn of, how bright, and the geometry to draw. Independent of the
//! GPU.

mod body_model;
mod cues;
mod footprint;
mod group;
mod habituation;
mod hazard;
mod hull;
mod label;
mod object;
mod obstacle_body;
mod panel;
mod proximity;
mod settings;
mod urgency;
mod velocity_filter;
mod wall;
mod warn;
mod warning_state;
mod warning_tracker;
mod wearer;

pub use cues::{Cue, CueScheduler, CueSettings, Tone};
pub use hull::convex_hull;
pub use panel::{Footprint, Panel, PanelKind, Shape, Warnings};
pub use settings::{Style, WarningSettings, WarningSettingsError};
pub use warn::{MAX_QUADS, warn};
pub use warning_tracker::WarningTracker;
pub use wearer::{BodyPart, Wearer};
