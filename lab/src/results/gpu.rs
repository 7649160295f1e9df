//! The page of dense volumes on the graphics card beside the processor.

use std::process::Command;
use std::time::Instant;

use a121::preset;
use anyhow::{Context, Result};
use glam::DVec3;

use super::{Extent, Page};
use radar_chaperone::gpu_imaging::{GpuImager, GpuWork};
use radar_chaperone::report::Table;
use radar_mapping::{ObserverSettings, observe_all};
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::Aabb;
use radar_sar::subaperture::{FineImage, SubapertureBuilder, SubapertureSettings, fine_image};
use radar_sar::{Beam, HistorySettings, Observation, Statistic, Volume, subaperture_volume};
use radar_simulation::Scenario;

/// The peer, in the checkout that this program was built from.
const TORCHBP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/torchbp_speed.py");
/// Times each work is repeated; the shortest counts.
const REPEATS: usize = 3;
const BEAM: Beam = Beam::Lensless;

pub(super) fn page(extent: Extent) -> Result<Page> {
    let begin = Instant::now();
    let mut imager = GpuImager::open()?;
    let opening_ms = begin.elapsed().as_secs_f64() * 1e3;
    let all = sweeps(extent.choose(10.0, 1.0))?;
    let (edge, some) = extent.choose((128, 100), (32, 20));
    let mut rows = Vec::new();
    for statistic in Statistic::ALL.into_iter().filter(|s| *s != Statistic::Subaperture) {
        rows.push(volumes(&mut imager, statistic, &spread(&all, some), edge)?);
    }
    let of_a_second = &all[..all.len().min(extent.choose(600, 200))];
    rows.push(volumes(&mut imager, Statistic::Subaperture, of_a_second, edge / 2)?);
    if !imager.is_software() && extent == Extent::Full {
        for statistic in [Statistic::Ls, Statistic::Coherent] {
            rows.push(volumes(&mut imager, statistic, &spread(&all, 1000), 256)?);
        }
    }
    rows.push(fine_images(&mut imager, of_a_second, extent.choose(64, 16))?);
    let software = if imager.is_software() { ", a software renderer on the same processor" } else { "" };
    Ok(Page::new("Volumes on the graphics card", "")
        .text(&format!(
            "`reconstruct --device gpu` on {}{software}, beside the processor's own kernels on all of its threads: a \
             simulated furnished room in natural play, preset d16, a cube of 3 m around the sensor. Times from \
             observations to the volume in memory, tables and transfers included, the shortest of {REPEATS}. The \
             processor skips sweeps that do not see a brick; the card does not. Updates are (voxel, sweep) pairs of the \
             whole volume. Opening the card took {opening_ms:.0} ms, once.",
            imager.adapter_name()
        ))
        .table(&table(rows))
        .text(
            "Card: from observations to the volume; kernel: the sum of the dispatches. Longest dispatch: how long another \
             program, such as a game, had to wait for the card at most. Difference: the 99.9th percentile over voxels, in \
             shares of the peak; a voxel at an edge of range or beam may count a sweep differently, and the \
             processor's fine image follows a sub-aperture's motion by a polynomial.",
        )
        .heading("A public backprojector on the same card")
        .text(&peer(extent)))
}

fn table(rows: Vec<Vec<String>>) -> Table {
    let head = [
        "work",
        "processor, s",
        "card, s",
        "ratio",
        "card, G updates/s",
        "kernel, G updates/s",
        "longest dispatch, ms",
        "difference",
    ];
    Table { head: head.map(str::to_owned).to_vec(), rows, caption: String::new() }
}

fn sweeps(duration_s: f64) -> Result<Vec<Observation>> {
    let scenario =
        Scenario::new("furnished-room", "natural", preset("d16").context("d16 is a preset")?, duration_s, 500);
    let simulated = scenario.run()?;
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
        range_bias_m: None,
    };
    Ok(observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses).0)
}

/// So many sweeps, spread over the whole time.
fn spread(all: &[Observation], count: usize) -> Vec<Observation> {
    let count = count.min(all.len());
    (0..count).map(|n| all[n * all.len() / count].clone()).collect()
}

/// A cube of so many voxels along each edge.
fn cube(sweeps: &[Observation], half_m: f64, edge: usize) -> (Aabb, f64) {
    let middle = sweeps[sweeps.len() / 2].tracking_from_sensor;
    let at = if half_m < 1.0 { middle.translation + 1.2 * middle.forward() } else { middle.translation };
    (Aabb { min: at - half_m, max: at + DVec3::splat(half_m) }, 2.0 * half_m / edge as f64)
}

/// The shortest time of some work, and its last result.
fn timed<T>(mut work: impl FnMut() -> Result<T>) -> Result<(f64, T)> {
    let mut run = || {
        let begin = Instant::now();
        let done = work()?;
        Ok::<_, anyhow::Error>((begin.elapsed().as_secs_f64(), done))
    };
    let (mut shortest_s, mut last) = run()?;
    for _ in 1..REPEATS {
        let (seconds, done) = run()?;
        (shortest_s, last) = (shortest_s.min(seconds), done);
    }
    Ok((shortest_s, last))
}

fn volumes(imager: &mut GpuImager, statistic: Statistic, sweeps: &[Observation], edge: usize) -> Result<Vec<String>> {
    let (region, voxel_m) = cube(sweeps, 1.5, edge);
    let settings = SubapertureSettings::default();
    let (processor_s, expected) = timed(|| {
        if statistic == Statistic::Subaperture {
            return Ok(subaperture_volume(sweeps, &BEAM, &settings, &region, voxel_m));
        }
        let grid = BrickGrid::covering(&region, voxel_m);
        let (stack, _) = SweepStack::of(statistic, &BEAM, sweeps, grid.middle_m());
        Ok(dense_volume(&stack, &grid).volume)
    })?;
    let mut fastest: Option<GpuWork> = None;
    let (card_s, found) = timed(|| {
        let found = imager.volume(statistic, &BEAM, &settings, sweeps, &region, voxel_m)?;
        if fastest.is_none_or(|work| found.work.sum_s < work.sum_s) {
            fastest = Some(found.work);
        }
        Ok(found)
    })?;
    let work = fastest.unwrap_or_default();
    let what = format!("{}, {edge}³ × {}", statistic.name(), sweeps.len());
    Ok(row(what, [processor_s, card_s], Some((work, found.updates)), &[(&expected, &found.volume)]))
}

fn fine_images(imager: &mut GpuImager, sweeps: &[Observation], edge: usize) -> Result<Vec<String>> {
    let (region, voxel_m) = cube(sweeps, 0.2, edge);
    let settings = SubapertureSettings::default();
    let per_aperture = 4;
    let none = || FineImage {
        coherent: Volume::covering(&region, voxel_m),
        incoherent: Volume::covering(&region, voxel_m),
        apertures: 0,
    };
    let (processor_s, expected) = timed(|| {
        let mut builder = SubapertureBuilder::new(settings);
        let mut blocks: Vec<_> = sweeps.iter().filter_map(|o| builder.push(o.clone())).collect();
        blocks.extend(builder.close());
        let blocks: Vec<_> = blocks.iter().collect();
        Ok(fine_image(&blocks, &region, voxel_m, per_aperture).unwrap_or_else(none))
    })?;
    let (card_s, found) = timed(|| {
        let found = imager.fine_image(&settings, sweeps, &region, voxel_m, per_aperture)?;
        Ok(found.unwrap_or_else(none))
    })?;
    let pairs = [(&expected.coherent, &found.coherent), (&expected.incoherent, &found.incoherent)];
    let what = format!("fine image, {edge}³ × {} in {} apertures", sweeps.len(), found.apertures);
    Ok(row(what, [processor_s, card_s], None, &pairs))
}

fn row(
    what: String,
    [processor_s, card_s]: [f64; 2],
    work: Option<(GpuWork, u64)>,
    pairs: &[(&Volume, &Volume)],
) -> Vec<String> {
    let per_s = |updates: u64, seconds: f64| format!("{:.2}", updates as f64 / seconds * 1e-9);
    let of_work = work.map(|(work, updates)| {
        [per_s(updates, card_s), per_s(updates, work.sum_s), format!("{:.1}", work.longest_s * 1e3)]
    });
    let difference = pairs.iter().map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
    let mut cells =
        vec![what, format!("{processor_s:.4}"), format!("{card_s:.4}"), format!("{:.1}", processor_s / card_s)];
    cells.extend(of_work.unwrap_or_else(|| ["–", "–", "–"].map(str::to_owned)));
    cells.push(format!("{difference:.1e}"));
    cells
}

/// The 99.9th percentile of |a − b|, in shares of the greatest value.
fn difference(a: &Volume, b: &Volume) -> f64 {
    let peak = a.peak().map_or(1.0, |(_, value)| value);
    let mut differences: Vec<f32> = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs()).collect();
    differences.sort_by(f32::total_cmp);
    f64::from(differences[(differences.len() - 1) * 999 / 1000] / peak)
}

/// What torchbp reaches, or why it was not measured.
fn peer(extent: Extent) -> String {
    let (pixels, sweeps, samples) = extent.choose((4096, 1000, 600), (64, 10, 100));
    let size = [pixels, sweeps, samples].map(|n| n.to_string());
    let what = format!("torchbp's `backprojection_cart_2d`, {pixels}² × {sweeps} (lab/peers/torchbp_speed.py)");
    match Command::new("python3").arg(TORCHBP).args(size).output() {
        Ok(done) if done.status.success() => {
            let per_s = String::from_utf8_lossy(&done.stdout).trim().parse::<f64>().unwrap_or(f64::NAN);
            format!("{what}: {per_s:.1} G updates/s, without weights, beam and motion during the sweep.")
        }
        Ok(done) => {
            let text = String::from_utf8_lossy(&done.stderr);
            format!("Not measured: {what} ended with \"{}\".", text.lines().last().unwrap_or("no message"))
        }
        Err(error) => format!("Not measured: {what} needs python3: {error}."),
    }
}
