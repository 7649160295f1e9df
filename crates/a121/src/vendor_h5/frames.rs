//! The frames of a file: what is stored for each of them, read when the file is opened, and their samples, read as they are
//! asked for.

use hdf5_pure::{Dataset, Datatype, make_i16_type};

use super::VendorFileError;
use super::file::VendorFile;
use crate::layout::sample_from_le_bytes;
use crate::{Frame, SensorConfig};

/// Limit of the number of frames. Choice: more than an hour of the fastest preset's; their times and flags are held in memory.
const MAX_FRAMES: u64 = 1 << 21;
/// Samples are read in pieces of at most so many bytes, or of one frame. Choice: many of the vendor's chunks at once, and little
/// memory.
const PIECE_BYTES: usize = 1 << 20;

/// All of a frame but its samples.
#[derive(Clone, Copy)]
struct FrameInfo {
    tick: i64,
    time_ns: i64,
    temperature_c: i16,
    data_saturated: bool,
    frame_delayed: bool,
    calibration_needed: bool,
}

/// The complete frames of a file.
pub(super) struct StoredFrames {
    file: VendorFile,
    /// Path of the data set of samples.
    at: String,
    /// Kept, because it keeps where its chunks are.
    dataset: Dataset,
    frame_bytes: usize,
    infos: Vec<FrameInfo>,
}

/// The data sets beside the samples.
struct Lists {
    ticks: Vec<i64>,
    temperatures: Vec<i64>,
    data_saturated: Vec<bool>,
    frame_delayed: Vec<bool>,
    calibration_needed: Vec<bool>,
}

impl StoredFrames {
    /// The complete frames, and the number of incomplete ones after them. `at`: path of the group of results.
    pub fn open(
        file: VendorFile,
        at: String,
        config: &SensorConfig,
        ticks_per_second: u32,
    ) -> Result<(Self, u64), VendorFileError> {
        let samples_at = format!("{at}/frame");
        let dataset = file.dataset(&samples_at)?;
        let stored = check_samples(&file, &samples_at, &dataset, config)?;
        let lists = Lists::read(&file, &at)?;
        // The writer extends one data set after the other; one that is interrupted leaves them of
        // unequal length.
        let lengths = lists.lengths();
        let (shortest, longest) = lengths.iter().fold((stored, stored), |(a, b), &n| (a.min(n), b.max(n)));
        let is_interrupted =
            file.left_open.is_some() || shortest != longest || lists.ticks.iter().skip(1).any(|&t| t == 0);
        let mut frames =
            Self { file, at: samples_at, dataset, frame_bytes: config.points_per_frame() * 4, infos: Vec::new() };
        let count = frames.written(&lists.ticks[..shortest], is_interrupted)?;
        let info = |index| {
            lists
                .info(index, ticks_per_second)
                .map_err(|(of, value)| frames.file.layout(&format!("{at}/{of}"), format!("[{index}] is {value}")))
        };
        frames.infos = (0..count).map(info).collect::<Result<_, _>>()?;
        Ok((frames, (longest - count) as u64))
    }

    pub fn times_ns(&self) -> impl ExactSizeIterator<Item = i64> {
        self.infos.iter().map(|info| info.time_ns)
    }

    pub fn iter(&self) -> impl Iterator<Item = Result<Frame, VendorFileError>> {
        let starts = (0..self.infos.len()).step_by(self.frames_per_piece());
        let pieces = starts.map(|first| self.piece(first, self.infos.len()).map(|bytes| (first, bytes)));
        let mut has_failed = false;
        let until_error = pieces.take_while(move |piece| !std::mem::replace(&mut has_failed, piece.is_err()));
        until_error.flat_map(|piece| {
            let (frames, error) = match piece {
                Ok((first, bytes)) => (self.frames_of(first, &bytes), None),
                Err(error) => (Vec::new(), Some(error)),
            };
            frames.into_iter().map(Ok).chain(error.map(Err))
        })
    }

    fn frames_of(&self, first: usize, bytes: &[u8]) -> Vec<Frame> {
        let each = bytes.chunks_exact(self.frame_bytes).zip(&self.infos[first..]);
        each.map(|(bytes, info)| info.frame(bytes)).collect()
    }

    fn frames_per_piece(&self) -> usize {
        (PIECE_BYTES / self.frame_bytes).max(1)
    }

    /// Samples as stored of the piece that begins with this frame and ends before `end` at the latest: real, imaginary,
    /// little-endian i16.
    fn piece(&self, first: usize, end: usize) -> Result<Vec<u8>, VendorFileError> {
        let count = self.frames_per_piece().min(end - first);
        let bytes = self.file.caught(|| {
            self.dataset.read_raw_rows(first as u64, count as u64).map_err(|error| self.file.hdf5(&self.at, error))
        })?;
        match bytes.len() == count * self.frame_bytes {
            true => Ok(bytes),
            false => Err(self.file.layout(&self.at, "is shorter than its shape says")),
        }
    }

    /// How many frames were written. Space that was reserved and never written reads as 0. Only a first tick is 0. The samples of
    /// a whole frame may be 0 too, at a low gain with many averages, so they count only where something else says that the writer
    /// was interrupted.
    fn written(&self, ticks: &[i64], is_interrupted: bool) -> Result<usize, VendorFileError> {
        let has_tick = |index: usize| index == 0 || ticks[index] != 0;
        let starts = (0..ticks.len()).step_by(self.frames_per_piece());
        for first in starts.rev() {
            let end = ticks.len().min(first + self.frames_per_piece());
            let samples = if is_interrupted { self.piece(first, end)? } else { Vec::new() };
            let is_silent = |index: usize| {
                let start = (index - first) * self.frame_bytes;
                is_interrupted && samples[start..start + self.frame_bytes].iter().all(|&byte| byte == 0)
            };
            if let Some(last) = (first..end).rev().find(|&index| has_tick(index) && !is_silent(index)) {
                return Ok(last + 1);
            }
        }
        Ok(0)
    }
}

impl Lists {
    fn read(file: &VendorFile, at: &str) -> Result<Self, VendorFileError> {
        let integers = |name| path_of_list(file, at, name).and_then(|at| file.integers(&at));
        let flags = |name| path_of_list(file, at, name).and_then(|at| file.flags(&at));
        Ok(Self {
            ticks: integers("tick")?,
            temperatures: integers("temperature")?,
            data_saturated: flags("data_saturated")?,
            frame_delayed: flags("frame_delayed")?,
            calibration_needed: flags("calibration_needed")?,
        })
    }

    fn lengths(&self) -> [usize; 5] {
        let flags = [&self.data_saturated, &self.frame_delayed, &self.calibration_needed].map(Vec::len);
        [self.ticks.len(), self.temperatures.len(), flags[0], flags[1], flags[2]]
    }

    /// # Errors
    /// Which list has a value that cannot be, and the value.
    fn info(&self, index: usize, ticks_per_second: u32) -> Result<FrameInfo, (&'static str, String)> {
        let (tick, temperature) = (self.ticks[index], self.temperatures[index]);
        Ok(FrameInfo {
            tick,
            time_ns: time_ns(tick, self.ticks[0], ticks_per_second).ok_or_else(|| ("tick", tick.to_string()))?,
            temperature_c: temperature.try_into().map_err(|_| ("temperature", format!("{temperature} °C")))?,
            data_saturated: self.data_saturated[index],
            frame_delayed: self.frame_delayed[index],
            calibration_needed: self.calibration_needed[index],
        })
    }
}

impl FrameInfo {
    fn frame(&self, bytes: &[u8]) -> Frame {
        Frame {
            tick: self.tick,
            host_time_ns: self.time_ns,
            temperature_c: self.temperature_c,
            data_saturated: self.data_saturated,
            frame_delayed: self.frame_delayed,
            calibration_needed: self.calibration_needed,
            samples: bytes.as_chunks::<4>().0.iter().map(|&sample| sample_from_le_bytes(sample)).collect(),
        }
    }
}

/// Path of a list, which has no more values than there may be frames.
fn path_of_list(file: &VendorFile, at: &str, name: &str) -> Result<String, VendorFileError> {
    let at = format!("{at}/{name}");
    let count = file.count(&at, &file.dataset(&at)?)?;
    if count > MAX_FRAMES { Err(file.too_many_frames(&at, count, MAX_FRAMES)) } else { Ok(at) }
}

/// Number of frames whose samples the file claims to hold.
fn check_samples(
    file: &VendorFile,
    at: &str,
    dataset: &Dataset,
    config: &SensorConfig,
) -> Result<usize, VendorFileError> {
    let shape = dataset.shape().map_err(|error| file.hdf5(at, error))?;
    let expected = [u64::from(config.sweeps_per_frame), config.points_per_sweep() as u64];
    let &[count, sweeps, points] = shape.as_slice() else {
        return Err(file.layout(at, format!("has the shape {shape:?}, not [frame, sweep, point]")));
    };
    if [sweeps, points] != expected {
        let [s, p] = expected;
        return Err(
            file.layout(at, format!("has {sweeps} × {points} samples a frame; its configuration says {s} × {p}"))
        );
    }
    check_type(file, at, dataset)?;
    if count > MAX_FRAMES {
        return Err(file.too_many_frames(at, count, MAX_FRAMES));
    }
    file.check_size(at, dataset, count * sweeps * points)?;
    Ok(count as usize)
}

fn check_type(file: &VendorFile, at: &str, dataset: &Dataset) -> Result<(), VendorFileError> {
    let datatype = dataset.datatype().map_err(|error| file.hdf5(at, error))?;
    match is_complex_i16(&datatype) {
        true => Ok(()),
        false => Err(file.layout(at, "has samples of another type than {real: i16, imag: i16}")),
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
