//! The vendor's real recordings, where they are at hand.

use crate::common::Folder;
use crate::found::{counter, obstacles_of, only};

#[test]
fn the_reflector_in_the_tank_stands_where_it_stood() {
    let folder = Folder::new("tank");
    if folder.copy_real("medium_tank.h5").and(folder.copy_real("medium_tank_poses.tum")).is_none() {
        return;
    }
    folder
        .run("import medium_tank.h5 --poses medium_tank_poses.tum --out tank.mcap")
        .done()
        .says("import of medium_tank.h5 and medium_tank_poses.tum")
        .says("1740 over");
    let found = only(obstacles_of(&folder, "tank.mcap"));
    assert!((found.position_m.z + 0.8).abs() < 0.02, "{}", found.position_m);
    assert!(found.position_m.truncate().length() < 0.05, "{}", found.position_m);
    assert_eq!(found.observed, "range_only");
    assert!(counter(&folder, "frames_without_pose") > 1300);
}

#[test]
fn recordings_without_poses_are_imported_and_replay_says_what_is_missing() {
    let folder = Folder::new("vendor");
    for name in ["corner-reflector", "distance_fixed_strength", "input", "fr10Hz-spf4"] {
        if folder.copy_real(&format!("{name}.h5")).is_none() {
            return;
        }
        folder.run(&format!("import {name}.h5 --out r.mcap")).done().says("Damage     none");
        folder.run("info r.mcap").done().says(&format!("import of {name}.h5"));
        folder.run("replay r.mcap").done().says("No sweep has a pose").says("\n0 obstacles, 0 walls\n");
    }
}
