//! What can be warned of: an obstacle or a wall, with its distance to the body and its visual.

use glam::DVec3;

use super::body_model::{BodyModel, Limb};
use super::footprint::footprint;
use super::object::{Aspect, Layout, object_panel};
use super::obstacle_body::ObstacleBody;
use super::panel::{Footprint, Panel, Shape};
use super::proximity::{Proximity, proximities};
use super::settings::WarningSettings;
use super::urgency::MAX_CONTACT_DISTANCE_M;
use super::wall::{wall_panel, wall_proximities};
use radar_mapping::Wall;

/// Hazards are tracked this far beyond the fade distance, metres, because a warning is held beyond
/// it. Choice: twice the margin for which it is held.
const REACH_MARGIN_M: f64 = 0.3;

/// Key of a hazard; walls and obstacles count their ids separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum HazardKey {
    Object(u64),
    Wall(u64),
}

/// An obstacle or a wall.
#[derive(Debug, Clone, Copy)]
pub(super) enum Hazard<'s> {
    Object(&'s ObstacleBody),
    Wall(&'s Wall),
}

/// What is drawn for a hazard.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WarningVisual {
    pub panel: Panel,
    pub footprint: Option<Footprint>,
    pub shape: Option<Shape>,
    /// Of an obstacle's picture and footprint.
    pub layout: Option<Layout>,
}

impl Hazard<'_> {
    pub fn key(&self) -> HazardKey {
        match self {
            Self::Object(body) => HazardKey::Object(body.id),
            Self::Wall(wall) => HazardKey::Wall(wall.id),
        }
    }

    /// Factor on the brightness: what was restored from a saved map and not seen again is fainter.
    pub fn brightness(&self, settings: &WarningSettings) -> f64 {
        match self {
            Self::Object(ObstacleBody { provisional: true, .. }) | Self::Wall(Wall { provisional: true, .. }) => {
                settings.provisional_brightness
            }
            _ => 1.0,
        }
    }

    /// Distances to each body part; empty where the wearer cannot reach.
    pub fn proximities(&self, body_model: &BodyModel, settings: &WarningSettings) -> Vec<Proximity> {
        let reach_m = MAX_CONTACT_DISTANCE_M.max(settings.fade_distance_m + REACH_MARGIN_M);
        match self {
            Self::Object(body) if body.approach_m_per_s.is_some() && !settings.moving => Vec::new(),
            Self::Object(body) if !can_reach(body_model, body.points.iter().copied(), settings) => Vec::new(),
            Self::Object(body) => proximities(body, body_model, reach_m),
            Self::Wall(wall) => wall_proximities(wall, body_model, reach_m),
        }
    }

    /// What is drawn for the body part with the greatest urgency. What was drawn before is taken from there while its layout
    /// stays.
    pub fn draw(
        &self,
        body_model: &BodyModel,
        near: &Proximity,
        alpha: f32,
        settings: &WarningSettings,
        before: Option<&WarningVisual>,
    ) -> Option<WarningVisual> {
        match self {
            Self::Object(body) => {
                let aspect = Aspect::of(body, body_model.head_m, body_model.ahead);
                let layout = Layout::of(body, &aspect);
                let before = before.filter(|before| before.layout.as_ref() == Some(&layout));
                let silhouette = before.map_or_else(|| layout.silhouette(), |before| before.panel.silhouette.clone());
                let known_corners = before.and_then(|before| before.footprint.as_ref()).map(|f| f.corners_xz_m.clone());
                let corners = || known_corners.unwrap_or_else(|| footprint(body, &aspect));
                let panel = object_panel(body, (&aspect, &layout), silhouette, body_model.head_m, near, alpha);
                let footprint = settings.footprints.then(|| Footprint { id: body.id, corners_xz_m: corners(), alpha });
                let points_m = body.points.clone();
                let shape = Shape { id: body.id, points_m, radius_m: body.radius_m, alpha };
                let shape = body.has_shape.then_some(shape);
                Some(WarningVisual { panel, footprint, shape, layout: Some(layout) })
            }
            Self::Wall(wall) => {
                let panel = wall_panel(wall, body_model.head_m, near, alpha, settings)?;
                let can_reach = can_reach(body_model, [panel.tracking_from_panel.translation], settings);
                can_reach.then_some(WarningVisual { panel, footprint: None, shape: None, layout: None })
            }
        }
    }
}

/// Whether the wearer can come near one of these points: in the play area near those around it, past its boundary near any.
fn can_reach(body_model: &BodyModel, points: impl IntoIterator<Item = DVec3>, settings: &WarningSettings) -> bool {
    let has_left = |limb: &Limb| limb.ends.iter().any(|end| !settings.is_in_play_area(*end, 0.0));
    points.into_iter().any(|point| settings.is_in_play_area(point, settings.play_area_margin_m))
        || body_model.limbs.iter().any(has_left)
}

impl WarningVisual {
    /// Sets the brightness.
    pub fn set_alpha(&mut self, alpha: f32) {
        self.panel.alpha = alpha;
        self.footprint.iter_mut().for_each(|area| area.alpha = alpha);
        self.shape.iter_mut().for_each(|shape| shape.alpha = alpha);
    }

    /// Sets the id.
    pub fn set_id(&mut self, id: u64) {
        self.panel.id = id;
        self.footprint.iter_mut().for_each(|area| area.id = id);
        self.shape.iter_mut().for_each(|shape| shape.id = id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use radar_mapping::{Observed, Obstacle};
    use radar_sar::geometry::Pose;

    /// A box of 0.6 × 0.9 × 0.3 m on the floor, its middle `aside_m` to the right of the origin, in voxels of 5 cm.
    fn sofa(aside_m: f64) -> Obstacle {
        let shape = (0..12 * 18 * 6)
            .map(|i| DVec3::new((i % 12).into(), (i / 12 % 18).into(), (i / 216).into()) * 0.05)
            .map(|v| (v + DVec3::new(aside_m - 0.275, 0.025, -0.125), 1.0));
        Obstacle {
            id: 1,
            position_m: DVec3::new(aside_m, 0.45, 0.0),
            covariance_m2: DMat3::from_diagonal(DVec3::splat(4e-4)),
            observed: Observed::Position,
            extent_m: DVec3::new(0.6, 0.9, 0.3),
            evidence: 10.0,
            shape: shape.collect(),
            provisional: false,
            first_seen_ns: 0,
            last_seen_ns: 0,
        }
    }

    #[test]
    fn what_is_taken_over_from_the_frame_before_equals_what_is_laid_out_anew() {
        let settings = WarningSettings::default();
        let (mut before, mut taken_over, mut laid_out): (Option<WarningVisual>, u32, u32) = (None, 0, 0);
        // Once around it at a changing distance; twice it is found a little aside.
        for step in 0..1200 {
            let body = ObstacleBody::of(&sofa(f64::from(step / 400) * 0.03)).unwrap();
            let angle = std::f64::consts::TAU * f64::from(step) / 1200.0;
            let distance_m = 0.9 + 0.4 * (7.0 * angle).sin();
            let eye = DVec3::new(angle.sin() * distance_m, 1.6 + 0.1 * (5.0 * angle).sin(), angle.cos() * distance_m);
            let body_model = BodyModel::still(&Pose::from_translation(eye)).unwrap();
            let hazard = Hazard::Object(&body);
            let near = hazard.proximities(&body_model, &settings)[0];
            let [with, without] = [before.as_ref(), None]
                .map(|before| hazard.draw(&body_model, &near, 0.5, &settings, before).expect("it is an obstacle"));
            assert_eq!(with, without, "step {step}");
            let is_taken_over =
                before.is_some_and(|before| std::sync::Arc::ptr_eq(&before.panel.silhouette, &with.panel.silhouette));
            *(if is_taken_over { &mut taken_over } else { &mut laid_out }) += 1;
            before = Some(with);
        }
        assert!(taken_over > 600 && laid_out > 20, "{taken_over} taken over, {laid_out} laid out");
    }
}
