//! `radar-chaperone replay FILE [--out DIR] [--view]`: runs the whole mapper over a recording.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::Args;

use super::files::{SettingsArguments, warn_of_damage};
use super::outputs::{CommandFiles, Outputs, ReplaceArgument, begins_with, is_png, never};
use super::results::Results;
use super::view::{ReplayEnd, ViewArguments, is_shot};
use crate::app::{correction_text, progress};
use crate::report::{
    CloudPoint, Figure, FilmRecorder, Limits, Report, RoomMap, Section, Table, cloud_bytes, obstacles_json, ply_bytes,
    room_map, score,
};
use crate::settings::Settings;
use crate::viewer::Recorder;
use radar_mapping::Event;
use radar_mapping::Mapper;
use radar_mapping::{MountInUse, Observed, Scene};
use radar_recording::{Header, MapFile, Recording, RecordingSummary, SparsePoses};
use radar_sar::geometry::Pose;

/// Events that are read at once, samples after which a batch ends earlier, and batches that wait. Choice: a batch is about a
/// second; whatever a file claims, three batches exist at a time, each of 4 MiB and a frame at most.
const BATCH: usize = 256;
const BATCH_SAMPLES: usize = 1 << 20;
const BATCHES_AHEAD: usize = 1;

/// Runs the mapper over a recording and writes what it finds
///
/// Prints the obstacles; with --out writes obstacles.json, a map (map.png) and report.html there,
/// and for tools that read point clouds obstacles.ply (positions with evidence and covariance) and
/// shape.ply (all points with evidence). Uses the recording's own settings, changed by --settings
/// and --set. The same recording and settings give the same files, byte for byte.
#[derive(Debug, Args)]
pub(super) struct Replay {
    /// Recording (.mcap)
    file: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Writes the recording again with the results of every map update; opens in Foxglove and in
    /// Rerun
    #[arg(long, value_name = "FILE.mcap")]
    results: Option<PathBuf>,
    /// Writes a short film of the room from above (.gif): how the map grows
    #[arg(long, value_name = "FILE.gif")]
    film: Option<PathBuf>,
    #[command(flatten)]
    replace: ReplaceArgument,
    /// Restores a map that `run` has saved, in the standing universe as it was then
    #[arg(long, value_name = "FILE.json")]
    map: Option<PathBuf>,
    /// Replays at this multiple of real time; default: as fast as possible
    #[arg(long, value_name = "X")]
    speed: Option<f64>,
    #[command(flatten)]
    settings: SettingsArguments,
    #[command(flatten)]
    view: ViewArguments,
}

impl Replay {
    pub fn run(&self) -> Result<()> {
        if let Some(speed) = self.speed.filter(|s| !(s.is_finite() && *s > 0.0)) {
            bail!("--speed {speed}: give a number above 0");
        }
        let outputs = self.files().check(self.replace)?;
        let summary = RecordingSummary::read(&self.file)?;
        let recording = Recording::open(&self.file)?;
        let settings = self.settings.over_recorded(&recording.header().settings)?;
        let header = recording.header().clone();
        let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &settings.mapping());
        if let Some(path) = &self.map {
            restore_map(&mut mapper, path, summary.frames.first_ns.unwrap_or(0))?;
        }
        let ended = if self.view.is_wanted() {
            let about = self.view.about(&summary, &settings, mapper.kind());
            let work = |recorder| self.work(recording, mapper, (&summary, &settings), &outputs, Some(recorder));
            self.view.show(about, &outputs, work)??
        } else {
            self.work(recording, mapper, (&summary, &settings), &outputs, None)?
        };
        match ended {
            ReplayEnd::Done(mapper, scene) => self.report(&summary, &settings, &mapper, &scene, &outputs),
            ReplayEnd::Closed => Ok(outln!("The view was closed before the recording was processed.")?),
        }
    }

    fn files(&self) -> CommandFiles {
        let files = CommandFiles::default().reads([&self.file]).reads(&self.map).reads(self.settings.file());
        let files = files.records(&self.results, never).writes(&self.film, never).writes(self.view.shots(), is_shot);
        match &self.out {
            Some(out) => files
                .writes([out.join("obstacles.json")], is_obstacles)
                .writes(["obstacles.ply", "shape.ply"].map(|name| out.join(name)), is_found_cloud)
                .writes([out.join("map.png")], is_found_picture)
                .writes([out.join("report.html")], is_found_page),
            None => files,
        }
    }

    /// Runs the recording through the mapper, to its end unless nobody needs the result any more.
    fn work(
        &self,
        mut recording: Recording,
        mut mapper: Mapper,
        (summary, settings): (&RecordingSummary, &Settings),
        files: &Outputs,
        recorder: Option<Recorder>,
    ) -> Result<ReplayEnd> {
        let results = match &self.results {
            Some(path) => Some(Results::create(path, files.existing(path), &summary.header, settings, mapper.kind())?),
            None => None,
        };
        let mut made = Made { results, recorder, film: self.film.as_ref().map(|_| FilmRecorder::default()) };
        let events = summary.frames.count + summary.poses.count + summary.hands.count;
        // On a thread of the pool: no stage of the mapper waits for one to wake up.
        if !rayon::scope(|_| self.feed(&mut recording, &mut mapper, events, &mut made))? {
            return Ok(ReplayEnd::Closed);
        }
        warn_of_damage(&recording);
        let spinner = progress::spinner("looking for obstacles");
        mapper.finish();
        let scene = mapper.scene();
        made.finish(&mapper, &scene)?;
        spinner.finish_and_clear();
        if let (Some(film), Some(path)) = (made.film, &self.film) {
            files.write(path, &film_bytes(&film, &summary.header, &mapper, &scene)?)?;
        }
        Ok(ReplayEnd::Done(Box::new(mapper), scene))
    }

    /// Prints the result and writes it where requested.
    fn report(
        &self,
        summary: &RecordingSummary,
        settings: &Settings,
        mapper: &Mapper,
        scene: &Scene,
        outputs: &Outputs,
    ) -> Result<()> {
        let header = &summary.header;
        let sparse = summary.sparse_poses(settings.tracking.history.max_gap_s);
        outln!("{}", result_text(scene, mapper, sparse.as_ref()).trim_end())?;
        let scored = header.truth.as_ref().map(|truth| score(scene, truth, &Limits::default()));
        if let Some(score) = &scored {
            outln!("\nAgainst the truth in the recording:\n{score}")?;
        }
        if let Some(out) = &self.out {
            outputs.write(&out.join("obstacles.json"), &obstacles_bytes(scene, mapper)?)?;
            write_clouds(out, scene, outputs)?;
            let path = sensor_path(mapper);
            let truth = header.truth.as_ref();
            let map = room_map(&RoomMap { title: &header.source, scene, truth, path_m: &path, region: None });
            outputs.write(&out.join("map.png"), &map.png()?)?;
            let mut section = Section::new("What was found")
                .figure(Figure::new(
                    &map,
                    "Seen from above: what was found, the sensor's path, and the truth if known",
                )?)
                .table(obstacle_table(scene));
            if let Some(score) = &scored {
                section = section.preformatted(score.to_string());
            }
            let counters = Section::new("What was taken and left out")
                .preformatted(serde_json::to_string_pretty(&mapper.counters())?);
            let recording = Section::new("The recording").preformatted(summary.to_string());
            let report = Report::new(&header.source)
                .intro("The mapper's result over one recording.")
                .section(section)
                .section(counters)
                .section(recording);
            outputs.write(&out.join("report.html"), report.html().as_bytes())?;
            outln!("\nWritten to {}", out.display())?;
        }
        Ok(())
    }

    /// Whether the result is still needed: for files, or by an open view.
    fn is_wanted(&self, recorder: Option<&Recorder>) -> bool {
        self.out.is_some()
            || self.results.is_some()
            || self.film.is_some()
            || !recorder.is_some_and(Recorder::is_closed)
    }

    /// Streams the recording at the requested speed; returns whether it reached the end. Another thread reads ahead.
    fn feed(&self, recording: &mut Recording, mapper: &mut Mapper, events: u64, made: &mut Made) -> Result<bool> {
        std::thread::scope(|scope| {
            let (sender, batches) = std::sync::mpsc::sync_channel(BATCHES_AHEAD);
            scope.spawn(move || {
                let batches = std::iter::from_fn(|| Some(next_batch(recording)));
                let _ = batches.take_while(|batch| !batch.is_empty()).try_for_each(|batch| sender.send(batch));
            });
            self.take(batches.into_iter().flatten(), mapper, events, made)
        })
    }

    fn take(
        &self,
        events: impl Iterator<Item = Event>,
        mapper: &mut Mapper,
        count: u64,
        made: &mut Made,
    ) -> Result<bool> {
        let bar = progress::bar(count, "replaying");
        let (start, mut first_ns) = (Instant::now(), None);
        for event in events {
            if !self.is_wanted(made.recorder.as_ref()) {
                bar.finish_and_clear();
                return Ok(false);
            }
            if let Some(speed) = self.speed {
                let since_ns = event.time_ns().saturating_sub(*first_ns.get_or_insert(event.time_ns()));
                // A leap in the recording's time is not waited for.
                let due = Duration::from_secs_f64((since_ns as f64 * 1e-9 / speed).clamp(0.0, 3600.0));
                std::thread::sleep(due.saturating_sub(start.elapsed()).min(Duration::from_secs(1)));
            }
            if let Some(results) = &mut made.results {
                results.write(&event)?;
            }
            let (time_ns, is_frame) = (event.time_ns(), matches!(event, Event::Frame(_)));
            if let Err(refusal) = mapper.push(event) {
                log::debug!("left out: {refusal}");
            }
            let scene = mapper.poll_scene();
            made.update(mapper, scene, time_ns, is_frame)?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(true)
    }

    /// A plain replay of a file, for viewing.
    pub(super) fn for_viewing(file: PathBuf, view: ViewArguments, replace: ReplaceArgument) -> Self {
        Self {
            file,
            out: None,
            results: None,
            film: None,
            replace,
            map: None,
            speed: None,
            settings: SettingsArguments::default(),
            view,
        }
    }
}

/// The next events of a recording; none at its end.
fn next_batch(recording: &mut Recording) -> Vec<Event> {
    let (mut events, mut samples) = (Vec::new(), 0);
    while events.len() < BATCH
        && samples < BATCH_SAMPLES
        && let Some(event) = recording.next()
    {
        if let Event::Frame(frame) = &event {
            samples += frame.samples.len();
        }
        events.push(event);
    }
    events
}

/// What is made of a replay while it runs.
struct Made {
    results: Option<Results>,
    recorder: Option<Recorder>,
    film: Option<FilmRecorder>,
}

impl Made {
    /// Takes the mapper's state after an event, with the scene if it is new.
    fn update(&mut self, mapper: &Mapper, scene: Option<Scene>, time_ns: i64, is_frame: bool) -> Result<()> {
        if let Some(results) = &mut self.results {
            results.update(mapper, scene.as_ref(), time_ns)?;
        }
        if let (Some(film), Some(scene)) = (&mut self.film, &scene) {
            film.record(time_ns, scene);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.record(mapper, scene, is_frame.then_some(time_ns));
        }
        Ok(())
    }

    /// Takes the last scene.
    fn finish(&mut self, mapper: &Mapper, scene: &Scene) -> Result<()> {
        if let Some(recorder) = &mut self.recorder {
            recorder.finish(mapper, scene.clone());
        }
        self.results.take().map_or(Ok(()), |results| results.finish(mapper, scene))
    }
}

fn film_bytes(film: &FilmRecorder, header: &Header, mapper: &Mapper, scene: &Scene) -> Result<Vec<u8>> {
    let path_ns: Vec<i64> = mapper.sensor_path().map(|(time_ns, _)| time_ns).collect();
    let (truth, path_m) = (header.truth.as_ref(), sensor_path(mapper));
    let map = RoomMap { title: &header.source, scene, truth, path_m: &path_m, region: None };
    Ok(film.gif(&map, &path_ns)?)
}

/// Restores a saved map as if it had been saved when the recording begins, so that no result
/// depends on the time of the replay.
fn restore_map(mapper: &mut Mapper, path: &Path, begin_ns: i64) -> Result<()> {
    let MapFile { map, standing_from_raw, .. } = MapFile::read(path)?;
    Ok(mapper.restore(&map.moved(&standing_from_raw).later_by_ns(begin_ns))?)
}

/// Path of the sensor, metres.
pub(super) fn sensor_path(mapper: &Mapper) -> Vec<glam::DVec3> {
    mapper.sensor_path().map(|(_, pose)| pose.translation).collect()
}

/// obstacles.json with all counters.
pub(super) fn obstacles_bytes(scene: &Scene, mapper: &Mapper) -> Result<Vec<u8>> {
    let counters = serde_json::to_value(mapper.counters())?;
    Ok(obstacles_json(scene, &counters, &mapper.calibration())?)
}

/// Whether a file is an obstacles.json.
pub(super) fn is_obstacles(file: &Path) -> bool {
    begins_with(file, b"{\n\"frame\":\"tracking\",\n\"obstacles\":[")
}

/// What else there is in a folder of results looks like others' files: an obstacles.json beside it shows what it is.
pub(super) fn is_found_picture(file: &Path) -> bool {
    is_png(file) && is_obstacles(&file.with_file_name("obstacles.json"))
}

pub(super) fn is_found_cloud(file: &Path) -> bool {
    begins_with(file, b"ply\n") && is_obstacles(&file.with_file_name("obstacles.json"))
}

fn is_found_page(file: &Path) -> bool {
    begins_with(file, b"<!doctype html>\n") && is_obstacles(&file.with_file_name("obstacles.json"))
}

/// Writes the obstacles' positions with evidence and covariance, and all their points, as point
/// clouds.
fn write_clouds(folder: &Path, scene: &Scene, outputs: &Outputs) -> Result<()> {
    let cloud_point = |obstacle: &radar_mapping::Obstacle| CloudPoint {
        position_m: obstacle.position_m,
        value: obstacle.evidence as f32,
        covariance_m2: Some(obstacle.covariance_m2),
    };
    let positions: Vec<CloudPoint> = scene.obstacles.iter().map(cloud_point).collect();
    outputs.write(&folder.join("obstacles.ply"), &cloud_bytes(&positions))?;
    let shape: Vec<_> = scene.obstacles.iter().flat_map(|obstacle| obstacle.shape.iter().copied()).collect();
    outputs.write(&folder.join("shape.ply"), &ply_bytes(&shape))
}

/// The result of a replay as text. `sparse`: whether its poses are too far apart.
pub(super) fn result_text(scene: &Scene, mapper: &Mapper, sparse: Option<&SparsePoses>) -> String {
    use std::fmt::Write;
    let streams = mapper.counters().streams;
    let mut text = format!(
        "{} frames, {} poses: {} sweeps imaged, {} frames without a pose skipped\n",
        streams.frames, streams.poses, streams.observations, streams.frames_without_pose
    );
    let left_out = [
        ("frames saturated", streams.frames_saturated),
        ("frames of wrong length", streams.frames_wrong_length),
        ("frames not later than the one before", streams.frames_time_not_rising),
        ("frames far ahead in time", streams.frames_time_leapt),
        ("poses far ahead in time", streams.poses_time_leapt),
        ("poses marked invalid", streams.poses_invalid),
        ("poses with impossible numbers", streams.poses_bad_numbers),
        ("poses not later than the one before", streams.poses_time_not_rising),
    ];
    for (what, count) in left_out.iter().filter(|(_, count)| *count > 0) {
        let _ = writeln!(text, "left out: {count} {what}");
    }
    if streams.tracking_jumps > 0 {
        let _ = writeln!(text, "the tracking jumped ({} times); the map did not", streams.tracking_jumps);
    }
    if let Some(sparse) = sparse.filter(|_| streams.sweeps_in_pose_gap > 0) {
        let _ = writeln!(text, "{} sweeps have no pose: {}", streams.sweeps_in_pose_gap, sparse.remedy());
    }
    if streams.observations == 0 {
        text +=
            "No sweep has a pose, so nothing could be imaged. `radar-chaperone info` shows what the recording holds.\n";
    }
    if let Some(reason) = mapper.counters().engine.no_subaperture() {
        let _ = writeln!(text, "{reason}");
    }
    let counted = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let (obstacles, walls) = (counted(scene.obstacles.len(), "obstacle"), counted(scene.walls.len(), "wall"));
    let _ = writeln!(text, "\n{obstacles}, {walls}");
    for obstacle in &scene.obstacles {
        let p = obstacle.position_m;
        let _ = writeln!(
            text,
            "  ({:6.3}, {:6.3}, {:6.3}) m  ± {}  evidence {:.1}  {}",
            p.x,
            p.y,
            p.z,
            sigmas(obstacle),
            obstacle.evidence,
            observed(obstacle.observed)
        );
    }
    for wall in &scene.walls {
        let n = wall.plane.outward;
        let _ = writeln!(
            text,
            "  wall towards ({:.2}, {:.2}, {:.2}) at {:.2} m  evidence {:.1}",
            n.x, n.y, n.z, wall.plane.offset_m, wall.evidence
        );
    }
    if let Some(biases_m) = mapper.calibration().range_bias_m {
        let biases: Vec<String> = biases_m.iter().map(|bias_m| format!("{:+.1}", bias_m * 1e3)).collect();
        let _ = writeln!(text, "ranges corrected for a bias of {} mm by subsweep", biases.join(", "));
    }
    let _ = writeln!(text, "{}", time_offset(mapper));
    if let Some(correction) = mount(&mapper.mount()) {
        let _ = writeln!(text, "{correction}");
    }
    text
}

/// What the data say against the assumed mount; `None` when they say nothing against it.
fn mount(mount: &MountInUse) -> Option<String> {
    let at =
        |pose: &Pose| format!("({:.3}, {:.3}, {:.3}) m", pose.translation.x, pose.translation.y, pose.translation.z);
    let (assumed, correction) = (at(&mount.assumed), correction_text(mount));
    if let Some(mistake) = mount.pose_mistake() {
        return Some(format!("the poses do not fit the echoes: likeliest, {mistake}"));
    }
    match (mount.is_corrected(), mount.is_contradicted()) {
        (true, _) => Some(format!(
            "mount {} on the head, corrected by {correction}: it is set to {assumed}; `calibrate` shows more",
            at(&mount.in_use)
        )),
        (false, true) => {
            Some(format!("the data contradict the mount {assumed}: `calibrate` shows where the sensor is"))
        }
        (false, false) => None,
    }
}

/// The time offset between the streams, in use and as estimated.
fn time_offset(mapper: &Mapper) -> String {
    let in_force = format!("{:+.1} ms", mapper.time_offset_s() * 1e3);
    let found = match mapper.time_offset_estimate() {
        Some(e) if e.observable => format!("the data give {:+.1} ± {:.1} ms", e.offset_s * 1e3, e.sigma_s * 1e3),
        Some(_) => "not observable: this motion does not separate it from depth".into(),
        None if mapper.counters().time_offset.estimates > 0 => "not estimated from the data".into(),
        None => "as set".into(),
    };
    format!("time offset {in_force}; {found}")
}

/// 1σ along x, y, z, centimetres.
fn sigmas(obstacle: &radar_mapping::Obstacle) -> String {
    let c = obstacle.covariance_m2;
    let cm = |variance: f64| format!("{:.1}", variance.max(0.0).sqrt() * 100.0);
    format!("({}, {}, {}) cm", cm(c.x_axis.x), cm(c.y_axis.y), cm(c.z_axis.z))
}

fn observed(observed: Observed) -> &'static str {
    match observed {
        Observed::Position => "",
        Observed::RangeAndOneDirection => "one direction was NOT observed",
        Observed::RangeOnly => "only the range was observed, its direction was NOT",
    }
}

/// The obstacles as a table.
pub(super) fn obstacle_table(scene: &Scene) -> Table {
    let row = |o: &radar_mapping::Obstacle| {
        let (p, e) = (o.position_m, o.extent_m);
        vec![
            format!("{:.3}, {:.3}, {:.3}", p.x, p.y, p.z),
            sigmas(o),
            format!("{:.2} × {:.2} × {:.2}", e.x, e.y, e.z),
            format!("{:.1}", o.evidence),
            observed(o.observed).to_owned(),
        ]
    };
    Table {
        head: ["position x, y, z (m)", "1σ along x, y, z", "extent (m)", "evidence", ""].map(String::from).to_vec(),
        rows: scene.obstacles.iter().map(row).collect(),
        caption: "Obstacles, tracking frame, strongest first".into(),
    }
}
