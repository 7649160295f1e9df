//! What can be warned of: a body or a wall, how near it is, and how it is drawn.

use super::body_model::BodyModel;
use super::footprint::footprint;
use super::object::{Aspect, object_panel};
use super::obstacle_body::ObstacleBody;
use super::panel::{Footprint, Panel, Shape};
use super::proximity::{Proximity, proximities};
use super::settings::WarningSettings;
use super::urgency::MAX_CONTACT_DISTANCE_M;
use super::wall::{wall_panel, wall_proximities};
use radar_mapping::Wall;

/// Beyond the fade distance things are still looked at, metres: who is there may hold on to what is shown.
const REACH_MARGIN_M: f64 = 0.3;

/// Walls and bodies have ids of their own each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum HazardKey {
    Object(u64),
    Wall(u64),
}

/// A body or a wall.
#[derive(Debug, Clone, Copy)]
pub(super) enum Hazard<'s> {
    Object(&'s ObstacleBody),
    Wall(&'s Wall),
}

/// A thing as it is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WarningVisual {
    pub panel: Panel,
    pub footprint: Option<Footprint>,
    pub shape: Option<Shape>,
}

impl Hazard<'_> {
    pub fn key(&self) -> HazardKey {
        match self {
            Self::Object(body) => HazardKey::Object(body.id),
            Self::Wall(wall) => HazardKey::Wall(wall.id),
        }
    }

    /// So much of its brightness is left: what is remembered from before and not seen again yet is fainter.
    pub fn brightness(&self, settings: &WarningSettings) -> f64 {
        match self {
            Self::Object(ObstacleBody { provisional: true, .. }) | Self::Wall(Wall { provisional: true, .. }) => {
                settings.provisional_brightness
            }
            _ => 1.0,
        }
    }

    /// The thing as each part of the body has it; empty where it is out of reach of a player who keeps to the play area.
    pub fn proximities(&self, body_model: &BodyModel, settings: &WarningSettings) -> Vec<Proximity> {
        let reach_m = MAX_CONTACT_DISTANCE_M.max(settings.fade_distance_m + REACH_MARGIN_M);
        match self {
            Self::Object(body) if body.approach_m_per_s.is_some() && !settings.moving => Vec::new(),
            Self::Object(body) if !body.points.iter().any(|point| settings.is_in_reach(*point)) => Vec::new(),
            Self::Object(body) => proximities(body, body_model, reach_m),
            Self::Wall(wall) => wall_proximities(wall, body_model, reach_m),
        }
    }

    /// How it is drawn for the part of the body that it is urgent for.
    pub fn draw(
        &self,
        body_model: &BodyModel,
        near: &Proximity,
        alpha: f32,
        settings: &WarningSettings,
    ) -> Option<WarningVisual> {
        match self {
            Self::Object(body) => {
                let aspect = Aspect::of(body, body_model.head_m, body_model.ahead);
                let panel = object_panel(body, &aspect, body_model.head_m, near, alpha);
                let footprint = settings.footprints.then(|| footprint(body, &aspect, alpha));
                let points_m = body.points.clone();
                let shape = Shape { id: body.id, points_m, radius_m: body.radius_m, alpha };
                Some(WarningVisual { panel, footprint, shape: body.has_shape.then_some(shape) })
            }
            Self::Wall(wall) => {
                let panel = wall_panel(wall, body_model.head_m, near, alpha, settings)?;
                let is_in_reach = settings.is_in_reach(panel.tracking_from_panel.translation);
                is_in_reach.then_some(WarningVisual { panel, footprint: None, shape: None })
            }
        }
    }
}

impl WarningVisual {
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
