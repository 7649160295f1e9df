//! Configuration of the sensor, with the names of the exploration protocol and the vendor's
//! defaults.

use serde::{Deserialize, Serialize};

use super::{BASE_STEP_M, Prf, Profile};

/// Idle state of the sensor while it waits; a deeper one takes longer to wake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IdleState {
    /// Awake.
    #[serde(alias = "READY")]
    Ready,
    /// 55 µs to wake.
    #[serde(alias = "SLEEP")]
    Sleep,
    /// 670 µs to wake.
    #[serde(alias = "DEEP_SLEEP")]
    DeepSleep,
}

/// A range of points measured together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Subsweep {
    /// First point, in base steps of 2.5 mm; may be negative, before the antenna.
    pub start_point: i32,
    /// Number of points.
    pub num_points: u32,
    /// Base steps between points; a divisor or a multiple of 24.
    pub step_length: u32,
    /// Pulse length.
    pub profile: Profile,
    /// Hardware-accelerated averages per point (HWAAS), 1 to 511.
    pub hwaas: u32,
    /// Receiver gain, 0 to 23.
    pub receiver_gain: u32,
    /// Whether the transmitter is on.
    pub enable_tx: bool,
    /// Whether the chip's transmitter is looped back to its receiver.
    pub enable_loopback: bool,
    /// Flattens the phase over a pulse; imaging needs it on.
    pub phase_enhancement: bool,
    /// Compensates imbalance between the in-phase and quadrature channels.
    pub iq_imbalance_compensation: bool,
    /// Pulse repetition frequency.
    pub prf: Prf,
}

impl Default for Subsweep {
    fn default() -> Self {
        Self {
            start_point: 80,
            num_points: 160,
            step_length: 1,
            profile: Profile::P3,
            hwaas: 8,
            receiver_gain: 16,
            enable_tx: true,
            enable_loopback: false,
            phase_enhancement: false,
            iq_imbalance_compensation: false,
            prf: Prf::Mhz15_6,
        }
    }
}

impl Subsweep {
    /// Range of the first point, metres; may be negative.
    pub fn first_m(&self) -> f64 {
        f64::from(self.start_point) * BASE_STEP_M
    }

    /// Distance between points, metres.
    pub fn step_m(&self) -> f64 {
        f64::from(self.step_length) * BASE_STEP_M
    }

    /// Range of the last point, metres.
    pub fn last_m(&self) -> f64 {
        self.first_m() + f64::from(self.num_points.saturating_sub(1)) * self.step_m()
    }

    /// Whether echoes reach the receiver: the transmitter is on, and not looped back.
    pub fn hears_echoes(&self) -> bool {
        self.enable_tx && !self.enable_loopback
    }
}

/// A sensor's configuration. Check it with [`SensorConfig::validate`] before use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SensorConfig {
    /// Sweeps in a frame.
    pub sweeps_per_frame: u32,
    /// Sweeps per second inside a frame; `None`: as fast as possible.
    pub sweep_rate: Option<f64>,
    /// Frames per second; `None`: as fast as possible.
    pub frame_rate: Option<f64>,
    /// Sweeps keep their period across frames.
    pub continuous_sweep_mode: bool,
    /// Measures a frame while the previous one is read.
    pub double_buffering: bool,
    /// Idle state between frames.
    pub inter_frame_idle_state: IdleState,
    /// Idle state between sweeps.
    pub inter_sweep_idle_state: IdleState,
    /// The subsweeps, measured in this order in every sweep.
    pub subsweeps: Vec<Subsweep>,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            sweeps_per_frame: 1,
            sweep_rate: None,
            frame_rate: None,
            continuous_sweep_mode: false,
            double_buffering: false,
            inter_frame_idle_state: IdleState::DeepSleep,
            inter_sweep_idle_state: IdleState::Ready,
            subsweeps: vec![Subsweep::default()],
        }
    }
}

impl SensorConfig {
    /// Points in one sweep, all subsweeps together.
    pub fn points_per_sweep(&self) -> usize {
        self.subsweeps.iter().map(|s| s.num_points as usize).sum()
    }

    /// Points in one frame.
    pub fn points_per_frame(&self) -> usize {
        self.points_per_sweep() * self.sweeps_per_frame as usize
    }
}
