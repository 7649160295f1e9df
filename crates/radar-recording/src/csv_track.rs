//! Pose tracks as CSV: a header line with column names, then one pose per line, as robot
//! controllers and trackers export them.
//!
//! Columns, in any order, in upper or lower case (dots and spaces in names count as `_`):
//!
//! - time: `time_s`, `timestamp_s`, `time`, `timestamp` or `t`, in seconds; `time_ms`, `time_us`,
//!   `time_ns`, and the same with `timestamp` or `t`, in that unit.
//! - position: `x`, `y`, `z`, with the prefix `t`, `p`, `pos_`, `position_`, `translation_` or
//!   none; in metres, or with the suffix `_m`, `_cm` or `_mm` in that unit.
//! - rotation: `qx`, `qy`, `qz`, `qw`, or with the prefix `q_`, `quat_`, `quaternion_`, `rotation_`
//!   or `orientation_`.
//! - validity: `valid`, optional: `1`, `0`, `true`, `false`.
//!
//! Other columns are ignored. The separator is a comma, semicolon or tab, whichever is most
//! frequent in the header line. Cells may be quoted, but must not contain the separator. Numbers
//! use a decimal point. `#` starts a comment. Frames are as everywhere: +y up, −z forward. Limit:
//! angles instead of a quaternion are rejected, since the order of their rotations is unknown.

use radar_sar::PoseSample;
use radar_sar::TrackingResult;

use super::track::has_unit_length;
use super::tum::time_ns;

/// Header line for the columns of [`csv_line`].
pub const CSV_HEAD: &str = "time_s,x_m,y_m,z_m,qx,qy,qz,qw,valid";

/// Limit of the number of columns. Choice: more columns mean another kind of file.
const MAX_COLUMNS: usize = 256;
/// Required columns, by their name in messages.
const WANTED: [&str; 8] = ["time", "x", "y", "z", "qx", "qy", "qz", "qw"];
const VALID: usize = WANTED.len();

/// Columns of a track.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Columns {
    separator: char,
    /// Number of columns.
    count: usize,
    /// Index and unit factor of each required column: time, position, quaternion.
    wanted: [(usize, f64); 8],
    valid: Option<usize>,
}

impl Columns {
    /// Parses the header line.
    ///
    /// # Errors
    /// A required column is missing or occurs twice; more than 256 columns.
    pub fn of(line: &str) -> Result<Self, String> {
        let most = [',', ';', '\t'].map(|separator| (line.matches(separator).count(), separator));
        let separator = most.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }).map_or(',', |most| most.1);
        let names: Vec<&str> = line.split(separator).collect();
        if names.len() > MAX_COLUMNS {
            return Err(format!("{} columns, more than {MAX_COLUMNS}", names.len()));
        }
        let mut found: [Option<(usize, f64)>; VALID + 1] = [None; VALID + 1];
        for (column, name) in names.iter().enumerate() {
            let Some((what, unit)) = column_of_name(name) else { continue };
            if found[what].replace((column, unit)).is_some() {
                return Err(format!("the column {} occurs twice", WANTED.get(what).unwrap_or(&"valid")));
            }
        }
        let missing: Vec<&str> = (0..VALID).filter(|&what| found[what].is_none()).map(|what| WANTED[what]).collect();
        if !missing.is_empty() {
            return Err(format!("no column for {}", missing.join(", ")));
        }
        let wanted = std::array::from_fn(|what| found[what].unwrap_or((0, 1.0)));
        Ok(Self { separator, count: names.len(), wanted, valid: found[VALID].map(|(column, _)| column) })
    }

    /// Parses the pose on a line. A NaN time is replaced by the previous time, and the pose is
    /// invalid; so is one whose quaternion does not have length 1.
    ///
    /// # Errors
    /// Why the line is not a pose.
    pub fn pose(&self, line: &str, previous_ns: i64) -> Result<PoseSample, String> {
        let cells = line.split(self.separator).count();
        if cells != self.count {
            return Err(format!("{cells} cells under {} names", self.count));
        }
        let cell = |column: usize| unquote(line.split(self.separator).nth(column).unwrap_or_default());
        let mut numbers = [0.0f64; 8];
        for ((number, (column, unit)), name) in numbers.iter_mut().zip(self.wanted).zip(WANTED) {
            let text = cell(column);
            let value: f64 = text.parse().map_err(|_| match text.is_empty() {
                true => format!("{name} is empty"),
                false => format!("{name}: {text:?} is not a number"),
            })?;
            *number = value * unit;
        }
        let is_valid = match self.valid.map(cell) {
            None => true,
            Some(text) => match text.to_ascii_lowercase().as_str() {
                "1" | "true" => true,
                "0" | "false" => false,
                _ => return Err(format!("valid: {text:?} is neither 1, 0, true nor false")),
            },
        };
        let [time_s, x, y, z, qx, qy, qz, qw] = numbers;
        let is_timed = !time_s.is_nan();
        Ok(PoseSample {
            time_ns: if is_timed { time_ns(time_s)? } else { previous_ns },
            position_m: [x, y, z],
            quaternion_xyzw: [qx, qy, qz, qw],
            valid: is_valid && is_timed && has_unit_length([qx, qy, qz, qw]),
            result: TrackingResult::Ok,
        })
    }
}

/// A pose as a line for [`CSV_HEAD`], without its newline.
pub fn csv_line(pose: &PoseSample) -> String {
    let [x, y, z] = pose.position_m;
    let [qx, qy, qz, qw] = pose.quaternion_xyzw;
    format!("{:.9},{x},{y},{z},{qx},{qy},{qz},{qw},{}", pose.time_ns as f64 * 1e-9, u8::from(pose.valid))
}

/// Strips blanks and quotes.
fn unquote(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell).trim()
}

/// Index in [`WANTED`], or [`VALID`], of a column name, and the factor of its unit to seconds or
/// metres.
fn column_of_name(name: &str) -> Option<(usize, f64)> {
    let name: String = unquote(name)
        .chars()
        .map(|c| if matches!(c, '.' | ' ' | '-') { '_' } else { c.to_ascii_lowercase() })
        .collect();
    if name == "valid" {
        return Some((VALID, 1.0));
    }
    for time in ["timestamp", "time", "t"] {
        if let Some(unit) = name.strip_prefix(time) {
            match unit {
                "" | "_s" => return Some((0, 1.0)),
                "_ms" => return Some((0, 1e-3)),
                "_us" => return Some((0, 1e-6)),
                "_ns" => return Some((0, 1e-9)),
                _ => {}
            }
        }
    }
    for turn in ["quaternion_", "quat_", "orientation_", "rotation_", "q_", "q"] {
        let axis = name.strip_prefix(turn).and_then(|axis| ["x", "y", "z", "w"].iter().position(|a| *a == axis));
        if let Some(axis) = axis {
            return Some((4 + axis, 1.0));
        }
    }
    let (axis_name, unit) = [("_mm", 1e-3), ("_cm", 1e-2), ("_m", 1.0)]
        .into_iter()
        .find_map(|(suffix, unit)| Some((name.strip_suffix(suffix)?, unit)))
        .unwrap_or((&name, 1.0));
    let position_axis = ["position_", "pos_", "translation_", "t", "p", ""].iter().find_map(|before| {
        let axis = axis_name.strip_prefix(before)?;
        ["x", "y", "z"].iter().position(|a| *a == axis)
    });
    position_axis.map(|axis| (1 + axis, unit))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(head: &str, line: &str) -> Result<PoseSample, String> {
        Columns::of(head)?.pose(line, 77)
    }

    #[test]
    fn columns_come_in_any_order_with_many_names_and_units() {
        let plain = read(CSV_HEAD, "5.508,1,2,3,0,0,0,1,1").unwrap();
        assert_eq!((plain.time_ns, plain.position_m, plain.valid), (5_508_000_000, [1.0, 2.0, 3.0], true));
        let other =
            read("QW;qz; qy ;qx;note;Position.Z_mm;pos_y_cm;\"tx\";timestamp_ms", "1;0;0;0;x;3000; 200 ;\"1\";5508")
                .unwrap();
        assert_eq!(other.position_m, plain.position_m);
        assert_eq!((other.time_ns, other.quaternion_xyzw), (plain.time_ns, plain.quaternion_xyzw));
        let tabbed = read(
            "t\tx\ty\tz\torientation.x\torientation.y\torientation.z\torientation.w\tvalid",
            "1\t0\t0\t0\t0\t1\t0\t0\tFalse",
        );
        assert_eq!(tabbed.map(|pose| (pose.quaternion_xyzw, pose.valid)), Ok(([0.0, 1.0, 0.0, 0.0], false)));
        let ns = read("time_ns,x,y,z,qx,qy,qz,qw", "1500000000,0,0,0,0,0,0,1").unwrap();
        assert_eq!(ns.time_ns, 1_500_000_000);
    }

    #[test]
    fn errors_name_the_problem() {
        let error = |head: &str, line: &str| read(head, line).unwrap_err();
        assert_eq!(error("time_s,x,y,roll,pitch,yaw", ""), "no column for z, qx, qy, qz, qw");
        assert_eq!(error("t,x,px,y,z,qx,qy,qz,qw", ""), "the column x occurs twice");
        assert_eq!(error(CSV_HEAD, "1,2,3"), "3 cells under 9 names");
        assert_eq!(error(CSV_HEAD, "1,,0,0,0,0,0,1,1"), "x is empty");
        assert_eq!(error(CSV_HEAD, "1,0,zero,0,0,0,0,1,1"), "y: \"zero\" is not a number");
        assert_eq!(error(CSV_HEAD, "1,0,0,0,0,0,0,1,maybe"), "valid: \"maybe\" is neither 1, 0, true nor false");
        assert!(error(CSV_HEAD, "1e300,0,0,0,0,0,0,1,1").starts_with("a time of"));
        assert!(error(&",".repeat(1000), "").contains("1001 columns"));
    }

    #[test]
    fn nan_positions_are_kept() {
        let pose = read(CSV_HEAD, "nan,nan,0,0,0,0,0,0,1").unwrap();
        assert!(pose.time_ns == 77 && !pose.valid && pose.position_m[0].is_nan());
    }

    proptest! {
        #[test]
        fn written_poses_are_read_back(p in prop::array::uniform3(-1e3..1e3f64), q in prop::array::uniform4(-1.0..1.0f64), ms in 0i64..1_000_000, valid: bool) {
            let q = glam::DQuat::from_array(q).normalize().to_array();
            let pose = PoseSample { time_ns: ms * 1_000_000, position_m: p, quaternion_xyzw: q, valid, result: TrackingResult::Ok };
            prop_assert_eq!(read(CSV_HEAD, &csv_line(&pose)), Ok(pose));
        }

        #[test]
        fn arbitrary_text_does_not_panic(head in ".{0,80}", line in ".{0,80}") {
            let _ = read(&head, &line);
            let _ = read(CSV_HEAD, &line);
        }
    }
}
