//! What a configuration asks of the line between board and host, before anything is connected.
//!
//! A result is a line of JSON of some 170 bytes and four bytes a point. What is not known of a board is whether it
//! measures the next frame while it still sends the last one, so two rates are told: with one after the other, and
//! with both at once. The facts at hand agree with one after the other on the UART: the thesis' configuration gives 8
//! frames a second at 115200 baud, and about 80 at 2 Mbaud where the line alone would carry 137.

use super::{SensorConfig, frame_timing};

/// Bytes of the line before each payload, for one sensor.
const HEADER_BYTES: f64 = 170.0;
/// Bytes of a point.
const POINT_BYTES: f64 = 4.0;
/// Bits that a byte takes on a UART: start, eight, stop.
const UART_BITS: f64 = 10.0;
/// What full-speed USB carries in bulk, bytes a second: some 1.2 MB/s in theory, this much in practice.
const USB_BYTES_PER_S: f64 = 1.0e6;
/// What the slowest network of a Raspberry Pi carries, bytes a second: 100 Mbit/s, of which some nine tenths.
const NETWORK_BYTES_PER_S: f64 = 11.0e6;

/// What carries the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineSpeed {
    /// A UART, bits a second.
    Uart(u32),
    /// The board's own USB: its baud rate is a name.
    Usb,
    /// A socket.
    Network,
}

impl LineSpeed {
    /// Bytes a second that it carries.
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

/// Whether a line carries a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkCapacity {
    /// Whatever the board does meanwhile.
    Yes,
    /// Only if the board measures while it sends.
    IfPipelined,
    /// Never.
    No,
}

/// What a configuration needs of one sensor and its line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkRequirement {
    /// Time that one sweep takes, seconds.
    pub sweep_s: f64,
    /// Frames a second that were asked for; `None`: as fast as it goes.
    pub requested_hz: Option<f64>,
    /// Frames a second that the sensor reaches, whatever was asked for.
    pub max_frame_hz: f64,
    /// Frames a second of the sensor: what was asked for, or as fast as it goes.
    pub frame_hz: f64,
    /// Sweeps a second at that rate.
    pub sweeps_hz: f64,
    /// Bytes of a frame on the line.
    pub frame_bytes: f64,
}

/// What a line makes of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkPrediction {
    /// Whether it carries the sensor's rate.
    pub capacity: LinkCapacity,
    /// Frames a second if the board measures and sends one after the other.
    pub sequential_hz: f64,
    /// Frames a second if it measures while it sends.
    pub pipelined_hz: f64,
    /// Part of the line's time that the sensor's rate would take.
    pub load: f64,
}

impl LinkRequirement {
    /// Of a sound configuration.
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

    /// Bytes a second at the sensor's rate.
    pub fn bytes_per_s(&self) -> f64 {
        self.frame_bytes * self.frame_hz
    }

    /// Whether the sensor reaches what was asked of it.
    pub fn is_rate_reachable(&self) -> bool {
        self.requested_hz.is_none_or(|asked| asked <= self.max_frame_hz * (1.0 + 1e-9))
    }

    /// What a line makes of it.
    pub fn predict(&self, line: LineSpeed) -> LinkPrediction {
        let transfer_s = self.frame_bytes / line.bytes_per_s();
        // USB and sockets have a processor of their own: nothing waits for them.
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
        // 1.74 Mbit/s on a UART; 8 frames a second at 115200 baud, about 80 at 2 Mbaud.
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
        // 92 % of the line: whether the board measures while it sends decides between 360 and 500 a second.
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
