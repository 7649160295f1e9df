//! Tones from the computer's sound device, for cues.
//!
//! The device is opened when the first tone is wanted, on a thread of its own, since opening may take a while and a stream may not change
//! threads on every system. A machine without one is told of once; tones are then dropped. Tones go through a bounded queue, and who
//! plays one never waits.

mod voice;

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};

use crate::warning::Tone;
use voice::Mixer;

/// Tones that may wait to begin.
const MAX_WAITING_TONES: usize = 4;

/// Why nothing can be heard.
#[derive(Debug, thiserror::Error)]
enum SoundError {
    #[error("there is no sound device")]
    NoDevice,
    #[error("the sound device cannot be used: {0}")]
    Config(#[from] cpal::DefaultStreamConfigError),
    #[error("the sound device cannot be opened: {0}")]
    Build(#[from] cpal::BuildStreamError),
    #[error("the sound device does not play: {0}")]
    Play(#[from] cpal::PlayStreamError),
    #[error("the sound device takes no samples that are known here ({0})")]
    Format(cpal::SampleFormat),
}

/// Where tones go. Silent until the first one, and when dropped.
#[derive(Debug, Default)]
pub struct TonePlayer {
    opened: Option<OpenDevice>,
}

#[derive(Debug)]
struct OpenDevice {
    tones: SyncSender<Tone>,
    /// Its thread keeps the device open until this is dropped.
    _keeps: SyncSender<()>,
}

impl TonePlayer {
    /// Begins a tone; it is left out when there is no device, or when too many wait.
    pub fn play(&mut self, tone: Tone) {
        let opened = self.opened.get_or_insert_with(open);
        // A queue that is full or has no reader any more: the next tone is as good.
        let _ = opened.tones.try_send(tone);
    }
}

fn open() -> OpenDevice {
    let (tones, waiting) = sync_channel(MAX_WAITING_TONES);
    let (keeps, ended) = sync_channel(0);
    let thread = std::thread::Builder::new().name("sound".into());
    let spawned = thread.spawn(move || {
        if let Err(error) = stream(waiting, &ended) {
            log::warn!("warnings are not heard: {error}");
        }
    });
    if let Err(error) = spawned {
        log::warn!("warnings are not heard: {error}");
    }
    OpenDevice { tones, _keeps: keeps }
}

/// Plays until `ended` has no sender any more.
fn stream(tones: Receiver<Tone>, ended: &Receiver<()>) -> Result<(), SoundError> {
    let device = cpal::default_host().default_output_device().ok_or(SoundError::NoDevice)?;
    let config = device.default_output_config()?;
    let mixer = Mixer::new(config.sample_rate().0 as f32, usize::from(config.channels()));
    let stream = match config.sample_format() {
        cpal::SampleFormat::F32 => build::<f32>(&device, &config.into(), mixer, tones),
        cpal::SampleFormat::I16 => build::<i16>(&device, &config.into(), mixer, tones),
        cpal::SampleFormat::U16 => build::<u16>(&device, &config.into(), mixer, tones),
        cpal::SampleFormat::I32 => build::<i32>(&device, &config.into(), mixer, tones),
        other => return Err(SoundError::Format(other)),
    }?;
    stream.play()?;
    // Nothing is ever sent: this returns when the other end is dropped.
    let _ = ended.recv();
    Ok(())
}

fn build<T: cpal::SizedSample + cpal::FromSample<f32>>(
    device: &cpal::Device,
    config: &cpal::StreamConfig,
    mut mixer: Mixer,
    tones: Receiver<Tone>,
) -> Result<cpal::Stream, cpal::BuildStreamError> {
    let fill = move |samples: &mut [T], _: &cpal::OutputCallbackInfo| {
        while let Ok(tone) = tones.try_recv() {
            mixer.begin(&tone);
        }
        mixer.fill(samples, T::from_sample);
    };
    // A device that was unplugged says so again and again.
    let mut told = false;
    let failed = move |error| {
        if !std::mem::replace(&mut told, true) {
            log::warn!("warnings are not heard any more: {error}");
        }
    };
    device.build_output_stream(config, fill, failed, None)
}
