//! `radar-chaperone record --out FILE.mcap`: records the sensor's frames, with the headset's poses
//! or a pose track if available.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;

use super::outputs::{CommandFiles, always, never};
use super::sensor::SensorArguments;
use crate::app::HeadPoses;
use crate::app::{FrameIntake, MAX_WAITING_POSES, Until};
use crate::app::{PoseSource, RecordFile};
use crate::app::{refine_timers, stop_flag};
use crate::openvr::{Role, Runtime, RuntimePaths};
use radar_mapping::Event;

/// Poses of the headset per second. Choice: a pose within 2 ms of every sweep, more often than any
/// headset displays.
const POSES_HZ: f64 = 250.0;

/// Records a sensor's frames, and head poses from SteamVR or a track
///
/// With SteamVR running, the headset's poses are recorded; with --poses, those of another program's
/// track. Ctrl-C ends the recording properly; a crash costs its last second or two. Faults of the
/// link are reported and corrected where possible: the sensor is set up again, an unplugged board
/// is waited for.
#[derive(Debug, Args)]
pub(super) struct Record {
    /// Recording to write; must not exist yet
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    #[command(flatten)]
    sensor: SensorArguments,
    /// Length, seconds from the first frame; default: until Ctrl-C
    #[arg(long)]
    duration_s: Option<f64>,
    /// Head poses, read while another program writes them: TUM, or CSV by its extension, times of
    /// this computer's monotonic clock (on Windows its performance counter), seconds
    #[arg(long, value_name = "TRACK.tum|.csv")]
    poses: Option<PathBuf>,
    /// Records no poses from SteamVR even if it runs
    #[arg(long, conflicts_with = "poses")]
    no_poses: bool,
}

impl Record {
    pub fn run(&self) -> Result<()> {
        let files = CommandFiles::default().reads(&self.poses).reads(&self.sensor.config);
        files.records([&self.out], never).writes(&self.sensor.calibration, always).check_new()?;
        self.check()?;
        self.sensor.mount()?;
        let sensor = self.sensor.choose()?;
        sensor.print()?;
        let stop = stop_flag()?;
        refine_timers();
        let (sender, receiver) = std::sync::mpsc::sync_channel(MAX_WAITING_POSES);
        let runtime = self.headset();
        let source = match (&self.poses, &runtime) {
            (Some(track), _) => PoseSource::Track(track.clone()),
            (None, Some(_)) => PoseSource::Live(receiver),
            (None, None) => PoseSource::None,
        };
        match &source {
            PoseSource::None => {
                outln!("No poses: only frames are recorded; ranges can be read from them, but no positions")?
            }
            PoseSource::Live(_) => outln!("Poses of SteamVR's headset, {POSES_HZ} a second")?,
            PoseSource::Track(_) => {}
        }
        let until = Until::Recorded(self.duration_s.map(Duration::from_secs_f64));
        let over = AtomicBool::new(false);
        // Poses are dropped when the channel is full, which takes a disk that is seconds behind.
        let sink = |event: Event| drop(sender.try_send(event));
        std::thread::scope(|scope| {
            if let Some(runtime) = &runtime {
                scope.spawn(|| HeadPoses::new(runtime).read(POSES_HZ, &sink, &over));
            }
            let stream = sensor.open();
            let recorded = stream.and_then(|stream| {
                let mut intake = FrameIntake::new(&sensor, Some(RecordFile::new(&self.out, source)), &|_| {});
                let done = intake.run(&stream, &stop, until, &String::new);
                intake.end(stream, done)
            });
            over.store(true, Ordering::Relaxed);
            recorded
        })
    }

    /// SteamVR, if it runs; it is never started.
    fn headset(&self) -> Option<Runtime> {
        if self.no_poses || self.poses.is_some() {
            return None;
        }
        let paths = RuntimePaths::find().ok()?;
        match Runtime::start(&paths, Role::Background) {
            Ok(runtime) => Some(runtime),
            Err(error) => {
                log::info!("SteamVR provides no poses: {error}");
                None
            }
        }
    }

    fn check(&self) -> Result<()> {
        if let Some(duration_s) = self.duration_s.filter(|s| !(*s > 0.0 && *s <= 1e7)) {
            bail!("--duration-s {duration_s}: give seconds above 0, at most 10000000");
        }
        if let Some(track) = self.poses.as_ref().filter(|track| track.exists() && !track.is_file()) {
            bail!("{} is a folder or a device: give the track's file", track.display());
        }
        Ok(())
    }
}
