//! Settings of SteamVR's chaperone: its colour, the distance from which it is drawn, and the play
//! area.

use std::ffi::CStr;

use super::runtime::{Runtime, call};
use super::sys;

/// The user's chaperone settings, as far as the runtime provides them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Chaperone {
    /// Colour of the bounds: sRGB red, green, blue, 0 to 255.
    pub color: Option<[u8; 3]>,
    /// Distance from which the bounds are drawn, metres.
    pub fade_distance_m: Option<f64>,
    /// Width (x) and depth (z) of the play area, metres. Its centre is the origin of the standing
    /// universe.
    pub play_area_m: Option<[f64; 2]>,
}

impl Runtime {
    /// The current settings.
    pub fn chaperone(&self) -> Chaperone {
        let section = sys::k_pch_CollisionBounds_Section;
        let fade_m = self.float_setting(section, sys::k_pch_CollisionBounds_FadeDistance_Float);
        let channel = |key| self.int_setting(section, key).and_then(|value| u8::try_from(value).ok());
        let color = || {
            Some([
                channel(sys::k_pch_CollisionBounds_ColorGammaR_Int32)?,
                channel(sys::k_pch_CollisionBounds_ColorGammaG_Int32)?,
                channel(sys::k_pch_CollisionBounds_ColorGammaB_Int32)?,
            ])
        };
        Chaperone {
            // A runtime without these settings was seen to answer each with 0 and no error: warnings in
            // black cannot be seen.
            color: color().filter(|channels| *channels != [0; 3]),
            fade_distance_m: fade_m.filter(|m| m.is_finite() && *m > 0.0),
            play_area_m: self.play_area_m(),
        }
    }

    fn play_area_m(&self) -> Option<[f64; 2]> {
        let (mut x, mut z) = (0.0f32, 0.0f32);
        let is_told = call!(self.chaperone?, GetPlayAreaSize(&mut x, &mut z));
        let is_sound = [x, z].iter().all(|side| side.is_finite() && (0.1..=100.0).contains(side));
        (is_told && is_sound).then(|| [f64::from(x), f64::from(z)])
    }

    fn float_setting(&self, section: &CStr, key: &CStr) -> Option<f64> {
        let mut error = 0;
        let (section, key) = (section.as_ptr().cast_mut(), key.as_ptr().cast_mut());
        let value = call!(self.settings, GetFloat(section, key, &mut error));
        (error == sys::EVRSettingsError_VRSettingsError_None).then_some(f64::from(value))
    }

    fn int_setting(&self, section: &CStr, key: &CStr) -> Option<i32> {
        let mut error = 0;
        let (section, key) = (section.as_ptr().cast_mut(), key.as_ptr().cast_mut());
        let value = call!(self.settings, GetInt32(section, key, &mut error));
        (error == sys::EVRSettingsError_VRSettingsError_None).then_some(value)
    }
}
