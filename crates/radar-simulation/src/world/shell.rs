//! A room's shell: walls with openings, floor, ceiling, pillars, and the right angles between them.

use std::f64::consts::FRAC_PI_4;

use glam::{DVec2, DVec3};

use radar_sar::geometry::{Aabb, Plane};

use super::floor_plan::{Ceiling, FloorPlan, Rectangle, WallLine};
use super::material::{GLASS, Material};
use super::parts::{Edge, InnerEdge, Panel, Parts};

/// Materials of a room's shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Finish {
    pub wall: Material,
    pub floor: Material,
    pub ceiling: Material,
    pub door: Material,
}

/// What fills an opening.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum OpeningKind {
    Door,
    Window,
}

/// An opening in a wall, from one place along it to another and between two heights, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Opening {
    pub kind: OpeningKind,
    pub wall: usize,
    pub along_m: [f64; 2],
    pub heights_m: [f64; 2],
}

/// A wall, floor, ceiling or pillar side, for the truth.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WorldWall {
    pub name: String,
    /// Its normal points out of the room.
    pub plane: Plane,
    /// A flat box around it; of a sloping ceiling, a box that it runs through.
    pub extent: Aabb,
}

/// A room's shell.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Shell {
    /// Panels that face the room, and its inner edges.
    pub parts: Parts,
    pub walls: Vec<WorldWall>,
}

/// Door leaves and panes stand this far behind the wall's surface, metres. Choice: a usual reveal.
const DOOR_REVEAL_M: f64 = 0.03;
const WINDOW_REVEAL_M: f64 = 0.10;

impl Shell {
    pub fn new(plan: &FloorPlan, finish: &Finish, openings: &[Opening]) -> Self {
        let mut shell = Self::default();
        for (n, wall) in plan.walls().iter().enumerate() {
            let opening = openings.iter().find(|opening| opening.wall == n);
            shell.add_wall(&format!("wall {n}"), plan, wall, finish, opening);
        }
        for (n, side) in plan.pillar_sides().iter().enumerate() {
            shell.add_wall(&format!("pillar {n}"), plan, side, finish, None);
        }
        for (n, rectangle) in plan.rectangles.iter().enumerate() {
            shell.add_floor_and_ceiling(n, plan, rectangle, finish);
        }
        shell.add_wall_corners(plan, finish.wall);
        shell
    }

    fn add_panel(&mut self, center_m: DVec3, half_u_m: DVec3, half_v_m: DVec3, material: Material) {
        self.parts.panels.push(Panel { center_m, half_u_m, half_v_m, material, two_sided: false });
    }

    fn add_truth(&mut self, name: String, panel: &Panel) {
        let outward = -panel.normal();
        let plane = Plane { outward, offset_m: outward.dot(panel.center_m) };
        if let Some(extent) = Aabb::around(panel.corners_m()) {
            self.walls.push(WorldWall { name, plane, extent });
        }
    }

    fn add_wall(&mut self, name: &str, plan: &FloorPlan, wall: &WallLine, finish: &Finish, opening: Option<&Opening>) {
        let middle = 0.5 * (wall.from + wall.to) - wall.inward() * 1e-3;
        // A wall under a slope ends where the ceiling meets it.
        let is_knee = wall.inward().x < -0.5 && plan.ceiling != Ceiling::Flat;
        let height_m = if is_knee { plan.ceiling_m(middle.x) } else { plan.height_m };
        let length_m = wall.length_m();
        let piece = |along_m: [f64; 2], heights_m: [f64; 2], behind_m: f64, material: Material| {
            let at = wall.from + wall.along() * (0.5 * (along_m[0] + along_m[1])) - wall.inward() * behind_m;
            let along = wall.along() * (0.5 * (along_m[1] - along_m[0]));
            Panel {
                center_m: DVec3::new(at.x, 0.5 * (heights_m[0] + heights_m[1]), at.y),
                half_u_m: DVec3::new(along.x, 0.0, along.y),
                half_v_m: DVec3::Y * (0.5 * (heights_m[1] - heights_m[0])),
                material,
                two_sided: false,
            }
        };
        self.add_truth(name.into(), &piece([0.0, length_m], [0.0, height_m], 0.0, finish.wall));
        let whole = [0.0, length_m];
        let Some(&Opening { kind, along_m: [a, b], heights_m: [low, high], .. }) = opening else {
            self.parts.panels.push(piece(whole, [0.0, height_m], 0.0, finish.wall));
            self.add_foot(wall, whole, finish);
            return;
        };
        let (behind_m, fill) = match kind {
            OpeningKind::Door => (DOOR_REVEAL_M, finish.door),
            OpeningKind::Window => (WINDOW_REVEAL_M, GLASS),
        };
        self.parts.panels.extend([
            piece([0.0, a], [0.0, height_m], 0.0, finish.wall),
            piece([b, length_m], [0.0, height_m], 0.0, finish.wall),
            piece([a, b], [high, height_m], 0.0, finish.wall),
            piece([a, b], [low, high], behind_m, fill),
        ]);
        if low > 0.0 {
            self.parts.panels.push(piece([a, b], [0.0, low], 0.0, finish.wall));
            self.add_foot(wall, whole, finish);
        } else {
            self.add_foot(wall, [0.0, a], finish);
            self.add_foot(wall, [b, length_m], finish);
        }
    }

    /// The right angle between a wall and the floor.
    fn add_foot(&mut self, wall: &WallLine, along_m: [f64; 2], finish: &Finish) {
        let level = |at: DVec2| DVec3::new(at.x, 0.0, at.y);
        let ends_m = along_m.map(|m| level(wall.from + wall.along() * m));
        let inward = (level(wall.inward()) + DVec3::Y).normalize();
        let reflectivity = finish.wall.specular() * finish.floor.specular();
        self.parts.inner_edges.push(InnerEdge { ends_m, inward, reflectivity });
    }

    fn add_floor_and_ceiling(&mut self, n: usize, plan: &FloorPlan, rectangle: &Rectangle, finish: &Finish) {
        let (half, center) = (0.5 * rectangle.size(), rectangle.center());
        let at = |x: f64, y: f64| DVec3::new(x, y, center.y);
        let (half_x, half_z) = (DVec3::X * half.x, DVec3::Z * half.y);
        self.add_panel(at(center.x, 0.0), half_z, half_x, finish.floor);
        self.truth_of_last(format!("floor {n}"));
        let Ceiling::Sloping { knee_m, run_m } = plan.ceiling else {
            self.add_panel(at(center.x, plan.height_m), half_x, half_z, finish.ceiling);
            self.truth_of_last(format!("ceiling {n}"));
            return;
        };
        let half_flat = 0.5 * (rectangle.size().x - run_m);
        let flat = at(rectangle.min.x + half_flat, plan.height_m);
        self.add_panel(flat, DVec3::X * half_flat, half_z, finish.ceiling);
        self.truth_of_last(format!("ceiling {n}"));
        let up = DVec3::new(-run_m, plan.height_m - knee_m, 0.0) * 0.5;
        let slope = at(rectangle.max.x, knee_m) + up;
        self.add_panel(slope, half_z, up, finish.ceiling);
        self.truth_of_last("slope".into());
    }

    fn truth_of_last(&mut self, name: String) {
        if let Some(panel) = self.parts.panels.last().copied() {
            self.add_truth(name, &panel);
        }
    }

    /// Upright corners: right angles inside the room, rounded edges at pillars and where a wing begins.
    fn add_wall_corners(&mut self, plan: &FloorPlan, material: Material) {
        let upright = |at: DVec2| [DVec3::new(at.x, 0.0, at.y), DVec3::new(at.x, plan.ceiling_m(at.x), at.y)];
        let between = |a: DVec2, b: DVec2| DVec3::new(a.x + b.x, 0.0, a.y + b.y).normalize();
        let edge =
            |at: DVec2, outward: DVec3| Edge { ends_m: upright(at), outward, half_angle_rad: FRAC_PI_4, material };
        let walls = plan.walls();
        for (n, wall) in walls.iter().enumerate() {
            let next = &walls[(n + 1) % walls.len()];
            let inward = between(wall.inward(), next.inward());
            if wall.along().perp_dot(next.along()) > 0.0 {
                let reflectivity = material.specular() * material.specular();
                self.parts.inner_edges.push(InnerEdge { ends_m: upright(wall.to), inward, reflectivity });
            } else {
                self.parts.edges.push(edge(wall.to, inward));
            }
        }
        for pillar in plan.pillar_sides().chunks(4) {
            let sides = (0..pillar.len()).map(|n| (&pillar[n], &pillar[(n + 1) % pillar.len()]));
            self.parts.edges.extend(sides.map(|(a, b)| edge(a.from, between(a.inward(), b.inward()))));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::floor_plan::RoomShape;
    use super::super::material::{PLASTER, WOOD};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const FINISH: Finish = Finish { wall: PLASTER, floor: WOOD, ceiling: PLASTER, door: WOOD };

    fn plan(shape: RoomShape) -> FloorPlan {
        FloorPlan::new(shape, [4.0, 4.6], 2.5, &mut ChaCha8Rng::seed_from_u64(3))
    }

    #[test]
    fn all_surfaces_face_the_room() {
        for shape in RoomShape::ALL {
            let plan = plan(shape);
            let shell = Shell::new(&plan, &FINISH, &[]);
            for panel in &shell.parts.panels {
                let at = panel.center_m + panel.normal() * 0.03;
                assert!(plan.clearance_m(at) > 0.0 && at.y > 0.0 && at.y < plan.ceiling_m(at.x), "{shape:?} {panel:?}");
            }
            for edge in &shell.parts.inner_edges {
                let at = 0.5 * (edge.ends_m[0] + edge.ends_m[1]) + edge.inward * 0.03;
                assert!(plan.clearance_m(at) > 0.0, "{shape:?} {edge:?}");
            }
            for edge in &shell.parts.edges {
                let at = 0.5 * (edge.ends_m[0] + edge.ends_m[1]);
                assert!(plan.clearance_m(at + edge.outward * 0.03) > 0.0, "{shape:?} {edge:?}");
                assert!(plan.clearance_m(at - edge.outward * 0.03) < 0.0, "{shape:?} {edge:?}");
            }
            assert!(shell.walls.iter().all(|wall| wall.plane.distance(DVec3::Y) > 0.0
                || wall.name.contains("pillar")
                || shape == RoomShape::LShape));
        }
    }

    #[test]
    fn pieces_around_an_opening_cover_the_wall() {
        let plan = plan(RoomShape::Rectangle);
        let opening = Opening { kind: OpeningKind::Window, wall: 0, along_m: [1.0, 2.2], heights_m: [0.9, 2.1] };
        let area = |openings: &[Opening]| {
            let panels = Shell::new(&plan, &FINISH, openings).parts.panels;
            panels.iter().filter(|p| p.normal().z > 0.9).map(Panel::area_m2).sum::<f64>()
        };
        assert!((area(&[opening]) - area(&[])).abs() < 1e-9 && area(&[]) > 9.0);
    }
}
