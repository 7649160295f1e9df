//! The recording that `record` writes: created once the board has reported its type, in time order,
//! and passed to the disk three times a second.

use std::path::{Path, PathBuf};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use anyhow::Result;

use super::{EventMerger, PoseTail, now_ns};
use a121::SensorConfig;
use a121::{SetupReply, SystemInfo};
use radar_mapping::Event;
use radar_recording::{Header, RecordingSummary, RecordingWriter, SensorMetadata};
use radar_sar::geometry::Pose;

/// How long frames wait for poses, which another program or thread delivers later. Choice: a
/// program that writes a track flushes it several times a second; frames that wait longer would
/// cost memory and the last moments of a killed recording.
const POSE_WAIT: Duration = Duration::from_millis(500);
/// Interval of reads of the track, nanoseconds. Choice: a tenth of the time that frames wait for
/// poses.
const TRACK_POLL_NS: i64 = 50_000_000;
/// Interval of flushes, nanoseconds. Choice: with the wait for poses, a killed program or a power cut costs less than a second of
/// the recording; the disk is rarely bothered.
const FLUSH_NS: i64 = 300_000_000;

/// Bound of the poses of headset and hands that wait to be written: about four seconds. Choice: at
/// 250 head poses and 100 hand samples a second; longer than a disk usually stalls.
pub const MAX_WAITING_POSES: usize = 1536;

/// Source of the poses.
pub enum PoseSource {
    /// None.
    None,
    /// A file that another program writes.
    Track(PathBuf),
    /// This program, with the hands.
    Live(Receiver<Event>),
}

/// The recording, once there is one, and its inputs.
pub struct RecordFile {
    path: PathBuf,
    writer: Option<RecordingWriter>,
    sensor: Option<SensorMetadata>,
    merge: EventMerger,
    poses: Option<PoseTail>,
    live_poses: Option<Receiver<Event>>,
    flushed_ns: i64,
    tailed_ns: i64,
}

impl RecordFile {
    /// A recording to be written there; the file is created by [`begin`](Self::begin).
    pub fn new(path: &Path, poses: PoseSource) -> Self {
        let now_ns = now_ns();
        let hold_ns = if let PoseSource::None = poses { 0 } else { POSE_WAIT.as_nanos() as i64 };
        let (poses, live_poses) = match poses {
            PoseSource::None => (None, None),
            PoseSource::Track(path) => (Some(PoseTail::new(&path, now_ns)), None),
            PoseSource::Live(receiver) => (None, Some(receiver)),
        };
        Self {
            path: path.to_owned(),
            writer: None,
            sensor: None,
            merge: EventMerger::new(hold_ns),
            poses,
            live_poses,
            flushed_ns: now_ns,
            tailed_ns: now_ns,
        }
    }

    /// Creates the file, the first time that the board is set up.
    pub fn begin(
        &mut self,
        source: String,
        config: &SensorConfig,
        mount: Pose,
        info: &SystemInfo,
        board: &str,
        reply: &SetupReply,
    ) -> Result<()> {
        let sensor = SensorMetadata {
            ticks_per_second: Some(info.ticks_per_second),
            base_step_length_m: reply.metadata.iter().flatten().find_map(|metadata| metadata.base_step_length_m),
            board: Some(info.hw.clone().unwrap_or_else(|| board.to_owned())),
            rss_version: Some(info.rss_version.clone()),
        };
        match &self.sensor {
            None => {
                let header = Header { sensor: sensor.clone(), ..Header::new(source, config.clone(), mount) };
                self.writer = Some(RecordingWriter::create_live(&self.path, &header)?);
                self.sensor = Some(sensor);
            }
            Some(before) if *before != sensor => {
                log::warn!("another board answers now: the recording's header describes the first one");
            }
            Some(_) => {}
        }
        Ok(())
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the file exists.
    pub fn has_file(&self) -> bool {
        self.writer.is_some()
    }

    /// Takes an event of any stream.
    pub fn push(&mut self, event: Event) {
        self.merge.push(event);
    }

    /// Reads the track and writes events that have waited long enough.
    pub fn write_due(&mut self) -> Result<()> {
        let now_ns = now_ns();
        self.take_live_poses();
        if let Some(tail) = self.poses.as_mut().filter(|_| now_ns.saturating_sub(self.tailed_ns) >= TRACK_POLL_NS) {
            self.tailed_ns = now_ns;
            for pose in tail.read() {
                self.merge.push(Event::Pose(pose));
            }
            if let Some(warning) = tail.warning(now_ns) {
                log::warn!("{warning}");
            }
        }
        let Some(writer) = &mut self.writer else { return Ok(()) };
        while let Some(event) = self.merge.next_due(now_ns) {
            writer.write(&event)?;
        }
        if now_ns.saturating_sub(self.flushed_ns) >= FLUSH_NS {
            self.flushed_ns = now_ns;
            writer.flush()?;
        }
        Ok(())
    }

    /// Writes all waiting events and closes the file; `None`: it never existed.
    pub fn finish(mut self) -> Result<Option<(RecordingSummary, Option<String>)>> {
        let Some(mut writer) = self.writer.take() else { return Ok(None) };
        self.take_live_poses();
        if let Some(tail) = &mut self.poses {
            tail.read().into_iter().for_each(|pose| self.merge.push(Event::Pose(pose)));
        }
        while let Some(event) = self.merge.pop() {
            writer.write(&event)?;
        }
        let summary = writer.finish()?;
        Ok(Some((summary, self.track_summary())))
    }

    fn take_live_poses(&mut self) {
        let waiting = self.live_poses.iter().flat_map(Receiver::try_iter);
        waiting.for_each(|event| self.merge.push(event));
    }

    /// Summary of the track.
    fn track_summary(&self) -> Option<String> {
        let (tail, late) = (self.poses.as_ref()?, self.merge.late());
        let counters = tail.counters();
        Some(match tail.is_open() {
            true => format!(
                "Track      {} poses, {} invalid lines, {} from before the recording, {late} events out of order",
                counters.poses, counters.bad_lines, counters.before_start
            ),
            false => "Track      never appeared".to_owned(),
        })
    }
}
