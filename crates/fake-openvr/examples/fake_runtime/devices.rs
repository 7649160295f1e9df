//! The tracked devices: their paths, losses of tracking, and the controllers' haptic pulses.

use std::collections::BTreeMap;

use glam::DVec3;
use radar_sar::geometry::Pose;

use crate::config::Config;
use crate::track::{Motion, Track};

/// The head, then the controllers.
pub struct Devices {
    tracks: Vec<Track>,
    /// Time at which the tracks begin, nanoseconds.
    tracks_zero_ns: i64,
    invalid_until_ns: i64,
    /// Time of the last pulse of each controller, nanoseconds.
    pulsed_ns: BTreeMap<u32, i64>,
}

impl Devices {
    /// Reads the tracks.
    ///
    /// # Errors
    /// What is wrong with a track's file.
    pub fn new(config: &Config, start_ns: i64) -> Result<Self, String> {
        let tracks_zero_ns = if config.track_is_relative { start_ns } else { 0 };
        let tracks = read_tracks(config)?;
        Ok(Self { tracks, tracks_zero_ns, invalid_until_ns: i64::MIN, pulsed_ns: BTreeMap::new() })
    }

    /// Number of devices.
    pub fn len(&self) -> usize {
        self.tracks.len()
    }

    /// Loses the tracking of all devices until a time.
    pub fn lose_tracking(&mut self, until_ns: i64) {
        self.invalid_until_ns = until_ns;
    }

    /// True pose of a device in the world, whether it is tracked or not; `None` in a gap of its
    /// track.
    pub fn pose(&self, device: usize, time_ns: i64) -> Option<Pose> {
        Some(self.at(device, time_ns)?.pose)
    }

    /// Motion of a device in the world; `None` if tracking is lost.
    pub fn motion(&self, device: usize, time_ns: i64) -> Option<Motion> {
        let lost = crate::clock::now_ns() < self.invalid_until_ns;
        if lost { None } else { self.at(device, time_ns) }
    }

    fn at(&self, device: usize, time_ns: i64) -> Option<Motion> {
        self.tracks.get(device)?.at(time_ns - self.tracks_zero_ns)
    }

    /// Starts a haptic pulse; returns the time of the one before.
    pub fn pulse(&mut self, device: u32, now_ns: i64) -> Option<i64> {
        self.pulsed_ns.insert(device, now_ns)
    }
}

fn read_tracks(config: &Config) -> Result<Vec<Track>, String> {
    let head = match &config.track {
        Some(path) => Track::read(path, config.track_loops)?,
        None => Track::at_rest(Pose::from_translation(DVec3::new(0.0, 1.6, 0.0))),
    };
    let controllers = config.controllers.iter().map(|path| Track::read(path, config.track_loops));
    std::iter::once(Ok(head)).chain(controllers).collect()
}
