//! Images of the fake runtime, and positions of the room's objects in them.

use std::path::Path;

use glam::{DQuat, DVec2, DVec3};
use image::RgbaImage;
use serde_json::Value;

/// Brightness above the fake runtime's background from which a pixel counts as lit, of 255.
const LIT: i32 = 24;

pub struct Eye {
    position: DVec3,
    turn: DQuat,
    /// Tangents of the left, right, lower and upper edge.
    edges: [f64; 4],
    picture: RgbaImage,
}

impl Eye {
    /// Left and right eye of a shot.
    pub fn both(folder: &Path, name: &Path, shot: &Value) -> [Self; 2] {
        ["left", "right"].map(|side| Self::of(folder, &name.to_string_lossy(), side, &shot[side]))
    }

    fn of(folder: &Path, name: &str, side: &str, eye: &Value) -> Self {
        let number = |value: &Value| value.as_f64().unwrap();
        let pose = &eye["tracking_from_eye"];
        let [x, y, z] = [0, 1, 2].map(|i| number(&pose["position_m"][i]));
        let [qx, qy, qz, qw] = [0, 1, 2, 3].map(|i| number(&pose["quaternion_xyzw"][i]));
        let edges = ["left", "right", "down", "up"].map(|edge| number(&eye["tangents"][edge]));
        let picture = image::open(folder.join(format!("{name}_{side}.png"))).unwrap().to_rgba8();
        Self { position: DVec3::new(x, y, z), turn: DQuat::from_xyzw(qx, qy, qz, qw).normalize(), edges, picture }
    }

    /// Tangents right and up of a point; `None` behind the eye.
    fn tangents(&self, position: DVec3) -> Option<DVec2> {
        let seen = self.turn.conjugate() * (position - self.position);
        (seen.z < -0.01).then(|| DVec2::new(seen.x / -seen.z, seen.y / -seen.z))
    }

    /// Direction of a pixel's centre.
    fn direction_of(&self, x: u32, y: u32) -> DVec3 {
        let [left, right, lower, upper] = self.edges;
        let share = |at: u32, of: u32| (f64::from(at) + 0.5) / f64::from(of);
        let right = left + (right - left) * share(x, self.picture.width());
        let up = upper - (upper - lower) * share(y, self.picture.height());
        DVec3::new(right, up, -1.0).normalize()
    }

    /// Direction of a point.
    pub fn direction(&self, position: DVec3) -> Option<DVec3> {
        self.tangents(position).map(|t| DVec3::new(t.x, t.y, -1.0).normalize())
    }

    /// Mean angle to the right of these directions, weighted by brightness.
    pub fn mean_right_rad(&self, lit: &[(DVec3, i32)]) -> f64 {
        let sum: DVec3 = lit.iter().map(|(at, weight)| *at * f64::from(*weight)).sum();
        sum.x.atan2(-sum.z)
    }

    /// Largest red and green of any pixel.
    pub fn brightest_red_and_green(&self) -> [u8; 2] {
        [0, 1].map(|channel| self.picture.pixels().map(|pixel| pixel[channel]).max().unwrap_or(0))
    }

    /// Direction and brightness above the background of each lit pixel.
    pub fn lit(&self) -> Vec<(DVec3, i32)> {
        let background = *self.picture.get_pixel(0, 0);
        let over =
            |pixel: &image::Rgba<u8>| (0..3).map(|c| i32::from(pixel[c]) - i32::from(background[c])).max().unwrap_or(0);
        let pixels = self.picture.enumerate_pixels().map(|(x, y, pixel)| (x, y, over(pixel)));
        pixels.filter(|(.., over)| *over > LIT).map(|(x, y, over)| (self.direction_of(x, y), over)).collect()
    }
}

/// Disparity of a point: how much further right the left eye sees it than the right eye.
pub fn disparity_rad(left: &Eye, right: &Eye, position: DVec3) -> f64 {
    let right_rad = |eye: &Eye| eye.tangents(position).map_or(f64::NAN, |t| t.x.atan());
    right_rad(left) - right_rad(right)
}
