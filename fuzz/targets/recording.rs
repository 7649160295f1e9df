//! The reader of recordings: any bytes as a file.
//!
//! Held: no panic, no hang, memory bounded by the largest record that is read; what is read twice is the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radar_recording::Recording;
use radar_chaperone_fuzz::{file, memory, seeds};

/// A record of 32 MiB, unpacked, and what it holds.
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
