//! `radar-chaperone reconstruct FILE --statistic NAME --voxel-m V --out V.npy`: the evidence in space, as a volume.

use std::path::PathBuf;

use anyhow::{Result, anyhow, bail};
use clap::{Args, ValueEnum};

use super::files::{SettingsArguments, keep_inputs, read_streams};
use super::progress;
use crate::engine::cube_ahead;
use crate::geometry::{Aabb, Pose};
use crate::imaging::{
    Oracle, Preselection, Preselector, Selection, Statistic, Volume, blocks_volume, ls_volume, oracle_volume,
};
use crate::radar::Observation;
use crate::report::{VolumeInfo, write_volume};
use crate::tracking::{ObserverSettings, observe_all};

/// Computes one statistic over a box of voxels: a NumPy volume [z][y][x] and a .json beside it
///
/// Statistics: thesis-full (eq. 3.1), thesis (eq. 3.2), ls, log, glrt, coherent, blocks. `ls` and `blocks` have fast ways;
/// the others are summed place by place in double precision, so give them small boxes or few sweeps.
#[derive(Debug, Args)]
pub(super) struct Reconstruct {
    /// Recording (.mcap)
    file: PathBuf,
    /// Which sum
    #[arg(long, default_value = "ls")]
    statistic: String,
    /// Edge of a voxel, metres
    #[arg(long, default_value_t = 0.05)]
    voxel_m: f64,
    /// Box in the tracking frame, metres; without it a 3 m cube ahead of the first pose
    #[arg(long = "box", value_name = "x0,y0,z0,x1,y1,z1", allow_hyphen_values = true)]
    region: Option<String>,
    /// Number of sweeps; without it all that have a pose
    #[arg(long)]
    sweeps: Option<usize>,
    /// How they are chosen: random, threshold, thesis-hull, farthest-point, d-optimal (for the middle of the box)
    #[arg(long, default_value = "farthest-point")]
    selection: String,
    /// What a chance selection draws follows from it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Leaves out sweeps whose greatest power stays below this many times the noise's (which reaches 5 to 10)
    #[arg(long, default_value_t = 0.0)]
    min_peak_power: f64,
    /// Leaves out sweeps from less than this way from the last one kept, metres; at rest ten a second stay
    #[arg(long, default_value_t = 0.0)]
    min_move_m: f64,
    /// How space is searched
    #[arg(long, value_enum, default_value_t = Search::Dense)]
    search: Search,
    /// Time of a sweep's pose minus time of the sweep, seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    time_offset_s: f64,
    /// Volume to write
    #[arg(long, value_name = "FILE.npy")]
    out: PathBuf,
    #[command(flatten)]
    settings: SettingsArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Search {
    /// Every voxel
    Dense,
}

/// Voxels at most: 2 GiB of volume.
const MAX_VOXELS: f64 = 512e6;

impl Reconstruct {
    pub fn run(&self) -> Result<()> {
        let Search::Dense = self.search;
        let statistic: Statistic = self.statistic.parse()?;
        let selection: Selection = self.selection.parse()?;
        self.check_arguments()?;
        keep_inputs(&self.out, &[&self.file])?;
        let (recording, frames, poses) = read_streams(&self.file)?;
        let header = recording.header();
        let settings = self.settings.over(&header.settings)?;
        let observer = ObserverSettings {
            history: settings.tracking.history,
            head_from_sensor: settings.tracking.mount.unwrap_or(header.head_from_sensor),
            time_offset_s: self.time_offset_s,
        };
        let (observations, counters) = observe_all(&header.config, observer, &frames, &poses);
        let Some(first) = observations.first() else {
            bail!(
                "no sweep of {} has a pose ({} frames, {} poses, {} of them unusable): nothing to reconstruct",
                self.file.display(),
                counters.frames,
                counters.poses,
                counters.poses_invalid + counters.poses_bad_numbers + counters.poses_time_not_rising
            );
        };
        let region = self.region(&first.tracking_from_sensor)?;
        self.check_size(&region)?;
        let chosen = self.choose(observations, selection, &region)?;
        let spinner = progress::spinner("reconstructing");
        let beam = &settings.radar.beam;
        let volume = match statistic {
            Statistic::Ls => ls_volume(&chosen, beam, &region, self.voxel_m),
            Statistic::Blocks => blocks_volume(&chosen, beam, &settings.rooms.blocks, &region, self.voxel_m),
            _ => oracle_volume(&Oracle::new(&chosen, beam, &settings.rooms.blocks), statistic, &region, self.voxel_m),
        };
        spinner.finish_and_clear();
        self.write(&volume, statistic, chosen.len())
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

    fn choose(
        &self,
        mut observations: Vec<Observation>,
        selection: Selection,
        region: &Aabb,
    ) -> Result<Vec<Observation>> {
        let mut preselector =
            Preselector::new(Preselection { min_peak_power: self.min_peak_power, min_move_m: self.min_move_m });
        observations.retain(|observation| preselector.keeps(observation));
        let left_out = preselector.counters();
        if left_out != Default::default() {
            let (signal, motion) = (left_out.without_signal, left_out.without_motion);
            say!("left out: {signal} sweeps without signal, {motion} without motion")?;
        }
        let Some(count) = self.sweeps else { return Ok(observations) };
        let chosen = selection.choose(&observations, count, region.center(), self.seed);
        Ok(chosen.into_iter().map(|n| observations[n].clone()).collect())
    }

    fn write(&self, volume: &Volume, statistic: Statistic, sweeps: usize) -> Result<()> {
        let updates = (volume.values.len() * sweeps) as u64;
        let mut extra = serde_json::Map::new();
        extra.insert("sweeps".into(), sweeps.into());
        extra.insert("search".into(), "dense".into());
        let info = VolumeInfo { statistic: statistic.name().into(), updates, dense_updates: updates, extra };
        write_volume(&self.out, volume, &info)?;
        let [nx, ny, nz] = volume.size;
        say!("{} over {nz} × {ny} × {nx} voxels [z][y][x] of {} m, {sweeps} sweeps", statistic.name(), self.voxel_m)?;
        if let Some((index, value)) = volume.peak() {
            let at = volume.center(volume.voxel(index));
            say!("greatest value {value:.4} at ({:.3}, {:.3}, {:.3}) m", at.x, at.y, at.z)?;
        }
        say!("Written to {} and its .json", self.out.display())?;
        Ok(())
    }
}
