//! Point clouds as binary little-endian .ply files, readable by MeshLab, CloudCompare, Blender and
//! Open3D. Each point has x, y, z (tracking frame, metres, f32) and a value. If any point has a
//! covariance, all points have its six independent elements, m²; NaN for points without one.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::{ReportError, write_atomically};

/// A point of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// Position, tracking frame, metres.
    pub position_m: DVec3,
    /// Its score or evidence.
    pub value: f32,
    /// Covariance of the position, m²; `None` for a voxel.
    pub covariance_m2: Option<DMat3>,
}

const PLACE: [&str; 4] = ["x", "y", "z", "value"];
/// Elements of the covariance: name, and row and column.
const COVARIANCE: [(&str, [usize; 2]); 6] = [
    ("cov_xx", [0, 0]),
    ("cov_xy", [0, 1]),
    ("cov_xz", [0, 2]),
    ("cov_yy", [1, 1]),
    ("cov_yz", [1, 2]),
    ("cov_zz", [2, 2]),
];

/// The bytes of a file without covariances. Non-finite points are skipped.
pub fn ply_bytes(points: &[(DVec3, f32)]) -> Vec<u8> {
    let point = |&(position_m, value): &(DVec3, f32)| CloudPoint { position_m, value, covariance_m2: None };
    cloud_bytes(&points.iter().map(point).collect::<Vec<_>>())
}

/// The bytes of a file. Points with a non-finite position or value are skipped.
pub fn cloud_bytes(points: &[CloudPoint]) -> Vec<u8> {
    let sound = || points.iter().filter(|point| point.position_m.is_finite() && point.value.is_finite());
    let has_covariance = points.iter().any(|point| point.covariance_m2.is_some());
    let more = COVARIANCE.iter().map(|(name, _)| *name).filter(|_| has_covariance);
    let properties: String = PLACE.into_iter().chain(more).map(|name| format!("property float {name}\n")).collect();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment tracking frame, metres, +y up\nelement vertex {}\n\
         {properties}end_header\n",
        sound().count()
    );
    let mut bytes = header.into_bytes();
    for point in sound() {
        let [x, y, z] = point.position_m.as_vec3().to_array();
        bytes.extend([x, y, z, point.value].into_iter().flat_map(f32::to_le_bytes));
        if has_covariance {
            let covariance = point.covariance_m2.unwrap_or(DMat3::NAN);
            let elements = COVARIANCE.iter().map(|&(_, [row, column])| covariance.col(column)[row] as f32);
            bytes.extend(elements.flat_map(f32::to_le_bytes));
        }
    }
    bytes
}

/// Writes a .ply file without covariances.
///
/// # Errors
/// The file cannot be written.
pub fn write_ply(path: &Path, points: &[(DVec3, f32)]) -> Result<(), ReportError> {
    write_atomically(path, &ply_bytes(points))
}

/// Parses the bytes of a file. `path` is named in errors.
///
/// # Errors
/// The bytes are not in the format of [`cloud_bytes`].
pub fn cloud_of(bytes: &[u8], path: &Path) -> Result<Vec<CloudPoint>, ReportError> {
    parse(bytes).map_err(|reason| ReportError::NotPly { path: path.to_owned(), reason: reason.to_owned() })
}

fn parse(bytes: &[u8]) -> Result<Vec<CloudPoint>, &'static str> {
    const END: &[u8] = b"end_header\n";
    let end = bytes.windows(END.len()).position(|at| at == END).ok_or("its header has no end")? + END.len();
    let header = std::str::from_utf8(&bytes[..end]).map_err(|_| "its header is not text")?;
    if !header.starts_with("ply\nformat binary_little_endian 1.0\n") {
        return Err("it is no binary little-endian .ply");
    }
    let count = header.lines().find_map(|line| line.strip_prefix("element vertex ")).ok_or("it has no points")?;
    let count: usize = count.trim().parse().map_err(|_| "its number of points is invalid")?;
    let names: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    let whole: Vec<&str> = PLACE.into_iter().chain(COVARIANCE.iter().map(|(name, _)| *name)).collect();
    if names != whole && names != whole[..PLACE.len()] {
        return Err("its properties are not those of this program's clouds");
    }
    let row = 4 * names.len();
    if count.checked_mul(row) != Some(bytes.len() - end) {
        return Err("its length does not fit its number of points");
    }
    let point = |row: &[u8]| {
        let values: Vec<f32> =
            row.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect();
        let mut covariance = DMat3::ZERO;
        for ((_, [row, column]), value) in COVARIANCE.iter().zip(values.iter().skip(PLACE.len())) {
            covariance.col_mut(*column)[*row] = f64::from(*value);
            covariance.col_mut(*row)[*column] = f64::from(*value);
        }
        let has_covariance = values.len() > PLACE.len() && covariance.is_finite();
        CloudPoint {
            position_m: DVec3::new(f64::from(values[0]), f64::from(values[1]), f64::from(values[2])),
            value: values[3],
            covariance_m2: has_covariance.then_some(covariance),
        }
    };
    Ok(bytes[end..].chunks_exact(row).map(point).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn header_and_points() {
        let points = [(DVec3::new(1.0, -2.0, 0.5), 7.0), (DVec3::NAN, 1.0), (DVec3::ONE, f32::NAN), (DVec3::ZERO, 0.0)];
        let bytes = ply_bytes(&points);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        assert!(header.contains("\nelement vertex 2\n") && !header.contains("cov"));
        let values: Vec<f32> =
            bytes[end..].chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        assert_eq!(values, [1.0, -2.0, 0.5, 7.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(ply_bytes(&[]).ends_with(b"end_header\n"));
    }

    #[test]
    fn clouds_roundtrip_with_covariances() {
        let covariance =
            DMat3::from_cols(DVec3::new(0.25, 0.5, -0.125), DVec3::new(0.5, 2.0, 0.75), DVec3::new(-0.125, 0.75, 4.0));
        let known = CloudPoint { position_m: DVec3::new(0.5, 1.5, -2.0), value: 3.0, covariance_m2: Some(covariance) };
        let voxel = CloudPoint { covariance_m2: None, ..known };
        for points in [vec![known, voxel], vec![voxel; 3], vec![]] {
            assert_eq!(cloud_of(&cloud_bytes(&points), Path::new("a.ply")).unwrap(), points);
        }
        let header = String::from_utf8_lossy(&cloud_bytes(&[known])).into_owned();
        assert!(header.contains("property float value\nproperty float cov_xx\nproperty float cov_xy\n"));
    }

    proptest! {
        #[test]
        fn garbage_is_rejected_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), cut in 0usize..200) {
            prop_assert!(parse(&bytes).is_err());
            let whole = ply_bytes(&[(DVec3::ONE, 1.0); 3]);
            prop_assert!(parse(&whole[..cut.min(whole.len() - 1)]).is_err());
            prop_assert!(parse(&[&whole[..], &bytes[..]].concat()).is_err() || bytes.is_empty());
        }
    }
}
