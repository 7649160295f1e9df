//! The page of peak memory: every command that reads a recording, over files made to swell.

mod vendor_file;

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use a121::{Frame, preset};
use anyhow::{Context, Result};
use num_complex::Complex;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Extent, Page};
use radar_chaperone::report::Table;
use radar_recording::{Existing, Header, RecordingWriter};
use radar_sar::geometry::Pose;
use radar_sar::{PoseSample, TrackingResult};

/// Commands on a recording: where they write, and further options.
const COMMANDS: [(&str, &str, &str); 7] = [
    ("info", "", ""),
    ("replay", "", ""),
    ("recover", "--out out.mcap", ""),
    ("reconstruct", "--out out.npy", ""),
    ("reconstruct", "--out out.npy", "--sweeps 200"),
    ("reconstruct", "--out out.npy", "--sweeps 200 --search adaptive"),
    ("calibrate", "", ""),
];
/// The same on a file of the vendor's tool, in the process that reads it.
const IMPORTS: [(&str, &str, &str); 2] = [
    ("import", "--isolated --out out.mcap", "--fixed-pose"),
    ("import", "--isolated --out out.mcap", "--poses track.tum"),
];
/// How long a command may take before it is stopped. Choice: long enough for its memory to have become steady.
const MAX_DURATION: Duration = Duration::from_secs(60);
/// Memory at which a command is stopped, KiB. Choice: what the machine can spare.
const MAX_KIB: u64 = 8 << 20;

/// A recording that is sound but for what it holds.
struct Swelling {
    name: &'static str,
    /// Frames, and poses of the same times.
    frames: usize,
    poses: usize,
    samples: Samples,
}

#[derive(Clone, Copy)]
enum Samples {
    /// A frame has none.
    None,
    /// All zero: a hundredth of their size on disk.
    Silence,
    /// Does not shrink.
    Noise,
}

pub(super) fn page(extent: Extent) -> Result<Page> {
    let program = super::program()?;
    let folder = std::env::temp_dir().join(format!("radar-chaperone-memory-{}", std::process::id()));
    std::fs::create_dir(&folder).with_context(|| folder.display().to_string())?;
    let table = measured(&program, &folder, extent);
    std::fs::remove_dir_all(&folder)?;
    Ok(Page::new("Memory", "")
        .text(
            "Greatest resident memory of each command that reads a recording, over recordings made to swell: millions of \
             frames without a sample, of poses, and hours of silence, which take a hundredth of their size on disk; and \
             noise, which does not shrink. Files of the vendor's tool: silence that is packed, noise that is not, and with \
             them a track of 100 MB. `reconstruct` makes its volume of 3 m in voxels of 5 cm. A command that took \
             longer than a minute was stopped.",
        )
        .table(&table?)
        .text(
            "By design: one chunk of a recording, at most 32 MiB, and its events are held at a time. `reconstruct` holds the \
             sweeps that it uses, at most 60 000 (20 000 with `--search adaptive`) with 8 bytes a sample and 5 to 46 kB of \
             tables each, and 40 bytes for each of at most two million sweeps to choose among. `calibrate` holds the first \
             34 MiB of the streams and what it computes from them. `replay` holds what the map needs, whatever the length, and \
             reads at most two batches of 2^20 samples ahead. `import` holds the file, at most 1 GiB, and 24 bytes for each of at \
             most two million frames.",
        ))
}

fn measured(program: &Path, folder: &Path, extent: Extent) -> Result<Table> {
    let head = ["file", "MB", "command", "peak, MiB", "s", "end"].map(str::to_owned).to_vec();
    let mut rows = Vec::new();
    for file in files(extent) {
        let path = folder.join("in.mcap");
        file.write(&path)?;
        rows.extend(measured_commands(program, file.name, &path, &COMMANDS)?);
        std::fs::remove_file(path)?;
    }
    let track = vendor_file::track(extent.choose(6_250_000, 1000));
    std::fs::write(folder.join("track.tum"), track)?;
    for (name, is_silent, samples) in [
        ("vendor's, silence", true, extent.choose(250_000_000, 100_000)),
        ("vendor's, noise", false, extent.choose(25_000_000, 100_000)),
    ] {
        let path = folder.join("in.h5");
        std::fs::write(&path, vendor_file::h5(samples / samples_per_frame(), is_silent)?)?;
        rows.extend(measured_commands(program, name, &path, &IMPORTS)?);
        std::fs::remove_file(path)?;
    }
    Ok(Table { head, rows, caption: String::new() })
}

/// A row for each command on a file.
fn measured_commands(
    program: &Path,
    name: &str,
    path: &Path,
    commands: &[(&str, &str, &str)],
) -> Result<Vec<Vec<String>>> {
    let megabytes = std::fs::metadata(path)?.len() as f64 * 1e-6;
    let folder = path.parent().context("the file is in a folder")?;
    let row = |(command, out, options): &(&str, &str, &str)| {
        let mut run = Command::new(program);
        run.arg(command).arg(path).args(out.split_whitespace()).args(options.split_whitespace());
        let (peak_kib, took_s, end) = watch(run.current_dir(folder), MAX_DURATION)?;
        for name in ["out.mcap", "out.npy", "out.json"] {
            let _ = std::fs::remove_file(folder.join(name));
        }
        let peak_mib = (peak_kib / 1024).to_string();
        let command = format!("{command} {options}");
        Ok(vec![name.into(), format!("{megabytes:.1}"), command, peak_mib, format!("{took_s:.0}"), end])
    };
    commands.iter().map(row).collect()
}

fn files(extent: Extent) -> [Swelling; 4] {
    let many = extent.choose(5_000_000, 10_000);
    let [silent, noisy] =
        [extent.choose(400_000_000, 1_000_000), extent.choose(25_000_000, 1_000_000)].map(|n| n / samples_per_frame());
    let swelling = |name, frames, poses, samples| Swelling { name, frames, poses, samples };
    [
        swelling("frames without samples", many, 0, Samples::None),
        swelling("silence", silent, silent, Samples::Silence),
        swelling("poses", 0, many, Samples::None),
        swelling("noise", noisy, noisy, Samples::Noise),
    ]
}

fn samples_per_frame() -> usize {
    preset("d16").map_or(1, |config| a121::FrameLayout::of(&config).samples_per_frame())
}

impl Swelling {
    fn write(&self, path: &Path) -> Result<()> {
        const PERIOD_NS: i64 = 15_000_000;
        let config = preset("d16").context("d16 is a preset")?;
        let mut writer =
            RecordingWriter::create(path, &Header::new(self.name, config, Pose::IDENTITY), Existing::Replace)?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for n in 0..self.frames.max(self.poses) {
            let time_ns = n as i64 * PERIOD_NS;
            if n < self.poses {
                writer.write_pose(&PoseSample {
                    time_ns,
                    position_m: [(n % 2) as f64 * 0.001, 0.0, 0.0],
                    quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
                    valid: true,
                    result: TrackingResult::Ok,
                })?;
            }
            if n < self.frames {
                writer.write_frame(&Frame {
                    tick: time_ns / 1000,
                    host_time_ns: time_ns,
                    temperature_c: 30,
                    data_saturated: false,
                    frame_delayed: false,
                    calibration_needed: false,
                    samples: self.samples.of_frame(&mut rng),
                })?;
            }
        }
        writer.finish()?;
        Ok(())
    }
}

impl Samples {
    fn of_frame(self, rng: &mut ChaCha8Rng) -> Vec<Complex<i16>> {
        let count = samples_per_frame();
        match self {
            Self::None => Vec::new(),
            Self::Silence => vec![Complex::new(0, 0); count],
            Self::Noise => (0..count).map(|_| Complex::new(rng.random(), rng.random())).collect(),
        }
    }
}

/// Greatest resident memory, KiB, seconds taken, and how it ended.
pub(super) fn watch(command: &mut Command, max: Duration) -> Result<(u64, f64, String)> {
    let start = Instant::now();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    let mut peak_kib = 0;
    loop {
        if let Ok(status) = std::fs::read_to_string(format!("/proc/{}/status", child.id())) {
            let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or_default();
            peak_kib = peak_kib.max(line.split_whitespace().nth(1).and_then(|n| n.parse().ok()).unwrap_or(0));
        }
        let took_s = start.elapsed().as_secs_f64();
        if let Some(status) = child.try_wait()? {
            let end = if status.success() { "done" } else { "refused" };
            return Ok((peak_kib, took_s, status.code().map_or("killed".into(), |_| end.into())));
        }
        if start.elapsed() > max || peak_kib > MAX_KIB {
            child.kill()?;
            child.wait()?;
            return Ok((peak_kib, took_s, "stopped".into()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
