//! How near, how bright, and the geometry to draw. No GPU here.

mod body;
mod calm;
mod cues;
mod footprint;
mod group;
mod hull;
mod label;
mod near;
mod object;
mod panel;
mod player;
mod settings;
mod speed;
mod thing;
mod track;
mod urgency;
mod wall;
mod warn;
mod watch;
mod wearer;

pub use cues::{Cue, CueSettings, Cues, Tone};
pub use hull::convex_hull;
pub use panel::{Footprint, Panel, PanelKind, Shape, Warnings};
pub use player::{BodyPart, Player};
pub use settings::{Style, WarningSettings, WarningSettingsError};
pub use warn::{MAX_QUADS, warn};
pub use watch::Watch;
