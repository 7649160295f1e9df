//! Renders the view of one eye on the CPU, in linear light. Every pixel has 2 × 2 rays. A ray
//! intersects the plane of a quad, or gives a direction of a projection view; the texture is
//! averaged over the area between neighbouring rays. Overlays are drawn over everything, by sort
//! order, then from far to near, as SteamVR draws them over a scene.

use std::ops::Range;

use glam::{DMat3, DVec3};

use crate::pyramid::{Pixel, Pyramid};
use crate::snapshot::{Eye, Shape, Snapshot};

/// Rays per pixel in each direction. Choice: four rays smooth the edges; the time of a picture
/// grows with their number.
const RAYS: usize = 2;
/// Colour of a quad's back: grey, half transparent. Choice: visible in pictures, and unlike what a
/// client draws.
const BACK: Pixel = [0.05, 0.05, 0.05, 0.5];
/// Brightness of the floor lines, linear, and half their width. Choice: seen in a picture for
/// orientation, and darker than a warning.
const GRID: f32 = 0.02;
const GRID_HALF_WIDTH_M: f64 = 0.006;

/// An overlay in the image of one eye.
pub struct Layer<'a> {
    /// Maps rays to texture coordinates.
    pub surface: Surface,
    pub paint: Paint<'a>,
    pub alpha: f32,
    pub color: [f32; 3],
}

/// Appearance of a surface.
pub enum Paint<'a> {
    /// A texture; the part between two corners (u, v) is shown.
    Texture { pyramid: &'a Pyramid, bounds: [f64; 4] },
    /// The back of a quad.
    Back,
}

/// A surface that rays intersect.
#[derive(Debug, Clone, Copy)]
pub enum Surface {
    /// A quad: the eye in the quad's frame, its rotation, its size.
    Quad { eye: DVec3, overlay_from_eye: DMat3, size_m: [f64; 2] },
    /// A projection view: its rotation, and tangents at the left, right, upper and lower edge.
    View { view_from_eye: DMat3, edges: [f64; 4] },
}

impl Surface {
    /// The surface of a shape for an eye; `None` for the other eye's view.
    pub fn new(shape: Shape, size_m: [f64; 2], eye: &Eye) -> Option<Self> {
        match shape {
            Shape::Quad { standing_from_overlay } => {
                let overlay_from_eye = standing_from_overlay.inverse() * eye.standing_from_eye;
                let turn = DMat3::from_quat(overlay_from_eye.rotation);
                Some(Self::Quad { eye: overlay_from_eye.translation, overlay_from_eye: turn, size_m })
            }
            Shape::View { standing_from_view, edges, is_left } => (is_left == eye.is_left).then(|| {
                let turn = standing_from_view.rotation.conjugate() * eye.standing_from_eye.rotation;
                let edges = [edges.left, edges.right, edges.up, edges.down];
                Self::View { view_from_eye: DMat3::from_quat(turn), edges }
            }),
        }
    }

    /// Whether the eye sees the front.
    pub fn faces_eye(&self) -> bool {
        !matches!(self, Self::Quad { eye, .. } if eye.z <= 0.0)
    }

    /// Distance to the centre; views are in front of everything.
    pub fn distance_m(&self) -> f64 {
        match self {
            Self::Quad { eye, .. } => eye.length(),
            Self::View { .. } => 0.0,
        }
    }

    /// Where a ray meets the surface: (0, 0) is the upper left corner and (1, 1) the lower right
    /// one, values outside are beyond the edges. `None` if it misses the plane.
    fn hit(&self, direction_in_eye: DVec3) -> Option<[f64; 2]> {
        match self {
            Self::Quad { eye, overlay_from_eye, size_m } => {
                let direction = *overlay_from_eye * direction_in_eye;
                let distance = -eye.z / direction.z;
                let place = *eye + distance * direction;
                (distance > 0.0 && distance.is_finite()).then(|| [place.x / size_m[0] + 0.5, 0.5 - place.y / size_m[1]])
            }
            Self::View { view_from_eye, edges: [left, right, up, down] } => {
                let direction = *view_from_eye * direction_in_eye;
                let (x, y) = (-direction.x / direction.z, -direction.y / direction.z);
                (direction.z < 0.0).then(|| [(x - left) / (right - left), (up - y) / (up - down)])
            }
        }
    }

    /// The corners in the eye's frame: positions of a quad's, directions of a view's.
    fn corners(&self) -> [DVec3; 4] {
        let signs = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
        match self {
            Self::Quad { eye, overlay_from_eye, size_m: [width_m, height_m] } => {
                signs.map(|(x, y)| overlay_from_eye.transpose() * (DVec3::new(x * width_m, y * height_m, 0.0) - *eye))
            }
            Self::View { view_from_eye, edges: [left, right, up, down] } => signs.map(|(x, y)| {
                let (x, y) = (left + (x + 0.5) * (right - left), down + (y + 0.5) * (up - down));
                view_from_eye.transpose() * DVec3::new(x, y, -1.0)
            }),
        }
    }
}

/// Ray directions of an eye.
struct Rays {
    first: DVec3,
    right: DVec3,
    down: DVec3,
}

impl Rays {
    fn new(eye: &Eye, [width, height]: [u32; 2]) -> Self {
        let edges = eye.edges;
        let right = DVec3::X * (edges.right - edges.left) / (f64::from(width) * RAYS as f64);
        let down = DVec3::Y * (edges.down - edges.up) / (f64::from(height) * RAYS as f64);
        Self { first: DVec3::new(edges.left, edges.up, -1.0) + 0.5 * (right + down), right, down }
    }

    fn direction(&self, x: usize, y: usize) -> DVec3 {
        self.first + x as f64 * self.right + y as f64 * self.down
    }

    /// Columns and rows of the pixels whose rays may meet a surface; all of them if a part of it lies behind the eye.
    fn pixels(&self, surface: &Surface, size: [usize; 2]) -> [Range<usize>; 2] {
        let corners = surface.corners();
        if corners.iter().any(|corner| corner.z > -1e-3) {
            return size.map(|size| 0..size);
        }
        let first = [self.first.x, self.first.y];
        let steps = [self.right.x, self.down.y].map(|step| step * RAYS as f64);
        [0, 1].map(|axis| {
            let pixel = corners.map(|corner| (corner[axis] / -corner.z - first[axis]) / steps[axis]);
            let [from, to] = [f64::min, f64::max].map(|of| pixel.iter().copied().reduce(of).unwrap_or(0.0));
            // Casts saturate: what lies beyond an edge is an empty range there.
            let to = ((to + 2.0) as usize).min(size[axis]);
            ((from - 1.0) as usize).min(to)..to
        })
    }
}

impl Layer<'_> {
    /// Colour of a ray on the layer; `None` if it misses.
    fn seen(&self, rays: &Rays, x: usize, y: usize) -> Option<Pixel> {
        let direction = rays.direction(x, y);
        let at = self.surface.hit(direction).filter(|at| at.iter().all(|v| (0.0..=1.0).contains(v)))?;
        let Paint::Texture { pyramid, bounds: [u_min, v_min, u_max, v_max] } = &self.paint else {
            return Some(BACK.map(|part| part * self.alpha));
        };
        let on_texture = |at: [f64; 2]| [u_min + at[0] * (u_max - u_min), v_min + at[1] * (v_max - v_min)];
        let centre = on_texture(at);
        let beside = |step: DVec3| {
            let end = self.surface.hit(direction + step).map_or(centre, on_texture);
            [end[0] - centre[0], end[1] - centre[1]]
        };
        let [r, g, b, a] = pyramid.sample(centre, beside(rays.right), beside(rays.down)).map(|part| part * self.alpha);
        Some([r * self.color[0], g * self.color[1], b * self.color[2], a])
    }
}

/// Renders an eye's image, row by row from the top.
pub fn draw(snapshot: &Snapshot, eye: &Eye, layers: &[Layer]) -> Vec<[f32; 3]> {
    let rays = Rays::new(eye, snapshot.size);
    let [width, height] = snapshot.size.map(|size| size as usize);
    let mut picture = vec![snapshot.background; width * height];
    if snapshot.floor_grid {
        draw_grid(&mut picture, width, snapshot, eye, &rays);
    }
    for layer in layers {
        let [columns, rows] = rays.pixels(&layer.surface, [width, height]);
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            let pixel = &mut picture[y * width + x];
            let mut over = [0.0f32; 4];
            for ray in 0..RAYS * RAYS {
                if let Some(seen) = layer.seen(&rays, x * RAYS + ray % RAYS, y * RAYS + ray / RAYS) {
                    over.iter_mut().zip(seen).for_each(|(sum, part)| *sum += part / (RAYS * RAYS) as f32);
                }
            }
            let [r, g, b, a] = over;
            *pixel = [r + pixel[0] * (1.0 - a), g + pixel[1] * (1.0 - a), b + pixel[2] * (1.0 - a)];
        }
    }
    picture
}

/// Draws lines 1 m apart on the floor of the room.
fn draw_grid(picture: &mut [[f32; 3]], width: usize, snapshot: &Snapshot, eye: &Eye, rays: &Rays) {
    let world_from_eye = snapshot.standing_from_world.inverse() * eye.standing_from_eye;
    let height_m = world_from_eye.translation.y;
    let ray_angle = rays.right.x;
    for (index, pixel) in picture.iter_mut().enumerate() {
        let direction = world_from_eye.transform_vector(rays.direction(index % width * RAYS, index / width * RAYS));
        let distance = -height_m / direction.y;
        if !(0.0..30.0).contains(&distance) {
            continue;
        }
        let place = world_from_eye.translation + distance * direction;
        let to_line = |v: f64| (v - v.round()).abs();
        let blur_m = distance * ray_angle * RAYS as f64;
        let covered = |v: f64| ((GRID_HALF_WIDTH_M - to_line(v)) / blur_m + 0.5).clamp(0.0, 1.0);
        let strength = covered(place.x).max(covered(place.z)) * (GRID_HALF_WIDTH_M / blur_m).min(1.0);
        pixel.iter_mut().for_each(|part| *part += GRID * strength as f32);
    }
}
