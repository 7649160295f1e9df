//! Where things are in a file of the vendor's tool. The reader of HDF5 is a third-party crate that gets untrusted bytes: a
//! panic in it counts as an unreadable file.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use hdf5_pure::{Dataset, File, VlenStringReadOptions};
use serde::Deserialize;
use serde_json::Value;

use super::frames::StoredFrames;
use super::superblock::{self, LeftOpen};
use super::{Contents, MAX_BYTES, Unfinished, VendorFileError, VendorRecording, too_big_unless};
use crate::SensorConfig;

/// Limit of an unpacked chunk of a data set, bytes. Choice: the vendor's have about ten thousand
/// bytes.
const MAX_CHUNK_BYTES: u64 = 16 << 20;
/// Limit of a JSON text, bytes. Choice: configurations and metadata take some kilobytes; a larger
/// text is no configuration.
const MAX_TEXT_BYTES: usize = 16 << 20;
/// Most bytes that a packed byte unpacks to. Source: deflate, which the vendor's tool uses, reaches
/// 1032 (zlib's technical details).
const MAX_UNPACKING: u64 = 1032;

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

/// An open file.
pub(super) struct VendorFile {
    path: PathBuf,
    file: File,
    bytes: u64,
    pub left_open: Option<LeftOpen>,
}

impl VendorFile {
    pub fn new(path: &Path, bytes: Vec<u8>) -> Result<Self, VendorFileError> {
        let (length, left_open) = (bytes.len() as u64, superblock::left_open(&bytes));
        let file = caught(path, left_open, || File::from_bytes(bytes).map_err(|error| hdf5_error(path, "/", error)))?;
        Ok(Self { path: path.to_owned(), file, bytes: length, left_open })
    }

    /// The recording in it.
    pub fn recording(self) -> Result<VendorRecording, VendorFileError> {
        let (path, left_open) = (self.path.clone(), self.left_open);
        caught(&path, left_open, || self.read())
    }

    fn read(self) -> Result<VendorRecording, VendorFileError> {
        let session = self.session()?;
        let server: ServerInfo = self.json("server_info")?;
        if server.ticks_per_second == 0 {
            return Err(self.layout("server_info", "has 0 ticks_per_second"));
        }
        let entry = format!("{session}/group_0/entry_0");
        let metadata: EntryMetadata = self.json(&format!("{entry}/metadata"))?;
        let config = self.config(&format!("{session}/session_config"), &format!("{entry}/sensor_id"))?;
        let (contents, left_open) = (self.contents(session), self.left_open);
        let (frames, incomplete_frames) =
            StoredFrames::open(self, format!("{entry}/result"), &config, server.ticks_per_second)?;
        let unfinished = (left_open.is_some() || incomplete_frames > 0).then(|| Unfinished {
            not_closed: left_open.is_some(),
            incomplete_frames,
            unindexed_bytes: left_open.map_or(0, |left_open| left_open.unindexed_bytes),
        });
        Ok(VendorRecording {
            config,
            ticks_per_second: server.ticks_per_second,
            base_step_length_m: metadata.base_step_length_m,
            board: server.hardware_name,
            rss_version: server.rss_version,
            contents,
            unfinished,
            frames,
        })
    }

    /// Path of the session. `session` is a group in older files and a link in newer ones; some
    /// copies lack the link.
    fn session(&self) -> Result<&'static str, VendorFileError> {
        let known = ["session", "sessions/session_0"];
        known
            .into_iter()
            .find(|at| self.file.group(at).is_ok())
            .ok_or_else(|| self.layout("/", "has neither `session` nor `sessions/session_0`"))
    }

    fn contents(&self, session: &str) -> Contents {
        let count = |at: &str, prefix: &str| {
            let groups = self.file.group(at).and_then(|g| g.groups()).unwrap_or_default();
            groups.iter().filter(|name| name.starts_with(prefix)).count()
        };
        Contents {
            // A file with the group `session` alone has no list of sessions.
            sessions: count("sessions", "session_").max(1),
            groups: count(session, "group_"),
            sensors: count(&format!("{session}/group_0"), "entry_"),
        }
    }

    /// The configuration of the entry's sensor in the session's first group.
    fn config(&self, at: &str, sensor_id_at: &str) -> Result<SensorConfig, VendorFileError> {
        let session: Value = self.json(at)?;
        let sensor_id = self.integers(sensor_id_at)?;
        let &[sensor_id] = sensor_id.as_slice() else {
            return Err(self.layout(sensor_id_at, format!("has {} values, not 1", sensor_id.len())));
        };
        let config = first_groups_config(&session, sensor_id)
            .ok_or_else(|| self.layout(at, "holds no configuration in groups[0]"))?;
        let mut config: SensorConfig = serde_json::from_value(config.clone())
            .map_err(|error| self.layout(at, format!("is unreadable: {error}")))?;
        // The server paces a session's frames by the update rate or the sensor does by its frame
        // rate, never both.
        config.frame_rate = config.frame_rate.or_else(|| session.get("update_rate")?.as_f64());
        match config.validate() {
            Ok(()) => Ok(config),
            Err(source) => Err(VendorFileError::Config { path: self.path.clone(), source }),
        }
    }

    /// The bytes of a data set, after checking its claimed sizes.
    fn raw(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<Vec<u8>, VendorFileError> {
        self.check_size(at, dataset, elements)?;
        dataset.read_raw().map_err(|error| self.hdf5(at, error))
    }

    /// Compares claimed sizes with the file and with limits.
    pub fn check_size(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<(), VendorFileError> {
        let error = |error| self.hdf5(at, error);
        let element_bytes = dataset.element_size().map_err(error)?;
        let bytes = elements.saturating_mul(element_bytes);
        too_big_unless(bytes <= MAX_BYTES, &self.path, at, bytes, MAX_BYTES)?;
        // Data sets without any stored data claim what they like.
        if bytes > self.bytes.saturating_mul(MAX_UNPACKING) {
            let file_bytes = self.bytes;
            return Err(
                self.layout(at, format!("claims {bytes} bytes, more than a file of {file_bytes} bytes can hold"))
            );
        }
        let chunk = dataset.chunk_shape().map_err(error)?.unwrap_or_default();
        let chunk_bytes = chunk.iter().fold(element_bytes, |bytes, &edge| bytes.saturating_mul(edge));
        too_big_unless(chunk_bytes <= MAX_CHUNK_BYTES, &self.path, at, chunk_bytes, MAX_CHUNK_BYTES)
    }

    /// Integers of a list or a scalar.
    pub fn integers(&self, at: &str) -> Result<Vec<i64>, VendorFileError> {
        let dataset = self.dataset(at)?;
        let count = self.count(at, &dataset)?;
        self.check_size(at, &dataset, count)?;
        let values = dataset.read_i64().map_err(|error| self.hdf5(at, error))?;
        self.counted(at, values, count)
    }

    /// Booleans, stored as one byte each.
    pub fn flags(&self, at: &str) -> Result<Vec<bool>, VendorFileError> {
        let dataset = self.dataset(at)?;
        let count = self.count(at, &dataset)?;
        let bytes = self.raw(at, &dataset, count)?;
        self.counted(at, bytes.iter().map(|&b| b != 0).collect(), count)
    }

    /// Number of values by the shape.
    pub fn count(&self, at: &str, dataset: &Dataset) -> Result<u64, VendorFileError> {
        let shape = dataset.shape().map_err(|error| self.hdf5(at, error))?;
        Ok(shape.iter().fold(1u64, |held, &edge| held.saturating_mul(edge)))
    }

    fn counted<T>(&self, at: &str, values: Vec<T>, count: u64) -> Result<Vec<T>, VendorFileError> {
        match values.len() as u64 == count {
            true => Ok(values),
            false => Err(self.layout(at, format!("gives {} values, not {count}", values.len()))),
        }
    }

    fn json<T: for<'de> Deserialize<'de>>(&self, at: &str) -> Result<T, VendorFileError> {
        let dataset = self.dataset(at)?;
        match self.count(at, &dataset)? {
            1 => self.check_size(at, &dataset, 1)?,
            count => return Err(self.layout(at, format!("has {count} values, not 1"))),
        }
        let limits = VlenStringReadOptions::new().with_max_elements(1).with_max_payload_bytes(MAX_TEXT_BYTES);
        let texts = dataset.read_vlen_strings(limits).or_else(|_| dataset.read_string());
        let texts = texts.map_err(|error| self.hdf5(at, error))?;
        let text = texts.first().ok_or_else(|| self.layout(at, "is empty"))?;
        serde_json::from_str(text).map_err(|error| self.layout(at, format!("is not the expected JSON: {error}")))
    }

    pub fn dataset(&self, at: &str) -> Result<Dataset, VendorFileError> {
        self.file.dataset(at).map_err(|error| self.hdf5(at, error))
    }

    pub fn layout(&self, at: &str, reason: impl Into<String>) -> VendorFileError {
        VendorFileError::Layout { path: self.path.clone(), at: format!("`{at}`"), reason: reason.into() }
    }

    pub fn too_many_frames(&self, at: &str, count: u64, max: u64) -> VendorFileError {
        VendorFileError::TooManyFrames { path: self.path.clone(), at: format!("`{at}`"), count, max }
    }

    pub fn hdf5(&self, at: &str, reason: impl std::fmt::Display) -> VendorFileError {
        hdf5_error(&self.path, at, reason)
    }

    /// What is read; a panic counts as an error, and an error in a file that was left open as that.
    pub fn caught<T>(&self, read: impl FnOnce() -> Result<T, VendorFileError>) -> Result<T, VendorFileError> {
        caught(&self.path, self.left_open, read)
    }
}

fn caught<T>(
    path: &Path,
    left_open: Option<LeftOpen>,
    read: impl FnOnce() -> Result<T, VendorFileError>,
) -> Result<T, VendorFileError> {
    let result = catch_unwind(AssertUnwindSafe(read));
    result
        .unwrap_or_else(|_| Err(hdf5_error(path, "/", "the HDF5 reader gave up")))
        .map_err(|error| of_left_open(error, left_open))
}

/// An error in a file whose writer may have left it open.
fn of_left_open(error: VendorFileError, left_open: Option<LeftOpen>) -> VendorFileError {
    let Some(left_open) = left_open else { return error };
    let remedy = match left_open.has_root {
        true => "a copy repaired with HDF5's own tools, h5clear and h5repack, may be readable; otherwise record again",
        false => {
            "the index of its frames was never written, so none can be recovered; record again, and let the vendor's tool \
             stop the recording before it ends"
        }
    };
    match error {
        VendorFileError::Hdf5 { path, at, reason } | VendorFileError::Layout { path, at, reason } => {
            VendorFileError::NotClosed { path, at, reason, remedy }
        }
        other => other,
    }
}

fn hdf5_error(path: &Path, at: &str, reason: impl std::fmt::Display) -> VendorFileError {
    VendorFileError::Hdf5 { path: path.to_owned(), at: format!("`{at}`"), reason: reason.to_string() }
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
