//! Point sources: the diffuse share of surfaces as points on a jittered grid, and small fittings.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use radar_sar::math;

use crate::world::{Corner, Panel, Tube};

/// Share of the field that a fitting returns to behind its lobe: −15 dB. Choice: as in the room of point
/// scatterers; no part of furniture vanishes entirely from behind.
const FITTING_BACK: f64 = 0.178;
/// Ends of thinner tubes return nothing worth mentioning, metres. Choice: −51 dBsm and less, of metal.
const MIN_END_RADIUS_M: f64 = 1.5e-3;
/// Largest extent of a cluster, metres. Choice: small enough that range and beam exclude most clusters.
const CLUSTER_M: f64 = 0.8;

/// How a point's echo depends on the direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Lobe {
    /// Lambert's law: √σ falls with the cosine from the surface's normal, nothing behind it.
    Lambert(DVec3),
    /// A fitting that reflects best to one side: −8 dB at 90°, −15 dB behind.
    Fitting(DVec3),
    /// To all sides alike.
    Isotropic,
}

impl Lobe {
    /// Field towards a direction (unit vector from the point), against that at the lobe's centre.
    pub fn towards(&self, direction: DVec3) -> f64 {
        match self {
            Self::Lambert(normal) => normal.dot(direction).max(0.0),
            Self::Fitting(axis) => {
                let half = 0.5 * (1.0 + axis.dot(direction));
                FITTING_BACK + (1.0 - FITTING_BACK) * half * half
            }
            Self::Isotropic => 1.0,
        }
    }
}

/// A point source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PointSource {
    pub position_m: DVec3,
    pub lobe: Lobe,
    /// √σ at the lobe's centre, m.
    pub root_sigma_m: f64,
    pub phase_rad: f64,
}

/// Neighbouring point sources, excluded together where range, beam or strength exclude all.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cluster {
    pub center_m: DVec3,
    pub radius_m: f64,
    pub max_root_sigma_m: f64,
    /// Of a plane surface: nothing is seen from behind.
    pub normal: Option<DVec3>,
    pub points: std::ops::Range<usize>,
}

/// Points by cluster.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct PointCloud {
    pub points: Vec<PointSource>,
    pub clusters: Vec<Cluster>,
}

impl PointCloud {
    /// Adds the diffuse points of a panel's reflecting sides.
    ///
    /// A Lambertian surface of albedo ρ has σ = 4 ρ cos²θ per area (Ulaby and Long, Microwave Radar and
    /// Radiometric Remote Sensing: radiance ρ/π of the irradiance cos θ, times 4π, projected by cos θ); a point
    /// stands for its cell of the grid, so the mean power does not depend on the spacing. The power is multiplied by
    /// `factor`.
    pub fn add_surface(&mut self, panel: &Panel, spacing_m: f64, factor: f64, rng: &mut ChaCha8Rng) {
        let sides = if panel.two_sided { [1.0, -1.0].as_slice() } else { [1.0].as_slice() };
        let (half_u, half_v) = (panel.half_u_m, panel.half_v_m);
        let parts = |half: DVec3| (2.0 * half.length() / CLUSTER_M).ceil().max(1.0) as usize;
        let (across, along) = (parts(half_u), parts(half_v));
        for side in sides {
            for (i, j) in (0..across).flat_map(|i| (0..along).map(move |j| (i, j))) {
                let at = |n: usize, of: usize| (2 * n + 1) as f64 / of as f64 - 1.0;
                let tile = Panel {
                    center_m: panel.center_m + half_u * at(i, across) + half_v * at(j, along),
                    half_u_m: half_u / across as f64,
                    half_v_m: half_v / along as f64,
                    ..*panel
                };
                self.add_tile(&tile, *side * panel.normal(), spacing_m, factor, rng);
            }
        }
    }

    fn add_tile(&mut self, tile: &Panel, normal: DVec3, spacing_m: f64, factor: f64, rng: &mut ChaCha8Rng) {
        let steps = |half: DVec3| (2.0 * half.length() / spacing_m).round().max(1.0) as usize;
        let (across, along) = (steps(tile.half_u_m), steps(tile.half_v_m));
        let cell_m2 = tile.area_m2() / (across * along) as f64;
        let root_sigma_m = (4.0 * factor * tile.material.diffuse() * cell_m2).sqrt();
        let first = self.points.len();
        for (i, j) in (0..across).flat_map(|i| (0..along).map(move |j| (i, j))) {
            let mut at = |n: usize, of: usize| 2.0 * (n as f64 + rng.random_range(0.0..1.0)) / of as f64 - 1.0;
            let position_m = tile.center_m + tile.half_u_m * at(i, across) + tile.half_v_m * at(j, along);
            let phase_rad = rng.random_range(0.0..TAU);
            self.points.push(PointSource { position_m, lobe: Lobe::Lambert(normal), root_sigma_m, phase_rad });
        }
        self.clusters.push(Cluster {
            center_m: tile.center_m,
            radius_m: (tile.half_u_m + tile.half_v_m).length(),
            max_root_sigma_m: root_sigma_m,
            normal: Some(normal),
            points: first..self.points.len(),
        });
    }

    /// Adds the fittings of an object as one cluster.
    pub fn add_fittings(&mut self, fittings: &[Corner], rng: &mut ChaCha8Rng) {
        let first = self.points.len();
        self.points.extend(fittings.iter().map(|fitting| PointSource {
            position_m: fitting.position_m,
            lobe: if fitting.lobe == DVec3::ZERO { Lobe::Isotropic } else { Lobe::Fitting(fitting.lobe) },
            root_sigma_m: math::powf(10f64, fitting.rcs_dbsm / 20.0),
            phase_rad: rng.random_range(0.0..TAU),
        }));
        self.close_cluster(first);
    }

    /// Adds the ends and bends of an object's tubes as one cluster: as rounded as a sphere of the tube's radius, whose
    /// cross-section is π a² γ (geometrical optics; Physics).
    pub fn add_tube_ends(&mut self, tubes: &[Tube], rng: &mut ChaCha8Rng) {
        let first = self.points.len();
        for tube in tubes.iter().filter(|tube| tube.radius_m >= MIN_END_RADIUS_M) {
            let root_sigma_m = tube.radius_m * (PI * tube.material.specular()).sqrt();
            for (position_m, outward) in [(tube.ends_m[0], -tube.axis()), (tube.ends_m[1], tube.axis())] {
                let phase_rad = rng.random_range(0.0..TAU);
                self.points.push(PointSource { position_m, lobe: Lobe::Fitting(outward), root_sigma_m, phase_rad });
            }
        }
        self.close_cluster(first);
    }

    /// Makes the points from `first` on a cluster.
    fn close_cluster(&mut self, first: usize) {
        let points = &self.points[first..];
        if points.is_empty() {
            return;
        }
        let center_m = points.iter().map(|p| p.position_m).sum::<DVec3>() / points.len() as f64;
        let radius_m = points.iter().map(|p| p.position_m.distance(center_m)).fold(0.0, f64::max);
        let max_root_sigma_m = points.iter().map(|p| p.root_sigma_m).fold(0.0, f64::max);
        let points = first..self.points.len();
        self.clusters.push(Cluster { center_m, radius_m, max_root_sigma_m, normal: None, points });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::material::TEXTILE;
    use num_complex::Complex64;
    use rand::SeedableRng;

    fn surface(spacing_m: f64, seed: u64) -> PointCloud {
        let (half_u_m, half_v_m) = (DVec3::X * 0.2, DVec3::Y * 0.25);
        let panel = Panel { center_m: DVec3::ZERO, half_u_m, half_v_m, material: TEXTILE, two_sided: false };
        let mut cloud = PointCloud::default();
        cloud.add_surface(&panel, spacing_m, 1.0, &mut ChaCha8Rng::seed_from_u64(seed));
        cloud
    }

    /// Power of the coherent sum, averaged over sensor positions and seeds.
    fn mean_power(spacing_m: f64) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..80 {
            let cloud = surface(spacing_m, seed);
            for n in 0..25 {
                let sensor = DVec3::new(0.1 * f64::from(n % 5) - 0.2, 0.1 * f64::from(n / 5) - 0.2, 1.5);
                let field: Complex64 = cloud
                    .points
                    .iter()
                    .map(|p| {
                        let to = sensor - p.position_m;
                        let amplitude = p.root_sigma_m * p.lobe.towards(to.normalize()) / to.length_squared();
                        math::from_polar(amplitude, radar_sar::PHASE_RAD_PER_M * to.length() + p.phase_rad)
                    })
                    .sum();
                sum += field.norm_sqr();
                count += 1.0;
            }
        }
        sum / count
    }

    #[test]
    fn mean_power_of_a_rough_surface_is_lamberts_and_independent_of_the_spacing() {
        let powers = [0.025, 0.05, 0.1].map(mean_power);
        for power in powers {
            // 0.2 m² at 1.5 m, nearly face-on: 4 ρ A cos²θ/d⁴, both averaged over the surface.
            let expected = 4.0 * TEXTILE.diffuse() * 0.2 / 1.5f64.powi(4);
            let off_db = 10.0 * (power / expected).log10();
            assert!((-0.9..0.2).contains(&off_db), "{off_db} dB");
            assert!((10.0 * (power / powers[1]).log10()).abs() < 0.4, "{powers:?}");
        }
    }

    #[test]
    fn rough_surface_is_dark_from_behind_and_fills_its_tile() {
        let cloud = surface(0.05, 1);
        assert_eq!(cloud.points.len(), 80);
        assert!(cloud.points.iter().all(|p| p.lobe.towards(DVec3::NEG_Z) == 0.0));
        let cluster = &cloud.clusters[0];
        assert!(cloud.points.iter().all(|p| p.position_m.distance(cluster.center_m) <= cluster.radius_m));
    }

    #[test]
    fn fitting_falls_off_from_its_axis() {
        let db = |direction: DVec3| 20.0 * Lobe::Fitting(DVec3::Z).towards(direction).log10();
        assert_eq!(db(DVec3::Z), 0.0);
        assert!((db(DVec3::X) + 8.3).abs() < 0.1 && (db(DVec3::NEG_Z) + 15.0).abs() < 0.1);
    }
}
