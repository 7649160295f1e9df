//! Dense volumes, searches and compressed sweeps against the oracle.

use std::sync::Arc;

use a121::Profile;
use glam::DVec3;
use num_complex::Complex64;
use radar_sar::backprojection::{BrickGrid, SweepStack, Threshold, dense_volume, search};
use radar_sar::subaperture::SubapertureSettings;
use radar_sar::{Beam, Observation, envelope};
use radar_sar::{Oracle, RangeCompressor, Statistic, Volume};
use rayon::prelude::*;

use crate::cases::{Case, Damage, PATHS, Path, cases, rows, sound, sweeps};
use crate::{agrees, quick_or_long};

/// Tolerance of `dense_volume` as a share of the volume's peak.
const SHARE: f64 = 5e-3;
/// Largest step of its tables, metres. Nearer to a sensor D is held constant; beyond, it is linear
/// between steps.
const TABLE_STEP_M: f64 = 5e-3;

/// Whether a point is so near to an edge of some sweep's range or beam that it may count on one
/// side only, or to a change of the nearest sample (`thesis`), or so near to a sensor that D is
/// held constant.
fn at_an_edge(place: DVec3, observations: &[Observation], beam: &Beam, statistic: Statistic) -> bool {
    observations.iter().any(|o| {
        let (d, axis) = (o.distance_m(place), &o.geometry.axis);
        let near = |border: f64| (d - border).abs() < 1e-4;
        let angle = o.cos_off_boresight(place).clamp(-1.0, 1.0).acos();
        let lit = |turn_deg: f64| {
            beam.amplitude((angle + turn_deg.to_radians()).clamp(0.0, std::f64::consts::PI).cos()) > 0.0
        };
        let jump = (axis.point_at(d) - 0.5).round() + 0.5;
        let jumps = statistic == Statistic::Thesis && near(axis.range_m(0) + jump * axis.step_m);
        jumps || near(axis.first_m) || near(axis.last_m()) || d < TABLE_STEP_M || lit(-0.05) != lit(0.05)
    })
}

/// Relative error of the piecewise linear D, or of the D² that a sum is divided by, at a point:
/// ¾·(step/d)² or 1¼·(step/d)² at the nearest sensor.
fn near_share(place: DVec3, observations: &[Observation], statistic: Statistic) -> f64 {
    let bend = if matches!(statistic, Statistic::Glrt | Statistic::Coherent) { 1.3 } else { 0.8 };
    let nearest = observations.iter().map(|o| o.distance_m(place)).fold(f64::INFINITY, f64::min);
    bend * (TABLE_STEP_M / nearest).powi(2)
}

/// Checks one statistic of one case along one path at every voxel; returns the violations as text.
fn check(case: &Case, path: &Path, observations: &[Observation], statistic: Statistic) -> Vec<String> {
    let what = format!("{} / {} / {}", case.name, path.name, statistic.name());
    let grid = BrickGrid::covering(&case.region(), case.voxel_m);
    let (stack, refused) = SweepStack::of(statistic, &case.beam, observations, grid.middle_m());
    let sound = sound(observations);
    let mut wrong = Vec::new();
    if refused != observations.len() - sound.len() {
        wrong.push(format!("{what}: {refused} sweeps refused of {}", observations.len()));
    }
    let fast = dense_volume(&stack, &grid).volume;
    let oracle = Oracle::new(&sound, &case.beam, &SubapertureSettings::default());
    let place = |index: usize| fast.center(fast.voxel(index));
    let exact: Vec<f64> = (0..fast.values.len()).into_par_iter().map(|n| oracle.value(statistic, place(n))).collect();
    let peak = exact.iter().copied().fold(0.0, f64::max);
    let rounding = if stack.sums_whole_numbers() { 2.0 * stack.step() * (sound.len() as f64).sqrt() } else { 0.0 };
    // Where f32 has no full precision left, each sweep may be off by the smallest normal number.
    let least = f64::from(f32::MIN_POSITIVE) * sound.len() as f64;
    let mut worst = (0.0f64, String::new());
    for (index, (value, exact)) in fast.values.iter().zip(&exact).enumerate() {
        if !value.is_finite() {
            wrong.push(format!("{what} at {}: {value}, oracle {exact}", place(index)));
            break;
        }
        if at_an_edge(place(index), &sound, &case.beam, statistic) {
            continue;
        }
        let allowed = SHARE * peak + near_share(place(index), &sound, statistic) * exact + rounding + least;
        let off = (f64::from(*value) - exact).abs() / allowed;
        if off > worst.0 {
            worst = (off, format!("{what} at {}: {value}, oracle {exact}, peak {peak}", place(index)));
        }
    }
    if worst.0 > 1.0 {
        wrong.push(format!("{} ({:.1} × the tolerance)", worst.1, worst.0));
    }
    wrong.extend(check_search(&what, &stack, &grid, &fast));
    wrong
}

/// The search must give the dense set with its values.
fn check_search(what: &str, stack: &SweepStack, grid: &BrickGrid, dense: &Volume) -> Option<String> {
    for share in [0.95, 0.5] {
        let found = search(stack, grid, Threshold::ShareOfPeak(share));
        let all = dense.values.iter().copied().enumerate();
        let limit = (share * dense.peak().map_or(0.0, |peak| peak.1)).max(f32::MIN_POSITIVE);
        let wanted: Vec<_> = all.filter(|v| v.1 >= limit).collect();
        if found.voxels != wanted {
            return Some(format!("{what}: searched at {share}: {:?} instead of {wanted:?}", found.voxels));
        }
    }
    None
}

#[test]
fn dense_volumes_and_searches_match_the_oracle() {
    let (count, seeds) = quick_or_long((20, 1), (80, 2));
    let mut wrong = Vec::new();
    for (case, path) in rows(&cases()) {
        for seed in 0..seeds {
            let observations = sweeps(case, path, count, seed);
            for statistic in Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture) {
                wrong.extend(check(case, path, &observations, statistic));
            }
        }
    }
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn compressed_sweeps_match_their_definition() {
    let mut wrong = Vec::new();
    for case in cases().iter().filter(|case| !matches!(case.damage, Damage::NotFinite | Damage::Huge)) {
        for observation in sweeps(case, &PATHS[0], quick_or_long(2, 40), 7) {
            let (axis, samples) = (&observation.geometry.axis, &observation.samples);
            let compressed = RangeCompressor::new(&observation.geometry).compress(samples, 1.0);
            let exact = |range_m: f64| {
                let e: Vec<f64> =
                    (0..axis.points).map(|n| envelope(case.pulse_fwhm_m, axis.range_m(n) - range_m)).collect();
                let sum: Complex64 =
                    samples.iter().zip(&e).map(|(x, e)| Complex64::new(x.re.into(), x.im.into()) * e).sum();
                sum / e.iter().map(|e| e * e).sum::<f64>().sqrt()
            };
            let range_m = |n: u32| axis.first_m + (axis.last_m() - axis.first_m) * (f64::from(n) + 0.31) / 200.0;
            let exact: Vec<Complex64> = (0..200).map(|n| exact(range_m(n))).collect();
            let peak = exact.iter().map(|z| z.norm()).fold(0.0, f64::max);
            // The documented tolerance.
            let share = if case.pulse_fwhm_m == Profile::P1.envelope_fwhm_m() { 3e-3 } else { 5e-4 };
            for (n, exact) in (0..200).zip(exact) {
                let (range_m, z) = (range_m(n), compressed.at(range_m(n)));
                if !agrees((z - exact).norm(), 0.0, share * peak + 1e-42) {
                    wrong.push(format!("{} at {range_m} m: {z}, by definition {exact}", case.name));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

/// Index and memory arithmetic hold for as many sweeps as the engine ever keeps.
#[test]
fn search_equals_dense_volume_for_twenty_thousand_sweeps() {
    let case = &cases()[2];
    let few = sweeps(case, &PATHS[1], 500, 3);
    let count = quick_or_long(2_000, 20_000);
    let many: Vec<_> = few.iter().cycle().take(count).cloned().collect();
    assert!(many.iter().all(|o| Arc::ptr_eq(&o.geometry, &many[0].geometry)));
    let grid = BrickGrid::covering(&case.region(), case.voxel_m);
    for statistic in [Statistic::Ls, Statistic::Glrt, Statistic::Coherent] {
        let (stack, refused) = SweepStack::of(statistic, &case.beam, &many, grid.middle_m());
        let dense = dense_volume(&stack, &grid).volume;
        let wrong = check_search(&format!("{count} sweeps / {}", statistic.name()), &stack, &grid, &dense);
        assert_eq!((refused, wrong), (0, None));
        // Each sweep counts as often as it occurs.
        let times = (count / few.len()) as f64;
        let once = Oracle::new(&few, &case.beam, &SubapertureSettings::default());
        let factor = if statistic == Statistic::Ls { times } else { times.sqrt() };
        let (index, peak) = dense.peak().unwrap();
        let exact = factor * once.value(statistic, dense.center(dense.voxel(index)));
        assert!((f64::from(peak) - exact).abs() < SHARE * exact, "{}: {peak}, oracle {exact}", statistic.name());
    }
}
