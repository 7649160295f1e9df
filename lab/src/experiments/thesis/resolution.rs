//! Thesis experiment "resolution and search area": what voxel and cube sizes cost, densely and by
//! branch and bound.

use std::time::Instant;

use glam::DVec3;

use super::imaging_methods::{BEAM, Quality, chosen, locate};
use super::shape_image::close_image;
use super::{ExperimentError, Outcome, Trials, cm, head, mm};
use crate::experiments::trial_recording::{TrialRecording, offset, quantile};
use radar_chaperone::report::{Chart, Picture, Series, Table};
use radar_sar::Observation;
use radar_sar::backprojection::{BrickGrid, SweepStack, Threshold, dense_volume, search};
use radar_sar::geometry::Aabb;
use radar_sar::math;
use radar_sar::{Selection, Statistic};

/// Edges of the voxels and of the searched cubes, metres. Choice: from the thesis' voxel to a
/// thirtieth of the pulse's width; from an arm's reach to a room.
const VOXELS_M: [f64; 5] = [0.1, 0.05, 0.02, 0.01, 0.005];
const CUBES_M: [f64; 4] = [1.0, 2.0, 3.0, 6.0];
/// Edge of the thesis' cube, metres.
const THESIS_CUBE_M: f64 = 3.0;
const STATISTICS: [(Statistic, &str); 2] = [(Statistic::Thesis, "the thesis' sum"), (Statistic::Ls, "least squares")];
const SWEEPS: usize = 50;
/// Volumes with more voxels are not made: at four bytes each, 128 MiB. Choice: larger ones would
/// decide the experiment's memory and time.
const MAX_DENSE_VOXELS: usize = 32 << 20;
/// Volumes with more voxels are made from two recordings only. Choice: run time.
const TWO_RECORDINGS_VOXELS: usize = 4 << 20;

/// Results for one voxel edge and one cube; medians.
#[derive(Debug, Clone, Copy)]
struct Trial {
    cube_m: f64,
    voxel_m: f64,
    voxels: usize,
    /// Run time of the dense volume, seconds; `None`: not made.
    dense_s: Option<f64>,
    /// Run time of every voxel of at least half of the greatest value by branch and bound, seconds.
    image_s: f64,
    /// Run time of the greatest voxel alone, seconds.
    peak_s: f64,
    error_m: f64,
    footprint_l: f64,
    /// Updates and bounds of the image as a share of the dense volume's updates.
    work: f64,
    /// Whether both ways give equal voxels.
    same: bool,
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let recorded = trials.reflector("sphere-50cm", "fine", 10.0)?;
    let mut outcome = Outcome {
        procedure: format!(
            "A reflector observed from within a sphere of 50 cm (preset fine, 40 dB), {SWEEPS} sweeps by farthest \
             point, {} seeds, medians: voxels of 10 cm to 5 mm in cubes of 1 to 6 m, with every voxel summed, and by \
             branch and bound, which evaluates only where the image can reach half of its greatest value. Times are \
             wall times on this machine, range tables included.",
            recorded.len()
        ),
        ..Outcome::default()
    };
    let sweeps: Vec<Vec<Observation>> = recorded.iter().map(|r| chosen(r, SWEEPS, Selection::FarthestPoint)).collect();
    let mut all = Vec::new();
    for (statistic, words) in STATISTICS {
        let mut done = Vec::new();
        for (cube_m, voxel_m) in CUBES_M.iter().flat_map(|cube| VOXELS_M.map(|voxel| (*cube, voxel))) {
            done.push(trial(statistic, cube_m, voxel_m, &recorded, &sweeps));
        }
        outcome.tables.push(table(words, &done));
        outcome.draw(
            format!("time-over-voxels-{}", statistic.name()),
            time_chart(words, &done),
            format!(
                "Run time in the thesis' cube of 3 m, {words}. The dense curve ends where the volume would not \
                fit in 128 MiB."
            ),
        );
        all.push(done);
    }
    outcome.draw(
        "error-over-voxels",
        error_chart(&all),
        "Median distance from the greatest voxel to the truth in the cube of 3 m.",
    );
    let sharp = sub_aperture_litres(trials)?;
    let refined: Vec<f64> = recorded
        .iter()
        .zip(&sweeps)
        .map(|(r, s)| locate(s, r.seed).0.map_or(f64::INFINITY, |refined| refined.position_m.distance(r.truth_m)))
        .collect();
    findings(&mut outcome, &all[0], &all[1], quantile(&refined, 0.5), sharp);
    Ok(outcome)
}

fn trial(
    statistic: Statistic,
    cube_m: f64,
    voxel_m: f64,
    recorded: &[TrialRecording],
    sweeps: &[Vec<Observation>],
) -> Trial {
    let (mut dense, mut image, mut peak) = (Vec::new(), Vec::new(), Vec::new());
    let (mut errors, mut footprints, mut work) = (Vec::new(), Vec::new(), Vec::new());
    let (mut voxels, mut same) = (0, true);
    for (recorded, sweeps) in recorded.iter().zip(sweeps) {
        let grid = BrickGrid::covering(&cube(cube_m, voxel_m, recorded.seed), voxel_m);
        voxels = grid.voxels();
        let timed = |threshold: f32| {
            let start = Instant::now();
            let (stack, _) = SweepStack::of(statistic, &BEAM, sweeps, grid.middle_m());
            let found = search(&stack, &grid, Threshold::ShareOfPeak(threshold));
            (found, start.elapsed().as_secs_f64())
        };
        let (found, image_s) = timed(0.5);
        image.push(image_s);
        peak.push(timed(1.0).1);
        work.push(found.work.share());
        footprints.push(found.voxels.len() as f64 * voxel_m.powi(3) * 1e3);
        let position = found.peak().map(|(index, _)| center(&grid, index));
        errors.push(position.map_or(f64::INFINITY, |position| position.distance(recorded.truth_m)));
        if voxels <= TWO_RECORDINGS_VOXELS || (voxels <= MAX_DENSE_VOXELS && dense.len() < 2) {
            let start = Instant::now();
            let (stack, _) = SweepStack::of(statistic, &BEAM, sweeps, grid.middle_m());
            let volume = dense_volume(&stack, &grid).volume;
            dense.push(start.elapsed().as_secs_f64());
            let above = volume.values.iter().filter(|value| **value >= found.threshold).count();
            same &= above == found.voxels.len() && found.voxels.iter().all(|&(n, value)| volume.values[n] == value);
        }
    }
    let [image_s, peak_s, error_m, footprint_l, work] =
        [&image, &peak, &errors, &footprints, &work].map(|values| quantile(values, 0.5));
    let dense_s = (!dense.is_empty()).then(|| quantile(&dense, 0.5));
    Trial { cube_m, voxel_m, voxels, dense_s, image_s, peak_s, error_m, footprint_l, work, same }
}

/// Footprint of the reflector by sub-apertures (preset d16, 4 s, voxels of 5 mm), median, litres.
fn sub_aperture_litres(trials: &Trials) -> Result<f64, ExperimentError> {
    let mut footprints = Vec::new();
    for recorded in &trials.reflector("sphere-50cm", "d16", 4.0)? {
        let sweeps = chosen(recorded, SWEEPS, Selection::FarthestPoint);
        let position = locate(&sweeps, recorded.seed).0.map(|refined| refined.position_m);
        let image = position.and_then(|position| close_image(recorded, position));
        footprints.push(image.map_or(f64::INFINITY, |image| Quality::of(&image, recorded.truth_m).footprint_l));
    }
    Ok(quantile(&footprints, 0.5))
}

/// Exponent of the dense run time over the number of voxels: least-squares fit to the trials of at
/// least 100 000 voxels.
fn run_time_exponent(done: &[Trial]) -> f64 {
    let points: Vec<[f64; 2]> = done
        .iter()
        .filter(|trial| trial.voxels >= 100_000)
        .filter_map(|trial| Some([math::ln(trial.voxels as f64), math::ln(trial.dense_s?)]))
        .collect();
    let mean = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64);
    let sum = |of: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(of).sum::<f64>();
    sum(&|p| (p[0] - mean[0]) * (p[1] - mean[1])) / sum(&|p| (p[0] - mean[0]).powi(2))
}

/// A cube ahead of the sensor that contains the reflector, shifted by a part of a voxel for each
/// seed.
fn cube(edge_m: f64, voxel_m: f64, seed: u64) -> Aabb {
    let middle = DVec3::new(0.0, 1.5, -(0.5 * edge_m).max(1.0)) + offset(seed) * voxel_m;
    Aabb { min: middle - 0.5 * edge_m, max: middle + 0.5 * edge_m }
}

fn center(grid: &BrickGrid, index: usize) -> DVec3 {
    let [nx, ny, _] = grid.size;
    let voxel = [index % nx, index / nx % ny, index / (nx * ny)].map(|n| n as f64 + 0.5);
    grid.origin_m + DVec3::from_array(voxel) * grid.voxel_m
}

fn table(words: &str, done: &[Trial]) -> Table {
    let ms = |seconds: f64| format!("{:.1}", seconds * 1e3);
    let row = |trial: &Trial| {
        let dense = match trial.dense_s {
            Some(seconds) => ms(seconds),
            None => "not made".into(),
        };
        vec![
            format!("{:.0}", trial.cube_m),
            format!("{:.1}", trial.voxel_m * 100.0),
            format!("{:.3}", trial.voxels as f64 * 1e-6),
            format!("{:.1}", memory_mib(trial)),
            dense,
            ms(trial.image_s),
            ms(trial.peak_s),
            format!("{:.2}", trial.work * 100.0),
            cm(trial.error_m),
            format!("{:.1}", trial.footprint_l),
        ]
    };
    Table {
        head: head(&[
            "cube (m)",
            "voxel (cm)",
            "voxels (million)",
            "memory of all (MiB)",
            "every voxel (ms)",
            "branch and bound: image (ms)",
            "greatest voxel (ms)",
            "work of every voxel (%)",
            "error (cm)",
            "footprint (l)",
        ]),
        rows: done.iter().map(row).collect(),
        caption: format!(
            "{words}. Not made: more than {:.0} MiB. Image and footprint: the voxels of at least half of the \
             greatest value.",
            MAX_DENSE_VOXELS as f64 * 4.0 / f64::from(1 << 20)
        ),
    }
}

fn memory_mib(trial: &Trial) -> f64 {
    trial.voxels as f64 * 4.0 / f64::from(1 << 20)
}

fn of_thesis_cube(done: &[Trial]) -> impl Iterator<Item = &Trial> {
    done.iter().filter(|trial| trial.cube_m == THESIS_CUBE_M)
}

fn time_chart(words: &str, done: &[Trial]) -> Picture {
    let of = |name: &str, time: fn(&Trial) -> Option<f64>| Series {
        name: name.into(),
        points: of_thesis_cube(done).filter_map(|t| Some([t.voxel_m * 100.0, time(t)? * 1e3])).collect(),
        joined: true,
    };
    Chart {
        title: format!("Run time against the voxel in a cube of 3 m, {words}"),
        x_label: "edge of a voxel (cm)".into(),
        y_label: "run time (ms)".into(),
        x_log: true,
        y_log: true,
        series: vec![
            of("every voxel", |t| t.dense_s),
            of("branch and bound, image from half of the peak", |t| Some(t.image_s)),
            of("branch and bound, greatest voxel", |t| Some(t.peak_s)),
        ],
    }
    .draw()
}

fn error_chart(all: &[Vec<Trial>]) -> Picture {
    let series = STATISTICS.iter().zip(all).map(|((_, words), done)| Series {
        name: (*words).into(),
        points: of_thesis_cube(done).map(|t| [t.voxel_m * 100.0, t.error_m * 100.0]).collect(),
        joined: true,
    });
    Chart {
        title: "Error of the greatest voxel against its edge".into(),
        x_label: "edge of a voxel (cm)".into(),
        y_label: "error (cm)".into(),
        x_log: true,
        y_log: true,
        series: series.collect(),
    }
    .draw()
}

fn findings(outcome: &mut Outcome, thesis: &[Trial], ls: &[Trial], refined_m: f64, sharp_l: f64) {
    let at = |done: &[Trial], voxel_m: f64| of_thesis_cube(done).find(|t| t.voxel_m == voxel_m).copied();
    let (Some(coarse), Some(centimetre), Some(fine)) = (at(thesis, 0.1), at(thesis, 0.01), at(thesis, 0.005)) else {
        return;
    };
    let Some(ls_fine) = at(ls, 0.005) else { return };
    let across = |litres: f64| math::cbrt(litres * 1e-3);
    outcome.add_finding(
        "A resolution of a few millimetres should be possible, since the sensor has it.",
        across(fine.footprint_l) < 0.01,
        format!(
            "voxels above half of the peak fill {:.1} l with voxels of 10 cm and {:.1} l with 5 mm, a cube of {} cm: \
             the pulse is 14 cm long, whatever its sampling; coherent sub-apertures reach {:.3} l, a cube of {} cm. \
             Position accuracy is far better than resolution: {} cm off with voxels of 5 mm (least squares {} cm), {} \
             mm refined",
            coarse.footprint_l,
            fine.footprint_l,
            cm(across(fine.footprint_l)),
            sharp_l,
            cm(across(sharp_l)),
            cm(fine.error_m),
            cm(ls_fine.error_m),
            mm(refined_m)
        ),
    );
    let dense_s = centimetre.dense_s.unwrap_or(f64::INFINITY);
    outcome.add_finding(
        "In 3 m the time for voxels of millimetres would be unfeasible.",
        fine.image_s > 10.0,
        format!(
            "5 mm: {:.0} ms for the image and {:.0} ms for the greatest voxel by branch and bound; every voxel would take {:.0} MiB and, by its {:.0} ms at \
             1 cm, {:.0} s",
            fine.image_s * 1e3,
            fine.peak_s * 1e3,
            memory_mib(&fine),
            dense_s * 1e3,
            dense_s * 8.0
        ),
    );
    let powers = [run_time_exponent(thesis), run_time_exponent(ls)];
    outcome.add_finding(
        "The time grows exponentially with the number of sampling points.",
        powers.iter().all(|power| *power > 1.5),
        format!(
            "every voxel: time grows as their number to the power of {:.2} ({:.2} with least squares), about \
             proportionally; by branch and bound from 10 cm to 5 mm, 8000 times the voxels, {:.0} times the time",
            powers[0],
            powers[1],
            fine.image_s / coarse.image_s
        ),
    );
    let same = thesis.iter().chain(ls).all(|trial| trial.same);
    outcome.add_finding(
        "Fine voxels only where scores are high would help hugely.",
        same && dense_s > 5.0 * centimetre.image_s,
        format!(
            "1 cm in 3 m: {:.0} ms for every voxel, {:.0} ms by branch and bound with {:.1} % of the work, {}",
            dense_s * 1e3,
            centimetre.image_s * 1e3,
            centimetre.work * 100.0,
            if same {
                "and the same voxels with the same values in every trial"
            } else {
                "but not always the same voxels"
            }
        ),
    );
    let six = thesis.iter().find(|t| t.cube_m == 6.0 && t.voxel_m == 0.005);
    let one = thesis.iter().find(|t| t.cube_m == 1.0 && t.voxel_m == 0.005);
    if let (Some(one), Some(six)) = (one, six) {
        outcome.add_finding(
            "How far the search area may reach was left open.",
            None,
            format!(
                "voxels of 5 mm: from 1 to 6 m the number grows 216 times, the time by branch and bound from {:.0} \
                 to {:.0} ms; every voxel of 6 m would take {:.1} GiB. The sensor's range (3.2 m here) limits the \
                 image, not the time",
                one.image_s * 1e3,
                six.image_s * 1e3,
                memory_mib(six) / 1024.0
            ),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_run_time_has_exponent_one() {
        let trial = |voxels: usize| Trial {
            cube_m: 3.0,
            voxel_m: 0.1,
            voxels,
            dense_s: Some(voxels as f64 * 1e-9),
            image_s: 0.0,
            peak_s: 0.0,
            error_m: 0.0,
            footprint_l: 0.0,
            work: 0.0,
            same: true,
        };
        let unmade = Trial { dense_s: None, ..trial(1 << 40) };
        assert!((run_time_exponent(&[trial(1 << 18), trial(1 << 20), trial(1 << 25), unmade]) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn every_cube_holds_the_reflector_and_has_its_edge() {
        for (edge_m, seed) in CUBES_M.into_iter().flat_map(|edge| (1..7).map(move |seed| (edge, seed))) {
            let cube = cube(edge_m, 0.1, seed);
            assert!(cube.contains(DVec3::new(-0.3, 1.5, -1.0)) && (cube.size().max_element() - edge_m).abs() < 1e-9);
        }
    }
}
