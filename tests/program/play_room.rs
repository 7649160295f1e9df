//! A play session as a recording: a player with moving hands, a visitor and a chair that is carried
//! away.

use crate::common::Folder;
use crate::found::obstacles_of;

#[test]
fn play_session_is_recorded_with_truth_and_reconstructed() {
    let folder = Folder::new("play_room");
    let outcome = folder.run("simulate play-room --duration-s 20 --seed 4 --out a.mcap").succeeds();
    assert!(outcome.out.contains("chair at the wall") && outcome.out.contains("6 walls"), "{}", outcome.out);
    assert!(
        !outcome.out.contains("chair to be removed"),
        "the removed chair must not be part of the truth: {}",
        outcome.out
    );
    folder.run("simulate play-room --duration-s 20 --seed 4 --out b.mcap").succeeds();
    assert!(folder.read("a.mcap") == folder.read("b.mcap"), "the same seed gives the same file");
    let found = obstacles_of(&folder, "a.mcap");
    assert!(found.len() > 3, "{} obstacles", found.len());
}

#[test]
fn play_room_refuses_motion_and_offset_options() {
    let folder = Folder::new("play_room_refused");
    folder.run("simulate play-room --motion natural --out a.mcap").fails_with("--motion is for the other rooms");
    folder
        .run("simulate play-room --time-offset-s 0.1 --out a.mcap")
        .fails_with("--time-offset-s is for the other rooms");
    folder.run("simulate play-room --serve tcp:127.0.0.1:0").fails_with("can only be recorded");
    folder.run("simulate play-room --duration-s 0 --out a.mcap").fails_with("give 1 to 3600 s");
}
