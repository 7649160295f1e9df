//! `radar-chaperone doctor`: checks everything from this computer to warnings in the headset, one
//! line each, with remedies.

use std::time::{Duration, Instant};

use anyhow::{Result, anyhow, bail};
use clap::Args;

use super::board::BoardArguments;
use super::doctor_steamvr::{check_steamvr, check_steamvr_apart};
use super::findings::Findings;
use crate::app::{FrameLossCounter, Received, SensorStream, StreamEvent, StreamOptions};
use crate::app::{counter_lines, line_speed, preset_table};
use a121::find::{Candidate, boards_without_port, discover, list_ports};
use a121::preset;
use a121::remedy::{MODEM_MANAGER_REMEDY, modem_manager_runs, owning_group};
use a121::{Address, Event, SensorInfo, Setup, SystemInfo};

/// How long frames are measured. Choice: a hundred frames or more, of which the 99th percentile can
/// be stated, without making the user wait.
const MEASURING_TIME: Duration = Duration::from_secs(2);
/// Longest wait for the first frame. Choice: a cold board's break, set-up and one repetition fit.
const MAX_START: Duration = Duration::from_secs(15);
/// Largest 99th percentile of the hand-over latency that gives no warning, seconds. Choice: 5 ms
/// more age moves an obstacle by 6 mm at walking speed.
const MAX_P99_S: f64 = 5e-3;

/// Checks SteamVR, headset, graphics card, port, permissions, board, sensor and link, and says what
/// to do
///
/// Exits with 1 when something must be fixed. Without a sensor, `radar-chaperone simulate … --serve
/// tcp:127.0.0.1:6110` simulates one: `radar-chaperone doctor --port tcp:127.0.0.1`.
#[derive(Debug, Args)]
pub(super) struct Doctor {
    #[command(flatten)]
    board: BoardArguments,
    /// Checks SteamVR alone, in this process.
    #[arg(long, hide = true)]
    steamvr_in_this_process: bool,
}

/// What the board reported up to its first frames.
#[derive(Default)]
struct BoardReport {
    info: Option<SystemInfo>,
    sensors: Vec<SensorInfo>,
    frames: u64,
    first_frame: Option<Instant>,
    losses: FrameLossCounter,
    trouble: Option<String>,
}

impl Doctor {
    pub fn run(&self) -> Result<()> {
        let mut findings = Findings::default();
        if self.steamvr_in_this_process {
            return check_steamvr(&mut findings);
        }
        self.check(&mut findings)?;
        match findings.to_fix {
            0 => Ok(()),
            1 => bail!("one problem must be fixed"),
            count => bail!("{count} problems must be fixed"),
        }
    }

    fn check(&self, findings: &mut Findings) -> Result<()> {
        check_steamvr_apart(findings)?;
        check_ports(findings, self.board.names_port())?;
        let candidate = match self.board.choose() {
            Ok(candidate) => candidate,
            Err(error) => {
                findings.fix("Board", &error.to_string())?;
                outln!(
                    "\nWithout a sensor: `radar-chaperone simulate furnished-room --serve tcp:127.0.0.1:6110` makes one,"
                )?;
                outln!("then `radar-chaperone doctor --port tcp:127.0.0.1`.\n\nWhat presets need:")?;
                return outln!("{}", preset_table(None).trim_end());
            }
        };
        findings.ok("Board", &format!("{} on {}", candidate.board.name(), candidate.address))?;
        candidate.warnings.iter().try_for_each(|warning| findings.warn("Board", warning))?;
        check_access(findings, &candidate)?;
        let name = candidate.board.default_preset();
        let config = preset(name).ok_or_else(|| anyhow!("preset \"{name}\" is not known"))?;
        let options = StreamOptions { baud: self.board.baud, ..Default::default() };
        let stream = match SensorStream::open(Setup::single(self.board.sensor, config), &candidate, &options) {
            Ok(stream) => stream,
            Err(error) => return findings.fix("Opens", &error.to_string()),
        };
        let opened =
            if let Address::Tcp(_) = candidate.address { "connected" } else { "115200 baud, 8 bits, exclusive" };
        findings.ok("Opens", opened)?;
        let heard = listen(&stream);
        self.check_board(findings, &candidate, &heard)?;
        if let Some(trouble) = &heard.trouble {
            return findings.fix(if heard.info.is_some() { "Sensor" } else { "Answers" }, trouble);
        }
        check_stream(findings, stream, &heard, name)
    }

    fn check_board(&self, findings: &Findings, candidate: &Candidate, heard: &BoardReport) -> Result<()> {
        let Some(info) = &heard.info else { return Ok(()) };
        let board = info.hw.as_deref().unwrap_or(candidate.board.name());
        findings.ok("Answers", &format!("{board}, {} ticks a second", info.ticks_per_second))?;
        findings.ok("Version", &format!("{}, new enough", info.rss_version))?;
        let connected: Vec<String> =
            (1..).zip(&heard.sensors).filter(|(_, s)| s.connected).map(|(n, _)| n.to_string()).collect();
        findings.ok("Sensors", &format!("connected: {} of {}", connected.join(", "), info.sensor_count))?;
        let line = line_speed(candidate, self.board.baud, Some(info));
        let max = info
            .max_baudrate
            .map_or("the board reports no speed".to_owned(), |max| format!("the board's fastest is {max}"));
        match line {
            Some(line) => findings.ok("Speed", &format!("{line}; {max}"))?,
            None => findings.warn("Speed", &format!("{max}: what the line carries is not known"))?,
        }
        outln!("\n{}", preset_table(line))
    }
}

/// With a named port, missing USB ports are no finding.
fn check_ports(findings: &Findings, is_named: bool) -> Result<()> {
    let ports = list_ports();
    let found = discover(&ports);
    let without_port = boards_without_port();
    without_port.iter().try_for_each(|board| findings.warn("Ports", &board.to_string()))?;
    if !is_named && without_port.is_empty() && ports.iter().all(|port| port.usb.is_none()) {
        findings.warn(
            "Ports",
            "there is no serial port on USB: is the board plugged in, with a cable that carries data?",
        )?;
    }
    for candidate in &found.candidates {
        let port = ports.iter().find(|port| port.path == candidate.address.to_string());
        findings
            .ok("Ports", &format!("{}: {}", port.map_or(String::new(), ToString::to_string), candidate.board.name()))?;
    }
    for (port, reason) in found.rejected.iter().filter(|(port, _)| port.usb.is_some()) {
        findings.ok("Ports", &format!("{port}: left out, {reason}"))?;
    }
    Ok(())
}

fn check_access(findings: &Findings, candidate: &Candidate) -> Result<()> {
    let Address::Serial { path, .. } = &candidate.address else { return Ok(()) };
    if let Some(group) = owning_group(path) {
        findings.ok("Access", &format!("{path} belongs to group {group}"))?;
    }
    match modem_manager_runs() {
        _ if cfg!(windows) => Ok(()),
        true => findings.warn("ModemManager", &format!("is running. {MODEM_MANAGER_REMEDY}")),
        false => findings.ok("ModemManager", "is not running"),
    }
}

/// Listens until enough was measured or something is wrong.
fn listen(stream: &SensorStream) -> BoardReport {
    let (start, mut heard) = (Instant::now(), BoardReport::default());
    while heard.trouble.is_none() && heard.first_frame.is_none_or(|first| first.elapsed() < MEASURING_TIME) {
        if heard.first_frame.is_none() && start.elapsed() > MAX_START {
            heard.trouble = Some(format!("no frame within {} s", MAX_START.as_secs()));
        }
        match stream.recv_timeout(Duration::from_millis(100)) {
            Received::Event(StreamEvent::Session(event)) => match event {
                Event::Connected(info, sensors) => (heard.info, heard.sensors) = (Some(info), sensors),
                Event::Frames(frames) => {
                    heard.first_frame.get_or_insert_with(Instant::now);
                    heard.frames += frames.len() as u64;
                    frames.iter().for_each(|frame| heard.losses.push(frame.frame.tick));
                }
                Event::Trouble(error) | Event::Failed(error) => heard.trouble = Some(error.to_string()),
                _ => {}
            },
            Received::Event(_) | Received::TimedOut => {}
            Received::Closed => {
                heard.trouble.get_or_insert_with(|| "the reader ended".to_owned());
            }
        }
    }
    heard
}

fn check_stream(findings: &mut Findings, stream: SensorStream, heard: &BoardReport, preset: &str) -> Result<()> {
    let counters = stream.finish();
    let seconds =
        heard.first_frame.map_or(0.0, |first| first.elapsed().as_secs_f64()).min(MEASURING_TIME.as_secs_f64());
    let text = format!("preset {preset}: {} frames in {seconds:.1} s, {} lost", heard.frames, heard.losses.lost());
    match heard.losses.lost() {
        0 => findings.ok("Stream", &text)?,
        _ => findings.warn("Stream", &format!("{text}: try a slower preset, or a port that is the board's alone"))?,
    }
    if counters.latency.p99_s > MAX_P99_S {
        findings.warn("Stream", "frames are handed over late: this computer is busy")?;
    }
    counter_lines(&counters, heard.losses.lost()).into_iter().try_for_each(|line| outln!("         {line}"))
}
