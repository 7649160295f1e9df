//! Writes a recording together with its results. A snapshot is written after the event that led to
//! it, with the time of the event, so the file is ordered by time if the recording is.

use std::path::Path;

use prost::Message;

use super::super::writer::Topic;
use super::super::{Existing, Header, RecordingError, RecordingSummary, RecordingWriter};
use super::beam::BeamCone;
use super::figures::{DESCRIPTORS, SCHEMA, figures};
use super::outlines::scene_dots;
use super::snapshot::{ResultsCounters, Snapshot};
use super::topics::{DotsTopic, EvidenceTopic, LogTopic, OnceTopics, SceneTopic, shape_dots};
use radar_mapping::Event;

/// A snapshot that is earlier than the one before by less than this is written just after it,
/// nanoseconds. Choice: as a jump of the streams' time stamps; a longer step is another recording's
/// time.
const MAX_CORRECTED_STEP_BACK_NS: i64 = 1_000_000_000;

/// Writer of a recording with results.
pub struct ResultsWriter {
    recording: RecordingWriter,
    once: OnceTopics,
    scene: SceneTopic,
    points: DotsTopic,
    outlines: DotsTopic,
    evidence: EvidenceTopic,
    figures: Topic,
    log: LogTopic,
    /// Time and counters of the last snapshot.
    before: Option<(i64, ResultsCounters)>,
}

impl ResultsWriter {
    /// Number of evidence voxels that are written at most.
    pub const MAX_EVIDENCE: usize = EvidenceTopic::MAX_VOXELS;

    /// A file that appears under its name when it is finished.
    ///
    /// # Errors
    /// A header that could not be read back, or a file that cannot be written.
    pub fn create(
        path: impl AsRef<Path>,
        header: &Header,
        beam: BeamCone,
        existing: Existing,
    ) -> Result<Self, RecordingError> {
        Ok(Self {
            recording: RecordingWriter::create(path, header, existing)?,
            once: OnceTopics::new(beam),
            scene: SceneTopic::new(),
            points: DotsTopic::new(24, "/scene/points"),
            outlines: DotsTopic::new(25, "/scene/outlines"),
            evidence: EvidenceTopic::new(),
            figures: Topic::new(27, "/figures", SCHEMA, DESCRIPTORS),
            log: LogTopic::new(),
            before: None,
        })
    }

    /// Writes an event of the recording.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write(&mut self, event: &Event) -> Result<(), RecordingError> {
        self.recording.write(event)?;
        self.once.write(&mut self.recording, event.time_ns())
    }

    /// Writes a snapshot.
    ///
    /// # Errors
    /// The system refuses the bytes.
    pub fn write_snapshot(&mut self, snapshot: &Snapshot) -> Result<(), RecordingError> {
        let snapshot = &Snapshot { time_ns: self.rising(snapshot.time_ns), ..*snapshot };
        let time_ns = snapshot.time_ns;
        let recording = &mut self.recording;
        self.scene.write(recording, snapshot)?;
        self.points.write(recording, time_ns, shape_dots(snapshot.scene))?;
        self.outlines.write(recording, time_ns, scene_dots(snapshot.scene))?;
        self.evidence.write(recording, snapshot)?;
        let numbers = figures(snapshot, self.before.as_ref());
        recording.write_to_topic(&mut self.figures, time_ns, &numbers.encode_to_vec())?;
        self.log.write(recording, snapshot)?;
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

#[cfg(test)]
mod tests {
    use foxglove::messages::{Log, SceneUpdate};
    use glam::{DMat3, DVec3, Vec3};

    use super::super::super::test_files::{TestFile, assert_same, events, header};
    use super::super::super::{Recording, RecordingSummary};
    use super::*;
    use radar_mapping::{CalibrationInUse, Evidence, Observed, Obstacle, Scene};
    use radar_sar::geometry::Pose;

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
        let mut writer = ResultsWriter::create(&file.0, &header(), BEAM, Existing::Replace).unwrap();
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
                calibration: &CalibrationInUse::as_set(0.0, Pose::IDENTITY),
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
