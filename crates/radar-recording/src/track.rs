//! Pose tracks of any tracker, headset or robot arm: TUM, or CSV by the file extension. Read line
//! by line, from a complete file or while another program writes it.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Take};
use std::path::{Path, PathBuf};

use super::ImportError;
use super::csv_track::{CSV_HEAD, Columns, csv_line};
use super::tum::{parse_line, tum_line};
use glam::DQuat;
use radar_sar::PoseSample;

/// Limit of a file's size, bytes. Choice: about 20 hours at 120 Hz.
const MAX_TRACK_BYTES: u64 = 1 << 30;
/// Limit of a line's length, bytes. Choice: eight numbers take less than 200, and CSV may have
/// other columns.
pub const MAX_TRACK_LINE_BYTES: usize = 4096;

/// How far the length of a quaternion may be from 1. Choice: three decimals, the fewest that tools write (the data sets of TUM have
/// four), give at most 0.001 when rounded and 0.002 when cut. Farther off, a number has lost digits.
const MAX_LENGTH_ERROR: f64 = 0.002;

/// Whether a quaternion of a track is a rotation, up to the digits that were written.
pub(super) fn has_unit_length(quaternion_xyzw: [f64; 4]) -> bool {
    (DQuat::from_array(quaternion_xyzw).length() - 1.0).abs() <= MAX_LENGTH_ERROR
}

/// Format of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackFormat {
    /// One pose per line: `timestamp_s tx ty tz qx qy qz qw`.
    Tum,
    /// A header line, then one pose per line; see `csv_track`.
    Csv,
}

impl TrackFormat {
    /// CSV if the name ends in `.csv`, else TUM.
    pub fn of(path: &Path) -> Self {
        let is_csv = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        if is_csv { Self::Csv } else { Self::Tum }
    }

    /// Example of a line, for messages.
    fn example_line(self) -> &'static str {
        match self {
            Self::Tum => "a line is `timestamp_s tx ty tz qx qy qz qw`",
            Self::Csv => "the first line names the columns, such as `time_s,x_m,y_m,z_m,qx,qy,qz,qw`",
        }
    }

    /// Writes poses as a track.
    pub fn write(self, poses: &[PoseSample]) -> String {
        let (head, line): (&str, fn(&PoseSample) -> String) = match self {
            Self::Tum => ("# timestamp_s tx ty tz qx qy qz qw", tum_line),
            Self::Csv => (CSV_HEAD, csv_line),
        };
        let mut text = format!("{head}\n");
        poses.iter().for_each(|pose| text += &format!("{}\n", line(pose)));
        text
    }
}

/// Parser of a track, line by line.
#[derive(Debug, Clone)]
pub struct TrackParser {
    format: TrackFormat,
    columns: Option<Columns>,
    previous_ns: i64,
}

impl TrackParser {
    /// A parser at the start of a track.
    pub fn new(format: TrackFormat) -> Self {
        Self { format, columns: None, previous_ns: 0 }
    }

    /// Parses the next line; `None` for comments, blank lines and the header line. A NaN time is
    /// replaced by the previous time, and the pose is invalid; so is one whose quaternion does not
    /// have length 1.
    ///
    /// # Errors
    /// Why the line is not a pose.
    pub fn line(&mut self, line: &str) -> Result<Option<PoseSample>, String> {
        let pose = match self.format {
            TrackFormat::Tum => parse_line(line, self.previous_ns)?,
            TrackFormat::Csv => {
                let content = line.trim_start_matches('\u{feff}').split('#').next().unwrap_or_default();
                let content = content.trim_end_matches(['\r', '\n']);
                match &self.columns {
                    _ if content.trim().is_empty() => None,
                    Some(columns) => Some(columns.pose(content, self.previous_ns)?),
                    None => {
                        self.columns = Some(Columns::of(content)?);
                        None
                    }
                }
            }
        };
        self.previous_ns = pose.map_or(self.previous_ns, |pose| pose.time_ns);
        Ok(pose)
    }
}

/// Reads a track. NaN positions and times that run backwards are kept: the user of the poses counts
/// and skips them. A NaN time is replaced by the previous time and the pose is marked invalid; so is
/// one whose quaternion does not have length 1. A pose on a last line without a line end is left out.
///
/// # Errors
/// A file that cannot be read; a line with too few or too many columns, with a word that is not a
/// number, or with a time beyond ±292 years; a CSV whose first line has no column names.
pub fn read_track(path: &Path) -> Result<Vec<PoseSample>, ImportError> {
    TrackFile::open(path)?.collect()
}

/// Reads a track from an open input; `name` is its name in messages.
///
/// # Errors
/// As [`read_track`].
pub fn read_track_from(input: impl BufRead, format: TrackFormat, name: &Path) -> Result<Vec<PoseSample>, ImportError> {
    TrackFile::new(input, format, name).collect()
}

/// The poses of a track, read one after the other, as [`read_track`] does. Nothing follows an error.
pub(super) struct TrackFile<R> {
    input: R,
    name: PathBuf,
    parser: TrackParser,
    /// Lines read so far.
    lines: usize,
    has_poses: bool,
    ended: bool,
}

impl TrackFile<Take<BufReader<File>>> {
    pub fn open(path: &Path) -> Result<Self, ImportError> {
        let io_error = |source| ImportError::Io { path: path.to_owned(), source };
        let metadata = std::fs::metadata(path).map_err(io_error)?;
        if !metadata.is_file() {
            return Err(ImportError::NotAFile(path.to_owned()));
        }
        if metadata.len() > MAX_TRACK_BYTES {
            let (bytes, max) = (metadata.len(), MAX_TRACK_BYTES);
            return Err(ImportError::TooBig { path: path.to_owned(), what: "the track".into(), bytes, max });
        }
        let input = BufReader::new(File::open(path).map_err(io_error)?).take(MAX_TRACK_BYTES);
        Ok(Self::new(input, TrackFormat::of(path), path))
    }
}

impl<R: BufRead> TrackFile<R> {
    fn new(input: R, format: TrackFormat, name: &Path) -> Self {
        Self {
            input,
            name: name.to_owned(),
            parser: TrackParser::new(format),
            lines: 0,
            has_poses: false,
            ended: false,
        }
    }

    /// What the next line says; `None` at the end.
    fn next_line(&mut self) -> Result<Option<Option<PoseSample>>, ImportError> {
        let mut bytes = Vec::new();
        let most = MAX_TRACK_LINE_BYTES as u64;
        let io_error = |source| ImportError::Io { path: self.name.clone(), source };
        let read = self.input.by_ref().take(most).read_until(b'\n', &mut bytes).map_err(io_error)?;
        self.lines += 1;
        if read == 0 {
            return Ok(None);
        }
        if read == MAX_TRACK_LINE_BYTES {
            return Err(self.line_error(format!("longer than {MAX_TRACK_LINE_BYTES} bytes")));
        }
        let text = std::str::from_utf8(&bytes).map_err(|_| "not text".into());
        let line = text.and_then(|text| self.parser.line(text));
        // Whether a number lacks digits cannot be seen.
        if !bytes.ends_with(b"\n") && line.as_ref().map_or(self.has_poses, Option::is_some) {
            log::warn!(
                "{}, line {}: the track ends without a line end, so its last line may be cut, and its pose is left out; if it is \
                 whole, end it with a newline",
                self.name.display(),
                self.lines
            );
            return Ok(None);
        }
        self.has_poses |= matches!(line, Ok(Some(_)));
        line.map(Some).map_err(|reason| self.line_error(reason))
    }

    fn line_error(&self, reason: String) -> ImportError {
        let example = self.parser.format.example_line();
        ImportError::TrackLine { path: self.name.clone(), line: self.lines, reason, example }
    }
}

impl<R: BufRead> Iterator for TrackFile<R> {
    type Item = Result<PoseSample, ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            match self.next_line() {
                Ok(Some(None)) => {}
                Ok(Some(Some(pose))) => return Some(Ok(pose)),
                Ok(None) => self.ended = true,
                Err(error) => {
                    self.ended = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::geometry::Pose;

    fn read(text: &str, format: TrackFormat) -> Result<Vec<PoseSample>, String> {
        read_track_from(text.as_bytes(), format, Path::new("track")).map_err(|error| error.to_string())
    }

    #[test]
    fn both_formats_round_trip() {
        let pose = |n: i64| PoseSample::valid(n * 8_000_000, &Pose::from_translation(glam::DVec3::X * 0.1 * n as f64));
        let poses: Vec<PoseSample> = (0..5).map(pose).collect();
        for format in [TrackFormat::Tum, TrackFormat::Csv] {
            assert_eq!(read(&format.write(&poses), format), Ok(poses.clone()));
        }
        assert_eq!(TrackFormat::of(Path::new("a/arm.CSV")), TrackFormat::Csv);
        assert_eq!(TrackFormat::of(Path::new("head.tum")), TrackFormat::Tum);
    }

    #[test]
    fn pose_on_a_cut_last_line_is_left_out() {
        let times = |text: &str, format| {
            read(text, format).map(|poses| poses.iter().map(|pose| pose.time_ns / 1_000_000).collect::<Vec<_>>())
        };
        let tum = "1 0 0 0 0 0 0.7071068 0.7071068\n2 0 0 0 0 0 0.7071068 0.7071068";
        for cut in tum.find('\n').unwrap() + 2..=tum.len() {
            assert_eq!(times(&tum[..cut], TrackFormat::Tum), Ok(vec![1000]), "{}", &tum[..cut]);
        }
        assert_eq!(times(&format!("{tum}\n# the end"), TrackFormat::Tum), Ok(vec![1000, 2000]));
        let csv = "qx,qy,qz,qw,x,y,z,t\n0,0,0,1,0,0,0,1\n0,0,0,1,0,0,0,2.5";
        assert_eq!(times(csv, TrackFormat::Csv), Ok(vec![1000]));
        // Nothing in it shows that it is a track.
        assert!(read("nonsense", TrackFormat::Tum).is_err());
    }

    #[test]
    fn quaternion_of_another_length_costs_its_pose() {
        let valid = |text: &str, format| read(text, format).unwrap().iter().map(|pose| pose.valid).collect::<Vec<_>>();
        // With four decimals, with three that were cut, with two, and without the last number's digits.
        let turns = ["0.6132 0.5962 -0.3311 -0.3986", "0 0 0.707 0.707", "0 0 0.70 0.70", "0 0 0.7071068 0", "0 0 0 2"];
        let expected = [true, true, false, false, false];
        let tum: String = turns.map(|turn| format!("1 0 0 0 {turn}\n")).concat();
        assert_eq!(valid(&tum, TrackFormat::Tum), expected);
        let csv = turns.map(|turn| format!("{},1,0,0,0\n", turn.replace(' ', ","))).concat();
        assert_eq!(valid(&format!("qx,qy,qz,qw,t,x,y,z\n{csv}"), TrackFormat::Csv), expected);
    }

    #[test]
    fn invalid_csv_line_is_named() {
        let error =
            read("# from a robot\n\ntime_s,x,y,z,qx,qy,qz,qw\r\n0.1,0,0,0,0,0,0,1\r\n0.2,0,0\n", TrackFormat::Csv)
                .unwrap_err();
        assert!(error.contains("track, line 5: 3 cells under 8 names") && error.contains("time_s,x_m"), "{error}");
        let error = read("0.1 0 0 0 0 0 0 1\n", TrackFormat::Csv).unwrap_err();
        assert!(error.contains("line 1: no column for time, x"), "{error}");
        assert!(read(&"x".repeat(5000), TrackFormat::Csv).unwrap_err().contains("longer than 4096"));
        assert_eq!(read("", TrackFormat::Csv), Ok(Vec::new()));
    }
}
