//! All settings, as the TOML file and `--set` spell them.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::DEFAULT_CUBE_M;
use crate::geometry::{Aabb, Pose};
use crate::imaging::PositionErrors;
use crate::obstacles::{RECENT_UPDATES, ReflectorSettings, RoomMapperSettings};
use crate::radar::Beam;
use crate::tracking::HistorySettings;
use crate::warning::{CueSettings, WarningSettings, WarningSettingsError};

/// Places that a search for single reflectors looks at, at most: 3 m cubed at 15 mm, or 12 m cubed at 60 mm.
const MAX_PLACES: f64 = 8e6;

/// A name that is less like the one that was found is no misspelling of it, 0 to 1.
const LEAST_ALIKE: f64 = 0.8;

/// Settings that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// Not TOML, an unknown name, or a value of the wrong kind.
    #[error("settings: {0}")]
    Toml(String),
    /// `--set` without a value.
    #[error("--set {0}: write it as name=value, for example --set tracking.time_offset_s=0.02")]
    NoValue(String),
    /// A name that leads through something that is no table.
    #[error("--set {0}: there is no setting of that name")]
    NoSuchName(String),
    /// A value outside its bounds.
    #[error("setting {name} is {value}: it must lie in {min} to {max}")]
    OutOfRange {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
        /// Least allowed.
        min: f64,
        /// Most allowed.
        max: f64,
    },
    /// A warning setting outside its bounds.
    #[error("settings: {0}")]
    Warning(#[from] WarningSettingsError),
    /// A mount that is none.
    #[error("setting {0} has a number that is not finite, or a rotation of length zero")]
    NotFinite(&'static str),
    /// A box that is none.
    #[error("setting processing.region is {0:?}: each coordinate of max must lie above min's, by 50 m at most")]
    Region(Aabb),
    /// A search that would take hours and all memory.
    #[error(
        "processing.region and reflectors.voxel_m {voxel_m} m give {places:.1e} places to search: at most {max:.0e}, \
             so choose a larger voxel or a smaller region"
    )]
    TooManyPlaces {
        /// Edge of a voxel, metres.
        voxel_m: f64,
        /// Voxels in the region.
        places: f64,
        /// The bound.
        max: f64,
    },
}

impl From<toml::de::Error> for SettingsError {
    fn from(error: toml::de::Error) -> Self {
        Self::Toml(for_people(&error.to_string()))
    }
}

/// What the parser says, without the names that a programmer gives to kinds of numbers.
fn for_people(says: &str) -> String {
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
    let mut lines: Vec<String> = says.trim_end().lines().map(line).collect();
    lines.extend(says.lines().find_map(likely_name).map(|name| format!("Did you mean `{name}`?")));
    lines.join("\n")
}

/// Of the names that the parser expected the one most like the one it found, where they are alike at all.
fn likely_name(says: &str) -> Option<&str> {
    let (_, rest) = says.split_once("unknown field `")?;
    let (found, expected) = rest.split_once('`')?;
    let names = expected.split('`').skip(1).step_by(2);
    let likeness = |name: &str| strsim::jaro_winkler(found, name);
    names.filter(|name| likeness(name) >= LEAST_ALIKE).max_by(|a, b| likeness(a).total_cmp(&likeness(b)))
}

/// The sensor, as imaging sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadarSettings {
    /// The beam: uniform, thesis, lensless, fresnel, hyperbolic, or rows of [angle in degrees, two-way amplitude].
    pub beam: Beam,
}

impl Default for RadarSettings {
    fn default() -> Self {
        Self { beam: Beam::Lensless }
    }
}

/// Where the sensor was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingSettings {
    /// Time of a sweep's pose minus time of the sweep, seconds; positive when sweeps are stamped too early.
    pub time_offset_s: f64,
    /// Whether the time offset is estimated from the data, within 0.1 s of the one given, and applied.
    pub estimate_time_offset: bool,
    /// An estimate is applied when its 1σ is at most this, seconds.
    pub max_time_offset_sigma_s: f64,
    /// Where the sensor sits on the head; left out: what the recording says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<Pose>,
    /// How poses become a path.
    pub history: HistorySettings,
    /// How well the poses are known.
    pub errors: PositionErrors,
}

impl Default for TrackingSettings {
    fn default() -> Self {
        Self {
            time_offset_s: 0.0,
            estimate_time_offset: true,
            max_time_offset_sigma_s: 3e-3,
            mount: None,
            history: HistorySettings::default(),
            errors: PositionErrors::default(),
        }
    }
}

/// How to search.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Rooms from 400 sweeps a second on, else single reflectors.
    #[default]
    Auto,
    /// Blocks, planes, explaining away.
    Rooms,
    /// Range-only sums.
    Reflectors,
}

/// What is searched, and how.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessingSettings {
    /// How to search.
    pub mode: Mode,
    /// Box searched for single reflectors; left out: a 3 m cube ahead of the first pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<Aabb>,
}

/// How warnings are shown in the headset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Display {
    /// Rectangles standing in the room, drawn again only when their picture changes: right on every runtime.
    #[default]
    Panels,
    /// Rectangles as windows, with a picture for each eye of what stands behind them, drawn every frame.
    Stereo,
    /// A picture for each eye over all of its view, drawn every frame.
    Projection,
}

/// What a runtime takes the matrix of a projection to be; its manual does not say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProjectionMatrix {
    /// From the tracking universe to the eye.
    #[default]
    EyeFromTracking,
    /// Where the eye is.
    TrackingFromEye,
}

/// Beside SteamVR.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HeadsetSettings {
    /// Whether warnings are shown at all.
    pub warnings: bool,
    /// How warnings are shown.
    pub display: Display,
    /// For the display `projection`.
    pub projection_matrix: ProjectionMatrix,
    /// Poses read between frames, a second; 0: at frames alone.
    pub poses_hz: f64,
    /// Whether SteamVR's colour, fade distance and play area serve where these settings do not name their own.
    pub follow_chaperone: bool,
    /// Whether the map is kept from one start to the next, for each room that the tracking system knows.
    pub keep_map: bool,
    /// Whether it is said in the headset when the radar sees nothing.
    pub notices: bool,
    /// Threads of the reconstruction; 0: the processors but one.
    pub threads: usize,
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
    /// Which search.
    pub processing: ProcessingSettings,
    /// The search in rooms.
    pub rooms: RoomMapperSettings,
    /// The search for single reflectors.
    pub reflectors: ReflectorSettings,
    /// What is drawn, from where on.
    pub warning: WarningSettings,
    /// What sounds and shakes.
    pub cues: CueSettings,
    /// Beside SteamVR.
    pub headset: HeadsetSettings,
}

impl Settings {
    /// From TOML text, with `name=value` changes laid over it, last one first in force.
    ///
    /// # Errors
    /// Text that is no TOML, unknown names, values of the wrong kind or outside their bounds.
    pub fn from_toml(text: &str, changes: &[String]) -> Result<Self, SettingsError> {
        Self::from_layers(toml::Table::new(), text, changes)
    }

    /// The same over values that serve where neither text nor changes name their own.
    ///
    /// # Errors
    /// As [`Settings::from_toml`].
    pub fn from_layers(below: toml::Table, text: &str, changes: &[String]) -> Result<Self, SettingsError> {
        let mut table = below;
        lay_over(&mut table, toml::from_str(text)?);
        for change in changes {
            let (name, value) = change.split_once('=').ok_or_else(|| SettingsError::NoValue(change.clone()))?;
            set(&mut table, change, name.trim(), parsed(value.trim()))?;
        }
        let settings: Self = toml::Value::Table(table).try_into()?;
        settings.check()?;
        Ok(settings)
    }

    /// As TOML text.
    pub fn to_toml(&self) -> String {
        // Every field is a number, a name, a list or a table of these: TOML has them all.
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), SettingsError> {
        let Self { tracking, rooms, reflectors, processing, .. } = self;
        let blocks = &rooms.blocks;
        let bounded = [
            ("tracking.time_offset_s", tracking.time_offset_s, -10.0, 10.0),
            ("tracking.max_time_offset_sigma_s", tracking.max_time_offset_sigma_s, 0.0, 0.005),
            ("tracking.history.max_gap_s", tracking.history.max_gap_s, 0.001, 1.0),
            ("tracking.history.smoothing_window_s", tracking.history.smoothing_window_s, 0.0, 0.5),
            ("tracking.history.max_ahead_s", tracking.history.max_ahead_s, 0.0, 0.5),
            ("tracking.errors.wander_m", tracking.errors.wander_m, 0.0, 1.0),
            ("tracking.errors.wander_s", tracking.errors.wander_s, 0.01, 1e4),
            ("tracking.errors.mount_m", tracking.errors.mount_m, 0.0, 1.0),
            ("tracking.errors.jitter_m", tracking.errors.jitter_m, 0.0, 1.0),
            ("tracking.errors.rotation_deg", tracking.errors.rotation_deg, 0.0, 90.0),
            ("rooms.blocks.block_s", blocks.block_s, 0.01, 0.5),
            ("rooms.blocks.min_sweeps", blocks.min_sweeps as f64, 2.0, 1e4),
            ("rooms.blocks.memory_s", blocks.memory_s, 0.1, 100.0),
            ("rooms.blocks.min_amplitude", blocks.min_amplitude, 0.01, 1.0),
            ("rooms.blocks.mirror_min_amplitude", blocks.mirror_min_amplitude, 0.001, 1.0),
            ("rooms.blocks.min_range_m", blocks.min_range_m, 0.05, 10.0),
            ("rooms.blocks.max_range_m", blocks.max_range_m, blocks.min_range_m, 5.0),
            ("rooms.blocks.voxel_m", blocks.voxel_m, 0.02, 0.5),
            ("rooms.explain.window_s", rooms.explain.window_s, 0.5, 20.0),
            ("rooms.explain.max_candidates", rooms.explain.max_candidates as f64, 1.0, 1e4),
            ("rooms.explain.min_score", rooms.explain.min_score, 0.0, 1e6),
            ("rooms.explain.min_candidate_score", rooms.explain.min_candidate_score, 0.0, 1e6),
            ("rooms.explain.plane_min_score", rooms.explain.plane_min_score, 0.0, 1e6),
            ("rooms.explain.min_over_point", rooms.explain.min_over_point, -1e6, 1e6),
            ("rooms.explain.plane_min_blocks", f64::from(rooms.explain.plane_min_blocks), 1.0, 1e4),
            ("rooms.explain.max_sigma_m", rooms.explain.max_sigma_m, 0.01, 10.0),
            ("rooms.explain.min_feet_rms_m", rooms.explain.min_feet_rms_m, 0.0, 10.0),
            ("rooms.explain.claim_range_m", rooms.explain.claim_range_m, 0.0, 10.0),
            ("rooms.explain.claim_lobes", rooms.explain.claim_lobes, 0.0, 1e3),
            ("rooms.map.confirm_score", rooms.map.confirm_score, 0.0, 1e6),
            ("rooms.map.confirm_sightings", rooms.map.confirm_sightings as f64, 1.0, RECENT_UPDATES as f64),
            ("rooms.map.confirm_wall_sightings", rooms.map.confirm_wall_sightings as f64, 1.0, RECENT_UPDATES as f64),
            ("rooms.map.confirm_odds", rooms.map.confirm_odds, -100.0, 100.0),
            ("rooms.map.forget.leak", rooms.map.forget.leak, 0.0, 1e3),
            ("rooms.map.forget.shadow_leak", rooms.map.forget.shadow_leak, 0.0, 1e3),
            ("rooms.map.forget.beside", rooms.map.forget.beside, 0.0, 100.0),
            ("rooms.map.forget.familiar_blocks", rooms.map.forget.familiar_blocks, 0.0, 1e9),
            ("rooms.explain.uneven_cost", rooms.explain.uneven_cost, 0.0, 1e6),
            ("rooms.map.hands_reach_m", rooms.map.hands_reach_m, 0.0, 10.0),
            ("rooms.map.forget.confirm", rooms.map.forget.confirm, -100.0, 100.0),
            ("rooms.map.forget.newly", rooms.map.forget.newly, 0.0, 100.0),
            ("rooms.map.forget.most", rooms.map.forget.most, 0.1, 100.0),
            ("rooms.map.forget.familiar", rooms.map.forget.familiar, 0.0, 0.99),
            ("rooms.map.forget.unfamiliar", rooms.map.forget.unfamiliar, 0.0, 0.99),
            ("rooms.map.match_m", rooms.map.match_m, 0.01, 1.0),
            ("rooms.fine.voxel_m", rooms.fine.voxel_m, 0.005, 0.05),
            ("rooms.fine.min_score", rooms.fine.min_score, 0.0, 1e6),
            ("rooms.fine.max_opened", rooms.fine.max_opened as f64, 0.0, 1e4),
            ("rooms.fine.max_bricks", rooms.fine.max_bricks as f64, 0.0, 1e5),
            ("rooms.fine.keep_looks", f64::from(rooms.fine.keep_looks), 0.0, 1e4),
            ("rooms.moving.alarms_per_block", rooms.moving.alarms_per_block, 1e-6, 1.0),
            ("rooms.moving.confirm_blocks", rooms.moving.confirm_blocks as f64, 1.0, 6.0),
            ("rooms.moving.min_travel_m", rooms.moving.min_travel_m, 0.0, 10.0),
            ("rooms.moving.forget_s", rooms.moving.forget_s, 0.1, 10.0),
            ("reflectors.voxel_m", reflectors.voxel_m, 0.005, 0.5),
            ("reflectors.min_range_m", reflectors.min_range_m, 0.0, 10.0),
            ("reflectors.threshold_sigma", reflectors.threshold_sigma, 0.0, 1e6),
            ("reflectors.max_reflectors", reflectors.max_reflectors as f64, 1.0, 1000.0),
            ("reflectors.max_sweeps", reflectors.max_sweeps as f64, 0.0, 1e9),
            ("reflectors.search_sweeps", reflectors.search_sweeps as f64, 3.0, 1e5),
            ("cues.volume", self.cues.volume, 0.0, 1.0),
            ("cues.pulse_strength", self.cues.pulse_strength, 0.0, 1.0),
            ("headset.poses_hz", self.headset.poses_hz, 0.0, 1000.0),
            ("headset.threads", self.headset.threads as f64, 0.0, 256.0),
        ];
        for (name, value, min, max) in bounded {
            if !(min..=max).contains(&value) {
                return Err(SettingsError::OutOfRange { name, value, min, max });
            }
        }
        if let Some(region) = &processing.region {
            let sound = region.min.is_finite() && region.max.is_finite() && region.size().min_element() > 0.0;
            if !sound || region.size().max_element() > 50.0 {
                return Err(SettingsError::Region(*region));
            }
        }
        self.check_places()?;
        if let Some(mount) = &tracking.mount
            && Pose::try_new(mount.translation.to_array(), mount.rotation.to_array()).is_err()
        {
            return Err(SettingsError::NotFinite("tracking.mount"));
        }
        Ok(self.warning.check()?)
    }

    fn check_places(&self) -> Result<(), SettingsError> {
        let size = self.processing.region.map_or(DVec3::splat(DEFAULT_CUBE_M), |region| region.size());
        let voxel_m = self.reflectors.voxel_m;
        let places = (size / voxel_m).ceil().to_array().iter().product::<f64>();
        match places <= MAX_PLACES {
            true => Ok(()),
            false => Err(SettingsError::TooManyPlaces { voxel_m, places, max: MAX_PLACES }),
        }
    }
}

/// Lays one table over another, key by key in tables within.
fn lay_over(table: &mut toml::Table, above: toml::Table) {
    for (key, value) in above {
        match (table.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(above)) => lay_over(inner, above),
            (_, value) => drop(table.insert(key, value)),
        }
    }
}

/// A TOML value where it is one, else a string: `--set radar.beam=thesis` needs no quotes.
fn parsed(value: &str) -> toml::Value {
    let line = format!("v = {value}");
    let table: Option<toml::Table> = toml::from_str(&line).ok();
    table.and_then(|mut t| t.remove("v")).unwrap_or_else(|| toml::Value::String(value.into()))
}

fn set(table: &mut toml::Table, change: &str, name: &str, value: toml::Value) -> Result<(), SettingsError> {
    match name.split_once('.') {
        None => {
            // Whole numbers serve where fractions are wanted.
            let value = match (&value, table.get(name)) {
                (toml::Value::Integer(n), Some(toml::Value::Float(_))) => toml::Value::Float(*n as f64),
                _ => value,
            };
            table.insert(name.into(), value);
            Ok(())
        }
        Some((first, rest)) => {
            let inner = table.entry(first).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            let inner = inner.as_table_mut().ok_or_else(|| SettingsError::NoSuchName(change.into()))?;
            set(inner, change, rest, value)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(change: &str) -> Result<Settings, SettingsError> {
        Settings::from_toml("", &[change.into()])
    }

    #[test]
    fn the_default_survives_its_own_text() {
        let settings = Settings::default();
        assert_eq!(Settings::from_toml(&settings.to_toml(), &[]).unwrap(), settings);
    }

    #[test]
    fn changes_are_laid_over() {
        assert_eq!(with("tracking.time_offset_s=0.02").unwrap().tracking.time_offset_s, 0.02);
        assert_eq!(with("radar.beam=thesis").unwrap().radar.beam, Beam::Thesis);
        assert_eq!(with("processing.mode=rooms").unwrap().processing.mode, Mode::Rooms);
        assert_eq!(with("reflectors.max_sweeps=50").unwrap().reflectors.max_sweeps, 50);
        assert_eq!(with("rooms.blocks.max_range_m=2").unwrap().rooms.blocks.max_range_m, 2.0);
    }

    #[test]
    fn what_lies_below_serves_where_nothing_else_is_named() {
        let below: toml::Table = toml::from_str("[warning]\ncolor = [1, 2, 3]\nfade_distance_m = 0.7").unwrap();
        let text = "[warning]\nfade_distance_m = 2.0";
        let settings = Settings::from_layers(below, text, &["warning.brightness=0.5".into()]).unwrap();
        let warning = settings.warning;
        assert_eq!((warning.color, warning.fade_distance_m, warning.brightness), ([1, 2, 3], 2.0, 0.5));
    }

    #[test]
    fn wrong_ones_say_what_is_wrong() {
        for (change, says) in [
            ("rooms.blocks.voxel_m=0", "rooms.blocks.voxel_m is 0"),
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
            assert!(error.contains(says), "{change}: {error}");
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
    fn no_number_may_be_any_number() {
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
    fn what_could_never_be_confirmed_is_refused() {
        for change in
            ["rooms.map.confirm_sightings=5", "rooms.map.confirm_wall_sightings=9", "rooms.explain.max_sigma_m=-1"]
        {
            assert!(with(change).is_err(), "{change}");
        }
        assert!(with("rooms.map.confirm_wall_sightings=4").is_ok());
    }

    #[test]
    fn the_likeliest_name_is_named() {
        let told = |change: &str| with(change).expect_err(change).to_string();
        assert!(told("warning.fade_distance=2").ends_with("Did you mean `fade_distance_m`?"));
        assert!(told("room.blocks.voxel_m=2").ends_with("Did you mean `rooms`?"), "{}", told("room.blocks.voxel_m=2"));
        assert!(!told("xyz=2").contains("Did you mean"), "{}", told("xyz=2"));
    }

    #[test]
    fn kinds_of_values_are_told_in_words() {
        for (change, says) in [
            ("warning.brightness=dark", "expected a number"),
            ("warning.color=[300, 0, 0]", "expected a whole number from 0 to 255"),
            ("reflectors.max_sweeps=many", "expected a whole number, 0 or more"),
            ("warning=3", "expected a table of settings"),
        ] {
            let error = with(change).expect_err(change).to_string();
            assert!(error.contains(says) && !error.contains("f32") && !error.contains("struct"), "{change}: {error}");
        }
    }
}
