//! The page of processor time and latency.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use super::{Extent, Page, peers_table, program};
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
        .text(
            "From frames and poses to the scene, on one thread: over the first 10 s, in which every object and wall is new, \
             and over the first 60 s (not with plain instructions). `RADAR_CHAPERONE_INSTRUCTIONS` limits the set.",
        )
        .table(&by_instruction_set(extent)?)
        .heading("Replay of a recording")
        .text(
            "`radar-chaperone replay` of recordings of the furnished room, from the start of the command to its end: times real \
             time, the best of three.",
        )
        .table(&replay(extent)?)
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

/// Instruction sets that this processor has, the widest first; only that one if a short run is enough.
fn instruction_sets(extent: Extent) -> impl Iterator<Item = InstructionSet> {
    let sets: Vec<_> = InstructionSet::all_of_processor().collect();
    sets.into_iter().rev().take(extent.choose(usize::MAX, 1))
}

/// Shares of a core of the whole pipeline, one row per instruction set. An instruction set is chosen
/// once per process, so each is measured in a process of its own.
fn by_instruction_set(extent: Extent) -> Result<Table> {
    let own = std::env::current_exe().context("cannot find this program's file")?;
    let durations_s = extent.choose([10.0, 60.0], [2.0, 2.5]);
    let mut rows = Vec::new();
    for set in instruction_sets(extent) {
        let mut row = vec![set.to_string()];
        for (scene, duration_s) in
            SCENES.into_iter().flat_map(|scene| durations_s.map(|duration_s| (scene, duration_s)))
        {
            if set == InstructionSet::Portable && duration_s == durations_s[1] {
                row.push("–".into());
                continue;
            }
            let done = Command::new(&own)
                .env(INSTRUCTIONS_VARIABLE, set.name())
                .env("RAYON_NUM_THREADS", "1")
                .args(["results", "--whole-pipeline", scene, "--seconds", &duration_s.to_string()])
                .output()
                .with_context(|| format!("cannot run {}", own.display()))?;
            ensure!(done.status.success(), "with {set}: {}", String::from_utf8_lossy(&done.stderr));
            row.push(String::from_utf8_lossy(&done.stdout).trim().to_owned());
        }
        rows.push(row);
    }
    let of = |room: &str| durations_s.map(|duration_s| format!("{room} room, {duration_s} s, % of a core"));
    let head = [vec!["instruction set".to_owned()], of("furnished").to_vec(), of("empty").to_vec()].concat();
    Ok(Table { head, rows, caption: String::new() })
}

/// How many times real time a replay runs at.
fn replay(extent: Extent) -> Result<Table> {
    let program = match program() {
        Ok(program) => program,
        // A short run shows that the page can be made, also where the lab alone was built.
        Err(_) if extent == Extent::Quick => return Ok(Table::default()),
        Err(error) => return Err(error),
    };
    let folder = std::env::temp_dir().join(format!("radar-chaperone-replay-{}", std::process::id()));
    std::fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
    let table = replayed(&program, &folder, extent);
    std::fs::remove_dir_all(&folder)?;
    table
}

fn replayed(program: &Path, folder: &Path, extent: Extent) -> Result<Table> {
    let durations_s = extent.choose([60, 120], [2, 3]);
    let cores = std::thread::available_parallelism()?.get();
    let threads: Vec<usize> = [1, 2, 4].into_iter().filter(|threads| *threads <= cores).collect();
    let mut table = Table { head: vec!["instruction set".to_owned(), "recording, s".to_owned()], ..Table::default() };
    table.head.extend(threads.iter().map(|threads| format!("{threads} thread{}", if *threads > 1 { "s" } else { "" })));
    for duration_s in durations_s {
        let file = folder.join(format!("{duration_s}.mcap"));
        let length = duration_s.to_string();
        let simulate = ["simulate", "furnished-room", "--seed", "500", "--duration-s", &length, "--out"];
        run(Command::new(program).args(simulate).arg(&file))?;
        for set in instruction_sets(extent).filter(|set| *set != InstructionSet::Portable) {
            let mut row = vec![set.to_string(), length.clone()];
            for threads in &threads {
                let mut replay = Command::new(program);
                replay.env(INSTRUCTIONS_VARIABLE, set.name()).env("RAYON_NUM_THREADS", threads.to_string());
                let least_s = least_time_s(replay.arg("replay").arg(&file))?;
                row.push(format!("{:.1}", f64::from(duration_s) / least_s));
            }
            table.rows.push(row);
        }
    }
    Ok(table)
}

/// Replays of a recording, of which the fastest counts. Choice: two may both be disturbed.
const REPLAYS: usize = 3;

/// The least time that a command takes, seconds.
fn least_time_s(command: &mut Command) -> Result<f64> {
    let mut least_s = f64::INFINITY;
    for _ in 0..REPLAYS {
        let start = Instant::now();
        run(command)?;
        least_s = start.elapsed().as_secs_f64().min(least_s);
    }
    Ok(least_s)
}

/// Runs a command to its end.
fn run(command: &mut Command) -> Result<()> {
    let done = command.output().with_context(|| format!("cannot run {command:?}"))?;
    ensure!(done.status.success(), "{command:?}: {}", String::from_utf8_lossy(&done.stderr));
    Ok(())
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
