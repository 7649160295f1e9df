//! User settings of the warnings: where they begin and how they look.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A setting outside its bounds, with its value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WarningSettingsError {
    /// The fade must span some distance.
    #[error(
        "full_distance_m = {full_m} must be at least 0 and less than fade_distance_m = {fade_m}, which is 10 at most"
    )]
    Distances {
        /// `full_distance_m` as given.
        full_m: f64,
        /// `fade_distance_m` as given.
        fade_m: f64,
    },
    /// A grid too fine or too wide to read.
    #[error("grid_spacing_m = {0} must be from 0.05 to 1 m")]
    GridSpacing(f64),
    /// An area without a size, or an invalid margin.
    #[error("play_area_m = {} and play_area_margin_m = {margin_m} must be lengths from 0 to 100 m", area_text(*area_m))]
    PlayArea {
        /// `play_area_m` as given.
        area_m: Option<[f64; 2]>,
        /// `play_area_margin_m` as given.
        margin_m: f64,
    },
    /// Brighter than the display, or negative.
    #[error("brightness = {0} must be from 0 to 1")]
    Brightness(f32),
    /// Times in the wrong order.
    #[error(
        "contact_full_s = {full_s} must be at least 0 and less than contact_begin_s = {begin_s}, which is 10 at most"
    )]
    Contact {
        /// `contact_full_s` as given.
        full_s: f64,
        /// `contact_begin_s` as given.
        begin_s: f64,
    },
    /// Farther than arms reach.
    #[error("hand_distance_m = {0} must be from 0 to 2 m")]
    HandDistance(f64),
    /// Not a share from 0 to 1.
    #[error("provisional_brightness = {0} must be from 0 to 1")]
    ProvisionalBrightness(f64),
    /// An invalid time, or not a share from 0 to 1.
    #[error("calm_after_s = {after_s} must be from 0 to 3600, and calm_brightness = {brightness} from 0 to 1")]
    Calm {
        /// `calm_after_s` as given.
        after_s: f64,
        /// `calm_brightness` as given.
        brightness: f64,
    },
}

fn area_text(area_m: Option<[f64; 2]>) -> String {
    area_m.map_or("none".into(), |area_m| format!("{area_m:?}"))
}

/// How warnings are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Style {
    /// A grid with the silhouette in it.
    #[default]
    Grid,
    /// The silhouette's outline; the frame for walls and for panels without a silhouette.
    Outline,
    /// The silhouette filled, on a tinted surface.
    Solid,
    /// A thin frame, and the footprint.
    Minimal,
}

impl Style {
    /// All styles.
    pub const ALL: [Self; 4] = [Self::Grid, Self::Outline, Self::Solid, Self::Minimal];
}

/// Distances and appearance of the warnings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WarningSettings {
    /// Warnings have full brightness up to this distance, metres, from the upright line through the
    /// torso or from the head.
    pub full_distance_m: f64,
    /// No warning from this distance on, metres.
    pub fade_distance_m: f64,
    /// No warning from this distance to a hand on, metres, for what is near only to a hand. 0:
    /// hands are ignored. Full brightness at 3/10 of it.
    pub hand_distance_m: f64,
    /// Full brightness when contact is this time away or less at the current speed, seconds, at any
    /// distance.
    pub contact_full_s: f64,
    /// No contribution of the time to contact from this time on, seconds. 0: time to contact is
    /// ignored.
    pub contact_begin_s: f64,
    /// A warning dims when the wearer has neither approached nor moved fast for this time, seconds.
    pub calm_after_s: f64,
    /// Share of its brightness that is left then; 1: it never dims.
    pub calm_brightness: f64,
    /// Share of its brightness for an obstacle restored from a saved map and not yet seen again.
    pub provisional_brightness: f64,
    /// Whether to warn of moving targets, such as people and pets.
    pub moving: bool,
    /// How warnings are drawn.
    pub style: Style,
    /// Whether the distance is written on the panels.
    pub labels: bool,
    /// Colour of lines and silhouettes: sRGB red, green, blue, 0 to 255.
    pub color: [u8; 3],
    /// Greatest brightness, 0 to 1.
    pub brightness: f32,
    /// Spacing of the grid lines, metres.
    pub grid_spacing_m: f64,
    /// Whether footprints are drawn on the floor as well.
    pub footprints: bool,
    /// Play area: width (x) and depth (z) around the origin of the tracking frame, metres; left
    /// out: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play_area_m: Option<[f64; 2]>,
    /// Obstacles wholly farther than this outside the play area are ignored while the wearer is inside, metres.
    pub play_area_margin_m: f64,
}

impl Default for WarningSettings {
    fn default() -> Self {
        Self {
            full_distance_m: 0.4,
            fade_distance_m: 1.5,
            hand_distance_m: 0.5,
            contact_full_s: 0.6,
            contact_begin_s: 1.5,
            calm_after_s: 6.0,
            calm_brightness: 0.3,
            provisional_brightness: 0.6,
            moving: true,
            style: Style::Grid,
            labels: false,
            color: [64, 224, 255],
            brightness: 1.0,
            grid_spacing_m: 0.2,
            footprints: true,
            play_area_m: None,
            play_area_margin_m: 1.0,
        }
    }
}

/// Largest fade distance, metres. Choice: the map does not reach farther.
const MAX_FADE_DISTANCE_M: f64 = 10.0;

impl WarningSettings {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value outside the bounds that its error names.
    pub fn check(&self) -> Result<(), WarningSettingsError> {
        let (full_m, fade_m) = (self.full_distance_m, self.fade_distance_m);
        if !(full_m >= 0.0 && fade_m > full_m && fade_m <= MAX_FADE_DISTANCE_M) {
            return Err(WarningSettingsError::Distances { full_m, fade_m });
        }
        if !(0.05..=1.0).contains(&self.grid_spacing_m) {
            return Err(WarningSettingsError::GridSpacing(self.grid_spacing_m));
        }
        if !(0.0..=1.0).contains(&self.brightness) {
            return Err(WarningSettingsError::Brightness(self.brightness));
        }
        let (full_s, begin_s) = (self.contact_full_s, self.contact_begin_s);
        if !(full_s >= 0.0 && (begin_s == 0.0 || full_s < begin_s) && (0.0..=10.0).contains(&begin_s)) {
            return Err(WarningSettingsError::Contact { full_s, begin_s });
        }
        if !(0.0..=2.0).contains(&self.hand_distance_m) {
            return Err(WarningSettingsError::HandDistance(self.hand_distance_m));
        }
        let (after_s, brightness) = (self.calm_after_s, self.calm_brightness);
        if !((0.0..=3600.0).contains(&after_s) && (0.0..=1.0).contains(&brightness)) {
            return Err(WarningSettingsError::Calm { after_s, brightness });
        }
        if !(0.0..=1.0).contains(&self.provisional_brightness) {
            return Err(WarningSettingsError::ProvisionalBrightness(self.provisional_brightness));
        }
        let (area_m, margin_m) = (self.play_area_m, self.play_area_margin_m);
        let lengths = area_m.into_iter().flatten().chain([margin_m]);
        if !lengths.into_iter().all(|length| (0.0..=100.0).contains(&length)) {
            return Err(WarningSettingsError::PlayArea { area_m, margin_m });
        }
        Ok(())
    }

    /// Whether a position lies in the play area or at most `margin_m` outside it.
    pub(super) fn is_in_play_area(&self, point: DVec3, margin_m: f64) -> bool {
        self.play_area_m.is_none_or(|[width_m, depth_m]| {
            point.x.abs() <= width_m / 2.0 + margin_m && point.z.abs() <= depth_m / 2.0 + margin_m
        })
    }

    /// Brightness at a distance: full up to `full_distance_m`, then falling smoothly to 0 at
    /// `fade_distance_m`; 0 for invalid numbers.
    pub fn alpha(&self, distance_m: f64) -> f32 {
        self.alpha_of(self.by_distance(distance_m))
    }

    /// Brightness for an urgency of 0 to 1.
    pub(super) fn alpha_of(&self, urgency: f64) -> f32 {
        let alpha = urgency as f32 * self.brightness;
        if alpha.is_finite() { alpha.clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Urgency by the distance from head or torso, 0 to 1.
    pub(super) fn by_distance(&self, distance_m: f64) -> f64 {
        smooth_fall(distance_m, self.full_distance_m, self.fade_distance_m)
    }

    /// Urgency by the distance from a hand, 0 to 1. Hands use shorter distances: they have little
    /// mass behind them, move where the eyes follow, and are near objects all the time.
    pub(super) fn by_hand_distance(&self, distance_m: f64) -> f64 {
        smooth_fall(distance_m, self.full_hand_distance_m(), self.hand_distance_m)
    }

    /// Distance from a hand up to which the urgency is greatest, metres.
    pub(super) fn full_hand_distance_m(&self) -> f64 {
        0.3 * self.hand_distance_m
    }

    /// Urgency by the time to contact, 0 to 1.
    pub(super) fn by_contact(&self, time_s: f64) -> f64 {
        smooth_fall(time_s, self.contact_full_s, self.contact_begin_s)
    }
}

/// 1 up to `full`, then falling smoothly to 0 at `none`; 0 for invalid numbers.
fn smooth_fall(value: f64, full: f64, none: f64) -> f64 {
    let share = if value < none { ((none - value) / (none - full)).min(1.0) } else { 0.0 };
    let share = if value <= full && full < none { 1.0 } else { share };
    let smooth = share * share * (3.0 - 2.0 * share);
    if smooth.is_finite() { smooth.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_falls_smoothly_with_distance() {
        let settings = WarningSettings::default();
        assert_eq!(settings.alpha(0.0), 1.0);
        assert_eq!(settings.alpha(0.4), 1.0);
        assert_eq!(settings.alpha(1.5), 0.0);
        assert_eq!(settings.alpha(f64::NAN), 0.0);
        let mut last = 1.0;
        for step in 0..200 {
            let alpha = settings.alpha(f64::from(step) * 0.01);
            assert!(alpha <= last && last - alpha < 0.02, "{alpha} after {last}");
            last = alpha;
        }
    }

    #[test]
    fn settings_roundtrip_through_toml_and_reject_unknown_keys() {
        let settings: WarningSettings = toml::from_str("fade_distance_m = 2.0").unwrap();
        assert_eq!(settings, WarningSettings { fade_distance_m: 2.0, ..Default::default() });
        assert_eq!(toml::from_str::<WarningSettings>(&toml::to_string(&settings).unwrap()).unwrap(), settings);
        assert!(toml::from_str::<WarningSettings>("fade_distance = 2.0").is_err());
    }

    #[test]
    fn invalid_settings_are_named_in_errors() {
        let turned = WarningSettings { full_distance_m: 2.0, ..Default::default() };
        assert_eq!(turned.check(), Err(WarningSettingsError::Distances { full_m: 2.0, fade_m: 1.5 }));
        let fine = WarningSettings { grid_spacing_m: 0.001, ..Default::default() };
        assert_eq!(fine.check(), Err(WarningSettingsError::GridSpacing(0.001)));
        for (setting, message) in [
            ("contact_full_s = 2.0", "contact_full_s = 2 "),
            ("contact_begin_s = nan", "contact_begin_s = NaN"),
            ("hand_distance_m = 3.0", "hand_distance_m = 3 "),
            ("calm_after_s = -1.0", "calm_after_s = -1 "),
            ("provisional_brightness = nan", "provisional_brightness = NaN"),
            ("calm_brightness = 1.5", "calm_brightness = 1.5"),
        ] {
            let settings: WarningSettings = toml::from_str(setting).unwrap();
            let error = settings.check().expect_err(setting).to_string();
            assert!(error.contains(message), "{setting}: {error}");
        }
        let without_contact = WarningSettings { contact_begin_s: 0.0, ..Default::default() };
        assert!(without_contact.check().is_ok() && without_contact.by_contact(0.0) == 0.0);
        let area = WarningSettings { play_area_m: Some([2.0, -1.0]), ..Default::default() };
        assert!(area.check().unwrap_err().to_string().contains("play_area_m = [2.0, -1.0]"));
        assert!(WarningSettings::default().check().is_ok());
    }
}
