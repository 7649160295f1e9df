//! Recordings of the vendor's tool, with any bytes as a file.
//!
//! Checks: no panic escapes, no hang; memory is bounded; frames have the length of their
//! configuration.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radar_chaperone_fuzz::{file, memory, seeds};
use radar_recording::{ImportOptions, import_h5};

const PEAK_BYTES: usize = 200 << 20;

fuzz_target!(
    // The importer catches panics of the HDF5 reader; the fuzzer's own panic hook would end the run
    // first.
    init: {
        seeds::write("vendor_h5");
        std::panic::set_hook(Box::new(|_| {}));
    },
    |data: &[u8]| {
        let path = file::temp_file_with(data);
        let options = ImportOptions::default();
        let read = || {
            let Ok(import) = import_h5(path, None, &options) else { return };
            let samples = import.header.config.points_per_frame();
            import.vendor.frames().flatten().for_each(|frame| assert_eq!(frame.samples.len(), samples));
        };
        memory::bounded(PEAK_BYTES, PEAK_BYTES, read);
    }
);
