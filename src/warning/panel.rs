//! What is drawn for an obstacle: an upright panel at its near side, its footprint on the floor,
//! and its shape.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::wearer::BodyPart;
use radar_sar::geometry::Pose;

/// What a panel represents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PanelKind {
    /// An obstacle: its silhouette is drawn into the grid.
    Object,
    /// A wall: the grid alone.
    Wall,
    /// An obstacle whose shape is drawn in space behind the panel: grid and border.
    Pane,
}

/// An upright quad in the room. Its texture depends only on `kind`, `size_m` and `silhouette`;
/// these are rounded, so that the texture changes rarely.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Id of the obstacle or wall.
    pub id: u64,
    /// Obstacle or wall.
    pub kind: PanelKind,
    /// Centre of the quad; +x to the right and +y up on it, +z out of its front, towards the head.
    pub tracking_from_panel: Pose,
    /// Width and height, metres.
    pub size_m: DVec2,
    /// Silhouette as discs on the panel: centre (panel x, y, metres from the middle) and radius,
    /// metres. Empty for a wall and for a range-only obstacle.
    pub silhouette: Arc<[(DVec2, f64)]>,
    /// Brightness, 0 (not drawn) to 1.
    pub alpha: f32,
    /// Distance to the near side of the obstacle, metres: from the vertical line between head and
    /// floor, or from the head for what is above it.
    pub distance_m: f64,
    /// Time until the nearest body part touches it at its closing speed, seconds; `None` when it
    /// does not approach or its speed is unknown.
    pub time_to_contact_s: Option<f64>,
    /// The nearest body part.
    pub nearest_part: BodyPart,
    /// Point of the obstacle nearest to that part, tracking frame, metres.
    pub nearest_m: DVec3,
    /// Distance to write on the panel, metres; see [`super::WarningTracker::warn`].
    pub label_m: Option<f64>,
}

/// Footprint of an obstacle on the floor (y = 0): a convex polygon in x and z, counter-clockwise
/// seen from above (+y), metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprint {
    /// Id of the obstacle.
    pub id: u64,
    /// Corners as (x, z).
    pub corners_xz_m: Arc<[DVec2]>,
    /// Brightness, 0 to 1.
    pub alpha: f32,
}

/// Known shape of an obstacle as spheres of one size, for displays that draw it in space.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Id of the obstacle.
    pub id: u64,
    /// Centres of the spheres, tracking frame, metres.
    pub points_m: Arc<[DVec3]>,
    /// Radius of each sphere, metres.
    pub radius_m: f64,
    /// Brightness, 0 to 1.
    pub alpha: f32,
}

/// Everything to draw for one head pose, brightest first; dark ones are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Warnings {
    /// Panels.
    pub panels: Vec<Panel>,
    /// Footprints.
    pub footprints: Vec<Footprint>,
}

impl Warnings {
    /// The first `most` quads: panels in their order, then footprints where there is room. A panel
    /// is more informative than a footprint, and the brightest more than the rest.
    pub fn at_most(mut self, most: usize) -> Self {
        self.panels.truncate(most);
        self.footprints.truncate(most - self.panels.len());
        self
    }

    /// For displays that draw shapes in space: panels without silhouettes, which would duplicate
    /// the shapes. A range-only obstacle has no shape, and its panel stays unchanged.
    pub fn without_silhouettes(mut self) -> Self {
        for panel in self.panels.iter_mut().filter(|panel| !panel.silhouette.is_empty()) {
            panel.kind = PanelKind::Pane;
            panel.silhouette = Arc::default();
        }
        self
    }
}
