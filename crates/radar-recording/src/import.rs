//! Imports a recording of the vendor's exploration tool, optionally with a pose track, as a
//! recording of this program.

use radar_mapping::{Event, in_time_order};
use std::path::Path;

use super::track::read_track;
use super::{Header, ImportError, RecordingError, RecordingSummary, RecordingWriter, SensorMetadata};
use a121::vendor_h5::{Unfinished, VendorRecording};
use a121::{Frame, frame_timing};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;

/// Interval of the poses of a sensor at rest, nanoseconds. Choice: 100 Hz, as of a headset; any
/// below the limit of the settings gives the same.
const STEP_AT_REST_NS: usize = 10_000_000;
/// How far these poses reach beyond the frames, seconds. Choice: the longest smoothing window of the
/// settings.
const MARGIN_AT_REST_S: f64 = 0.5;
/// Longest recording that gets these poses, seconds. Choice: a day; the ticks of a longer one are
/// damaged, and its poses would take a gigabyte.
const MAX_AT_REST_S: f64 = 86_400.0;

/// Information that the files do not contain.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Pose of the sensor on the tracked object; identity if the track is the sensor's own.
    pub head_from_sensor: Pose,
    /// The program's settings, for the header.
    pub settings: String,
    /// A sensor at rest: the pose of the tracked object throughout, instead of a track.
    pub fixed_pose: Option<Pose>,
}

impl Default for ImportOptions {
    /// Options for a track of the sensor itself.
    fn default() -> Self {
        Self { head_from_sensor: Pose::IDENTITY, settings: String::new(), fixed_pose: None }
    }
}

/// An imported recording, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The header.
    pub header: Header,
    /// Frames in the order of the file; the first one ends at time 0.
    pub frames: Vec<Frame>,
    /// Poses in the order of the track, valid or not.
    pub poses: Vec<PoseSample>,
}

/// Reads the vendor's .h5 and, if given, a track with times since the first tick: TUM, or CSV if
/// its name ends in `.csv`. A track has precedence over a fixed pose.
///
/// # Errors
/// A file that is of another format, damaged, too big or breaks a rule of the sensor; an invalid
/// line of the track.
pub fn import_h5(frames: &Path, poses: Option<&Path>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let vendor = VendorRecording::read(frames)?;
    warn_about_ignored_parts(frames, &vendor);
    warn_if_unfinished(frames, &vendor);
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut source = format!("import of {}", name(frames));
    let mut track = Vec::new();
    if let Some(path) = poses {
        track = read_track(path)?;
        source += &format!(" and {}", name(path));
        warn_if_no_overlap(&vendor.frames, &track);
    } else if let Some(pose) = &options.fixed_pose {
        track = track_at_rest(frames, &vendor, pose)?;
        source += " at a fixed pose";
    }
    let mut header = Header::new(source, vendor.config, options.head_from_sensor);
    header.sensor = SensorMetadata {
        ticks_per_second: Some(vendor.ticks_per_second),
        base_step_length_m: vendor.base_step_length_m,
        board: vendor.board,
        rss_version: vendor.rss_version,
    };
    header.settings.clone_from(&options.settings);
    Ok(Imported { header, frames: vendor.frames, poses: track })
}

impl Imported {
    /// Frames and poses by time. Each stream keeps its own order even if its times run backwards.
    pub fn events(&self) -> impl Iterator<Item = Event> + '_ {
        in_time_order(self.frames.iter().cloned(), self.poses.iter().copied())
    }

    /// Writes it as a recording.
    ///
    /// # Errors
    /// An invalid mount, or a file that cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<RecordingSummary, RecordingError> {
        let mut writer = RecordingWriter::create(path, &self.header)?;
        for event in self.events() {
            writer.write(&event)?;
        }
        writer.finish()
    }
}

/// The same pose all along the frames, and before and after them as far as their sweeps and the
/// smoothing reach.
fn track_at_rest(path: &Path, vendor: &VendorRecording, pose: &Pose) -> Result<Vec<PoseSample>, ImportError> {
    let times = vendor.frames.iter().map(|frame| frame.host_time_ns);
    let (Some(first_ns), Some(last_ns)) = (times.clone().min(), times.max()) else { return Ok(Vec::new()) };
    let span_s = (last_ns as f64 - first_ns as f64) * 1e-9;
    if span_s > MAX_AT_REST_S {
        return Err(ImportError::TooLongAtRest { path: path.to_owned(), span_s, max_s: MAX_AT_REST_S });
    }
    let before_ns = ((frame_timing(&vendor.config).frame_period_s + MARGIN_AT_REST_S) * 1e9).round() as i64;
    let after_ns = (MARGIN_AT_REST_S * 1e9).round() as i64;
    let times_ns = (first_ns.saturating_sub(before_ns)..=last_ns.saturating_add(after_ns)).step_by(STEP_AT_REST_NS);
    Ok(times_ns.map(|time_ns| PoseSample::valid(time_ns, pose)).collect())
}

fn warn_about_ignored_parts(path: &Path, vendor: &VendorRecording) {
    let contents = &vendor.contents;
    if contents.has_more() {
        log::warn!(
            "{} has {} sessions, {} groups and {} sensors in the first: the first of each is imported",
            path.display(),
            contents.sessions,
            contents.groups,
            contents.sensors
        );
    }
}

/// Warns of frames that the writer could not finish.
fn warn_if_unfinished(path: &Path, vendor: &VendorRecording) {
    let Some(unfinished) = &vendor.unfinished else { return };
    let Unfinished { not_closed, incomplete_frames, unindexed_bytes } = *unfinished;
    let what = if not_closed { "was not closed by its writer" } else { "ends within a frame" };
    let mut text = format!("{} {what}: {} frames recovered", path.display(), vendor.frames.len());
    if incomplete_frames > 0 {
        text += &format!(", {incomplete_frames} incomplete ones left out");
    }
    if unindexed_bytes > 0 {
        text += &format!(", {unindexed_bytes} bytes written after the last flush lost");
    }
    log::warn!("{text}");
}

/// Warns of the usual mistake: a track whose times do not start at the first tick.
fn warn_if_no_overlap(frames: &[Frame], poses: &[PoseSample]) {
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

#[cfg(test)]
mod tests {
    use a121::preset;
    use a121::vendor_h5::Contents;
    use glam::{DQuat, DVec3};

    use super::super::test_files::{TestFile, assert_same, events, real_recording};
    use super::super::{Recording, RecordingSummary};
    use super::*;

    fn frames(seconds: i64) -> Vec<Frame> {
        events(seconds)
            .into_iter()
            .filter_map(|e| if let Event::Frame(frame) = e { Some(frame) } else { None })
            .collect()
    }

    #[test]
    #[ignore = "needs the vendor's recordings in ../shared/recordings"]
    fn import_with_track_round_trips() {
        let (frames, track) = (real_recording("medium_tank.h5"), real_recording("medium_tank_poses.tum"));
        let imported = import_h5(&frames, Some(&track), &ImportOptions::default()).unwrap();
        assert_eq!(imported.header.source, "import of medium_tank.h5 and medium_tank_poses.tum");
        assert_eq!(imported.header.head_from_sensor, Pose::IDENTITY);
        assert_eq!(imported.header.sensor.board.as_deref(), Some("xm125"));
        assert_eq!(imported.header.sensor.base_step_length_m, Some(0.00250227400101721));
        assert_eq!(imported.header.config.subsweeps[0].start_point, -40);
        assert_eq!(imported.poses.len(), 354);
        assert_eq!((imported.poses[0].time_ns, imported.poses[0].position_m[2]), (5_508_000_000, -0.479641));
        let file = TestFile::new();
        let written = imported.write(&file.0).unwrap();
        let mut recording = Recording::open(&file.0).unwrap();
        let events: Vec<Event> = recording.by_ref().collect();
        assert!(recording.damage().is_none());
        assert_eq!(recording.header(), &imported.header);
        assert_same(&events, &imported.events().collect::<Vec<_>>());
        assert!(events.windows(2).all(|w| w[0].time_ns() <= w[1].time_ns()));
        assert_eq!(written, RecordingSummary::read(&file.0).unwrap());
    }

    #[test]
    fn sensor_at_rest_gets_poses_beyond_all_its_frames() {
        let at = |seconds: f64| Frame { host_time_ns: (seconds * 1e9) as i64, ..frames(1).remove(0) };
        let vendor = |frames| VendorRecording {
            config: preset("c16").unwrap(),
            ticks_per_second: 1000,
            base_step_length_m: None,
            board: None,
            rss_version: None,
            frames,
            contents: Contents { sessions: 1, groups: 1, sensors: 1 },
            unfinished: None,
        };
        let pose = Pose::new(DVec3::new(0.0, 1.6, 0.0), DQuat::from_rotation_y(0.3));
        let path = Path::new("frames.h5");
        let track = track_at_rest(path, &vendor(vec![at(0.0), at(2.0)]), &pose).unwrap();
        assert!(track[0].time_ns <= -500_000_000 && track.last().unwrap().time_ns > 2_490_000_000);
        assert!(track.windows(2).all(|pair| pair[1].time_ns - pair[0].time_ns == 10_000_000));
        assert!(track.iter().all(|sample| *sample == PoseSample::valid(sample.time_ns, &pose)));
        assert!(track_at_rest(path, &vendor(vec![]), &pose).unwrap().is_empty());
        // Ticks are untrusted.
        for end_s in [86_401.0, 9e9, -9e9] {
            let error = track_at_rest(path, &vendor(vec![at(0.0), at(end_s)]), &pose).unwrap_err().to_string();
            assert!(error.starts_with("frames.h5 lasts "), "{error}");
        }
    }

    #[test]
    #[ignore = "needs the vendor's recordings in ../shared/recordings"]
    fn invalid_track_line_is_named() {
        let frames = real_recording("input.h5");
        let track = TestFile::with(b"# head\n\n0.1 0 0 0 0 0 0 1\n0.2 0 0\n");
        let error = import_h5(&frames, Some(&track.0), &ImportOptions::default()).unwrap_err().to_string();
        assert!(error.contains(", line 4: 3 columns instead of 8"), "{error}");
    }
}
