//! Imports a recording of the vendor's exploration tool, optionally with a pose track, as a
//! recording of this program.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::track::{TrackFile, has_unit_length};
use super::{Existing, Header, ImportError, RecordingSummary, RecordingWriter, SensorMetadata};
use a121::frame_timing;
use a121::vendor_h5::{Unfinished, VendorRecording};
use radar_mapping::{Event, in_time_order};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;

/// Interval of the poses of a sensor at rest, nanoseconds. Choice: 100 Hz, as of a headset; any
/// below the limit of the settings gives the same.
const STEP_AT_REST_NS: usize = 10_000_000;
/// How far these poses reach beyond the frames, seconds. Choice: the longest smoothing window of the
/// settings.
const MARGIN_AT_REST_S: f64 = 0.5;
/// Longest recording that gets these poses, seconds. Choice: a day; the ticks of a longer one are
/// damaged.
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

/// A recording of the vendor's tool and its poses, opened. Frames and poses are read as they are asked for.
#[derive(Debug)]
pub struct Import {
    /// The header of the recording that it becomes.
    pub header: Header,
    /// The vendor's recording.
    pub vendor: VendorRecording,
    poses: Poses,
}

/// Where the poses come from.
#[derive(Debug)]
enum Poses {
    None,
    Track(PathBuf),
    AtRest { pose: Pose, times_ns: RangeInclusive<i64> },
}

/// Opens the vendor's .h5 for import with, if given, a track with times since the first tick: TUM, or CSV if
/// its name ends in `.csv`. A track has precedence over a fixed pose.
///
/// # Errors
/// A file that is of another format, damaged, too big or breaks a rule of the sensor; a track that cannot be opened.
pub fn import_h5(frames: &Path, poses: Option<&Path>, options: &ImportOptions) -> Result<Import, ImportError> {
    let vendor = VendorRecording::open(frames)?;
    warn_about_ignored_parts(frames, &vendor);
    warn_if_unfinished(frames, &vendor);
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut source = format!("import of {}", name(frames));
    let poses = match (poses, options.fixed_pose) {
        (Some(path), _) => {
            TrackFile::open(path)?;
            source += &format!(" and {}", name(path));
            Poses::Track(path.to_owned())
        }
        (None, Some(pose)) => {
            source += " at a fixed pose";
            let times_ns = times_at_rest(frames, vendor.times_ns(), frame_timing(&vendor.config).frame_period_s)?;
            times_ns.map_or(Poses::None, |times_ns| Poses::AtRest { pose, times_ns })
        }
        (None, None) => Poses::None,
    };
    let mut header = Header::new(source, vendor.config.clone(), options.head_from_sensor);
    header.sensor = SensorMetadata {
        ticks_per_second: Some(vendor.ticks_per_second),
        base_step_length_m: vendor.base_step_length_m,
        board: vendor.board.clone(),
        rss_version: vendor.rss_version.clone(),
    };
    header.settings.clone_from(&options.settings);
    Ok(Import { header, vendor, poses })
}

impl Import {
    /// Poses in the order of the track, valid or not. Nothing follows an error.
    pub fn poses(&self) -> Box<dyn Iterator<Item = Result<PoseSample, ImportError>> + '_> {
        match &self.poses {
            Poses::None => Box::new(std::iter::empty()),
            Poses::Track(path) => match TrackFile::open(path) {
                Ok(track) => Box::new(track),
                Err(error) => Box::new(std::iter::once(Err(error))),
            },
            Poses::AtRest { pose, times_ns } => {
                Box::new(times_ns.clone().step_by(STEP_AT_REST_NS).map(|time_ns| Ok(PoseSample::valid(time_ns, pose))))
            }
        }
    }

    /// Frames and poses by time. Each stream keeps its own order even if its times run backwards. Nothing follows an error.
    pub fn events(&self) -> impl Iterator<Item = Result<Event, ImportError>> {
        let failure = Rc::new(RefCell::new(None));
        let frames = until_failure(self.vendor.frames(), Rc::clone(&failure));
        let poses = until_failure(self.poses(), Rc::clone(&failure));
        let mut events = in_time_order(frames, poses);
        let mut has_failed = false;
        std::iter::from_fn(move || {
            if has_failed {
                return None;
            }
            let event = events.next();
            let error = failure.take();
            has_failed = error.is_some();
            error.map(Err).or(event.map(Ok))
        })
    }

    /// Writes it as a recording.
    ///
    /// # Errors
    /// A damaged place of the frames or the track; an invalid mount; a file that cannot be written.
    pub fn write(&self, path: impl AsRef<Path>, existing: Existing) -> Result<RecordingSummary, ImportError> {
        let mut writer = RecordingWriter::create(path, &self.header, existing)?;
        let (mut frames, mut poses) = (Span::default(), Span::default());
        let mut no_rotations = NoRotations::default();
        for event in self.events() {
            let event = event?;
            match &event {
                Event::Frame(frame) => frames.add(frame.host_time_ns),
                Event::Pose(pose) => {
                    poses.add(pose.time_ns);
                    no_rotations.add(pose);
                }
                Event::Hands(_) => {}
            }
            writer.write(&event)?;
        }
        warn_if_apart(frames, poses);
        no_rotations.warn();
        Ok(writer.finish()?)
    }
}

/// The values up to the first error, which is kept in `failure`.
fn until_failure<T, E: Into<ImportError>>(
    values: impl Iterator<Item = Result<T, E>>,
    failure: Rc<RefCell<Option<ImportError>>>,
) -> impl Iterator<Item = T> {
    values.map_while(move |value| value.map_err(|error| *failure.borrow_mut() = Some(error.into())).ok())
}

/// Times of poses of a sensor at rest: all along the frames, and before and after them as far as their sweeps and the
/// smoothing reach; `None` without frames.
fn times_at_rest(
    path: &Path,
    frame_times_ns: impl Iterator<Item = i64>,
    frame_period_s: f64,
) -> Result<Option<RangeInclusive<i64>>, ImportError> {
    let mut frames = Span::default();
    frame_times_ns.for_each(|time_ns| frames.add(time_ns));
    let Some([first_ns, last_ns]) = frames.0 else { return Ok(None) };
    let span_s = (last_ns as f64 - first_ns as f64) * 1e-9;
    if span_s > MAX_AT_REST_S {
        return Err(ImportError::TooLongAtRest { path: path.to_owned(), span_s, max_s: MAX_AT_REST_S });
    }
    let before_ns = ((frame_period_s + MARGIN_AT_REST_S) * 1e9).round() as i64;
    let after_ns = (MARGIN_AT_REST_S * 1e9).round() as i64;
    Ok(Some(first_ns.saturating_sub(before_ns)..=last_ns.saturating_add(after_ns)))
}

/// First and last of some times, nanoseconds.
#[derive(Debug, Clone, Copy, Default)]
struct Span(Option<[i64; 2]>);

impl Span {
    fn add(&mut self, time_ns: i64) {
        let [first, last] = self.0.unwrap_or([time_ns; 2]);
        self.0 = Some([first.min(time_ns), last.max(time_ns)]);
    }
}

/// Poses whose quaternion does not have length 1.
#[derive(Debug, Default)]
struct NoRotations {
    count: u64,
    first: Option<PoseSample>,
}

impl NoRotations {
    fn add(&mut self, pose: &PoseSample) {
        if !has_unit_length(pose.quaternion_xyzw) {
            self.count += 1;
            self.first.get_or_insert(*pose);
        }
    }

    fn warn(&self) {
        let Some(first) = self.first else { return };
        log::warn!(
            "the quaternions of {} poses do not have length 1 and are not used, the first at {:.3} s with {:?} (x y z w): the track \
             has lost digits, or has other numbers there; export it anew with unit quaternions",
            self.count,
            first.time_ns as f64 * 1e-9,
            first.quaternion_xyzw
        );
    }
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
    let mut text = format!("{} {what}: {} frames recovered", path.display(), vendor.frame_count());
    if incomplete_frames > 0 {
        text += &format!(", {incomplete_frames} incomplete ones left out");
    }
    if unindexed_bytes > 0 {
        text += &format!(", {unindexed_bytes} bytes written after the last flush lost");
    }
    log::warn!("{text}");
}

/// Warns of the usual mistake: a track whose times do not start at the first tick.
fn warn_if_apart(frames: Span, poses: Span) {
    if let (Some(frames), Some(poses)) = (frames.0, poses.0)
        && (poses[1] < frames[0] || poses[0] > frames[1])
    {
        let s = |ns: i64| ns as f64 * 1e-9;
        log::warn!(
            "the track ({:.2} to {:.2} s) lies outside the frames ({:.2} to {:.2} s): its times must be seconds since the \
             recording's first tick",
            s(poses[0]),
            s(poses[1]),
            s(frames[0]),
            s(frames[1])
        );
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::super::test_files::{TestFile, assert_same, real_recording};
    use super::super::{Recording, RecordingSummary};
    use super::*;

    #[test]
    #[ignore = "needs the vendor's recordings in ../shared/recordings"]
    fn import_with_track_round_trips() {
        let (frames, track) = (real_recording("medium_tank.h5"), real_recording("medium_tank_poses.tum"));
        let import = import_h5(&frames, Some(&track), &ImportOptions::default()).unwrap();
        assert_eq!(import.header.source, "import of medium_tank.h5 and medium_tank_poses.tum");
        assert_eq!(import.header.head_from_sensor, Pose::IDENTITY);
        assert_eq!(import.header.sensor.board.as_deref(), Some("xm125"));
        assert_eq!(import.header.sensor.base_step_length_m, Some(0.00250227400101721));
        assert_eq!(import.header.config.subsweeps[0].start_point, -40);
        let poses: Vec<PoseSample> = import.poses().collect::<Result<_, _>>().unwrap();
        assert_eq!(poses.len(), 354);
        assert_eq!((poses[0].time_ns, poses[0].position_m[2]), (5_508_000_000, -0.479641));
        let file = TestFile::new();
        let written = import.write(&file.0, Existing::Replace).unwrap();
        let mut recording = Recording::open(&file.0).unwrap();
        let events: Vec<Event> = recording.by_ref().collect();
        assert!(recording.damage().is_none());
        assert_eq!(recording.header(), &import.header);
        assert_same(&events, &import.events().collect::<Result<Vec<_>, _>>().unwrap());
        assert!(events.windows(2).all(|w| w[0].time_ns() <= w[1].time_ns()));
        assert_eq!(written, RecordingSummary::read(&file.0).unwrap());
    }

    #[test]
    #[ignore = "needs the vendor's recordings in ../shared/recordings"]
    fn sensor_at_rest_gets_poses_all_along() {
        let pose = Pose::new(DVec3::new(0.0, 1.6, 0.0), DQuat::from_rotation_y(0.3));
        let options = ImportOptions { fixed_pose: Some(pose), ..ImportOptions::default() };
        let import = import_h5(&real_recording("input.h5"), None, &options).unwrap();
        let poses: Vec<PoseSample> = import.poses().collect::<Result<_, _>>().unwrap();
        assert!(poses.len() > 100 && poses.windows(2).all(|pair| pair[1].time_ns - pair[0].time_ns == 10_000_000));
        assert!(poses.iter().all(|sample| *sample == PoseSample::valid(sample.time_ns, &pose)));
    }

    #[test]
    fn poses_at_rest_reach_beyond_all_frames() {
        let of = |seconds: &[f64]| {
            let times_ns = seconds.iter().map(|s| (s * 1e9) as i64).collect::<Vec<_>>();
            times_at_rest(Path::new("frames.h5"), times_ns.into_iter(), 0.1)
        };
        assert_eq!(of(&[0.0, 2.0]).unwrap(), Some(-600_000_000..=2_500_000_000));
        assert_eq!(of(&[]).unwrap(), None);
        // Ticks are untrusted.
        for end_s in [86_401.0, 9e9, -9e9] {
            let error = of(&[0.0, end_s]).unwrap_err().to_string();
            assert!(error.starts_with("frames.h5 lasts "), "{error}");
        }
    }

    #[test]
    #[ignore = "needs the vendor's recordings in ../shared/recordings"]
    fn invalid_track_line_is_named_and_nothing_is_written() {
        let frames = real_recording("input.h5");
        let track = TestFile::with(b"# head\n\n0.1 0 0 0 0 0 0 1\n0.2 0 0\n");
        let import = import_h5(&frames, Some(&track.0), &ImportOptions::default()).unwrap();
        let file = TestFile::new();
        let error = import.write(&file.0, Existing::Replace).unwrap_err().to_string();
        assert!(error.contains("line 4: 3 columns instead of 8") && !file.0.exists(), "{error}");
        assert!(matches!(import.events().last(), Some(Err(ImportError::TrackLine { line: 4, .. }))));
    }
}
