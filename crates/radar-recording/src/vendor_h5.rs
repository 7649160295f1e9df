//! Reads recordings of the vendor's exploration tool (HDF5, A121 generation): first session, first
//! group, first sensor.
//!
//! Layout: `server_info` (JSON); `session` or `sessions/session_0` with `session_config` (JSON) and
//! `group_0/entry_0/{sensor_id, metadata (JSON), result/…}`. `result/` holds `frame` [frame, sweep,
//! point] of {real, imag: i16}, and per frame `tick`, `temperature` and three flags. There are no
//! host times: a frame's time is its tick, counted from the first one.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use hdf5_pure::{Dataset, Datatype, File, VlenStringReadOptions, make_i16_type};
use serde::Deserialize;
use serde_json::Value;

use super::message::complex_from_le_bytes;
use super::{ImportError, SensorMetadata};
use a121::{Frame, SensorConfig};

/// Limit of a file, and of an unpacked data set, bytes. Choice: about 80 minutes of the fastest
/// preset.
const MAX_BYTES: u64 = 1 << 30;
/// Limit of an unpacked chunk of a data set, bytes. Choice: the vendor's have about ten thousand
/// bytes.
const MAX_CHUNK_BYTES: u64 = 64 << 20;
/// Limit of a JSON text, bytes. Choice.
const MAX_TEXT_BYTES: usize = 16 << 20;

/// Content of a file.
#[derive(Debug)]
pub(super) struct VendorRecording {
    pub config: SensorConfig,
    pub sensor: SensorMetadata,
    pub frames: Vec<Frame>,
}

/// The used parts of `server_info`; older files lack some.
#[derive(Deserialize)]
struct ServerInfo {
    ticks_per_second: u32,
    rss_version: Option<String>,
    hardware_name: Option<String>,
}

/// The used part of an entry's `metadata`.
#[derive(Deserialize)]
struct EntryMetadata {
    base_step_length_m: Option<f64>,
}

/// Reads a file.
///
/// # Errors
/// Another kind of file, damaged, too big, or with a configuration that breaks a rule of the
/// sensor.
pub(super) fn read(path: &Path) -> Result<VendorRecording, ImportError> {
    let io_error = |source| ImportError::Io { path: path.to_owned(), source };
    let metadata = std::fs::metadata(path).map_err(io_error)?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile(path.to_owned()));
    }
    too_big_unless(metadata.len() <= MAX_BYTES, path, "the file", metadata.len(), MAX_BYTES)?;
    // Read here, to separate errors of the system from errors of the parser.
    let bytes = std::fs::read(path).map_err(io_error)?;
    // The file is untrusted and the parser is a third-party crate: a panic in it counts as an
    // unreadable file.
    catch_unwind(AssertUnwindSafe(|| Reader::open(path, bytes)?.read())).unwrap_or_else(|_| {
        Err(ImportError::Hdf5 { path: path.to_owned(), at: "/".into(), reason: "the HDF5 reader gave up".into() })
    })
}

struct Reader<'a> {
    path: &'a Path,
    file: File,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, bytes: Vec<u8>) -> Result<Self, ImportError> {
        match File::from_bytes(bytes) {
            Ok(file) => Ok(Self { path, file }),
            Err(error) => Err(hdf5_error(path, "/", error)),
        }
    }

    fn read(&self) -> Result<VendorRecording, ImportError> {
        let session = self.session()?;
        self.warn_about_ignored_parts(session);
        let server: ServerInfo = self.json("server_info")?;
        if server.ticks_per_second == 0 {
            return Err(self.layout("server_info", "has 0 ticks_per_second"));
        }
        let entry = format!("{session}/group_0/entry_0");
        let metadata: EntryMetadata = self.json(&format!("{entry}/metadata"))?;
        let config = self.config(&format!("{session}/session_config"), &format!("{entry}/sensor_id"))?;
        let frames = self.frames(&format!("{entry}/result"), &config, server.ticks_per_second)?;
        let sensor = SensorMetadata {
            ticks_per_second: Some(server.ticks_per_second),
            base_step_length_m: metadata.base_step_length_m,
            board: server.hardware_name,
            rss_version: server.rss_version,
        };
        Ok(VendorRecording { config, sensor, frames })
    }

    /// Path of the session. `session` is a group in older files and a link in newer ones; some
    /// copies lack the link.
    fn session(&self) -> Result<&'static str, ImportError> {
        let known = ["session", "sessions/session_0"];
        known
            .into_iter()
            .find(|at| self.file.group(at).is_ok())
            .ok_or_else(|| self.layout("/", "has neither `session` nor `sessions/session_0`"))
    }

    fn warn_about_ignored_parts(&self, session: &str) {
        let count = |at: &str, prefix: &str| {
            let groups = self.file.group(at).and_then(|g| g.groups()).unwrap_or_default();
            groups.iter().filter(|name| name.starts_with(prefix)).count()
        };
        let (sessions, groups) = (count("sessions", "session_"), count(session, "group_"));
        let sensors = count(&format!("{session}/group_0"), "entry_");
        if sessions.max(groups).max(sensors) > 1 {
            let path = self.path.display();
            log::warn!(
                "{path} has {sessions} sessions, {groups} groups and {sensors} sensors in the first: the first of each is imported"
            );
        }
    }

    /// The configuration of the entry's sensor in the session's first group.
    fn config(&self, at: &str, sensor_id_at: &str) -> Result<SensorConfig, ImportError> {
        let session: Value = self.json(at)?;
        let sensor_id = self.integers(sensor_id_at, 1)?[0];
        let config = first_groups_config(&session, sensor_id)
            .ok_or_else(|| self.layout(at, "holds no configuration in groups[0]"))?;
        let config: SensorConfig = serde_json::from_value(config.clone())
            .map_err(|error| self.layout(at, format!("is unreadable: {error}")))?;
        match config.validate() {
            Ok(()) => Ok(config),
            Err(source) => Err(ImportError::Config { path: self.path.to_owned(), source }),
        }
    }

    fn frames(&self, at: &str, config: &SensorConfig, ticks_per_second: u32) -> Result<Vec<Frame>, ImportError> {
        let (count, samples) = self.samples(&format!("{at}/frame"), config)?;
        let ticks = self.integers(&format!("{at}/tick"), count)?;
        let temperatures = self.integers(&format!("{at}/temperature"), count)?;
        let data_saturated = self.flags(&format!("{at}/data_saturated"), count)?;
        let frame_delayed = self.flags(&format!("{at}/frame_delayed"), count)?;
        let calibration_needed = self.flags(&format!("{at}/calibration_needed"), count)?;
        let frames = samples.chunks_exact(config.points_per_frame() * 4).enumerate().map(|(index, bytes)| {
            Ok(Frame {
                tick: ticks[index],
                host_time_ns: time_ns(ticks[index], ticks[0], ticks_per_second)
                    .ok_or_else(|| self.layout(&format!("{at}/tick"), format!("[{index}] is {}", ticks[index])))?,
                temperature_c: i16::try_from(temperatures[index]).map_err(|_| {
                    self.layout(&format!("{at}/temperature"), format!("[{index}] is {} °C", temperatures[index]))
                })?,
                data_saturated: data_saturated[index],
                frame_delayed: frame_delayed[index],
                calibration_needed: calibration_needed[index],
                samples: bytes.as_chunks::<4>().0.iter().map(|&sample| complex_from_le_bytes(sample)).collect(),
            })
        });
        frames.collect()
    }

    /// Number of frames, and all samples as stored: real, imaginary, little-endian i16.
    fn samples(&self, at: &str, config: &SensorConfig) -> Result<(usize, Vec<u8>), ImportError> {
        let dataset = self.dataset(at)?;
        let shape = dataset.shape().map_err(|error| hdf5_error(self.path, at, error))?;
        let expected = [u64::from(config.sweeps_per_frame), config.points_per_sweep() as u64];
        let &[count, sweeps, points] = shape.as_slice() else {
            return Err(self.layout(at, format!("has the shape {shape:?}, not [frame, sweep, point]")));
        };
        if [sweeps, points] != expected {
            let [s, p] = expected;
            return Err(
                self.layout(at, format!("has {sweeps} × {points} samples a frame; its configuration says {s} × {p}"))
            );
        }
        let datatype = dataset.datatype().map_err(|error| hdf5_error(self.path, at, error))?;
        if !is_complex_i16(&datatype) {
            return Err(self.layout(at, "has samples of another type than {real: i16, imag: i16}"));
        }
        let bytes = self.raw(at, &dataset, count.saturating_mul(sweeps * points))?;
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        if bytes.len() != count.saturating_mul(config.points_per_frame() * 4) {
            return Err(self.layout(at, "is shorter than its shape says"));
        }
        Ok((count, bytes))
    }

    /// The bytes of a data set, after checking its claimed sizes.
    fn raw(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<Vec<u8>, ImportError> {
        self.check_size(at, dataset, elements)?;
        dataset.read_raw().map_err(|error| hdf5_error(self.path, at, error))
    }

    fn check_size(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<(), ImportError> {
        let error = |error| hdf5_error(self.path, at, error);
        let element_bytes = dataset.element_size().map_err(error)?;
        let bytes = elements.saturating_mul(element_bytes);
        too_big_unless(bytes <= MAX_BYTES, self.path, at, bytes, MAX_BYTES)?;
        let chunk = dataset.chunk_shape().map_err(error)?.unwrap_or_default();
        let chunk_bytes = chunk.iter().fold(element_bytes, |bytes, &edge| bytes.saturating_mul(edge));
        too_big_unless(chunk_bytes <= MAX_CHUNK_BYTES, self.path, at, chunk_bytes, MAX_CHUNK_BYTES)
    }

    /// This many integers, or a scalar.
    fn integers(&self, at: &str, count: usize) -> Result<Vec<i64>, ImportError> {
        let dataset = self.dataset(at)?;
        self.check_count(at, &dataset, count)?;
        self.check_size(at, &dataset, count as u64)?;
        let values = dataset.read_i64().map_err(|error| hdf5_error(self.path, at, error))?;
        self.counted(at, values, count)
    }

    /// This many booleans, stored as one byte each.
    fn flags(&self, at: &str, count: usize) -> Result<Vec<bool>, ImportError> {
        let dataset = self.dataset(at)?;
        self.check_count(at, &dataset, count)?;
        let bytes = self.raw(at, &dataset, count as u64)?;
        self.counted(at, bytes.iter().map(|&b| b != 0).collect(), count)
    }

    fn check_count(&self, at: &str, dataset: &Dataset, count: usize) -> Result<(), ImportError> {
        let shape = dataset.shape().map_err(|error| hdf5_error(self.path, at, error))?;
        let held = shape.iter().fold(1u64, |held, &edge| held.saturating_mul(edge));
        if held == count as u64 { Ok(()) } else { Err(self.layout(at, format!("has {held} values, not {count}"))) }
    }

    fn counted<T>(&self, at: &str, values: Vec<T>, count: usize) -> Result<Vec<T>, ImportError> {
        match values.len() == count {
            true => Ok(values),
            false => Err(self.layout(at, format!("gives {} values, not {count}", values.len()))),
        }
    }

    fn json<T: for<'de> Deserialize<'de>>(&self, at: &str) -> Result<T, ImportError> {
        let dataset = self.dataset(at)?;
        self.check_count(at, &dataset, 1)?;
        self.check_size(at, &dataset, 1)?;
        let limits = VlenStringReadOptions::new().with_max_elements(1).with_max_payload_bytes(MAX_TEXT_BYTES);
        let texts = dataset.read_vlen_strings(limits).or_else(|_| dataset.read_string());
        let texts = texts.map_err(|error| hdf5_error(self.path, at, error))?;
        let text = texts.first().ok_or_else(|| self.layout(at, "is empty"))?;
        serde_json::from_str(text).map_err(|error| self.layout(at, format!("is not the expected JSON: {error}")))
    }

    fn dataset(&self, at: &str) -> Result<Dataset, ImportError> {
        self.file.dataset(at).map_err(|error| hdf5_error(self.path, at, error))
    }

    fn layout(&self, at: &str, reason: impl Into<String>) -> ImportError {
        ImportError::Layout { path: self.path.to_owned(), at: format!("`{at}`"), reason: reason.into() }
    }
}

fn hdf5_error(path: &Path, at: &str, error: hdf5_pure::Error) -> ImportError {
    ImportError::Hdf5 { path: path.to_owned(), at: format!("`{at}`"), reason: error.to_string() }
}

fn too_big_unless(fits: bool, path: &Path, what: &str, bytes: u64, max: u64) -> Result<(), ImportError> {
    if fits { Ok(()) } else { Err(ImportError::TooBig { path: path.to_owned(), what: what.to_owned(), bytes, max }) }
}

/// Finds the sensor's configuration. `groups[0]` is a map from sensor id to configuration; in the
/// protocol's form it is a list of {sensor_id, config}.
fn first_groups_config(session: &Value, sensor_id: i64) -> Option<&Value> {
    match session.get("groups")?.get(0)? {
        Value::Object(map) => map.get(&sensor_id.to_string()).or_else(|| map.values().next()),
        Value::Array(list) => list.iter().find(|e| e["sensor_id"] == sensor_id).or_else(|| list.first())?.get("config"),
        _ => None,
    }
}

fn is_complex_i16(datatype: &Datatype) -> bool {
    let Datatype::Compound { size: 4, members } = datatype else { return false };
    let expected = [("real", 0), ("imag", 2)];
    members.len() == 2
        && members.iter().zip(expected).all(|(member, (name, offset))| {
            member.name == name && member.byte_offset == offset && member.datatype == make_i16_type()
        })
}

/// Time of a tick since the first one, nanoseconds, rounded; `None` beyond 292 years.
fn time_ns(tick: i64, first_tick: i64, ticks_per_second: u32) -> Option<i64> {
    let per_second = i128::from(ticks_per_second);
    let doubled = (i128::from(tick) - i128::from(first_tick)) * 2_000_000_000;
    i64::try_from((doubled + per_second).div_euclid(2 * per_second)).ok()
}
