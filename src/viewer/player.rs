//! The player: position in the recording, and playback. It has no clock: the caller passes the
//! elapsed time.

/// Slowest and fastest playback, times real time. Choice: a single update lasts 2.5 s; a minute
/// passes in 8 s.
pub const SPEEDS: [f64; 2] = [0.1, 8.0];
/// A press of + or − changes the speed by this factor. Choice: two presses double it.
const SPEED_STEP: f64 = std::f64::consts::SQRT_2;

/// Position in the recording. Times are seconds from its beginning.
#[derive(Debug, Clone, PartialEq)]
pub struct Player {
    time_s: f64,
    speed: f64,
    is_playing: bool,
    is_looping: bool,
    /// Whether the data arrives live, and whether the newest data is shown.
    is_live: bool,
    is_at_edge: bool,
    /// Requested position that is not processed yet.
    awaited_s: Option<f64>,
}

/// Duration of the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Processed so far, seconds.
    pub buffered_s: f64,
    /// In total, seconds. Equals the buffered duration once everything is processed.
    pub duration_s: f64,
    /// Whether everything is processed.
    pub is_complete: bool,
}

impl Default for Player {
    fn default() -> Self {
        Self {
            time_s: 0.0,
            speed: 1.0,
            is_playing: true,
            is_looping: false,
            is_live: false,
            is_at_edge: false,
            awaited_s: None,
        }
    }
}

impl Player {
    /// For live data: follows the newest data until the user seeks back or pauses.
    pub fn live() -> Self {
        Self { is_live: true, is_at_edge: true, ..Self::default() }
    }

    /// Whether the data arrives live.
    pub fn is_live(&self) -> bool {
        self.is_live
    }

    /// Whether the newest data is followed.
    pub fn is_at_edge(&self) -> bool {
        self.is_at_edge
    }

    /// The displayed time.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Requested position that is not processed yet.
    pub fn awaited_s(&self) -> Option<f64> {
        self.awaited_s
    }

    /// Playback speed, times real time.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Whether playback is running.
    pub fn is_playing(&self) -> bool {
        self.is_playing
    }

    /// Whether playback restarts at the end.
    pub fn is_looping(&self) -> bool {
        self.is_looping
    }

    /// Plays or pauses. At the end, playback restarts.
    pub fn toggle(&mut self, extent: &Extent) {
        self.is_playing = !self.is_playing;
        self.is_at_edge = false;
        if self.is_playing && extent.is_complete && self.time_s >= extent.duration_s {
            self.seek(0.0, extent);
        }
    }

    /// Pauses.
    pub fn pause(&mut self) {
        (self.is_playing, self.is_at_edge) = (false, false);
    }

    /// Sets whether playback restarts at the end.
    pub fn set_looping(&mut self, looping: bool) {
        self.is_looping = looping;
    }

    /// Sets the speed, times real time, limited to [`SPEEDS`]. Non-finite values are ignored.
    pub fn set_speed(&mut self, speed: f64) {
        if speed.is_finite() {
            self.speed = speed.clamp(SPEEDS[0], SPEEDS[1]);
        }
    }

    /// One step faster (+1) or slower (−1). Speed 1 is never skipped.
    pub fn change_speed(&mut self, steps: i32) {
        let before = self.speed;
        self.set_speed(before * SPEED_STEP.powi(steps));
        if (before - 1.0) * (self.speed - 1.0) < 0.0 || (self.speed - 1.0).abs() < 0.02 {
            self.speed = 1.0;
        }
    }

    /// Seeks to a time. If it is not processed yet, the newest data is shown until then.
    pub fn seek(&mut self, time_s: f64, extent: &Extent) {
        let wanted_s = if time_s.is_finite() { time_s.clamp(0.0, extent.duration_s.max(0.0)) } else { self.time_s };
        self.time_s = wanted_s.min(extent.buffered_s);
        self.awaited_s = (wanted_s > extent.buffered_s && !extent.is_complete).then_some(wanted_s);
        self.reach_edge(extent);
    }

    /// At the newest live data, follow mode is enabled.
    fn reach_edge(&mut self, extent: &Extent) {
        self.is_at_edge = self.is_live && !extent.is_complete && self.time_s >= extent.buffered_s;
        self.is_playing |= self.is_at_edge;
    }

    /// Advances by `passed_s` seconds of real time. Returns whether the display changes.
    pub fn advance(&mut self, passed_s: f64, extent: &Extent) -> bool {
        let before = (self.time_s, self.awaited_s);
        if self.is_at_edge && !extent.is_complete {
            self.time_s = extent.buffered_s;
        } else if let Some(awaited_s) = self.awaited_s {
            self.seek(awaited_s, extent);
        } else if self.is_playing && passed_s > 0.0 {
            self.play(passed_s, extent);
        }
        before != (self.time_s, self.awaited_s)
    }

    fn play(&mut self, passed_s: f64, extent: &Extent) {
        let next_s = self.time_s + passed_s * self.speed;
        if !(extent.is_complete && next_s >= extent.duration_s) {
            // Not beyond the processed part.
            self.time_s = next_s.min(extent.buffered_s).max(self.time_s.min(extent.buffered_s));
            self.reach_edge(extent);
        } else if self.is_looping && extent.duration_s > 0.0 {
            self.time_s = next_s % extent.duration_s;
        } else {
            (self.time_s, self.is_playing) = (extent.duration_s, false);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Extent = Extent { buffered_s: 10.0, duration_s: 10.0, is_complete: true };
    const HALF: Extent = Extent { buffered_s: 5.0, duration_s: 10.0, is_complete: false };

    #[test]
    fn playback_runs_at_speed_and_stops_at_the_end() {
        let mut player = Player::default();
        player.set_speed(2.0);
        assert!(player.advance(1.5, &ALL));
        assert_eq!(player.time_s(), 3.0);
        player.toggle(&ALL);
        assert!(!player.advance(1.0, &ALL) && player.time_s() == 3.0, "paused");
        player.toggle(&ALL);
        player.advance(100.0, &ALL);
        assert_eq!((player.time_s(), player.is_playing()), (10.0, false));
        player.toggle(&ALL);
        assert_eq!((player.time_s(), player.is_playing()), (0.0, true), "from the beginning again");
    }

    #[test]
    fn live_playback_follows_the_newest_until_seek() {
        let grown = |buffered_s| Extent { buffered_s, duration_s: buffered_s, is_complete: false };
        let mut player = Player::live();
        assert!(player.advance(0.1, &grown(7.0)) && player.time_s() == 7.0 && player.is_at_edge());
        player.seek(2.0, &grown(7.0));
        assert!(player.advance(1.0, &grown(8.0)) && player.time_s() == 3.0 && !player.is_at_edge());
        player.seek(8.0, &grown(8.0));
        player.advance(0.1, &grown(9.5));
        assert_eq!((player.time_s(), player.is_at_edge()), (9.5, true));
        player.pause();
        player.advance(0.1, &grown(10.0));
        assert_eq!((player.time_s(), player.is_at_edge()), (9.5, false));
        player.toggle(&grown(10.0));
        player.set_speed(4.0);
        player.advance(1.0, &grown(10.5));
        assert!(player.is_at_edge(), "it has caught up");
        player.advance(0.1, &Extent { buffered_s: 10.5, duration_s: 10.5, is_complete: true });
        assert_eq!((player.time_s(), player.is_playing()), (10.5, false), "it is over");
    }

    #[test]
    fn looping_preserves_overshoot() {
        let mut player = Player::default();
        player.set_looping(true);
        player.advance(9.5, &ALL);
        player.advance(1.0, &ALL);
        assert!((player.time_s() - 0.5).abs() < 1e-12 && player.is_playing());
        player.set_looping(false);
        player.advance(20.0, &ALL);
        assert_eq!(player.time_s(), 10.0);
    }

    #[test]
    fn playback_waits_for_processing() {
        let mut player = Player::default();
        player.advance(7.0, &HALF);
        assert_eq!((player.time_s(), player.is_playing()), (5.0, true), "it waits and goes on");
        player.advance(0.5, &Extent { buffered_s: 6.0, ..HALF });
        assert_eq!(player.time_s(), 5.5);
    }

    #[test]
    fn seek_beyond_buffer_is_deferred() {
        let mut player = Player::default();
        player.pause();
        player.seek(8.0, &HALF);
        assert_eq!((player.time_s(), player.awaited_s()), (5.0, Some(8.0)));
        assert!(player.advance(0.0, &Extent { buffered_s: 7.0, ..HALF }));
        assert_eq!((player.time_s(), player.awaited_s()), (7.0, Some(8.0)));
        player.advance(0.0, &ALL);
        assert_eq!((player.time_s(), player.awaited_s(), player.is_playing()), (8.0, None, false));
        player.seek(-3.0, &ALL);
        assert_eq!(player.time_s(), 0.0);
        player.seek(99.0, &ALL);
        assert_eq!(player.time_s(), 10.0);
        player.seek(f64::NAN, &ALL);
        assert_eq!(player.time_s(), 10.0);
    }

    #[test]
    fn short_recordings_end_early() {
        let mut player = Player::default();
        player.pause();
        player.seek(9.0, &HALF);
        player.advance(0.0, &Extent { buffered_s: 6.0, duration_s: 6.0, is_complete: true });
        assert_eq!((player.time_s(), player.awaited_s()), (6.0, None));
    }

    #[test]
    fn speed_steps_are_bounded_and_return_to_one() {
        let mut player = Player::default();
        for steps in [1, -1] {
            (0..40).for_each(|_| player.change_speed(steps));
            assert_eq!(player.speed(), if steps > 0 { 8.0 } else { 0.1 });
        }
        (0..40).for_each(|_| {
            if player.speed() < 1.0 {
                player.change_speed(1);
            }
        });
        assert_eq!(player.speed(), 1.0);
        player.set_speed(f64::NAN);
        assert_eq!(player.speed(), 1.0);
    }

    #[test]
    fn empty_recording_does_not_panic() {
        let none = Extent { buffered_s: 0.0, duration_s: 0.0, is_complete: true };
        let mut player = Player::default();
        player.set_looping(true);
        player.advance(1.0, &none);
        player.seek(5.0, &none);
        assert_eq!(player.time_s(), 0.0);
    }
}
