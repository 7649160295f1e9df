//! How far reported positions are from the truth: reflectors, pairs, time offsets, mounts, rooms.

mod jumps;
mod mount;
mod pairs;
mod reflector;
mod rooms;
mod sharpness;
mod time_offset;

pub use jumps::jumps_table;
pub use mount::{gross_table, mount_table};
pub use pairs::{pair_calibration, pair_table, split_table};
pub use reflector::{ErrorKind, REFLECTOR_TRIALS, ReflectorOptions, ReflectorTrial, reflector_table};
pub use rooms::{RoomTrial, room_table};
pub use sharpness::sharpness_table;
pub use time_offset::{correction_in_rooms, correction_table, time_offset_table};

/// A quantile of values in any order; NaN without values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = ((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1));
    values.get(n).copied().unwrap_or(f64::NAN)
}

/// The mean; NaN without values.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
    sum / count
}
