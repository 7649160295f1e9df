//! Reader of recordings, with any bytes as a file.
//!
//! Checks: no panic, no hang; memory is bounded by the largest record; reading twice gives the
//! same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{file, memory, seeds};
use radar_recording::Recording;

/// Limits for an unpacked record of 32 MiB and its content, bytes.
const PEAK_BYTES: usize = 256 << 20;
const LARGEST_BYTES: usize = 64 << 20;

fuzz_target!(init: seeds::write("recording"), |data: &[u8]| {
    let path = file::temp_file_with(data);
    let read = || {
        let mut recording = Recording::open(path).ok()?;
        let events = recording.by_ref().count();
        Some((events, format!("{:?}", recording.damage())))
    };
    let first = memory::bounded(PEAK_BYTES, LARGEST_BYTES, read);
    assert_eq!(first, read());
});
