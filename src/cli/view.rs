//! `--view` and `--view-shot DIR` of commands that replay a recording.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;

use super::outputs::{Outputs, begins_with};
use crate::settings::Settings;
use crate::viewer;
use crate::viewer::{Recorder, RecordingInfo, SHOT_NAMES, SHOT_SIZE_PX};
use radar_mapping::Scene;
use radar_mapping::{Mapper, MapperKind};
use radar_recording::{RecordingSummary, StreamSummary};

/// Arguments of the view.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct ViewArguments {
    /// Opens a window on the desktop that shows the replay in space, over time and in
    /// cross-sections; ? lists its keys
    #[arg(long)]
    view: bool,
    /// Draws a few states of that view into a folder instead, as PNG and without a window: for
    /// documentation and tests
    #[arg(long, value_name = "DIR")]
    view_shot: Option<PathBuf>,
}

/// How a replay ended.
pub(super) enum ReplayEnd {
    /// Completed: the mapper and the last scene.
    Done(Box<Mapper>, Scene),
    /// The view was closed.
    Closed,
}

impl ViewArguments {
    /// Whether a view was requested.
    pub fn is_wanted(&self) -> bool {
        self.view || self.view_shot.is_some()
    }

    /// The pictures that are drawn.
    pub fn shots(&self) -> Vec<PathBuf> {
        let folder = self.view_shot.as_ref();
        folder.map_or(Vec::new(), |folder| SHOT_NAMES.iter().map(|name| folder.join(name)).collect())
    }

    /// Information about the recording for the view.
    pub fn about(&self, summary: &RecordingSummary, settings: &Settings, search: MapperKind) -> RecordingInfo {
        RecordingInfo::new(&summary.header, settings, search, expected_s(summary))
    }

    /// Runs the work and shows it meanwhile, or draws it afterwards.
    pub fn show<T: Send>(
        &self,
        about: RecordingInfo,
        outputs: &Outputs,
        work: impl FnOnce(Recorder) -> T + Send,
    ) -> Result<T> {
        if self.view_shot.is_none() {
            return Ok(viewer::show(about, work)?);
        }
        let (pictures, done) = viewer::draw(about, work)?;
        for (path, picture) in self.shots().iter().zip(pictures) {
            outputs.write(path, &picture)?;
            outln!("Drawn: {}", path.display())?;
        }
        Ok(done)
    }
}

/// Whether a file is a picture of the view: one of their size.
pub(super) fn is_shot(file: &Path) -> bool {
    let [width, height] = SHOT_SIZE_PX.map(u32::to_be_bytes);
    begins_with(file, &[b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", &width[..], &height].concat())
}

/// Plausible length of a recording, seconds: a single wrong timestamp does not extend it.
fn expected_s(summary: &RecordingSummary) -> f64 {
    let usual = |stream: &StreamSummary| stream.count as f64 * stream.median_interval_s().unwrap_or(0.0);
    summary.duration_s().min(3.0 * usual(&summary.frames).max(usual(&summary.poses)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;
    use radar_recording::Header;
    use radar_sar::PoseSample;
    use radar_sar::geometry::Pose;

    #[test]
    fn wrong_timestamp_does_not_extend_the_duration() {
        let header = Header::new("test", preset("d16").unwrap(), Pose::IDENTITY);
        let mut summary = RecordingSummary::new(header);
        let pose = |time_ns| PoseSample::valid(time_ns, &Pose::IDENTITY);
        (0..=100).for_each(|n| summary.push_pose(&pose(n * 10_000_000)));
        assert!((expected_s(&summary) - 1.0).abs() < 1e-9);
        summary.push_pose(&pose(i64::MAX));
        assert!(expected_s(&summary) < 10.0);
    }
}
