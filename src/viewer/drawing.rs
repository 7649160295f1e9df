//! Contents of the 3D view as lists of lines, faces and points, and the bodies made of them. Knows
//! no GPU.

use glam::{DMat3, DVec3};

use radar_sar::geometry::{Aabb, Pose};

/// Red, green, blue (sRGB) and alpha, 0 to 1.
pub type Color = [f32; 4];

/// A line with a width in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Start point, tracking frame, metres.
    pub from_m: DVec3,
    /// End point, tracking frame, metres.
    pub to_m: DVec3,
    /// Width, pixels.
    pub width_px: f32,
    /// Colour.
    pub color: Color,
}

/// A triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Corners, tracking frame, metres.
    pub corners_m: [DVec3; 3],
    /// Colour.
    pub color: Color,
}

/// A ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Centre, tracking frame, metres.
    pub position_m: DVec3,
    /// Radius, metres.
    pub radius_m: f32,
    /// Colour.
    pub color: Color,
}

/// Everything in the 3D view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Drawing {
    /// Opaque faces.
    pub faces: Vec<Face>,
    /// Balls.
    pub points: Vec<Point>,
    /// Lines.
    pub lines: Vec<Line>,
    /// Transparent faces. They hide nothing.
    pub transparent_faces: Vec<Face>,
}

/// Direction towards the light. Choice: from above and the front right, so that all faces of a box
/// differ.
const LIGHT: DVec3 = DVec3::new(0.35, 0.85, 0.4);
/// Rings and segments of a ball's mesh. Choice: it looks round at the size of an obstacle; a
/// hundred balls are 40 000 triangles.
const RINGS: u32 = 10;
const SEGMENTS: u32 = 20;

impl Drawing {
    /// Adds a line.
    pub fn line(&mut self, from_m: DVec3, to_m: DVec3, width_px: f32, color: Color) {
        if from_m.is_finite() && to_m.is_finite() {
            self.lines.push(Line { from_m, to_m, width_px, color });
        }
    }

    /// Adds lines from each point to the next.
    pub fn polyline(&mut self, points_m: impl IntoIterator<Item = DVec3>, width_px: f32, color: Color) {
        let mut before = None;
        for point in points_m {
            if let Some(before) = before.replace(point) {
                self.line(before, point, width_px, color);
            }
        }
    }

    /// Adds a ball.
    pub fn point(&mut self, position_m: DVec3, radius_m: f64, color: Color) {
        if position_m.is_finite() && radius_m.is_finite() {
            self.points.push(Point { position_m, radius_m: radius_m as f32, color });
        }
    }

    /// Adds a transparent polygon.
    pub fn transparent_polygon(&mut self, corners_m: &[DVec3], color: Color) {
        fan(&mut self.transparent_faces, corners_m, color);
    }

    /// Adds the edges of a box given in its own frame.
    pub fn box_edges(&mut self, tracking_from_box: &Pose, bounds: &Aabb, width_px: f32, color: Color) {
        let corner = |n: usize| {
            let pick = |axis: usize| if n >> axis & 1 == 1 { bounds.max[axis] } else { bounds.min[axis] };
            tracking_from_box.transform_point(DVec3::new(pick(0), pick(1), pick(2)))
        };
        for n in 0..8 {
            for axis in (0..3).filter(|axis| n >> axis & 1 == 0) {
                self.line(corner(n), corner(n | 1 << axis), width_px, color);
            }
        }
    }

    /// Adds a solid, shaded box.
    pub fn solid_box(&mut self, tracking_from_box: &Pose, bounds: &Aabb, color: Color) {
        let (middle, half) = (bounds.center(), bounds.size() / 2.0);
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let normal = DVec3::AXES[axis] * side;
                let (u, v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
                let corner =
                    |a: f64, b: f64| tracking_from_box.transform_point(middle + (normal + u * a + v * b) * half);
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                fan(&mut self.faces, &corners, lit(color, tracking_from_box.transform_vector(normal)));
            }
        }
    }

    /// Adds a solid, shaded ball, scaled by a matrix.
    pub fn solid_ball(&mut self, middle_m: DVec3, axes_m: &DMat3, color: Color) {
        let faces = ball_faces(middle_m, axes_m, |normal| lit(color, normal));
        self.faces.extend(faces);
    }

    /// Adds a transparent ball, scaled by a matrix, with the three great circles of its axes.
    pub fn transparent_ball(&mut self, middle_m: DVec3, axes_m: &DMat3, color: Color) {
        let [r, g, b, alpha] = color;
        self.transparent_faces.extend(ball_faces(middle_m, axes_m, |_| [r, g, b, 0.25 * alpha]));
        for axis in 0..3 {
            let (u, v) = (axes_m.col(axis), axes_m.col((axis + 1) % 3));
            self.polyline(circle(middle_m, u, v, 40), 1.2, color);
        }
    }
}

/// Points on an ellipse with these half axes. The first point is repeated at the end.
pub fn circle(middle_m: DVec3, u: DVec3, v: DVec3, segments: u32) -> impl Iterator<Item = DVec3> {
    (0..=segments).map(move |n| {
        let (sin, cos) = (f64::from(n) / f64::from(segments) * std::f64::consts::TAU).sin_cos();
        middle_m + u * cos + v * sin
    })
}

fn fan(into: &mut Vec<Face>, corners_m: &[DVec3], color: Color) {
    if corners_m.iter().all(|corner| corner.is_finite()) {
        let triangles = (2..corners_m.len()).map(|n| [corners_m[0], corners_m[n - 1], corners_m[n]]);
        into.extend(triangles.map(|corners_m| Face { corners_m, color }));
    }
}

fn lit([r, g, b, alpha]: Color, normal: DVec3) -> Color {
    let light = (0.62 + 0.38 * normal.normalize_or_zero().dot(LIGHT.normalize())) as f32;
    [r * light, g * light, b * light, alpha]
}

fn ball_faces(middle_m: DVec3, axes_m: &DMat3, color: impl Fn(DVec3) -> Color) -> Vec<Face> {
    let on_ball = |ring: u32, segment: u32| {
        let (sin, cos) = (f64::from(ring) / f64::from(RINGS) * std::f64::consts::PI).sin_cos();
        let (s, c) = (f64::from(segment) / f64::from(SEGMENTS) * std::f64::consts::TAU).sin_cos();
        DVec3::new(sin * c, cos, sin * s)
    };
    let mut faces = Vec::new();
    if !middle_m.is_finite() || !axes_m.is_finite() {
        return faces;
    }
    for (ring, segment) in (0..RINGS).flat_map(|ring| (0..SEGMENTS).map(move |segment| (ring, segment))) {
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(r, s)| on_ball(ring + r, segment + s));
        let normal = *axes_m * corners.iter().sum::<DVec3>();
        fan(&mut faces, &corners.map(|corner| middle_m + *axes_m * corner), color(normal));
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: Color = [1.0; 4];

    #[test]
    fn box_has_twelve_edges_and_twelve_triangles() {
        let bounds = Aabb { min: DVec3::ZERO, max: DVec3::new(1.0, 2.0, 3.0) };
        let mut drawing = Drawing::default();
        drawing.box_edges(&Pose::IDENTITY, &bounds, 1.0, WHITE);
        let length: f64 = drawing.lines.iter().map(|line| line.from_m.distance(line.to_m)).sum();
        assert_eq!((drawing.lines.len(), length), (12, 24.0));
        drawing.solid_box(&Pose::IDENTITY, &bounds, WHITE);
        let area = |f: &Face| {
            let [a, b, c] = f.corners_m;
            (b - a).cross(c - a).length() / 2.0
        };
        assert_eq!(drawing.faces.len(), 12);
        assert!((drawing.faces.iter().map(area).sum::<f64>() - 22.0).abs() < 1e-9);
    }

    #[test]
    fn ball_vertices_match_axes() {
        let axes = DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.3));
        let mut drawing = Drawing::default();
        drawing.solid_ball(DVec3::ONE, &axes, WHITE);
        drawing.transparent_ball(DVec3::ONE, &axes, WHITE);
        let on_ball = |point: DVec3| ((axes.inverse() * (point - DVec3::ONE)).length() - 1.0).abs() < 1e-9;
        assert!(drawing.faces.iter().chain(&drawing.transparent_faces).flat_map(|f| f.corners_m).all(on_ball));
        assert!(drawing.lines.iter().all(|line| on_ball(line.from_m) && on_ball(line.to_m)));
    }

    #[test]
    fn non_finite_positions_are_not_drawn() {
        let mut drawing = Drawing::default();
        drawing.line(DVec3::NAN, DVec3::ZERO, 1.0, WHITE);
        drawing.point(DVec3::splat(f64::INFINITY), 1.0, WHITE);
        drawing.transparent_polygon(&[DVec3::ZERO, DVec3::X, DVec3::NAN], WHITE);
        drawing.transparent_ball(DVec3::NAN, &DMat3::IDENTITY, WHITE);
        assert_eq!(drawing, Drawing::default());
    }
}
