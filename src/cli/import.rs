//! `radar-chaperone import FRAMES.h5 --poses TRACK --out FILE.mcap`: converts the vendor's
//! recordings, with poses of any tracker.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;

use super::outputs::{CommandFiles, ReplaceArgument, never};
use crate::app::limit_memory_of_this_process;
use radar_recording::{ImportOptions, import_h5, remove_unfinished};
use radar_sar::HistorySettings;
use radar_sar::geometry::{Pose, mount};

/// Limit of the process that reads the file, bytes. Choice: the gibibyte that a file may have, and as much for all else and what the
/// allocator reserves.
const MAX_MEMORY_BYTES: u64 = 2 << 30;

/// Converts a recording of the vendor's exploration tool and a pose track into a recording
///
/// The track is a TUM trajectory: lines of `timestamp_s tx ty tz qx qy qz qw`, seconds since the
/// recording's first tick, metres; `#` starts a comment. Or, where its name ends in .csv, a table
/// whose first line names the columns, in any order: time_s (or _ms, _us, _ns), x y z (metres, or
/// x_mm, x_cm), qx qy qz qw, and valid where there is such a column. It gives the poses of what the
/// sensor is mounted on; without --mount, of the sensor itself (looking along −z). For a sensor that
/// stood still, --fixed-pose gives the same pose throughout.
#[derive(Debug, Args)]
pub(super) struct Import {
    /// Recording of the vendor's tool (.h5)
    frames: PathBuf,
    /// Pose track (TUM, or CSV by its extension); without it and --fixed-pose the recording has no
    /// poses
    #[arg(long, value_name = "TRACK.tum|.csv")]
    poses: Option<PathBuf>,
    /// The pose of a sensor at rest, instead of a track: x,y,z in metres, or x,y,z,qx,qy,qz,qw;
    /// without a value the origin
    #[arg(
        long,
        value_name = "x,y,z[,qx,qy,qz,qw]",
        num_args = 0..=1,
        default_missing_value = "0,0,0",
        require_equals = true,
        conflicts_with = "poses"
    )]
    fixed_pose: Option<String>,
    /// Pose of the sensor on the tracked object: x,y,z in metres, or x,y,z,qx,qy,qz,qw
    #[arg(long, value_name = "x,y,z[,qx,qy,qz,qw]", allow_hyphen_values = true)]
    mount: Option<String>,
    /// Recording to write
    #[arg(long, value_name = "FILE.mcap")]
    out: PathBuf,
    #[command(flatten)]
    replace: ReplaceArgument,
    /// This is the process that reads the file
    #[arg(long, hide = true)]
    isolated: bool,
}

impl Import {
    /// The reader of .h5 files is a large library that gets untrusted bytes: it works in a process of its own, whose end and whose
    /// memory are its own.
    pub fn run(&self) -> Result<()> {
        if self.isolated {
            limit_memory_of_this_process(MAX_MEMORY_BYTES).context("cannot limit this process' memory")?;
            return self.import();
        }
        let program = std::env::current_exe().context("cannot find this program's own file")?;
        let mut reader = Command::new(&program);
        reader.args(["import", "--isolated"]).args(std::env::args_os().skip(2));
        let mut reader = reader.spawn().with_context(|| format!("cannot start {}", program.display()))?;
        let status = reader.wait().context("cannot wait for the reader of .h5 files")?;
        match status.code() {
            Some(0) => Ok(()),
            // It has said why.
            Some(code @ (1 | 2)) => std::process::exit(code),
            _ => {
                remove_unfinished(&self.out);
                bail!(
                    "the reader of .h5 files ended abruptly ({status}): {} is damaged, or needs more than {} GiB of memory; {} \
                     was not written",
                    self.frames.display(),
                    MAX_MEMORY_BYTES >> 30,
                    self.out.display()
                )
            }
        }
    }

    fn import(&self) -> Result<()> {
        let files = CommandFiles::default().reads([&self.frames]).reads(&self.poses).records([&self.out], never);
        let outputs = files.check(self.replace)?;
        let mut options = ImportOptions::default();
        if let Some(mount) = &self.mount {
            options.head_from_sensor = parse_mount(mount)?;
        }
        if let Some(pose) = &self.fixed_pose {
            let (position_m, quaternion_xyzw) = parse_numbers("pose", pose)?;
            options.fixed_pose = Some(Pose::try_new(position_m, quaternion_xyzw)?);
        }
        let summary =
            import_h5(&self.frames, self.poses.as_deref(), &options)?.write(&self.out, outputs.existing(&self.out))?;
        if let Some(sparse) = summary.sparse_poses(HistorySettings::default().max_gap_s) {
            log::warn!("{}", sparse.remedy());
        }
        outln!("{summary}")?;
        outln!("Written to {}", self.out.display())?;
        Ok(())
    }
}

/// Parses the mount: `x,y,z` or `x,y,z,qx,qy,qz,qw`.
pub(super) fn parse_mount(text: &str) -> Result<Pose> {
    let (position_m, quaternion_xyzw) = parse_numbers("mount", text)?;
    mount(position_m, quaternion_xyzw).with_context(|| format!("--mount {text}"))
}

/// Parses `x,y,z` or `x,y,z,qx,qy,qz,qw` into position and quaternion; `what` is its name in the error.
fn parse_numbers(what: &str, text: &str) -> Result<([f64; 3], [f64; 4])> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(([x, y, z], [0.0, 0.0, 0.0, 1.0])),
        Some(&[x, y, z, qx, qy, qz, qw]) => Ok(([x, y, z], [qx, qy, qz, qw])),
        _ => Err(anyhow!("\"{text}\" is no {what}: give x,y,z or x,y,z,qx,qy,qz,qw, numbers in metres")),
    }
}
