//! `radar-chaperone reconstruct FILE --statistic NAME --voxel-m V --out V.npy`: the evidence in
//! space, as a volume.
//!
//! `Reconstruct` has 17 fields: they are the command line's arguments, one field each.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use serde_json::{Map, Value};

use super::files::{SettingsArguments, SweepSource, warn_of_damage};
use super::outputs::{CommandFiles, Outputs, ReplaceArgument, begins_with};
use crate::app::progress;
use crate::gpu_imaging::GpuImager;
use crate::report::{VolumeInfo, ply_bytes, points_above, volume_bytes};
use crate::settings::Settings;
use radar_mapping::cube_ahead;
use radar_mapping::{ObserverCounters, ObserverSettings};
use radar_recording::Recording;
use radar_sar::backprojection::{BrickGrid, DenseVolume, SweepStack, Threshold, dense_volume, search};
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::{Candidate, Observation};
use radar_sar::{Preselection, Preselector, Selection, Statistic, Volume, subaperture_volume};

/// Computes one statistic over a box of voxels: a NumPy volume [z][y][x] and a .json with it
///
/// The .json contains the lowest corner of the box, the edge of a voxel, the frame, the order of
/// the axes and the unit of the values. With --cloud the strongest voxels are also written as
/// points (.ply), for tools that read point clouds.
///
/// Statistics: thesis-full (eq. 3.1), thesis (eq. 3.2), ls, log, glrt, coherent, subaperture.
///
/// `--search adaptive` finds the voxels at or above `--threshold-share` of the greatest value, the
/// same voxels with the same values as `dense`, with a small part of its work; the others are 0 in
/// the volume. It supports all statistics but subaperture.
///
/// `--device gpu` computes a dense volume on the graphics card, to 0.5 % of its peak the same; the
/// processor gives the same bits on every machine. `auto` takes a card where there is one and the
/// volume is large.
#[derive(Debug, Args)]
pub(super) struct Reconstruct {
    /// Recording (.mcap)
    file: PathBuf,
    /// The statistic
    #[arg(long, default_value = "ls")]
    statistic: String,
    /// Edge of a voxel, metres
    #[arg(long, default_value_t = 0.05)]
    voxel_m: f64,
    /// Box in the tracking frame, metres; default: a 3 m cube ahead of the first pose
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    region: Option<String>,
    /// Number of sweeps; default: all that have a pose
    #[arg(long)]
    sweeps: Option<usize>,
    /// How they are chosen: random, threshold, thesis-hull, farthest-point, d-optimal (for the
    /// centre of the box)
    #[arg(long, default_value = "farthest-point")]
    selection: String,
    /// Seed of a random selection
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Excludes sweeps whose greatest power is below this multiple of the noise power (noise
    /// reaches 5 to 10)
    #[arg(long, default_value_t = 0.0)]
    min_peak_power: f64,
    /// Excludes sweeps within this distance of the last one kept, metres; at rest ten a second stay
    #[arg(long, default_value_t = 0.0)]
    min_move_m: f64,
    /// How space is searched
    #[arg(long, value_enum, default_value_t = Search::Dense)]
    search: Search,
    /// What computes a dense volume
    #[arg(long, value_enum, default_value_t = Device::Cpu)]
    device: Device,
    /// Adaptive: voxels from this share of the greatest value on
    #[arg(long, default_value_t = 0.5)]
    threshold_share: f32,
    /// Time of a sweep's pose minus time of the sweep, seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    time_offset_s: f64,
    /// Volume to write
    #[arg(long, value_name = "FILE.npy")]
    out: PathBuf,
    /// Also writes the voxels above --cloud-share of the greatest value as a point cloud
    #[arg(long, value_name = "FILE.ply")]
    cloud: Option<PathBuf>,
    /// Share of the greatest value from which on a voxel is a point of the cloud
    #[arg(long, default_value_t = 0.5, requires = "cloud")]
    cloud_share: f64,
    #[command(flatten)]
    replace: ReplaceArgument,
    #[command(flatten)]
    settings: SettingsArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Search {
    /// Every voxel
    Dense,
    /// The voxels above a threshold, by branch and bound
    Adaptive,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Device {
    /// The processor
    Cpu,
    /// The graphics card, or a software renderer
    Gpu,
    /// The graphics card for large volumes, where there is one
    Auto,
}

/// (voxel, sweep) pairs from which on `--device auto` takes the graphics card. Choice: a second of
/// one core, several times what opening a card takes.
const UPDATES_FOR_GPU: u64 = 1_000_000_000;

/// The result of the computation.
struct Computed {
    volume: Volume,
    /// Number of (voxel, sweep) pairs computed.
    updates: u64,
    /// More results of the search, for the .json.
    extra: Map<String, Value>,
}

/// Largest number of voxels: 2 GiB of volume. Choice: 2 GiB of volume, which fits the memory of
/// most computers.
const MAX_VOXELS: f64 = 512e6;
/// Largest number of sweeps: their tables take 5 to 16 kB each, and 30 kB more for an adaptive
/// search. Choice: 1 GiB at most, which fits the memory of most computers beside the volume.
const MAX_SWEEPS_DENSE: usize = 60_000;
const MAX_SWEEPS_ADAPTIVE: usize = 20_000;
/// The same for `subaperture`, which keeps only the samples, about 2 kB a sweep.
const MAX_SWEEPS_SUBAPERTURE: usize = 400_000;
/// Most sweeps among which is chosen. Choice: half an hour at 1000 a second, 80 MB; of longer recordings
/// every second sweep, or every fourth, and so on.
const MAX_CANDIDATES: usize = 1 << 21;

/// Sweeps to choose among.
#[derive(Debug, Default)]
struct Candidates {
    /// Sweeps numbered with multiples of 2 to this power are candidates.
    halvings: u32,
    numbers: Vec<usize>,
    candidates: Vec<Candidate>,
}

impl Candidates {
    /// Adds sweep `number`; they come in rising order.
    fn add(&mut self, number: usize, observation: &Observation) {
        if !number.is_multiple_of(1 << self.halvings) {
            return;
        }
        if self.numbers.len() == MAX_CANDIDATES {
            self.halvings += 1;
            let mut stays = self.numbers.iter().map(|number| number.is_multiple_of(1 << self.halvings));
            self.candidates.retain(|_| stays.next() == Some(true));
            self.numbers.retain(|number| number.is_multiple_of(1 << self.halvings));
            return self.add(number, observation);
        }
        self.numbers.push(number);
        self.candidates.push(Candidate::from(observation));
    }

    /// Numbers of at most `count` of them, in rising order.
    fn choose(&self, selection: Selection, count: usize, place: DVec3, seed: u64) -> Vec<usize> {
        selection.choose(&self.candidates, count, place, seed).into_iter().map(|n| self.numbers[n]).collect()
    }
}

impl Reconstruct {
    pub fn run(&self) -> Result<()> {
        let statistic: Statistic = self.statistic.parse()?;
        let selection: Selection = self.selection.parse()?;
        self.check_arguments()?;
        let files = CommandFiles::default().reads([&self.file]).reads(self.settings.file());
        let files = files.writes([&self.out], is_volume).writes([self.out.with_extension("json")], is_volume_info);
        let outputs = files.writes(&self.cloud, is_cloud).check(self.replace)?;
        let recording = Recording::open(&self.file)?;
        let header = recording.header();
        let settings = self.settings.over_recorded(&header.settings)?;
        let of_mapping = ObserverSettings::new(&settings.mapping(), &header.head_from_sensor);
        let observer = ObserverSettings { time_offset_s: self.time_offset_s, ..of_mapping };
        let source = SweepSource { path: &self.file, observer };
        let (chosen, region) = self.gather(&source, selection, self.most_sweeps(statistic))?;
        let spinner = progress::spinner("reconstructing");
        let computed = self.compute(statistic, &chosen, &settings, &region)?;
        spinner.finish_and_clear();
        self.write(computed, statistic, chosen.len(), &outputs)
    }

    fn compute(
        &self,
        statistic: Statistic,
        sweeps: &[Observation],
        settings: &Settings,
        region: &Aabb,
    ) -> Result<Computed> {
        let beam = &settings.radar.beam;
        let (mut extra, adaptive) = (Map::new(), matches!(self.search, Search::Adaptive));
        extra.insert("sweeps".into(), sweeps.len().into());
        extra.insert("selection".into(), self.sweeps.map(|_| self.selection.clone()).into());
        extra.insert("search".into(), if adaptive { "adaptive" } else { "dense" }.into());
        if statistic == Statistic::Subaperture && adaptive {
            bail!("--search adaptive does not serve subaperture: leave it out");
        }
        let subapertures = &settings.rooms.subapertures;
        if let Some(mut imager) = self.imager(region, sweeps.len())? {
            extra.insert("device".into(), imager.adapter_name().into());
            let found = imager.volume(statistic, beam, subapertures, sweeps, region, self.voxel_m)?;
            return Ok(Computed { volume: found.volume, updates: found.updates, extra });
        }
        if statistic == Statistic::Subaperture {
            let volume = subaperture_volume(sweeps, beam, subapertures, region, self.voxel_m);
            let updates = (volume.values.len() * sweeps.len()) as u64;
            return Ok(Computed { volume, updates, extra });
        }
        let grid = BrickGrid::covering(region, self.voxel_m);
        let (stack, _) = SweepStack::of(statistic, beam, sweeps, grid.middle_m());
        if !adaptive {
            let DenseVolume { volume, updates } = dense_volume(&stack, &grid);
            return Ok(Computed { volume, updates, extra });
        }
        let found = search(&stack, &grid, Threshold::ShareOfPeak(self.threshold_share));
        extra.insert("threshold".into(), f64::from(found.threshold).into());
        extra.insert("voxels".into(), found.voxels.len().into());
        extra.insert("bounds".into(), found.work.bounds.into());
        Ok(Computed { volume: found.volume(&grid), updates: found.work.updates, extra })
    }

    /// The graphics card, if it is to compute the volume.
    fn imager(&self, region: &Aabb, sweeps: usize) -> Result<Option<GpuImager>> {
        let adaptive = matches!(self.search, Search::Adaptive);
        let voxels = Volume::size_covering(region, self.voxel_m).iter().product::<usize>();
        match self.device {
            Device::Cpu => Ok(None),
            Device::Gpu if adaptive => bail!("--device gpu computes dense volumes: leave out --search adaptive"),
            Device::Gpu => Ok(Some(GpuImager::open()?)),
            Device::Auto if adaptive || ((voxels * sweeps) as u64) < UPDATES_FOR_GPU => Ok(None),
            Device::Auto => {
                let card = GpuImager::open().ok().filter(|imager| !imager.is_software());
                let of = card.as_ref().map_or("the processor: no graphics card", GpuImager::adapter_name);
                log::info!("--device auto takes {of}");
                Ok(card)
            }
        }
    }

    fn region(&self, first_pose: &Pose) -> Result<Aabb> {
        let Some(text) = &self.region else { return Ok(cube_ahead(first_pose)) };
        let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x0, y0, z0, x1, y1, z1])
                if [x0, y0, z0, x1, y1, z1].iter().all(|n| n.is_finite()) && x1 > x0 && y1 > y0 && z1 > z0 =>
            {
                Ok(Aabb { min: glam::dvec3(x0, y0, z0), max: glam::dvec3(x1, y1, z1) })
            }
            _ => Err(anyhow!("--box {text}: give x0,y0,z0,x1,y1,z1 in metres, each second corner above the first")),
        }
    }

    fn check_arguments(&self) -> Result<()> {
        if !(1e-4..=10.0).contains(&self.voxel_m) {
            bail!("--voxel-m {}: give 0.0001 to 10 metres", self.voxel_m);
        }
        if self.out.extension().is_some_and(|extension| extension == "json") {
            bail!("--out {}: the .json beside the volume takes this name: choose one in .npy", self.out.display());
        }
        if !(self.cloud_share > 0.0 && self.cloud_share <= 1.0) {
            bail!("--cloud-share {}: give a share above 0, at most 1", self.cloud_share);
        }
        if !(self.threshold_share > 0.0 && self.threshold_share <= 1.0) {
            bail!("--threshold-share {}: give a share above 0, at most 1", self.threshold_share);
        }
        if !(0.0..=1e9).contains(&self.min_peak_power) || !(0.0..=10.0).contains(&self.min_move_m) {
            bail!("give --min-peak-power 0 to 1e9 and --min-move-m 0 to 10 metres");
        }
        if self.sweeps == Some(0) {
            bail!("--sweeps 0: give at least 1, or leave it out for all");
        }
        if !(-10.0..=10.0).contains(&self.time_offset_s) {
            bail!("--time-offset-s {}: give -10 to 10 seconds", self.time_offset_s);
        }
        Ok(())
    }

    fn check_size(&self, region: &Aabb) -> Result<()> {
        let voxels = (region.size() / self.voxel_m).ceil().to_array().iter().product::<f64>();
        if voxels > MAX_VOXELS {
            bail!("the box holds {voxels:.3e} voxels of {} m: at most {MAX_VOXELS:.0e} fit in memory", self.voxel_m);
        }
        Ok(())
    }

    fn most_sweeps(&self, statistic: Statistic) -> usize {
        match self.search {
            _ if statistic == Statistic::Subaperture => MAX_SWEEPS_SUBAPERTURE,
            Search::Adaptive => MAX_SWEEPS_ADAPTIVE,
            Search::Dense => MAX_SWEEPS_DENSE,
        }
    }

    /// The sweeps to use, at most `most`, and the box. To choose among them the recording is read twice: it may
    /// be larger than memory.
    fn gather(&self, source: &SweepSource, selection: Selection, most: usize) -> Result<(Vec<Observation>, Aabb)> {
        let (mut first, mut all, mut candidates) = (None, Vec::new(), Candidates::default());
        let (mut preselector, mut count) = (self.preselector(), 0);
        let (counters, recording) = source.each(|observation| {
            first.get_or_insert(observation.tracking_from_sensor);
            if preselector.keeps(&observation) {
                match self.sweeps {
                    Some(_) => candidates.add(count, &observation),
                    None if count < most => all.push(observation),
                    None => {}
                }
                count += 1;
            }
        })?;
        warn_of_damage(&recording);
        let Some(first) = first else { bail!(self.without_sweeps(&counters)) };
        let region = self.region(&first)?;
        self.check_size(&region)?;
        let left_out = preselector.counters();
        if left_out != Default::default() {
            let (signal, motion) = (left_out.without_signal, left_out.without_motion);
            outln!("left out: {signal} sweeps without signal, {motion} without motion")?;
        }
        let wanted = self.sweeps.map(|wanted| candidates.choose(selection, wanted, region.center(), self.seed));
        let used = wanted.as_ref().map_or(count, Vec::len);
        if used > most {
            bail!("{used} sweeps are more than fit in memory: choose at most {most} with --sweeps");
        }
        let Some(wanted) = wanted else { return Ok((all, region)) };
        let (mut preselector, mut count) = (self.preselector(), 0);
        source.each(|observation| {
            if preselector.keeps(&observation) {
                if wanted.get(all.len()) == Some(&count) {
                    all.push(observation);
                }
                count += 1;
            }
        })?;
        Ok((all, region))
    }

    fn preselector(&self) -> Preselector {
        Preselector::new(Preselection { min_peak_power: self.min_peak_power, min_move_m: self.min_move_m })
    }

    fn without_sweeps(&self, counters: &ObserverCounters) -> String {
        format!(
            "no sweep of {} has a pose ({} frames, {} poses, {} of them unusable): nothing to reconstruct",
            self.file.display(),
            counters.frames,
            counters.poses,
            counters.poses_invalid
                + counters.poses_bad_numbers
                + counters.poses_time_not_rising
                + counters.poses_time_leapt
        )
    }

    fn write(&self, computed: Computed, statistic: Statistic, sweeps: usize, outputs: &Outputs) -> Result<()> {
        let Computed { volume, updates, extra } = computed;
        let dense_updates = (volume.values.len() * sweeps) as u64;
        let found = extra.get("voxels").and_then(Value::as_u64);
        let bounds = extra.get("bounds").and_then(Value::as_u64).unwrap_or(0);
        let info = VolumeInfo { statistic: statistic.name().into(), updates, dense_updates, extra };
        let [npy, json] = volume_bytes(&volume, &info)?;
        outputs.write(&self.out, &npy)?;
        outputs.write(&self.out.with_extension("json"), &json)?;
        let [nx, ny, nz] = volume.size;
        outln!("{} over {nz} × {ny} × {nx} voxels [z][y][x] of {} m, {sweeps} sweeps", statistic.name(), self.voxel_m)?;
        if let Some(found) = found {
            let share = (updates + bounds) as f64 / dense_updates.max(1) as f64 * 100.0;
            outln!("{found} voxels above the threshold, with {share:.2} % of the work of every voxel")?;
        }
        if let Some((index, value)) = volume.peak() {
            let at = volume.center(volume.voxel(index));
            outln!("greatest value {value:.4} at ({:.3}, {:.3}, {:.3}) m", at.x, at.y, at.z)?;
        }
        outln!("Written to {} and its .json", self.out.display())?;
        if let Some(cloud) = &self.cloud {
            let points = points_above(&volume, self.cloud_share);
            outputs.write(cloud, &ply_bytes(&points))?;
            outln!("{} points written to {}", points.len(), cloud.display())?;
        }
        Ok(())
    }
}

/// A volume of this program: others' lack what describes it.
fn is_volume(file: &Path) -> bool {
    begins_with(file, b"\x93NUMPY") && is_volume_info(&file.with_extension("json"))
}

fn is_volume_info(file: &Path) -> bool {
    begins_with(file, b"{\n  \"origin_m\": [")
}

fn is_cloud(file: &Path) -> bool {
    begins_with(file, b"ply\nformat binary_little_endian 1.0\ncomment tracking frame, metres, +y up\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::{RangeAxis, SweepGeometry};

    #[test]
    fn of_too_many_sweeps_every_second_and_then_every_fourth_is_a_candidate() {
        let axis = RangeAxis { first_m: 0.2, step_m: 0.01, points: 1 };
        let geometry = SweepGeometry { subsweep: 0, axis, pulse_fwhm_m: 0.1, point_period_s: 0.0 };
        let mut sweep = Observation {
            mid_time_ns: 0,
            tracking_from_sensor: Pose::IDENTITY,
            velocity_m_per_s: DVec3::ZERO,
            geometry: geometry.into(),
            samples: Vec::new(),
        };
        let mut candidates = Candidates::default();
        for number in 0..=2 * MAX_CANDIDATES {
            sweep.tracking_from_sensor.translation.x = number as f64;
            candidates.add(number, &sweep);
            let apart = if number < MAX_CANDIDATES { 1 } else { 2 };
            if number < 2 * MAX_CANDIDATES {
                assert_eq!(candidates.numbers.len(), number / apart + 1);
            }
        }
        assert_eq!(candidates.numbers.len(), MAX_CANDIDATES / 2 + 1);
        for (n, (number, candidate)) in candidates.numbers.iter().zip(&candidates.candidates).enumerate() {
            assert_eq!((*number, candidate.position_m.x), (4 * n, *number as f64));
        }
        let chosen = candidates.choose(Selection::Random, 9, DVec3::ZERO, 1);
        assert!(chosen.len() == 9 && chosen.iter().all(|number| number % 4 == 0));
    }
}
