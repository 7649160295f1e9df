//! `replay --results FILE.mcap`: writes the mapper's results into a copy of the recording.

use std::path::Path;

use anyhow::Result;

use crate::settings::Settings;
use crate::viewer::RecordingInfo;
use radar_mapping::{Event, Scene};
use radar_mapping::{Mapper, MapperCounters, MapperKind};
use radar_recording::{BeamCone, Existing, Header, ResultsCounters, ResultsWriter, Snapshot};

/// The copy of the recording with a result for every map update.
pub(super) struct Results {
    writer: ResultsWriter,
    /// Time of the newest event.
    newest_ns: Option<i64>,
}

impl Results {
    pub fn create(
        path: &Path,
        existing: Existing,
        header: &Header,
        settings: &Settings,
        search: MapperKind,
    ) -> Result<Self> {
        let about = RecordingInfo::new(header, settings, search, 0.0);
        let beam = BeamCone { cut_off_rad: about.beam_rad, ranges_m: about.ranges_m };
        // The beam is drawn at the mount of the settings.
        let header = Header { head_from_sensor: about.head_from_sensor, ..header.clone() };
        Ok(Self { writer: ResultsWriter::create(path, &header, beam, existing)?, newest_ns: None })
    }

    /// Writes an event; call it before the mapper takes the event.
    pub fn write(&mut self, event: &Event) -> Result<()> {
        Ok(self.writer.write(event)?)
    }

    /// Call it after the mapper has taken an event of that time, with the scene of a new map update.
    /// Single reflectors are searched at the end.
    pub fn update(&mut self, mapper: &Mapper, scene: Option<&Scene>, time_ns: i64) -> Result<()> {
        self.newest_ns = Some(time_ns);
        scene.map_or(Ok(()), |scene| self.snapshot(mapper, scene, time_ns))
    }

    fn snapshot(&mut self, mapper: &Mapper, scene: &Scene, time_ns: i64) -> Result<()> {
        let evidence = mapper.evidence(ResultsWriter::MAX_EVIDENCE);
        let snapshot = Snapshot {
            time_ns,
            head: mapper.head().map(|(_, head)| head),
            scene,
            evidence: &evidence,
            evidence_ns: mapper.evidence_ns(),
            calibration: &mapper.calibration(),
            counted: results_counters(&mapper.counters()),
        };
        Ok(self.writer.write_snapshot(&snapshot)?)
    }

    /// Call it after the mapper has finished.
    pub fn finish(mut self, mapper: &Mapper, scene: &Scene) -> Result<()> {
        let time_ns = self.newest_ns.unwrap_or(0);
        self.snapshot(mapper, scene, time_ns)?;
        self.writer.finish()?;
        Ok(())
    }
}

fn results_counters(counters: &MapperCounters) -> ResultsCounters {
    let MapperCounters { streams, engine, .. } = counters;
    ResultsCounters {
        frames: streams.frames,
        sweeps: streams.observations,
        poses: streams.poses,
        frames_left_out: streams.frames_saturated
            + streams.frames_wrong_length
            + streams.frames_time_not_rising
            + streams.frames_time_leapt
            + streams.frames_without_pose,
        sweeps_left_out: streams.sweeps_outside_poses
            + streams.sweeps_in_pose_gap
            + streams.sweeps_at_invalid_pose
            + engine.rooms.sweeps_without_block,
        poses_left_out: streams.poses_invalid
            + streams.poses_bad_numbers
            + streams.poses_time_not_rising
            + streams.poses_time_leapt,
        updates: engine.rooms.looks,
        removed: engine.rooms.forgotten,
    }
}
