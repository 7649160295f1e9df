//! `radar-chaperone simulate ROOM --motion M --out FILE.mcap`: a recording without hardware, with
//! its truth. `… --serve PLACE`: the sensor itself without hardware.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;

use super::import::parse_mount;
use super::outputs::{CommandFiles, ReplaceArgument, never};
use super::serve::Serve;
use crate::app::progress;
use crate::settings::Settings;
use a121::{PRESETS, SensorConfig, preset};
use radar_mapping::in_time_order;
use radar_recording::{Existing, Header, RecordingSummary, RecordingWriter, SensorMetadata, read_small_text};
use radar_sar::Beam;
use radar_sar::geometry::Pose;
use radar_simulation::{
    Headset, MOTIONS, PlaySession, PlayWorld, SCENES, Scenario, SensorEffects, Simulated, TrackingErrors,
};

/// The room of the play sessions.
const PLAY_ROOM: &str = "play-room";

/// Simulates a sensor on a headset in a room and records it, with the truth, or serves it live
///
/// Rooms: corner-reflector, raised-reflector, clothes-hanger, chair, two-chairs (the thesis'
/// scenes), furnished-room, empty-room, nothing; play-room is a play session: a player among
/// furniture, own hands in the beam, a person who crosses the room, a chair carried away halfway.
/// The same seed gives the same file. With --serve, any program that speaks the A121's protocol can
/// use it like a board.
#[derive(Debug, Args)]
pub(super) struct Simulate {
    /// The room
    #[arg(value_parser = clap::builder::PossibleValuesParser::new(SCENES.into_iter().chain([PLAY_ROOM])))]
    room: String,
    /// How the sensor moves; default: natural
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(MOTIONS))]
    motion: Option<String>,
    /// Seed of all randomness
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Sensor preset; default: d16, or fine for the corner reflector
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(PRESETS))]
    preset: Option<String>,
    /// Sensor configuration (JSON, named as in the vendor's protocol) instead of a preset
    #[arg(long, value_name = "FILE.json", conflicts_with = "preset")]
    config: Option<PathBuf>,
    /// Length, seconds; default: 10, or, with --serve, until Ctrl-C
    #[arg(long)]
    duration_s: Option<f64>,
    /// Power SNR of the strongest scatterer on the axis at 1 m, dB; default: from the radar
    /// equation
    #[arg(long, allow_hyphen_values = true)]
    snr_db: Option<f64>,
    /// Beam: uniform, thesis, lensless, fresnel, hyperbolic
    #[arg(long, default_value = "lensless")]
    beam: String,
    /// Pose of the sensor on the head: x,y,z in metres, or x,y,z,qx,qy,qz,qw
    #[arg(long, value_name = "x,y,z[,qx,qy,qz,qw]", allow_hyphen_values = true)]
    mount: Option<String>,
    /// Time of a sweep's pose minus time of the sweep, as written, seconds; default: 0
    #[arg(long, allow_hyphen_values = true)]
    time_offset_s: Option<f64>,
    /// Kind of the play-room: points (scatterers and smooth walls), or with surfaces, multipath and
    /// shadows: office, dining, living; corner: a bare room; default: points
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(PlayWorld::NAMES))]
    world: Option<String>,
    /// How well the headset is tracked
    #[arg(long, default_value = "nominal", value_parser = clap::builder::PossibleValuesParser::new(Headset::NAMES))]
    headset: String,
    /// Tracking without any error
    #[arg(long, conflicts_with = "headset")]
    perfect_tracking: bool,
    /// Losses of tracking per minute, of 50 to 300 ms each; default: by the headset
    #[arg(long)]
    dropouts_per_minute: Option<f64>,
    /// Imperfections of the sensor: none, measured, or a list of jitter, leakage, ringing,
    /// range_bias, warm_up, interference, profile_noise, each with =STRENGTH if it is not 1;
    /// default: measured in furnished-room, empty-room and play-room, none in the thesis' scenes
    #[arg(long)]
    effects: Option<SensorEffects>,
    /// Recording to write
    #[arg(long, value_name = "FILE.mcap", required_unless_present = "serve")]
    out: Option<PathBuf>,
    #[command(flatten)]
    replace: ReplaceArgument,
    #[command(flatten)]
    live: Serve,
}

impl Simulate {
    pub fn run(&self) -> Result<()> {
        let Some(out) = self.out.as_ref().filter(|_| !self.live.is_requested()) else {
            if self.room == PLAY_ROOM {
                bail!("{PLAY_ROOM} can only be recorded: give --out FILE.mcap, or another room to serve");
            }
            let outputs = self.live.files().reads(&self.config).check(self.replace)?;
            return self.live.run(self.scenario()?, self.duration_s, &outputs);
        };
        self.live.require_serve()?;
        let files = CommandFiles::default().reads(&self.config).records([out], never);
        let existing = files.check(self.replace)?.existing(out);
        let spinner = progress::spinner("simulating");
        let summary = if self.room == PLAY_ROOM {
            let session = self.play_session()?.prepare()?;
            let source = format!("simulation: {PLAY_ROOM}, seed {}", self.seed);
            let PlaySession { config, beam, head_from_sensor, .. } = session.play();
            write_simulated(out, existing, source, (config, beam, head_from_sensor), &session.recorded())?
        } else {
            write_scenario(out, existing, &self.scenario()?)?
        };
        spinner.finish_and_clear();
        outln!("{summary}")?;
        outln!("Written to {}", out.display())?;
        Ok(())
    }

    fn sensor_config(&self) -> Result<SensorConfig> {
        match &self.config {
            Some(path) => read_config(path),
            None => {
                let usual = if self.room == "corner-reflector" { "fine" } else { "d16" };
                let name = self.preset.as_deref().unwrap_or(usual);
                preset(name).ok_or_else(|| anyhow!("preset \"{name}\" is not known: use {}", PRESETS.join(", ")))
            }
        }
    }

    fn errors(&self) -> Result<TrackingErrors> {
        let headset = if self.perfect_tracking { Headset::Perfect } else { Headset::from_name(&self.headset)? };
        let mut errors = headset.errors();
        errors.dropouts_per_minute = self.dropouts_per_minute.unwrap_or(errors.dropouts_per_minute);
        Ok(errors)
    }

    fn scenario(&self) -> Result<Scenario> {
        if self.world.is_some() {
            bail!("--world is for {PLAY_ROOM}: the other rooms are of points");
        }
        let (motion, duration_s) = (self.motion.as_deref().unwrap_or("natural"), self.duration_s.unwrap_or(10.0));
        let mut scenario = Scenario::new(&self.room, motion, self.sensor_config()?, duration_s, self.seed);
        scenario.beam = Beam::from_name(&self.beam)?;
        if let Some(mount) = &self.mount {
            scenario.head_from_sensor = parse_mount(mount)?;
        }
        scenario.errors = self.errors()?;
        scenario.effects = self.effects.unwrap_or_else(|| effects_in(&self.room));
        scenario.snr_db = self.snr_db;
        scenario.time_offset_s = self.time_offset_s.unwrap_or(0.0);
        Ok(scenario)
    }

    fn play_session(&self) -> Result<PlaySession> {
        let others = [
            ("--motion", self.motion.is_some()),
            ("--snr-db", self.snr_db.is_some()),
            ("--time-offset-s", self.time_offset_s.is_some()),
        ];
        if let Some((name, _)) = others.iter().find(|(_, is_given)| *is_given) {
            bail!("{name} is for the other rooms: a player of {PLAY_ROOM} moves and is measured by its own rules");
        }
        let mut session = PlaySession::new(self.sensor_config()?, self.seed);
        session.duration_s = self.duration_s.unwrap_or(60.0);
        session.beam = Beam::from_name(&self.beam)?;
        if let Some(mount) = &self.mount {
            session.head_from_sensor = parse_mount(mount)?;
        }
        session.errors = self.errors()?;
        session.effects = self.effects.unwrap_or_else(|| effects_in(PLAY_ROOM));
        session.world = self.world.as_deref().map_or(Ok(PlayWorld::Points), PlayWorld::from_name)?;
        // Aligns the room with the axes, so that the walls in the truth are axis-aligned.
        session.axis_aligned = true;
        Ok(session)
    }
}

/// The sensor's imperfections in a room: as measured on real sensors in what stands for real rooms, none in the thesis'
/// scenes, which compare methods.
pub(super) fn effects_in(room: &str) -> SensorEffects {
    match room {
        "furnished-room" | "empty-room" | PLAY_ROOM => SensorEffects::MEASURED,
        _ => SensorEffects::NONE,
    }
}

/// A valid sensor configuration from a file.
pub(super) fn read_config(path: &Path) -> Result<SensorConfig> {
    let text = read_small_text(path).with_context(|| format!("cannot read configuration {}", path.display()))?;
    let config: SensorConfig =
        serde_json::from_str(&text).with_context(|| format!("{} is no sensor configuration", path.display()))?;
    config.validate().with_context(|| format!("{} breaks a rule of the sensor", path.display()))?;
    Ok(config)
}

/// Runs a scenario and writes its recording.
pub(super) fn write_scenario(path: &Path, existing: Existing, scenario: &Scenario) -> Result<RecordingSummary> {
    let source = format!("simulation: {}, {}, seed {}", scenario.scene, scenario.motion, scenario.seed);
    let Scenario { config, beam, head_from_sensor, .. } = scenario;
    write_simulated(path, existing, source, (config, beam, head_from_sensor), &scenario.run()?)
}

/// Writes a simulated recording: both streams merged in time, the truth and the beam in its header.
fn write_simulated(
    path: &Path,
    existing: Existing,
    source: String,
    (config, beam, head_from_sensor): (&SensorConfig, &Beam, &Pose),
    simulated: &Simulated,
) -> Result<RecordingSummary> {
    let mut settings = Settings::default();
    settings.radar.beam = beam.clone();
    let header = Header {
        sensor: SensorMetadata {
            ticks_per_second: Some(1_000_000),
            base_step_length_m: Some(a121::BASE_STEP_M),
            board: Some("simulated".into()),
            rss_version: None,
        },
        settings: settings.to_toml(),
        truth: Some(simulated.truth.clone()),
        ..Header::new(source, config.clone(), *head_from_sensor)
    };
    let mut writer = RecordingWriter::create(path, &header, existing)?;
    for event in in_time_order(simulated.frames.iter().cloned(), simulated.poses.iter().copied()) {
        writer.write(&event)?;
    }
    Ok(writer.finish()?)
}
