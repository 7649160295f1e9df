//! Simulates a board's clock and a late reader, for the tests of [`super::Clock`] and for
//! `examples/a121_clock.rs`.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Pattern in which results arrive at the reader.
#[derive(Clone, Copy, PartialEq)]
pub enum ArrivalPattern {
    /// Polling every 1 ms, and in one case of ten a stall of up to 30 ms.
    Stalls,
    /// All bytes arrive in bursts, every 27 to 33 ms.
    Bursts,
}

/// True end times and arrivals of frames. The board's clock drifts by 40 ppm, less while it warms
/// up; frames have 10 µs of jitter.
pub struct SimulatedClock {
    rng: ChaCha8Rng,
    pub frame_rate: f64,
    pub ticks_per_second: f64,
    reader: ArrivalPattern,
    next_read_s: f64,
    stalled_until_s: f64,
}

/// Transfer time of a result on the line, seconds; given to the clock under test. Choice: 300 bytes
/// at a megabyte a second.
pub const TRANSFER_S: f64 = 3e-4;

impl SimulatedClock {
    pub fn new(seed: u64, frame_rate: f64, ticks_per_second: f64, reader: ArrivalPattern) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Self { rng, frame_rate, ticks_per_second, reader, next_read_s: 0.0, stalled_until_s: 0.0 }
    }

    /// Returns the true end of frame `k` (s), its tick and its arrival (s).
    pub fn frame(&mut self, k: u64) -> (f64, i64, f64) {
        let phase = 0.377 / self.frame_rate;
        let end_s = 5.0 + phase + k as f64 / self.frame_rate + self.rng.random_range(-1e-5..1e-5);
        let warming = 5e-6 * 60.0 * (1.0 - (-end_s / 60.0).exp());
        let board_s = 100.0 + end_s * (1.0 - 40e-6) + warming;
        // Transfer time, then the delay of the board and the bus.
        let ready_s = end_s + TRANSFER_S - 1e-4 * (1.0 - self.rng.random_range(0.0f64..1.0)).ln();
        (end_s, (board_s * self.ticks_per_second) as i64, self.read(ready_s))
    }

    fn read(&mut self, ready_s: f64) -> f64 {
        if self.reader == ArrivalPattern::Bursts {
            while self.next_read_s < ready_s {
                self.next_read_s += self.rng.random_range(0.027..0.033);
            }
            return self.next_read_s;
        }
        if ready_s > self.stalled_until_s && self.rng.random_bool(0.1) {
            self.stalled_until_s = ready_s + 0.03 * self.rng.random_range(0.0..1.0);
        }
        (ready_s + self.rng.random_range(0.0..1e-3)).max(self.stalled_until_s)
    }
}
