//! Geometric parts that objects and rooms consist of, without any electromagnetics.

use glam::DVec3;

use radar_sar::geometry::Pose;

use super::material::Material;

/// Largest distance between points on a surface that represent it in the truth, metres. Choice: well
/// below the errors that are measured against them.
pub(crate) const SURFACE_SPACING_M: f64 = 0.05;

/// A flat rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Panel {
    /// Its centre, metres.
    pub center_m: DVec3,
    /// From the centre to the middle of one side, metres; the front's normal is u × v.
    pub half_u_m: DVec3,
    /// From the centre to the middle of the neighbouring side, perpendicular to the other, metres.
    pub half_v_m: DVec3,
    /// Its material.
    pub material: Material,
    /// Whether its back reflects as well; the back of a box's face never shows.
    pub two_sided: bool,
}

/// A rounded convex edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Edge {
    /// Its ends, metres.
    pub ends_m: [DVec3; 2],
    /// Unit vector in the middle between the normals of its two faces.
    pub outward: DVec3,
    /// Half the angle between the normals of its two faces, rad: 45° for a box, 90° for a board.
    pub half_angle_rad: f64,
    /// Its material, which gives its radius.
    pub material: Material,
}

/// A round tube, pole, rail or cable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tube {
    /// Its ends, metres.
    pub ends_m: [DVec3; 2],
    /// Its radius, metres.
    pub radius_m: f64,
    /// Its material.
    pub material: Material,
}

/// A small fitting: screw, castor, hook, handle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    /// Its position, metres.
    pub position_m: DVec3,
    /// Unit vector to where it reflects best; zero for all directions alike.
    pub lobe: DVec3,
    /// Radar cross-section at the lobe's centre, dBsm.
    pub rcs_dbsm: f64,
}

/// The line in which two perpendicular faces meet, seen from inside the right angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InnerEdge {
    /// Its ends, metres.
    pub ends_m: [DVec3; 2],
    /// Unit vector into the middle of the right angle.
    pub inward: DVec3,
    /// Product of the two faces' specular reflectivities.
    pub reflectivity: f64,
}

/// The foot of an upright face that stands on the floor; the floor's material is the room's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FloorEdge {
    /// Its ends, metres.
    pub ends_m: [DVec3; 2],
    /// The face's normal, horizontal.
    pub outward: DVec3,
    /// Specular reflectivity of the face.
    pub reflectivity: f64,
}

/// Parts by kind.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Parts {
    pub panels: Vec<Panel>,
    pub edges: Vec<Edge>,
    pub tubes: Vec<Tube>,
    pub corners: Vec<Corner>,
    pub inner_edges: Vec<InnerEdge>,
    pub floor_edges: Vec<FloorEdge>,
}

impl Panel {
    /// Unit normal of the front.
    pub fn normal(&self) -> DVec3 {
        self.half_u_m.cross(self.half_v_m).normalize_or(DVec3::Y)
    }

    /// Its area, m².
    pub fn area_m2(&self) -> f64 {
        4.0 * self.half_u_m.length() * self.half_v_m.length()
    }

    /// Its corners, in order around it.
    pub fn corners_m(&self) -> [DVec3; 4] {
        let (u, v) = (self.half_u_m, self.half_v_m);
        [-u - v, u - v, u + v, v - u].map(|offset| self.center_m + offset)
    }

    /// Distance from a point to the rectangle, metres.
    fn distance_m(&self, point: DVec3) -> f64 {
        let off_m = point - self.center_m;
        let along = |half: DVec3| half * (off_m.dot(half) / half.length_squared().max(1e-12)).clamp(-1.0, 1.0);
        (off_m - along(self.half_u_m) - along(self.half_v_m)).length()
    }

    fn moved(&self, to_from: &Pose) -> Self {
        Self {
            center_m: to_from.transform_point(self.center_m),
            half_u_m: to_from.transform_vector(self.half_u_m),
            half_v_m: to_from.transform_vector(self.half_v_m),
            ..*self
        }
    }

    fn surface_points(&self, points: &mut Vec<DVec3>) {
        let steps = |half: DVec3| (2.0 * half.length() / SURFACE_SPACING_M).ceil().max(1.0) as usize;
        let (across, along) = (steps(self.half_u_m), steps(self.half_v_m));
        for i in 0..=across {
            for j in 0..=along {
                let [u, v] = [(i, across), (j, along)].map(|(n, of)| 2.0 * n as f64 / of as f64 - 1.0);
                points.push(self.center_m + self.half_u_m * u + self.half_v_m * v);
            }
        }
    }
}

impl Tube {
    /// From the first end to the second one, unit length.
    pub fn axis(&self) -> DVec3 {
        (self.ends_m[1] - self.ends_m[0]).normalize_or(DVec3::Y)
    }

    /// Distance from a point to the surface, metres; 0 inside.
    fn distance_m(&self, point: DVec3) -> f64 {
        let [from, to] = self.ends_m;
        let share = (point - from).dot(to - from) / from.distance_squared(to).max(1e-12);
        (point.distance(from.lerp(to, share.clamp(0.0, 1.0))) - self.radius_m).max(0.0)
    }

    fn surface_points(&self, points: &mut Vec<DVec3>) {
        let [from, to] = self.ends_m;
        let steps = (from.distance(to) / SURFACE_SPACING_M).ceil().max(1.0) as usize;
        points.extend((0..=steps).map(|n| from.lerp(to, n as f64 / steps as f64)));
    }
}

impl Parts {
    /// Distance from a point to the nearest surface, metres. Edges and what stands on the floor bound panels, so they
    /// add nothing.
    pub fn distance_m(&self, point: DVec3) -> f64 {
        let panels = self.panels.iter().map(|panel| panel.distance_m(point));
        let tubes = self.tubes.iter().map(|tube| tube.distance_m(point));
        let fittings = self.corners.iter().map(|fitting| fitting.position_m.distance(point));
        panels.chain(tubes).chain(fittings).fold(f64::INFINITY, f64::min)
    }

    /// The same parts in another frame.
    pub fn moved(&self, to_from: &Pose) -> Self {
        let ends = |ends: [DVec3; 2]| ends.map(|end| to_from.transform_point(end));
        let turned = |vector: DVec3| to_from.transform_vector(vector);
        let mut parts = self.clone();
        parts.panels.iter_mut().for_each(|p| *p = p.moved(to_from));
        parts.tubes.iter_mut().for_each(|t| t.ends_m = ends(t.ends_m));
        for edge in &mut parts.edges {
            (edge.ends_m, edge.outward) = (ends(edge.ends_m), turned(edge.outward));
        }
        for corner in &mut parts.corners {
            (corner.position_m, corner.lobe) = (to_from.transform_point(corner.position_m), turned(corner.lobe));
        }
        for edge in &mut parts.inner_edges {
            (edge.ends_m, edge.inward) = (ends(edge.ends_m), turned(edge.inward));
        }
        for edge in &mut parts.floor_edges {
            (edge.ends_m, edge.outward) = (ends(edge.ends_m), turned(edge.outward));
        }
        parts
    }

    /// Adds other parts of the same frame.
    pub fn append(&mut self, other: Self) {
        self.panels.extend(other.panels);
        self.edges.extend(other.edges);
        self.tubes.extend(other.tubes);
        self.corners.extend(other.corners);
        self.inner_edges.extend(other.inner_edges);
        self.floor_edges.extend(other.floor_edges);
    }

    /// Points on all surfaces, at most [`SURFACE_SPACING_M`] apart along them.
    pub fn surface_points(&self) -> Vec<DVec3> {
        let mut points = Vec::new();
        self.panels.iter().for_each(|panel| panel.surface_points(&mut points));
        self.tubes.iter().for_each(|tube| tube.surface_points(&mut points));
        points.extend(self.corners.iter().map(|corner| corner.position_m));
        points
    }
}
