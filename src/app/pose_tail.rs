//! Reads a pose track (TUM, or CSV by the file's extension) while another program writes it. Times
//! are of the host's monotonic clock.
//!
//! Memory holds one line and the result of one call. A missing file is waited for; a truncated one
//! is read from the start, and of one that another program has replaced by a rename the new one is
//! read, each without the poses that are already known. A line counts once its end has been written.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use radar_recording::{MAX_TRACK_LINE_BYTES, TrackFormat, TrackParser};
use radar_sar::PoseSample;

use super::host_clock::CLOCK_NAME;
use super::platform::file_identity;

/// Bytes read per call. Choice: a second of poses at 1 kHz takes some 100 kB of text, so each call
/// catches up.
const READ_BYTES: usize = 1 << 18;
/// Bytes before the place read to that a replacement must share to be a longer copy. Choice: dozens
/// of lines, each with its time.
const SHARED_BYTES: u64 = 4096;
/// How far the newest pose may be from now, nanoseconds. Choice: writers flush several times a second,
/// and clocks with another origin differ by hours.
const MAX_POSE_AGE_NS: i64 = 5_000_000_000;

/// Counters of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PoseTailCounters {
    /// Poses returned.
    pub poses: u64,
    /// Lines that are not a pose.
    pub bad_lines: u64,
    /// Poses from before the recording's start.
    pub before_start: u64,
    /// How often the file was truncated or replaced by another one and read from the start.
    pub restarts: u64,
    /// Time of the newest pose, host nanoseconds.
    pub newest_ns: Option<i64>,
}

/// Reads what is appended to a track; see the module documentation.
pub struct PoseTail {
    path: PathBuf,
    start_ns: i64,
    file: Option<File>,
    at_byte: u64,
    is_at_end: bool,
    bytes: Vec<u8>,
    line: Vec<u8>,
    is_too_long: bool,
    parser: TrackParser,
    counters: PoseTailCounters,
    /// Newest pose before the last restart: up to it the file repeats what is known.
    known_until_ns: Option<i64>,
    /// Whether a pose has been near its time.
    was_current: bool,
    has_warned: bool,
}

impl PoseTail {
    /// Follows a file; poses before `start_ns` are ignored.
    pub fn new(path: &Path, start_ns: i64) -> Self {
        Self {
            path: path.to_owned(),
            start_ns,
            file: None,
            at_byte: 0,
            is_at_end: false,
            bytes: vec![0; READ_BYTES],
            line: Vec::new(),
            is_too_long: false,
            parser: TrackParser::new(TrackFormat::of(path)),
            counters: PoseTailCounters::default(),
            known_until_ns: None,
            was_current: false,
            has_warned: false,
        }
    }

    /// Counters so far.
    pub fn counters(&self) -> PoseTailCounters {
        self.counters
    }

    /// Whether the file exists.
    pub fn is_open(&self) -> bool {
        self.file.is_some()
    }

    /// Poses appended since the last call; only some of them when there are many.
    pub fn read(&mut self) -> Vec<PoseSample> {
        let mut bytes = std::mem::take(&mut self.bytes);
        let count = self.read_bytes(&mut bytes).unwrap_or(0);
        self.is_at_end = count < bytes.len();
        let mut poses = Vec::new();
        for &byte in &bytes[..count] {
            match byte {
                b'\n' => self.end_line(&mut poses),
                _ if self.line.len() >= MAX_TRACK_LINE_BYTES => self.is_too_long = true,
                _ => self.line.push(byte),
            }
        }
        self.bytes = bytes;
        poses
    }

    /// A warning where the newest pose is far from now, at a host time: once until a pose is near again.
    pub fn warning(&mut self, now_ns: i64) -> Option<String> {
        let newest_ns = self.counters.newest_ns;
        let age_ns = now_ns.saturating_sub(newest_ns.unwrap_or(self.start_ns));
        if age_ns.saturating_abs() <= MAX_POSE_AGE_NS {
            self.was_current |= newest_ns.is_some();
            self.has_warned = false;
            return None;
        }
        if !self.is_at_end || std::mem::replace(&mut self.has_warned, true) {
            return None;
        }
        let (path, age_s) = (self.path.display(), age_ns as f64 * 1e-9);
        Some(match newest_ns {
            None if self.file.is_none() => {
                format!("there is no track {path} after {age_s:.1} s: check its path and the program that writes it")
            }
            None => format!(
                "the track {path} has no pose after {age_s:.1} s, and {} invalid lines: check the program that writes it",
                self.counters.bad_lines
            ),
            Some(_) if self.was_current => format!(
                "the newest pose of the track {path} is {age_s:.1} s old: check that the program that writes it still tracks, and \
                 writes to this file"
            ),
            Some(_) => format!(
                "the newest pose of the track is {age_s:.1} s away from now: its times must be seconds of this computer's \
                 monotonic clock ({CLOCK_NAME}), now {:.3}",
                now_ns as f64 * 1e-9
            ),
        })
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.file.is_none() {
            self.file = open_if_file(&self.path)?;
        }
        let Some(file) = &self.file else { return Ok(0) };
        if file.metadata()?.len() < self.at_byte {
            self.restart();
        }
        let count = self.read_on(bytes)?;
        // The old file is read to its end first.
        if count == 0 && self.follow_replacement()? { self.read_on(bytes) } else { Ok(count) }
    }

    fn read_on(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let Some(file) = &mut self.file else { return Ok(0) };
        file.seek(SeekFrom::Start(self.at_byte))?;
        let count = file.read(bytes)?;
        self.at_byte += count as u64;
        Ok(count)
    }

    /// Opens the file that has taken the place of the one that is read; returns whether there is one. A longer copy is read on
    /// from the same byte: programs that write the whole track again and again would keep this one from catching up.
    fn follow_replacement(&mut self) -> io::Result<bool> {
        let (Some(old), Some(new)) = (&self.file, open_if_file(&self.path)?) else { return Ok(false) };
        if file_identity(old)? == file_identity(&new)? {
            return Ok(false);
        }
        if bytes_before(old, self.at_byte)? != bytes_before(&new, self.at_byte)? {
            self.restart();
        }
        self.file = Some(new);
        Ok(true)
    }

    /// Begins again at the start of the file.
    fn restart(&mut self) {
        self.at_byte = 0;
        self.is_too_long = false;
        self.parser = TrackParser::new(TrackFormat::of(&self.path));
        self.line.clear();
        self.counters.restarts += 1;
        // What is far from now is known by a wrong clock, or one wrong line.
        if std::mem::take(&mut self.has_warned) {
            self.counters.newest_ns = None;
        }
        self.known_until_ns = self.counters.newest_ns;
    }

    fn end_line(&mut self, poses: &mut Vec<PoseSample>) {
        let line = std::mem::take(&mut self.line);
        let is_too_long = std::mem::take(&mut self.is_too_long);
        let text = std::str::from_utf8(&line).ok().filter(|_| !is_too_long);
        match text.map(|text| self.parser.line(text)) {
            Some(Ok(None)) => {}
            Some(Ok(Some(pose))) if self.known_until_ns.is_some_and(|known_ns| pose.time_ns <= known_ns) => {}
            Some(Ok(Some(pose))) => {
                self.counters.newest_ns = self.counters.newest_ns.max(Some(pose.time_ns));
                let is_before = pose.time_ns < self.start_ns;
                let counter = if is_before { &mut self.counters.before_start } else { &mut self.counters.poses };
                *counter += 1;
                poses.extend((!is_before).then_some(pose));
            }
            // Before the first new pose invalid lines are known as well.
            Some(Err(_)) | None => {
                let is_known = self.known_until_ns.is_some() && self.known_until_ns == self.counters.newest_ns;
                self.counters.bad_lines += u64::from(!is_known);
            }
        }
    }
}

/// Opens a file if there is one. Opening a pipe would block until another program writes to it.
fn open_if_file(path: &Path) -> io::Result<Option<File>> {
    let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
    if is_file { File::open(path).map(Some) } else { Ok(None) }
}

/// The last bytes before a place, fewer where the file ends before it.
fn bytes_before(mut file: &File, at_byte: u64) -> io::Result<Vec<u8>> {
    let count = at_byte.min(SHARED_BYTES);
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(at_byte - count))?;
    file.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_growing_track_is_read_line_by_line() {
        let path = std::env::temp_dir().join(format!("radar-chaperone-tail-{}.tum", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let mut tail = PoseTail::new(&path, 2_000_000_000);
        assert!(tail.read().is_empty() && !tail.is_open());
        let mut file = File::create(&path).unwrap();
        let mut write = |text: &str| file.write_all(text.as_bytes()).unwrap();
        let times = |poses: Vec<PoseSample>| poses.iter().map(|pose| pose.time_ns / 1_000_000).collect::<Vec<_>>();
        write("# time tx ty tz qx qy qz qw\n1.5 0 0 0 0 0 0 1\n2.5 0 0 0 0 0 0 1\n3.5 0 0 0 0 0");
        assert_eq!(times(tail.read()), [2500]);
        assert!(tail.read().is_empty() && tail.is_open());
        write(" 0 1\nnonsense\n");
        write(&"x".repeat(3 * MAX_TRACK_LINE_BYTES));
        write("\n4 0 0 0 0 0 0 1\n");
        assert_eq!(times(tail.read()), [3500, 4000]);
        assert_eq!((tail.counters().bad_lines, tail.counters().before_start, tail.counters().poses), (2, 1, 3));
        std::fs::write(&path, "5 0 0 0 0 0 0 1\n").unwrap();
        assert_eq!((times(tail.read()), tail.counters().restarts), (vec![5000], 1));
        std::fs::remove_file(&path).unwrap();
    }

    /// A track whose file is replaced by a rename.
    struct Replaced {
        path: PathBuf,
        tail: PoseTail,
    }

    impl Replaced {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("radar-chaperone-{name}-{}.tum", std::process::id()));
            Self { tail: PoseTail::new(&path, 0), path }
        }

        fn replace(&self, times_s: std::ops::Range<i64>, end: &str) {
            let beside = self.path.with_extension("tmp");
            let lines: String = times_s.map(|s| format!("{s} 0 0 0 0 0 0 1\n")).collect();
            std::fs::write(&beside, lines + end).unwrap();
            std::fs::rename(&beside, &self.path).unwrap();
        }

        fn read_s(&mut self) -> Vec<i64> {
            self.tail.read().iter().map(|pose| pose.time_ns / 1_000_000_000).collect()
        }
    }

    impl Drop for Replaced {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.path);
        }
    }

    #[test]
    fn longer_copy_of_the_track_is_read_on() {
        let mut track = Replaced::new("copy");
        track.replace(1..3, "nonsense\n3 0 0 0 0");
        assert_eq!(track.read_s(), [1, 2]);
        assert!(track.read_s().is_empty());
        track.replace(1..3, "nonsense\n3 0 0 0 0 0 0 1\n4 0 0");
        assert_eq!(track.read_s(), [3]);
        track.replace(1..3, "nonsense\n3 0 0 0 0 0 0 1\n4 0 0 0 0 0 0 1\n");
        assert_eq!(track.read_s(), [4]);
        assert_eq!((track.tail.counters().bad_lines, track.tail.counters().restarts), (1, 0));
    }

    #[test]
    fn other_file_in_the_tracks_place_adds_its_new_poses() {
        let mut track = Replaced::new("other");
        track.replace(1..4, "");
        assert_eq!(track.read_s(), [1, 2, 3]);
        // Written after the last read, before the file is replaced.
        File::options().append(true).open(&track.path).unwrap().write_all(b"4 0 0 0 0 0 0 1\n5 0").unwrap();
        track.replace(3..8, "nonsense\n");
        assert_eq!(track.read_s(), [4]);
        assert_eq!(track.read_s(), [5, 6, 7]);
        std::fs::remove_file(&track.path).unwrap();
        assert!(track.read_s().is_empty());
        track.replace(6..9, "nonsense\n");
        assert_eq!(track.read_s(), [8]);
        let PoseTailCounters { poses, bad_lines, restarts, .. } = track.tail.counters();
        assert_eq!((poses, bad_lines, restarts), (8, 2, 2));
    }

    #[test]
    fn track_whose_newest_pose_is_old_is_reported_once() {
        let mut track = Replaced::new("old");
        let warning = |track: &mut Replaced, now_s: i64| {
            track.tail.read();
            track.tail.warning(now_s * 1_000_000_000)
        };
        assert_eq!(warning(&mut track, 4), None);
        assert!(warning(&mut track, 7).unwrap().contains("there is no track"));
        track.replace(0..0, "nonsense\n");
        track.tail.has_warned = false;
        assert!(warning(&mut track, 8).unwrap().contains("no pose after 8.0 s, and 1 invalid lines"));
        track.replace(1..2, "");
        track.tail.has_warned = false;
        assert!(warning(&mut track, 101).unwrap().contains("100.0 s away from now: its times must be"));
        track.replace(1..102, "");
        assert_eq!(warning(&mut track, 103), None);
        // Times of another clock do not make those of the right one old.
        track.replace(1_700_000_000..1_700_000_001, "");
        assert!(warning(&mut track, 104).is_some());
        track.replace(103..105, "");
        assert_eq!((track.read_s(), track.tail.warning(105_000_000_000)), (vec![103, 104], None));
        assert!(warning(&mut track, 110).unwrap().contains("is 6.0 s old: check that the program"));
        assert_eq!(warning(&mut track, 111), None);
        track.replace(1..113, "");
        assert_eq!(warning(&mut track, 112), None);
        assert!(warning(&mut track, 120).is_some());
    }

    #[test]
    fn growing_csv_is_read_by_column_names() {
        let path = std::env::temp_dir().join(format!("radar-chaperone-tail-{}.csv", std::process::id()));
        let mut tail = PoseTail::new(&path, 0);
        std::fs::write(&path, "time_s,x,y,z,qx,qy,qz,qw\n1,0.5,0,0,0,0,0,1\n2,0,0\n3,1,0,0,0,0,0,1\n").unwrap();
        let x = |poses: Vec<PoseSample>| poses.iter().map(|pose| pose.position_m[0]).collect::<Vec<_>>();
        assert_eq!((x(tail.read()), tail.counters().bad_lines), (vec![0.5, 1.0], 1));
        std::fs::write(&path, "qw,qz,qy,qx,z,y,x,t\n1,0,0,0,0,0,7,4\n").unwrap();
        assert_eq!((x(tail.read()), tail.counters().restarts), (vec![7.0], 1));
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn missing_file_is_waited_for() {
        let mut tail = PoseTail::new(&std::env::temp_dir(), 0);
        assert!(tail.read().is_empty() && !tail.is_open());
    }
}
