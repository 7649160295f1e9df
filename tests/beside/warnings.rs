//! A person walks up to a chair in a furnished room, and away again.

use std::path::Path;

use a121::preset;
use glam::{DQuat, DVec2, DVec3};
use radar_sar::truth::TruthObstacle;
use radar_simulation::Scenario;
use serde_json::{Value, json};

use crate::eyes::{Eye, disparity_rad};
use crate::rig::Rig;

const SEED: u64 = 1;
/// Seconds of one walk to the chair and back, with a shot in each.
pub const WALK_S: u32 = 14;
/// Walks in which the chair may become known. During the first one it is mapped; a machine whose cores
/// are taken drops sweeps and needs a few more.
pub const WALKS: u32 = 6;
/// The head is at the chair below the first distance, and away from it above the second, metres.
const NEAR_M: f64 = 0.5;
const AWAY_M: f64 = 1.95;
/// Tolerance for comparing distances, metres: the detected part of the chair grows by a voxel or
/// two meanwhile.
const MIN_DIFFERENCE_M: f64 = 0.2;

/// One shot.
struct Shot {
    eyes: [Eye; 2],
    head_m: DVec3,
    /// Distance from the head to the nearest part of the chair, along the floor, metres.
    away_m: f64,
    /// Brightness of the chair's panel; 0 without one.
    alpha: f64,
    /// Position of that panel.
    panel_m: Option<DVec3>,
}

impl Shot {
    fn is_near(&self) -> bool {
        self.away_m < NEAR_M
    }
}

#[test]
fn chair_warning_is_at_the_chair_in_both_eyes() {
    let mut rig = Rig::new("chair");
    rig.start_sensor("furnished-room", "approach-chair", SEED, WALKS * WALK_S + 4);
    let shots: Vec<Value> = (WALK_S + 1..=WALKS * WALK_S)
        .map(|second| json!({"at_s": second, "do": "shot", "name": second.to_string()}))
        .collect();
    rig.start_steamvr(&json!({"events": shots}), true);
    let program = rig.start_run(&[]);
    let chair = chair();
    // The walk that is judged is the first one in which the whole chair is mapped, and confirmed for long enough to be
    // bright.
    let walk = (1..WALKS).map(|walk| {
        let seconds = walk * WALK_S + 1..=(walk + 1) * WALK_S;
        seconds.map(|second| take_shot(&rig, &second.to_string(), &chair)).collect::<Vec<Shot>>()
    });
    let is_bright = |shot: &Shot| {
        println!("{:.2} m: brightness {:.2}", shot.away_m, shot.alpha);
        shot.alpha > 0.9 && shows_chair(shot, &chair)
    };
    let shots = walk.into_iter().find(|shots| shots.iter().filter(|shot| shot.is_near()).all(is_bright));
    let shots = shots.expect("the chair was not wholly and brightly lit in any walk");
    let ended = program.interrupt();
    assert_eq!(ended.code, Some(0), "{}", ended.err);

    let near: Vec<&Shot> = shots.iter().filter(|shot| shot.is_near()).collect();
    assert!(near.len() >= 2, "the head never came near");
    for shot in &near {
        assert_disparity(shot);
    }
    let first_m = shots.iter().find(|shot| shot.alpha > 0.0).map(|shot| shot.away_m).unwrap();
    println!("warned of from {first_m:.2} m on, by shots of one second");
    // The warning is brighter the closer the head is, and disappears on the way back.
    let leaving: Vec<&Shot> = shots.iter().skip_while(|shot| shot.away_m > NEAR_M).collect();
    for (nearer, farther) in leaving.iter().flat_map(|a| leaving.iter().map(move |b| (a, b))) {
        if nearer.away_m + MIN_DIFFERENCE_M < farther.away_m {
            let (near, far) = (nearer.alpha, farther.alpha);
            assert!(near >= far, "{near} at {:.2} m, {far} at {:.2} m", nearer.away_m, farther.away_m);
        }
    }
    let gone = leaving.iter().filter(|shot| shot.away_m > AWAY_M);
    assert!(gone.clone().count() > 0, "the head never went away");
    gone.for_each(|shot| assert_eq!(shot.alpha, 0.0, "still there at {:.2} m", shot.away_m));

    let report = rig.report();
    assert_eq!(report["violations"], json!({}));
    assert_eq!(report["left_at_cleanup"], 0);
    assert!(report["most_visible"].as_u64().unwrap() <= 8);
}

#[test]
fn controllers_pulse_near_the_chair_only() {
    let mut rig = Rig::new("pulse");
    rig.start_sensor("furnished-room", "approach-chair", SEED, 60);
    let shots: Vec<Value> =
        (1..=WALK_S).map(|second| json!({"at_s": second, "do": "shot", "name": second.to_string()})).collect();
    // A controller that follows the head, as if held; the other hand's controller is off.
    rig.start_steamvr(&json!({"events": shots, "controllers": ["track.tum"]}), true);
    let program = rig.start_run(&[]);
    let chair = chair();
    let mut pulsed = Vec::new();
    for second in 1..=WALK_S {
        let shot = take_shot(&rig, &second.to_string(), &chair);
        let report = rig.report();
        pulsed.push((shot.away_m, report["pulses"]["1"].as_u64().unwrap_or(0)));
        assert_eq!(report["pulses"]["2"], Value::Null);
    }
    assert_eq!(program.interrupt().code, Some(0));
    println!("{pulsed:.2?}");
    // The report is at most a second old. There are other objects on the way.
    let far = pulsed.iter().take_while(|(away_m, _)| *away_m > 1.9).map(|(_, count)| *count).max();
    assert_eq!(far, Some(0), "{pulsed:.2?}");
    assert!(pulsed.last().unwrap().1 >= 10, "{pulsed:.2?}");
    assert_eq!(rig.report()["violations"], json!({}));
}

/// Whether there is a warning within a degree of the chair's nearest part and of most of the rest, in
/// both eyes. A radar does not see all of a chair; the nearest part is what a user would hit first.
fn shows_chair(shot: &Shot, chair: &TruthObstacle) -> bool {
    shot.panel_m.is_some()
        && shot.eyes.iter().all(|eye| {
            let lit = eye.lit();
            let from_lit_deg = |part: &DVec3| {
                let seen = eye.direction(*part).unwrap();
                lit.iter().map(|(at, _)| at.angle_between(seen)).fold(f64::INFINITY, f64::min).to_degrees()
            };
            let level = |part: &DVec3| DVec2::new(part.x - shot.head_m.x, part.z - shot.head_m.z).length();
            let first = chair.points_m.iter().min_by(|a, b| level(a).total_cmp(&level(b))).unwrap();
            let mut all: Vec<f64> = chair.points_m.iter().map(from_lit_deg).collect();
            all.sort_by(f64::total_cmp);
            println!("{:.2} m: nearest part {:.2} deg from lit, all {all:.1?}", shot.away_m, from_lit_deg(first));
            from_lit_deg(first) < 1.0 && all[all.len() / 2] < 1.0
        })
}

/// The warning's image lies at the distance of its panel.
fn assert_disparity(shot: &Shot) {
    let panel_m = shot.panel_m.unwrap();
    let [left, right] = &shot.eyes;
    let expected = disparity_rad(left, right, panel_m).to_degrees();
    let around = |eye: &Eye| {
        let middle = eye.direction(panel_m).unwrap();
        let own: Vec<_> =
            eye.lit().into_iter().filter(|(at, _)| at.angle_between(middle).to_degrees() < 12.0).collect();
        eye.mean_right_rad(&own)
    };
    let shown = (around(left) - around(right)).to_degrees();
    assert!(expected > 1.0 && (shown - expected).abs() < 1.0, "disparity {shown:.2} degrees, {expected:.2} expected");
}

/// True position of the chair.
pub fn chair() -> TruthObstacle {
    let scenario = Scenario::new("furnished-room", "approach-chair", preset("d16").unwrap(), 0.5, SEED);
    let truth = scenario.run().unwrap().truth;
    truth.obstacles.into_iter().find(|obstacle| obstacle.name == "chair").unwrap()
}

fn take_shot(rig: &Rig, name: &str, chair: &TruthObstacle) -> Shot {
    let shot = rig.shot(name);
    let eyes = Eye::both(&rig.path("vr/shots"), Path::new(name), &shot);
    let head = position(&shot["tracking_from_head"]);
    let level = |v: DVec3| DVec2::new(v.x, v.z);
    let to_chair = |at: DVec3| chair.points_m.iter().map(|p| level(*p - at).length()).fold(f64::INFINITY, f64::min);
    let overlays = shot["overlays"].as_array().unwrap();
    // Panels are vertical; overlays on the floor are footprints.
    let panels = overlays.iter().filter(|overlay| overlay["sort_order"] == 1);
    // The chair may share a panel with objects too close to it to pass between: its panel is one
    // that has the chair behind it.
    let before_chair = |overlay: &&Value| {
        let [from, to] = ends(overlay).map(|end| level(end - head));
        let is_between =
            |to_part: DVec2| from.perp_dot(to_part) * to_part.perp_dot(to) > 0.0 && to_part.dot(from + to) > 0.0;
        let parts = chair.points_m.iter().map(|part| level(*part - head));
        0.5 * (from + to).length() < to_chair(head) + 0.3 && parts.filter(|part| is_between(*part)).count() > 0
    };
    let own = panels.filter(before_chair);
    let own = own.map(|overlay| (position(&overlay["tracking_from_overlay"]), overlay["alpha"].as_f64().unwrap()));
    let own = own.max_by(|a, b| a.1.total_cmp(&b.1));
    Shot {
        eyes,
        head_m: head,
        away_m: to_chair(head),
        alpha: own.map_or(0.0, |own| own.1),
        panel_m: own.map(|own| own.0),
    }
}

/// Left and right edge of an overlay at half its height.
fn ends(overlay: &Value) -> [DVec3; 2] {
    let pose = &overlay["tracking_from_overlay"];
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| pose["quaternion_xyzw"][i].as_f64().unwrap());
    let half = DQuat::from_xyzw(x, y, z, w) * DVec3::X * (0.5 * overlay["width_m"].as_f64().unwrap());
    [position(pose) - half, position(pose) + half]
}

fn position(pose: &Value) -> DVec3 {
    let [x, y, z] = [0, 1, 2].map(|i| pose["position_m"][i].as_f64().unwrap());
    DVec3::new(x, y, z)
}
