//! The page of processor time and latency.

use std::process::Command;

use anyhow::{Context, Result, ensure};

use super::{Extent, Page, peers_table};
use crate::experiments::{LiveLatency, PipelineCost};
use radar_chaperone::report::Table;
use radar_sar::{INSTRUCTIONS_VARIABLE, InstructionSet};

const SCENES: [&str; 2] = ["furnished-room", "empty-room"];
const MOTIONS: [(&str, &str); 4] = [
    ("natural", "play"),
    ("stationary", "at rest"),
    ("x-50cm", "to and fro along a line of 50 cm"),
    ("straight-0.3", "straight on, 0.3 m/s"),
];

pub(super) fn page(extent: Extent) -> Result<Page> {
    let duration_s = extent.choose(30.0, 2.0);
    let mut page = Page::new("Speed", "")
        .text(
            "Simulated natural play, preset d16. A share of a core is processor time of all threads over the length of \
             the recording; each stage is repeated three times and the shortest counts. Nothing else was running.",
        )
        .heading("Dense backprojection beside plain C")
        .table(&peers_table(extent)?)
        .heading("The whole pipeline by instruction set")
        .text("From frames and poses to the scene, on one thread, 10 s. `RADAR_CHAPERONE_INSTRUCTIONS` limits the set.")
        .table(&by_instruction_set(extent, extent.choose(10.0, 2.0))?)
        .heading("The whole pipeline by motion")
        .text("At rest and along a straight line the data do not show the time offset and the mount.")
        .table(&by_motion(duration_s)?)
        .heading("Stages");
    for scene in SCENES {
        page = page.table(&PipelineCost::of_play(scene, duration_s).table(false)?);
    }
    let session = LiveLatency { duration_s: extent.choose(60.0, 2.0), ..LiveLatency::default() };
    Ok(page
        .heading("Latency beside a frame loop")
        .text(
            "In real time: a furnished room, frames arrive 2 ms after their end, poses and display frames 90 times a \
             second; the frame loop takes the newest scene and computes its warnings at every display frame.",
        )
        .table(&session.table())
        .heading("More")
        .text(
            "`cargo bench -p radar-sar` measures backprojection in updates (one voxel, one sweep) per second, `cargo \
             bench -p lab` the adaptive search and the rolling image.",
        ))
}

/// Shares of a core of the whole pipeline, one row per instruction set that this processor has. An
/// instruction set is chosen once per process, so each is measured in a process of its own.
fn by_instruction_set(extent: Extent, duration_s: f64) -> Result<Table> {
    let own = std::env::current_exe().context("cannot find this program's file")?;
    let mut rows = Vec::new();
    let mut sets: Vec<_> = InstructionSet::all_of_processor().collect();
    sets.reverse();
    for set in sets.into_iter().take(extent.choose(usize::MAX, 1)) {
        let mut row = vec![set.to_string()];
        for scene in SCENES {
            let done = Command::new(&own)
                .env(INSTRUCTIONS_VARIABLE, set.name())
                .args(["results", "--whole-pipeline", scene, "--seconds", &duration_s.to_string()])
                .output()
                .with_context(|| format!("cannot run {}", own.display()))?;
            ensure!(done.status.success(), "with {set}: {}", String::from_utf8_lossy(&done.stderr));
            row.push(String::from_utf8_lossy(&done.stdout).trim().to_owned());
        }
        rows.push(row);
    }
    let head = ["instruction set", "furnished room, % of a core", "empty room, % of a core"];
    Ok(Table { head: head.map(str::to_owned).to_vec(), rows, caption: String::new() })
}

fn by_motion(duration_s: f64) -> Result<Table> {
    let mut rows = Vec::new();
    for (motion, description) in MOTIONS {
        let mut row = vec![description.to_owned()];
        for scene in SCENES {
            row.push(PipelineCost { motion: motion.into(), ..PipelineCost::of_play(scene, duration_s) }.whole_share()?);
        }
        rows.push(row);
    }
    let head = ["motion", "furnished room, % of a core", "empty room, % of a core"];
    let caption = format!("{duration_s} s, all threads");
    Ok(Table { head: head.map(str::to_owned).to_vec(), rows, caption })
}

/// Share of a core of the whole pipeline, percent.
///
/// # Errors
/// There is no such scene.
pub fn whole_pipeline_share(scene: &str, duration_s: f64) -> Result<String> {
    Ok(PipelineCost::of_play(scene, duration_s).whole_share()?)
}
