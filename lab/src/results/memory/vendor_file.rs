//! A file of the vendor's tool that is sound but for what it holds, and a track.

use a121::preset;
use anyhow::{Context, Result};
use hdf5_pure::{CompoundTypeBuilder, FileBuilder, GroupBuilder};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A file of one sensor with the preset d16, a frame each 15 ms. Silence is packed, a hundred frames together; noise is not.
pub(super) fn h5(frames: usize, is_silent: bool) -> Result<Vec<u8>> {
    let config = preset("d16").context("d16 is a preset")?;
    let mut file = FileBuilder::new();
    file.create_dataset("server_info").with_vlen_strings(&[r#"{"ticks_per_second": 1000}"#]);
    let mut session = file.create_group("session");
    let session_config = serde_json::json!({"groups": [{"1": config}]}).to_string();
    session.create_dataset("session_config").with_vlen_strings(&[session_config.as_str()]);
    let mut group = session.create_group("group_0");
    let mut entry = group.create_group("entry_0");
    entry.create_dataset("sensor_id").with_i64_data(&[1]);
    entry.create_dataset("metadata").with_vlen_strings(&["{}"]);
    let mut result = entry.create_group("result");
    let shape = [frames as u64, config.sweeps_per_frame.into(), config.points_per_sweep() as u64];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let samples = shape.iter().product::<u64>();
    let bytes = (0..4 * samples).map(|_| if is_silent { 0 } else { rng.random() }).collect();
    let complex = CompoundTypeBuilder::new().i16_field("real").i16_field("imag").build()?;
    let dataset = result.create_dataset("frame").with_compound_data(complex, bytes, samples).with_shape(&shape);
    if is_silent {
        dataset.with_chunks(&[shape[0].min(100), shape[1], shape[2]]).with_deflate(1);
    }
    lists(&mut result, frames);
    entry.add_group(result.finish());
    group.add_group(entry.finish());
    session.add_group(group.finish());
    file.add_group(session.finish());
    Ok(file.finish()?)
}

fn lists(result: &mut GroupBuilder, frames: usize) {
    result.create_dataset("tick").with_i64_data(&(0..frames as i64).map(|n| 15 * n).collect::<Vec<_>>());
    result.create_dataset("temperature").with_i64_data(&vec![30; frames]);
    for flag in ["data_saturated", "frame_delayed", "calibration_needed"] {
        result.create_dataset(flag).with_u8_data(&vec![0; frames]);
    }
}

/// A track of so many of the shortest lines.
pub(super) fn track(lines: usize) -> String {
    "0 0 0 0 0 0 0 1\n".repeat(lines)
}
