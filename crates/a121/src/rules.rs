//! Rules of a configuration. Each error names the field, its value and the limit.

use super::{IdleState, Prf, Profile, SensorConfig, Subsweep};

/// A broken rule of a configuration. Subsweeps are counted from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// No subsweeps.
    #[error("subsweeps is empty: give 1 to 4")]
    NoSubsweeps,
    /// Too many subsweeps.
    #[error("subsweeps has {0} entries: give 1 to 4")]
    TooManySubsweeps(usize),
    /// A number outside its range.
    #[error("{field} is {value}: it must lie in {min} to {max}")]
    OutOfRange {
        /// The field, with its subsweep.
        field: String,
        /// Its value.
        value: i64,
        /// Lowest allowed value.
        min: i64,
        /// Highest allowed value.
        max: i64,
    },
    /// A step length that the sensor does not support.
    #[error("subsweeps[{subsweep}].step_length is {value}: it must divide 24 or be a multiple of 24")]
    StepLength {
        /// Index of the subsweep.
        subsweep: usize,
        /// Its step length.
        value: u32,
    },
    /// Loopback with profile 2, which would spoil the measurement.
    #[error("subsweeps[{0}].enable_loopback is true with profile 2: choose another profile or switch it off")]
    LoopbackWithProfile2(usize),
    /// The highest PRF requires profile 1.
    #[error(
        "subsweeps[{subsweep}].prf is 19.5 MHz with profile {profile}: it needs profile 1; choose 15.6 MHz or less"
    )]
    PrfNeedsProfile1 {
        /// Index of the subsweep.
        subsweep: usize,
        /// Its profile.
        profile: u8,
    },
    /// The last point lies beyond the unambiguous range of the PRF.
    #[error(
        "subsweeps[{subsweep}] ends at {end_m:.2} m: prf {prf_mhz} MHz measures to {max_m} m; lower the prf or num_points"
    )]
    BeyondPrf {
        /// Index of the subsweep.
        subsweep: usize,
        /// Range of its last point, metres.
        end_m: f64,
        /// Its PRF, MHz.
        prf_mhz: f64,
        /// Farthest allowed range, metres.
        max_m: f64,
    },
    /// The PRF rises from one subsweep to the next.
    #[error("subsweeps[{subsweep}].prf is {value_mhz} MHz, above {before_mhz} MHz before it: it must not rise")]
    PrfRises {
        /// Index of the later subsweep.
        subsweep: usize,
        /// Its PRF, MHz.
        value_mhz: f64,
        /// PRF of the subsweep before, MHz.
        before_mhz: f64,
    },
    /// A rate that is not positive and finite.
    #[error("{field} is {value:?}: it must be above 0 and below 3e38, or left out for as fast as possible")]
    Rate {
        /// `frame_rate` or `sweep_rate`.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// The frame rate is too high for the sweep rate.
    #[error(
        "frame_rate is {frame_rate}: with {sweeps_per_frame} sweeps at sweep_rate {sweep_rate} it may be {max} at most"
    )]
    FrameRateAboveSweeps {
        /// Frame rate, Hz.
        frame_rate: f64,
        /// Sweep rate, Hz.
        sweep_rate: f64,
        /// Sweeps in a frame.
        sweeps_per_frame: u32,
        /// Highest frame rate, Hz.
        max: f64,
    },
    /// The idle state between frames is less deep than the one between sweeps.
    #[error("inter_frame_idle_state is {frame:?}, less deep than inter_sweep_idle_state {sweep:?}: make it as deep")]
    FrameIdleShallower {
        /// Idle state between frames.
        frame: IdleState,
        /// Idle state between sweeps.
        sweep: IdleState,
    },
    /// Continuous sweep mode excludes a frame rate.
    #[error("continuous_sweep_mode with frame_rate {0}: leave frame_rate out")]
    ContinuousWithFrameRate(f64),
    /// Continuous sweep mode requires a sweep rate.
    #[error("continuous_sweep_mode without sweep_rate: set sweep_rate")]
    ContinuousWithoutSweepRate,
    /// Continuous sweep mode requires equal idle states.
    #[error(
        "continuous_sweep_mode with inter_frame_idle_state {frame:?} and inter_sweep_idle_state {sweep:?}: make them equal"
    )]
    ContinuousIdleStates {
        /// Idle state between frames.
        frame: IdleState,
        /// Idle state between sweeps.
        sweep: IdleState,
    },
    /// The frame exceeds the sensor's buffer.
    #[error(
        "num_points × sweeps_per_frame is {per_sweep} × {sweeps_per_frame} = {points}: the sensor holds {max}{hint}"
    )]
    Buffer {
        /// Points × sweeps of the configuration.
        points: u64,
        /// Points in a sweep.
        per_sweep: u64,
        /// Sweeps in a frame.
        sweeps_per_frame: u32,
        /// Buffer size, points.
        max: u64,
        /// Text: why the buffer is halved, if it is.
        hint: &'static str,
    },
}

/// Most subsweeps in a sweep. Physics: sensor.
const MAX_SUBSWEEPS: usize = 4;
/// Size of the sensor's buffer, points. Physics: sensor.
const BUFFER_POINTS: u64 = 4095;
/// Size of the buffer when double buffering splits it, points. Physics: sensor.
const BUFFER_POINTS_DOUBLE: u64 = 2047;

impl SensorConfig {
    /// Checks every rule of the sensor and returns the first broken one.
    ///
    /// # Errors
    /// The broken rule.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if self.subsweeps.is_empty() {
            return Err(ConfigError::NoSubsweeps);
        }
        if self.subsweeps.len() > MAX_SUBSWEEPS {
            return Err(ConfigError::TooManySubsweeps(self.subsweeps.len()));
        }
        check_range("sweeps_per_frame".into(), self.sweeps_per_frame.into(), 1, BUFFER_POINTS as i64)?;
        for (index, subsweep) in self.subsweeps.iter().enumerate() {
            validate_subsweep(index, subsweep)?;
        }
        for (index, pair) in self.subsweeps.windows(2).enumerate() {
            if pair[1].prf.hz() > pair[0].prf.hz() {
                return Err(ConfigError::PrfRises {
                    subsweep: index + 1,
                    value_mhz: pair[1].prf.hz() / 1e6,
                    before_mhz: pair[0].prf.hz() / 1e6,
                });
            }
        }
        self.validate_buffer()?;
        self.validate_rates()?;
        self.validate_idle_states()
    }

    fn validate_buffer(&self) -> Result<(), ConfigError> {
        let per_sweep: u64 = self.subsweeps.iter().map(|s| u64::from(s.num_points)).sum();
        let points = per_sweep * u64::from(self.sweeps_per_frame);
        let (max, hint) = match self.double_buffering {
            true => (BUFFER_POINTS_DOUBLE, " with double_buffering"),
            false => (BUFFER_POINTS, ""),
        };
        if points > max {
            return Err(ConfigError::Buffer { points, per_sweep, sweeps_per_frame: self.sweeps_per_frame, max, hint });
        }
        Ok(())
    }

    fn validate_rates(&self) -> Result<(), ConfigError> {
        for (field, rate) in [("sweep_rate", self.sweep_rate), ("frame_rate", self.frame_rate)] {
            // Servers store rates as 32-bit floats; a rate that becomes 0 or infinite there is
            // invalid.
            if let Some(value) = rate.filter(|v| !((*v as f32).is_normal() && *v > 0.0)) {
                return Err(ConfigError::Rate { field, value });
            }
        }
        if let (Some(frame_rate), Some(sweep_rate)) = (self.frame_rate, self.sweep_rate) {
            let max = sweep_rate / f64::from(self.sweeps_per_frame);
            if frame_rate > max {
                return Err(ConfigError::FrameRateAboveSweeps {
                    frame_rate,
                    sweep_rate,
                    sweeps_per_frame: self.sweeps_per_frame,
                    max,
                });
            }
        }
        Ok(())
    }

    fn validate_idle_states(&self) -> Result<(), ConfigError> {
        let (frame, sweep) = (self.inter_frame_idle_state, self.inter_sweep_idle_state);
        if frame < sweep {
            return Err(ConfigError::FrameIdleShallower { frame, sweep });
        }
        if self.continuous_sweep_mode {
            if let Some(rate) = self.frame_rate {
                return Err(ConfigError::ContinuousWithFrameRate(rate));
            }
            if self.sweep_rate.is_none() {
                return Err(ConfigError::ContinuousWithoutSweepRate);
            }
            if frame != sweep {
                return Err(ConfigError::ContinuousIdleStates { frame, sweep });
            }
        }
        Ok(())
    }
}

fn check_range(field: String, value: i64, min: i64, max: i64) -> Result<(), ConfigError> {
    if (min..=max).contains(&value) { Ok(()) } else { Err(ConfigError::OutOfRange { field, value, min, max }) }
}

fn validate_subsweep(index: usize, subsweep: &Subsweep) -> Result<(), ConfigError> {
    let name = |field: &str| format!("subsweeps[{index}].{field}");
    check_range(name("start_point"), subsweep.start_point.into(), -275, i64::from(i32::MAX))?;
    check_range(name("num_points"), subsweep.num_points.into(), 1, BUFFER_POINTS as i64)?;
    check_range(name("hwaas"), subsweep.hwaas.into(), 1, 511)?;
    check_range(name("receiver_gain"), subsweep.receiver_gain.into(), 0, 23)?;
    let step = subsweep.step_length;
    if step == 0 || (24 % step != 0 && !step.is_multiple_of(24)) {
        return Err(ConfigError::StepLength { subsweep: index, value: step });
    }
    if subsweep.enable_loopback && subsweep.profile == Profile::P2 {
        return Err(ConfigError::LoopbackWithProfile2(index));
    }
    if subsweep.prf == Prf::Mhz19_5 && subsweep.profile != Profile::P1 {
        return Err(ConfigError::PrfNeedsProfile1 { subsweep: index, profile: subsweep.profile.into() });
    }
    let end_m = subsweep.last_m();
    if end_m > subsweep.prf.max_measurable_m() {
        return Err(ConfigError::BeyondPrf {
            subsweep: index,
            end_m,
            prf_mhz: subsweep.prf.hz() / 1e6,
            max_m: subsweep.prf.max_measurable_m(),
        });
    }
    Ok(())
}

#[cfg(test)]
#[path = "rules_tests.rs"]
mod tests;
