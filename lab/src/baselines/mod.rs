//! Other people's ways to see obstacles with the same sensor, to hold ours against; written from public descriptions, in f64, for
//! experiments alone.

mod vendor;

pub use vendor::{
    DetectorConfig, DetectorResult, RangeVelocity, Reflection, Sampling, Track, VendorDetector, cone_angle_rad,
};
