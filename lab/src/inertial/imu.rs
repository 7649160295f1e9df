//! Samples of an inertial measurement unit and its error model.
//!
//! Values are 1σ, in SI units, for each axis. White noise, instability and random walk are what an
//! Allan deviation shows (IEEE Std 952): its slope −½, its flat bottom and its slope +½. Tolerances
//! of data sheets ("±") are taken as 2σ.

use glam::DVec3;

use radar_sar::math;

/// Acceleration of free fall, tracking frame. Physics: standard gravity.
pub const GRAVITY_M_PER_S2: DVec3 = DVec3::new(0.0, -9.806_65, 0.0);

/// Correlation time of a bias of the size of the instability, seconds. Choice: the time at which
/// Allan curves of such parts have their minimum.
pub const INSTABILITY_TIME_S: f64 = 300.0;

/// Measurement since the sample before: means over the interval, as an integrating sensor gives
/// them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// End of the interval, host nanoseconds.
    pub time_ns: i64,
    /// Angular velocity of the body relative to the room, body frame, rad/s.
    pub angular_rate_rad_per_s: DVec3,
    /// Acceleration less gravity's, body frame, m/s². At rest it points up.
    pub specific_force_m_per_s2: DVec3,
}

impl ImuSample {
    /// Whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.angular_rate_rad_per_s.is_finite() && self.specific_force_m_per_s2.is_finite()
    }
}

/// Three gyroscopes, or three accelerometers. The unit is rad/s, or m/s².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriadSpec {
    /// Density of the white noise, unit/√Hz.
    pub white: f64,
    /// Instability of the bias: the bottom of the Allan deviation, unit.
    pub instability: f64,
    /// Random walk of the bias, unit/√s.
    pub walk: f64,
    /// Bias at switch-on, unit.
    pub turn_on: f64,
    /// Relative scale error.
    pub scale: f64,
    /// Relative cross-axis sensitivity.
    pub cross: f64,
}

impl TriadSpec {
    /// No errors at all.
    pub const PERFECT: Self = Self { white: 0.0, instability: 0.0, walk: 0.0, turn_on: 0.0, scale: 0.0, cross: 0.0 };

    /// Random walk of the bias that a filter assumes, unit/√s: the walk, and the instability's
    /// changes over times shorter than its correlation time.
    pub fn bias_walk(&self) -> f64 {
        math::hypot(self.walk, self.instability * (2.0 / INSTABILITY_TIME_S).sqrt())
    }
}

/// An inertial measurement unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSpec {
    /// Its product name.
    pub name: &'static str,
    /// Samples per second.
    pub rate_hz: f64,
    /// In rad/s.
    pub gyroscope: TriadSpec,
    /// In m/s².
    pub accelerometer: TriadSpec,
}

impl ImuSpec {
    /// One without errors.
    pub const PERFECT: Self =
        Self { name: "perfect", rate_hz: 400.0, gyroscope: TriadSpec::PERFECT, accelerometer: TriadSpec::PERFECT };
}

/// Degrees in radians, thousandths of standard gravity in m/s².
const DEG: f64 = std::f64::consts::PI / 180.0;
const MILLI_G: f64 = 9.806_65e-3;
/// Bias random walks that users of such parts calibrate with, rad/s² and m/s³ per √Hz (source: the
/// example of Kalibr's manual).
const CONSUMER_WALKS: [f64; 2] = [4.0e-6, 2.0e-4];

/// What hobby boards carried for a decade, as in a prototype. Data sheet: 0.005 °/s/√Hz, 400
/// µg/√Hz, ±20 °/s, ±50 mg, ±3 %, ±2 % cross-axis. Instabilities as users measured them: 4.3 °/h;
/// 36 µg of the sister MPU-6000 (Greenheck 2009).
pub const MPU_6050: ImuSpec = ImuSpec {
    name: "MPU-6050",
    rate_hz: 400.0,
    gyroscope: TriadSpec {
        white: 0.005 * DEG,
        instability: 4.3 / 3600.0 * DEG,
        walk: CONSUMER_WALKS[0],
        turn_on: 10.0 * DEG,
        scale: 0.015,
        cross: 0.01,
    },
    accelerometer: TriadSpec {
        white: 0.4 * MILLI_G,
        instability: 0.036 * MILLI_G,
        walk: CONSUMER_WALKS[1],
        turn_on: 25.0 * MILLI_G,
        scale: 0.015,
        cross: 0.01,
    },
};

/// What phones and headsets carry ten years later. Data sheet (DS-000347): 0.0028 °/s/√Hz, 70
/// µg/√Hz. Assumed as usual of such parts: ±0.5 °/s, ±20 mg, ±0.5 %, ±1 % cross-axis; instabilities
/// and walks as above.
pub const ICM_42688: ImuSpec = ImuSpec {
    name: "ICM-42688-P",
    rate_hz: 400.0,
    gyroscope: TriadSpec {
        white: 0.0028 * DEG,
        turn_on: 0.25 * DEG,
        scale: 0.0025,
        cross: 0.005,
        ..MPU_6050.gyroscope
    },
    accelerometer: TriadSpec {
        white: 0.07 * MILLI_G,
        turn_on: 10.0 * MILLI_G,
        scale: 0.0025,
        cross: 0.005,
        ..MPU_6050.accelerometer
    },
};

/// The class of sophisticated and expensive units (thesis, 2.6.1), from what its makers state: 0.04
/// °/√h, 0.25 °/h, 0.03 m/s/√h, 25 µg, calibrated in the factory. Not one part; walks are assumed
/// to be a tenth of a consumer part's.
pub const TACTICAL: ImuSpec = ImuSpec {
    name: "tactical grade",
    rate_hz: 400.0,
    gyroscope: TriadSpec {
        white: 0.04 / 60.0 * DEG,
        instability: 0.25 / 3600.0 * DEG,
        walk: 0.1 * CONSUMER_WALKS[0],
        turn_on: 7.0 / 3600.0 * DEG,
        scale: 3e-4,
        cross: 3e-4,
    },
    accelerometer: TriadSpec {
        white: 0.03 / 60.0,
        instability: 0.025 * MILLI_G,
        walk: 0.1 * CONSUMER_WALKS[1],
        turn_on: 1.7 * MILLI_G,
        scale: 3e-4,
        cross: 3e-4,
    },
};
