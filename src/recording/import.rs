//! Turns a recording of the vendor's exploration tool, and a pose track made beside it, into one of ours.

use std::path::Path;

use super::tum::read_track;
use super::{Event, Header, ImportError, RecordingError, RecordingSummary, RecordingWriter, vendor_h5};
use crate::geometry::Pose;
use crate::radar::Frame;
use crate::tracking::PoseSample;

/// What the files do not say.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Where the sensor sits on what the track follows. The identity when the track is the sensor's own.
    pub head_from_sensor: Pose,
    /// The program's settings, kept in the header.
    pub settings: String,
}

impl Default for ImportOptions {
    /// The track is the sensor's own.
    fn default() -> Self {
        Self { head_from_sensor: Pose::IDENTITY, settings: String::new() }
    }
}

/// An imported recording, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// What holds for the whole of it.
    pub header: Header,
    /// Frames in the file's order; the first one ends at time 0.
    pub frames: Vec<Frame>,
    /// Poses in the track's order, sound or not.
    pub poses: Vec<PoseSample>,
}

/// Reads the vendor's .h5 and, when given, a track in the TUM format with times in seconds since the first tick.
///
/// # Errors
/// A file that is foreign, damaged, too big or breaks a rule of the sensor; a line of the track that is no pose.
pub fn import_h5(frames: &Path, poses: Option<&Path>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let vendor = vendor_h5::read(frames)?;
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut source = format!("import of {}", name(frames));
    let mut track = Vec::new();
    if let Some(path) = poses {
        track = read_track(path)?;
        source += &format!(" and {}", name(path));
        warn_when_apart(&vendor.frames, &track);
    }
    let mut header = Header::new(source, vendor.config, options.head_from_sensor);
    header.sensor = vendor.sensor;
    header.settings.clone_from(&options.settings);
    Ok(Imported { header, frames: vendor.frames, poses: track })
}

impl Imported {
    /// Frames and poses by time; each stream keeps its own order even where its times run backwards.
    pub fn events(&self) -> impl Iterator<Item = Event> + '_ {
        let mut frames = self.frames.iter().peekable();
        let mut poses = self.poses.iter().peekable();
        std::iter::from_fn(move || {
            let pose_first = match (poses.peek(), frames.peek()) {
                (Some(pose), Some(frame)) => pose.time_ns <= frame.host_time_ns,
                (Some(_), None) => true,
                (None, _) => false,
            };
            match pose_first {
                true => poses.next().copied().map(Event::Pose),
                false => frames.next().cloned().map(Event::Frame),
            }
        })
    }

    /// Writes it as a recording.
    ///
    /// # Errors
    /// A mount that is no pose, or a file that cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<RecordingSummary, RecordingError> {
        let mut writer = RecordingWriter::create(path, &self.header)?;
        for event in self.events() {
            writer.write(&event)?;
        }
        writer.finish()
    }
}

/// The usual mistake: a track that counts from another moment than the first tick.
fn warn_when_apart(frames: &[Frame], poses: &[PoseSample]) {
    let span = |times: &mut dyn Iterator<Item = i64>| {
        times.fold(None, |span, t| span.map_or(Some((t, t)), |(a, b): (i64, i64)| Some((a.min(t), b.max(t)))))
    };
    let frames = span(&mut frames.iter().map(|f| f.host_time_ns));
    let poses = span(&mut poses.iter().map(|p| p.time_ns));
    if let (Some(frames), Some(poses)) = (frames, poses)
        && (poses.1 < frames.0 || poses.0 > frames.1)
    {
        let s = |ns: i64| ns as f64 * 1e-9;
        log::warn!(
            "the track ({:.2} to {:.2} s) lies outside the frames ({:.2} to {:.2} s): its times must be seconds since the \
             recording's first tick",
            s(poses.0),
            s(poses.1),
            s(frames.0),
            s(frames.1)
        );
    }
}
