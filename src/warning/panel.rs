//! What is drawn for an obstacle: an upright panel at its near side, its footprint on the floor, and its shape.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::wearer::BodyPart;
use radar_sar::geometry::Pose;

/// What a panel stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PanelKind {
    /// An object: its silhouette is drawn into the grid.
    Object,
    /// A wall: the grid alone.
    Wall,
    /// An object whose shape is shown in space, behind the panel: grid and border.
    Pane,
}

/// An upright quad in the room. Its texture depends on `kind`, `size_m` and `silhouette` alone; these are rounded to
/// centimetres, so that it changes seldom.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// The obstacle or wall it warns of.
    pub id: u64,
    /// Object or wall.
    pub kind: PanelKind,
    /// Middle of the quad; +x to the right and +y up on it, +z out of its front, towards the head.
    pub tracking_from_panel: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
    /// Silhouette as discs on the panel: middle (panel x, y, metres from the middle) and radius, metres. Empty for a wall,
    /// and for an object of which only the distance is known.
    pub silhouette: Vec<(DVec2, f64)>,
    /// Brightness, 0 (not drawn) to 1.
    pub alpha: f32,
    /// From the wearer, the vertical line from head to floor, to the nearest side of the obstacle, metres; from the head for
    /// what is above it.
    pub distance_m: f64,
    /// Until the nearest part of the body is there at the speed it comes nearer at; `None` when it does not come nearer, or when its
    /// speed is not known.
    pub time_to_contact_s: Option<f64>,
    /// The part of the body that is nearest.
    pub nearest_part: BodyPart,
    /// The place of the obstacle that is nearest to that part, tracking frame, metres.
    pub nearest_m: DVec3,
    /// A distance to write on the panel, metres; see [`super::WarningTracker::warn`].
    pub label_m: Option<f64>,
}

/// Where an obstacle stands on the floor (y = 0): a convex polygon of x and z, counter-clockwise seen from above (+y), metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprint {
    /// The obstacle it belongs to.
    pub id: u64,
    /// Corners as (x, z).
    pub corners_xz_m: Vec<DVec2>,
    /// Brightness, 0 to 1.
    pub alpha: f32,
}

/// What is known of an obstacle's shape, as balls of one size: for displays that show it in space.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// The obstacle it belongs to.
    pub id: u64,
    /// Middles of the balls, tracking frame, metres.
    pub points_m: Arc<[DVec3]>,
    /// Radius of each, metres.
    pub radius_m: f64,
    /// Brightness, 0 to 1.
    pub alpha: f32,
}

/// Everything to draw for one head pose; brightest first, dark ones left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Warnings {
    /// Panels.
    pub panels: Vec<Panel>,
    /// Footprints.
    pub footprints: Vec<Footprint>,
}

impl Warnings {
    /// Those that are shown where at most `most` quads can be: panels in their order, then, if there is room, footprints.
    /// A panel says more than a footprint, and the brightest more than the rest.
    pub fn at_most(mut self, most: usize) -> Self {
        self.panels.truncate(most);
        self.footprints.truncate(most - self.panels.len());
        self
    }

    /// For displays that show shapes in space: panels without silhouettes, which would be seen beside the shapes. Something of
    /// unknown direction has no shape, and its panel stays as it is.
    pub fn without_silhouettes(mut self) -> Self {
        for panel in self.panels.iter_mut().filter(|panel| !panel.silhouette.is_empty()) {
            panel.kind = PanelKind::Pane;
            panel.silhouette.clear();
        }
        self
    }
}
