//! Dense backprojection beside plain C on the same sweeps, in one run.

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use glam::{DQuat, DVec3};
use num_complex::{Complex32, Complex64};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Extent;
use radar_chaperone::report::Table;
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::math;
use radar_sar::{
    Beam, CompressedSweep, INSTRUCTIONS_VARIABLE, InstructionSet, Observation, PHASE_RAD_PER_M, RangeAxis,
    RangeCompressor, Statistic, SweepGeometry,
};

const PEER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/backprojection.c");
const STATISTICS: [Statistic; 2] = [Statistic::Ls, Statistic::Coherent];
/// The compiler's tunings, of which the faster counts: one avoids the processor's gathers where they are slow.
const TUNINGS: [&str; 2] = ["generic", "native"];
/// Points of a sweep: 1.6 m.
pub(super) const POINTS: usize = 321;
/// Time for which a volume is repeated; the fastest counts. Choice: ten volumes or more.
const REPEATING: Duration = Duration::from_secs(2);
/// Largest difference from the sum in f64, as a share of the volume's peak, with which a peer has done the same work. Choice: both
/// interpolate between samples 5 mm apart, under a pulse of 140 mm.
const MAX_DIFFERENCE: f64 = 0.01;

/// A dense volume of a box in front of the sensor.
#[derive(Debug, Clone, Copy)]
pub struct DenseJob {
    /// The statistic.
    pub statistic: Statistic,
    /// Voxels along each side of the box.
    pub voxels: u32,
    /// Number of sweeps.
    pub sweeps: usize,
    /// Points of a sweep.
    pub points: usize,
    /// Whether the time begins with the raw sweeps, not with their tables.
    pub from_raw_sweeps: bool,
}

impl DenseJob {
    /// Seconds for one volume on one thread with this process's instruction set: the fastest of many.
    pub fn seconds(&self) -> f64 {
        let (grid, observations) = (self.grid(), self.observations());
        let make = || SweepStack::of(self.statistic, &Beam::Lensless, &observations, grid.middle_m()).0;
        let stack = make();
        // On a thread of the pool: from outside it each volume would wait for one to wake up.
        let work = || match self.from_raw_sweeps {
            true => drop(dense_volume(&make(), &grid)),
            false => drop(dense_volume(&stack, &grid)),
        };
        let mut best_s = f64::INFINITY;
        rayon::scope(|_| {
            let begin = Instant::now();
            while best_s.is_infinite() || begin.elapsed() < REPEATING {
                let start = Instant::now();
                work();
                best_s = best_s.min(start.elapsed().as_secs_f64());
            }
        });
        best_s
    }

    fn region(&self) -> Aabb {
        Aabb { min: DVec3::new(0.5, -0.4, -0.4), max: DVec3::new(1.3, 0.4, 0.4) }
    }

    fn grid(&self) -> BrickGrid {
        BrickGrid::covering(&self.region(), self.region().size().x / f64::from(self.voxels))
    }

    /// Noise along a winding path, points 5 mm apart.
    fn observations(&self) -> Vec<Observation> {
        let axis = RangeAxis { first_m: 0.2, step_m: 0.005, points: self.points };
        let geometry = Arc::new(SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.14, point_period_s: 0.0 });
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let sweep = |n: usize| {
            let t = n as f64 / (self.sweeps - 1).max(1) as f64;
            let (sin, cos) = (math::sin::<f64>, math::cos::<f64>);
            let position = DVec3::new(0.1 * sin(5.0 * t), 0.2 * cos(3.0 * t) - 0.2, 0.15 * sin(9.0 * t));
            let ahead = DVec3::new(1.0, 0.3 * sin(4.0 * t), 0.2 * cos(6.0 * t)).normalize();
            let mut part = || rng.random_range(-0.5..0.5);
            Observation {
                mid_time_ns: n as i64,
                tracking_from_sensor: Pose::new(position, DQuat::from_rotation_arc(DVec3::NEG_Z, ahead)),
                velocity_m_per_s: DVec3::ZERO,
                geometry: Arc::clone(&geometry),
                samples: (0..axis.points).map(|_| Complex32::new(part(), part())).collect(),
            }
        };
        (0..self.sweeps).map(sweep).collect()
    }
}

/// What a peer reads.
struct PeerData {
    job: DenseJob,
    axis: RangeAxis,
    positions: Vec<DVec3>,
    sweeps: Vec<CompressedSweep>,
}

impl PeerData {
    fn of(job: DenseJob) -> Result<Self> {
        let observations = job.observations();
        let axis = observations.first().context("a job has sweeps")?.geometry.axis;
        let compressed = |o: &Observation| RangeCompressor::new(&o.geometry).compress(&o.samples, 1.0);
        let positions: Vec<DVec3> = observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
        let region = job.region();
        for position in &positions {
            let nearest = position.clamp(region.min, region.max).distance(*position);
            let farthest = (region.min - *position).abs().max((region.max - *position).abs()).length();
            ensure!(axis.contains(nearest) && axis.contains(farthest), "the box leaves the sampled ranges");
        }
        Ok(Self { job, axis, positions, sweeps: observations.iter().map(compressed).collect() })
    }

    fn bytes(&self) -> Vec<u8> {
        let grid = self.job.grid();
        let counts = [self.job.voxels as usize, self.positions.len(), self.axis.points];
        let mut bytes: Vec<u8> = counts.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
        let lengths = [self.axis.first_m, self.axis.step_m, PHASE_RAD_PER_M].into_iter();
        let z: Vec<Complex64> = self
            .sweeps
            .iter()
            .flat_map(|sweep| (0..self.axis.points).map(|n| sweep.at(self.axis.range_m(n))))
            .collect();
        let floats = lengths
            .chain(grid.origin_m.to_array())
            .chain([grid.voxel_m])
            .chain(self.positions.iter().flat_map(|position| position.to_array()))
            .chain(z.iter().map(|z| z.re))
            .chain(z.iter().map(|z| z.im));
        bytes.extend(floats.flat_map(|value| (value as f32).to_le_bytes()));
        bytes
    }

    /// Fails unless the peer's volume is the sum in f64 at a few hundred voxels.
    fn check(&self, volume: &[f32]) -> Result<()> {
        let grid = self.job.grid();
        let n = self.job.voxels as usize;
        ensure!(volume.len() == n * n * n, "the peer's volume has {} voxels", volume.len());
        let peak = f64::from(volume.iter().copied().fold(0.0, f32::max));
        for index in (0..volume.len()).step_by((volume.len() / 300).max(1)) {
            let voxel = DVec3::new((index % n) as f64, (index / n % n) as f64, (index / (n * n)) as f64) + 0.5;
            let expected = self.sum(grid.origin_m + voxel * grid.voxel_m);
            let found = f64::from(volume[index]);
            ensure!(
                (found - expected).abs() <= MAX_DIFFERENCE * peak,
                "the peer has {found} where {expected} is the sum"
            );
        }
        Ok(())
    }

    fn sum(&self, position: DVec3) -> f64 {
        let (mut power, mut coherent) = (0.0, Complex64::ZERO);
        for (from, sweep) in self.positions.iter().zip(&self.sweeps) {
            let distance_m = from.distance(position);
            let z = sweep.at(distance_m);
            power += z.norm_sqr();
            coherent += z * math::from_polar(1.0, -PHASE_RAD_PER_M * distance_m);
        }
        if self.job.statistic == Statistic::Ls { power } else { math::norm(coherent) }
    }
}

/// Our time, plain C's and their ratio, for each instruction set of this processor; then the job of the thesis. Rows of peers that
/// cannot be built here say why.
///
/// # Errors
/// This program cannot be run again; a peer gives a wrong volume.
pub fn peers_table(extent: Extent) -> Result<Table> {
    let folder = std::env::temp_dir().join(format!("lab-peers-{}", std::process::id()));
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let rows = rows(extent, &folder);
    std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    let head = ["instruction set", "volume", "here, ms", "G updates/s", "plain C, ms", "times as fast"];
    Ok(Table {
        head: head.map(str::to_owned).to_vec(),
        rows: rows?,
        caption: "One thread each, the fastest of 2 s, twice in turn. An update is one voxel with one sweep. Plain C: \
                  `lab/peers/backprojection.c`, vectorised by the compiler (`cc -O3 -ffast-math`, the faster of two tunings) for the same instructions, \
                  without checks of range, and `coherent` without weights."
            .into(),
    })
}

fn rows(extent: Extent, folder: &Path) -> Result<Vec<Vec<String>>> {
    let (voxels, sweeps) = extent.choose((128, 100), (16, 10));
    let mut rows = Vec::new();
    let mut sets: Vec<_> = InstructionSet::all_of_processor().collect();
    sets.reverse();
    for set in sets.into_iter().take(extent.choose(usize::MAX, 1)) {
        let peers = TUNINGS.map(|tuning| build(architecture(set), tuning, folder));
        for statistic in STATISTICS {
            let job = DenseJob { statistic, voxels, sweeps, points: POINTS, from_raw_sweeps: false };
            let (mut own_s, mut peer_s) = (f64::INFINITY, Ok(f64::INFINITY));
            for _ in 0..extent.choose(2, 1) {
                own_s = own_s.min(own_seconds(set, &job)?);
                for peer in &peers {
                    peer_s = match (peer_s, peer) {
                        (Ok(best_s), Ok(program)) => Ok(peer_seconds(program, &job, folder)?.min(best_s)),
                        (_, Err(why)) => Err(why.clone()),
                        (Err(why), _) => Err(why),
                    };
                }
            }
            rows.push(row(set, &job, own_s, peer_s));
        }
        let job = DenseJob { statistic: Statistic::Ls, voxels: 30, sweeps: 50, points: POINTS, from_raw_sweeps: true };
        rows.push(row(set, &job, own_seconds(set, &job)?, Err("–".into())));
    }
    Ok(rows)
}

fn row(set: InstructionSet, job: &DenseJob, own_s: f64, peer_s: Result<f64, String>) -> Vec<String> {
    let updates = f64::from(job.voxels).powi(3) * job.sweeps as f64;
    let from = if job.from_raw_sweeps { ", from raw sweeps" } else { "" };
    let (peer, ratio) = match peer_s {
        Ok(seconds) => (format!("{:.1}", seconds * 1e3), format!("{:.2}", seconds / own_s)),
        Err(why) => (why, "–".into()),
    };
    vec![
        set.to_string(),
        format!("{}, {}³ × {}{from}", job.statistic.name(), job.voxels, job.sweeps),
        format!("{:.2}", own_s * 1e3),
        format!("{:.2}", updates / own_s * 1e-9),
        peer,
        ratio,
    ]
}

/// What the compiler calls a processor with these instructions.
fn architecture(set: InstructionSet) -> &'static str {
    match set {
        InstructionSet::Portable if cfg!(target_arch = "x86_64") => "x86-64",
        InstructionSet::Portable | InstructionSet::Neon => "armv8-a",
        InstructionSet::Avx2 => "x86-64-v3",
        InstructionSet::Avx512 => "x86-64-v4",
    }
}

/// The peer's program for an architecture, or why there is none.
fn build(architecture: &str, tuning: &str, folder: &Path) -> Result<PathBuf, String> {
    let program = folder.join(format!("peer-{architecture}-{tuning}"));
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let (march, mtune) = (format!("-march={architecture}"), format!("-mtune={tuning}"));
    let words: [&OsStr; 8] = [
        "-O3".as_ref(),
        "-ffast-math".as_ref(),
        march.as_ref(),
        mtune.as_ref(),
        PEER.as_ref(),
        "-o".as_ref(),
        program.as_ref(),
        "-lm".as_ref(),
    ];
    match Command::new(&compiler).args(words).output() {
        Ok(done) if done.status.success() => Ok(program),
        Ok(done) => {
            Err(format!("not built: {}", String::from_utf8_lossy(&done.stderr).lines().next().unwrap_or_default()))
        }
        Err(error) => Err(format!("not built: {}: {error}", compiler.display())),
    }
}

/// An instruction set is chosen once per process, so each job runs in a process of its own.
fn own_seconds(set: InstructionSet, job: &DenseJob) -> Result<f64> {
    let own = std::env::current_exe().context("cannot find this program's file")?;
    let mut command = Command::new(&own);
    command.env(INSTRUCTIONS_VARIABLE, set.name()).env("RAYON_NUM_THREADS", "1").args([
        "benchmark",
        "--dense",
        job.statistic.name(),
    ]);
    command.args(["--voxels", &job.voxels.to_string(), "--sweeps", &job.sweeps.to_string()]);
    command.args(["--points", &job.points.to_string()]);
    if job.from_raw_sweeps {
        command.arg("--from-raw-sweeps");
    }
    seconds(command)
}

fn peer_seconds(program: &Path, job: &DenseJob, folder: &Path) -> Result<f64> {
    let (input, output) = (folder.join("data"), folder.join("volume"));
    let data = PeerData::of(*job)?;
    std::fs::File::create(&input)
        .and_then(|mut file| file.write_all(&data.bytes()))
        .context("cannot write the peer's data")?;
    let mut command = Command::new(program);
    command.args([input.as_os_str(), job.statistic.name().as_ref(), output.as_os_str()]);
    let took_s = seconds(command)?;
    let volume = std::fs::read(&output).context("cannot read the peer's volume")?;
    let floats: Vec<f32> = volume.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    data.check(&floats)?;
    Ok(took_s)
}

/// Runs a program that prints seconds.
fn seconds(mut command: Command) -> Result<f64> {
    let done = command.output().with_context(|| format!("cannot run {}", command.get_program().display()))?;
    let text = String::from_utf8_lossy(&done.stdout);
    match text.trim().parse() {
        Ok(seconds) if done.status.success() => Ok(seconds),
        _ => bail!(
            "{} ended with {}: {}",
            command.get_program().display(),
            done.status,
            String::from_utf8_lossy(&done.stderr)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_volume_is_noticed() {
        let data = PeerData::of(DenseJob {
            statistic: Statistic::Ls,
            voxels: 8,
            sweeps: 5,
            points: POINTS,
            from_raw_sweeps: false,
        })
        .unwrap();
        let grid = data.job.grid();
        let center = |n: usize| DVec3::new((n % 8) as f64, (n / 8 % 8) as f64, (n / 64) as f64) + 0.5;
        let mut volume: Vec<f32> =
            (0..512).map(|n| data.sum(grid.origin_m + center(n) * grid.voxel_m) as f32).collect();
        data.check(&volume).unwrap();
        volume[100] *= 1.1;
        assert!(data.check(&volume).is_err());
        assert!(data.check(&volume[..511]).is_err());
    }
}
