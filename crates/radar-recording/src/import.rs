//! Imports a recording of the vendor's exploration tool, optionally with a pose track, as a
//! recording of this program.

use radar_mapping::{Event, in_time_order};
use std::path::Path;

use super::track::read_track;
use super::{Header, ImportError, RecordingError, RecordingSummary, RecordingWriter, vendor_h5};
use a121::Frame;
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;

/// Information that the files do not contain.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Pose of the sensor on the tracked object; identity if the track is the sensor's own.
    pub head_from_sensor: Pose,
    /// The program's settings, for the header.
    pub settings: String,
}

impl Default for ImportOptions {
    /// Options for a track of the sensor itself.
    fn default() -> Self {
        Self { head_from_sensor: Pose::IDENTITY, settings: String::new() }
    }
}

/// An imported recording, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The header.
    pub header: Header,
    /// Frames in the order of the file; the first one ends at time 0.
    pub frames: Vec<Frame>,
    /// Poses in the order of the track, valid or not.
    pub poses: Vec<PoseSample>,
}

/// Reads the vendor's .h5 and, if given, a track with times since the first tick: TUM, or CSV if
/// its name ends in `.csv`.
///
/// # Errors
/// A file that is of another format, damaged, too big or breaks a rule of the sensor; an invalid
/// line of the track.
pub fn import_h5(frames: &Path, poses: Option<&Path>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let vendor = vendor_h5::read(frames)?;
    let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let mut source = format!("import of {}", name(frames));
    let mut track = Vec::new();
    if let Some(path) = poses {
        track = read_track(path)?;
        source += &format!(" and {}", name(path));
        warn_if_no_overlap(&vendor.frames, &track);
    }
    let mut header = Header::new(source, vendor.config, options.head_from_sensor);
    header.sensor = vendor.sensor;
    header.settings.clone_from(&options.settings);
    Ok(Imported { header, frames: vendor.frames, poses: track })
}

impl Imported {
    /// Frames and poses by time. Each stream keeps its own order even if its times run backwards.
    pub fn events(&self) -> impl Iterator<Item = Event> + '_ {
        in_time_order(self.frames.iter().cloned(), self.poses.iter().copied())
    }

    /// Writes it as a recording.
    ///
    /// # Errors
    /// An invalid mount, or a file that cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<RecordingSummary, RecordingError> {
        let mut writer = RecordingWriter::create(path, &self.header)?;
        for event in self.events() {
            writer.write(&event)?;
        }
        writer.finish()
    }
}

/// Warns of the usual mistake: a track whose times do not start at the first tick.
fn warn_if_no_overlap(frames: &[Frame], poses: &[PoseSample]) {
    let span = |times: &mut dyn Iterator<Item = i64>| {
        times.fold(None, |span, t| span.map_or(Some((t, t)), |(a, b): (i64, i64)| Some((a.min(t), b.max(t)))))
    };
    let frames = span(&mut frames.iter().map(|f| f.host_time_ns));
    let poses = span(&mut poses.iter().map(|p| p.time_ns));
    if let (Some(frames), Some(poses)) = (frames, poses)
        && (poses.1 < frames.0 || poses.0 > frames.1)
    {
        let s = |ns: i64| ns as f64 * 1e-9;
        log::warn!(
            "the track ({:.2} to {:.2} s) lies outside the frames ({:.2} to {:.2} s): its times must be seconds since the \
             recording's first tick",
            s(poses.0),
            s(poses.1),
            s(frames.0),
            s(frames.1)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_files::{TestFile, assert_same, real_recording};
    use super::super::{Recording, RecordingSummary};
    use super::*;

    /// FNV-1a hash. The constants below come from h5py and the same hash in Python.
    fn checksum(bytes: impl IntoIterator<Item = u8>) -> u64 {
        bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |sum, b| (sum ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
    }

    #[test]
    fn real_recordings_match_h5py() {
        // Name, frames, points per frame; hashes of samples, ticks and temperatures; last time in
        // ns.
        let known: [(&str, usize, usize, [u64; 3], i64); 5] = [
            (
                "corner-reflector.h5",
                113,
                74,
                [0xdf8d_0647_58e0_5695, 0x230b_baa6_92ba_dabc, 0xf491_09a9_d9a1_ba64],
                2_240_000_000,
            ),
            (
                "distance_fixed_strength.h5",
                93,
                33,
                [0x4911_4d76_c73e_5383, 0x2473_8a96_80b8_0c93, 0x49ad_7c04_2d57_7a39],
                18_399_995_000,
            ),
            (
                "fr10Hz-spf4.h5",
                10,
                640,
                [0xc826_5a96_ac4d_2505, 0x2f4c_a5c4_8dac_a767, 0x1fc3_a03d_0dee_bbc4],
                905_757_000,
            ),
            ("input.h5", 10, 160, [0x0622_9340_8c57_dd19, 0xd6c9_6d13_fa50_e605, 0x2eaa_ec36_b267_ffc5], 24_752_000),
            (
                "medium_tank.h5",
                1740,
                287,
                [0xf80c_af47_1bc6_1ef8, 0x1333_9c2c_e0ac_1efa, 0x10f0_6aa6_9ffa_3b05],
                20_123_000_000,
            ),
        ];
        for (name, count, points, checksums, last_ns) in known {
            let Some(path) = real_recording(name) else { return };
            let imported = import_h5(&path, None, &ImportOptions::default()).unwrap();
            let frames = &imported.frames;
            assert_eq!(frames.len(), count, "{name}");
            assert!(frames.iter().all(|f| f.samples.len() == points), "{name}");
            let samples = frames.iter().flat_map(|f| &f.samples);
            let samples = checksum(samples.flat_map(|s| [s.re, s.im]).flat_map(i16::to_le_bytes));
            let ticks = checksum(frames.iter().flat_map(|f| f.tick.to_le_bytes()));
            let temperatures = checksum(frames.iter().flat_map(|f| i64::from(f.temperature_c).to_le_bytes()));
            assert_eq!([samples, ticks, temperatures], checksums, "{name}");
            assert_eq!((frames[0].host_time_ns, frames[count - 1].host_time_ns), (0, last_ns), "{name}");
            assert!(!frames.iter().any(|f| f.data_saturated || f.frame_delayed || f.calibration_needed), "{name}");
        }
    }

    #[test]
    fn import_with_track_round_trips() {
        let (Some(frames), Some(track)) = (real_recording("medium_tank.h5"), real_recording("medium_tank_poses.tum"))
        else {
            return;
        };
        let imported = import_h5(&frames, Some(&track), &ImportOptions::default()).unwrap();
        assert_eq!(imported.header.source, "import of medium_tank.h5 and medium_tank_poses.tum");
        assert_eq!(imported.header.head_from_sensor, Pose::IDENTITY);
        assert_eq!(imported.header.sensor.board.as_deref(), Some("xm125"));
        assert_eq!(imported.header.sensor.base_step_length_m, Some(0.00250227400101721));
        assert_eq!(imported.header.config.subsweeps[0].start_point, -40);
        assert_eq!(imported.poses.len(), 354);
        assert_eq!((imported.poses[0].time_ns, imported.poses[0].position_m[2]), (5_508_000_000, -0.479641));
        let file = TestFile::new();
        let written = imported.write(&file.0).unwrap();
        let mut recording = Recording::open(&file.0).unwrap();
        let events: Vec<Event> = recording.by_ref().collect();
        assert!(recording.damage().is_none());
        assert_eq!(recording.header(), &imported.header);
        assert_same(&events, &imported.events().collect::<Vec<_>>());
        assert!(events.windows(2).all(|w| w[0].time_ns() <= w[1].time_ns()));
        assert_eq!(written, RecordingSummary::read(&file.0).unwrap());
    }

    #[test]
    fn foreign_files_are_rejected_with_a_reason() {
        let message = |path: &Path| import_h5(path, None, &ImportOptions::default()).unwrap_err().to_string();
        assert!(message(Path::new("/no/such.h5")).contains("cannot read /no/such.h5"));
        assert!(message(&std::env::temp_dir()).contains("is a folder"));
        assert!(message(&TestFile::with(b"").0).contains("cannot be read as HDF5"));
        assert!(message(&TestFile::with(b"timestamp_s tx ty tz").0).contains("cannot be read as HDF5"));
        let mut other = hdf5_pure::FileBuilder::new();
        other.create_dataset("data").with_f64_data(&[1.0]);
        let other = TestFile::with(&other.finish().unwrap());
        assert!(message(&other.0).contains("has neither `session` nor `sessions/session_0`"));
    }

    #[test]
    fn invalid_track_line_is_named() {
        let Some(frames) = real_recording("input.h5") else { return };
        let track = TestFile::with(b"# head\n\n0.1 0 0 0 0 0 0 1\n0.2 0 0\n");
        let error = import_h5(&frames, Some(&track.0), &ImportOptions::default()).unwrap_err().to_string();
        assert!(error.contains(", line 4: 3 columns instead of 8"), "{error}");
    }

    #[test]
    fn damaged_files_give_an_error_or_complete_frames() {
        for name in ["corner-reflector.h5", "input.h5"] {
            let Some(path) = real_recording(name) else { return };
            let bytes = std::fs::read(path).unwrap();
            let read = |bytes: &[u8]| import_h5(&TestFile::with(bytes).0, None, &ImportOptions::default());
            for length in (0..bytes.len()).step_by(bytes.len() / 37) {
                assert!(read(&bytes[..length]).is_err(), "{name} cut to {length}");
            }
            for position in (0..bytes.len()).step_by(bytes.len() / 211) {
                let mut damaged = bytes.clone();
                damaged[position] ^= 0xff;
                if let Ok(imported) = read(&damaged) {
                    let points = imported.header.config.points_per_frame();
                    assert!(imported.frames.iter().all(|f| f.samples.len() == points));
                }
            }
        }
    }
}
