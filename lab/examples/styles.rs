//! The four warning styles side by side, as one eye sees them over a dark and over a bright,
//! detailed game picture.
//!
//!     cargo run --release -p lab --example styles -- FILE.png

use anyhow::{Context, Result, anyhow};
use glam::{DMat3, DQuat, DVec2, DVec3};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use radar_chaperone::render::{EyeView, Renderer, StereoScene};
use radar_chaperone::warning::{Style, WarningSettings, WarningTracker, Warnings, Wearer};
use radar_mapping::{Observed, Obstacle, Scene, Wall};
use radar_sar::geometry::{Aabb, Plane, Pose};

/// Size of one eye's picture, pixels. Choice: four styles fit a page's width.
const WIDTH: u32 = 340;
const HEIGHT: u32 = 360;
/// Gap between pictures, and height of the style names above them, pixels. Choice: one line of
/// text.
const GAP: u32 = 6;
const HEAD: u32 = 34;

/// Seat, back and legs as boxes: minimum and maximum corner, metres; origin on the floor below the
/// chair's centre.
const CHAIR: [([f64; 3], [f64; 3]); 6] = [
    ([-0.23, 0.42, -0.23], [0.23, 0.47, 0.23]),
    ([-0.23, 0.47, -0.23], [0.23, 0.95, -0.18]),
    ([-0.23, 0.0, -0.23], [-0.18, 0.42, -0.18]),
    ([0.18, 0.0, -0.23], [0.23, 0.42, -0.18]),
    ([-0.23, 0.0, 0.18], [-0.18, 0.42, 0.23]),
    ([0.18, 0.0, 0.18], [0.23, 0.42, 0.23]),
];

/// The chair's voxels of 5 cm.
fn chair(tracking_from_chair: Pose) -> Vec<(DVec3, f32)> {
    let mut cells = std::collections::BTreeSet::new();
    for (least, greatest) in CHAIR {
        let steps = ((DVec3::from(greatest) - DVec3::from(least)) / 0.02).ceil();
        for n in 0..(steps.element_product() as u64) {
            let (nx, ny) = (steps.x as u64, steps.y as u64);
            let cell = DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / (nx * ny)) as f64);
            let point = tracking_from_chair.transform_point(DVec3::from(least) + (cell + 0.5) * 0.02);
            cells.insert((point / 0.05).floor().to_array().map(|v| v as i64));
        }
    }
    cells.into_iter().map(|cell| ((DVec3::from_array(cell.map(|v| v as f64)) + 0.5) * 0.05, 1.0)).collect()
}

fn scene() -> Scene {
    let tracking_from_chair = Pose::new(DVec3::new(-0.12, 0.0, -1.35), DQuat::from_rotation_y(0.5));
    let chair = Obstacle {
        id: 1,
        position_m: tracking_from_chair.transform_point(DVec3::new(0.0, 0.5, 0.0)),
        covariance_m2: DMat3::from_diagonal(DVec3::splat(1e-4)),
        observed: Observed::Position,
        extent_m: DVec3::new(0.46, 0.95, 0.46),
        evidence: 20.0,
        shape: chair(tracking_from_chair),
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    let wall = Wall {
        id: 2,
        plane: Plane { outward: DVec3::new(0.94, 0.0, -0.342), offset_m: 1.15 },
        evidence: 9.0,
        seen_at: Aabb::from_corners(DVec3::new(0.2, 1.5, -1.5), DVec3::new(1.5, 1.7, 1.0)),
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    Scene { time_ns: 0, obstacles: vec![chair], walls: vec![wall], moving: vec![] }
}

/// The warnings after the head has stayed there for half a second, when they have faded in.
fn settled_warnings(head: Pose, settings: &WarningSettings) -> Warnings {
    let mut tracker = WarningTracker::new();
    tracker.update(&scene());
    let warn = |step: i64| tracker.warn(&Wearer::head_only(step * 10_000_000, head), settings);
    (0..50).map(warn).last().unwrap_or_default()
}

fn to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn to_srgb(v: f64) -> u8 {
    let v = v.clamp(0.0, 1.0);
    (if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 } * 255.0).round() as u8
}

/// A cave at night, or a meadow of light and hard shadows: linear red, green and blue in a
/// direction from a head at 1.65 m.
fn game(is_bright: bool, toward: DVec3) -> [f64; 3] {
    let hash = |n: DVec2| ((n.x * 127.1 + n.y * 311.7).sin() * 43_758.545).fract().abs();
    let floor = DVec2::new(toward.x, toward.z) * (1.65 / -toward.y.min(-1e-3));
    // Tiles, which blur with distance.
    let tile = 0.5 + (hash((floor * 2.0).floor()) - 0.5) * (1.0 - (floor.length() - 1.5) / 2.0).clamp(0.0, 1.0);
    if !is_bright {
        let torch = (-toward.distance_squared(DVec3::new(0.5, 0.05, -0.86)) / 0.05).exp();
        let stone = if toward.y < 0.0 { 0.004 + 0.008 * tile } else { 0.003 };
        return [stone + 0.25 * torch, stone + 0.11 * torch, stone * 1.2 + 0.03 * torch];
    }
    if toward.y < 0.0 {
        let light = 0.35 + 0.6 * tile;
        return [0.75 * light, 0.85 * light, 0.35 * light];
    }
    let cloud = (0.5 + 0.5 * (9.0 * toward.x + 2.0 * (14.0 * toward.y).sin()).sin()).powi(2);
    [0.55 + 0.45 * cloud, 0.75 + 0.25 * cloud, 1.0]
}

/// One eye's view in a style, over a game picture.
fn picture(renderer: &mut Renderer, style: Style, is_bright: bool) -> Result<RgbImage> {
    let settings =
        WarningSettings { style, labels: true, full_distance_m: 1.3, fade_distance_m: 2.5, ..Default::default() };
    let head = Pose::looking_at(DVec3::new(0.0, 1.65, 0.0), DVec3::new(0.17, 0.82, -1.35), DVec3::Y);
    let warnings = settled_warnings(head, &settings);
    let quads = renderer.quads(&warnings, &settings)?;
    let [view, _] = EyeView::pair(&head, 0.064, 1.15, [WIDTH, HEIGHT]);
    let scenery = StereoScene { quads: &quads, shapes: &[], color: settings.color };
    let texture = renderer.eye(&scenery, 0, &view)?;
    let seen = renderer.picture_of_texture(&texture)?;
    let [left, right, lower, upper] = view.tangents;
    Ok(RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let share = DVec2::new((f64::from(x) + 0.5) / f64::from(WIDTH), (f64::from(y) + 0.5) / f64::from(HEIGHT));
        let at = DVec2::new(left + (right - left) * share.x, upper + (lower - upper) * share.y);
        let toward = view.tracking_from_eye.rotation * DVec3::new(at.x, at.y, -1.0).normalize();
        let behind = game(is_bright, toward);
        let pixel = seen.get_pixel(x, y).0.map(|v| f64::from(v) / 255.0);
        Rgb(std::array::from_fn(|c| to_srgb(to_linear(pixel[c]) + behind[c] * (1.0 - pixel[3]))))
    }))
}

fn main() -> Result<()> {
    let file = std::env::args().nth(1).context("give a file for the picture")?;
    let mut renderer = Renderer::new()?;
    println!("{}", renderer.adapter_name());
    let columns = Style::ALL.len() as u32;
    let size = (columns * (WIDTH + GAP) - GAP, HEAD + 2 * HEIGHT + GAP);
    let mut whole = RgbImage::from_pixel(size.0, size.1, Rgb([255; 3]));
    for (column, style) in (0..).zip(Style::ALL) {
        for (row, is_bright) in [false, true].into_iter().enumerate() {
            let one = picture(&mut renderer, style, is_bright)?;
            let top = HEAD + row as u32 * (HEIGHT + GAP);
            image::imageops::replace(&mut whole, &one, (column * (WIDTH + GAP)).into(), top.into());
        }
    }
    name_columns(&mut whole, size)?;
    let out = std::io::BufWriter::new(std::fs::File::create(&file)?);
    let encoder = PngEncoder::new_with_quality(out, CompressionType::Best, FilterType::Adaptive);
    whole.write_with_encoder(encoder)?;
    println!("{file}: {} kB", std::fs::metadata(&file)?.len() / 1000);
    Ok(())
}

fn name_columns(whole: &mut RgbImage, size: (u32, u32)) -> Result<()> {
    register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
        .map_err(|_| anyhow!("the embedded font cannot be read"))?;
    let area = BitMapBackend::with_buffer(whole, size).into_drawing_area();
    for (column, style) in (0..).zip(["grid", "outline", "solid", "minimal"]) {
        let font = ("sans-serif", 22).into_font().color(&RGBColor(28, 36, 48));
        area.draw_text(style, &font, ((column * (WIDTH + GAP) + 8) as i32, 6)).map_err(|error| anyhow!("{error}"))?;
    }
    area.present().map_err(|error| anyhow!("{error}"))
}
