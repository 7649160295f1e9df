//! Topics of the results, each with what it has written before: messages that occur once, on a
//! change, or at most so often.

use foxglove::Encode;
use foxglove::messages::log::Level;
use foxglove::messages::{FrameTransform, Log, PointCloud, SceneUpdate};
use glam::{DQuat, DVec3};

use super::super::foxglove_messages::{SENSOR, TRACKING, timestamp, transform};
use super::super::writer::Topic;
use super::super::{RecordingError, RecordingWriter};
use super::beam::BeamCone;
use super::cloud::{Dot, cloud, heat};
use super::entities::{beam_update, scene_update};
use super::log::LogState;
use super::outlines::{OBSTACLE, beam_dots};
use super::snapshot::Snapshot;
use radar_mapping::Scene;
use radar_sar::geometry::Pose;

/// Name of the frame with +z up.
const ROOM: &str = "room";
/// Name of the logger.
const NAME: &str = "radar-chaperone";
/// Shortest interval of the evidence topic, nanoseconds, and limit of its voxels. Choice: evidence
/// changes slowly and is the largest part of a file, 80 kB/s at most.
const EVIDENCE_NS: i64 = 500_000_000;
const MAX_EVIDENCE: usize = 2000;
/// Limit of the voxels of all obstacles together. Choice: 120 kB a snapshot; a furnished room has
/// fewer.
const MAX_POINTS: usize = 6000;

/// What does not change: the frame of the room and the beam.
pub(super) struct OnceTopics {
    beam: BeamCone,
    written: bool,
    room: Topic,
    beam_lines: Topic,
    beam_dots: Topic,
}

impl OnceTopics {
    pub fn new(beam: BeamCone) -> Self {
        Self {
            beam,
            written: false,
            room: Topic::foxglove::<FrameTransform>(20, "/room"),
            beam_lines: Topic::foxglove::<SceneUpdate>(21, "/beam"),
            beam_dots: Topic::foxglove::<PointCloud>(22, "/beam/outline"),
        }
    }

    /// Writes them if they are not written yet.
    pub fn write(&mut self, recording: &mut RecordingWriter, time_ns: i64) -> Result<(), RecordingError> {
        if std::mem::replace(&mut self.written, true) {
            return Ok(());
        }
        let upright = Pose::new(DVec3::ZERO, DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2));
        put(recording, &mut self.room, time_ns, &transform(time_ns, ROOM, TRACKING, &upright))?;
        put(recording, &mut self.beam_lines, time_ns, &beam_update(time_ns, &self.beam))?;
        let dots = cloud(time_ns, SENSOR, &beam_dots(&self.beam));
        put(recording, &mut self.beam_dots, time_ns, &dots)
    }
}

/// The scene's entities.
pub(super) struct SceneTopic {
    topic: Topic,
    /// Names of the current entities.
    names: Vec<String>,
}

impl SceneTopic {
    pub fn new() -> Self {
        Self { topic: Topic::foxglove::<SceneUpdate>(23, "/scene"), names: Vec::new() }
    }

    pub fn write(&mut self, recording: &mut RecordingWriter, snapshot: &Snapshot) -> Result<(), RecordingError> {
        put(recording, &mut self.topic, snapshot.time_ns, &scene_update(snapshot, &mut self.names))
    }
}

/// Dots that are written when they change.
pub(super) struct DotsTopic {
    topic: Topic,
    before: Option<Vec<Dot>>,
}

impl DotsTopic {
    pub fn new(id: u16, name: &'static str) -> Self {
        Self { topic: Topic::foxglove::<PointCloud>(id, name), before: None }
    }

    pub fn write(
        &mut self,
        recording: &mut RecordingWriter,
        time_ns: i64,
        dots: Vec<Dot>,
    ) -> Result<(), RecordingError> {
        if self.before.as_ref() != Some(&dots) {
            put(recording, &mut self.topic, time_ns, &cloud(time_ns, TRACKING, &dots))?;
            self.before = Some(dots);
        }
        Ok(())
    }
}

/// The strongest voxels, at most so often.
pub(super) struct EvidenceTopic {
    topic: Topic,
    written_ns: Option<i64>,
}

impl EvidenceTopic {
    /// Number of voxels that are written at most.
    pub const MAX_VOXELS: usize = MAX_EVIDENCE;

    pub fn new() -> Self {
        Self { topic: Topic::foxglove::<PointCloud>(26, "/evidence"), written_ns: None }
    }

    pub fn write(&mut self, recording: &mut RecordingWriter, snapshot: &Snapshot) -> Result<(), RecordingError> {
        let time_ns = snapshot.time_ns;
        // A time that ran back must not suppress the evidence.
        self.written_ns.take_if(|then_ns| *then_ns > time_ns);
        if self.written_ns.is_none_or(|then_ns| time_ns.saturating_sub(then_ns) >= EVIDENCE_NS) {
            self.written_ns = Some(time_ns);
            put(recording, &mut self.topic, time_ns, &cloud(time_ns, TRACKING, &evidence_dots(snapshot)))?;
        }
        Ok(())
    }
}

/// The log.
pub(super) struct LogTopic {
    topic: Topic,
    state: LogState,
}

impl LogTopic {
    pub fn new() -> Self {
        Self { topic: Topic::foxglove::<Log>(28, "/log"), state: LogState::default() }
    }

    pub fn write(&mut self, recording: &mut RecordingWriter, snapshot: &Snapshot) -> Result<(), RecordingError> {
        let time_ns = snapshot.time_ns;
        for line in self.state.lines_for(snapshot) {
            let level = if line.is_warning { Level::Warning } else { Level::Info };
            let message = Log {
                timestamp: Some(timestamp(time_ns)),
                level: level.into(),
                message: line.text,
                name: NAME.to_owned(),
                ..Default::default()
            };
            put(recording, &mut self.topic, time_ns, &message)?;
        }
        Ok(())
    }
}

fn put<M: Encode>(
    recording: &mut RecordingWriter,
    topic: &mut Topic,
    time_ns: i64,
    message: &M,
) -> Result<(), RecordingError> {
    let mut bytes = Vec::new();
    // Encoding into memory cannot fail.
    let _ = message.encode(&mut bytes);
    recording.write_to_topic(topic, time_ns, &bytes)
}

/// The voxels of all obstacles; an obstacle without voxels is shown at its position.
pub(super) fn shape_dots(scene: &Scene) -> Vec<Dot> {
    let dots = scene.obstacles.iter().flat_map(|obstacle| {
        let alone = obstacle.shape.is_empty().then_some(obstacle.position_m);
        let positions = obstacle.shape.iter().map(|voxel| voxel.0).chain(alone);
        positions.map(|position| Dot { position: position.as_vec3(), value: obstacle.id as f32, rgba: OBSTACLE })
    });
    dots.take(MAX_POINTS).collect()
}

/// The strongest evidence; the strongest voxel is the brightest.
fn evidence_dots(snapshot: &Snapshot) -> Vec<Dot> {
    let voxels = &snapshot.evidence.voxels[..snapshot.evidence.voxels.len().min(MAX_EVIDENCE)];
    let (least, top) = voxels.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v.1), b.max(v.1)));
    let share = |score: f32| (score - least) / (top - least).max(f32::MIN_POSITIVE);
    voxels.iter().map(|&(position, score)| Dot { position, value: score, rgba: heat(share(score)) }).collect()
}
