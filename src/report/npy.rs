//! Volumes in NumPy's NPY format 1.0
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>): C-ordered
//! little-endian f32, shape `[z][y][x]`. A .json file beside it gives origin, voxel edge, frame,
//! axis order and units.

use std::fs;
use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value};

use radar_sar::{Statistic, Volume};

use super::{ReportError, write_atomically};

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
/// The data begins at a multiple of this, bytes (NPY format).
const ALIGNMENT: usize = 64;
/// Axes of the array's three indices.
const AXES: [&str; 3] = ["z", "y", "x"];
/// Frame of the coordinates.
const FRAME: &str = "tracking: right-handed, x right, y up, z back, metres";

/// Metadata of a volume, written to its .json file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VolumeInfo {
    /// Name of the statistic: `thesis`, `ls`, …
    pub statistic: String,
    /// Number of voxel updates computed.
    pub updates: u64,
    /// Number of voxel updates of a dense computation over the same box.
    pub dense_updates: u64,
    /// Further entries, appended in the map's order.
    pub extra: Map<String, Value>,
}

#[derive(Serialize)]
struct Header<'a> {
    origin_m: [f64; 3],
    voxel_m: f64,
    shape: [usize; 3],
    axes: [&'static str; 3],
    frame: &'static str,
    statistic: &'a str,
    value_unit: &'static str,
    updates: u64,
    dense_updates: u64,
    #[serde(flatten)]
    extra: &'a Map<String, Value>,
}

/// Writes `path` (.npy) and a .json file of the same name. `origin_m` is the lowest corner of the
/// box (the centre of the first voxel is half a voxel above it); `shape` is `[z, y, x]`.
///
/// # Errors
/// The size does not match the number of values, the origin or voxel edge is not finite, an extra
/// entry has the name of a standard entry, or a file cannot be written.
pub fn write_volume(path: &Path, volume: &Volume, info: &VolumeInfo) -> Result<(), ReportError> {
    let [npy, json] = volume_bytes(volume, info)?;
    write_atomically(path, &npy)?;
    write_atomically(&path.with_extension("json"), &json)
}

/// The bytes of both files, the .npy first.
///
/// # Errors
/// As [`write_volume`], except for file errors.
pub fn volume_bytes(volume: &Volume, info: &VolumeInfo) -> Result<[Vec<u8>; 2], ReportError> {
    Ok([npy_bytes(volume)?, header_bytes(volume, info)?])
}

/// Reads both files. `extra` receives the entries for which [`VolumeInfo`] has no field.
///
/// # Errors
/// A file cannot be read, or is not in the format of [`write_volume`].
pub fn read_volume(path: &Path) -> Result<(Volume, VolumeInfo), ReportError> {
    let read = |path: &Path| fs::read(path).map_err(|source| ReportError::File { path: path.to_owned(), source });
    volume_of(&read(path)?, &read(&path.with_extension("json"))?, path)
}

/// Parses the bytes of both files. `path` is named in errors.
///
/// # Errors
/// The bytes are not in the format of [`volume_bytes`].
pub fn volume_of(npy: &[u8], json: &[u8], path: &Path) -> Result<(Volume, VolumeInfo), ReportError> {
    let wrong = |reason: &str| ReportError::NotNpy { path: path.to_owned(), reason: reason.to_owned() };
    let ([z, y, x], values) = parse(npy).map_err(wrong)?;
    let beside = path.with_extension("json");
    let not_json = |source| ReportError::Json { path: beside.clone(), source };
    let mut entries: Map<String, Value> = serde_json::from_slice(json).map_err(not_json)?;
    let mut take = |name: &str| entries.remove(name).unwrap_or_default();
    let origin_m: [f64; 3] = serde_json::from_value(take("origin_m")).map_err(not_json)?;
    let voxel_m = serde_json::from_value(take("voxel_m")).map_err(not_json)?;
    let statistic = serde_json::from_value(take("statistic")).map_err(not_json)?;
    let updates = serde_json::from_value(take("updates")).map_err(not_json)?;
    let dense_updates = serde_json::from_value(take("dense_updates")).map_err(not_json)?;
    if take("shape") != serde_json::json!([z, y, x]) {
        return Err(wrong("its shape is not the one in the .json"));
    }
    // Files of earlier versions lack these entries; the values were the same.
    if ![Value::Null, serde_json::json!(AXES)].contains(&take("axes")) {
        return Err(wrong("its axes are not [z][y][x]"));
    }
    for key in ["frame", "value_unit"] {
        take(key);
    }
    let info = VolumeInfo { statistic, updates, dense_updates, extra: entries };
    Ok((Volume { origin_m: origin_m.into(), voxel_m, size: [x, y, z], values }, info))
}

/// The bytes of the .npy file.
fn npy_bytes(volume: &Volume) -> Result<Vec<u8>, ReportError> {
    let [x, y, z] = volume.size;
    if x * y * z != volume.values.len() {
        return Err(ReportError::VolumeSize { size: volume.size, values: volume.values.len() });
    }
    let mut dictionary = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({z}, {y}, {x}), }}");
    let unpadded = MAGIC.len() + 2 + dictionary.len() + 1;
    dictionary.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(ALIGNMENT) - unpadded));
    dictionary.push('\n');
    let mut bytes = Vec::with_capacity(MAGIC.len() + 2 + dictionary.len() + 4 * volume.values.len());
    bytes.extend(MAGIC);
    bytes.extend((dictionary.len() as u16).to_le_bytes());
    bytes.extend(dictionary.as_bytes());
    bytes.extend(volume.values.iter().flat_map(|value| value.to_le_bytes()));
    Ok(bytes)
}

fn header_bytes(volume: &Volume, info: &VolumeInfo) -> Result<Vec<u8>, ReportError> {
    for value in volume.origin_m.to_array().into_iter().chain([volume.voxel_m]) {
        if !value.is_finite() {
            return Err(ReportError::NotFinite { what: "origin_m or voxel_m".into(), value });
        }
    }
    const OWN: [&str; 9] =
        ["origin_m", "voxel_m", "shape", "axes", "frame", "statistic", "value_unit", "updates", "dense_updates"];
    if let Some(key) = OWN.into_iter().find(|key| info.extra.contains_key(*key)) {
        return Err(ReportError::ExtraKey(key.to_owned()));
    }
    let [x, y, z] = volume.size;
    let header = Header {
        origin_m: volume.origin_m.to_array(),
        voxel_m: volume.voxel_m,
        shape: [z, y, x],
        axes: AXES,
        frame: FRAME,
        statistic: &info.statistic,
        value_unit: info.statistic.parse::<Statistic>().map_or("", Statistic::unit),
        updates: info.updates,
        dense_updates: info.dense_updates,
        extra: &info.extra,
    };
    let mut bytes = serde_json::to_vec_pretty(&header)
        .map_err(|source| ReportError::Json { path: "volume.json".into(), source })?;
    bytes.push(b'\n');
    Ok(bytes)
}

fn parse(bytes: &[u8]) -> Result<([usize; 3], Vec<f32>), &'static str> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("it does not begin as NPY 1.0")?;
    let (length, rest) = rest.split_first_chunk::<2>().ok_or("it ends in its header")?;
    let (header, data) = rest.split_at_checked(u16::from_le_bytes(*length) as usize).ok_or("it ends in its header")?;
    let header = std::str::from_utf8(header).map_err(|_| "its header is not text")?;
    if !(header.contains("'descr': '<f4'") && header.contains("'fortran_order': False")) {
        return Err("its values are not C-ordered little-endian f32");
    }
    let shape = header.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')')).ok_or("it has no shape")?.0;
    let shape: Vec<usize> = shape.split(',').map(str::trim).filter_map(|n| n.parse().ok()).collect();
    let shape: [usize; 3] = shape.try_into().map_err(|_| "its shape has not three numbers")?;
    let wanted = shape.iter().try_fold(4usize, |a, &b| a.checked_mul(b));
    if wanted != Some(data.len()) {
        return Err("its length does not fit its shape");
    }
    let values = data.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]));
    Ok((shape, values.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn volume(size: [usize; 3]) -> Volume {
        let values = (0..size.iter().product::<usize>()).map(|n| n as f32 * 0.5 - 1.0).collect();
        Volume { origin_m: DVec3::new(-1.5, 0.25, -3.0), voxel_m: 0.05, size, values }
    }

    fn folder(name: &str) -> std::path::PathBuf {
        std::env::temp_dir().join(format!("report-npy-{name}-{}", std::process::id()))
    }

    #[test]
    fn npy_header_matches_numpy_and_is_aligned() {
        let bytes = npy_bytes(&volume([4, 3, 2])).unwrap();
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
        let text = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }";
        assert_eq!(&bytes[10..10 + text.len()], text.as_bytes());
        assert!(bytes[10 + text.len()..127].iter().all(|&b| b == b' '));
        assert_eq!(bytes[127], b'\n');
        assert_eq!(bytes.len(), 128 + 4 * 24);
        assert_eq!(bytes[128..136], [0, 0, 0x80, 0xbf, 0, 0, 0, 0xbf]);
    }

    #[test]
    fn volume_files_roundtrip() {
        let path = folder("round").join("a.npy");
        let mut info = VolumeInfo { statistic: "ls".into(), updates: 7, dense_updates: 24, extra: Map::new() };
        info.extra.insert("sweeps".into(), 120.into());
        write_volume(&path, &volume([4, 3, 2]), &info).unwrap();
        assert_eq!(read_volume(&path).unwrap(), (volume([4, 3, 2]), info));
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }

    #[test]
    fn json_describes_the_volume() {
        let info = VolumeInfo { statistic: "ls".into(), ..VolumeInfo::default() };
        let [npy, json] = volume_bytes(&volume([4, 3, 2]), &info).unwrap();
        let sidecar: Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(
            (&sidecar["axes"], &sidecar["shape"]),
            (&serde_json::json!(["z", "y", "x"]), &serde_json::json!([2, 3, 4]))
        );
        assert_eq!(
            (&sidecar["value_unit"], &sidecar["voxel_m"]),
            (&serde_json::json!("LSB²"), &serde_json::json!(0.05))
        );
        // As another reader would compute it: the voxel at [k][j][i] is half a voxel above the
        // corner, and so on.
        let (read, _) = volume_of(&npy, &json, Path::new("v.npy")).unwrap();
        assert!(read.center([0, 0, 0]).distance(DVec3::new(-1.475, 0.275, -2.975)) < 1e-12);
        let turned = String::from_utf8(json).unwrap().replace("\"z\"", "\"x\"");
        assert!(volume_of(&npy, turned.as_bytes(), Path::new("v.npy")).is_err());
    }

    /// NumPy reads what equals its own: length and `zlib.crc32` of what `numpy.save` of NumPy 2.4.6 writes
    /// for `(numpy.arange(24, dtype="<f4") * numpy.float32(0.5) - 1).reshape(2, 3, 4)`.
    #[test]
    fn npy_bytes_equal_those_of_numpy() {
        let bytes = npy_bytes(&volume([4, 3, 2])).unwrap();
        assert_eq!((bytes.len(), crc32fast::hash(&bytes)), (224, 0x1e6b_15fe));
    }

    #[test]
    fn inconsistent_volumes_are_rejected() {
        let path = folder("refused").join("a.npy");
        let wrong_size = Volume { size: [9, 9, 9], ..volume([4, 3, 2]) };
        let nowhere = Volume { origin_m: DVec3::NAN, ..volume([4, 3, 2]) };
        let info = VolumeInfo::default();
        assert!(matches!(write_volume(&path, &wrong_size, &info), Err(ReportError::VolumeSize { values: 24, .. })));
        assert!(matches!(write_volume(&path, &nowhere, &info), Err(ReportError::NotFinite { .. })));
        let mut hiding = VolumeInfo::default();
        hiding.extra.insert("shape".into(), Value::Null);
        assert!(matches!(write_volume(&path, &volume([4, 3, 2]), &hiding), Err(ReportError::ExtraKey(_))));
        assert!(!path.exists());
    }

    proptest! {
        #[test]
        fn volume_bytes_roundtrip(x in 0usize..6, y in 0usize..6, z in 0usize..300) {
            let volume = volume([x, y, z]);
            let bytes = npy_bytes(&volume).unwrap();
            prop_assert_eq!((bytes.len() - 4 * x * y * z) % ALIGNMENT, 0);
            prop_assert_eq!(parse(&bytes).unwrap(), ([z, y, x], volume.values));
        }

        #[test]
        fn garbage_is_rejected_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), keep in any::<bool>()) {
            let bytes = if keep { [MAGIC, &bytes].concat() } else { bytes };
            prop_assert!(parse(&bytes).is_err());
        }
    }
}
