//! Cues on their way out: ticks to the controllers, tones to the sound device.

use crate::engine::Settings;
use crate::live::sound::Sound;
use crate::steamvr::{Hands, Runtime};
use crate::warning::{Cues, Player, Warnings};

/// Decides on cues and gives them.
#[derive(Debug, Default)]
pub(super) struct CueOutput {
    cues: Cues,
    sound: Sound,
}

impl CueOutput {
    /// What the warnings of this frame ask for.
    pub fn give(&mut self, runtime: &Runtime, hands: Hands, warnings: &Warnings, player: &Player, settings: &Settings) {
        let cue = self.cues.take(warnings, player, settings.warning.brightness, &settings.cues);
        for (hand, tick_us) in cue.ticks_us.into_iter().enumerate() {
            if let Some(tick_us) = tick_us.filter(|tick_us| *tick_us > 0) {
                runtime.pulse(hands, hand, tick_us);
            }
        }
        if let Some(tone) = cue.tone {
            self.sound.play(tone);
        }
    }
}
