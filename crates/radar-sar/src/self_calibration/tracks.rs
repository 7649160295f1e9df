//! Links echoes over time into tracks.

use glam::DVec3;

use super::echoes::Echo;
use crate::geometry::Pose;

/// A track without an echo for this long ends, nanoseconds. Choice: five groups of 8 ms; after
/// longer pauses another echo may lie at the prediction.
const MAX_PAUSE_NS: i64 = 40_000_000;
/// A track ends at this length, to bound the work on it, nanoseconds. Choice: a few movements of
/// the head, and 600 echoes.
const MAX_SPAN_NS: i64 = 5_000_000_000;
/// An echo belongs to a track if it lies within this of the prediction: metres, plus metres per
/// second since the last echo. Choice: range noise and a change of speed; echoes in the gate are
/// less than a pulse apart and do not both exist.
const GATE_M: f64 = 0.02;
const GATE_M_PER_S: f64 = 0.8;
/// Weight of a new echo in the track's speed. Choice: a mean of a dozen echoes, 0.1 s, as ranges of
/// single groups are noisy.
const SPEED_GAIN: f64 = 0.15;
/// Greatest range rate, m/s. Choice: heads move at up to 2.5 m/s (thesis, 3.5); faster tracks jump
/// between echoes.
const MAX_SPEED_M_PER_S: f64 = 3.0;
/// Greatest number of open tracks. Choice: bounds the work; a sweep of 3 m holds about as many
/// distinct echoes.
const MAX_OPEN: usize = 24;

/// The echoes of one object while it was followed.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub echoes: Vec<Echo>,
    /// Sum of the sensor's boresights, an estimate of the object's direction.
    pub forward: DVec3,
    speed_m_per_s: f64,
}

impl Track {
    fn new(echo: Echo) -> Self {
        Self { echoes: vec![echo], forward: DVec3::ZERO, speed_m_per_s: 0.0 }
    }

    pub fn first_ns(&self) -> i64 {
        self.echoes.first().map_or(0, |e| e.time_ns)
    }

    pub fn last_ns(&self) -> i64 {
        self.echoes.last().map_or(0, |e| e.time_ns)
    }

    /// Distance of an echo from the track's prediction, if it may belong to the track.
    fn distance_m(&self, echo: &Echo) -> Option<f64> {
        let last = self.echoes.last()?;
        let pause_s = (echo.time_ns - last.time_ns) as f64 * 1e-9;
        let off_m = (echo.range_m - last.range_m - self.speed_m_per_s * pause_s).abs();
        (pause_s > 0.0 && off_m <= GATE_M + GATE_M_PER_S * pause_s).then_some(off_m)
    }

    fn push(&mut self, echo: Echo) {
        if let Some(last) = self.echoes.last() {
            let speed = (echo.range_m - last.range_m) / ((echo.time_ns - last.time_ns) as f64 * 1e-9);
            self.speed_m_per_s += SPEED_GAIN * (speed - self.speed_m_per_s);
            self.speed_m_per_s = self.speed_m_per_s.clamp(-MAX_SPEED_M_PER_S, MAX_SPEED_M_PER_S);
        }
        self.echoes.push(echo);
    }
}

/// Links the echoes of one subsweep.
#[derive(Debug, Default)]
pub(super) struct Tracks {
    open: Vec<Track>,
}

impl Tracks {
    /// Adds the echoes of one time; returns the tracks that ended.
    pub fn push(&mut self, echoes: &[Echo], now_ns: i64, sensor: &Pose) -> Vec<Track> {
        let mut free: Vec<Echo> = echoes.to_vec();
        // Tracks choose in order of age, the oldest first, so that a new track cannot take an older
        // one's echo.
        for track in &mut self.open {
            let distances = free.iter().enumerate().filter_map(|(n, e)| Some((n, track.distance_m(e)?)));
            if let Some((nearest, _)) = distances.min_by(|a, b| a.1.total_cmp(&b.1)) {
                track.push(free.remove(nearest));
                track.forward += sensor.forward();
            }
        }
        let ended = |t: &mut Track| now_ns - t.last_ns() > MAX_PAUSE_NS || t.last_ns() - t.first_ns() >= MAX_SPAN_NS;
        let done = self.open.extract_if(.., ended).collect();
        let room = MAX_OPEN.saturating_sub(self.open.len());
        self.open.extend(free.into_iter().take(room).map(Track::new));
        done
    }

    /// Tracks that have not ended.
    pub fn open(&self) -> &[Track] {
        &self.open
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn echo(step: i64, range_m: f64) -> Echo {
        let time_ns = step * 8_000_000;
        Echo { time_ns, range_m, variance_m2: 1e-6, phase_rad: 0.0, phase_time_ns: time_ns, ln_amplitude: 0.0 }
    }

    #[test]
    fn crossing_ranges_are_followed_through_and_pauses_end_tracks() {
        let mut tracks = Tracks::default();
        let mut done = Vec::new();
        for step in 0..100 {
            let t = step as f64 * 0.008;
            // Two objects cross in range; close to each other, one of them is not seen.
            let (a, b) = (1.0 + t, 1.9 - t);
            let echoes = if (a - b).abs() < 0.02 { vec![echo(step, a)] } else { vec![echo(step, a), echo(step, b)] };
            done.extend(tracks.push(&echoes, step * 8_000_000, &Pose::IDENTITY));
        }
        assert!(done.is_empty());
        let ends: Vec<f64> = tracks.open().iter().map(|t| t.echoes[t.echoes.len() - 1].range_m).collect();
        assert!(ends.len() == 2 && (ends[0] - 1.792).abs() < 1e-9 && (ends[1] - 1.108).abs() < 1e-9, "{ends:?}");
        let done = tracks.push(&[], 99 * 8_000_000 + MAX_PAUSE_NS + 1, &Pose::IDENTITY);
        assert!(done.len() == 2 && tracks.open().is_empty());
    }

    #[test]
    fn tracks_are_bounded() {
        let mut tracks = Tracks::default();
        let many: Vec<Echo> = (0..100).map(|n| echo(0, 0.2 + 0.2 * f64::from(n))).collect();
        tracks.push(&many, 0, &Pose::IDENTITY);
        assert_eq!(tracks.open().len(), MAX_OPEN);
    }
}
