//! Tests of the whole program, run as a user runs it: every command with valid, damaged, foreign
//! and invalid input, and the physics from simulation or real recording to obstacle.

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
mod links;
mod physics;
mod play_room;
mod real_recordings;
mod record;
mod results;
mod round_trip;
mod sensor_rules;
mod serve;
mod transcripts;
mod vendor_file;
mod view;

/// The program under test.
const PROGRAM: &str = env!("CARGO_BIN_EXE_radar-chaperone");
