//! Floor plan of a room: rectangles that together form it, its outline, pillars.

use glam::{DVec2, DVec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A rectangle along the axes, in x and z, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rectangle {
    pub min: DVec2,
    pub max: DVec2,
}

impl Rectangle {
    pub fn size(&self) -> DVec2 {
        self.max - self.min
    }

    pub fn center(&self) -> DVec2 {
        0.5 * (self.min + self.max)
    }

    fn corners(&self) -> [DVec2; 4] {
        [self.min, DVec2::new(self.max.x, self.min.y), self.max, DVec2::new(self.min.x, self.max.y)]
    }
}

/// A wall of the outline; the room lies on the side of [`WallLine::inward`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallLine {
    pub from: DVec2,
    pub to: DVec2,
}

impl WallLine {
    pub fn length_m(&self) -> f64 {
        self.from.distance(self.to)
    }

    /// Unit vector along it.
    pub fn along(&self) -> DVec2 {
        (self.to - self.from).normalize_or(DVec2::X)
    }

    /// Unit normal into the room.
    pub fn inward(&self) -> DVec2 {
        let along = self.along();
        DVec2::new(-along.y, along.x)
    }
}

/// How the ceiling runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Ceiling {
    Flat,
    /// It slopes down to the wall at the greatest x: height at that wall, and how far inside it begins, metres.
    Sloping {
        knee_m: f64,
        run_m: f64,
    },
}

/// A room's floor plan and heights. The play area's centre is the origin.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FloorPlan {
    /// Rectangles without overlap; the first one holds the play area.
    pub rectangles: Vec<Rectangle>,
    /// Corners of the outline, from the least x and z along +x.
    pub outline: Vec<DVec2>,
    /// Square pillars.
    pub pillars: Vec<Rectangle>,
    pub height_m: f64,
    pub ceiling: Ceiling,
}

/// Shapes of rooms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RoomShape {
    Rectangle,
    LShape,
    Pillar,
    SlopingCeiling,
}

impl RoomShape {
    pub const ALL: [Self; 4] = [Self::Rectangle, Self::LShape, Self::Pillar, Self::SlopingCeiling];
}

impl FloorPlan {
    /// A room of about the given width in x and depth in z, metres.
    pub fn new(shape: RoomShape, [width_m, depth_m]: [f64; 2], height_m: f64, rng: &mut ChaCha8Rng) -> Self {
        let off = DVec2::new(rng.random_range(-0.15..0.15), rng.random_range(-0.15..0.15));
        let half = 0.5 * DVec2::new(width_m, depth_m);
        let main = Rectangle { min: off - half, max: off + half };
        let mut plan = Self {
            rectangles: vec![main],
            outline: main.corners().to_vec(),
            pillars: Vec::new(),
            height_m,
            ceiling: Ceiling::Flat,
        };
        match shape {
            RoomShape::Rectangle => {}
            RoomShape::LShape => plan.add_wing(rng),
            RoomShape::Pillar => plan.add_pillar(rng),
            RoomShape::SlopingCeiling => {
                plan.ceiling =
                    Ceiling::Sloping { knee_m: rng.random_range(1.2..1.7), run_m: rng.random_range(0.9..1.4) };
            }
        }
        plan
    }

    /// A wing beyond the wall at the greatest x, along part of it.
    fn add_wing(&mut self, rng: &mut ChaCha8Rng) {
        let main = self.rectangles[0];
        let (deep, wide) = (rng.random_range(1.4..2.4), rng.random_range(0.4..0.6) * main.size().y);
        let wing = Rectangle { min: DVec2::new(main.max.x, main.max.y - wide), max: main.max + DVec2::X * deep };
        let [a, b, _, d] = main.corners();
        self.outline = vec![a, b, DVec2::new(b.x, wing.min.y), DVec2::new(wing.max.x, wing.min.y), wing.max, d];
        self.rectangles.push(wing);
    }

    /// A pillar beside the play area, or before a wall.
    fn add_pillar(&mut self, rng: &mut ChaCha8Rng) {
        let main = self.rectangles[0];
        let half = 0.5 * rng.random_range(0.25..0.42);
        let side = if rng.random_range(0.0..1.0) < 0.5 { 1.0 } else { -1.0 };
        let x = rng.random_range(1.25..0.5 * main.size().x - half - 0.05);
        let z = rng.random_range(-0.9..0.9);
        let center = DVec2::new(main.center().x + side * x, z);
        self.pillars.push(Rectangle { min: center - half, max: center + half });
    }

    /// Walls of the outline.
    pub fn walls(&self) -> Vec<WallLine> {
        let next = self.outline.iter().cycle().skip(1);
        self.outline.iter().zip(next).map(|(&from, &to)| WallLine { from, to }).collect()
    }

    /// Sides of the pillars, seen from the room.
    pub fn pillar_sides(&self) -> Vec<WallLine> {
        let sides = self.pillars.iter().flat_map(|pillar| {
            let corners = pillar.corners();
            [0, 1, 2, 3].map(|n| WallLine { from: corners[(n + 1) % 4], to: corners[n] })
        });
        sides.collect()
    }

    /// Distance of a point of the floor from the nearest wall or pillar, metres; negative outside the room and inside
    /// pillars. `point.y` is ignored.
    pub fn clearance_m(&self, point: DVec3) -> f64 {
        let at = DVec2::new(point.x, point.z);
        let sides = self.walls().into_iter().chain(self.pillar_sides());
        let nearest_m = sides.map(|side| distance_m(at, &side)).fold(f64::INFINITY, f64::min);
        let within = |rectangle: &Rectangle| at.cmpge(rectangle.min).all() && at.cmple(rectangle.max).all();
        let inside = self.rectangles.iter().any(within) && !self.pillars.iter().any(within);
        if inside { nearest_m } else { -nearest_m }
    }

    /// Height of the ceiling above a point, metres.
    pub fn ceiling_m(&self, x_m: f64) -> f64 {
        match self.ceiling {
            Ceiling::Flat => self.height_m,
            Ceiling::Sloping { knee_m, run_m } => {
                let inside_m = self.rectangles[0].max.x - x_m;
                self.height_m.min(knee_m + (self.height_m - knee_m) * inside_m / run_m)
            }
        }
    }
}

fn distance_m(at: DVec2, side: &WallLine) -> f64 {
    let along = (at - side.from).dot(side.along()).clamp(0.0, side.length_m());
    at.distance(side.from + side.along() * along)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn walls_face_inwards_and_clearance_is_signed() {
        for shape in RoomShape::ALL {
            for seed in 0..10 {
                let plan = FloorPlan::new(shape, [4.2, 4.8], 2.5, &mut ChaCha8Rng::seed_from_u64(seed));
                for wall in plan.walls().iter().chain(&plan.pillar_sides()) {
                    let middle = 0.5 * (wall.from + wall.to);
                    let [inside, outside] = [0.02, -0.02].map(|m| middle + wall.inward() * m);
                    assert!(plan.clearance_m(DVec3::new(inside.x, 1.0, inside.y)) > 0.0, "{shape:?} {wall:?}");
                    assert!(plan.clearance_m(DVec3::new(outside.x, 1.0, outside.y)) < 0.0, "{shape:?} {wall:?}");
                }
                assert!(plan.clearance_m(DVec3::ZERO) > 0.8, "{shape:?}");
            }
        }
    }

    #[test]
    fn wing_opens_the_wall_that_it_adjoins() {
        let plan = FloorPlan::new(RoomShape::LShape, [4.0, 4.0], 2.5, &mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!((plan.walls().len(), plan.rectangles.len()), (6, 2));
        let door = plan.rectangles[1].center() - DVec2::X * 0.5 * plan.rectangles[1].size().x;
        assert!(plan.clearance_m(DVec3::new(door.x - 0.01, 0.0, door.y)) > 0.5);
    }

    #[test]
    fn sloping_ceiling_is_low_at_its_wall() {
        let plan = FloorPlan::new(RoomShape::SlopingCeiling, [4.0, 4.0], 2.5, &mut ChaCha8Rng::seed_from_u64(1));
        assert!(plan.ceiling_m(plan.rectangles[0].max.x) < 1.7 && plan.ceiling_m(0.0) == 2.5);
    }
}
