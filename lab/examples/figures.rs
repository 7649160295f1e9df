//! Draws every figure of a report from synthetic data and prints the time each takes.
//!
//!     cargo run --release -p lab --example figures -- [DIR]
//!
//! Writes PNGs, a volume, a point cloud, obstacles.json and report.html; without DIR into the
//! temporary folder.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{DMat3, DVec3};
use radar_chaperone::report::{
    Chart, Figure, Limits, Marks, Picture, Report, RoomMap, Section, Series, Table, VolumeInfo, cross_sections,
    motion_plot, point_cloud, points_above, room_map, score, write_obstacles_json, write_ply, write_volume,
};
use radar_mapping::{CalibrationInUse, Observed, Obstacle, Scene, Wall};
use radar_sar::geometry::{Aabb, Plane, Pose};
use radar_sar::truth::{Truth, TruthObstacle, TruthWall};
use radar_sar::{TimeOffset, Volume};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder =
        std::env::args().nth(1).map_or_else(|| std::env::temp_dir().join("radar-chaperone-figures"), PathBuf::from);
    let chair = chair_points();
    let volume = chair_volume(&chair);
    let path = head_path();
    let positions: Vec<DVec3> = path.iter().map(|&(_, position)| position).collect();
    let found = [DVec3::new(0.18, 0.46, -1.52), DVec3::new(-0.2, 0.92, -1.72)];
    let marks = Marks { truth_m: &chair, found_m: &found, path_m: &positions };
    let (scene, truth) = room();
    let walk: Vec<DVec3> = (0..600).map(|n| walked(n as f64 / 600.0)).collect();
    let map = RoomMap {
        title: "Living room, walking, after 30 s",
        scene: &scene,
        truth: Some(&truth),
        path_m: &walk,
        region: None,
    };
    let quantity = "log-likelihood (nats)";

    let sections = timed(&folder, "cross_sections", || {
        cross_sections(&volume, "Chair at 1.5 m, accumulated cross-sections", quantity, &marks)
    })?;
    let room_image = timed(&folder, "room_sections", || {
        let quantity = "Σ|x| (LSB)";
        cross_sections(
            &room_volume(&truth),
            "A whole room, the thesis' sum",
            quantity,
            &Marks { path_m: &walk, ..marks },
        )
    })?;
    let cloud =
        timed(&folder, "point_cloud", || point_cloud(&volume, "Chair at 1.5 m, point cloud", quantity, 0.35, &marks))?;
    let room = timed(&folder, "room_map", || room_map(&map))?;
    let motion = timed(&folder, "motion_plot", || motion_plot(&path, "Head motion, seated, 8 s"))?;

    let trade = timed(&folder, "chart", || run_time_against_error().draw())?;
    let narrow = narrow_volume();
    timed(&folder, "narrow", || cross_sections(&narrow, "A narrow box", quantity, &Marks::default()))?;

    let score = score(&scene, &truth, &Limits::default());
    println!("{score}");
    let info = VolumeInfo { statistic: "log".into(), updates: 1_234, dense_updates: 216_000, ..VolumeInfo::default() };
    write_volume(&folder.join("chair.npy"), &volume, &info)?;
    write_ply(&folder.join("chair.ply"), &points_above(&volume, 0.35))?;
    let estimate = TimeOffset { offset_s: 0.012, sigma_s: 0.000_4, observable: true, tracks: 9, tracks_left_out: 0 };
    let calibration = CalibrationInUse {
        time_offset_estimate: Some(estimate),
        drift_m: Some(0.001),
        ..CalibrationInUse::as_set(0.012, Pose::IDENTITY)
    };
    write_obstacles_json(&folder.join("obstacles.json"), &scene, &serde_json::json!({"sweeps": 9600}), &calibration)?;
    let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
    let table = Table {
        head: row(["obstacle", "nearest report (cm)", "evidence"]),
        rows: vec![row(["chair", "2.1", "61"]), row(["table", "4.0", "38"]), row(["floor lamp", "–", "–"])],
        caption: "Detections, from synthetic data".into(),
    };
    Report::new("Radar chaperone: example figures")
        .intro("All data on this page are synthetic; it shows the layout of reports.")
        .section(Section::new("A chair").text("Gaussian blobs along a chair's edges.").figure(sections).figure(cloud))
        .section(Section::new("A room").figure(room).figure(room_image).table(table).preformatted(score.to_string()))
        .section(Section::new("Run time").figure(trade))
        .section(Section::new("The motion").figure(motion))
        .write(&folder.join("report.html"))?;
    println!("{}", folder.display());
    Ok(())
}

fn timed(folder: &Path, name: &str, draw: impl Fn() -> Picture) -> Result<Figure, Box<dyn std::error::Error>> {
    draw();
    let start = Instant::now();
    let picture = draw();
    let drawn = start.elapsed();
    picture.write(&folder.join(format!("{name}.png")))?;
    let figure = Figure::new(&picture, format!("The figure {name}."))?;
    println!("{name}: drawn in {drawn:.1?}, {} × {}, {} kB", picture.width, picture.height, figure.png.len() / 1000);
    Ok(figure)
}

fn chair_points() -> Vec<DVec3> {
    let mut points = Vec::new();
    for (x, z) in [(-0.22, -1.45), (0.22, -1.45), (-0.22, -1.85), (0.22, -1.85)] {
        let top = if z < -1.6 { 0.95 } else { 0.45 };
        points.extend([0.1, 0.45, top].map(|y| DVec3::new(x, y, z)));
    }
    points.push(DVec3::new(0.0, 0.45, -1.45));
    points.push(DVec3::new(0.0, 0.95, -1.85));
    points
}

fn chair_volume(points: &[DVec3]) -> Volume {
    let region = Aabb { min: DVec3::new(-1.5, -0.2, -3.0), max: DVec3::new(1.5, 2.8, 0.0) };
    let mut volume = Volume::covering(&region, 0.05);
    for index in 0..volume.values.len() {
        let position = volume.center(volume.voxel(index));
        let blobs = points.iter().enumerate().map(|(n, point)| {
            let d = (position - *point) / DVec3::new(0.09, 0.11, 0.05);
            (14.0 + 5.0 * (n as f64 * 1.7).sin()) * (-0.5 * d.length_squared()).exp()
        });
        let noise = 0.5 + 0.5 * ((index * 7919 % 1000) as f64 / 1000.0);
        volume.values[index] = (blobs.sum::<f64>() + noise) as f32;
    }
    volume.values[77] = f32::NAN;
    volume
}

/// Large values everywhere, and slightly larger ones at objects.
fn room_volume(truth: &Truth) -> Volume {
    let region = Aabb { min: DVec3::new(-2.0, 0.0, -2.5), max: DVec3::new(2.0, 2.5, 2.5) };
    let mut volume = Volume::covering(&region, 0.05);
    let points: Vec<DVec3> = truth.obstacles.iter().flat_map(|obstacle| obstacle.points_m.iter().copied()).collect();
    for index in 0..volume.values.len() {
        let position = volume.center(volume.voxel(index));
        let blobs: f64 = points.iter().map(|point| (-0.5 * (position - *point).length_squared() / 0.02).exp()).sum();
        volume.values[index] = (4000.0 + 2500.0 * blobs + 300.0 * (index * 7919 % 1000) as f64 / 1000.0) as f32;
    }
    volume
}

fn narrow_volume() -> Volume {
    let region = Aabb { min: DVec3::new(-0.3, 0.0, -4.0), max: DVec3::new(0.3, 2.0, 0.0) };
    let mut volume = Volume::covering(&region, 0.1);
    for (index, value) in volume.values.iter_mut().enumerate() {
        *value = (index % 17) as f32;
    }
    volume
}

fn run_time_against_error() -> Chart {
    let curve = |name: &str, best: f64, joined| Series {
        name: name.into(),
        points: (0..8).map(|n| 2f64.powi(n)).map(|t| [0.004 * t, best + 0.08 / t]).collect(),
        joined,
    };
    Chart {
        title: "Position error against run time".into(),
        x_label: "run time (s)".into(),
        y_label: "median position error (m)".into(),
        x_log: true,
        y_log: false,
        series: vec![
            curve("dense, LS", 0.012, true),
            curve("adaptive, LS", 0.009, true),
            curve("thesis, eq. 3.2", 0.03, false),
        ],
    }
}

fn head_path() -> Vec<(f64, DVec3)> {
    let at = |t: f64| DVec3::new(0.11 * (1.3 * t).sin(), 1.18 + 0.05 * (2.1 * t).sin(), 0.12 + 0.07 * (0.7 * t).cos());
    (0..800).map(|n| n as f64 * 0.01).map(|t| (t, at(t))).collect()
}

fn walked(share: f64) -> DVec3 {
    let a = share * std::f64::consts::TAU * 2.0;
    DVec3::new(0.9 * a.sin() + 0.15 * (5.0 * a).sin(), 1.65, 0.9 * (a * 0.5).cos() + 0.1 * (3.0 * a).sin())
}

fn room() -> (Scene, Truth) {
    let objects: [(&str, &[[f64; 2]], f64, f64); 8] = [
        ("chair", &[[-1.2, -0.3], [-0.8, -0.3], [-1.2, 0.1], [-0.8, 0.1]], 0.45, 0.5),
        ("table", &[[0.9, -1.6], [1.7, -1.6], [0.9, -0.9], [1.7, -0.9]], 0.72, 0.7),
        ("floor lamp", &[[1.75, 2.2]], 1.4, 1.3),
        ("shelf", &[[-1.9, -1.9], [-1.9, -1.3], [-1.9, -1.6]], 1.1, 0.9),
        ("box", &[[0.3, 1.6], [0.6, 1.6], [0.3, 1.9]], 0.2, 0.6),
        ("plant", &[[-1.6, 2.0]], 0.6, 1.2),
        ("monitor", &[[1.3, -1.3]], 1.1, 0.8),
        ("sofa", &[[-1.9, 0.6], [-1.9, 1.0], [-1.9, 1.4]], 0.5, 0.8),
    ];
    let reports: [([f64; 3], [f64; 2], f64, f64); 9] = [
        ([-0.82, 0.45, -0.27], [0.02, 0.03], 30.0, 61.0),
        ([0.93, 0.70, -0.94], [0.03, 0.02], -20.0, 48.2),
        ([1.31, 1.08, -1.27], [0.03, 0.12], 10.0, 39.0),
        ([-1.87, 1.1, -1.58], [0.02, 0.10], 80.0, 27.4),
        ([0.33, 0.22, 1.63], [0.02, 0.03], 0.0, 22.0),
        ([-1.85, 0.5, 1.02], [0.02, 0.20], 85.0, 19.1),
        ([-1.55, 0.6, 1.86], [0.04, 0.15], 60.0, 12.0),
        ([0.45, 0.9, -2.0], [0.05, 0.30], 15.0, 9.7),
        ([-1.19, 0.45, 0.13], [0.03, 0.03], 0.0, 15.5),
    ];
    let obstacles = objects.iter().map(|(name, feet, height, closest)| TruthObstacle {
        name: (*name).into(),
        points_m: feet.iter().map(|[x, z]| DVec3::new(*x, *height, *z)).collect(),
        rcs_dbsm: vec![-20.0; feet.len()],
        closest_approach_m: *closest,
        in_beam_s: 4.0,
    });
    let found = reports.iter().enumerate().map(|(n, (position, [short, long], degrees, evidence))| {
        let turn = DMat3::from_rotation_y(degrees.to_radians());
        let spread = DMat3::from_diagonal(DVec3::new(long * long, 0.01, short * short));
        Obstacle {
            id: n as u64,
            position_m: DVec3::from_array(*position),
            covariance_m2: turn * spread * turn.transpose(),
            observed: Observed::Position,
            extent_m: DVec3::new(0.25 + 0.03 * n as f64, 0.5, 0.3),
            evidence: *evidence,
            shape: Vec::new(),
            provisional: false,
            first_seen_ns: 1_250_000_000 * n as i64,
            last_seen_ns: 30_000_000_000,
        }
    });
    let walls = [
        ("north", DVec3::NEG_Z, 2.5, DVec3::new(-2.0, 0.0, -2.5), DVec3::new(2.0, 2.5, -2.5)),
        ("south", DVec3::Z, 2.5, DVec3::new(-2.0, 0.0, 2.5), DVec3::new(2.0, 2.5, 2.5)),
        ("east", DVec3::X, 2.0, DVec3::new(2.0, 0.0, -2.5), DVec3::new(2.0, 2.5, 2.5)),
        ("west", DVec3::NEG_X, 2.0, DVec3::new(-2.0, 0.0, -2.5), DVec3::new(-2.0, 2.5, 2.5)),
        ("floor", DVec3::NEG_Y, 0.0, DVec3::new(-2.0, 0.0, -2.5), DVec3::new(2.0, 0.0, 2.5)),
    ];
    let true_walls = walls.iter().map(|(name, outward, offset_m, min, max)| TruthWall {
        name: (*name).into(),
        plane: Plane { outward: *outward, offset_m: *offset_m },
        extent: Aabb { min: *min, max: *max },
    });
    let found_walls = walls.iter().take(3).enumerate().map(|(n, (_, outward, offset_m, min, max))| Wall {
        id: 100 + n as u64,
        plane: Plane { outward: (*outward + DVec3::new(0.02, 0.0, -0.015)).normalize(), offset_m: offset_m + 0.01 },
        evidence: 80.0,
        seen_at: Aabb { min: *min, max: *max },
        provisional: false,
        first_seen_ns: 0,
        last_seen_ns: 30_000_000_000,
    });
    let scene =
        Scene { time_ns: 30_000_000_000, obstacles: found.collect(), walls: found_walls.collect(), moving: vec![] };
    let truth = Truth {
        title: "living room, walking".into(),
        obstacles: obstacles.collect(),
        walls: true_walls.collect(),
        ..Truth::default()
    };
    (scene, truth)
}
