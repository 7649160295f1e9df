//! The page of large scale: how time and memory grow.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use a121::preset;
use anyhow::{Context, Result, bail};
use glam::DVec3;

use super::memory::watch;
use super::peers::POINTS;
use super::{DenseJob, Extent, Page};
use radar_chaperone::report::Table;
use radar_mapping::{Mapper, MappingSettings};
use radar_recording::{Existing, Header, MapFile, Recording, RecordingWriter};
use radar_sar::Statistic;
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_simulation::Scenario;

/// Distance between the middles of a house's rooms, metres: those of `furnished-room` are 4 by 5 m.
const ROOM_PITCH_M: f64 = 6.0;
/// Area of such a room, m².
const ROOM_M2: usize = 20;
/// Rooms in a row of a house.
const ROOMS_IN_ROW: usize = 5;
/// Time without frames and poses between two rooms, seconds: a walk with the headset in the hand.
const WALK_S: f64 = 5.0;
/// First seed of the rooms.
const SEED: u64 = 8500;
/// How long a replay may take. Choice: longer than the longest recording, so that a replay slower than real time is stopped.
const MAX_REPLAY: Duration = Duration::from_secs(2400);

/// Play in one furnished room after the other.
#[derive(Debug, Clone, Copy)]
struct House {
    rooms: usize,
    seconds_per_room: f64,
}

/// What a house costs.
struct Cost {
    house: House,
    replay_s: f64,
    peak_kib: u64,
    obstacles: usize,
    walls: usize,
    map_bytes: u64,
    save_s: f64,
    load_s: f64,
}

pub(super) fn page(extent: Extent) -> Result<Page> {
    let program = super::program()?;
    let folder = std::env::temp_dir().join(format!("radar-chaperone-scale-{}", std::process::id()));
    std::fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
    let page = measured(&program, &folder, extent);
    std::fs::remove_dir_all(&folder)?;
    page
}

fn measured(program: &Path, folder: &Path, extent: Extent) -> Result<Page> {
    let seconds_per_room = extent.choose(120.0, 4.0);
    let counts: &[usize] = extent.choose(&[1, 2, 5, 10], &[1, 2]);
    let houses = counts.iter().map(|&rooms| House { rooms, seconds_per_room });
    let houses = houses.map(|house| house.cost(program, folder)).collect::<Result<Vec<_>>>()?;
    let minutes: &[f64] = extent.choose(&[2.0, 8.0, 32.0], &[0.05, 0.1]);
    let long = minutes.iter().map(|&minutes| House { rooms: 1, seconds_per_room: 60.0 * minutes });
    let long = long.map(|house| house.cost(program, folder)).collect::<Result<Vec<_>>>()?;
    Ok(Page::new("Scale", "")
        .text(
            "How time and memory grow. An exponent is the slope of the least-squares line through the logarithms: 1 is \
             growth in proportion, 0 none.",
        )
        .heading("A house")
        .text(&format!(
            "Play in one furnished room after the other, {seconds_per_room} s in each, preset d16; the whole is one \
             recording, and the map keeps all rooms. `replay`, the save and the load of the map were timed on all cores."
        ))
        .table(&cost_table(&houses, |cost| cost.house.rooms as f64, "rooms"))
        .heading("Longer in one room")
        .table(&cost_table(&long, |cost| cost.house.minutes(), "minutes"))
        .heading("Dense volumes")
        .text("`ls` on one thread; those of one row differ in one number alone.")
        .table(&dense_table(extent)))
}

impl House {
    fn minutes(&self) -> f64 {
        self.rooms as f64 * self.seconds_per_room / 60.0
    }

    fn cost(self, program: &Path, folder: &Path) -> Result<Cost> {
        let (path, map) = (folder.join("house.mcap"), folder.join("map.json"));
        self.write(&path)?;
        let (peak_kib, replay_s, end) = watch(Command::new(program).arg("replay").arg(&path), MAX_REPLAY)?;
        if end != "done" {
            bail!("`replay` of {} rooms was {end}", self.rooms);
        }
        let mut recording = Recording::open(&path)?;
        let header = recording.header();
        let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &MappingSettings::default());
        mapper.push_all(&mut recording);
        let scene = mapper.scene();
        let file = MapFile::new(1, 0.0, Pose::IDENTITY, mapper.saved_map());
        let (save_s, saved) = timed(|| file.write(&map));
        saved?;
        let (load_s, loaded) = timed(|| MapFile::read(&map));
        loaded?;
        let map_bytes = std::fs::metadata(&map)?.len();
        let (obstacles, walls) = (scene.obstacles.len(), scene.walls.len());
        Ok(Cost { house: self, replay_s, peak_kib, obstacles, walls, map_bytes, save_s, load_s })
    }

    fn write(self, path: &Path) -> Result<()> {
        let config = preset("d16").context("d16 is a preset")?;
        let scenario = |room: usize| {
            Scenario::new("furnished-room", "natural", config.clone(), self.seconds_per_room, SEED + room as u64)
        };
        let header = Header::new("house", config.clone(), scenario(0).head_from_sensor);
        let mut writer = RecordingWriter::create(path, &header, Existing::Replace)?;
        for room in 0..self.rooms {
            let simulated = scenario(room).run()?;
            let later_ns = (room as f64 * (self.seconds_per_room + WALK_S) * 1e9) as i64;
            let (column, row) = (room % ROOMS_IN_ROW, room / ROOMS_IN_ROW);
            let middle_m = DVec3::new(column as f64, 0.0, row as f64) * ROOM_PITCH_M;
            let mut poses = simulated.poses.into_iter().peekable();
            // In the order of arrival, as the recorder writes: the reader keeps poses of minutes, not of hours.
            for mut frame in simulated.frames {
                while let Some(mut pose) = poses.next_if(|pose| pose.time_ns <= frame.host_time_ns) {
                    pose.time_ns += later_ns;
                    pose.position_m = (DVec3::from_array(pose.position_m) + middle_m).to_array();
                    writer.write_pose(&pose)?;
                }
                frame.host_time_ns += later_ns;
                frame.tick += later_ns / 1000;
                writer.write_frame(&frame)?;
            }
        }
        writer.finish()?;
        Ok(())
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let done = work();
    (start.elapsed().as_secs_f64(), done)
}

fn cost_table(costs: &[Cost], size: impl Fn(&Cost) -> f64, name: &str) -> Table {
    let row = |cost: &Cost| {
        vec![
            cost.house.rooms.to_string(),
            (cost.house.rooms * ROOM_M2).to_string(),
            format!("{:.1}", cost.house.minutes()),
            format!("{:.1}", cost.replay_s),
            format!("{:.0}", cost.house.minutes() * 60.0 / cost.replay_s),
            (cost.peak_kib / 1024).to_string(),
            cost.obstacles.to_string(),
            cost.walls.to_string(),
            format!("{:.0}", cost.map_bytes as f64 * 1e-3),
            format!("{:.1}", cost.save_s * 1e3),
            format!("{:.1}", cost.load_s * 1e3),
        ]
    };
    let of = |value: &dyn Fn(&Cost) -> f64| exponent(costs.iter().map(|cost| (size(cost), value(cost))));
    let (time, memory) = (of(&|cost| cost.replay_s), of(&|cost| cost.peak_kib as f64));
    let (bytes, load) = (of(&|cost| cost.map_bytes as f64), of(&|cost| cost.load_s));
    let head = [
        "rooms",
        "m²",
        "min",
        "replay, s",
        "times real time",
        "peak, MiB",
        "obstacles",
        "walls",
        "map, kB",
        "save, ms",
        "load, ms",
    ];
    Table {
        head: head.map(str::to_owned).to_vec(),
        rows: costs.iter().map(row).collect(),
        caption: format!(
            "Exponents with the number of {name}: time {time:.2}, peak memory {memory:.2}, size of the map {bytes:.2}, its load {load:.2}."
        ),
    }
}

fn dense_table(extent: Extent) -> Table {
    let base = DenseJob { statistic: Statistic::Ls, voxels: 64, sweeps: 100, points: POINTS, from_raw_sweeps: false };
    let sides: &[u32] = extent.choose(&[32, 64, 128, 192], &[8, 16]);
    let sweeps: &[usize] = extent.choose(&[50, 100, 200, 400, 800], &[5, 10]);
    let points: &[usize] = extent.choose(&[POINTS, 2 * POINTS, 4 * POINTS, 8 * POINTS], &[POINTS, 2 * POINTS]);
    let of = |name: &str, jobs: Vec<(f64, DenseJob)>| {
        let times: Vec<_> = jobs.iter().map(|(size, job)| (*size, on_one_thread(job))).collect();
        let list = |values: Vec<String>| values.join(", ");
        vec![
            name.to_owned(),
            list(times.iter().map(|(size, _)| size.to_string()).collect()),
            list(times.iter().map(|(_, seconds)| format!("{:.2}", seconds * 1e3)).collect()),
            format!("{:.2}", exponent(times.into_iter())),
        ]
    };
    let small = DenseJob { voxels: extent.choose(64, 8), sweeps: extent.choose(100, 5), ..base };
    let rows = vec![
        of("voxels", sides.iter().map(|&voxels| (f64::from(voxels).powi(3), DenseJob { voxels, ..small })).collect()),
        of("sweeps", sweeps.iter().map(|&sweeps| (sweeps as f64, DenseJob { sweeps, ..small })).collect()),
        of(
            "points of a sweep (range), from raw sweeps",
            points
                .iter()
                .map(|&points| (points as f64, DenseJob { points, voxels: 8, from_raw_sweeps: true, ..small }))
                .collect(),
        ),
    ];
    let head = ["number of", "values", "ms", "exponent"].map(str::to_owned).to_vec();
    Table { head, rows, caption: String::new() }
}

fn on_one_thread(job: &DenseJob) -> f64 {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(|| job.seconds()),
        Err(_) => f64::NAN,
    }
}

/// Slope of the least-squares line through the logarithms.
fn exponent(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let logs: Vec<_> = points.map(|(x, y)| (math::ln(x), math::ln(y))).collect();
    let count = logs.len() as f64;
    let (mean_x, mean_y) =
        (logs.iter().map(|p| p.0).sum::<f64>() / count, logs.iter().map(|p| p.1).sum::<f64>() / count);
    let covariance: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    covariance / logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::{exponent, math};

    #[test]
    fn exponents_are_those_of_powers() {
        let of = |power: f64| exponent([1.0, 2.0, 5.0, 40.0].into_iter().map(|x: f64| (x, 3.0 * math::powf(x, power))));
        for power in [0.0, 0.5, 1.0, 3.0] {
            assert!((of(power) - power).abs() < 1e-12);
        }
    }
}
