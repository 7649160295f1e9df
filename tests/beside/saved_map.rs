//! The map is saved from one start to the next.

use std::fmt::Write;

use glam::{DVec2, DVec3};
use radar_chaperone::panel;
use radar_recording::MapFile;
use radar_sar::geometry::Pose;
use radar_sar::truth::TruthObstacle;
use serde_json::{Value, json};

use crate::rig::Rig;
use crate::warnings::chair;

/// Distance of the head from the chair at the second start, along the floor, metres.
const AWAY_M: f64 = 0.7;

#[test]
fn saved_map_warns_before_redetection() {
    let mut rig = Rig::new("kept");
    rig.start_sensor("furnished-room", "approach-chair", 1, 300);
    rig.start_steamvr(&json!({}), true);
    let program = rig.start_run(&[]);
    let chair = chair();
    // A warning at the chair: it is confirmed, and part of the map.
    rig.wait_shot("confirmed", |shot| !panels_at(shot, &chair).is_empty());
    // The map that is saved is up to a second older than what is shown.
    rig.wait_frames(2 * 90);
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let folder = rig.path("home/.local/share/radar-chaperone/maps");
    let files: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let [file] = &files[..] else { panic!("{files:?}") };
    let bytes = std::fs::read(file).unwrap();
    let kept = MapFile::read(file).unwrap();
    let in_room = kept.map.moved(&kept.standing_from_raw);
    assert!(in_room.places.iter().any(|point| to(&chair, point.position_m) < 0.2), "{in_room:?}");
    rig.end_steamvr();

    // The head is beside the chair and looks away from it.
    let middle = chair.points_m.iter().sum::<DVec3>() / chair.points_m.len() as f64;
    let away = DVec3::new(-middle.x, 0.0, -middle.z).normalize_or(DVec3::Z);
    let edge = chair.points_m.iter().map(|point| (*point - middle).dot(away)).fold(0.0, f64::max);
    let eyes = DVec3::new(middle.x, 1.6, middle.z) + away * (edge + AWAY_M);
    std::fs::write(rig.path("still.tum"), still(&Pose::looking_at(eyes, eyes + away, DVec3::Y))).unwrap();
    rig.start_steamvr_with(&json!({}), &["--track", "still.tum"]);
    let program = rig.start_run(&[]);
    // Fainter than a detected obstacle.
    let is_faint = |alpha: &f64| *alpha > 0.0 && *alpha <= 0.6;
    rig.wait_shot("again", |shot| panels_at(shot, &chair).iter().any(is_faint));

    // The panel's button erases the map and its file.
    rig.send_command(&json!({"do": "dashboard", "open": true}));
    rig.wait_report("the panel", |report| report["dashboard_textures"].as_u64() > Some(5));
    let [x, y] = panel::target(&toml::Table::new(), "forget").unwrap();
    let press = json!({"do": "mouse", "action": "click", "x": x, "y": y});
    let drawn = |report: &Value| report["dashboard_textures"].as_u64();
    let before = drawn(&rig.report());
    rig.send_command(&press);
    // The panel has been drawn again, with its question.
    rig.wait_report("the question", |report| drawn(report) > before.map(|count| count + 1));
    assert!(!panels_at(&rig.shoot("asked"), &chair).is_empty(), "it must ask for confirmation");
    // The question stands for some seconds, in which a slow machine may not have finished the shot: the press is
    // repeated until the map is forgotten.
    rig.wait_for("its message", || {
        let before = drawn(&rig.report());
        rig.send_command(&press);
        rig.wait_report("the panel", |report| drawn(report) > before.map(|count| count + 1));
        program.err().contains("button to forget the room").then_some(())
    });
    rig.wait_for("no map", || (std::fs::read_dir(&folder).unwrap().count() == 0).then_some(()));
    let warned = panels_at(&rig.shoot("wiped"), &chair);
    assert!(warned.is_empty(), "{warned:?}");
    assert_eq!(program.interrupt().code, Some(0));
    let is_kept = |file: MapFile| {
        let in_room = file.map.moved(&file.standing_from_raw);
        in_room.places.iter().any(|point| to(&chair, point.position_m) < 0.2)
    };
    assert!(!MapFile::read(file).is_ok_and(is_kept), "it must not be written again at the end");

    std::fs::write(file, bytes).unwrap();
    let _ = std::fs::remove_file(rig.path("vr/report.json"));
    let program = rig.start_run(&["--forget"]);
    rig.wait_report("frames", |report| report["frames"].as_u64() > Some(180));
    let warned = panels_at(&rig.shoot("forgotten"), &chair);
    assert_eq!(program.interrupt().code, Some(0));
    assert!(warned.is_empty(), "{warned:?}");
    assert_eq!(rig.report()["violations"], json!({}));
}

/// Brightness of the panels at the chair, in the frame of the shot.
pub fn panels_at(shot: &Value, chair: &TruthObstacle) -> Vec<f64> {
    let panels = shot["overlays"].as_array().unwrap().iter().filter(|overlay| overlay["sort_order"] == 1);
    let position = |overlay: &Value| {
        let [x, y, z] = [0, 1, 2].map(|i| overlay["tracking_from_overlay"]["position_m"][i].as_f64().unwrap());
        DVec3::new(x, y, z)
    };
    panels.filter(|overlay| to(chair, position(overlay)) < 0.3).map(|panel| panel["alpha"].as_f64().unwrap()).collect()
}

/// Distance along the floor to the box around the chair, metres. Its points are only its corners.
pub fn to(chair: &TruthObstacle, position: DVec3) -> f64 {
    let level = |v: DVec3| DVec2::new(v.x, v.z);
    let corners = || chair.points_m.iter().map(|point| level(*point));
    let least = corners().fold(DVec2::INFINITY, DVec2::min);
    let most = corners().fold(DVec2::NEG_INFINITY, DVec2::max);
    level(position).distance(level(position).clamp(least, most))
}

/// Track of a head at rest for ten minutes from now, fifty poses per second: the fake runtime
/// treats 30 ms without a pose as a gap.
fn still(head: &Pose) -> String {
    let now_s = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic).tv_sec as f64;
    let (p, q) = (head.translation, head.rotation);
    let mut track = String::new();
    for n in 0..30_000 {
        let time_s = now_s - 1.0 + f64::from(n) * 0.02;
        writeln!(track, "{time_s:.3} {} {} {} {} {} {} {}", p.x, p.y, p.z, q.x, q.y, q.z, q.w).unwrap();
    }
    track
}
