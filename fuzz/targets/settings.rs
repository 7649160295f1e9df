//! Settings: any text as TOML and, after a line with `%`, any text as changes, one per line.
//!
//! Checks: no panic; memory grows in proportion to the text; accepted settings round-trip.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radar_chaperone::settings::Settings;
use radar_chaperone_fuzz::{memory, seeds};

fuzz_target!(init: seeds::write("settings"), |data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let (text, changes) = text.split_once("\n%\n").unwrap_or((text, ""));
    let changes: Vec<String> = changes.lines().map(str::to_owned).collect();
    let read = || Settings::from_toml(text, &changes);
    if let Ok(settings) = memory::bounded((1 << 24) + 4096 * data.len(), (1 << 22) + 1024 * data.len(), read) {
        let written = settings.to_toml();
        let again = Settings::from_toml(&written, &[]);
        assert_eq!(again.as_ref().ok(), Some(&settings), "{written}");
    }
});
