//! Reads recordings of the vendor's exploration tool (HDF5, A121 generation): first session, first
//! group, first sensor.
//!
//! Layout: `server_info` (JSON); `session` or `sessions/session_0` with `session_config` (JSON) and
//! `group_0/entry_0/{sensor_id, metadata (JSON), result/…}`. `result/` holds `frame` [frame, sweep,
//! point] of {real, imag: i16}, and per frame `tick`, `temperature` and three flags. There are no
//! host times: a frame's time is its tick, counted from the first one.
//!
//! The vendor's tool writes the index of a file (groups, shapes, places of the chunks) and its JSON
//! texts when it closes the file. What is on the disk before that are compressed chunks without
//! configuration, ticks and order, of which no frame can be made; such a file is refused as
//! [not closed](VendorFileError::NotClosed). A file that was flushed holds everything up to then and
//! is read as far as it goes: see [`Unfinished`].
//!
//! Longer than other files: it reads one layout, each function a part of it.
//!
//! Nothing in a file is trusted: each length is compared with the configuration, with the size of
//! the file and with a limit before memory is taken.
//!
//! ```no_run
//! use a121::vendor_h5::VendorRecording;
//!
//! let recording = VendorRecording::read("tank.h5")?;
//! let config = &recording.config;
//! println!("{} frames of {} points", recording.frames.len(), config.points_per_frame());
//! # Ok::<(), a121::vendor_h5::VendorFileError>(())
//! ```

mod superblock;

use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use hdf5_pure::{Dataset, Datatype, File, VlenStringReadOptions, make_i16_type};
use serde::Deserialize;
use serde_json::Value;

use self::superblock::LeftOpen;
use crate::layout::sample_from_le_bytes;
use crate::{ConfigError, Frame, SensorConfig};

/// Limit of a file, of an unpacked data set, and of all frames in memory, bytes. Choice: about 80
/// minutes of the fastest preset.
const MAX_BYTES: u64 = 1 << 30;
/// Limit of an unpacked chunk of a data set, bytes. Choice: the vendor's have about ten thousand
/// bytes.
const MAX_CHUNK_BYTES: u64 = 64 << 20;
/// Limit of a JSON text, bytes. Choice: configurations and metadata take some kilobytes; a larger
/// text is no configuration.
const MAX_TEXT_BYTES: usize = 16 << 20;
/// Most bytes that a packed byte unpacks to. Source: deflate, which the vendor's tool uses, reaches
/// 1032 (zlib's technical details).
const MAX_UNPACKING: u64 = 1032;

/// A file of the vendor's tool that cannot be read. Each message says what happened and what to do.
#[derive(Debug, thiserror::Error)]
pub enum VendorFileError {
    /// The system refused a file operation.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A directory or device instead of a file.
    #[error("{0} is a folder or a device: give the file itself")]
    NotAFile(PathBuf),
    /// Larger than anything that the vendor's tool records at once.
    #[error("{path}: {what} is {bytes} bytes, more than the {max} bytes that are imported: record in shorter pieces")]
    TooBig {
        /// The file.
        path: PathBuf,
        /// The file, data set or chunk.
        what: String,
        /// Its size, bytes.
        bytes: u64,
        /// The limit, bytes.
        max: u64,
    },
    /// Not an HDF5 file, or truncated or damaged.
    #[error("{path} cannot be read as HDF5 (at {at}): {reason}; it is damaged, cut short or of another format")]
    Hdf5 {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// The HDF5 reader's message.
        reason: String,
    },
    /// The writer ended without closing the file, and what is in it cannot be read.
    #[error("{path} was not closed by its writer (at {at}: {reason}): {remedy}")]
    NotClosed {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// What is missing.
        reason: String,
        /// Text: what is left of the recording, and what to do.
        remedy: &'static str,
    },
    /// An HDF5 file with another layout than the vendor's exploration tool writes.
    #[error("{path}: {at} {reason}; is it a recording of the vendor's A121 exploration tool?")]
    Layout {
        /// The file.
        path: PathBuf,
        /// The object in the file.
        at: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The configuration breaks a rule of the sensor.
    #[error("{path}: the sensor configuration breaks a rule of the sensor: {source}")]
    Config {
        /// The file.
        path: PathBuf,
        /// The broken rule.
        source: ConfigError,
    },
}

/// How many parts a file holds, of which the first are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contents {
    /// Sessions of the file.
    pub sessions: usize,
    /// Groups of the first session.
    pub groups: usize,
    /// Sensors of its first group.
    pub sensors: usize,
}

impl Contents {
    /// Whether the file holds more than what is read.
    pub fn has_more(&self) -> bool {
        self.sessions.max(self.groups).max(self.sensors) > 1
    }
}

/// What is missing at the end of a recording whose writer was interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unfinished {
    /// Whether the writer did not close the file; otherwise it stopped between the parts of a frame.
    pub not_closed: bool,
    /// Frames that lack some of their parts, or whose space was reserved and never written.
    pub incomplete_frames: u64,
    /// Bytes after the end of what was flushed; the index does not cover them.
    pub unindexed_bytes: u64,
}

/// A recording of the vendor's tool: the first sensor of the first group of the first session.
#[derive(Debug, Clone, PartialEq)]
pub struct VendorRecording {
    /// Configuration of the sensor; breaks no rule of the sensor. Its frame rate is the session's
    /// update rate where the server paced the frames.
    pub config: SensorConfig,
    /// Ticks of the board's clock per second.
    pub ticks_per_second: u32,
    /// Distance between range points at step length 1, metres; older files lack it.
    pub base_step_length_m: Option<f64>,
    /// Name of the board, such as "xc120"; older files lack it.
    pub board: Option<String>,
    /// Version of the sensor's software; older files lack it.
    pub rss_version: Option<String>,
    /// Frames in the order of the file; their times count from the first one's tick.
    pub frames: Vec<Frame>,
    /// What the file holds.
    pub contents: Contents,
    /// What is missing at its end; `None` if the writer finished it.
    pub unfinished: Option<Unfinished>,
}

impl VendorRecording {
    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be opened, is of another kind, damaged or too big, or its configuration
    /// breaks a rule of the sensor.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, VendorFileError> {
        let path = path.as_ref();
        let io_error = |source| VendorFileError::Io { path: path.to_owned(), source };
        let metadata = std::fs::metadata(path).map_err(io_error)?;
        if !metadata.is_file() {
            return Err(VendorFileError::NotAFile(path.to_owned()));
        }
        too_big_unless(metadata.len() <= MAX_BYTES, path, "the file", metadata.len(), MAX_BYTES)?;
        // Read here, to separate errors of the system from errors of the parser.
        let mut bytes = Vec::new();
        // As long as it is, and one more in which its end is found: growing on the way takes up to three times that.
        bytes.try_reserve_exact(metadata.len() as usize + 1).map_err(|error| io_error(error.into()))?;
        let file = std::fs::File::open(path).map_err(io_error)?;
        file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(io_error)?;
        // The file is untrusted and the parser is a third-party crate: a panic in it counts as an
        // unreadable file.
        let left_open = superblock::left_open(&bytes);
        catch_unwind(AssertUnwindSafe(|| Reader::open(path, bytes, left_open)?.read()))
            .unwrap_or_else(|_| Err(hdf5_error(path, "/", "the HDF5 reader gave up")))
            .map_err(|error| match left_open {
                Some(left_open) => not_closed(error, left_open),
                None => error,
            })
    }
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

struct Reader<'a> {
    path: &'a Path,
    file: File,
    file_bytes: u64,
    left_open: Option<LeftOpen>,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path, bytes: Vec<u8>, left_open: Option<LeftOpen>) -> Result<Self, VendorFileError> {
        let file_bytes = bytes.len() as u64;
        match File::from_bytes(bytes) {
            Ok(file) => Ok(Self { path, file, file_bytes, left_open }),
            Err(error) => Err(hdf5_error(path, "/", error)),
        }
    }

    fn read(&self) -> Result<VendorRecording, VendorFileError> {
        let session = self.session()?;
        let server: ServerInfo = self.json("server_info")?;
        if server.ticks_per_second == 0 {
            return Err(self.layout("server_info", "has 0 ticks_per_second"));
        }
        let entry = format!("{session}/group_0/entry_0");
        let metadata: EntryMetadata = self.json(&format!("{entry}/metadata"))?;
        let config = self.config(&format!("{session}/session_config"), &format!("{entry}/sensor_id"))?;
        let (frames, incomplete_frames) = self.frames(&format!("{entry}/result"), &config, server.ticks_per_second)?;
        let unfinished = (self.left_open.is_some() || incomplete_frames > 0).then(|| Unfinished {
            not_closed: self.left_open.is_some(),
            incomplete_frames,
            unindexed_bytes: self.left_open.map_or(0, |left_open| left_open.unindexed_bytes),
        });
        Ok(VendorRecording {
            config,
            ticks_per_second: server.ticks_per_second,
            base_step_length_m: metadata.base_step_length_m,
            board: server.hardware_name,
            rss_version: server.rss_version,
            frames,
            contents: self.contents(session),
            unfinished,
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
            Err(source) => Err(VendorFileError::Config { path: self.path.to_owned(), source }),
        }
    }

    /// The complete frames, and the number of incomplete ones after them.
    fn frames(
        &self,
        at: &str,
        config: &SensorConfig,
        ticks_per_second: u32,
    ) -> Result<(Vec<Frame>, u64), VendorFileError> {
        let (stored, samples) = self.samples(&format!("{at}/frame"), config)?;
        let ticks = self.integers(&format!("{at}/tick"))?;
        let temperatures = self.integers(&format!("{at}/temperature"))?;
        let data_saturated = self.flags(&format!("{at}/data_saturated"))?;
        let frame_delayed = self.flags(&format!("{at}/frame_delayed"))?;
        let calibration_needed = self.flags(&format!("{at}/calibration_needed"))?;
        // The writer extends one data set after the other; one that is interrupted leaves them of
        // unequal length.
        let lengths = [
            stored,
            ticks.len(),
            temperatures.len(),
            data_saturated.len(),
            frame_delayed.len(),
            calibration_needed.len(),
        ];
        let (shortest, longest) = lengths.iter().fold((stored, stored), |(a, b), &n| (a.min(n), b.max(n)));
        let frame_bytes = config.points_per_frame() * 4;
        // Space that was reserved and never written reads as 0. Only a first tick is 0. The samples of a
        // whole frame may be 0 too, at a low gain with many averages, so they count only where
        // something else says that the writer was interrupted.
        let is_interrupted =
            self.left_open.is_some() || shortest != longest || ticks.iter().skip(1).any(|&tick| tick == 0);
        let is_written = |index: usize| {
            let samples = &samples[index * frame_bytes..(index + 1) * frame_bytes];
            (index == 0 || ticks[index] != 0) && (!is_interrupted || samples.iter().any(|&byte| byte != 0))
        };
        let count = (0..shortest).rev().find(|&index| is_written(index)).map_or(0, |last| last + 1);
        let frames = samples.chunks_exact(frame_bytes).take(count).enumerate().map(|(index, bytes)| {
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
                samples: bytes.as_chunks::<4>().0.iter().map(|&sample| sample_from_le_bytes(sample)).collect(),
            })
        });
        Ok((frames.collect::<Result<_, _>>()?, (longest - count) as u64))
    }

    /// Number of frames, and all samples as stored: real, imaginary, little-endian i16.
    fn samples(&self, at: &str, config: &SensorConfig) -> Result<(usize, Vec<u8>), VendorFileError> {
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
        let frame_bytes = (size_of::<Frame>() + 4 * config.points_per_frame()) as u64;
        let frames_bytes = count.saturating_mul(frame_bytes);
        too_big_unless(frames_bytes <= MAX_BYTES, self.path, at, frames_bytes, MAX_BYTES)?;
        let bytes = self.raw(at, &dataset, count.saturating_mul(sweeps * points))?;
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        if bytes.len() != count.saturating_mul(config.points_per_frame() * 4) {
            return Err(self.layout(at, "is shorter than its shape says"));
        }
        Ok((count, bytes))
    }

    /// The bytes of a data set, after checking its claimed sizes.
    fn raw(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<Vec<u8>, VendorFileError> {
        self.check_size(at, dataset, elements)?;
        dataset.read_raw().map_err(|error| hdf5_error(self.path, at, error))
    }

    fn check_size(&self, at: &str, dataset: &Dataset, elements: u64) -> Result<(), VendorFileError> {
        let error = |error| hdf5_error(self.path, at, error);
        let element_bytes = dataset.element_size().map_err(error)?;
        let bytes = elements.saturating_mul(element_bytes);
        too_big_unless(bytes <= MAX_BYTES, self.path, at, bytes, MAX_BYTES)?;
        // Data sets without any stored data claim what they like.
        if bytes > self.file_bytes.saturating_mul(MAX_UNPACKING) {
            let file_bytes = self.file_bytes;
            return Err(
                self.layout(at, format!("claims {bytes} bytes, more than a file of {file_bytes} bytes can hold"))
            );
        }
        let chunk = dataset.chunk_shape().map_err(error)?.unwrap_or_default();
        let chunk_bytes = chunk.iter().fold(element_bytes, |bytes, &edge| bytes.saturating_mul(edge));
        too_big_unless(chunk_bytes <= MAX_CHUNK_BYTES, self.path, at, chunk_bytes, MAX_CHUNK_BYTES)
    }

    /// Integers of a list or a scalar.
    fn integers(&self, at: &str) -> Result<Vec<i64>, VendorFileError> {
        let dataset = self.dataset(at)?;
        let count = self.count(at, &dataset)?;
        self.check_size(at, &dataset, count)?;
        let values = dataset.read_i64().map_err(|error| hdf5_error(self.path, at, error))?;
        self.counted(at, values, count)
    }

    /// Booleans, stored as one byte each.
    fn flags(&self, at: &str) -> Result<Vec<bool>, VendorFileError> {
        let dataset = self.dataset(at)?;
        let count = self.count(at, &dataset)?;
        let bytes = self.raw(at, &dataset, count)?;
        self.counted(at, bytes.iter().map(|&b| b != 0).collect(), count)
    }

    /// Number of values by the shape.
    fn count(&self, at: &str, dataset: &Dataset) -> Result<u64, VendorFileError> {
        let shape = dataset.shape().map_err(|error| hdf5_error(self.path, at, error))?;
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
        let texts = texts.map_err(|error| hdf5_error(self.path, at, error))?;
        let text = texts.first().ok_or_else(|| self.layout(at, "is empty"))?;
        serde_json::from_str(text).map_err(|error| self.layout(at, format!("is not the expected JSON: {error}")))
    }

    fn dataset(&self, at: &str) -> Result<Dataset, VendorFileError> {
        self.file.dataset(at).map_err(|error| hdf5_error(self.path, at, error))
    }

    fn layout(&self, at: &str, reason: impl Into<String>) -> VendorFileError {
        VendorFileError::Layout { path: self.path.to_owned(), at: format!("`{at}`"), reason: reason.into() }
    }
}

fn hdf5_error(path: &Path, at: &str, reason: impl std::fmt::Display) -> VendorFileError {
    VendorFileError::Hdf5 { path: path.to_owned(), at: format!("`{at}`"), reason: reason.to_string() }
}

/// The error of a file that was left open.
fn not_closed(error: VendorFileError, left_open: LeftOpen) -> VendorFileError {
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

fn too_big_unless(fits: bool, path: &Path, what: &str, bytes: u64, max: u64) -> Result<(), VendorFileError> {
    if fits {
        Ok(())
    } else {
        Err(VendorFileError::TooBig { path: path.to_owned(), what: what.to_owned(), bytes, max })
    }
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

#[cfg(test)]
#[path = "vendor_h5_tests.rs"]
mod tests;
