//! Board types of the simulated device, and their clocks.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Type of board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Board {
    /// XC120 with XE121: USB, ticks of 1 µs, up to five sensors. Served over TCP it stands for the
    /// server on a Raspberry Pi.
    Xc120,
    /// XE125 with XM125: a serial line of up to 2 Mbaud, ticks of 1 ms.
    Xm125,
    /// SparkFun's XM125: 115 200 baud only.
    Sparkfun,
}

impl Board {
    /// All types.
    pub const ALL: [Self; 3] = [Self::Xc120, Self::Xm125, Self::Sparkfun];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Xc120 => "xc120",
            Self::Xm125 => "xm125",
            Self::Sparkfun => "sparkfun",
        }
    }

    /// The type with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|board| board.name() == name)
    }

    /// Ticks of the clock per second.
    pub fn ticks_per_second(self) -> u32 {
        match self {
            Self::Xc120 => 1_000_000,
            Self::Xm125 | Self::Sparkfun => 1_000,
        }
    }

    /// Highest baud rate of the line; `None` if the line has no baud rate.
    pub fn max_baudrate(self) -> Option<u32> {
        match self {
            Self::Xc120 => None,
            Self::Xm125 => Some(2_000_000),
            Self::Sparkfun => Some(115_200),
        }
    }

    /// Number of sensor connectors.
    pub fn sensor_count(self) -> u32 {
        match self {
            Self::Xc120 => 5,
            Self::Xm125 | Self::Sparkfun => 1,
        }
    }

    /// Number of connected sensors, from the first connector on: two of an XC120, one of an XM125.
    pub fn connected(self) -> u32 {
        self.sensor_count().min(2)
    }

    /// Name in the system info.
    pub(super) fn hardware(self) -> &'static str {
        match self {
            Self::Xc120 => "xc120",
            Self::Xm125 | Self::Sparkfun => "xm125",
        }
    }
}

/// Largest drift of a board's crystal against the host's clock, as a fraction. Choice: two crystals
/// of 30 ppm.
const MAX_DRIFT: f64 = 60e-6;
/// Additional drift while the board is cold, as a fraction, and the time constant of warming up,
/// seconds. Choice: a crystal's few parts per million over some ten degrees, within a minute.
const WARM_UP_DRIFT: f64 = 5e-6;
const WARM_UP_S: f64 = 60.0;

/// A board's clock: ticks since power-on, from a crystal with drift.
#[derive(Debug, Clone)]
pub(super) struct BoardClock {
    boot_ns: i64,
    ticks_per_second: f64,
    drift: f64,
    offset_ticks: u64,
}

impl BoardClock {
    pub fn new(board: Board, seed: u64, boot_ns: i64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xC10C);
        Self {
            boot_ns,
            ticks_per_second: f64::from(board.ticks_per_second()),
            drift: rng.random_range(-MAX_DRIFT..MAX_DRIFT),
            offset_ticks: 0,
        }
    }

    /// Resets the counter, as power-cycling does.
    pub fn restart(&mut self, boot_ns: i64) {
        (self.boot_ns, self.offset_ticks) = (boot_ns, 0);
    }

    /// Advances the counter by a number of ticks.
    pub fn jump(&mut self, ticks: u32) {
        self.offset_ticks += u64::from(ticks);
    }

    /// Sets the counter so that it wraps this long after a host time.
    pub fn wrap_after(&mut self, now_ns: i64, after_s: f64) {
        let left = u32::MAX.wrapping_sub(self.tick(now_ns));
        self.jump(left.wrapping_sub((after_s * self.ticks_per_second) as u32));
    }

    /// Board time at a host time, seconds since power-on.
    pub fn board_s(&self, host_ns: i64) -> f64 {
        let host_s = host_ns.saturating_sub(self.boot_ns) as f64 * 1e-9;
        host_s * (1.0 + self.drift) + WARM_UP_DRIFT * WARM_UP_S * (1.0 - libm::exp(-host_s.max(0.0) / WARM_UP_S))
    }

    /// Host time at a board time, nanoseconds.
    pub fn host_ns(&self, board_s: f64) -> i64 {
        let ns = |s: f64| self.boot_ns.saturating_add((s * 1e9).round() as i64);
        // Both clocks run at nearly the same rate; each iteration leaves 10⁻⁴ of the error.
        let mut host_s = board_s;
        for _ in 0..4 {
            host_s += board_s - self.board_s(ns(host_s));
        }
        ns(host_s)
    }

    pub fn tick(&self, host_ns: i64) -> u32 {
        ((self.board_s(host_ns).max(0.0) * self.ticks_per_second) as u64).wrapping_add(self.offset_ticks) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_time_and_host_time_are_inverse() {
        for seed in 0..20 {
            let clock = BoardClock::new(Board::Xc120, seed, 7_000_000_000);
            for board_s in [0.0, 0.5, 30.0, 4000.0, 86_400.0] {
                assert!((clock.board_s(clock.host_ns(board_s)) - board_s).abs() < 2e-9 + 1e-15 * board_s);
            }
            let ticks = clock.tick(107_000_000_000) - clock.tick(7_000_000_000);
            assert!((f64::from(ticks) / 100e6 - 1.0).abs() < 66e-6, "{ticks}");
        }
    }

    #[test]
    fn tick_counter_wraps_when_requested() {
        for board in Board::ALL {
            let mut clock = BoardClock::new(board, 3, 0);
            clock.wrap_after(5_000_000_000, 2.0);
            let (before, after) = (clock.tick(6_990_000_000), clock.tick(7_010_000_000));
            assert!(before > u32::MAX - 20_000 && after < 20_000, "{before} {after}");
            assert_eq!(Board::from_name(board.name()), Some(board));
        }
    }
}
