//! Plays the tones of cues on the computer's sound device.
//!
//! The device is opened at the first tone, in its own thread: opening may take a while, and on some
//! systems a stream must stay in its thread. A missing device is logged once and tones are dropped.
//! Tones go through a bounded queue, and playing one never waits.

mod voice;

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};

use crate::warning::Tone;
use voice::Mixer;

/// Bound of tones that wait to start. Choice: as many as sound at once; a device that stalls must
/// not play old cues later.
const MAX_WAITING_TONES: usize = 4;

/// Why no sound can be played.
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
    #[error("the sound device uses an unsupported sample format ({0})")]
    Format(cpal::SampleFormat),
}

/// Plays tones. Silent before the first tone and after it is dropped.
#[derive(Debug, Default)]
pub struct TonePlayer {
    opened: Option<OpenDevice>,
}

#[derive(Debug)]
struct OpenDevice {
    tones: SyncSender<Tone>,
    /// The thread keeps the device open until this is dropped.
    _keeps: SyncSender<()>,
}

impl TonePlayer {
    /// Starts a tone; it is dropped when there is no device or too many wait.
    pub fn play(&mut self, tone: Tone) {
        let opened = self.opened.get_or_insert_with(open);
        // The queue is full or has no reader any more: dropping the tone is fine.
        let _ = opened.tones.try_send(tone);
    }
}

fn open() -> OpenDevice {
    let (tones, waiting) = sync_channel(MAX_WAITING_TONES);
    let (keeps, ended) = sync_channel(0);
    let thread = std::thread::Builder::new().name("sound".into());
    let spawned = thread.spawn(move || {
        if let Err(error) = stream(waiting, &ended) {
            log::warn!("warnings have no sound: {error}");
        }
    });
    if let Err(error) = spawned {
        log::warn!("warnings have no sound: {error}");
    }
    OpenDevice { tones, _keeps: keeps }
}

/// Plays until the sender of `ended` is dropped.
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
    // Nothing is ever sent: this returns when the sender is dropped.
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
    // An unplugged device reports the error repeatedly.
    let mut has_logged = false;
    let failed = move |error| {
        if !std::mem::replace(&mut has_logged, true) {
            log::warn!("warnings no longer have sound: {error}");
        }
    };
    device.build_output_stream(config, fill, failed, None)
}
