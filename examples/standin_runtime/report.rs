//! What a client did, and what it did wrong: `report.json`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

/// Longest text of a violation that is kept.
const MAX_TEXT_BYTES: usize = 500;

/// A kind of wrong call.
#[derive(Debug, Clone, Serialize)]
pub struct Violation {
    pub count: u64,
    /// The first one, in words.
    pub first: String,
}

/// Times of the end, seconds since Init.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Ending {
    /// The client was asked to quit.
    pub quit_asked_s: Option<f64>,
    /// It took the event.
    pub quit_delivered_s: Option<f64>,
    /// It called AcknowledgeQuit_Exiting.
    pub quit_acknowledged_s: Option<f64>,
    /// It called Cleanup.
    pub cleanup_s: Option<f64>,
    /// Cleanup took so long.
    pub cleanup_took_s: Option<f64>,
    /// Overlays that it had not destroyed by then.
    pub left_at_cleanup: Option<usize>,
}

/// What is counted.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    pub pid: u32,
    /// A number of EVRApplicationType.
    pub application_type: u32,
    /// Times that Init succeeded.
    pub inits: u64,
    /// What SetSDKVersion said.
    pub sdk_version: Option<[u32; 3]>,
    /// Seconds since the last Init.
    pub running_s: f64,
    pub server_alive: bool,
    /// Frames that WaitFrameSync returned for.
    pub frames: u64,
    /// Frames that began while the client was elsewhere.
    pub frames_missed: u64,
    /// Textures that were handed over.
    pub textures: u64,
    /// Of these, those that could not be copied because too many copies were under way.
    pub textures_not_copied: u64,
    /// Of these, those for tabs of the dashboard and their buttons.
    pub dashboard_textures: u64,
    /// Times that textures came from another device, the one before being lost.
    pub devices_lost: u64,
    /// The most overlays that were visible at the end of a frame.
    pub most_visible: usize,
    /// Overlays there are, and of these those that are shown.
    pub overlays: usize,
    pub visible: usize,
    /// Events that were not taken in time and dropped.
    pub events_dropped: u64,
    /// Pictures taken.
    pub shots: u64,
    /// Pictures that could not be taken, and why the first could not.
    pub shots_failed: u64,
    pub shot_error: Option<String>,
    /// Haptic pulses of each controller, by its device index.
    pub pulses: BTreeMap<u32, u64>,
    #[serde(flatten)]
    pub ending: Ending,
    pub calls: BTreeMap<&'static str, u64>,
    pub violations: BTreeMap<String, Violation>,
    /// To be written as soon as may be.
    #[serde(skip)]
    pub urgent: bool,
}

impl Report {
    /// Counts a call.
    pub fn called(&mut self, name: &'static str) {
        *self.calls.entry(name).or_default() += 1;
    }

    /// Counts a wrong call; the first of its kind goes to stderr, too.
    pub fn violation(&mut self, kind: &str, text: impl Into<String>) {
        if let Some(violation) = self.violations.get_mut(kind) {
            violation.count += 1;
            return;
        }
        let first: String = text.into().chars().take(MAX_TEXT_BYTES).collect();
        eprintln!("stand-in: violation: {kind}: {first}");
        self.violations.insert(kind.to_owned(), Violation { count: 1, first });
        self.urgent = true;
    }

    /// Counts a picture that could not be taken.
    pub fn shot_failed(&mut self, why: String) {
        eprintln!("stand-in: no picture: {why}");
        self.shots_failed += 1;
        self.shot_error.get_or_insert(why);
    }

    /// As JSON.
    pub fn to_json(&self) -> Vec<u8> {
        serde_json::to_vec_pretty(self).unwrap_or_default()
    }
}

/// Replaces a file as a whole, so that readers see the old or the new one.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    std::fs::write(&temporary, bytes)?;
    std::fs::rename(&temporary, path)
}
