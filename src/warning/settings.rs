//! What the player may change about warnings: how near they begin, and how they look.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A setting that cannot be used, with its value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WarningSettingsError {
    /// The fade must run over some distance.
    #[error("full_distance_m = {full_m} must be at least 0 and less than fade_distance_m = {fade_m}")]
    Distances {
        /// `full_distance_m` as given.
        full_m: f64,
        /// `fade_distance_m` as given.
        fade_m: f64,
    },
    /// A grid too fine or too wide to read.
    #[error("grid_spacing_m = {0} must be from 0.05 to 1 m")]
    GridSpacing(f64),
    /// An area without a size, or a margin that is none.
    #[error("play_area_m = {area_m:?} and play_area_margin_m = {margin_m} must be lengths from 0 to 100 m")]
    PlayArea {
        /// `play_area_m` as given.
        area_m: Option<[f64; 2]>,
        /// `play_area_margin_m` as given.
        margin_m: f64,
    },
    /// Brighter than the display, or negative.
    #[error("brightness = {0} must be from 0 to 1")]
    Brightness(f32),
}

/// Distances and looks of the warnings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WarningSettings {
    /// At this distance and nearer a warning has its full brightness, metres.
    pub full_distance_m: f64,
    /// From this distance on there is no warning, metres.
    pub fade_distance_m: f64,
    /// Colour of lines and silhouettes: sRGB red, green, blue, 0 to 255.
    pub color: [u8; 3],
    /// Greatest brightness, 0 to 1.
    pub brightness: f32,
    /// Distance between two lines of the grid, metres.
    pub grid_spacing_m: f64,
    /// Whether obstacles are also drawn as areas on the floor.
    pub footprints: bool,
    /// The area the player keeps to: width (x) and depth (z) around the origin of the tracking frame, metres; left out: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play_area_m: Option<[f64; 2]>,
    /// What lies wholly farther than this outside the play area is not warned of, metres.
    pub play_area_margin_m: f64,
}

impl Default for WarningSettings {
    fn default() -> Self {
        Self {
            full_distance_m: 0.4,
            fade_distance_m: 1.5,
            color: [64, 224, 255],
            brightness: 1.0,
            grid_spacing_m: 0.2,
            footprints: true,
            play_area_m: None,
            play_area_margin_m: 1.0,
        }
    }
}

impl WarningSettings {
    /// Whether every value can be used.
    ///
    /// # Errors
    /// The first value outside the bounds that its error names.
    pub fn check(&self) -> Result<(), WarningSettingsError> {
        let (full_m, fade_m) = (self.full_distance_m, self.fade_distance_m);
        if !(full_m >= 0.0 && fade_m > full_m && fade_m.is_finite()) {
            return Err(WarningSettingsError::Distances { full_m, fade_m });
        }
        if !(0.05..=1.0).contains(&self.grid_spacing_m) {
            return Err(WarningSettingsError::GridSpacing(self.grid_spacing_m));
        }
        if !(0.0..=1.0).contains(&self.brightness) {
            return Err(WarningSettingsError::Brightness(self.brightness));
        }
        let (area_m, margin_m) = (self.play_area_m, self.play_area_margin_m);
        let lengths = area_m.into_iter().flatten().chain([margin_m]);
        if !lengths.into_iter().all(|length| (0.0..=100.0).contains(&length)) {
            return Err(WarningSettingsError::PlayArea { area_m, margin_m });
        }
        Ok(())
    }

    /// Whether a player who keeps to the play area can come near a place.
    pub(super) fn is_in_reach(&self, place: DVec3) -> bool {
        self.play_area_m.is_none_or(|[width_m, depth_m]| {
            let margin_m = self.play_area_margin_m;
            place.x.abs() <= width_m / 2.0 + margin_m && place.z.abs() <= depth_m / 2.0 + margin_m
        })
    }

    /// Brightness at a distance: full up to `full_distance_m`, then falling smoothly to 0 at `fade_distance_m`; 0 when a
    /// number makes no sense.
    pub fn alpha(&self, distance_m: f64) -> f32 {
        let share = if distance_m <= self.full_distance_m {
            1.0
        } else if distance_m < self.fade_distance_m {
            (self.fade_distance_m - distance_m) / (self.fade_distance_m - self.full_distance_m)
        } else {
            0.0
        };
        let alpha = (share * share * (3.0 - 2.0 * share)) as f32 * self.brightness;
        if alpha.is_finite() { alpha.clamp(0.0, 1.0) } else { 0.0 }
    }
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
    fn settings_round_through_toml_and_refuse_what_they_do_not_know() {
        let settings: WarningSettings = toml::from_str("fade_distance_m = 2.0").unwrap();
        assert_eq!(settings, WarningSettings { fade_distance_m: 2.0, ..Default::default() });
        assert_eq!(toml::from_str::<WarningSettings>(&toml::to_string(&settings).unwrap()).unwrap(), settings);
        assert!(toml::from_str::<WarningSettings>("fade_distance = 2.0").is_err());
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let turned = WarningSettings { full_distance_m: 2.0, ..Default::default() };
        assert_eq!(turned.check(), Err(WarningSettingsError::Distances { full_m: 2.0, fade_m: 1.5 }));
        let fine = WarningSettings { grid_spacing_m: 0.001, ..Default::default() };
        assert_eq!(fine.check(), Err(WarningSettingsError::GridSpacing(0.001)));
        let area = WarningSettings { play_area_m: Some([2.0, -1.0]), ..Default::default() };
        assert!(area.check().unwrap_err().to_string().contains("play_area_m = Some([2.0, -1.0])"));
        assert!(WarningSettings::default().check().is_ok());
    }
}
