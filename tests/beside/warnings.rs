//! A person walks up to a chair in a furnished room, and away again.

use glam::DVec3;
use radar_chaperone::radar::preset;
use radar_chaperone::simulation::Scenario;
use serde_json::{Value, json};

use crate::eyes::{Eye, mean};
use crate::rig::Rig;

#[test]
fn the_chair_is_warned_of_in_both_eyes_where_it_is() {
    let mut rig = Rig::new("chair");
    rig.start_sensor("furnished-room", "approach-chair", 1, 40);
    let shots: Vec<Value> = (0..16).map(|i| json!({"at_s": 1.0 + f64::from(i), "do": "shot", "name": format!("{i}")})).collect();
    rig.start_steamvr(&json!({"events": shots}), true);
    let program = rig.start_run(&["--report", "run.json"]);
    let scenario = Scenario::new("furnished-room", "approach-chair", preset("d16").unwrap(), 1.0, 1);
    let truth = scenario.run().unwrap().truth;
    let chair = truth.obstacles.iter().find(|thing| thing.name == "chair").unwrap();
    for i in 0..16 {
        let name = format!("{i}");
        let shot = rig.shot(&name);
        let eyes = Eye::both(&rig.path("vr/shots"), &name, &shot);
        let head = &shot["tracking_from_head"]["position_m"];
        let head = DVec3::new(head[0].as_f64().unwrap(), head[1].as_f64().unwrap(), head[2].as_f64().unwrap());
        let away = chair.points_m.iter().map(|p| (DVec3::new(p.x, 0.0, p.z) - DVec3::new(head.x, 0.0, head.z)).length()).fold(f64::INFINITY, f64::min);
        println!("{i}: away {away:.2}");
        for eye in &eyes {
            let lit = eye.lit();
            let seen: Vec<(DVec3, i32)> = chair.points_m.iter().filter_map(|p| eye.direction(*p)).map(|d| (d, 1)).collect();
            if lit.is_empty() || seen.is_empty() { println!("   lit {} seen {}", lit.len(), seen.len()); continue }
            let max = lit.iter().map(|l| l.1).max().unwrap();
            let deg = |a: DVec3, b: DVec3| a.angle_between(b).to_degrees();
            let near: Vec<f64> = seen.iter().map(|s| lit.iter().filter(|l| l.1 > max / 3).map(|l| deg(l.0, s.0)).fold(f64::INFINITY, f64::min)).collect();
            println!("   lit {} max {max} means {:.1} deg apart; points to lit {:.1?}", lit.len(), deg(mean(&lit), mean(&seen)), near);
        }
        for o in shot["overlays"].as_array().unwrap() { println!("     {} {}", o["key"], o["alpha"]); }
    }
    println!("{:?}", program.interrupt());
    println!("{:#}", rig.report());
}
