//! Fine coherent imaging of a detected object at voxels of 1 cm and smaller.
//!
//! Coherent within an aperture (one sub-aperture or a few consecutive ones, over which tracking is
//! stable), incoherent across apertures: the mean over apertures of abs(Σ_k w_k z_k(d_k)
//! e^(−jκd_k))² / K. It cannot detect objects in a room, where one wall dominates everything else.
//! Within a region known to hold an object its cross-range resolution is a wavelength over the
//! aperture's angle, while incoherent sums resolve only the pulse. Longer apertures resolve more
//! until tracking drifts.

use glam::DVec3;
use rayon::prelude::*;

use super::Subaperture;
use super::brick::{Scratch, Sums, VoxelBox};
use crate::Volume;
use crate::geometry::Aabb;
use crate::simd::LANES;

/// Edge of the voxel cube that one task images. Choice: 8 × 8 × 8 where the box tables reach that
/// far, else 4 × 4 × 4.
const EDGES: [usize; 2] = [8, 4];
/// Sub-apertures farther apart than this are not summed coherently, nanoseconds, because tracking
/// drifts. Choice: a tenth of a second is what tracking holds a phase for.
const MAX_GAP_NS: i64 = 150_000_000;

/// Power in a region, normalised so that noise gives 1.
#[derive(Debug, Clone, PartialEq)]
pub struct FineImage {
    /// Coherent within apertures, mean over them.
    pub coherent: Volume,
    /// Σ abs(z)² over the same sweeps, mean: the reference for the coherent image.
    pub incoherent: Volume,
    /// Apertures used. Sub-apertures whose range axes do not cover the whole region are left out.
    pub apertures: usize,
}

/// Images a region from the sub-apertures of one subsweep in time order, at most `per_aperture` of
/// them in each aperture.
///
/// The voxel cube of one task must fit the box tables, which allows voxels as large as the sub-apertures' settings state,
/// up to 6.5 cm for the 14 cm pulse. Returns `None` when voxels are larger, or when no sub-aperture covers the region. The
/// result has the same bits on any number of threads.
pub fn fine_image(blocks: &[&Subaperture], region: &Aabb, voxel_m: f64, per_aperture: usize) -> Option<FineImage> {
    let sound = voxel_m > 0.0 && region.size().is_finite() && region.size().min_element() >= 0.0;
    if !sound || (region.size() / voxel_m).to_array().iter().product::<f64>() > MAX_VOXELS {
        return None;
    }
    let apertures = coherent_runs(blocks, region, per_aperture.max(1));
    let reach_m = apertures.iter().flatten().map(|b| f64::from(b.box_reach_m())).reduce(f64::min)?;
    let radius_m = |edge: usize| (edge - 1) as f64 * 0.5 * 3f64.sqrt() * voxel_m;
    let edge = EDGES.into_iter().find(|&edge| radius_m(edge) <= reach_m)?;
    let empty = Volume::covering(region, voxel_m);
    let boxes = empty.size.map(|n| n.div_ceil(edge));
    let images: Vec<Vec<[f32; 2]>> = (0..boxes.iter().product())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, n| {
            let first = [n % boxes[0], n / boxes[0] % boxes[1], n / (boxes[0] * boxes[1])].map(|n| n * edge);
            image_box(&apertures, empty.center(first), voxel_m, edge, scratch)
        })
        .collect();
    let mut image = FineImage { coherent: empty.clone(), incoherent: empty, apertures: apertures.len() };
    for index in 0..image.coherent.values.len() {
        let voxel = image.coherent.voxel(index);
        let of = voxel.map(|n| n / edge);
        let [x, y, z] = voxel.map(|n| n % edge);
        let box_at = (of[2] * boxes[1] + of[1]) * boxes[0] + of[0];
        let tile = (y / 4 * (edge / 4) + x / 4) * edge + z;
        let [coherent, incoherent] = images[box_at][tile * LANES + y % 4 * 4 + x % 4];
        image.coherent.values[index] = coherent;
        image.incoherent.values[index] = incoherent;
    }
    Some(image)
}

/// Regions of more voxels than this are refused. Choice: 2 GB of memory.
const MAX_VOXELS: f64 = 1e8;

/// Sub-apertures that cover the region, in runs without gaps.
fn coherent_runs<'a>(blocks: &[&'a Subaperture], region: &Aabb, per_aperture: usize) -> Vec<Vec<&'a Subaperture>> {
    let half_m = region.size().length() * 0.5;
    let covers = |block: &&&Subaperture| {
        let distance_m = block.distance_m(region.center());
        block.covers((distance_m - half_m) as f32, (distance_m + half_m) as f32)
    };
    let mut found: Vec<Vec<&Subaperture>> = Vec::new();
    for block in blocks.iter().filter(covers) {
        match found.last_mut() {
            Some(last)
                if last.len() < per_aperture
                    && last.last().is_some_and(|before| block.mid_time_ns - before.mid_time_ns <= MAX_GAP_NS) =>
            {
                last.push(block);
            }
            _ => found.push(vec![block]),
        }
    }
    found
}

/// Coherent and incoherent power of a cube of voxels, in tiles of 4 × 4 columns, layer by layer.
fn image_box(
    apertures: &[Vec<&Subaperture>],
    low: DVec3,
    voxel_m: f64,
    edge: usize,
    scratch: &mut Scratch,
) -> Vec<[f32; 2]> {
    let half_m = (edge - 1) as f64 * 0.5 * voxel_m;
    let middle = low + half_m;
    let corner = |tile: usize, z: usize| {
        let (x, y) = (tile % (edge / 4) * 4, tile / (edge / 4) * 4);
        (DVec3::new(x as f64, y as f64, z as f64) * voxel_m - half_m).as_vec3().to_array()
    };
    let tiles = (edge / 4) * (edge / 4);
    let layers_m: Vec<[f32; 3]> = (0..tiles).flat_map(|tile| (0..edge).map(move |z| corner(tile, z))).collect();
    let radius_m = (half_m * 3f64.sqrt()) as f32;
    let mut image = vec![[0.0f32; 2]; layers_m.len() * LANES];
    let mut of_block: Vec<Sums> = vec![[[0.0; LANES]; 3]; layers_m.len()];
    for aperture in apertures {
        let mut sums: Vec<Sums> = vec![[[0.0; LANES]; 3]; layers_m.len()];
        for block in aperture {
            let middle_m = (middle - block.middle.translation).as_vec3().to_array();
            let voxels = VoxelBox { middle_m, voxel_m: voxel_m as f32, radius_m, layers_m: &layers_m };
            block.sums_in_box(&voxels, scratch, &mut of_block);
            for (sum, of_block) in sums.iter_mut().flatten().flatten().zip(of_block.iter().flatten().flatten()) {
                *sum += of_block;
            }
        }
        let count = aperture.iter().map(|b| b.sweep_count()).sum::<usize>() as f32;
        for (pixel, n) in image.iter_mut().zip(0..) {
            let [re, im, energy] = sums[n / LANES].map(|lanes| lanes[n % LANES]);
            pixel[0] += (re * re + im * im) / count;
            pixel[1] += energy / count;
        }
    }
    let share = 1.0 / apertures.len().max(1) as f32;
    image.iter_mut().flatten().for_each(|value| *value *= share);
    image
}

/// The voxels connected to the peak (by faces, edges or corners) with at least `share` of its
/// value: centre and value, greatest first. Empty when nothing is above 0.
pub fn connected_region(volume: &Volume, share: f32) -> Vec<(DVec3, f32)> {
    let Some((peak, greatest)) = volume.peak() else { return Vec::new() };
    let mut reached = vec![false; volume.values.len()];
    reached[peak] = true;
    let (mut open, mut found) = (vec![peak], Vec::new());
    while let Some(index) = open.pop() {
        let voxel = volume.voxel(index);
        found.push((volume.center(voxel), volume.values[index]));
        for n in (0..27).filter(|n| *n != 13) {
            let step = [n % 3, n / 3 % 3, n / 9];
            let next: [usize; 3] = std::array::from_fn(|axis| (voxel[axis] + step[axis]).wrapping_sub(1));
            if next.iter().zip(volume.size).all(|(at, size)| *at < size) {
                let next = volume.index(next);
                if !reached[next] && volume.values[next] >= share * greatest {
                    reached[next] = true;
                    open.push(next);
                }
            }
        }
    }
    // Ties are broken by position, so the order is deterministic.
    let by_place = |a: &DVec3, b: &DVec3| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z));
    found.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| by_place(&a.0, &b.0)));
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Observation;
    use crate::subaperture::{SubapertureBuilder, SubapertureSettings};
    use crate::test_data::{Echo, conjugated, on_one_thread, sweeps, winding};

    const AT: DVec3 = DVec3::new(0.1, -0.2, -1.1);

    fn blocks(observations: Vec<Observation>) -> Vec<Subaperture> {
        let mut builder = SubapertureBuilder::new(SubapertureSettings::default());
        let mut blocks: Vec<_> = observations.into_iter().filter_map(|o| builder.push(o)).collect();
        blocks.extend(builder.close());
        blocks
    }

    fn image(observations: Vec<Observation>, half_m: f64, voxel_m: f64, per_aperture: usize) -> FineImage {
        let blocks = blocks(observations);
        let region = Aabb { min: AT - half_m, max: AT + half_m };
        fine_image(&blocks.iter().collect::<Vec<_>>(), &region, voxel_m, per_aperture).unwrap()
    }

    /// Full width at half power through the peak along x, y and z.
    fn widths_m(volume: &Volume) -> [f64; 3] {
        let (peak, greatest) = volume.peak().unwrap();
        let at = volume.voxel(peak);
        std::array::from_fn(|axis| {
            let strong = |n: &usize| {
                let mut voxel = at;
                voxel[axis] = *n;
                volume.values[volume.index(voxel)] >= 0.5 * greatest
            };
            let below = (0..at[axis]).rev().take_while(strong).count();
            let above = (at[axis]..volume.size[axis]).take_while(strong).count();
            (below + above) as f64 * volume.voxel_m
        })
    }

    #[test]
    fn longer_aperture_sharpens_a_point_at_its_position() {
        let observations = sweeps(3.0, winding, &[(Echo::Point(AT), 3.0)], 1);
        let [one, four] = [1, 4].map(|per_aperture| image(observations.clone(), 0.16, 0.01, per_aperture));
        let widths = [&one.incoherent, &one.coherent, &four.coherent].map(widths_m);
        let [incoherent, one_block, four_blocks] = widths.map(|each| each.into_iter().fold(0.0, f64::max));
        assert!(incoherent > 0.25 && one_block < 0.6 * incoherent && four_blocks < 0.5 * one_block, "{widths:?}");
        for image in [&one, &four] {
            let (peak, _) = image.coherent.peak().unwrap();
            assert!(image.coherent.center(image.coherent.voxel(peak)).distance(AT) < 0.012);
        }
    }

    #[test]
    fn points_six_centimetres_apart_are_separated() {
        let beside = AT + DVec3::X * 0.06;
        let pair = [(Echo::Point(AT), 3.0), (Echo::Point(beside), 3.0)];
        let image = image(sweeps(3.0, winding, &pair, 2), 0.1, 0.01, 8);
        let found = connected_region(&image.coherent, 0.5);
        let nearest = |place: DVec3| found.iter().map(|(at, _)| at.distance(place)).fold(f64::INFINITY, f64::min);
        // One point is connected to the peak; the other is not.
        let distances = [nearest(AT), nearest(beside)];
        assert!(distances.iter().any(|d| *d < 0.012) && distances.iter().any(|d| *d > 0.02), "{distances:?}");
        assert!(found.windows(2).all(|pair| pair[0].1 >= pair[1].1));
    }

    #[test]
    fn conjugated_echoes_collapse_and_the_incoherent_image_stays() {
        let observations = sweeps(1.0, winding, &[(Echo::Point(AT), 3.0)], 3);
        let straight = image(observations.clone(), 0.1, 0.02, 2);
        let turned = image(conjugated(observations), 0.1, 0.02, 2);
        let peak = |volume: &Volume| volume.peak().unwrap().1;
        assert!(peak(&turned.coherent) < 0.1 * peak(&straight.coherent));
        assert!((peak(&turned.incoherent) / peak(&straight.incoherent) - 1.0).abs() < 0.01);
    }

    #[test]
    fn image_agrees_with_the_exact_kernel_on_any_number_of_threads() {
        let observations = sweeps(0.5, |t| winding(1.5 * t), &[(Echo::Point(AT), 3.0)], 4);
        let fine = image(observations.clone(), 0.05, 0.01, 1);
        assert_eq!(on_one_thread(|| image(observations.clone(), 0.05, 0.01, 1)), fine);
        let blocks = blocks(observations);
        let peak = fine.coherent.peak().unwrap().1;
        for index in (0..fine.coherent.values.len()).step_by(7) {
            let place = fine.coherent.center(fine.coherent.voxel(index));
            let power = |b: &Subaperture| {
                let relative = (place - b.middle.translation).as_vec3().to_array();
                b.coherence_at_points(&[relative])[0].power
            };
            let exact = blocks.iter().map(power).sum::<f32>() / blocks.len() as f32;
            assert!((fine.coherent.values[index] - exact).abs() < 0.01 * peak);
        }
    }

    #[test]
    fn regions_that_cannot_be_imaged_are_refused() {
        let blocks = blocks(sweeps(0.2, winding, &[], 5));
        let blocks: Vec<&Subaperture> = blocks.iter().collect();
        let around = |at: DVec3| Aabb { min: at - 0.05, max: at + 0.05 };
        assert_eq!(fine_image(&blocks, &around(DVec3::Z * -50.0), 0.01, 1), None);
        assert_eq!(fine_image(&blocks, &around(AT), 0.5, 1), None);
        assert_eq!(fine_image(&blocks, &around(AT), f64::NAN, 1), None);
        assert_eq!(fine_image(&blocks, &around(DVec3::NAN), 0.01, 1), None);
        assert_eq!(fine_image(&[], &around(AT), 0.01, 1), None);
    }
}
