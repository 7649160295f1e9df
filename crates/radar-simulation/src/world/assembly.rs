//! Puts objects together from boards, boxes and tubes, in their own frame: x to the right, +y up from
//! the floor, the front towards −z.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{DQuat, DVec3};

use radar_sar::geometry::Pose;

use super::material::Material;
use super::parts::{Corner, Edge, FloorEdge, InnerEdge, Panel, Parts, Tube};

/// Parts of an object that is being put together.
#[derive(Debug, Clone, Default)]
pub(crate) struct Assembly {
    pub parts: Parts,
}

impl Assembly {
    /// A thin board with four rounded edges, seen from both sides.
    pub fn board(&mut self, center_m: DVec3, half_u_m: DVec3, half_v_m: DVec3, material: Material) {
        self.sheet(center_m, half_u_m, half_v_m, material);
        for (outward, along) in
            [(half_u_m, half_v_m), (-half_u_m, half_v_m), (half_v_m, half_u_m), (-half_v_m, half_u_m)]
        {
            let middle = center_m + outward;
            let ends_m = [middle - along, middle + along];
            self.edge(ends_m, outward.normalize_or(DVec3::Y), FRAC_PI_2, material);
        }
    }

    /// A rectangle seen from both sides, without edges.
    pub fn sheet(&mut self, center_m: DVec3, half_u_m: DVec3, half_v_m: DVec3, material: Material) {
        self.parts.panels.push(Panel { center_m, half_u_m, half_v_m, material, two_sided: true });
    }

    /// A level board: centre, full width in x and depth in z.
    pub fn shelf_board(&mut self, center_m: DVec3, width_m: f64, depth_m: f64, material: Material) {
        self.board(center_m, DVec3::Z * (0.5 * depth_m), DVec3::X * (0.5 * width_m), material);
    }

    /// An upright board that faces ±z: centre, full width in x and height in y.
    pub fn upright_board(&mut self, center_m: DVec3, width_m: f64, height_m: f64, material: Material) {
        self.board(center_m, DVec3::Y * (0.5 * height_m), DVec3::X * (0.5 * width_m), material);
    }

    /// A closed box above the floor: six faces and twelve rounded edges.
    pub fn cuboid(&mut self, center_m: DVec3, size_m: DVec3, material: Material) {
        self.faces(center_m, 0.5 * size_m, material, false);
    }

    /// A closed box on the floor, its faces forming dihedrals with it. `center_m` is the middle of
    /// its underside.
    pub fn cuboid_on_floor(&mut self, center_m: DVec3, size_m: DVec3, material: Material) {
        let half_m = 0.5 * size_m;
        self.faces(center_m + DVec3::Y * half_m.y, half_m, material, true);
        for side in [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            let (foot, along) = (center_m + side * half_m, side.cross(DVec3::Y) * half_m);
            self.floor_edge([foot - along, foot + along], side, material);
        }
    }

    fn faces(&mut self, center_m: DVec3, half_m: DVec3, material: Material, on_floor: bool) {
        let hidden = |normal: DVec3| on_floor && normal.y < -0.5;
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        for n in 0..3 {
            let (u, v) = (axes[(n + 1) % 3] * half_m, axes[(n + 2) % 3] * half_m);
            for (normal, half_u_m, half_v_m) in [(axes[n], u, v), (-axes[n], v, u)] {
                if !hidden(normal) {
                    let center_m = center_m + normal * half_m;
                    self.parts.panels.push(Panel { center_m, half_u_m, half_v_m, material, two_sided: false });
                }
            }
            // The four edges along this axis.
            let along = axes[n] * half_m;
            for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let corner = a * axes[(n + 1) % 3] + b * axes[(n + 2) % 3];
                if !hidden(corner) {
                    let middle = center_m + corner * half_m;
                    self.edge([middle - along, middle + along], corner.normalize(), FRAC_PI_4, material);
                }
            }
        }
    }

    /// A rounded edge.
    pub fn edge(&mut self, ends_m: [DVec3; 2], outward: DVec3, half_angle_rad: f64, material: Material) {
        self.parts.edges.push(Edge { ends_m, outward, half_angle_rad, material });
    }

    /// A dihedral with the floor, at the foot of a face with this horizontal normal.
    pub fn floor_edge(&mut self, ends_m: [DVec3; 2], outward: DVec3, material: Material) {
        self.parts.floor_edges.push(FloorEdge { ends_m, outward, reflectivity: material.specular() });
    }

    /// The line in which two perpendicular faces of one material meet; `inward` lies between them.
    pub fn inner_edge(&mut self, ends_m: [DVec3; 2], inward: DVec3, material: Material) {
        let reflectivity = material.specular() * material.specular();
        self.parts.inner_edges.push(InnerEdge { ends_m, inward: inward.normalize_or(DVec3::Y), reflectivity });
    }

    /// A tube; where it stands on the floor, both form a dihedral by the floor's mirror image.
    pub fn tube(&mut self, from_m: DVec3, to_m: DVec3, radius_m: f64, material: Material) {
        self.parts.tubes.push(Tube { ends_m: [from_m, to_m], radius_m, material });
    }

    /// A bent tube through these points.
    pub fn bent_tube(&mut self, points_m: &[DVec3], radius_m: f64, material: Material) {
        points_m.windows(2).for_each(|pair| self.tube(pair[0], pair[1], radius_m, material));
    }

    /// A ring of upright or tilted panels: lampshades, pots, bins. Radii at the lower and upper rim.
    pub fn ring(&mut self, foot_m: DVec3, radii_m: [f64; 2], height_m: f64, sides: usize, material: Material) {
        for n in 0..sides {
            let turn = DQuat::from_rotation_y(std::f64::consts::TAU * n as f64 / sides as f64);
            let outward = turn * DVec3::X;
            let [low, high] = [foot_m + outward * radii_m[0], foot_m + outward * radii_m[1] + DVec3::Y * height_m];
            let half_width_m =
                0.5 * (radii_m[0] + radii_m[1]) * radar_sar::math::sin(std::f64::consts::PI / sides as f64);
            let half_up = 0.5 * (high - low);
            self.sheet(0.5 * (low + high), half_up, turn * DVec3::NEG_Z * -half_width_m, material);
        }
    }

    /// A small fitting that reflects alike to all sides.
    pub fn fitting(&mut self, position_m: DVec3, rcs_dbsm: f64) {
        self.parts.corners.push(Corner { position_m, lobe: DVec3::ZERO, rcs_dbsm });
    }

    /// A small fitting with a lobe.
    pub fn lobed_fitting(&mut self, position_m: DVec3, lobe: DVec3, rcs_dbsm: f64) {
        self.parts.corners.push(Corner { position_m, lobe: lobe.normalize_or(DVec3::Y), rcs_dbsm });
    }

    /// Adds another assembly, turned about an axis through the origin and then shifted.
    pub fn add(&mut self, other: Assembly, at_m: DVec3, turn: DQuat) {
        self.parts.append(other.parts.moved(&Pose::new(at_m, turn)));
    }
}

/// The four combinations of ±x and ±z at a height.
pub(crate) fn four_corners(half_x_m: f64, y_m: f64, half_z_m: f64) -> [DVec3; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| DVec3::new(x * half_x_m, y_m, z * half_z_m))
}

#[cfg(test)]
mod tests {
    use super::super::material::WOOD;
    use super::*;

    #[test]
    fn faces_and_edges_of_a_box_point_outwards() {
        let mut assembly = Assembly::default();
        let center = DVec3::new(0.3, 1.0, -0.2);
        assembly.cuboid(center, DVec3::new(0.4, 0.6, 0.2), WOOD);
        let Parts { panels, edges, .. } = &assembly.parts;
        assert_eq!((panels.len(), edges.len()), (6, 12));
        assert!(panels.iter().all(|p| p.normal().dot(p.center_m - center) > 0.09));
        assert!(edges.iter().all(|e| e.outward.dot(0.5 * (e.ends_m[0] + e.ends_m[1]) - center) > 0.1));
        let area: f64 = panels.iter().map(Panel::area_m2).sum();
        assert!((area - 2.0 * (0.24 + 0.08 + 0.12)).abs() < 1e-12);
    }

    #[test]
    fn box_on_the_floor_has_dihedrals_instead_of_lower_edges() {
        let mut assembly = Assembly::default();
        assembly.cuboid_on_floor(DVec3::ZERO, DVec3::splat(0.5), WOOD);
        let Parts { panels, edges, floor_edges, .. } = &assembly.parts;
        assert_eq!((panels.len(), edges.len(), floor_edges.len()), (5, 8, 4));
        assert!(panels.iter().all(|p| p.corners_m().iter().all(|c| c.y > -1e-12)));
        assert!(
            floor_edges.iter().all(|e| e.ends_m.iter().all(|end| end.dot(e.outward) > 0.24 && end.y.abs() < 1e-12))
        );
    }

    #[test]
    fn ring_faces_outwards_all_around() {
        let mut assembly = Assembly::default();
        assembly.ring(DVec3::Y, [0.2, 0.3], 0.3, 8, WOOD);
        for panel in &assembly.parts.panels {
            let level = DVec3::new(panel.center_m.x, 0.0, panel.center_m.z);
            assert!(panel.normal().dot(level).abs() > 0.9 * 0.25, "{panel:?}");
            assert!(panel.half_u_m.dot(panel.half_v_m).abs() < 1e-12);
        }
    }

    #[test]
    fn points_on_a_board_are_no_further_apart_than_stated() {
        let mut assembly = Assembly::default();
        assembly.shelf_board(DVec3::Y, 0.83, 0.31, WOOD);
        let points = assembly.parts.surface_points();
        for n in 0..100 {
            let at = DVec3::new(f64::from(n % 10) * 0.083 - 0.4, 1.0, f64::from(n / 10) * 0.031 - 0.15);
            let nearest = points.iter().map(|p| p.distance(at)).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.036, "{nearest}");
        }
    }
}
