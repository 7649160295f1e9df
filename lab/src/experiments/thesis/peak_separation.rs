//! Whether an image resolves two objects: the dip of the values between their peaks.
//!
//! Voxels are added in descending order of value and joined with their neighbours (union-find). The
//! value at which the two peaks first become connected is the height of the saddle between them.

use glam::DVec3;

use radar_sar::Volume;

/// Maximum distance of an object's peak from one of its points, metres. Choice: the pulse's width.
const PEAK_RADIUS_M: f64 = 0.15;
/// Physics: Rayleigh's criterion. Two equal points are resolved when the power between them falls
/// by this share.
pub(super) const RAYLEIGH_DIP: f64 = 0.265;

/// Peaks of two objects in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PeakSeparation {
    /// The weaker peak as a share of the stronger one.
    pub weaker: f64,
    /// Depth of the saddle below the weaker peak, as a share of that peak; 0: no peak of its own.
    pub dip: f64,
}

impl PeakSeparation {
    /// For two objects given by their points; `None` where the image has no value at one of them.
    pub fn of(volume: &Volume, things_m: [&[DVec3]; 2]) -> Option<Self> {
        let peaks = peaks(volume, things_m);
        let (a, b) = (peaks[0]?, peaks[1]?);
        let (low, high) = if volume.values[a] < volume.values[b] { (a, b) } else { (b, a) };
        let [weaker, stronger] = [low, high].map(|index| f64::from(volume.values[index]));
        let saddle = f64::from(saddle(volume, low, high));
        Some(Self { weaker: weaker / stronger, dip: 1.0 - saddle / weaker })
    }

    /// By Rayleigh's criterion.
    pub fn is_resolved(&self) -> bool {
        self.dip >= RAYLEIGH_DIP
    }
}

/// The greatest voxel near each object, among the voxels nearer to it than to the other.
fn peaks(volume: &Volume, things_m: [&[DVec3]; 2]) -> [Option<usize>; 2] {
    let mut best: [Option<usize>; 2] = [None; 2];
    for (index, value) in volume.values.iter().enumerate().filter(|(_, value)| **value > 0.0) {
        let position = volume.center(volume.voxel(index));
        let [a, b] = things_m.map(|points| points.iter().map(|p| p.distance(position)).fold(f64::INFINITY, f64::min));
        let own = usize::from(b < a);
        if a.min(b) <= PEAK_RADIUS_M && best[own].is_none_or(|best| *value > volume.values[best]) {
            best[own] = Some(index);
        }
    }
    best
}

/// The greatest threshold at which two voxels are connected; 0 when they never are.
fn saddle(volume: &Volume, from: usize, to: usize) -> f32 {
    let mut order: Vec<usize> = (0..volume.values.len()).filter(|&n| volume.values[n] > 0.0).collect();
    order.sort_by(|&a, &b| volume.values[b].total_cmp(&volume.values[a]).then(a.cmp(&b)));
    let mut parent: Vec<usize> = (0..volume.values.len()).collect();
    let mut is_in = vec![false; volume.values.len()];
    for index in order {
        is_in[index] = true;
        for next in neighbours(volume, index) {
            if is_in[next] {
                let (a, b) = (root(&mut parent, index), root(&mut parent, next));
                parent[a] = b;
            }
        }
        if is_in[from] && is_in[to] && root(&mut parent, from) == root(&mut parent, to) {
            return volume.values[index];
        }
    }
    0.0
}

/// The 26 neighbours of a voxel, as far as they lie in the volume.
fn neighbours(volume: &Volume, index: usize) -> impl Iterator<Item = usize> {
    let at = volume.voxel(index);
    (0..27usize).filter(|n| *n != 13).filter_map(move |n| {
        let step = [n % 3, n / 3 % 3, n / 9];
        let next: [usize; 3] = std::array::from_fn(|axis| (at[axis] + step[axis]).wrapping_sub(1));
        next.iter().zip(volume.size).all(|(at, size)| *at < size).then(|| volume.index(next))
    })
}

/// Root of a voxel's connected component, with path halving.
fn root(parent: &mut [usize], mut index: usize) -> usize {
    while parent[index] != index {
        parent[index] = parent[parent[index]];
        index = parent[index];
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(values: &[f32]) -> Volume {
        Volume { origin_m: DVec3::ZERO, voxel_m: 0.1, size: [values.len(), 1, 1], values: values.to_vec() }
    }

    #[test]
    fn dip_is_that_of_the_highest_path_between_the_peaks() {
        let points = [DVec3::new(0.15, 0.05, 0.05), DVec3::new(0.65, 0.05, 0.05)];
        let of = |values: &[f32]| PeakSeparation::of(&line(values), [&points[..1], &points[1..]]);
        let apart = of(&[0.0, 4.0, 3.0, 1.0, 2.0, 2.2, 2.5, 0.0]).unwrap();
        assert!((apart.weaker - 0.625).abs() < 1e-6 && (apart.dip - 0.6).abs() < 1e-6, "{apart:?}");
        assert!(apart.is_resolved());
        // On the slope of the other peak it has no peak of its own.
        let slope = of(&[0.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0, 0.0]).unwrap();
        assert!(slope.dip == 0.0 && !slope.is_resolved());
        assert_eq!(of(&[0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), None);
        // A path through the second layer avoids the gap.
        let around = Volume { size: [4, 2, 1], values: vec![4.0, 0.0, 0.0, 4.0, 0.0, 3.0, 3.0, 0.0], ..line(&[]) };
        let ends = [DVec3::new(0.05, 0.05, 0.05), DVec3::new(0.35, 0.05, 0.05)];
        assert!((PeakSeparation::of(&around, [&ends[..1], &ends[1..]]).unwrap().dip - 0.25).abs() < 1e-6);
    }
}
