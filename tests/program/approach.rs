//! A person walks up to a chair: it is detected, and warned of at its position, before the head is
//! within 0.8 m, on the first approach.

use a121::preset;
use glam::DVec3;
use radar_chaperone::settings::Settings;
use radar_chaperone::warning::{PanelKind, warn};
use radar_mapping::Mapper;
use radar_mapping::in_time_order;
use radar_sar::geometry::Pose;
use radar_sar::truth::TruthObstacle;
use radar_simulation::Scenario;

/// Duration of the first approach with the rest before it, seconds.
const THERE_S: f64 = 6.0;

fn level(v: DVec3) -> DVec3 {
    DVec3::new(v.x, 0.0, v.z)
}

fn away_m(chair: &TruthObstacle, at: DVec3) -> f64 {
    chair.points_m.iter().map(|p| level(*p - at).length()).fold(f64::INFINITY, f64::min)
}

/// Horizontal distance of the head from the chair when the first panel stands at the chair, metres.
fn warned_from_m(scene: &str, seed: u64) -> Option<f64> {
    let scenario = Scenario::new(scene, "approach-chair", preset("d16").unwrap(), THERE_S, seed);
    let simulated = scenario.run().unwrap();
    let chair = simulated.truth.obstacles.iter().find(|obstacle| obstacle.name.contains("chair")).unwrap();
    let settings = Settings::default();
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings.mapping());
    for event in in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()) {
        mapper.push(event).unwrap();
        if mapper.poll_scene().is_none() {
            continue;
        }
        let (_, head) = mapper.head().unwrap();
        if panel_stands_at(&mapper, &head, chair, &settings) {
            return Some(away_m(chair, head.translation));
        }
    }
    None
}

/// Whether a sufficiently bright panel stands at the chair.
fn panel_stands_at(mapper: &Mapper, head: &Pose, chair: &TruthObstacle, settings: &Settings) -> bool {
    let warnings = warn(&mapper.scene(), head, &settings.warning);
    let objects = warnings.panels.iter().filter(|panel| panel.kind == PanelKind::Object && panel.alpha > 0.02);
    objects.into_iter().any(|panel| away_m(chair, panel.tracking_from_panel.translation) < 0.25)
}

#[test]
fn chair_is_warned_of_beyond_80_cm() {
    for (scene, seed) in [("furnished-room", 1), ("furnished-room", 2), ("furnished-room", 3), ("chair", 1)] {
        let from_m = warned_from_m(scene, seed);
        println!("{scene} {seed}: warned from {from_m:?} m on");
        assert!(from_m.is_some_and(|m| m > 0.8), "{scene} {seed}: {from_m:?}");
    }
}
