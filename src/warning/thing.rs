//! What can be warned of: a body or a wall, how near it is, and how it is drawn.

use super::body::Body;
use super::footprint::footprint;
use super::near::{Near, nears};
use super::object::{Aspect, object_panel};
use super::panel::{Footprint, Panel, Shape};
use super::settings::WarningSettings;
use super::urgency::FARTHEST_CONTACT_M;
use super::wall::{wall_nears, wall_panel};
use super::wearer::Wearer;
use radar_mapping::Wall;

/// Beyond the fade distance things are still looked at, metres: who is there may hold on to what is shown.
const MARGIN_M: f64 = 0.3;

/// Walls and bodies have ids of their own each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Key {
    Object(u64),
    Wall(u64),
}

/// A body or a wall.
#[derive(Debug, Clone, Copy)]
pub(super) enum Thing<'s> {
    Object(&'s Body),
    Wall(&'s Wall),
}

/// A thing as it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Drawn {
    pub panel: Panel,
    pub footprint: Option<Footprint>,
    pub shape: Option<Shape>,
}

impl Thing<'_> {
    pub fn key(&self) -> Key {
        match self {
            Self::Object(body) => Key::Object(body.id),
            Self::Wall(wall) => Key::Wall(wall.id),
        }
    }

    /// So much of its brightness is left: what is remembered from before and not seen again yet is fainter.
    pub fn brightness(&self, settings: &WarningSettings) -> f64 {
        match self {
            Self::Object(Body { provisional: true, .. }) | Self::Wall(Wall { provisional: true, .. }) => {
                settings.provisional_brightness
            }
            _ => 1.0,
        }
    }

    /// The thing as each part of the body has it; empty where it is out of reach of a player who keeps to the play area.
    pub fn nears(&self, wearer: &Wearer, settings: &WarningSettings) -> Vec<Near> {
        let reach_m = FARTHEST_CONTACT_M.max(settings.fade_distance_m + MARGIN_M);
        match self {
            Self::Object(body) if body.comes_m_per_s.is_some() && !settings.moving => Vec::new(),
            Self::Object(body) if !body.points.iter().any(|point| settings.is_in_reach(*point)) => Vec::new(),
            Self::Object(body) => nears(body, wearer, reach_m),
            Self::Wall(wall) => wall_nears(wall, wearer, reach_m),
        }
    }

    /// How it is drawn for the part of the body that it is urgent for.
    pub fn draw(&self, wearer: &Wearer, near: &Near, alpha: f32, settings: &WarningSettings) -> Option<Drawn> {
        match self {
            Self::Object(body) => {
                let aspect = Aspect::of(body, wearer.head_m, wearer.ahead);
                let panel = object_panel(body, &aspect, wearer.head_m, near, alpha);
                let footprint = settings.footprints.then(|| footprint(body, &aspect, alpha));
                let points_m = body.points.clone();
                let shape = Shape { id: body.id, points_m, radius_m: body.radius_m, alpha };
                Some(Drawn { panel, footprint, shape: body.has_shape.then_some(shape) })
            }
            Self::Wall(wall) => {
                let panel = wall_panel(wall, wearer.head_m, near, alpha, settings)?;
                let is_in_reach = settings.is_in_reach(panel.tracking_from_panel.translation);
                is_in_reach.then_some(Drawn { panel, footprint: None, shape: None })
            }
        }
    }
}

impl Drawn {
    /// With another brightness.
    pub fn set_alpha(&mut self, alpha: f32) {
        self.panel.alpha = alpha;
        self.footprint.iter_mut().for_each(|area| area.alpha = alpha);
        self.shape.iter_mut().for_each(|shape| shape.alpha = alpha);
    }

    /// With another id.
    pub fn set_id(&mut self, id: u64) {
        self.panel.id = id;
        self.footprint.iter_mut().for_each(|area| area.id = id);
        self.shape.iter_mut().for_each(|shape| shape.id = id);
    }
}
