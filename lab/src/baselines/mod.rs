//! Baselines: other detectors for the same sensor, for comparison in experiments only. Written from
//! public descriptions, in f64.

mod vendor;

pub use vendor::{
    DetectorConfig, DetectorResult, RangeVelocity, Reflection, Sampling, Track, VendorDetector, cone_angle_rad,
};
