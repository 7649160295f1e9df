//! Pictures of both eyes' views of a chair 0.9 m ahead and a wall to the right, as PNG files:
//! panels in a dark room, the windows of the display mode `stereo`, and the eye textures of the
//! display mode `projection`.
//!
//!     cargo run --release -p lab --example preview -- DIR

use std::time::Instant;

use anyhow::Context;
use glam::{DMat3, DQuat, DVec3};
use radar_chaperone::render::{EyeView, Renderer, StereoScene, Window};
use radar_chaperone::warning::{WarningSettings, WarningTracker, Warnings, Wearer};
use radar_mapping::{Observed, Obstacle, Scene, Wall};
use radar_sar::geometry::{Aabb, Plane, Pose};

/// Edge of a voxel, metres. Choice: the mapper's own.
const VOXEL_M: f64 = 0.05;

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

fn chair(tracking_from_chair: Pose, step_m: f64) -> Vec<DVec3> {
    let mut points = Vec::new();
    for (least, greatest) in CHAIR {
        let (least, size) = (DVec3::from(least), DVec3::from(greatest) - DVec3::from(least));
        let [nx, ny, nz] = (size / step_m).round().max(DVec3::ONE).to_array().map(|n| n as u32);
        let count = DVec3::new(nx.into(), ny.into(), nz.into());
        points.extend((0..nx * ny * nz).map(|i| {
            let cell = DVec3::new((i % nx).into(), (i / nx % ny).into(), (i / (nx * ny)).into());
            tracking_from_chair.transform_point(least + (cell + 0.5) / count * size)
        }));
    }
    points
}

/// Centres of the voxels that contain a point: the best possible radar image.
fn voxels(points: &[DVec3]) -> Vec<(DVec3, f32)> {
    let mut cells: Vec<[i64; 3]> = points.iter().map(|p| (*p / VOXEL_M).floor().to_array().map(|v| v as i64)).collect();
    cells.sort_unstable();
    cells.dedup();
    cells.into_iter().map(|c| ((DVec3::from_array(c.map(|v| v as f64)) + 0.5) * VOXEL_M, 1.0)).collect()
}

fn scene(tracking_from_chair: Pose) -> Scene {
    let shape = voxels(&chair(tracking_from_chair, 0.02));
    let chair = Obstacle {
        id: 1,
        position_m: tracking_from_chair.transform_point(DVec3::new(0.0, 0.5, 0.0)),
        covariance_m2: DMat3::from_diagonal(DVec3::splat(4e-4)),
        observed: Observed::Position,
        extent_m: DVec3::new(0.46, 0.95, 0.46),
        evidence: 20.0,
        shape,
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    let unknown = Obstacle {
        id: 2,
        position_m: DVec3::new(-1.1, 0.9, -0.6),
        observed: Observed::RangeOnly,
        shape: Vec::new(),
        ..chair.clone()
    };
    let wall = Wall {
        id: 3,
        plane: Plane { outward: DVec3::new(0.94, 0.0, -0.342), offset_m: 0.95 },
        evidence: 9.0,
        seen_at: Aabb::from_corners(DVec3::new(0.2, 1.5, -1.5), DVec3::new(1.5, 1.7, 1.0)),
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 0,
    };
    Scene { time_ns: 0, obstacles: vec![chair, unknown], walls: vec![wall], moving: vec![] }
}

/// The warnings after the head has stayed there for half a second, when they have faded in.
fn settled_warnings(tracker: &mut WarningTracker, tracking_from_head: Pose, settings: &WarningSettings) -> Warnings {
    let warn = |step: i64| tracker.warn(&Wearer::head_only(step * 10_000_000, tracking_from_head), settings);
    (0..50).map(warn).last().unwrap_or_default()
}

fn main() -> anyhow::Result<()> {
    let folder = std::env::args().nth(1).context("give a folder for the pictures")?;
    let path = |name: &str| std::path::Path::new(&folder).join(name);
    let tracking_from_chair = Pose::new(DVec3::new(-0.1, 0.0, -0.9), DQuat::from_rotation_y(0.5));
    let truth: Vec<(DVec3, f64)> = chair(tracking_from_chair, 0.015).into_iter().map(|p| (p, 0.009)).collect();
    let scene = scene(tracking_from_chair);
    let settings = WarningSettings::default();
    let mut renderer = Renderer::new()?;
    println!("{}", renderer.adapter_name());

    let mut tracker = WarningTracker::new();
    tracker.update(&scene);
    let head = DVec3::new(0.0, 1.65, 0.0);
    for (name, target) in [
        ("ahead", DVec3::new(0.0, 0.9, -1.0)),
        ("down", DVec3::new(0.0, 0.3, -0.8)),
        ("side", DVec3::new(0.8, 1.1, -0.9)),
        ("left", DVec3::new(-0.9, 1.1, -0.9)),
    ] {
        let tracking_from_head = Pose::looking_at(head, target, DVec3::Y);
        let warnings = settled_warnings(&mut tracker, tracking_from_head, &settings);
        let start = Instant::now();
        let count = renderer.quads(&warnings, &settings)?.len();
        println!("{name}: {count} quads ready in {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
        let views = EyeView::pair(&tracking_from_head, 0.064, 1.75, [960, 960]);
        for (eye, view) in ["left", "right"].iter().zip(&views) {
            let start = Instant::now();
            let picture = renderer.preview(&warnings, &settings, view, &truth)?;
            println!("{name} {eye}: {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
            picture.save(path(&format!("{name}-{eye}.png")))?;
        }
        let shapes = tracker.shapes(&warnings);
        let quads = renderer.quads(&warnings.clone().without_silhouettes(), &settings)?;
        let scenery = StereoScene { quads: &quads, shapes: &shapes, color: settings.color };
        for (side, view) in views.iter().enumerate() {
            let start = Instant::now();
            let texture = renderer.eye(&scenery, side, view)?;
            println!("{name} eye {side}: {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
            renderer.picture_of_texture(&texture)?.save(path(&format!("{name}-eye-{side}.png")))?;
        }
        let eyes_m = views.map(|view| view.tracking_from_eye.translation);
        for window in Window::of_panels(&scenery, eyes_m) {
            let start = Instant::now();
            let texture = renderer.window(&scenery, &window, eyes_m, window.half_px())?;
            println!("{name} window {:?}: {:.0} ms", window.key, start.elapsed().as_secs_f64() * 1e3);
            let file = format!("{name}-window-{:?}-{}.png", window.key.0, window.key.1).to_lowercase();
            renderer.picture_of_texture(&texture)?.save(path(&file))?;
        }
        for quad in renderer.quads(&warnings, &settings)? {
            let kind = if quad.on_floor { "floor" } else { "panel" };
            renderer.picture_of(&quad)?.save(path(&format!("{kind}-{}.png", quad.id)))?;
        }
    }
    println!("{} textures drawn", renderer.textures_drawn());
    Ok(())
}
