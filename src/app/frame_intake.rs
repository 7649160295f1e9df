//! The sensor's stream: received, reported and recorded.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use a121::find::Candidate;
use a121::{Calibration, Event, Frame, LinkRequirement, LogLine, SensorConfig, Setup, SystemInfo};
use anyhow::{Context, Result, anyhow, bail};
use indicatif::ProgressBar;
use radar_recording::{Existing, Readers, RecordingError, write_whole_through_links};
use radar_sar::geometry::Pose;

use super::board_messages::BoardMessages;
use super::board_report::{config_table, counter_lines, line_speed, verdict};
use super::progress;
use super::record_file::RecordFile;
use super::{FrameLossCounter, Received, SensorStream, StreamEvent, StreamOptions};

/// Longest wait for the first frame. Choice: longer than a slow board's restart, baud change and
/// two retries take, so only a dead one fails.
const MAX_START: Duration = Duration::from_secs(30);
/// Interval of reads of the track and of writes. Choice: a stop feels immediate, and an idle line
/// costs twenty wake-ups a second.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// A chosen sensor and its set-up.
pub struct ChosenSensor {
    /// Board and address.
    pub place: Candidate,
    /// Name of the configuration.
    pub name: String,
    /// What the board is set up with.
    pub setup: Setup,
    /// `head_from_sensor`.
    pub mount: Pose,
    /// Speed of a serial port, bits per second; `None`: the fastest.
    pub baud: Option<u32>,
    /// Calibration to rewrite when the sensor was calibrated.
    pub calibration: Option<PathBuf>,
}

impl ChosenSensor {
    /// The sensor's configuration.
    pub fn config(&self) -> Result<&SensorConfig> {
        let sensor = self.setup.sensors().next().map(|sensor| &sensor.config);
        sensor.ok_or_else(|| anyhow!("the set-up has no sensor"))
    }

    /// `head_from_sensor`.
    pub fn mount(&self) -> Pose {
        self.mount
    }

    /// Board and address.
    pub fn place(&self) -> String {
        format!("{} on {}", self.place.board.name(), self.place.address)
    }

    /// Prints board and configuration, and logs warnings.
    pub fn print(&self) -> Result<()> {
        outln!("{}", self.place())?;
        let line = line_speed(&self.place, self.baud, None);
        outln!("{}", config_table(&self.name, self.config()?, line).trim_end())?;
        self.place.warnings.iter().for_each(|warning| log::warn!("{warning}"));
        Ok(())
    }

    /// Opens the port and starts the stream.
    pub fn open(&self) -> Result<SensorStream> {
        let options = StreamOptions { baud: self.baud, ..Default::default() };
        Ok(SensorStream::open(self.setup.clone(), &self.place, &options)?)
    }
}

/// Receives a stream: passes frames on, records them and reports faults.
pub struct FrameIntake<'a> {
    sensor: &'a ChosenSensor,
    file: Option<RecordFile>,
    /// Called with every frame.
    on_frame: &'a dyn Fn(&Frame),
    /// Follows whether the board is connected.
    is_connected: Option<&'a AtomicBool>,
    on_trouble: Option<&'a dyn Fn(&str)>,
    info: Option<SystemInfo>,
    frames: u64,
    losses: FrameLossCounter,
    messages: BoardMessages,
    first_frame: Option<Instant>,
    progress: ProgressBar,
}

/// When the intake ends.
#[derive(Debug, Clone, Copy)]
pub enum Until {
    /// This long after the first frame, which must come soon; `None`: when asked to stop.
    Recorded(Option<Duration>),
    /// When asked to stop.
    Stopped,
}

impl<'a> FrameIntake<'a> {
    /// `file`: records what is received; `on_frame` is called with every frame.
    pub fn new(sensor: &'a ChosenSensor, file: Option<RecordFile>, on_frame: &'a dyn Fn(&Frame)) -> Self {
        let progress = progress::spinner("waiting for the board");
        let losses = FrameLossCounter::default();
        let messages = BoardMessages::default();
        Self {
            sensor,
            file,
            on_frame,
            is_connected: None,
            on_trouble: None,
            info: None,
            frames: 0,
            losses,
            messages,
            first_frame: None,
            progress,
        }
    }

    /// Publishes from now on whether the board is connected: a stream outlives an unplugged board.
    pub fn with_presence(self, is_connected: &'a AtomicBool) -> Self {
        is_connected.store(true, Ordering::Relaxed);
        Self { is_connected: Some(is_connected), ..self }
    }

    /// Reports from now on why no frames come.
    pub fn with_troubles(self, on_trouble: &'a dyn Fn(&str)) -> Self {
        Self { on_trouble: Some(on_trouble), ..self }
    }

    /// Receives the stream until it ends or is asked to stop. `note` adds to the progress line.
    pub fn run(
        &mut self,
        stream: &SensorStream,
        stop: &AtomicBool,
        until: Until,
        note: &dyn Fn() -> String,
    ) -> Result<()> {
        let (start, mut shown_at) = (Instant::now(), Instant::now());
        while !stop.load(Ordering::Relaxed) {
            match stream.recv_timeout(POLL_INTERVAL) {
                Received::Event(event) => self.take(event)?,
                Received::TimedOut => {}
                Received::Closed => return Ok(()),
            }
            self.file.as_mut().map_or(Ok(()), RecordFile::write_due)?;
            if shown_at.elapsed() >= Duration::from_secs(1) {
                shown_at = Instant::now();
                self.show_progress(stream, &note());
            }
            match (self.first_frame, until) {
                (None, Until::Recorded(_)) if start.elapsed() > MAX_START => {
                    bail!("no frame within {} s: `radar-chaperone doctor` looks for the reason", MAX_START.as_secs())
                }
                (Some(first), Until::Recorded(Some(duration))) if first.elapsed() >= duration => return Ok(()),
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
                    (self.on_frame)(&frame.frame);
                    if let Some(file) = &mut self.file {
                        file.push(radar_mapping::Event::Frame(frame.frame));
                    }
                }
            }
            StreamEvent::Session(Event::Connected(info, _)) => {
                self.print_link(&info)?;
                self.info = Some(info);
            }
            StreamEvent::Session(Event::SetUp(reply)) => {
                let Some(info) = &self.info else { return Ok(()) };
                let ChosenSensor { place, setup, mount, calibration, .. } = self.sensor;
                if let Some(file) = &mut self.file {
                    let board = place.board.name();
                    file.begin(self.sensor.place(), self.sensor.config()?, *mount, info, board, &reply)?;
                }
                let is_new = !reply.calibrations.is_empty() && reply.calibrations != setup.calibrations;
                if let Some(path) = calibration.as_deref().filter(|_| is_new) {
                    write_calibrations(path, &reply.calibrations)?;
                }
            }
            StreamEvent::Session(Event::Streaming) => self.losses.restart(),
            StreamEvent::Session(Event::Failed(error)) => bail!(error),
            StreamEvent::Session(Event::Trouble(error)) => self.report_trouble(&error.to_string()),
            StreamEvent::Session(Event::Recalibrating) => {
                self.warn("the sensor asks for calibration, its temperature has changed: it is set up again");
            }
            StreamEvent::Session(Event::Log(line)) => self.log_board_line(&line),
            StreamEvent::Session(Event::Stopped) => {}
            StreamEvent::Reopened(address) => {
                self.set_connected(true);
                self.warn(&format!("the board is back on {address}"));
            }
            StreamEvent::Waiting(reason) => {
                self.set_connected(false);
                self.report_trouble(&format!("still waiting for the board: {reason}"));
            }
        }
        Ok(())
    }

    /// The board has reported its speed: prints it where it was unknown before.
    fn print_link(&self, info: &SystemInfo) -> Result<()> {
        if self.info.is_some() {
            return Ok(());
        }
        let ChosenSensor { place, baud, .. } = self.sensor;
        let board = info.hw.as_deref().unwrap_or(place.board.name());
        outln!("{board}, software {}, {} ticks a second", info.rss_version, info.ticks_per_second)?;
        let line = line_speed(place, *baud, Some(info));
        if line != line_speed(place, *baud, None)
            && let Some(line) = line
        {
            outln!("Carried by {line}: {}", verdict(&LinkRequirement::of(self.sensor.config()?), line))?;
        }
        Ok(())
    }

    fn set_connected(&self, is_connected: bool) {
        if let Some(presence) = self.is_connected {
            presence.store(is_connected, Ordering::Relaxed);
        }
    }

    fn report_trouble(&self, text: &str) {
        if let Some(on_trouble) = self.on_trouble {
            on_trouble(text);
        }
        self.warn(text);
    }

    fn warn(&self, text: &str) {
        self.progress.suspend(|| log::warn!("{text}"));
    }

    fn log_board_line(&mut self, line: &LogLine) {
        let shown = self.messages.take(line, Instant::now());
        self.progress.suspend(|| shown.iter().for_each(|(level, text)| log::log!(*level, "{text}")));
    }

    fn show_progress(&self, stream: &SensorStream, more: &str) {
        let Some(first) = self.first_frame else { return };
        let counters = stream.counters();
        let clock = counters.clock.unwrap_or_default();
        self.progress.set_message(format!(
            "{:.0} s  {} frames  {:.1}/s  {} lost  clock ±{:.0} µs, jitter {:.0} µs{more}",
            first.elapsed().as_secs_f64(),
            self.frames,
            self.frames as f64 / first.elapsed().as_secs_f64().max(1e-3),
            self.losses.lost(),
            clock.sigma_s * 1e6,
            clock.jitter_s * 1e6
        ));
    }

    /// Stops the board, receives what was on its way, closes the file and reports. Keeps what was
    /// recorded in any case.
    pub fn end(mut self, stream: SensorStream, done: Result<()>) -> Result<()> {
        stream.stop();
        let mut done = done;
        while let Received::Event(event) = stream.recv_timeout(MAX_START) {
            // The first fault is the one to report.
            let taken = self.take(event);
            done = done.and(taken);
        }
        let counters = stream.finish();
        self.progress.finish_and_clear();
        let counts = counter_lines(&counters, self.losses.lost());
        let Some(file) = self.file.take() else {
            counts.into_iter().try_for_each(|line| outln!("{line}"))?;
            return done;
        };
        let (has_file, out) = (file.has_file(), file.path().to_owned());
        match file.finish() {
            Ok(Some((summary, track))) => {
                outln!("{summary}")?;
                track.map_or(Ok(()), |track| outln!("{track}"))?;
                counts.into_iter().try_for_each(|line| outln!("{line}"))?;
                outln!("Written to {}", out.display())?;
            }
            Ok(None) if done.is_ok() => outln!("Nothing was recorded: it ended before the sensor was set up")?,
            Ok(None) => {}
            // It states itself where the recording is.
            Err(error) if is_elsewhere(&error) => {
                return Err(match done {
                    Ok(()) => error,
                    Err(first) => error.context(format!("{first:#}")),
                });
            }
            Err(error) => done = done.and(Err(error)),
        }
        done.with_context(|| match has_file {
            true => format!("the recording ended early; what was recorded is in {}", out.display()),
            false => "nothing was recorded".to_owned(),
        })
    }
}

fn is_elsewhere(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(RecordingError::Displaced { .. }))
}

fn write_calibrations(path: &Path, calibrations: &[Calibration]) -> Result<()> {
    let text = serde_json::to_string_pretty(calibrations)?;
    write_whole_through_links(path, text.as_bytes(), Readers::Usual, Existing::Replace)
        .with_context(|| format!("cannot write calibration {}", path.display()))
}
