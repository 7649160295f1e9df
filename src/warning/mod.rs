//! How near, how bright, and the geometry to draw. No GPU here.

mod body;
mod footprint;
mod group;
mod hull;
mod object;
mod panel;
mod player;
mod settings;
mod wall;
mod warn;
mod watch;

pub use hull::convex_hull;
pub use panel::{Footprint, Panel, PanelKind, Shape, Warnings};
pub use player::{BodyPart, Player};
pub use settings::{WarningSettings, WarningSettingsError};
pub use warn::{MAX_QUADS, warn};
pub use watch::Watch;
