//! Peak memory of every command that reads a recording, over files made to swell.
//!
//!     cargo build --release && cargo run --release -p lab --example hostile_memory -- PROGRAM FOLDER [MEGABYTES]
//!
//! Writes into FOLDER recordings that are sound but for what they hold: millions of frames without a
//! sample, of silent frames and of poses, which shrink to a hundredth on disk; and noise of
//! MEGABYTES (default 100), which does not shrink. Prints the greatest resident memory of each
//! command and how it ended.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use a121::{Frame, preset};
use num_complex::Complex;
use radar_recording::{Header, RecordingWriter};
use radar_sar::geometry::Pose;
use radar_sar::{PoseSample, TrackingResult};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const COMMANDS: [(&str, &[&str]); 7] = [
    ("info", &[]),
    ("replay", &[]),
    ("recover", &["--out", "OUT.mcap"]),
    ("reconstruct", &["--out", "OUT.npy"]),
    ("reconstruct", &["--out", "OUT.npy", "--sweeps", "200"]),
    ("reconstruct", &["--out", "OUT.npy", "--sweeps", "200", "--search", "adaptive"]),
    ("calibrate", &[]),
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [program, folder, rest @ ..] = arguments.as_slice() else { panic!("give the program and a folder") };
    let megabytes = rest.first().map_or(100, |text| text.parse().expect("megabytes"));
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    println!("| file | MB | command | peak, MiB | s | end |\n|---|--:|---|--:|--:|---|");
    for (name, write) in files(megabytes) {
        let file = folder.join(name).with_extension("mcap");
        write(&file);
        for (command, options) in COMMANDS {
            let out = folder.join("out").display().to_string();
            let options: Vec<String> = options.iter().map(|o| o.replace("OUT", &out)).collect();
            let megabytes = std::fs::metadata(&file).expect("written").len() as f64 * 1e-6;
            let (peak, took, end) = watch(Command::new(program).arg(command).arg(&file).args(&options));
            println!(
                "| {name} | {megabytes:.1} | {command} {} | {peak} | {took:.0} | {end} |",
                options[options.len().min(2)..].join(" ")
            );
            for extension in ["mcap", "npy", "json"] {
                let _ = std::fs::remove_file(folder.join("out").with_extension(extension));
            }
        }
        let _ = std::fs::remove_file(file);
    }
}

type Write = Box<dyn Fn(&Path)>;

fn files(megabytes: usize) -> [(&'static str, Write); 4] {
    let samples = a121::FrameLayout::of(&preset("d16").expect("a preset")).samples_per_frame();
    let of = move |count: usize, frame: fn(&mut ChaCha8Rng, usize) -> Vec<Complex<i16>>, samples: usize| {
        move |path: &Path| write(path, count, &mut |rng| frame(rng, samples))
    };
    [
        ("empty frames", Box::new(of(5_000_000, |_, _| Vec::new(), 0))),
        ("silent frames", Box::new(of(400_000_000 / samples, |_, n| vec![Complex::new(0, 0); n], samples))),
        ("poses", Box::new(|path: &Path| write(path, 0, &mut |_| Vec::new()))),
        ("noise", Box::new(of(megabytes * 250_000 / samples, noise, samples))),
    ]
}

fn noise(rng: &mut ChaCha8Rng, samples: usize) -> Vec<Complex<i16>> {
    (0..samples).map(|_| Complex::new(rng.random(), rng.random())).collect()
}

/// Frames with a pose each, but for empty frames; without frames, five million poses.
fn write(path: &Path, frames: usize, samples: &mut dyn FnMut(&mut ChaCha8Rng) -> Vec<Complex<i16>>) {
    const PERIOD_NS: i64 = 15_000_000;
    let _ = std::fs::remove_file(path);
    let header = Header::new("hostile", preset("d16").expect("a preset"), Pose::IDENTITY);
    let mut writer = RecordingWriter::create(path, &header).expect("a writer");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for n in 0..frames.max(5_000_000 * usize::from(frames == 0)) as i64 {
        let time_ns = n * PERIOD_NS;
        let pose = PoseSample {
            time_ns,
            position_m: [(n % 2) as f64 * 0.001, 0.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            valid: true,
            result: TrackingResult::Ok,
        };
        let samples = samples(&mut rng);
        if frames == 0 || !samples.is_empty() {
            writer.write_pose(&pose).expect("written");
        }
        if frames > 0 {
            let frame = Frame {
                tick: time_ns / 1_000,
                host_time_ns: time_ns,
                temperature_c: 30,
                data_saturated: false,
                frame_delayed: false,
                calibration_needed: false,
                samples,
            };
            writer.write_frame(&frame).expect("written");
        }
    }
    writer.finish().expect("finished");
}

/// Greatest resident memory, MiB, seconds taken, and how it ended: at most two minutes.
fn watch(command: &mut Command) -> (u64, f64, String) {
    let start = Instant::now();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program");
    let mut peak_kib = 0;
    loop {
        if let Ok(status) = std::fs::read_to_string(format!("/proc/{}/status", child.id())) {
            let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap_or_default();
            peak_kib = peak_kib.max(line.split_whitespace().nth(1).and_then(|n| n.parse().ok()).unwrap_or(0));
        }
        if let Some(status) = child.try_wait().expect("waited") {
            return (
                peak_kib / 1024,
                start.elapsed().as_secs_f64(),
                status.code().map_or("killed".into(), |c| c.to_string()),
            );
        }
        if start.elapsed() > Duration::from_secs(120) || peak_kib > 8 << 20 {
            child.kill().expect("killed");
            let _ = child.wait();
            return (peak_kib / 1024, start.elapsed().as_secs_f64(), "stopped".into());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
