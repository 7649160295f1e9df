//! The other two display modes, and the chaperone's colour.

use std::path::Path;

use serde_json::{Value, json};

use crate::eyes::Eye;
use crate::rig::{Program, Rig};
use crate::warnings::{WALK_S, WALKS};

/// Starts with these settings and takes a shot when the head is at the chair and the chair is lit. A machine whose
/// cores are taken drops sweeps, and maps the chair in a later walk than the first.
pub fn at_the_chair(rig: &mut Rig, configuration: &Value, settings: &[&str]) -> (Program, [Eye; 2], Value) {
    rig.start_sensor("furnished-room", "approach-chair", 1, WALKS * WALK_S);
    let mut configuration = configuration.clone();
    let near = |walk: u32| format!("near{walk}");
    let shots = (0..WALKS).map(|walk| {
        let at_s = f64::from(walk * WALK_S) + 6.5;
        json!({"at_s": at_s, "do": "shot", "name": near(walk)})
    });
    configuration["events"] = shots.collect();
    rig.start_steamvr(&configuration, true);
    let program = rig.start_run(settings);
    let in_walk = |walk| {
        let shot = rig.shot(&near(walk));
        let eyes = Eye::both(&rig.path("vr/shots"), Path::new(&near(walk)), &shot);
        (eyes, shot)
    };
    let (eyes, shot) =
        (0..WALKS).map(in_walk).find(|(eyes, _)| shows_the_chair(eyes)).expect("the chair was not lit in any walk");
    (program, eyes, shot)
}

pub fn end(rig: &Rig, program: Program) {
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let report = rig.report();
    assert_eq!((&report["violations"], &report["left_at_cleanup"]), (&json!({}), &json!(0)));
}

/// The overlays of a shot but the notice's, which a machine whose cores are taken shows.
fn of_warnings(shot: &Value) -> impl Iterator<Item = &Value> {
    let overlays = shot["overlays"].as_array().unwrap().iter();
    overlays.filter(|overlay| overlay["key"] != "radar-chaperone.notice")
}

/// Whether the chair is lit in both eyes, most of its points within a degree.
fn shows_the_chair(eyes: &[Eye; 2]) -> bool {
    let chair = crate::warnings::chair();
    eyes.iter().all(|eye| {
        let lit = eye.lit();
        let from_lit = |part: &glam::DVec3| {
            let seen = eye.direction(*part).unwrap();
            lit.iter().map(|(at, _)| at.angle_between(seen)).fold(f64::INFINITY, f64::min).to_degrees()
        };
        let mut all: Vec<f64> = chair.points_m.iter().map(from_lit).collect();
        all.sort_by(f64::total_cmp);
        println!("{all:.1?} degrees from what is lit");
        all[all.len() / 2] < 1.0
    })
}

#[test]
fn windows_show_each_eye_its_own_image() {
    let mut rig = Rig::new("stereo");
    let (program, _, shot) = at_the_chair(&mut rig, &json!({}), &["--set", "headset.display=stereo"]);
    let side_by_side = 1 << 10;
    for overlay in of_warnings(&shot) {
        assert_ne!(overlay["flags"].as_u64().unwrap() & side_by_side, 0, "{overlay}");
    }
    end(&rig, program);
}

#[test]
fn projections_work_with_either_matrix_direction() {
    for matrix in ["eye_from_tracking", "tracking_from_eye"] {
        let mut rig = Rig::new(&format!("projection-{matrix}"));
        let set = format!("headset.projection_matrix={matrix}");
        let settings = ["--set", "headset.display=projection", "--set", &set];
        let (program, _, shot) = at_the_chair(&mut rig, &json!({"projection_matrix": matrix}), &settings);
        assert_eq!(of_warnings(&shot).count(), 2);
        end(&rig, program);
    }
}

#[test]
fn chaperone_color_and_distance_are_defaults() {
    for (settings, is_red) in [(&[][..], true), (&["--set", "warning.color=[0,255,0]"][..], false)] {
        let mut rig = Rig::new(if is_red { "red" } else { "green" });
        let configuration = json!({"settings": {"collisionBounds": {
            "CollisionBoundsColorGammaR": 255, "CollisionBoundsColorGammaG": 0, "CollisionBoundsColorGammaB": 0
        }}});
        let (program, [eye, _], _) = at_the_chair(&mut rig, &configuration, settings);
        let [red, green] = eye.brightest_red_and_green();
        assert_eq!((red > 2 * green, green > 2 * red), (is_red, !is_red), "{red} {green}");
        end(&rig, program);
    }
}
