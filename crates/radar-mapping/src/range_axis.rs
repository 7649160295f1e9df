//! The range axis of an A121 subsweep.

use a121::Subsweep;
use radar_sar::RangeAxis;

/// Ranges of a subsweep's points, metres from the sensor's phase centre.
pub fn range_axis(subsweep: &Subsweep) -> RangeAxis {
    RangeAxis { first_m: subsweep.first_m(), step_m: subsweep.step_m(), points: subsweep.num_points as usize }
}
