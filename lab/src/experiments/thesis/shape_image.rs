//! Object shapes by sub-apertures: coherent sums within groups of sub-apertures, power summed
//! across groups.
//!
//! No prior knowledge: the cube is imaged in coarse tiles first, and finely in the tiles that show
//! something.

use glam::DVec3;
use rayon::prelude::*;

use crate::experiments::trial_recording::{TrialRecording, region};
use radar_sar::Volume;
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::{Subaperture, SubapertureBuilder, SubapertureSettings, fine_image};

/// Edges of the tiles, of coarse voxels and of fine ones, metres. Choice: a tile is sixteen fine
/// voxels wide, large enough to pay for its tables, small enough to follow a shape.
const TILE_M: f64 = 0.2;
const COARSE_VOXEL_M: f64 = 0.05;
pub(super) const FINE_VOXEL_M: f64 = 0.0125;
const FINE_IN_TILE: usize = 16;
/// Tiles with this share of the greatest coarse power are imaged finely: −10 dB. Choice: −10 dB, as
/// deep as a shape is drawn.
const MIN_TILE_SHARE: f32 = 0.1;
/// Sub-apertures of 90 ms in one coherent sum. Choice: 360 ms, over which tracking drift is
/// negligible.
const SUBAPERTURES_PER_GROUP: usize = 4;

/// Amplitude (root of the power, noise at most 1) by sub-apertures, 0 where nothing is imaged;
/// `None` where no tile was covered.
pub(super) fn subaperture_image(recorded: &TrialRecording) -> Option<Volume> {
    let subapertures = subapertures(recorded);
    let cube = region(COARSE_VOXEL_M, recorded.seed);
    let tiles = (cube.size() / TILE_M).ceil().to_array().map(|n| n as usize);
    let tile_at = |n: usize| [n % tiles[0], n / tiles[0] % tiles[1], n / (tiles[0] * tiles[1])];
    let coarse: Vec<(usize, f32)> = (0..tiles.iter().product())
        .into_par_iter()
        .filter_map(|n| Some((n, tile_image(&subapertures, &cube, tile_at(n), COARSE_VOXEL_M, 1)?.peak()?.1)))
        .collect();
    let greatest = coarse.iter().map(|tile| tile.1).fold(0.0, f32::max);
    let shown: Vec<[usize; 3]> =
        coarse.iter().filter(|tile| tile.1 >= MIN_TILE_SHARE * greatest).map(|tile| tile_at(tile.0)).collect();
    let fine: Vec<([usize; 3], Volume)> = shown
        .into_par_iter()
        .filter_map(|tile| Some((tile, tile_image(&subapertures, &cube, tile, FINE_VOXEL_M, SUBAPERTURES_PER_GROUP)?)))
        .collect();
    assembled(&cube, &fine)
}

/// Amplitude in a box of ±15 cm around a point, voxels of 5 mm; `None` where it is not covered.
pub(super) fn close_image(recorded: &TrialRecording, position: DVec3) -> Option<Volume> {
    let subapertures = subapertures(recorded);
    let region = Aabb { min: position - 0.15, max: position + 0.15 };
    Some(amplitude(
        fine_image(&subapertures.iter().collect::<Vec<_>>(), &region, 0.005, SUBAPERTURES_PER_GROUP)?.coherent,
    ))
}

fn subapertures(recorded: &TrialRecording) -> Vec<Subaperture> {
    let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
    let mut subapertures: Vec<Subaperture> =
        recorded.observations.iter().filter_map(|o| builder.push(o.clone())).collect();
    subapertures.extend(builder.close());
    subapertures
}

/// Power in a tile: the sum over the sub-apertures that cover it, divided by the number of all
/// sub-apertures. So tiles that few of them cover are not brighter, and tiles fit together.
fn tile_image(
    subapertures: &[Subaperture],
    cube: &Aabb,
    tile: [usize; 3],
    voxel_m: f64,
    per_aperture: usize,
) -> Option<Volume> {
    let min = cube.min + DVec3::from_array(tile.map(|n| n as f64)) * TILE_M;
    let all: Vec<&Subaperture> = subapertures.iter().collect();
    let image = fine_image(&all, &Aabb { min, max: min + TILE_M }, voxel_m, per_aperture)?;
    let share = (image.apertures * per_aperture) as f32 / subapertures.len() as f32;
    let mut power = image.coherent;
    power.values.iter_mut().for_each(|value| *value *= share);
    Some(power)
}

fn amplitude(mut power: Volume) -> Volume {
    power.values.iter_mut().for_each(|value| *value = value.max(0.0).sqrt());
    power
}

/// Joins the tiles' amplitudes in one volume.
fn assembled(cube: &Aabb, tiles: &[([usize; 3], Volume)]) -> Option<Volume> {
    let bound = |start: usize, pick: fn(usize, usize) -> usize| {
        [0, 1, 2].map(|axis| tiles.iter().map(|(tile, _)| tile[axis]).fold(start, pick))
    };
    let (low, high) = (bound(usize::MAX, usize::min), bound(0, usize::max));
    if tiles.is_empty() {
        return None;
    }
    let at = |tile: [usize; 3]| cube.min + DVec3::from_array(tile.map(|n| n as f64)) * TILE_M;
    let mut whole = Volume::covering(&Aabb { min: at(low), max: at(high) + TILE_M }, FINE_VOXEL_M);
    for (tile, image) in tiles {
        for (index, value) in image.values.iter().enumerate() {
            let voxel = image.voxel(index);
            let to: [usize; 3] = std::array::from_fn(|axis| (tile[axis] - low[axis]) * FINE_IN_TILE + voxel[axis]);
            let index = whole.index(to);
            whole.values[index] = value.max(0.0).sqrt();
        }
    }
    Some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;
    use radar_simulation::Scenario;

    #[test]
    fn reflector_is_imaged_at_its_position_and_nowhere_else() {
        let of = |scene: &str| {
            let config = preset("d16").unwrap();
            let scenario = Scenario { snr_db: Some(30.0), ..Scenario::new(scene, "sphere-50cm", config, 1.5, 1) };
            TrialRecording::of(&scenario).unwrap()
        };
        let recorded = of("corner-reflector");
        let image = subaperture_image(&recorded).unwrap();
        let (peak, greatest) = image.peak().unwrap();
        assert!(image.center(image.voxel(peak)).distance(recorded.truth_m) < 0.03);
        assert!(image.values.iter().filter(|value| **value >= 0.5 * greatest).count() < image.values.len() / 20);
        let close = close_image(&recorded, recorded.truth_m).unwrap();
        assert!(close.center(close.voxel(close.peak().unwrap().0)).distance(recorded.truth_m) < 0.02);
        assert_eq!(close_image(&recorded, DVec3::Z * 50.0), None);
        assert_eq!(assembled(&region(0.05, 1), &[]), None);
    }
}
