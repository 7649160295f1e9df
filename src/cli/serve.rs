//! `simulate … --serve`: serves the simulated sensor on a port, for any program that speaks the
//! A121's protocol.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use num_complex::Complex;

use a121::device::{Board, Device, DeviceCounters, FaultPlan, FrameRequest, SampleSource, ServeAddress, Server};
use a121::monotonic_ns;
use radar_recording::{Existing, Readers, WholeFile, write_whole_through_links};
use radar_sar::geometry::Pose;
use radar_simulation::{LiveScenario, Scenario};

use super::outputs::{CommandFiles, Outputs, begins_with};
use crate::app::{refine_timers, stop_flag};

/// Length of the head's path, which is followed back and forth, seconds. Choice: longer than a play
/// session; bounds what is computed beforehand.
const PATH_S: f64 = 3600.0;
/// Longest duration, seconds: a year. Choice: far within i64 nanoseconds, and longer than any test.
const MAX_DURATION_S: f64 = 3.2e7;
/// Longest delay of the motion's start, seconds. Choice: the path's length.
const MAX_START_DELAY_S: f64 = 3600.0;

/// Arguments for serving instead of recording.
#[derive(Debug, Args)]
pub(super) struct Serve {
    /// Serves the sensor live instead of writing a recording: pty:PATH, or tcp:127.0.0.1:6110. The
    /// client sets its configuration
    #[arg(long, value_name = "PLACE", conflicts_with_all = ["out", "preset", "config"])]
    serve: Option<String>,
    /// Board to simulate; default: xc120
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(Board::ALL.map(Board::name)))]
    board: Option<String>,
    /// Faults per minute: drop, double, flip, garbage, stall, delay, burst, error, refuse,
    /// saturate, calibrate, wrap, jump, unplug, reboot, banner
    #[arg(long, value_name = "KIND=RATE,…")]
    faults: Option<String>,
    /// Writes the head poses as tracked: TUM format, times in seconds of this computer's monotonic
    /// clock
    #[arg(long, value_name = "TRACK.tum")]
    poses_out: Option<PathBuf>,
    /// Writes the whole track before serving starts, for a simulated headset that must look ahead;
    /// requires --duration-s, an hour at most
    #[arg(long, value_name = "TRACK.tum")]
    track_out: Option<PathBuf>,
    /// The motion starts this many seconds after the program, so that others can be ready; until
    /// then the head rests
    #[arg(long, value_name = "S")]
    start_in_s: Option<f64>,
    /// Lets other computers connect
    #[arg(long)]
    any_address: bool,
}

impl Serve {
    pub fn is_requested(&self) -> bool {
        self.serve.is_some()
    }

    /// Rejects arguments that require --serve.
    pub fn require_serve(&self) -> Result<()> {
        let given = [
            ("--board", self.board.is_some()),
            ("--faults", self.faults.is_some()),
            ("--poses-out", self.poses_out.is_some()),
            ("--track-out", self.track_out.is_some()),
            ("--start-in-s", self.start_in_s.is_some()),
            ("--any-address", self.any_address),
        ];
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => bail!("{name} is for serving: give --serve PLACE in place of --out"),
            None => Ok(()),
        }
    }

    /// What it writes, and the link that it makes.
    pub fn files(&self) -> CommandFiles {
        let link = self.serve.as_deref().and_then(|place| place.strip_prefix("pty:"));
        CommandFiles::default().reads(link).writes(&self.track_out, is_track).records(&self.poses_out, is_track)
    }

    /// Serves until Ctrl-C, or for a time, which replaces `scenario.duration_s`.
    pub fn run(&self, mut scenario: Scenario, duration_s: Option<f64>, outputs: &Outputs) -> Result<()> {
        if let Some(seconds) = duration_s.filter(|s| !(0.1..=MAX_DURATION_S).contains(s)) {
            bail!("a duration of {seconds} s cannot be served: give 0.1 to {MAX_DURATION_S} s, or leave it out");
        }
        if let Some(seconds) = self.start_in_s.filter(|s| !(0.0..=MAX_START_DELAY_S).contains(s)) {
            bail!("--start-in-s {seconds}: give 0 to {MAX_START_DELAY_S}");
        }
        if self.track_out.is_some() && duration_s.is_none_or(|s| s > PATH_S) {
            bail!("--track-out writes the whole track beforehand: give --duration-s, at most {PATH_S} s");
        }
        scenario.duration_s = PATH_S;
        let address = ServeAddress::parse(self.serve.as_deref().unwrap_or_default(), self.any_address)?;
        let name = self.board.as_deref().unwrap_or(Board::Xc120.name());
        let board = Board::from_name(name).ok_or_else(|| anyhow!("board \"{name}\" is not known"))?;
        let plan = FaultPlan::parse(self.faults.as_deref().unwrap_or_default())?;
        let live = scenario.live()?;
        let stopped = stop_flag()?;
        refine_timers();
        let origin_ns = monotonic_ns() + (self.start_in_s.unwrap_or(0.0) * 1e9) as i64;
        let offset_ns = (scenario.time_offset_s * 1e9) as i64;
        let poses = Poses { live: live.clone(), origin_ns, offset_ns };
        if let (Some(path), Some(duration_s)) = (&self.track_out, duration_s) {
            let text = poses.clone().whole_track(duration_s);
            write_whole_through_links(path, text.as_bytes(), Readers::Usual, outputs.existing(path))
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        let source = RoomSamples { live: live.clone(), origin_ns };
        let device = Device::new(board, Box::new(source), plan, scenario.seed, monotonic_ns());
        let mut server = Server::open(address.clone(), device)?;
        let track = self.poses_out.as_deref().map(|path| Track::create(path, outputs.existing(path)));
        let mut track = track.transpose()?;
        self.print_usage(&address, &scenario, board, origin_ns)?;
        let end_ns = duration_s.map_or(i64::MAX, |seconds| origin_ns + (seconds * 1e9) as i64);
        let mut poses = poses;
        while monotonic_ns() < end_ns && !stopped.load(Ordering::Relaxed) {
            let next_pose_ns = match &mut track {
                Some(track) => poses.write_due(track)?,
                None => i64::MAX,
            };
            server.step(next_pose_ns.min(end_ns))?;
        }
        outln!("{}", counters_text(&server.device().counters(), server.clients(), track.as_ref().map(|t| t.poses)))
    }

    fn print_usage(&self, address: &ServeAddress, scenario: &Scenario, board: Board, origin_ns: i64) -> Result<()> {
        let port = address.port();
        outln!(
            "{}, {}, seed {}, as a board {}, at {port}",
            scenario.scene,
            scenario.motion,
            scenario.seed,
            board.name()
        )?;
        // The poses are the head's, so their user needs the mount of the sensor.
        let (p, q) = (scenario.head_from_sensor.translation, scenario.head_from_sensor.rotation);
        let mount = format!("{},{},{},{},{},{},{}", p.x, p.y, p.z, q.x, q.y, q.z, q.w);
        let poses = |path: &PathBuf| format!(" --poses {} --mount {mount}", path.display());
        let poses = self.poses_out.as_ref().map_or(String::new(), poses);
        outln!("Try: radar-chaperone record --port {port}{poses} --out FILE.mcap")?;
        outln!("The motion begins at {} s of this computer's monotonic clock", seconds(origin_ns))?;
        outln!("Ctrl-C ends it")?;
        Ok(std::io::stdout().flush()?)
    }
}

fn counters_text(counters: &DeviceCounters, clients: u64, poses: Option<u64>) -> String {
    let DeviceCounters { results, delayed, lost, bytes, commands, faults } = counters;
    let faults: Vec<String> = faults.iter().map(|(fault, count)| format!("{} {count}", fault.name())).collect();
    let faults = if faults.is_empty() { "none".to_owned() } else { faults.join(", ") };
    let poses = poses.map_or(String::new(), |poses| format!("\nPoses    {poses}"));
    format!(
        "Clients  {clients}, {commands} commands\nSent     {results} results, {bytes} bytes; {delayed} late, {lost} \
         lost inside the board\nFaults   {faults}{poses}"
    )
}

/// Samples of the simulated room.
struct RoomSamples {
    live: LiveScenario,
    origin_ns: i64,
}

impl SampleSource for RoomSamples {
    fn frame(&mut self, request: &FrameRequest, samples: &mut Vec<Complex<i16>>) -> bool {
        let end_s = request.end_ns.saturating_sub(self.origin_ns) as f64 * 1e-9;
        // Every frame has its own noise, also after a restart.
        let number = (request.end_ns as u64) << 3 | u64::from(request.sensor_id);
        self.live.frame(request.config, number, end_s, samples)
    }
}

/// Poses as tracked.
#[derive(Clone)]
struct Poses {
    live: LiveScenario,
    origin_ns: i64,
    offset_ns: i64,
}

impl Poses {
    /// Writes all poses that are due and returns the time of the next one.
    fn write_due(&mut self, track: &mut Track) -> Result<i64> {
        loop {
            let at_ns = self.stamp_ns(self.live.next_pose_s());
            if at_ns > monotonic_ns() {
                return Ok(at_ns);
            }
            // The format cannot express an invalid pose.
            if let Some((stamp_s, pose)) = self.live.next_pose() {
                track.write(self.stamp_ns(stamp_s) + self.offset_ns, &pose)?;
            }
        }
    }

    /// All poses of this duration as a track; it has a gap where tracking is lost.
    fn whole_track(mut self, duration_s: f64) -> String {
        let mut text = HEAD_LINE.to_owned();
        while self.live.next_pose_s() <= duration_s {
            if let Some((stamp_s, pose)) = self.live.next_pose() {
                text += &track_line(self.stamp_ns(stamp_s) + self.offset_ns, &pose);
            }
        }
        text
    }

    /// Host time of a time of the scenario, nanoseconds.
    fn stamp_ns(&self, time_s: f64) -> i64 {
        self.origin_ns + (time_s * 1e9).round() as i64
    }
}

fn is_track(file: &Path) -> bool {
    begins_with(file, HEAD_LINE.as_bytes())
}

/// A track in the TUM format, flushed line by line.
struct Track {
    file: File,
    path: PathBuf,
    poses: u64,
}

impl Track {
    fn create(path: &Path, existing: Existing) -> Result<Self> {
        let file = Self::open(path, existing).with_context(|| format!("cannot write {}", path.display()))?;
        let mut track = Self { file, path: path.to_owned(), poses: 0 };
        track.put(HEAD_LINE)?;
        Ok(track)
    }

    /// A new file, which has its name from the beginning: others read along. Or a device or a pipe.
    fn open(path: &Path, existing: Existing) -> std::io::Result<File> {
        if std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
            return File::options().write(true).open(path);
        }
        if existing == Existing::Keep {
            return File::create_new(path);
        }
        // A link that the user names stays.
        let path = &path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let (whole, file) = WholeFile::create(path, Readers::Usual, existing)?;
        whole.finish(&file)?;
        Ok(file)
    }

    fn put(&mut self, line: &str) -> Result<()> {
        self.file.write_all(line.as_bytes()).with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn write(&mut self, time_ns: i64, pose: &Pose) -> Result<()> {
        self.poses += 1;
        self.put(&track_line(time_ns, pose))
    }
}

/// First line of a track.
const HEAD_LINE: &str = "# time_s x y z qx qy qz qw, of the monotonic clock\n";

fn track_line(time_ns: i64, pose: &Pose) -> String {
    let (p, q) = (pose.translation, pose.rotation);
    format!("{} {:.6} {:.6} {:.6} {:.8} {:.8} {:.8} {:.8}\n", seconds(time_ns), p.x, p.y, p.z, q.x, q.y, q.z, q.w)
}

/// Seconds with all nine digits.
fn seconds(time_ns: i64) -> String {
    format!("{}.{:09}", time_ns.div_euclid(1_000_000_000), time_ns.rem_euclid(1_000_000_000))
}
