//! Predicts whether the line between board and host carries the frames of a configuration.
//!
//! A result is a JSON line of about 170 bytes, plus four bytes per point. Whether a board measures
//! the next frame while it still sends the last one is unknown, so there are two predictions:
//! sequential and pipelined. Known facts agree with sequential operation on the UART: the thesis'
//! configuration gives 8 frames per second at 115200 baud, and about 80 at 2 Mbaud, where the line
//! alone would carry 137.

use super::{SensorConfig, frame_timing};

/// Size of the JSON line before each payload, bytes, for one sensor. Source: the protocol's result
/// line with its five fields.
const HEADER_BYTES: f64 = 170.0;
/// Bytes per point.
const POINT_BYTES: f64 = 4.0;
/// Bits per byte on a UART. Source: 8N1 is a start bit, eight data bits and a stop bit.
const UART_BITS: f64 = 10.0;
/// Bulk throughput of full-speed USB, bytes per second. Choice: of 1.2 MB/s in theory (19 packets
/// of 64 bytes a millisecond) what remains beside the protocol and other devices.
const USB_BYTES_PER_S: f64 = 1.0e6;
/// Throughput of the slowest network of a Raspberry Pi, bytes per second. Physics: about nine
/// tenths of 100 Mbit/s, the rest are frames' headers and gaps.
const NETWORK_BYTES_PER_S: f64 = 11.0e6;

/// Type and speed of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineSpeed {
    /// A UART, with its baud rate.
    Uart(u32),
    /// The board's own USB, where the baud rate has no effect.
    Usb,
    /// A network socket.
    Network,
}

impl LineSpeed {
    /// Throughput, bytes per second.
    pub fn bytes_per_s(self) -> f64 {
        match self {
            Self::Uart(baud) => f64::from(baud) / UART_BITS,
            Self::Usb => USB_BYTES_PER_S,
            Self::Network => NETWORK_BYTES_PER_S,
        }
    }
}

impl std::fmt::Display for LineSpeed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Uart(baud) => write!(f, "{baud} baud"),
            Self::Usb => f.write_str("USB"),
            Self::Network => f.write_str("network"),
        }
    }
}

/// Whether a link carries a configuration's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkCapacity {
    /// Yes, in either case.
    Yes,
    /// Only if the board measures while it sends.
    IfPipelined,
    /// No.
    No,
}

/// What a configuration requires of sensor and link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkRequirement {
    /// Duration of a sweep, seconds.
    pub sweep_s: f64,
    /// Requested frame rate, Hz; `None`: as fast as possible.
    pub requested_hz: Option<f64>,
    /// Highest frame rate of the sensor with this configuration, Hz.
    pub max_frame_hz: f64,
    /// Frame rate of the sensor: the requested one, limited by the sensor, Hz.
    pub frame_hz: f64,
    /// Sweeps per second at that rate.
    pub sweeps_hz: f64,
    /// Size of a frame on the line, bytes.
    pub frame_bytes: f64,
}

/// Prediction for a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPrediction {
    /// Whether it carries the sensor's rate.
    pub capacity: LinkCapacity,
    /// Frame rate if the board measures and sends one after the other, Hz.
    pub sequential_hz: f64,
    /// Frame rate if it measures while it sends, Hz.
    pub pipelined_hz: f64,
    /// Share of the link's throughput at the sensor's rate.
    pub load: f64,
}

impl LinkRequirement {
    /// The requirement of a valid configuration.
    pub fn of(config: &SensorConfig) -> Self {
        let timing = frame_timing(config);
        let fastest = frame_timing(&SensorConfig { frame_rate: None, ..config.clone() });
        let frame_hz = 1.0 / timing.frame_period_s;
        Self {
            sweep_s: timing.sweep_s,
            requested_hz: config.frame_rate,
            max_frame_hz: 1.0 / fastest.frame_period_s,
            frame_hz,
            sweeps_hz: frame_hz * f64::from(config.sweeps_per_frame),
            frame_bytes: HEADER_BYTES + POINT_BYTES * config.points_per_frame() as f64,
        }
    }

    /// Bytes per second at the sensor's rate.
    pub fn bytes_per_s(&self) -> f64 {
        self.frame_bytes * self.frame_hz
    }

    /// Whether the sensor reaches the requested rate.
    pub fn is_rate_reachable(&self) -> bool {
        self.requested_hz.is_none_or(|asked| asked <= self.max_frame_hz * (1.0 + 1e-9))
    }

    /// Predicts the frame rate over a link.
    pub fn predict(&self, line: LineSpeed) -> LinkPrediction {
        let transfer_s = self.frame_bytes / line.bytes_per_s();
        // USB and sockets have their own processor, so measuring does not wait for them.
        let sequential_s =
            if let LineSpeed::Uart(_) = line { transfer_s + 1.0 / self.max_frame_hz } else { transfer_s };
        let (sequential_hz, pipelined_hz) =
            (self.frame_hz.min(1.0 / sequential_s), self.frame_hz.min(1.0 / transfer_s));
        let capacity = match (sequential_hz >= self.frame_hz, pipelined_hz >= self.frame_hz) {
            (true, _) => LinkCapacity::Yes,
            (false, true) => LinkCapacity::IfPipelined,
            (false, false) => LinkCapacity::No,
        };
        LinkPrediction { capacity, sequential_hz, pipelined_hz, load: transfer_s * self.frame_hz }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PRESETS, preset};
    use super::*;

    fn need(name: &str) -> LinkRequirement {
        LinkRequirement::of(&preset(name).unwrap())
    }

    #[test]
    fn thesis_preset_matches_measured_frame_rates() {
        let thesis = need("thesis");
        assert!((thesis.sweep_s - 5.68e-3).abs() < 0.02e-3);
        assert_eq!(thesis.frame_bytes, 1454.0);
        // 1.74 Mbit/s on a UART; 8 frames per second at 115200 baud, about 80 at 2 Mbaud.
        assert!((thesis.bytes_per_s() * UART_BITS / 1e6 - 1.745).abs() < 0.005);
        let slow = thesis.predict(LineSpeed::Uart(115_200));
        assert!((slow.sequential_hz - 7.6).abs() < 0.1 && slow.capacity == LinkCapacity::No, "{slow:?}");
        let fast = thesis.predict(LineSpeed::Uart(2_000_000));
        assert!((fast.sequential_hz - 77.0).abs() < 1.0 && fast.capacity == LinkCapacity::IfPipelined, "{fast:?}");
        assert_eq!(thesis.predict(LineSpeed::Usb).capacity, LinkCapacity::Yes);
    }

    #[test]
    fn default_presets_fit_their_links() {
        assert_eq!(need("d16").predict(LineSpeed::Usb).capacity, LinkCapacity::Yes);
        assert_eq!(need("d16").predict(LineSpeed::Network).capacity, LinkCapacity::Yes);
        assert_eq!(need("d16").predict(LineSpeed::Uart(2_000_000)).capacity, LinkCapacity::No);
        // 92 % of the line: 360 frames per second if sequential, 500 if pipelined.
        let c16 = need("c16").predict(LineSpeed::Uart(2_000_000));
        assert!(c16.capacity == LinkCapacity::IfPipelined && (c16.load - 0.925).abs() < 0.001, "{c16:?}");
        assert!((c16.sequential_hz - 360.0).abs() < 1.0, "{c16:?}");
        assert_eq!(need("slow-link").predict(LineSpeed::Uart(115_200)).capacity, LinkCapacity::Yes);
        assert_eq!(need("c16").predict(LineSpeed::Uart(115_200)).capacity, LinkCapacity::No);
    }

    #[test]
    fn every_preset_reaches_its_rate_over_usb() {
        for name in PRESETS {
            let need = need(name);
            assert!(need.is_rate_reachable(), "{name}: {need:?}");
            assert_eq!(need.predict(LineSpeed::Usb).capacity, LinkCapacity::Yes, "{name}");
        }
    }

    #[test]
    fn unreachable_rate_is_reported() {
        let config = SensorConfig { frame_rate: Some(1e4), ..preset("thesis").unwrap() };
        let need = LinkRequirement::of(&config);
        assert!(!need.is_rate_reachable() && need.frame_hz == need.max_frame_hz && need.frame_hz < 180.0);
        let config = SensorConfig { frame_rate: None, ..config };
        assert!(LinkRequirement::of(&config).is_rate_reachable());
    }
}
