//! All settings, named as in the TOML file and in `--set`.

mod games;
mod renamed;

use radar_mapping::{
    MappingSettings, MappingSettingsError, ProcessingSettings, RadarSettings, ReflectorSettings, RoomMapperSettings,
    TrackingSettings,
};
use radar_sar::{BoundedSettings, SettingBound, SettingOutOfBounds, bounds};
use serde::{Deserialize, Serialize};

use games::Games;
pub use games::path_of;
use renamed::{put, with_present_names};

use crate::warning::{CueSettings, WarningSettings, WarningSettingsError};

/// Least similarity of an unknown name and a known one for a suggestion, 0 to 1. Choice: one wrong
/// or missing letter in a short name, two in a long one; lower suggests unrelated names.
const MIN_SIMILARITY: f64 = 0.8;

/// Invalid settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// Not TOML, an unknown name, or a value of the wrong kind.
    #[error("settings: {0}")]
    Toml(String),
    /// `--set` without a value.
    #[error("--set {0}: write it as name=value, for example --set tracking.time_offset_s=0.02")]
    NoValue(String),
    /// Wrong settings of a game.
    #[error("settings of game \"{key}\": {why}")]
    Game {
        /// SteamVR's application key.
        key: String,
        /// The reason.
        why: String,
    },
    /// A value outside its bounds.
    #[error(transparent)]
    OutOfBounds(#[from] SettingOutOfBounds),
    /// A setting of mapping outside its bounds.
    #[error(transparent)]
    Mapping(#[from] MappingSettingsError),
    /// A warning setting outside its bounds.
    #[error("settings: {0}")]
    Warning(#[from] WarningSettingsError),
}

impl From<toml::de::Error> for SettingsError {
    fn from(error: toml::de::Error) -> Self {
        Self::Toml(readable_message(&error.to_string()))
    }
}

/// The parser's message in the user's words, without the names of Rust's number types.
fn readable_message(message: &str) -> String {
    let kind = |word: &str| match word.trim_end_matches(',') {
        "f64" | "f32" => "a number".to_owned(),
        "u8" => "a whole number from 0 to 255".to_owned(),
        "u32" | "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        word => word.to_owned(),
    };
    let line = |line: &str| match line.split_once("expected ") {
        Some((before, rest)) if rest.starts_with("struct ") => format!("{before}expected a table of settings"),
        Some((before, rest)) if !rest.contains(' ') => format!("{before}expected {}", kind(rest)),
        _ => line.to_owned(),
    };
    let mut lines: Vec<String> = message.trim_end().lines().map(line).collect();
    lines.extend(message.lines().find_map(closest_name).map(|name| format!("Did you mean `{name}`?")));
    lines.join("\n")
}

/// The expected name most similar to the one found, if similar enough.
fn closest_name(message: &str) -> Option<&str> {
    let (_, rest) = message.split_once("unknown field `")?;
    let (found, expected) = rest.split_once('`')?;
    let names = expected.split('`').skip(1).step_by(2);
    let likeness = |name: &str| strsim::jaro_winkler(found, name);
    names.filter(|name| likeness(name) >= MIN_SIMILARITY).max_by(|a, b| likeness(a).total_cmp(&likeness(b)))
}

/// How warnings are shown in the headset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Display {
    /// Rectangles in the room, redrawn only when their picture changes: works with every runtime.
    #[default]
    Panels,
    /// Rectangles as windows with a picture of the space behind them for each eye, drawn every
    /// frame.
    Stereo,
    /// A picture for each eye over its whole view, drawn every frame.
    Projection,
}

/// Convention of a runtime for the matrix of a projection overlay, which OpenVR's documentation
/// does not specify.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProjectionMatrix {
    /// From the tracking universe to the eye.
    #[default]
    EyeFromTracking,
    /// From the eye to the tracking universe.
    TrackingFromEye,
}

/// Settings for running with SteamVR.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HeadsetSettings {
    /// Whether warnings are shown at all.
    pub warnings: bool,
    /// How warnings are shown.
    pub display: Display,
    /// For the display `projection`.
    pub projection_matrix: ProjectionMatrix,
    /// Poses read between frames, per second; 0: only at frames.
    pub poses_hz: f64,
    /// Whether SteamVR's colour, fade distance and play area apply where these settings do not set
    /// them.
    pub follow_chaperone: bool,
    /// Whether the map is saved from one start to the next, for each room that the tracking system
    /// knows.
    pub keep_map: bool,
    /// Whether a notice is shown in the headset when the radar has failed.
    pub notices: bool,
    /// Threads of the reconstruction; 0: all processors but one.
    pub threads: usize,
}

impl BoundedSettings for HeadsetSettings {
    const BOUNDS: &'static [SettingBound<Self>] = bounds![
        poses_hz: 0.0, 1000.0;
        threads: 0.0, 256.0;
    ];
}

impl Default for HeadsetSettings {
    fn default() -> Self {
        Self {
            warnings: true,
            display: Display::Panels,
            projection_matrix: ProjectionMatrix::EyeFromTracking,
            poses_hz: 250.0,
            follow_chaperone: true,
            keep_map: true,
            notices: true,
            threads: 0,
        }
    }
}

/// All settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// The sensor.
    pub radar: RadarSettings,
    /// Poses and time.
    pub tracking: TrackingSettings,
    /// How to map.
    pub processing: ProcessingSettings,
    /// The room mapper.
    pub rooms: RoomMapperSettings,
    /// The search for single reflectors.
    pub reflectors: ReflectorSettings,
    /// The drawn warnings.
    pub warning: WarningSettings,
    /// Sounds and controller pulses.
    pub cues: CueSettings,
    /// Running with SteamVR.
    pub headset: HeadsetSettings,
}

impl Settings {
    /// From TOML text with `name=value` changes over it; later changes override earlier ones.
    ///
    /// # Errors
    /// Text that is not TOML, unknown names, values of the wrong kind or outside their bounds.
    pub fn from_toml(text: &str, changes: &[String]) -> Result<Self, SettingsError> {
        Self::from_layers(toml::Table::new(), text, changes)
    }

    /// The same over a lower layer of values, used where neither text nor changes set one.
    ///
    /// # Errors
    /// As [`Settings::from_toml`].
    pub fn from_layers(below: toml::Table, text: &str, changes: &[String]) -> Result<Self, SettingsError> {
        Self::for_game(below, text, changes, None)
    }

    /// The same in a game, by SteamVR's application key: the text's settings of that game are over
    /// its others.
    ///
    /// # Errors
    /// As [`Settings::from_toml`]; also wrong settings of any game.
    pub fn for_game(
        below: toml::Table,
        text: &str,
        changes: &[String],
        game: Option<&str>,
    ) -> Result<Self, SettingsError> {
        let mut table = with_present_names(below);
        let mut file: toml::Table = toml::from_str(text)?;
        let games = Games::take(&mut file)?;
        merge_over(&mut table, with_present_names(file));
        games.check(&table)?;
        merge_over(&mut table, game.and_then(|game| games.of(game)).unwrap_or_default());
        for change in changes {
            let (name, value) = change.split_once('=').ok_or_else(|| SettingsError::NoValue(change.clone()))?;
            let mut changed = toml::Table::new();
            put(&mut changed, name.trim(), parsed(value.trim()));
            merge_over(&mut table, with_present_names(changed));
        }
        let settings: Self = toml::Value::Table(table).try_into()?;
        settings.check()?;
        Ok(settings)
    }

    /// As TOML text.
    pub fn to_toml(&self) -> String {
        // Every field is a number, a string, a list or a table of these, so the conversion to TOML
        // cannot fail.
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), SettingsError> {
        self.cues.check_bounds("cues")?;
        self.headset.check_bounds("headset")?;
        self.mapping().check()?;
        Ok(self.warning.check()?)
    }

    /// Those of mapping.
    pub fn mapping(&self) -> MappingSettings {
        let Self { radar, tracking, processing, rooms, reflectors, .. } = self.clone();
        MappingSettings { radar, tracking, processing, rooms, reflectors }
    }
}

/// Merges one table over another, key by key in nested tables.
fn merge_over(table: &mut toml::Table, above: toml::Table) {
    for (key, value) in above {
        match (table.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(above)) => merge_over(inner, above),
            (_, value) => drop(table.insert(key, value)),
        }
    }
}

/// Parses a TOML value, else takes it as a string: `--set radar.beam=thesis` needs no quotes.
fn parsed(value: &str) -> toml::Value {
    let line = format!("v = {value}");
    let table: Option<toml::Table> = toml::from_str(&line).ok();
    table.and_then(|mut t| t.remove("v")).unwrap_or_else(|| toml::Value::String(value.into()))
}

#[cfg(test)]
mod tests {
    use radar_mapping::Mode;
    use radar_sar::Beam;

    use super::*;

    fn with(change: &str) -> Result<Settings, SettingsError> {
        Settings::from_toml("", &[change.into()])
    }

    #[test]
    fn default_settings_roundtrip() {
        let settings = Settings::default();
        assert_eq!(Settings::from_toml(&settings.to_toml(), &[]).unwrap(), settings);
    }

    #[test]
    fn changes_override_the_text() {
        assert_eq!(with("tracking.time_offset_s=0.02").unwrap().tracking.time_offset_s, 0.02);
        assert_eq!(with("radar.beam=thesis").unwrap().radar.beam, Beam::Thesis);
        assert_eq!(with("processing.mode=rooms").unwrap().processing.mode, Mode::Rooms);
        assert_eq!(with("reflectors.max_sweeps=50").unwrap().reflectors.max_sweeps, 50);
        assert_eq!(with("rooms.subapertures.max_range_m=2").unwrap().rooms.subapertures.max_range_m, 2.0);
    }

    #[test]
    fn lower_layer_fills_unset_values() {
        let below: toml::Table = toml::from_str("[warning]\ncolor = [1, 2, 3]\nfade_distance_m = 0.7").unwrap();
        let text = "[warning]\nfade_distance_m = 2.0";
        let settings = Settings::from_layers(below, text, &["warning.brightness=0.5".into()]).unwrap();
        let warning = settings.warning;
        assert_eq!((warning.color, warning.fade_distance_m, warning.brightness), ([1, 2, 3], 2.0, 0.5));
    }

    #[test]
    fn invalid_settings_state_the_reason() {
        for (change, message) in [
            ("rooms.subapertures.voxel_m=0", "rooms.subapertures.voxel_m is 0"),
            ("tracking.time_offset_s=nan", "time_offset_s is NaN"),
            ("warnings=1", "unknown field `warnings`"),
            ("radar.beam=laser", "laser"),
            ("radar.beam", "name=value"),
            ("warning.fade_distance_m=-1", "fade"),
            ("warning.style=loud", "loud"),
            ("cues.volume=2", "cues.volume is 2"),
            ("tracking.time_offset_s.x=1", "time_offset_s"),
        ] {
            let error = with(change).expect_err(change).to_string();
            assert!(error.contains(message), "{change}: {error}");
        }
    }

    /// The names of all numbers.
    fn numbers(table: &toml::Table, before: &str) -> Vec<String> {
        let names = table.iter().flat_map(|(name, value)| match value {
            toml::Value::Table(inner) => numbers(inner, &format!("{before}{name}.")),
            toml::Value::Float(_) | toml::Value::Integer(_) => vec![format!("{before}{name}")],
            _ => Vec::new(),
        });
        names.collect()
    }

    #[test]
    fn every_number_is_bounded() {
        let table = toml::Table::try_from(Settings::default()).unwrap();
        let names = numbers(&table, "");
        assert!(names.len() > 70, "{}", names.len());
        for name in names {
            for value in ["nan", "inf", "-inf", "-1e9", "1e30"] {
                let error = with(&format!("{name}={value}")).expect_err(&format!("{name}={value}")).to_string();
                let own = name.rsplit('.').next().unwrap_or_default();
                assert!(error.contains(own) || error.contains("expected"), "{name}={value}: {error}");
            }
        }
    }

    #[test]
    fn what_nothing_could_be_mapped_with_is_refused() {
        for (change, message) in [
            ("rooms.tracks.confirm_observations=5", "lie in 1 to 4"),
            ("rooms.tracks.confirm_wall_observations=9", "lie in 1 to 4"),
            ("rooms.tracks.existence.loss=1", "lie in 0 to 0.3"),
            (
                "rooms.tracks.existence.max_log_odds=1",
                "rooms.tracks.existence.max_log_odds is 1: with rooms.tracks.existence.confirm_log_odds = 3 it must lie in 3 to 100, \
                 else no object is ever confirmed",
            ),
            ("rooms.tracks.existence.confirm_log_odds=5", "max_log_odds is 4: with"),
            ("rooms.tracks.existence.confirm_log_odds=100", "lie in -100 to 10"),
            ("rooms.tracks.existence.established_max_log_odds=1", "it must lie in 4 to 100"),
            ("rooms.subapertures.min_sweeps=10000", "lie in 2 to 80"),
            ("rooms.subapertures.min_sweeps=37", "duration_s = 0.09 it must lie in 2 to 36"),
            ("rooms.subapertures.min_range_m=5", "min_range_m is 5"),
            (
                "rooms.clean.window_s=1",
                "plane_min_subapertures is 13: with rooms.clean.window_s = 1 it must lie in 1 to 11",
            ),
            ("reflectors.max_sweeps=3", "give 0 for all, or at least 10"),
            (
                "tracking.mount={translation=[1000,0,0],rotation=[0,0,0,1]}",
                "tracking.mount: the sensor is [1000.0, 0.0, 0.0] m from the head: give at most 10 m",
            ),
        ] {
            let error = with(change).expect_err(change).to_string();
            assert!(error.contains(message), "{change}: {error}");
        }
        let changes = ["rooms.subapertures.min_range_m=0.8", "rooms.subapertures.max_range_m=1.2"].map(str::to_owned);
        let error = Settings::from_toml("", &changes).expect_err("0.4 m of range").to_string();
        assert!(
            error.contains("max_range_m is 1.2: with rooms.subapertures.min_range_m = 0.8 it must lie in 1.3 to 5"),
            "{error}"
        );
        assert!(with("rooms.tracks.confirm_wall_observations=4").is_ok());
    }

    #[test]
    fn closest_name_is_suggested() {
        let refusal = |change: &str| with(change).expect_err(change).to_string();
        assert!(refusal("warning.fade_distance=2").ends_with("Did you mean `fade_distance_m`?"));
        assert!(
            refusal("room.subapertures.voxel_m=2").ends_with("Did you mean `rooms`?"),
            "{}",
            refusal("room.subapertures.voxel_m=2")
        );
        assert!(!refusal("xyz=2").contains("Did you mean"), "{}", refusal("xyz=2"));
    }

    #[test]
    fn value_kinds_are_described_in_words() {
        for (change, message) in [
            ("warning.brightness=dark", "expected a number"),
            ("warning.color=[300, 0, 0]", "expected a whole number from 0 to 255"),
            ("reflectors.max_sweeps=many", "expected a whole number, 0 or more"),
            ("warning=3", "expected a table of settings"),
        ] {
            let error = with(change).expect_err(change).to_string();
            assert!(
                error.contains(message) && !error.contains("f32") && !error.contains("struct"),
                "{change}: {error}"
            );
        }
    }
}
