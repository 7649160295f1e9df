//! `replay --results FILE.mcap`: writes the pipeline's results into a copy of the recording.

use std::path::Path;

use anyhow::Result;

use crate::settings::Settings;
use crate::view::RecordingInfo;
use radar_mapping::{Counters, MapperKind, Pipeline};
use radar_recording::{BeamCone, Event, Header, OffsetEstimate, ResultsCounters, ResultsWriter, Snapshot};

/// The copy of the recording with a result for every map update.
pub(super) struct Results {
    writer: ResultsWriter,
    looks: u64,
    /// Time of the newest event.
    newest_ns: Option<i64>,
}

impl Results {
    pub fn create(path: &Path, header: &Header, settings: &Settings, search: MapperKind) -> Result<Self> {
        let about = RecordingInfo::new(header, settings, search, 0.0);
        let beam = BeamCone { cut_off_rad: about.beam_rad, ranges_m: about.ranges_m };
        // The beam is drawn at the mount of the settings.
        let header = Header { head_from_sensor: about.head_from_sensor, ..header.clone() };
        Ok(Self { writer: ResultsWriter::create(path, &header, beam)?, looks: 0, newest_ns: None })
    }

    /// Writes an event; call it before the pipeline takes the event.
    pub fn write(&mut self, event: &Event) -> Result<()> {
        Ok(self.writer.write(event)?)
    }

    /// Call it after the pipeline has taken an event of that time.
    pub fn update(&mut self, pipeline: &Pipeline, time_ns: i64) -> Result<()> {
        self.newest_ns = Some(time_ns);
        // The search for single reflectors covers the whole recording at once: its scene is written
        // at the end.
        let looks = pipeline.counters().engine.rooms.looks;
        if pipeline.engine().search() == MapperKind::Rooms && looks != self.looks {
            self.looks = looks;
            self.snapshot(pipeline, time_ns)?;
        }
        Ok(())
    }

    fn snapshot(&mut self, pipeline: &Pipeline, time_ns: i64) -> Result<()> {
        let scene = pipeline.scene();
        let evidence = pipeline.engine().evidence(ResultsWriter::MAX_EVIDENCE);
        let estimate = pipeline.time_offset_estimate().filter(|estimate| estimate.observable);
        let snapshot = Snapshot {
            time_ns,
            head: pipeline.head().map(|(_, head)| head),
            scene: &scene,
            evidence: &evidence,
            evidence_ns: pipeline.engine().evidence_ns(),
            time_offset_s: pipeline.time_offset_s(),
            estimate: estimate.map(|e| OffsetEstimate { offset_s: e.offset_s, sigma_s: e.sigma_s }),
            counted: results_counters(&pipeline.counters()),
        };
        Ok(self.writer.write_snapshot(&snapshot)?)
    }

    /// Call it after the pipeline has finished.
    pub fn finish(mut self, pipeline: &Pipeline) -> Result<()> {
        let time_ns = self.newest_ns.unwrap_or(0);
        self.snapshot(pipeline, time_ns)?;
        self.writer.finish()?;
        Ok(())
    }
}

fn results_counters(counters: &Counters) -> ResultsCounters {
    let Counters { streams, engine, .. } = counters;
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
