//! Golden recordings give the same bits on every architecture: each obstacle is, to the last digit, one that the program wrote to
//! `tests/golden`. The program's own test of them needs its libraries; this one runs wherever the crates do.

use std::path::PathBuf;

use radar_mapping::{Mapper, MappingSettings};
use radar_recording::Recording;

fn golden(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "../../tests/golden", name].iter().collect()
}

#[test]
fn obstacles_are_those_of_the_golden_outputs() {
    for name in ["c16_room", "d16_room"] {
        let written = std::fs::read_to_string(golden(&format!("{name}.obstacles.json"))).unwrap();
        let mut recording = Recording::open(golden(&format!("{name}.mcap"))).unwrap();
        let header = recording.header();
        let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &MappingSettings::default());
        mapper.push_all(&mut recording);
        let scene = mapper.scene();
        for obstacle in &scene.obstacles {
            let columns = [0, 1, 2].map(|n| obstacle.covariance_m2.row(n).to_array());
            let text = serde_json::to_string(&(obstacle.position_m.to_array(), columns)).unwrap();
            let text = text.trim_start_matches('[').trim_end_matches(']').replace("],[[", "],\"covariance_m2\":[[");
            assert!(written.contains(&format!("\"position_m\":[{text}]]")), "{name}: {text}");
        }
        assert!(scene.obstacles.len() >= 5 && written.matches("\"covariance_m2\"").count() == scene.obstacles.len());
    }
}
