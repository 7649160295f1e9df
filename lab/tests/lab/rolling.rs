//! The rolling image over very many sweeps with bursts: as exact at the end as at the start. With
//! `RADAR_CHAPERONE_LONG=1` a million sweeps, in minutes.

#[allow(dead_code)]
#[path = "../../../crates/radar-mapping/tests/stability/cases.rs"]
mod cases;

use std::sync::Arc;

use radar_sar::Statistic;
use radar_sar::backprojection::{BrickGrid, RollingImage, RollingSettings, dense_volume};

use crate::quick_or_long;
use cases::{Case, Damage, NOISE_LSB, PATHS, cases, sound, sweeps};

/// Pushes sweeps in a cycle and compares the image at intervals with the dense one of its window,
/// bit for bit.
fn roll(case: &Case, statistic: Statistic, count: usize, compare_every: usize) {
    let observations: Vec<_> = PATHS[..6].iter().flat_map(|path| sweeps(case, path, 83, 5)).collect();
    let grid = BrickGrid::covering(&case.region(), 2.0 * case.voxel_m);
    let settings =
        RollingSettings { statistic, window: 12, min_sweeps: 6, noise_rms_lsb: NOISE_LSB, ..Default::default() };
    let geometries = [Arc::clone(&observations[0].geometry)];
    // The paths' geometries are equal, but separate allocations.
    let mut image = RollingImage::new(settings, &case.beam, &geometries, &grid).unwrap();
    let (mut compared, mut shown) = (0, 0);
    for (n, observation) in observations.iter().cycle().take(count).enumerate() {
        let taken = image.push(observation).is_ok();
        assert_eq!(taken, !sound(std::slice::from_ref(observation)).is_empty(), "{} sweep {n}", case.name);
        if image.work().sweeps < 6 || (n % compare_every != 0 && n + 40 < count) {
            continue;
        }
        let what = format!("{} / {} / sweep {n}", case.name, statistic.name());
        assert!(image.is_complete(), "{what}: the image is not complete");
        let (dense, threshold) = (dense_volume(image.stack(), &grid).volume, image.threshold());
        let wanted: Vec<_> = dense.values.iter().copied().enumerate().filter(|v| v.1 >= threshold).collect();
        assert_eq!(image.voxels(), wanted, "{what}, threshold {threshold}");
        assert!(threshold.is_finite() && dense.values.iter().all(|v| v.is_finite()), "{what}");
        compared += 1;
        shown += usize::from(!wanted.is_empty());
    }
    assert!(compared > 20, "{}: compared {compared} times", case.name);
    // Nothing exceeds the threshold where all samples are alike, or where the beam is cut off.
    let silent = case.damage != Damage::None || case.snr_db < 5.0 || case.name.contains("off the boresight");
    assert!(silent || shown > 0, "{} / {}: no voxel ever exceeded the threshold", case.name, statistic.name());
    assert_eq!(image.work().sweeps + image.work().refused, count as u64);
}

fn case(damage: Damage) -> Case {
    cases().into_iter().find(|case| case.damage == damage && case.snr_db == 20.0).unwrap()
}

#[test]
fn rolling_image_stays_exact_over_a_million_sweeps_with_bursts() {
    roll(&case(Damage::Bursts), Statistic::Ls, quick_or_long(3_000, 1_000_000), quick_or_long(29, 997));
    roll(&case(Damage::Bursts), Statistic::Log, quick_or_long(3_000, 1_000_000), quick_or_long(29, 997));
}

#[test]
fn rolling_image_matches_dense_in_every_case() {
    for case in cases() {
        for statistic in [Statistic::Ls, Statistic::Log] {
            roll(&case, statistic, quick_or_long(300, 6_000), 17);
        }
    }
}

#[test]
fn windows_of_any_length_accept_saturated_sweeps() {
    let case = case(Damage::Saturated);
    let observations = sweeps(&case, &PATHS[0], 300, 6);
    let geometries = [Arc::clone(&observations[0].geometry)];
    let grid = BrickGrid::covering(&case.region(), case.voxel_m);
    for window in [1, 2, 3, 7, 40, 127, 255] {
        let settings = RollingSettings { window, min_sweeps: 1, noise_rms_lsb: 1e-3, ..Default::default() };
        let mut image = RollingImage::new(settings, &case.beam, &geometries, &grid).unwrap();
        for (n, observation) in observations.iter().enumerate() {
            image.push(observation).unwrap();
            if n % 23 == 0 || n + 1 == observations.len() {
                let (dense, threshold) = (dense_volume(image.stack(), &grid).volume, image.threshold());
                let wanted: Vec<_> = dense.values.iter().copied().enumerate().filter(|v| v.1 >= threshold).collect();
                assert_eq!(image.voxels(), wanted, "window {window}, sweep {n}");
                assert!(!wanted.is_empty(), "window {window}, sweep {n}: no voxel exceeds the threshold");
            }
        }
    }
}
