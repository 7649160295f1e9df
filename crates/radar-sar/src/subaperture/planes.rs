//! The sub-aperture statistic over planes: walls, floor and ceiling, which a radar sees as specular
//! reflectors.
//!
//! A plane is a unit normal u and an offset; its range from sensor position p is offset − u·p. The
//! specular point moves with the head, a point reflector does not. Walls are upright (horizontal
//! normals at any yaw), floor and ceiling are level.

use glam::DVec3;
use rayon::prelude::*;

use super::{MEAN_LOG_OF_NOISE, ParallelPlanes, Subaperture, SubapertureSettings};
use crate::geometry::Plane;
use crate::math;

/// Directions of upright planes, evenly spaced in yaw. Choice: half a step, 0.75°, moves an echo by
/// ±0.6 mm (±90° of phase) over the 9 cm of a sub-aperture at 1 m/s.
const YAW_STEPS: usize = 240;
/// Distance between offsets, metres. Choice: that between voxels, half of the 14 cm pulse.
const OFFSET_STEP_M: f64 = 0.065;
/// Offsets held, from −`OFFSET_HALF`·step to +: ±6 m around the field's first sensor position.
/// Choice: a room of 12 m.
const OFFSET_HALF: i32 = 93;

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    a: f32,
    b: f32,
    seen_s: f32,
    /// Sub-apertures that had the plane in the beam.
    blocks: u32,
}

/// A local maximum over planes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePeak {
    /// The plane.
    pub plane: Plane,
    /// A/√B.
    pub score: f64,
    /// Sub-apertures that had it in the beam.
    pub blocks: u32,
}

/// Scores over planes.
#[derive(Debug)]
pub struct PlaneField {
    settings: SubapertureSettings,
    min_cos: f64,
    start_ns: Option<i64>,
    /// Offsets are counted from the plane through this point.
    origin: DVec3,
    directions: Vec<DVec3>,
    /// `[direction][offset]`.
    cells: Vec<Vec<Cell>>,
}

impl PlaneField {
    /// Empty. `min_cos`: cosine of the widest angle in the beam.
    pub fn new(settings: SubapertureSettings, min_cos: f64) -> Self {
        let yaw = |n: usize| std::f64::consts::TAU * n as f64 / YAW_STEPS as f64;
        let level = (0..YAW_STEPS).map(|n| DVec3::new(math::sin(yaw(n)), 0.0, -math::cos(yaw(n))));
        let directions: Vec<DVec3> = level.chain([DVec3::NEG_Y, DVec3::Y]).collect();
        let cells = vec![vec![Cell::default(); 2 * OFFSET_HALF as usize + 1]; directions.len()];
        Self { settings, min_cos, start_ns: None, origin: DVec3::ZERO, directions, cells }
    }

    /// Adds a sub-aperture to every plane in its beam.
    pub fn add(&mut self, block: &Subaperture) {
        if self.start_ns.is_none() {
            self.origin = block.middle.translation;
        }
        let start_ns = *self.start_ns.get_or_insert(block.mid_time_ns);
        let now_s = ((block.mid_time_ns - start_ns) as f64 * 1e-9) as f32;
        let decay_s = self.settings.decay_s as f32;
        let (origin, min_cos) = (self.origin, self.min_cos);
        // Walls are strong, so they are followed half a metre beyond the range used for obstacles.
        let max_range_m = self.settings.max_range_m + 0.5;
        let settings = SubapertureSettings { max_range_m, ..self.settings }.within(&block.geometry().axis);
        self.cells.par_iter_mut().zip(&self.directions).for_each(|(cells, &toward)| {
            if toward.dot(block.middle.forward()) < min_cos {
                return;
            }
            let base_m = toward.dot(origin - block.middle.translation);
            // A head may have leapt further away than an i32 counts steps.
            let index = |range_m: f64| (((range_m - base_m) / OFFSET_STEP_M) as i32).saturating_add(OFFSET_HALF);
            let first = index(settings.min_range_m).clamp(0, 2 * OFFSET_HALF + 1) as usize;
            let beyond = index(settings.max_range_m).clamp(0, 2 * OFFSET_HALF + 1) as usize;
            let planes = ParallelPlanes {
                toward: toward.as_vec3().to_array(),
                first_m: (base_m + offset_m(first as i32 - OFFSET_HALF)) as f32,
                step_m: OFFSET_STEP_M as f32,
                count: beyond.saturating_sub(first),
            };
            for (cell, coherence) in cells[first..].iter_mut().zip(block.coherence_of_parallel_planes(&planes)) {
                cell.add(coherence.m, now_s, decay_s);
            }
        });
    }

    /// Planes of at least that score, seen by at least `min_blocks` sub-apertures and since
    /// `since_ns`. Each is the greatest within 10° and 20 cm. In order of falling score.
    pub fn peaks(&self, min_score: f64, min_blocks: u32, since_ns: i64) -> Vec<PlanePeak> {
        let since_s = self.start_ns.map_or(0.0, |start| (since_ns - start) as f64 * 1e-9) as f32;
        let mut found = Vec::new();
        for (cells, &outward) in self.cells.iter().zip(&self.directions) {
            for (n, cell) in cells.iter().enumerate() {
                if cell.blocks < min_blocks || cell.seen_s < since_s {
                    continue;
                }
                let score = if cell.b > 0.0 { f64::from(cell.a / cell.b.sqrt()) } else { 0.0 };
                if score >= min_score {
                    let offset_m = outward.dot(self.origin) + offset_m(n as i32 - OFFSET_HALF);
                    let plane = Plane { outward, offset_m };
                    found.push(PlanePeak { plane, score, blocks: cell.blocks });
                }
            }
        }
        found.sort_by(|p, q| q.score.total_cmp(&p.score));
        let mut peaks: Vec<PlanePeak> = Vec::new();
        for candidate in found {
            let near = |p: &PlanePeak| {
                p.plane.outward.dot(candidate.plane.outward) > math::cos(10f64.to_radians())
                    && (p.plane.offset_m - candidate.plane.offset_m).abs() < 0.2
            };
            if !peaks.iter().any(near) {
                peaks.push(candidate);
            }
        }
        peaks
    }
}

fn offset_m(steps: i32) -> f64 {
    f64::from(steps) * OFFSET_STEP_M
}

impl Cell {
    fn add(&mut self, m: f32, now_s: f32, decay_s: f32) {
        let rho = math::exp(-(now_s - self.seen_s) / decay_s);
        self.a = rho * self.a + math::ln_1p(m) - MEAN_LOG_OF_NOISE as f32;
        self.b = rho * rho * self.b + 1.0;
        self.seen_s = now_s;
        self.blocks += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Beam;
    use crate::subaperture::SubapertureBuilder;
    use crate::test_data::{Echo, on_one_thread, sweeps, winding};

    fn peaks(wall: Option<Plane>, seed: u64) -> Vec<PlanePeak> {
        let settings = SubapertureSettings::default();
        let mut field = PlaneField::new(settings, settings.min_cos(&Beam::Lensless));
        let mut builder = SubapertureBuilder::new(settings);
        let echoes: Vec<_> = wall.map(|wall| (Echo::Plane(wall), 5.0)).into_iter().collect();
        let observations = sweeps(1.5, winding, &echoes, seed);
        observations.into_iter().filter_map(|o| builder.push(o)).for_each(|block| field.add(&block));
        field.peaks(6.0, 13, 0)
    }

    #[test]
    fn a_wall_has_its_offset_and_direction() {
        let yaw = 0.21f64;
        let wall = Plane { outward: DVec3::new(yaw.sin(), 0.0, -yaw.cos()), offset_m: 1.83 };
        let found = peaks(Some(wall), 1);
        let best = found[0].plane;
        assert!((best.offset_m - wall.offset_m).abs() < 0.05, "{best:?}");
        assert!(best.outward.dot(wall.outward) > 6f64.to_radians().cos(), "{best:?}");
        assert_eq!(on_one_thread(|| peaks(Some(wall), 1)), found);
    }

    #[test]
    fn noise_gives_no_planes() {
        assert_eq!(peaks(None, 2), []);
    }
}
