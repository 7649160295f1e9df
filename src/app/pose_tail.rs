//! Reads a pose track (TUM, or CSV by the file's extension) while another program writes it. Times
//! are of the host's monotonic clock.
//!
//! Memory holds one line and the result of one call. A missing file is waited for; a truncated one
//! is read from the start. A line counts once its end has been written.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use radar_recording::{MAX_TRACK_LINE_BYTES, TrackFormat, TrackParser};
use radar_sar::PoseSample;

/// Bytes read per call. Choice: a second of poses at 1 kHz takes some 100 kB of text, so each call
/// catches up.
const READ_BYTES: usize = 1 << 18;

/// Counters of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PoseTailCounters {
    /// Poses returned.
    pub poses: u64,
    /// Lines that are not a pose.
    pub bad_lines: u64,
    /// Poses from before the recording's start.
    pub before_start: u64,
    /// How often the file was truncated and read from the start.
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
    bytes: Vec<u8>,
    line: Vec<u8>,
    is_too_long: bool,
    parser: TrackParser,
    counters: PoseTailCounters,
}

impl PoseTail {
    /// Follows a file; poses before `start_ns` are ignored.
    pub fn new(path: &Path, start_ns: i64) -> Self {
        Self {
            path: path.to_owned(),
            start_ns,
            file: None,
            at_byte: 0,
            bytes: vec![0; READ_BYTES],
            line: Vec::new(),
            is_too_long: false,
            parser: TrackParser::new(TrackFormat::of(path)),
            counters: PoseTailCounters::default(),
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

    fn read_bytes(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        // Opening a pipe would block until another program writes to it.
        let is_file = std::fs::metadata(&self.path).is_ok_and(|metadata| metadata.is_file());
        if self.file.is_none() && is_file {
            self.file = Some(File::open(&self.path)?);
        }
        let Some(file) = &mut self.file else { return Ok(0) };
        if file.metadata()?.len() < self.at_byte {
            file.seek(SeekFrom::Start(0))?;
            self.at_byte = 0;
            self.counters.restarts += 1;
            self.is_too_long = false;
            self.parser = TrackParser::new(TrackFormat::of(&self.path));
            self.line.clear();
        }
        let count = file.read(bytes)?;
        self.at_byte += count as u64;
        Ok(count)
    }

    fn end_line(&mut self, poses: &mut Vec<PoseSample>) {
        let line = std::mem::take(&mut self.line);
        let is_too_long = std::mem::take(&mut self.is_too_long);
        let text = std::str::from_utf8(&line).ok().filter(|_| !is_too_long);
        match text.map(|text| self.parser.line(text)) {
            Some(Ok(None)) => {}
            Some(Ok(Some(pose))) => {
                self.counters.newest_ns = Some(pose.time_ns);
                let is_before = pose.time_ns < self.start_ns;
                let counter = if is_before { &mut self.counters.before_start } else { &mut self.counters.poses };
                *counter += 1;
                poses.extend((!is_before).then_some(pose));
            }
            Some(Err(_)) | None => self.counters.bad_lines += 1,
        }
    }
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
