//! Synthesises tones: sines with a raised-cosine envelope, panned with equal power, a few at a
//! time.

use std::f32::consts::{FRAC_PI_4, TAU};

use crate::warning::Tone;

/// Largest number of simultaneous tones. Choice: tones of 0.12 s, 0.3 s apart, do not overlap; a
/// late device may start a few together.
const MAX_VOICES: usize = 4;

/// Mixes tones into a stream.
#[derive(Debug)]
pub(super) struct Mixer {
    rate_hz: f32,
    channels: usize,
    voices: Vec<Voice>,
}

#[derive(Debug)]
struct Voice {
    left: f32,
    right: f32,
    step_rad: f32,
    samples: u32,
    done: u32,
}

impl Mixer {
    pub fn new(rate_hz: f32, channels: usize) -> Self {
        Self { rate_hz, channels: channels.max(1), voices: Vec::with_capacity(MAX_VOICES) }
    }

    /// Adds a tone; it is dropped when too many are playing.
    pub fn begin(&mut self, tone: &Tone) {
        let angle = (tone.pan.clamp(-1.0, 1.0) + 1.0) * FRAC_PI_4;
        let samples = (tone.length_s.clamp(0.0, 2.0) * self.rate_hz) as u32;
        if self.voices.len() < MAX_VOICES && samples > 0 {
            let volume = tone.volume.clamp(0.0, 1.0);
            let step_rad = TAU * tone.hz / self.rate_hz;
            self.voices.push(Voice {
                left: volume * angle.cos(),
                right: volume * angle.sin(),
                step_rad,
                samples,
                done: 0,
            });
        }
    }

    /// Fills interleaved frames: the first channel is left, the second right, others are silent; a
    /// single channel gets both.
    pub fn fill<T>(&mut self, samples: &mut [T], of: impl Fn(f32) -> T) {
        for frame in samples.chunks_mut(self.channels) {
            let (mut left, mut right) = (0.0, 0.0);
            for voice in &mut self.voices {
                let value = voice.next();
                left += value * voice.left;
                right += value * voice.right;
            }
            let sides = if self.channels == 1 { [left.midpoint(right), 0.0] } else { [left, right] };
            for (channel, sample) in frame.iter_mut().enumerate() {
                *sample = of(sides.get(channel).map_or(0.0, |side| side.clamp(-1.0, 1.0)));
            }
            self.voices.retain(|voice| voice.done < voice.samples);
        }
    }
}

impl Voice {
    fn next(&mut self) -> f32 {
        let share = self.done as f32 / self.samples as f32;
        // A raised cosine starts and ends without a click.
        let envelope = 0.5 - 0.5 * (TAU * share).cos();
        let value = (self.step_rad * self.done as f32).sin() * envelope;
        self.done = (self.done + 1).min(self.samples);
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(pan: f32) -> Tone {
        Tone { pan, volume: 0.5, hz: 440.0, length_s: 0.12 }
    }

    fn played(mixer: &mut Mixer, frames: usize) -> Vec<f32> {
        let mut samples = vec![9.0f32; frames * mixer.channels];
        mixer.fill(&mut samples, |v| v);
        samples
    }

    #[test]
    fn tone_is_panned_click_free_and_ends() {
        let mut mixer = Mixer::new(48_000.0, 2);
        mixer.begin(&tone(-1.0));
        let samples = played(&mut mixer, 6000);
        let loudest = |side: usize| samples.iter().skip(side).step_by(2).fold(0.0f32, |most, v| most.max(v.abs()));
        assert!((loudest(0) - 0.5).abs() < 0.01 && loudest(1) < 1e-6, "{} {}", loudest(0), loudest(1));
        let left: Vec<f32> = samples.iter().step_by(2).copied().collect();
        assert!(left.windows(2).all(|pair| (pair[0] - pair[1]).abs() < 0.03));
        assert!(left[..20].iter().all(|v| v.abs() < 1e-3) && left[5760..].iter().all(|v| *v == 0.0));
        assert!(mixer.voices.is_empty());
    }

    #[test]
    fn mixer_stays_within_bounds() {
        for channels in [1, 2, 6] {
            let mut mixer = Mixer::new(44_100.0, channels);
            (0..100).for_each(|_| mixer.begin(&Tone { volume: 1.0, ..tone(0.0) }));
            assert_eq!(mixer.voices.len(), MAX_VOICES);
            let samples = played(&mut mixer, 4000);
            assert!(samples.iter().all(|v| v.abs() <= 1.0) && samples.iter().any(|v| v.abs() > 0.5));
            assert!(samples.chunks(channels).all(|frame| frame.iter().skip(2).all(|v| *v == 0.0)));
        }
        let mut mixer = Mixer::new(48_000.0, 2);
        mixer.begin(&Tone { pan: f32::NAN, volume: f32::NAN, hz: f32::NAN, length_s: f32::NAN });
        assert!(mixer.voices.is_empty(), "a tone of no length is none");
    }
}
