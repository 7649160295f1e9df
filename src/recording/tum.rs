//! Pose tracks in the TUM format: a line `timestamp_s tx ty tz qx qy qz qw` a pose, `#` begins a comment.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::ImportError;
use crate::tracking::{PoseSample, TrackingResult};

/// Longest file that is read: some 20 hours at 120 Hz.
const MAX_TRACK_BYTES: u64 = 1 << 30;
/// Longest line: eight numbers take less than 200.
const MAX_LINE_BYTES: u64 = 4096;

/// Reads a track. Positions and quaternions that are NaN or zero, and times that run backwards, stay as they are: who uses
/// the poses counts and skips them. A time that is NaN cannot stay: such a pose is marked invalid and given the time of
/// the one before.
///
/// # Errors
/// A file that cannot be read; a line with too few or too many columns, with a word that is no number, or with a time
/// beyond ±292 years.
pub fn read_track(path: &Path) -> Result<Vec<PoseSample>, ImportError> {
    let io_error = |source| ImportError::Io { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(io_error)?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile(path.to_owned()));
    }
    if metadata.len() > MAX_TRACK_BYTES {
        let (bytes, max) = (metadata.len(), MAX_TRACK_BYTES);
        return Err(ImportError::TooBig { path: path.to_owned(), what: "the track".into(), bytes, max });
    }
    let mut input = BufReader::new(File::open(path).map_err(io_error)?).take(MAX_TRACK_BYTES);
    let mut poses: Vec<PoseSample> = Vec::new();
    for line in 1.. {
        let line_error = |reason| ImportError::TrackLine { path: path.to_owned(), line, reason };
        let mut bytes = Vec::new();
        let read = input.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut bytes).map_err(io_error)?;
        if read == 0 {
            break;
        }
        if read as u64 == MAX_LINE_BYTES {
            return Err(line_error(format!("longer than {MAX_LINE_BYTES} bytes")));
        }
        let text = std::str::from_utf8(&bytes).map_err(|_| line_error("not text".into()))?;
        let previous_ns = poses.last().map_or(0, |p| p.time_ns);
        poses.extend(parse_line(text, previous_ns).map_err(line_error)?);
    }
    Ok(poses)
}

/// The pose on a line of a track; `None` for comments and blank lines. A time that is NaN becomes the one before.
///
/// # Errors
/// Why it is none.
pub fn parse_line(line: &str, previous_ns: i64) -> Result<Option<PoseSample>, String> {
    let content = line.trim_start_matches('\u{feff}').split('#').next().unwrap_or_default();
    let words: Vec<&str> = content.split_whitespace().collect();
    if words.is_empty() {
        return Ok(None);
    }
    let words: [&str; 8] =
        words.try_into().map_err(|words: Vec<&str>| format!("{} columns instead of 8", words.len()))?;
    let mut numbers = [0.0f64; 8];
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = word.parse().map_err(|_| format!("{word:?} is not a number"))?;
    }
    let [time_s, x, y, z, qx, qy, qz, qw] = numbers;
    let time_ns = if time_s.is_nan() { previous_ns } else { time_ns(time_s)? };
    Ok(Some(PoseSample {
        time_ns,
        position_m: [x, y, z],
        quaternion_xyzw: [qx, qy, qz, qw],
        valid: !time_s.is_nan(),
        result: TrackingResult::Ok,
    }))
}

fn time_ns(time_s: f64) -> Result<i64, String> {
    let ns = (time_s * 1e9).round();
    if ns.abs() < 9.2e18 { Ok(ns as i64) } else { Err(format!("a time of {time_s} s")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_blank_lines_and_odd_spacing_are_fine() {
        assert_eq!(parse_line("# timestamp_s tx ty tz", 0), Ok(None));
        assert_eq!(parse_line(" \t \r\n", 0), Ok(None));
        let pose = parse_line("5.508\t0 1.5  -0.479641 0 0 0 1 # here\r\n", 0).unwrap().unwrap();
        assert_eq!(pose.time_ns, 5_508_000_000);
        assert_eq!(pose.position_m, [0.0, 1.5, -0.479641]);
        assert_eq!(pose.quaternion_xyzw, [0.0, 0.0, 0.0, 1.0]);
        assert!(pose.valid);
    }

    #[test]
    fn nan_and_zero_stay_for_the_observer_to_count() {
        let pose = parse_line("1 nan 0 0 0 0 0 0", 0).unwrap().unwrap();
        assert!(pose.position_m[0].is_nan() && pose.valid);
        assert_eq!(pose.quaternion_xyzw, [0.0; 4]);
        let pose = parse_line("NaN 0 0 0 0 0 0 1", 77).unwrap().unwrap();
        assert_eq!((pose.time_ns, pose.valid), (77, false));
    }

    #[test]
    fn bad_lines_say_what_is_wrong() {
        assert_eq!(parse_line("1 2 3", 0), Err("3 columns instead of 8".into()));
        assert_eq!(parse_line("1 0 0 zero 0 0 0 1", 0), Err("\"zero\" is not a number".into()));
        assert_eq!(parse_line("1e300 0 0 0 0 0 0 1", 0).unwrap_err(), format!("a time of {} s", 1e300));
    }
}
