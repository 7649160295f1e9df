//! Maps a recording: frames and poses from an .mcap file in, obstacles and walls out.
//!
//!     cargo run --release -p radar-recording --example map_recording -- FILE.mcap
//!
//! `radar-chaperone simulate` and `radar-chaperone record` write such files.

use radar_mapping::{Mapper, MappingSettings};
use radar_recording::Recording;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("name a recording: FILE.mcap")?;
    let mut recording = Recording::open(path)?;
    let header = recording.header();
    let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &MappingSettings::default());
    mapper.push_all(&mut recording);

    let scene = mapper.scene();
    for obstacle in &scene.obstacles {
        println!("obstacle at {:.2} m, size {:.2} m", obstacle.position_m, obstacle.extent_m);
    }
    for wall in &scene.walls {
        println!("wall facing {:.2}, {:.2} m from the origin", -wall.plane.outward, wall.plane.offset_m);
    }
    let (streams, damage) = (mapper.counters().streams, recording.damage());
    println!("{} frames, {} poses; could not be read: {damage:?}", streams.frames, streams.poses);
    Ok(())
}
