//! A point cloud as a binary little-endian .ply with x, y, z (tracking frame, metres) and value: MeshLab, CloudCompare,
//! Blender and Open3D read it.

use std::path::Path;

use glam::DVec3;

use super::{ReportError, write_atomically};

/// The bytes of the file; points with anything that is not finite are left out.
pub fn ply_bytes(points: &[(DVec3, f32)]) -> Vec<u8> {
    let sound = || points.iter().filter(|(place, value)| place.is_finite() && value.is_finite());
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment tracking frame, metres, +y up\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty float value\nend_header\n",
        sound().count()
    );
    let mut bytes = header.into_bytes();
    for (place, value) in sound() {
        let [x, y, z] = place.as_vec3().to_array();
        bytes.extend([x, y, z, *value].into_iter().flat_map(f32::to_le_bytes));
    }
    bytes
}

/// Writes a .ply file.
///
/// # Errors
/// A file that cannot be written.
pub fn write_ply(path: &Path, points: &[(DVec3, f32)]) -> Result<(), ReportError> {
    write_atomically(path, &ply_bytes(points))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_and_points() {
        let points = [(DVec3::new(1.0, -2.0, 0.5), 7.0), (DVec3::NAN, 1.0), (DVec3::ONE, f32::NAN), (DVec3::ZERO, 0.0)];
        let bytes = ply_bytes(&points);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        assert!(header.contains("\nelement vertex 2\n"));
        let values: Vec<f32> =
            bytes[end..].chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        assert_eq!(values, [1.0, -2.0, 0.5, 7.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(ply_bytes(&[]).ends_with(b"end_header\n"));
    }
}
