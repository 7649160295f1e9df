//! Pose tracks in the TUM format: one pose per line, `timestamp_s tx ty tz qx qy qz qw`; `#` starts
//! a comment.

use radar_sar::PoseSample;
use radar_sar::TrackingResult;

use super::track::has_unit_length;

/// Parses a line of a track; `None` for comments and blank lines. A NaN time is replaced by the
/// previous time, and the pose is invalid; so is one whose quaternion does not have length 1.
///
/// # Errors
/// Why the line is not a pose.
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
        valid: !time_s.is_nan() && has_unit_length([qx, qy, qz, qw]),
        result: TrackingResult::Ok,
    }))
}

/// Converts seconds to nanoseconds.
pub(super) fn time_ns(time_s: f64) -> Result<i64, String> {
    let ns = (time_s * 1e9).round();
    if ns.abs() < 9.2e18 { Ok(ns as i64) } else { Err(format!("a time of {time_s} s")) }
}

/// A pose as a line, without its newline. The format cannot store validity.
pub fn tum_line(pose: &PoseSample) -> String {
    let [x, y, z] = pose.position_m;
    let [qx, qy, qz, qw] = pose.quaternion_xyzw;
    format!("{:.9} {x} {y} {z} {qx} {qy} {qz} {qw}", pose.time_ns as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_blank_lines_and_odd_spacing_are_accepted() {
        assert_eq!(parse_line("# timestamp_s tx ty tz", 0), Ok(None));
        assert_eq!(parse_line(" \t \r\n", 0), Ok(None));
        let pose = parse_line("5.508\t0 1.5  -0.479641 0 0 0 1 # here\r\n", 0).unwrap().unwrap();
        assert_eq!(pose.time_ns, 5_508_000_000);
        assert_eq!(pose.position_m, [0.0, 1.5, -0.479641]);
        assert_eq!(pose.quaternion_xyzw, [0.0, 0.0, 0.0, 1.0]);
        assert!(pose.valid);
    }

    #[test]
    fn nan_and_zero_are_kept() {
        let pose = parse_line("1 nan 0 0 0 0 0 0", 0).unwrap().unwrap();
        assert!(pose.position_m[0].is_nan() && !pose.valid);
        assert_eq!(pose.quaternion_xyzw, [0.0; 4]);
        let pose = parse_line("NaN 0 0 0 0 0 0 1", 77).unwrap().unwrap();
        assert_eq!((pose.time_ns, pose.valid), (77, false));
    }

    #[test]
    fn invalid_lines_give_the_reason() {
        assert_eq!(parse_line("1 2 3", 0), Err("3 columns instead of 8".into()));
        assert_eq!(parse_line("1 0 0 zero 0 0 0 1", 0), Err("\"zero\" is not a number".into()));
        assert_eq!(parse_line("1e300 0 0 0 0 0 0 1", 0).unwrap_err(), format!("a time of {} s", 1e300));
    }
}
