//! `radar-chaperone record --out FILE.mcap`: the sensor's frames, and a pose track where there is one, as a recording.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use indicatif::ProgressBar;

use super::board::{BoardArguments, config_table, line_speed, told_counters, verdict};
use super::files::keep_inputs;
use super::import::parse_mount;
use super::progress;
use super::record_file::RecordFile;
use super::simulate::read_config;
use crate::a121::find::Candidate;
use crate::a121::{Calibration, Event, LogLine, Setup, SystemInfo};
use crate::geometry::Pose;
use crate::live::{Losses, Received, SensorStream, StreamEvent, StreamOptions};
use crate::radar::{LinkNeed, PRESETS, SensorConfig, preset};
use crate::recording;

/// A board that sends no frame by then never will.
const PATIENCE: Duration = Duration::from_secs(30);
/// How often the track is looked at and what is due is written.
const TURN: Duration = Duration::from_millis(50);
/// Longest file of calibrations.
const MAX_CALIBRATION_BYTES: u64 = 1 << 20;

/// Records a sensor's frames, and head poses from a track
///
/// Ctrl-C ends the recording properly; a crash costs its last second or two. What goes wrong on the line is told and
/// cured where it can be: the sensor is set up again, an unplugged board is waited for.
#[derive(Debug, Args)]
pub(super) struct Record {
    /// Recording to write; must not be there yet
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    #[command(flatten)]
    board: BoardArguments,
    /// Sensor preset; without it d16 on XC120 and Raspberry Pi, c16 on XE125, slow-link on boards with a CH340
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    preset: Option<String>,
    /// Sensor configuration (JSON, named as in the vendor's protocol) in place of a preset
    #[arg(long, value_name = "FILE.json", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Length, seconds from the first frame; without it until Ctrl-C
    #[arg(long)]
    duration_s: Option<f64>,
    /// Head poses, read while another program writes them: TUM format, times in seconds of this computer's monotonic clock
    #[arg(long, value_name = "TRACK.tum")]
    poses: Option<PathBuf>,
    /// Where the sensor sits on what is tracked: x,y,z in metres, or x,y,z,qx,qy,qz,qw
    #[arg(long, value_name = "x,y,z[,qx,qy,qz,qw]", allow_hyphen_values = true)]
    mount: Option<String>,
    /// Calibration to use again; written anew when the sensor was calibrated
    #[arg(long, value_name = "FILE.json")]
    calibration: Option<PathBuf>,
}

/// A recording under way.
struct Recorder<'a> {
    place: &'a Candidate,
    setup: &'a Setup,
    baud: Option<u32>,
    mount: Pose,
    calibration: Option<&'a Path>,
    file: RecordFile,
    info: Option<SystemInfo>,
    frames: u64,
    losses: Losses,
    first_frame: Option<Instant>,
    progress: ProgressBar,
}

impl Record {
    pub fn run(&self) -> Result<()> {
        self.check_files()?;
        let mount = self.mount.as_deref().map_or(Ok(Pose::IDENTITY), parse_mount)?;
        let place = self.board.choose()?;
        let (name, config) = self.config_for(&place)?;
        let mut setup = Setup::single(self.board.sensor, config.clone());
        setup.calibrations = self.calibration.as_deref().map_or(Ok(Vec::new()), read_calibrations)?;
        say!("{} on {}", place.board.name(), place.address)?;
        let line = line_speed(&place, self.board.baud, None);
        say!("{}", config_table(&name, &config, line).trim_end())?;
        place.warnings.iter().for_each(|warning| log::warn!("{warning}"));
        if self.poses.is_none() {
            say!("No pose track: frames alone are recorded; ranges can be read from them, places cannot")?;
        }
        let stop = stop_flag()?;
        let options = StreamOptions { baud: self.board.baud, ..Default::default() };
        let stream = SensorStream::open(setup.clone(), &place, &options)?;
        let mut recorder = Recorder {
            place: &place,
            setup: &setup,
            baud: self.board.baud,
            mount,
            calibration: self.calibration.as_deref(),
            file: RecordFile::new(&self.out, self.poses.as_deref()),
            info: None,
            frames: 0,
            losses: Losses::default(),
            first_frame: None,
            progress: progress::spinner("waiting for the board"),
        };
        let done = recorder.record(&stream, &stop, self.duration_s.map(Duration::from_secs_f64));
        recorder.end(stream, &self.out, done)
    }

    fn check_files(&self) -> Result<()> {
        let inputs: Vec<&Path> =
            [&self.poses, &self.config, &self.calibration].into_iter().flatten().map(PathBuf::as_path).collect();
        keep_inputs(&self.out, &inputs)?;
        if self.out.exists() {
            bail!("{} is there already: choose another name for --out, or remove it", self.out.display());
        }
        let folder = self.out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("there is no folder {}: make it, or choose another name for --out", folder.display());
        }
        if let Some(duration_s) = self.duration_s.filter(|s| !(*s > 0.0 && *s <= 1e7)) {
            bail!("--duration-s {duration_s}: give seconds above 0, at most 10000000");
        }
        if let Some(track) = self.poses.as_ref().filter(|track| track.exists() && !track.is_file()) {
            bail!("{} is a folder or a device: give the track's file", track.display());
        }
        Ok(())
    }

    /// The configuration asked for, else the board's default, with its name.
    fn config_for(&self, place: &Candidate) -> Result<(String, SensorConfig)> {
        if let Some(path) = &self.config {
            return Ok((path.display().to_string(), read_config(path)?));
        }
        let name = self.preset.as_deref().unwrap_or(place.board.default_preset());
        let config = preset(name).ok_or_else(|| anyhow!("preset \"{name}\" is not known"))?;
        Ok((name.to_owned(), config))
    }
}

impl Recorder<'_> {
    fn record(&mut self, stream: &SensorStream, stop: &AtomicBool, duration: Option<Duration>) -> Result<()> {
        let (start, mut told) = (Instant::now(), Instant::now());
        while !stop.load(Ordering::Relaxed) {
            match stream.recv_timeout(TURN) {
                Received::Event(event) => self.take(event)?,
                Received::TimedOut => {}
                Received::Over => return Ok(()),
            }
            self.file.write_due()?;
            if told.elapsed() >= Duration::from_secs(1) {
                told = Instant::now();
                self.tell_progress(stream);
            }
            match (self.first_frame, duration) {
                (None, _) if start.elapsed() > PATIENCE => {
                    bail!("no frame within {} s: `radar-chaperone doctor` looks for the reason", PATIENCE.as_secs())
                }
                (Some(first), Some(duration)) if first.elapsed() >= duration => return Ok(()),
                _ => {}
            }
        }
        Ok(())
    }

    fn take(&mut self, event: StreamEvent) -> Result<()> {
        match event {
            StreamEvent::Session(Event::Frames(frames)) => {
                for frame in frames {
                    self.frames += 1;
                    self.first_frame.get_or_insert_with(Instant::now);
                    self.losses.push(frame.frame.tick);
                    self.file.push(recording::Event::Frame(frame.frame));
                }
            }
            StreamEvent::Session(Event::Connected(info, _)) => {
                self.tell_link(&info)?;
                self.info = Some(info);
            }
            StreamEvent::Session(Event::SetUp(reply)) => {
                let Some(info) = &self.info else { return Ok(()) };
                let Some(sensor) = self.setup.sensors().next() else { return Ok(()) };
                let board = self.place.board.name();
                let source = format!("{board} on {}", self.place.address);
                self.file.begin(source, &sensor.config, self.mount, info, board, &reply)?;
                let is_new = !reply.calibrations.is_empty() && reply.calibrations != self.setup.calibrations;
                if let Some(path) = self.calibration.filter(|_| is_new) {
                    write_calibrations(path, &reply.calibrations)?;
                }
            }
            StreamEvent::Session(Event::Streaming) => self.losses.begin(),
            StreamEvent::Session(Event::Failed(error)) => bail!(error),
            StreamEvent::Session(Event::Trouble(error)) => self.warn(&error.to_string()),
            StreamEvent::Session(Event::Recalibrating) => {
                self.warn("the sensor asks for calibration, its temperature has changed: it is set up anew");
            }
            StreamEvent::Session(Event::Log(line)) => self.tell_log(&line),
            StreamEvent::Session(Event::Stopped) => {}
            StreamEvent::Reopened(address) => self.warn(&format!("the board is back on {address}")),
            StreamEvent::Waiting(reason) => self.warn(&format!("still waiting for the board: {reason}")),
        }
        Ok(())
    }

    /// The board has told its speed: says so where it was not known, or does not carry the configuration.
    fn tell_link(&self, info: &SystemInfo) -> Result<()> {
        let Some(sensor) = self.setup.sensors().next().filter(|_| self.info.is_none()) else { return Ok(()) };
        let board = info.hw.as_deref().unwrap_or(self.place.board.name());
        say!("{board}, software {}, {} ticks a second", info.rss_version, info.ticks_per_second)?;
        let line = line_speed(self.place, self.baud, Some(info));
        if line != line_speed(self.place, self.baud, None)
            && let Some(line) = line
        {
            say!("Carried by {line}: {}", verdict(&LinkNeed::of(&sensor.config), line))?;
        }
        Ok(())
    }

    fn warn(&self, text: &str) {
        self.progress.suspend(|| log::warn!("{text}"));
    }

    fn tell_log(&self, line: &LogLine) {
        let is_grave = ["error", "warning", "ERROR", "WARNING"].contains(&line.level.as_str());
        let level = if is_grave { log::Level::Warn } else { log::Level::Debug };
        self.progress.suspend(|| log::log!(level, "the board says ({}): {}", line.module, line.text));
    }

    fn tell_progress(&self, stream: &SensorStream) {
        let Some(first) = self.first_frame else { return };
        let counters = stream.counters();
        let clock = counters.clock.unwrap_or_default();
        self.progress.set_message(format!(
            "{:.0} s  {} frames  {:.1}/s  {} lost  clock ±{:.0} µs, jitter {:.0} µs",
            first.elapsed().as_secs_f64(),
            self.frames,
            self.frames as f64 / first.elapsed().as_secs_f64().max(1e-3),
            self.losses.lost(),
            clock.sigma_s * 1e6,
            clock.jitter_s * 1e6
        ));
    }

    /// Stops the board, takes what was on its way, ends the file, and tells; whatever went wrong, what there is is kept.
    fn end(mut self, stream: SensorStream, out: &Path, done: Result<()>) -> Result<()> {
        stream.stop();
        let mut done = done;
        while let Received::Event(event) = stream.recv_timeout(PATIENCE) {
            // The first fault is the one to tell.
            let taken = self.take(event);
            done = done.and(taken);
        }
        let counters = stream.finish();
        self.progress.finish_and_clear();
        let lost = self.losses.lost();
        let is_begun = self.file.is_begun();
        match self.file.finish() {
            Ok(Some((summary, track))) => {
                say!("{summary}")?;
                track.map_or(Ok(()), |track| say!("{track}"))?;
                told_counters(&counters, lost).into_iter().try_for_each(|line| say!("{line}"))?;
                say!("Written to {}", out.display())?;
            }
            Ok(None) if done.is_ok() => say!("Nothing was recorded: it ended before the sensor was set up")?,
            Ok(None) => {}
            Err(error) => done = done.and(Err(error)),
        }
        done.with_context(|| match is_begun {
            true => format!("the recording ended early; what was recorded is in {}", out.display()),
            false => "nothing was recorded".to_owned(),
        })
    }
}

/// What ends a recording properly: Ctrl-C, being told to end, and the terminal's closing.
#[cfg(unix)]
const ENDING_SIGNALS: [i32; 3] =
    [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];
/// What ends a recording properly.
#[cfg(not(unix))]
const ENDING_SIGNALS: [i32; 2] = [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM];

/// Set by the first signal to end; the second ends the program at once.
fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in ENDING_SIGNALS {
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Calibrations of an earlier recording; none where there is no file yet.
fn read_calibrations(path: &Path) -> Result<Vec<Calibration>> {
    let about = || format!("cannot read calibration {}", path.display());
    match std::fs::metadata(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Ok(metadata) if metadata.len() > MAX_CALIBRATION_BYTES => {
            bail!("{} is no calibration: too long", path.display())
        }
        metadata => metadata.with_context(about)?,
    };
    let text = std::fs::read_to_string(path).with_context(about)?;
    serde_json::from_str(&text).with_context(|| format!("{} is no calibration", path.display()))
}

fn write_calibrations(path: &Path, calibrations: &[Calibration]) -> Result<()> {
    let text = serde_json::to_string_pretty(calibrations)?;
    std::fs::write(path, text).with_context(|| format!("cannot write calibration {}", path.display()))
}
