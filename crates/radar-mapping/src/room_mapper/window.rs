//! The sub-apertures of the last seconds, and a selection of earlier ones.

use std::collections::VecDeque;

use glam::DVec3;
use radar_sar::subaperture::Subaperture;

use crate::history::History;

/// Sub-apertures that detections rest on.
#[derive(Debug, Default)]
pub(super) struct Window {
    subapertures: VecDeque<Subaperture>,
    /// Sub-apertures that have left the window.
    pub history: History,
    /// Position of the sensor at the first sub-aperture: about the middle of the room.
    middle: Option<DVec3>,
    /// Middle of the first sub-aperture, host nanoseconds.
    first_ns: Option<i64>,
}

impl Window {
    /// An empty window of the same room.
    pub fn emptied(self) -> Self {
        Self { middle: self.middle, ..Self::default() }
    }

    /// In rising time.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &Subaperture> + ExactSizeIterator {
        self.subapertures.iter()
    }

    pub fn len(&self) -> usize {
        self.subapertures.len()
    }

    pub fn newest(&self) -> Option<&Subaperture> {
        self.subapertures.back()
    }

    /// Middle of the newest sub-aperture, host nanoseconds; the least time when there is none.
    pub fn now_ns(&self) -> i64 {
        self.newest().map_or(i64::MIN, |newest| newest.mid_time_ns)
    }

    /// A point in the room that planes are compared at, metres.
    pub fn middle(&self) -> DVec3 {
        self.middle.unwrap_or(DVec3::ZERO)
    }

    /// How long sub-apertures have been coming, seconds.
    pub fn age_s(&self) -> f64 {
        let times_ns = self.first_ns.zip(self.newest().map(|newest| newest.mid_time_ns));
        times_ns.map_or(0.0, |(first_ns, now_ns)| (now_ns - first_ns) as f64 * 1e-9)
    }

    pub fn push(&mut self, subaperture: Subaperture) {
        self.middle.get_or_insert(subaperture.middle.translation);
        self.first_ns.get_or_insert(subaperture.mid_time_ns);
        self.subapertures.push_back(subaperture);
    }

    /// Moves the sub-apertures of before a time into the history; `leave` is called for each.
    pub fn drop_before(&mut self, since_ns: i64, mut leave: impl FnMut()) {
        while let Some(old) = self.subapertures.pop_front_if(|subaperture| subaperture.mid_time_ns < since_ns) {
            leave();
            self.history.push(&old);
        }
    }

    /// As if all of it had been measured so much later.
    #[cfg(test)]
    pub fn shift_ns(&mut self, by_ns: i64) {
        self.subapertures.iter_mut().for_each(|subaperture| subaperture.mid_time_ns += by_ns);
    }
}
