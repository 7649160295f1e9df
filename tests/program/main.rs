//! Tests of the whole program in one binary, which saves linking the program for each of them. Most
//! run it as a user runs it: every command with valid, damaged, foreign and invalid input, and the
//! physics from simulation or real recording to obstacle. Some drive its library. Tests that need
//! the machine to themselves are in `tests/beside`.

mod approach;
mod arguments;
mod bad_content;
mod bad_files;
mod calibrate;
#[path = "../common/mod.rs"]
mod common;
mod constants;
mod faults;
mod found;
mod golden;
mod gpu_imaging;
#[cfg(target_os = "linux")]
mod hostile_port;
mod links;
#[cfg(target_os = "linux")]
mod memory;
mod module_dependencies;
mod moving_targets;
mod outputs;
mod physics;
mod play_room;
mod real_recordings;
mod reconstruction;
mod record;
mod results;
mod round_trip;
mod saved_map;
mod sensor_rules;
mod serve;
mod settings_file;
mod tiny_board;
mod tracking_jumps;
mod transcripts;
mod vendor_file;
mod view;
#[cfg(unix)]
mod vulkan_validation;

/// The vendor's recordings, beside the repository.
const RECORDINGS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/recordings");
/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_radar-chaperone");
