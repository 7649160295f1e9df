//! Writes a recording together with its results. A snapshot is written after the event that led to
//! it, with the time of the event, so the file is ordered by time if the recording is.

use radar_mapping::Event;
use std::path::Path;

use foxglove::Encode;
use foxglove::messages::log::Level;
use foxglove::messages::{FrameTransform, Log, PointCloud, SceneUpdate};
use glam::{DQuat, DVec3};
use prost::Message;

use super::super::foxglove_messages::{SENSOR, TRACKING, timestamp, transform};
use super::super::writer::Topic;
use super::super::{Header, RecordingError, RecordingSummary, RecordingWriter};
use super::beam::BeamCone;
use super::cloud::{Dot, cloud, heat};
use super::entities::{beam_update, scene_update};
use super::figures::{DESCRIPTORS, SCHEMA, figures};
use super::log::LogState;
use super::outlines::{OBSTACLE, beam_dots, scene_dots};
use super::snapshot::{ResultsCounters, Snapshot};
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
/// A snapshot that is earlier than the one before by less than this is written just after it,
/// nanoseconds. Choice: as a jump of the streams' time stamps; a longer step is another recording's
/// time.
const MAX_CORRECTED_STEP_BACK_NS: i64 = 1_000_000_000;

/// Writer of a recording with results.
pub struct ResultsWriter {
    recording: RecordingWriter,
    beam: BeamCone,
    has_begun: bool,
    room: Topic,
    beam_lines: Topic,
    beam_dots: Topic,
    scene: Topic,
    points: Topic,
    outlines: Topic,
    evidence: Topic,
    figures: Topic,
    log: Topic,
    /// Names of the current entities of the scene.
    names: Vec<String>,
    log_state: LogState,
    before: Option<(i64, ResultsCounters)>,
    evidence_ns: Option<i64>,
    points_before: Option<Vec<Dot>>,
    outlines_before: Option<Vec<Dot>>,
}

impl ResultsWriter {
    /// Number of evidence voxels that are written at most.
    pub const MAX_EVIDENCE: usize = MAX_EVIDENCE;

    /// Creates or truncates the file and writes the header.
    ///
    /// # Errors
    /// A header that could not be read back, or a file that cannot be written.
    pub fn create(path: impl AsRef<Path>, header: &Header, beam: BeamCone) -> Result<Self, RecordingError> {
        Ok(Self {
            recording: RecordingWriter::create(path, header)?,
            beam,
            has_begun: false,
            room: Topic::foxglove::<FrameTransform>(20, "/room"),
            beam_lines: Topic::foxglove::<SceneUpdate>(21, "/beam"),
            beam_dots: Topic::foxglove::<PointCloud>(22, "/beam/outline"),
            scene: Topic::foxglove::<SceneUpdate>(23, "/scene"),
            points: Topic::foxglove::<PointCloud>(24, "/scene/points"),
            outlines: Topic::foxglove::<PointCloud>(25, "/scene/outlines"),
            evidence: Topic::foxglove::<PointCloud>(26, "/evidence"),
            figures: Topic::new(27, "/figures", SCHEMA, DESCRIPTORS),
            log: Topic::foxglove::<Log>(28, "/log"),
            names: Vec::new(),
            log_state: LogState::default(),
            before: None,
            evidence_ns: None,
            points_before: None,
            outlines_before: None,
        })
    }

    /// Writes an event of the recording.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write(&mut self, event: &Event) -> Result<(), RecordingError> {
        self.recording.write(event)?;
        match std::mem::replace(&mut self.has_begun, true) {
            true => Ok(()),
            false => self.begin(event.time_ns()),
        }
    }

    /// Writes the messages that occur once.
    fn begin(&mut self, time_ns: i64) -> Result<(), RecordingError> {
        let upright = Pose::new(DVec3::ZERO, DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2));
        put(&mut self.recording, &mut self.room, time_ns, &transform(time_ns, ROOM, TRACKING, &upright))?;
        put(&mut self.recording, &mut self.beam_lines, time_ns, &beam_update(time_ns, &self.beam))?;
        let dots = cloud(time_ns, SENSOR, &beam_dots(&self.beam));
        put(&mut self.recording, &mut self.beam_dots, time_ns, &dots)
    }

    /// Writes a snapshot.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write_snapshot(&mut self, snapshot: &Snapshot) -> Result<(), RecordingError> {
        let snapshot = &Snapshot { time_ns: self.rising(snapshot.time_ns), ..*snapshot };
        let time_ns = snapshot.time_ns;
        let recording = &mut self.recording;
        put(recording, &mut self.scene, time_ns, &scene_update(snapshot, &mut self.names))?;
        for (dots, before, topic) in [
            (shape_dots(snapshot.scene), &mut self.points_before, &mut self.points),
            (scene_dots(snapshot.scene), &mut self.outlines_before, &mut self.outlines),
        ] {
            if before.as_ref() != Some(&dots) {
                put(recording, topic, time_ns, &cloud(time_ns, TRACKING, &dots))?;
                *before = Some(dots);
            }
        }
        // A time that ran back must not suppress the evidence.
        self.evidence_ns.take_if(|then_ns| *then_ns > time_ns);
        if self.evidence_ns.is_none_or(|then_ns| time_ns.saturating_sub(then_ns) >= EVIDENCE_NS) {
            self.evidence_ns = Some(time_ns);
            put(recording, &mut self.evidence, time_ns, &cloud(time_ns, TRACKING, &evidence_dots(snapshot)))?;
        }
        let numbers = figures(snapshot, self.before.as_ref());
        recording.write_to_topic(&mut self.figures, time_ns, &numbers.encode_to_vec())?;
        for line in self.log_state.lines_for(snapshot) {
            let level = if line.is_warning { Level::Warning } else { Level::Info };
            let message = Log {
                timestamp: Some(timestamp(time_ns)),
                level: level.into(),
                message: line.text,
                name: NAME.to_owned(),
                ..Default::default()
            };
            put(recording, &mut self.log, time_ns, &message)?;
        }
        self.before = Some((time_ns, snapshot.counted));
        recording.count_scene();
        Ok(())
    }

    /// Makes the times of snapshots rise, except after large steps back in the recording.
    fn rising(&self, time_ns: i64) -> i64 {
        match self.before {
            Some((then, _)) if time_ns <= then && then.saturating_sub(time_ns) < MAX_CORRECTED_STEP_BACK_NS => {
                then.saturating_add(1)
            }
            _ => time_ns,
        }
    }

    /// Writes the index and ends the file; returns a summary.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn finish(self) -> Result<RecordingSummary, RecordingError> {
        self.recording.finish()
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
fn shape_dots(scene: &Scene) -> Vec<Dot> {
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

#[cfg(test)]
mod tests {
    use glam::{DMat3, Vec3};

    use super::super::super::test_files::{TestFile, assert_same, events, header};
    use super::super::super::{Recording, RecordingSummary};
    use super::*;
    use radar_mapping::{Evidence, Observed, Obstacle};

    const BEAM: BeamCone = BeamCone { cut_off_rad: 0.7, ranges_m: [0.2, 3.0] };

    fn scene(time_ns: i64, ids: std::ops::Range<u64>) -> Scene {
        let obstacle = |id: u64| Obstacle {
            provisional: false,
            id,
            position_m: DVec3::new(0.0, 1.0, -2.0 - id as f64),
            covariance_m2: DMat3::IDENTITY * 1e-4,
            observed: Observed::Position,
            extent_m: DVec3::splat(0.3),
            evidence: 12.0,
            shape: vec![(DVec3::new(0.0, 1.0, -2.0 - id as f64), 12.0)],
            first_seen_ns: 0,
            last_seen_ns: time_ns,
        };
        Scene { time_ns, obstacles: ids.map(obstacle).collect(), walls: vec![], moving: vec![] }
    }

    fn written(events: &[Event], scene: impl Fn(i64) -> Scene) -> TestFile {
        let file = TestFile::new();
        let mut writer = ResultsWriter::create(&file.0, &header(), BEAM).unwrap();
        let evidence = Evidence { voxel_m: 0.05, voxels: vec![(Vec3::X, 3.0), (Vec3::Y, 2.0)] };
        for event in events {
            writer.write(event).unwrap();
            let time_ns = event.time_ns();
            let snapshot = Snapshot {
                time_ns,
                head: None,
                scene: &scene(time_ns),
                evidence: &evidence,
                evidence_ns: None,
                time_offset_s: 0.0,
                estimate: None,
                counted: ResultsCounters::default(),
            };
            writer.write_snapshot(&snapshot).unwrap();
        }
        assert_eq!(writer.finish().unwrap().scenes, events.len() as u64);
        file
    }

    fn messages(file: &TestFile, topic: &str) -> Vec<(u64, Vec<u8>)> {
        let bytes = std::fs::read(&file.0).unwrap();
        let all = mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap());
        all.filter(|m| m.channel.topic == topic).map(|m| (m.log_time, m.data.to_vec())).collect()
    }

    #[test]
    fn results_do_not_affect_reading() {
        let events = events(1);
        let file = written(&events, |time_ns| scene(time_ns, 0..2));
        let mut recording = Recording::open(&file.0).unwrap();
        assert_same(&recording.by_ref().collect::<Vec<_>>(), &events);
        assert!(recording.damage().is_none());
        assert_eq!(RecordingSummary::read(&file.0).unwrap().frames.count, 20);
    }

    #[test]
    fn removed_obstacles_are_deleted_once_and_logged() {
        let events = events(1);
        // Obstacles 0 and 1, then only 1, then 1 and 2.
        let ids = |time_ns: i64| match time_ns / 300_000_000 {
            0 => 0..2,
            1 => 1..2,
            _ => 1..3,
        };
        let file = written(&events, |time_ns| scene(time_ns, ids(time_ns)));
        let updates = messages(&file, "/scene");
        let updates: Vec<SceneUpdate> =
            updates.iter().map(|(_, bytes)| SceneUpdate::decode(bytes.as_slice()).unwrap()).collect();
        let deleted: Vec<&str> = updates.iter().flat_map(|u| &u.deletions).map(|d| d.id.as_str()).collect();
        assert_eq!(deleted, ["obstacle 0"]);
        assert_eq!(updates.last().unwrap().entities.len(), 2);
        let log = messages(&file, "/log");
        let lines: Vec<String> = log.iter().map(|(_, bytes)| Log::decode(bytes.as_slice()).unwrap().message).collect();
        let found = lines.iter().filter(|line| line.contains(" found ")).count();
        assert_eq!((found, lines.iter().filter(|line| line.contains(" gone ")).count()), (3, 1), "{lines:?}");
    }

    #[test]
    fn topics_are_time_ordered_and_unchanged_data_is_written_once() {
        let file = written(&events(2), |time_ns| scene(time_ns, 0..2));
        for topic in ["/scene", "/figures", "/evidence", "/log"] {
            let times: Vec<u64> = messages(&file, topic).iter().map(|m| m.0).collect();
            assert!(!times.is_empty() && times.windows(2).all(|pair| pair[0] <= pair[1]), "{topic}: {times:?}");
        }
        for (topic, count) in [("/room", 1), ("/beam", 1), ("/beam/outline", 1), ("/scene/points", 1), ("/evidence", 4)]
        {
            assert_eq!(messages(&file, topic).len(), count, "{topic}");
        }
    }

    #[test]
    fn time_jumps_do_not_suppress_snapshots() {
        let mut events = events(2);
        if let Event::Pose(pose) = &mut events[10] {
            pose.time_ns = i64::MAX - 7;
        }
        let file = written(&events, |time_ns| scene(time_ns, 0..1));
        assert_eq!(messages(&file, "/figures").len(), events.len());
        assert!(messages(&file, "/evidence").len() >= 4);
    }
}
