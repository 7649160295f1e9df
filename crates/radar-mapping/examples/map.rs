//! Maps a simulated room: frames and poses in, obstacles and walls out, next to the truth.
//!
//!     cargo run --release -p radar-mapping --example map -- [SCENE] [SECONDS]
//!
//! SCENE is one of `radar_simulation::SCENES`, by default furnished-room, with natural motion of
//! the head for 30 s and preset d16. The example map_recording of the crate radar-recording does
//! the same with a recording.

use a121::preset;
use radar_mapping::{Mapper, MappingSettings, in_time_order};
use radar_simulation::Scenario;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "furnished-room".into());
    let seconds = arguments.next().map_or(Ok(30.0), |text| text.parse())?;
    let config = preset("d16").ok_or("there is no such preset")?;
    let scenario = Scenario::new(&scene, "natural", config, seconds, 1);
    let simulated = scenario.run()?;

    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &MappingSettings::default());
    for event in in_time_order(simulated.frames, simulated.poses) {
        if let Err(refusal) = mapper.push(event) {
            eprintln!("{refusal}");
        }
        if let Some(scene) = mapper.poll_scene() {
            let (at_s, found) = (scene.time_ns as f64 * 1e-9, scene.obstacles.len());
            println!("{at_s:6.2} s: {found} obstacles, {} walls, {} moving", scene.walls.len(), scene.moving.len());
        }
    }
    mapper.finish();

    let distance_m = |position_m| {
        let points = simulated.truth.obstacles.iter().flat_map(|object| &object.points_m);
        points.map(|point: &glam::DVec3| point.distance(position_m)).fold(f64::INFINITY, f64::min)
    };
    for obstacle in mapper.scene().obstacles {
        let (at, size) = (obstacle.position_m, obstacle.extent_m);
        println!("obstacle at {at:.2} m, size {size:.2} m: {:.2} m from a true reflecting point", distance_m(at));
    }
    for wall in mapper.scene().walls {
        println!("wall facing {:.2}, {:.2} m from the origin", -wall.plane.outward, wall.plane.offset_m);
    }
    Ok(())
}
