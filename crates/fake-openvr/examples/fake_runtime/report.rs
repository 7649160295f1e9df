//! Record of a client's calls and violations: `report.json`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

/// Longest text of a violation that is kept, characters. Choice: enough for what was wrong and
/// where; a report stays readable.
const MAX_TEXT_BYTES: usize = 500;

/// A kind of violation.
#[derive(Debug, Clone, Serialize)]
pub struct Violation {
    pub count: u64,
    /// Description of the first one.
    pub first: String,
}

/// Times of the shutdown, seconds since Init.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Ending {
    /// The client was asked to quit.
    pub quit_asked_s: Option<f64>,
    /// It received the event.
    pub quit_delivered_s: Option<f64>,
    /// It called AcknowledgeQuit_Exiting.
    pub quit_acknowledged_s: Option<f64>,
    /// It called Cleanup.
    pub cleanup_s: Option<f64>,
    /// Duration of Cleanup.
    pub cleanup_took_s: Option<f64>,
    /// Overlays that it had not destroyed by then.
    pub left_at_cleanup: Option<usize>,
}

/// Counters. 25 fields: one record, serialised as it is.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    pub pid: u32,
    /// Value of EVRApplicationType.
    pub application_type: u32,
    /// Number of successful Init calls.
    pub inits: u64,
    /// Argument of SetSDKVersion.
    pub sdk_version: Option<[u32; 3]>,
    /// Seconds since the last Init.
    pub running_s: f64,
    pub server_alive: bool,
    /// Frames for which WaitFrameSync returned.
    pub frames: u64,
    /// Frames that began while the client was not in WaitFrameSync.
    pub frames_missed: u64,
    /// Submitted textures.
    pub textures: u64,
    /// Of these, those that were not copied because too many copies were in progress.
    pub textures_not_copied: u64,
    /// Of these, those of another size than the overlay's previous one.
    pub texture_size_changes: u64,
    /// Of these, those of dashboard tabs and their buttons.
    pub dashboard_textures: u64,
    /// Number of device changes after the previous device was lost.
    pub devices_lost: u64,
    /// Largest number of visible overlays at the end of a frame.
    pub most_visible: usize,
    /// Number of overlays, and of these the shown ones.
    pub overlays: usize,
    pub visible: usize,
    /// Events that were dropped because the client did not poll them in time.
    pub events_dropped: u64,
    /// Number of images.
    pub shots: u64,
    /// Number of failed images, and the error of the first.
    pub shots_failed: u64,
    pub shot_error: Option<String>,
    /// Commands read from `commands.jsonl`.
    pub commands: u64,
    /// Haptic pulses of each controller, by its device index.
    pub pulses: BTreeMap<u32, u64>,
    #[serde(flatten)]
    pub ending: Ending,
    pub calls: BTreeMap<&'static str, u64>,
    pub violations: BTreeMap<String, Violation>,
    /// Whether the report must be written as soon as possible.
    #[serde(skip)]
    pub urgent: bool,
}

impl Report {
    /// Counts a call.
    pub fn called(&mut self, name: &'static str) {
        *self.calls.entry(name).or_default() += 1;
    }

    /// Counts a violation. The first of its kind is also printed to stderr.
    pub fn violation(&mut self, kind: &str, text: impl Into<String>) {
        if let Some(violation) = self.violations.get_mut(kind) {
            violation.count += 1;
            return;
        }
        let first: String = text.into().chars().take(MAX_TEXT_BYTES).collect();
        eprintln!("fake runtime: violation: {kind}: {first}");
        self.violations.insert(kind.to_owned(), Violation { count: 1, first });
        self.urgent = true;
    }

    /// Counts a failed image.
    pub fn shot_failed(&mut self, why: String) {
        eprintln!("fake runtime: no picture: {why}");
        self.shots_failed += 1;
        self.shot_error.get_or_insert(why);
    }

    /// As JSON.
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(self).unwrap_or_default()
    }
}

/// Replaces a file atomically.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    std::fs::write(&temporary, bytes)?;
    std::fs::rename(&temporary, path)
}
