//! Pose tracks in the TUM format, with any bytes as a file.
//!
//! Checks: no panic; memory grows in proportion to the file; at most one pose per line.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{file, memory, seeds};
use radar_recording::read_track;

fuzz_target!(init: seeds::write("track"), |data: &[u8]| {
    let path = file::temp_file_with(data);
    let poses = memory::bounded((1 << 20) + 64 * data.len(), (1 << 20) + 64 * data.len(), || read_track(path));
    let lines = data.split(|&byte| byte == b'\n').count();
    assert!(poses.map_or(0, |poses| poses.len()) <= lines);
});
