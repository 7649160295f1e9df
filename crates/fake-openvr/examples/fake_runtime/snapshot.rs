//! State of one moment for rendering: the head, the eyes and the visible overlays, all in the
//! standing universe. The textures are still in the GPU's copies. Taken under the lock, rendered
//! outside it.

use radar_sar::geometry::Pose;
use serde_json::{Value, json};

use crate::config::ProjectionMatrix;
use crate::eyes::Edges;
use crate::overlay::{Overlay, Transform};
use crate::sys;
use crate::world::World;

/// Placement of an overlay.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// A quad in the room, facing its +z. Its height follows from the texture.
    Quad { standing_from_overlay: Pose },
    /// Covers one eye's view: content appears in the direction from which the client drew it.
    View { standing_from_view: Pose, edges: Edges, is_left: bool },
}

/// An overlay to draw.
pub struct Item {
    pub overlay: Overlay,
    pub shape: Shape,
}

impl Item {
    /// Whether the texture is side by side, and if so, whether the left half is the left eye's.
    pub fn left_half_first(&self) -> Option<bool> {
        let parallel = self.overlay.has(sys::VROverlayFlags_SideBySide_Parallel);
        (parallel || self.overlay.has(sys::VROverlayFlags_SideBySide_Crossed)).then_some(parallel)
    }

    /// The quad's height: from its width and the part of the texture that one eye sees.
    pub fn height_m(&self) -> Option<f64> {
        let [width, height] = self.overlay.texture.as_ref()?.size.map(f64::from);
        let eyes = if self.left_half_first().is_some() { 2.0 } else { 1.0 };
        let [u_min, v_min, u_max, v_max] = self.overlay.look.bounds.map(f64::from);
        let aspect = (height * (v_max - v_min)).abs() / (width / eyes * (u_max - u_min)).abs();
        Some(f64::from(self.overlay.look.width_m) * aspect / f64::from(self.overlay.look.texel_aspect))
    }
}

/// An eye.
#[derive(Debug, Clone, Copy)]
pub struct Eye {
    pub standing_from_eye: Pose,
    pub edges: Edges,
    pub is_left: bool,
}

/// A moment.
pub struct Snapshot {
    pub name: String,
    /// Time at which the light of the image leaves the display, nanoseconds.
    pub time_ns: i64,
    pub standing_from_head: Pose,
    /// The room at the start, for the grid on its floor.
    pub standing_from_world: Pose,
    pub eyes: [Eye; 2],
    pub size: [u32; 2],
    pub background: [f32; 3],
    pub floor_grid: bool,
    /// Whether quads have a visible back: for clients built with SDK 2.15 or later, unless a quad
    /// opts out.
    pub backs: bool,
    pub universe_id: u64,
    pub items: Vec<Item>,
}

impl World {
    /// The present moment: the light of the next frame, and what is shown now.
    ///
    /// # Errors
    /// The head's pose is unknown.
    pub fn snapshot(&self, name: &str, now_ns: i64) -> Result<Snapshot, String> {
        let display = &self.config.display;
        let vsync_ns = self.frames.start_ns(self.frames.at(now_ns) + 1);
        let time_ns = vsync_ns + (display.vsync_to_photons_s * 1e9) as i64;
        let standing_from_world = self.universes.standing_from_world();
        let head = self.devices.pose(0, time_ns).ok_or("a gap in the head's track")?;
        let standing_from_head = standing_from_world * head;
        let eye = |is_left| Eye {
            standing_from_eye: standing_from_head * self.head_from_eye(is_left),
            edges: self.eye_edges(is_left),
            is_left,
        };
        let item = |overlay: &Overlay| {
            let shape = self.shape(overlay.transform, time_ns)?;
            Some(Item { overlay: overlay.clone(), shape })
        };
        Ok(Snapshot {
            name: name.to_owned(),
            time_ns,
            standing_from_head,
            standing_from_world,
            eyes: [eye(true), eye(false)],
            size: display.shot_size,
            background: display.background,
            floor_grid: display.floor_grid,
            backs: self.report.sdk_version.is_some_and(|[major, minor, _]| (major, minor) >= (2, 15)),
            universe_id: self.universes.id,
            items: self.overlays.visible().filter_map(item).collect(),
        })
    }

    /// Placement of an overlay; `None` if it has no transform, or its device does not exist.
    fn shape(&self, transform: Transform, time_ns: i64) -> Option<Shape> {
        let standing_from_world = self.universes.standing_from_world();
        let standing_from = |origin| Some(standing_from_world * self.universes.universe_from_world(origin)?.inverse());
        Some(match transform {
            Transform::Unset => return None,
            Transform::Absolute { origin, universe_from_overlay } => {
                Shape::Quad { standing_from_overlay: standing_from(origin)? * universe_from_overlay }
            }
            Transform::Device { device, device_from_overlay } => {
                let standing_from_device = standing_from_world * self.devices.pose(device as usize, time_ns)?;
                Shape::Quad { standing_from_overlay: standing_from_device * device_from_overlay }
            }
            Transform::Projection { origin, matrix, edges, is_left } => {
                let universe_from_view = match self.config.projection_matrix {
                    ProjectionMatrix::TrackingFromEye => matrix,
                    ProjectionMatrix::EyeFromTracking => matrix.inverse(),
                };
                Shape::View { standing_from_view: standing_from(origin)? * universe_from_view, edges, is_left }
            }
        })
    }
}

fn pose_json(pose: &Pose) -> Value {
    json!({ "position_m": pose.translation.to_array(), "quaternion_xyzw": pose.rotation.to_array() })
}

fn edges_json(edges: Edges) -> Value {
    json!({ "left": edges.left, "right": edges.right, "up": edges.up, "down": edges.down })
}

impl Item {
    fn to_json(&self) -> Value {
        let overlay = &self.overlay;
        let mut json = json!({
            "key": overlay.key,
            "name": overlay.name,
            "alpha": overlay.look.alpha,
            "color": overlay.look.color,
            "width_m": overlay.look.width_m,
            "height_m": self.height_m(),
            "texture_size": overlay.texture.as_ref().map(|texture| texture.size),
            "texture_bounds": overlay.look.bounds,
            "texel_aspect": overlay.look.texel_aspect,
            "flags": overlay.flags,
            "sort_order": overlay.look.sort_order,
        });
        match self.shape {
            Shape::Quad { standing_from_overlay } => {
                json["tracking_from_overlay"] = pose_json(&standing_from_overlay);
            }
            Shape::View { standing_from_view, edges, is_left } => {
                json["tracking_from_view"] = pose_json(&standing_from_view);
                json["view_tangents"] = edges_json(edges);
                json["eye"] = json!(if is_left { "left" } else { "right" });
            }
        }
        json
    }
}

impl Snapshot {
    /// Metadata of the images. `tracking` is the standing universe.
    pub fn to_json(&self) -> Value {
        let eye = |eye: &Eye| json!({ "tracking_from_eye": pose_json(&eye.standing_from_eye), "tangents": edges_json(eye.edges) });
        json!({
            "name": self.name,
            "time_ns": self.time_ns,
            "tracking_from_world": pose_json(&self.standing_from_world),
            "size": self.size,
            "universe_id": self.universe_id,
            "tracking_from_head": pose_json(&self.standing_from_head),
            "left": eye(&self.eyes[0]),
            "right": eye(&self.eyes[1]),
            "overlays": self.items.iter().map(Item::to_json).collect::<Vec<_>>(),
        })
    }
}
