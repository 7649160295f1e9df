//! Outputs cues: ticks to the controllers, tones to the sound device.

use crate::app::now_ns;
use crate::app::sound::TonePlayer;
use crate::openvr::{Hands, Runtime};
use crate::warning::{CueScheduler, CueSettings, Warnings, Wearer};

/// Least interval of ticks to one controller, nanoseconds. Source: openvr.h, which refuses a pulse
/// within 5 ms of the last. Choice: 1 ms more, because late frames come closer together.
const MIN_TICK_INTERVAL_NS: i64 = 6_000_000;

/// Schedules cues and outputs them.
#[derive(Debug, Default)]
pub(super) struct CueOutput {
    cues: CueScheduler,
    sound: TonePlayer,
    /// Time of the last tick of each hand, host nanoseconds.
    ticked_ns: [i64; 2],
}

impl CueOutput {
    /// Outputs the cues for the warnings of this frame.
    pub fn output(
        &mut self,
        runtime: &Runtime,
        hands: Hands,
        warnings: &Warnings,
        wearer: &Wearer,
        brightness: f32,
        settings: &CueSettings,
    ) {
        let cue = self.cues.update(warnings, wearer, brightness, settings);
        for (hand, tick_us) in cue.ticks_us.into_iter().enumerate() {
            let is_ready = now_ns().saturating_sub(self.ticked_ns[hand]) >= MIN_TICK_INTERVAL_NS;
            if let Some(tick_us) = tick_us.filter(|tick_us| *tick_us > 0 && is_ready) {
                runtime.pulse(hands, hand, tick_us);
                self.ticked_ns[hand] = now_ns();
            }
        }
        if let Some(tone) = cue.tone {
            self.sound.play(tone);
        }
    }
}
