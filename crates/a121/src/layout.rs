//! Expected layout of a result, known from the set-up. Headers are checked against it and never
//! trusted.

use num_complex::Complex;

use super::{ResultInfo, Setup, SetupReply};

/// Bytes of a sample, a protocol's point: i16 real, i16 imaginary, little-endian.
const SAMPLE_BYTES: usize = 4;

/// Layout of the results of one set-up.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultLayout {
    /// Samples of a frame, `[group][sensor]`.
    samples: Vec<Vec<usize>>,
}

impl ResultLayout {
    /// The layout of a valid set-up.
    pub fn of(setup: &Setup) -> Self {
        let frames = |group: &Vec<super::SensorSetup>| group.iter().map(|s| s.config.points_per_frame()).collect();
        Self { samples: setup.groups.iter().map(frames).collect() }
    }

    /// Bytes of a payload.
    pub fn payload_bytes(&self) -> usize {
        self.samples.iter().flatten().sum::<usize>() * SAMPLE_BYTES
    }

    /// Whether the server's reply to the set-up has the same layout.
    pub fn agrees_with(&self, reply: &SetupReply) -> bool {
        let said = reply.metadata.iter().map(|group| group.iter().map(|sensor| sensor.frame_data_length));
        self.samples.len() == reply.metadata.len()
            && self.samples.iter().zip(said).all(|(ours, theirs)| ours.iter().map(|&n| n as u64).eq(theirs))
    }

    /// Whether a header matches this layout.
    pub(super) fn fits(&self, info: &[Vec<ResultInfo>], payload_bytes: u64) -> bool {
        payload_bytes == self.payload_bytes() as u64
            && self.samples.len() == info.len()
            && self.samples.iter().zip(info).all(|(samples, info)| samples.len() == info.len())
    }

    /// Splits a payload of [`Self::payload_bytes`] into frames, by group, then by sensor.
    pub(super) fn split(&self, payload: &[u8]) -> Vec<Vec<Complex<i16>>> {
        let mut rest = payload;
        let frames = self.samples.iter().flatten().map(|&samples| {
            let (frame, later) = rest.split_at((samples * SAMPLE_BYTES).min(rest.len()));
            rest = later;
            let (samples, _) = frame.as_chunks::<SAMPLE_BYTES>();
            samples.iter().map(|&sample| sample_from_le_bytes(sample)).collect()
        });
        frames.collect()
    }
}

/// A sample as it is sent and stored.
pub(crate) fn sample_from_le_bytes([a, b, c, d]: [u8; SAMPLE_BYTES]) -> Complex<i16> {
    Complex::new(i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset;

    #[test]
    fn payloads_are_split_group_by_group() {
        let mut setup = Setup::single(1, preset("d16").unwrap());
        let mut short = setup.groups[0][0].clone();
        (short.config.sweeps_per_frame, short.config.subsweeps[0].num_points) = (1, 2);
        setup.groups.push(vec![short]);
        let layout = ResultLayout::of(&setup);
        assert_eq!(layout.payload_bytes(), 802 * 4);
        let payload: Vec<u8> = (0..802i16).flat_map(|n| [n.to_le_bytes(), (-n).to_le_bytes()].concat()).collect();
        let frames = layout.split(&payload);
        assert_eq!((frames[0].len(), frames[1].len()), (800, 2));
        assert_eq!((frames[0][799], frames[1][0]), (Complex::new(799, -799), Complex::new(800, -800)));
    }
}
