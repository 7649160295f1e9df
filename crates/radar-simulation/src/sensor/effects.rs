//! Which imperfections a simulated sensor has, and how strong they are.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Imperfections of the sensor, each as a strength: 0 is none, 1 is as measured on real sensors,
/// 2 is twice that.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorEffects {
    /// Multiplicative jitter of phase and amplitude from sweep to sweep and along a sweep.
    pub jitter: f64,
    /// Direct leakage from transmitter to receiver: factor of its amplitude.
    pub leakage: f64,
    /// Ringing of the headset's shell and the mounting: factor of its amplitude.
    pub ringing: f64,
    /// Range bias of the module; it differs between modules, so it depends on the seed.
    pub range_bias: f64,
    /// Warming up after the start: factor of the rise of temperature, which lowers all amplitudes
    /// and turns the phase of the leakage.
    pub warm_up: f64,
    /// Another radar at 60 GHz in the room: factor of the share of points that it disturbs.
    pub interference: f64,
    /// Noise and gain of each profile instead of those of profile 3: share of the difference, in dB.
    pub profile_noise: f64,
}

impl SensorEffects {
    /// A sensor with noise alone.
    pub const NONE: Self = Self {
        jitter: 0.0,
        leakage: 0.0,
        ringing: 0.0,
        range_bias: 0.0,
        warm_up: 0.0,
        interference: 0.0,
        profile_noise: 0.0,
    };

    /// A sensor as measured.
    pub const MEASURED: Self = Self {
        jitter: 1.0,
        leakage: 1.0,
        ringing: 1.0,
        range_bias: 1.0,
        warm_up: 1.0,
        interference: 1.0,
        profile_noise: 1.0,
    };

    /// Names of the effects, as in settings and on the command line.
    pub const NAMES: [&str; 7] =
        ["jitter", "leakage", "ringing", "range_bias", "warm_up", "interference", "profile_noise"];

    /// The strength of the effect with this name.
    pub fn strength_mut(&mut self, name: &str) -> Option<&mut f64> {
        match name {
            "jitter" => Some(&mut self.jitter),
            "leakage" => Some(&mut self.leakage),
            "ringing" => Some(&mut self.ringing),
            "range_bias" => Some(&mut self.range_bias),
            "warm_up" => Some(&mut self.warm_up),
            "interference" => Some(&mut self.interference),
            "profile_noise" => Some(&mut self.profile_noise),
            _ => None,
        }
    }

    /// Whether every strength is a finite number from 0 to 100.
    pub fn is_valid(&self) -> bool {
        let mut copy = *self;
        Self::NAMES.iter().all(|name| copy.strength_mut(name).is_some_and(|strength| (0.0..=100.0).contains(strength)))
    }
}

/// A list of effects that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no sensor effect: use none, measured, or {list}, each with =STRENGTH if it is not 1", list = SensorEffects::NAMES.join(", "))]
pub struct EffectsError(pub String);

impl FromStr for SensorEffects {
    type Err = EffectsError;

    /// From a list with commas: `none`, `measured`, and names of effects, with `=STRENGTH` if it is not
    /// 1: `measured,jitter=2,leakage=0`. It begins with no effect.
    fn from_str(text: &str) -> Result<Self, EffectsError> {
        let mut effects = Self::NONE;
        for part in text.split(',').map(str::trim) {
            let unknown = || EffectsError(part.into());
            match part.split_once('=') {
                None if part == "none" => effects = Self::NONE,
                None if part == "measured" => effects = Self::MEASURED,
                None => *effects.strength_mut(part).ok_or_else(unknown)? = 1.0,
                Some((name, strength)) => {
                    *effects.strength_mut(name).ok_or_else(unknown)? = strength.parse().map_err(|_| unknown())?;
                }
            }
        }
        if effects.is_valid() { Ok(effects) } else { Err(EffectsError(text.into())) }
    }
}

impl Default for SensorEffects {
    /// [`Self::MEASURED`].
    fn default() -> Self {
        Self::MEASURED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read() {
        let read = |text: &str| text.parse::<SensorEffects>();
        assert_eq!(read("none"), Ok(SensorEffects::NONE));
        assert_eq!(read("measured"), Ok(SensorEffects::MEASURED));
        assert_eq!(read("jitter"), Ok(SensorEffects { jitter: 1.0, ..SensorEffects::NONE }));
        let expected = SensorEffects { leakage: 0.0, range_bias: 2.5, ..SensorEffects::MEASURED };
        assert_eq!(read("measured, leakage=0, range_bias=2.5"), Ok(expected));
        for bad in ["", "gravity", "jitter=-1", "jitter=NaN", "jitter=x", "none=1"] {
            assert!(read(bad).unwrap_err().to_string().contains("warm_up"), "{bad}");
        }
    }

    #[test]
    fn every_effect_has_a_name_and_bounds() {
        let mut effects = SensorEffects::NONE;
        for name in SensorEffects::NAMES {
            *effects.strength_mut(name).unwrap() = 1.0;
        }
        assert_eq!(effects, SensorEffects::MEASURED);
        assert!(effects.strength_mut("gravity").is_none());
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            for name in SensorEffects::NAMES {
                let mut effects = SensorEffects::MEASURED;
                *effects.strength_mut(name).unwrap() = bad;
                assert!(!effects.is_valid(), "{name} = {bad}");
            }
        }
        assert!(SensorEffects::MEASURED.is_valid() && SensorEffects::NONE.is_valid());
    }
}
