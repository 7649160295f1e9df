//! The sensors of a board: measure results by the board's clock.

use num_complex::Complex;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::board::BoardClock;
use super::protocol::BoardSetup;
use super::stream::Measured;
use super::{FrameRequest, SampleSource, SentInfo};

/// Largest interrupt latency, nanoseconds. Choice: some microseconds of an interrupt on a
/// microcontroller; visible in ticks of 1 µs.
const LATENCY_NS: i64 = 8_000;

/// A result to measure.
pub(super) struct Request<'a> {
    pub setup: &'a BoardSetup,
    /// Index of the result since the start of streaming.
    pub index: u64,
    /// Start of the measurement, board seconds.
    pub start_s: f64,
    /// Whether that is later than requested.
    pub is_late: bool,
    /// Whether all samples hit the limit of the converter.
    pub saturates: bool,
    pub calibration_needed: bool,
}

/// Clock and samples of a board.
pub(super) struct Sensors {
    pub clock: BoardClock,
    source: Box<dyn SampleSource + Send>,
}

impl Sensors {
    pub fn new(clock: BoardClock, source: Box<dyn SampleSource + Send>) -> Self {
        Self { clock, source }
    }

    /// Measures a result. The samples are made at once, before the measurement ends.
    pub fn measure(&mut self, request: &Request, rng: &mut ChaCha8Rng) -> Measured {
        let &Request { setup, index, start_s, .. } = request;
        let temperature = 30 + libm::sin(start_s / 20.0).round() as i16;
        let (mut ends_ns, mut infos, mut samples) = (Vec::new(), Vec::new(), Vec::new());
        for (entry, end_s) in setup.ends_s() {
            let end_ns = self.clock.host_ns(start_s + end_s);
            let tick = self.clock.tick(end_ns + rng.random_range(0..LATENCY_NS));
            let first = samples.len();
            let frame = FrameRequest { sensor_id: entry.sensor_id, config: &entry.config, index, tick, end_ns };
            let mut data_saturated = self.source.frame(&frame, &mut samples);
            samples.resize(first + entry.config.points_per_frame(), Complex::default());
            if request.saturates {
                data_saturated = true;
                samples[first..].iter_mut().for_each(|s| *s = Complex::new(clamped(s.re), clamped(s.im)));
            }
            ends_ns.push(end_ns);
            infos.push(SentInfo {
                tick,
                data_saturated,
                temperature,
                calibration_needed: request.calibration_needed,
                frame_delayed: request.is_late,
            });
        }
        let end_ns = self.clock.host_ns(start_s + setup.timing.whole_s);
        Measured { start_s, end_ns, ends_ns, infos, samples }
    }
}

/// The converter's limit with the sign of the sample.
fn clamped(value: i16) -> i16 {
    if value < 0 { i16::MIN } else { i16::MAX }
}
