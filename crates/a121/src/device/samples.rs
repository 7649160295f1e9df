//! Source of the samples of a simulated board.

use num_complex::Complex;

use crate::SensorConfig;

/// Request for a frame.
#[derive(Debug, Clone, Copy)]
pub struct FrameRequest<'a> {
    /// Sensor on the board, from 1.
    pub sensor_id: u32,
    /// Its configuration.
    pub config: &'a SensorConfig,
    /// Index of the frame since the start of streaming.
    pub index: u64,
    /// Tick sent with it.
    pub tick: u32,
    /// End of its measurement, host nanoseconds.
    pub end_ns: i64,
}

/// Source of samples.
pub trait SampleSource {
    /// Appends the frame's samples, `[sweep][point]`, as many as the configuration has; returns
    /// whether a sample hit the limit of the converter.
    fn frame(&mut self, request: &FrameRequest, samples: &mut Vec<Complex<i16>>) -> bool;
}

/// Noise seeded by sensor and tick. It is cheap, all byte values are equally likely, and samples
/// under a wrong tick are recognised.
#[derive(Debug, Clone, Copy, Default)]
pub struct TickSeededNoise;

impl SampleSource for TickSeededNoise {
    fn frame(&mut self, request: &FrameRequest, samples: &mut Vec<Complex<i16>>) -> bool {
        // SplitMix64.
        let mut state = u64::from(request.tick) << 8 | u64::from(request.sensor_id);
        samples.extend((0..request.config.points_per_frame()).map(|_| {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut word = state;
            word = (word ^ (word >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            word ^= word >> 31;
            Complex::new(word as i16, (word >> 16) as i16)
        }));
        false
    }
}
