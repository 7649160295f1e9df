//! A board's clock and a late reader, for the tests of [`super::Clock`] and the study of it (`examples/a121_clock.rs`).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How results come to the reader.
#[derive(Clone, Copy, PartialEq)]
pub enum ArrivalPattern {
    /// 1 ms polls, and one time in ten a stall of 30 ms.
    Stalls,
    /// All bytes in bursts, one every 30 ms give or take a tenth.
    Bursts,
}

/// Truth and arrival of frames: 40 ppm of drift that creeps as a board warms up, frames regular to 10 µs.
pub struct SimulatedClock {
    rng: ChaCha8Rng,
    pub frame_rate: f64,
    pub ticks_per_second: f64,
    reader: ArrivalPattern,
    next_read_s: f64,
    stalled_until_s: f64,
}

/// Time that a result's bytes take on the line, seconds; the clock is told.
pub const TRANSFER_S: f64 = 3e-4;

impl SimulatedClock {
    pub fn new(seed: u64, frame_rate: f64, ticks_per_second: f64, reader: ArrivalPattern) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        Self { rng, frame_rate, ticks_per_second, reader, next_read_s: 0.0, stalled_until_s: 0.0 }
    }

    /// End of frame k, its tick, its arrival.
    pub fn frame(&mut self, k: u64) -> (f64, i64, f64) {
        let phase = 0.377 / self.frame_rate;
        let end_s = 5.0 + phase + k as f64 / self.frame_rate + self.rng.random_range(-1e-5..1e-5);
        let warming = 5e-6 * 60.0 * (1.0 - (-end_s / 60.0).exp());
        let board_s = 100.0 + end_s * (1.0 - 40e-6) + warming;
        // Time on the line, then the board's and the bus' own.
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
