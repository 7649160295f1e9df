//! Saved maps of rooms, with any bytes as a file.
//!
//! A map of format 1 has no checksum and the content of the newest: it is how the fuzzer gets behind the checksum.
//!
//! Checks: no panic; memory grows in proportion to the file; an accepted map is written and read as the same; a mapper that starts
//! from it gives finite numbers.
#![no_main]

use a121::preset;
use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{file, memory, seeds};
use radar_mapping::{Mapper, MappingSettings};
use radar_recording::MapFile;
use radar_sar::geometry::Pose;

fuzz_target!(init: seeds::write("map"), |data: &[u8]| {
    let path = file::temp_file_with(data);
    let limit = (1 << 20) + 64 * data.len();
    let Ok(read) = memory::bounded(limit, limit, || MapFile::read(path)) else { return };
    read.write(path).expect("a map that was read can be written");
    let again = MapFile::read(path).expect("a map that was written can be read");
    assert_eq!(format!("{read:?}"), format!("{again:?}"));
    let mut mapper = Mapper::new(&preset("c16").expect("a preset"), &Pose::IDENTITY, &MappingSettings::default());
    if mapper.restore(&read.map).is_ok() {
        mapper.finish();
        assert!(mapper.scene().obstacles.iter().all(|obstacle| obstacle.position_m.is_finite()));
    }
});
