//! `radar-chaperone simulate ROOM --motion M --out FILE.mcap`: a recording without hardware, with its truth.
//! `… --serve PLACE`: the sensor itself without hardware.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use clap::Args;

use super::files::keep_inputs;
use super::import::parse_mount;
use super::progress;
use super::serve::Serve;
use crate::engine::Settings;
use crate::radar::{Beam, PRESETS, SensorConfig, preset};
use crate::recording::{Header, RecordingSummary, RecordingWriter, SensorMetadata};
use crate::simulation::{MOTIONS, SCENES, Scenario, Simulated, TrackingErrors};
use crate::tracking::PoseSample;

/// Simulates a sensor on a headset in a room and records it, with the truth, or serves it live
///
/// Rooms: corner-reflector, raised-reflector, clothes-hanger, chair, two-chairs (the thesis' scenes), furnished-room, empty-room, nothing.
/// The same seed gives the same file. With --serve, whatever speaks the A121's protocol can try it as if it were a board.
#[derive(Debug, Args)]
pub(super) struct Simulate {
    /// What stands there
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(SCENES))]
    room: String,
    /// How the sensor moves
    #[arg(long, default_value = "natural", value_parser = clap::builder::PossibleValuesParser::new(MOTIONS))]
    motion: String,
    /// Everything random follows from it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Sensor preset; without it d16, or fine for the corner reflector
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    preset: Option<String>,
    /// Sensor configuration (JSON, named as in the vendor's protocol) in place of a preset
    #[arg(long, value_name = "FILE.json", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Length, seconds; without it 10, or, with --serve, until Ctrl-C
    #[arg(long)]
    duration_s: Option<f64>,
    /// Power SNR of the strongest scatterer on the axis at 1 m, dB; without it the radar equation says
    #[arg(long, allow_hyphen_values = true)]
    snr_db: Option<f64>,
    /// Beam: uniform, thesis, lensless, fresnel, hyperbolic
    #[arg(long, default_value = "lensless")]
    beam: String,
    /// Where the sensor sits on the head: x,y,z in metres, or x,y,z,qx,qy,qz,qw
    #[arg(long, value_name = "x,y,z[,qx,qy,qz,qw]", allow_hyphen_values = true)]
    mount: Option<String>,
    /// Time of a sweep's pose minus time of the sweep, as written, seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    time_offset_s: f64,
    /// Tracking without any error
    #[arg(long)]
    perfect_tracking: bool,
    /// Times a minute that tracking is lost for 50 to 300 ms
    #[arg(long, default_value_t = 0.0)]
    dropouts_per_minute: f64,
    /// Recording to write
    #[arg(long, value_name = "FILE.mcap", required_unless_present = "serve")]
    out: Option<PathBuf>,
    #[command(flatten)]
    live: Serve,
}

impl Simulate {
    pub fn run(&self) -> Result<()> {
        let Some(out) = self.out.as_ref().filter(|_| !self.live.is_asked()) else {
            return self.live.run(self.scenario()?, self.duration_s);
        };
        self.live.refuse_alone()?;
        if let Some(config) = &self.config {
            keep_inputs(out, &[config])?;
        }
        let scenario = self.scenario()?;
        let spinner = progress::spinner("simulating");
        let simulated = scenario.run()?;
        let summary = write_simulated(out, &scenario, &simulated)?;
        spinner.finish_and_clear();
        say!("{summary}")?;
        say!("Written to {}", out.display())?;
        Ok(())
    }

    fn scenario(&self) -> Result<Scenario> {
        let config = match &self.config {
            Some(path) => read_config(path)?,
            None => {
                let usual = if self.room == "corner-reflector" { "fine" } else { "d16" };
                let name = self.preset.as_deref().unwrap_or(usual);
                preset(name).ok_or_else(|| anyhow!("preset \"{name}\" is not known: use {}", PRESETS.join(", ")))?
            }
        };
        let mut scenario = Scenario::new(&self.room, &self.motion, config, self.duration_s.unwrap_or(10.0), self.seed);
        scenario.beam = Beam::named(&self.beam)?;
        if let Some(mount) = &self.mount {
            scenario.head_from_sensor = parse_mount(mount)?;
        }
        if self.perfect_tracking {
            scenario.errors = TrackingErrors::none();
        }
        scenario.errors.dropouts_per_minute = self.dropouts_per_minute;
        scenario.snr_db = self.snr_db;
        scenario.time_offset_s = self.time_offset_s;
        Ok(scenario)
    }
}

/// A sensor configuration from a file, sound.
pub(super) fn read_config(path: &Path) -> Result<SensorConfig> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read configuration {}", path.display()))?;
    let config: SensorConfig =
        serde_json::from_str(&text).with_context(|| format!("{} is no sensor configuration", path.display()))?;
    config.validate().with_context(|| format!("{} breaks a rule of the sensor", path.display()))?;
    Ok(config)
}

/// Writes a simulated recording: both streams merged in time, the truth and the beam in its header.
pub(super) fn write_simulated(path: &Path, scenario: &Scenario, simulated: &Simulated) -> Result<RecordingSummary> {
    let source = format!("simulation: {}, {}, seed {}", scenario.scene, scenario.motion, scenario.seed);
    let mut settings = Settings::default();
    settings.radar.beam = scenario.beam.clone();
    let header = Header {
        sensor: SensorMetadata {
            ticks_per_second: Some(1_000_000),
            base_step_length_m: Some(crate::radar::BASE_STEP_M),
            board: Some("simulated".into()),
            rss_version: None,
        },
        settings: settings.to_toml(),
        truth: Some(simulated.truth.clone()),
        ..Header::new(source, scenario.config.clone(), scenario.head_from_sensor)
    };
    let mut writer = RecordingWriter::create(path, &header)?;
    let mut poses = simulated.poses.iter().peekable();
    for frame in &simulated.frames {
        while let Some(pose) = poses.next_if(|p: &&PoseSample| p.time_ns <= frame.host_time_ns) {
            writer.write_pose(pose)?;
        }
        writer.write_frame(frame)?;
    }
    for pose in poses {
        writer.write_pose(pose)?;
    }
    Ok(writer.finish()?)
}
