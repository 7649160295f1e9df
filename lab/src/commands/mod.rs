//! The lab's commands: one file each.

mod benchmark;
mod experiment;
mod play_sessions;
mod results;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use a121::Frame;
use a121::vendor_h5::{VendorFileError, VendorRecording};
use anyhow::{Context, Result, bail};
use radar_chaperone::outln;
use radar_simulation::RecordedSensor;

pub use benchmark::BenchmarkCommand;
pub use experiment::ExperimentCommand;
pub use play_sessions::PlaySessions;
pub use results::ResultsCommand;

/// Refuses targets that cannot be written, before minutes of work: `json` may not be one of the
/// files that `out` will hold.
fn check_targets(json: Option<&Path>, out: Option<&Path>, names_in_out: &[&str]) -> Result<()> {
    if let Some(folder) = out {
        make_folder(folder)?;
    }
    let Some(json) = json else { return Ok(()) };
    if json.is_dir() || json.file_name().is_none() {
        bail!("--json {}: give the name of a file", json.display());
    }
    if out.is_some_and(|folder| names_in_out.iter().any(|name| folder.join(name) == *json)) {
        bail!("--json {}: a file of --out has this name: choose another", json.display());
    }
    match json.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => make_folder(folder),
        None => Ok(()),
    }
}

fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make folder {}", folder.display()))
}

/// Jitter and noise of recordings of the sensor at rest; without recordings, the model's are used.
fn recorded_sensor(paths: &[PathBuf]) -> Result<Option<Arc<RecordedSensor>>> {
    let read = |path: &PathBuf| {
        let read = || {
            let recording = VendorRecording::open(path)?;
            let frames: Vec<Frame> = recording.frames().collect::<Result<_, _>>()?;
            Ok::<_, VendorFileError>((recording.config, frames))
        };
        read().with_context(|| format!("cannot read the recording {}", path.display()))
    };
    let recordings = paths.iter().map(read).collect::<Result<Vec<_>>>()?;
    if recordings.is_empty() {
        return Ok(None);
    }
    let scenes = recordings.iter().map(|(config, frames)| (config, frames.as_slice()));
    let recorded = RecordedSensor::of_scenes_at_rest(scenes)?;
    let jitter = match recorded.phase_jitter() {
        Some((rms_rad, hwaas)) => format!("recorded, {rms_rad:.3} rad with HWAAS {hwaas}"),
        None => "by the model".into(),
    };
    outln!("Jitter: {jitter}; noise: {}", if recorded.has_noise() { "recorded" } else { "by the model" })?;
    Ok(Some(Arc::new(recorded)))
}
