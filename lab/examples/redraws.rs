//! How often panels are redrawn, and the CPU time per frame of each display mode's drawing (this
//! thread's time), during play in the demo's furnished room.
//!
//!     cargo run --release -p lab --example redraws -- [SECONDS]

use radar_mapping::{Event, in_time_order};
use std::collections::BTreeMap;

use a121::preset;
use radar_chaperone::app::thread_cpu_ns;
use radar_chaperone::render::{EyeView, Renderer, StereoScene, Window};
use radar_chaperone::settings::Settings;
use radar_chaperone::warning::{WarningTracker, Wearer};
use radar_mapping::Mapper;
use radar_mapping::Scene;
use radar_sar::geometry::Pose;
use radar_simulation::{Scenario, Simulated};

/// Period of a display frame, nanoseconds: 90 Hz. Choice: the usual rate of headsets, 90 Hz.
const FRAME_NS: i64 = 11_111_111;

/// A head pose for every display frame, and the scene when it has changed.
fn frames(played: Simulated, scenario: &Scenario, settings: &Settings) -> Vec<(Pose, Option<Scene>)> {
    let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &settings.mapping());
    let mut next_ns = i64::MIN;
    let mut known = Scene::default();
    let mut frames = Vec::new();
    for event in in_time_order(played.frames, played.poses) {
        let pose = if let Event::Pose(pose) = &event { Some(*pose) } else { None };
        let _ = mapper.push(event);
        let Some(sample) = pose else { continue };
        let Ok(head) = sample.tracking_from_head() else { continue };
        if sample.time_ns < next_ns {
            continue;
        }
        next_ns = next_ns.max(sample.time_ns - FRAME_NS) + FRAME_NS;
        let scene = mapper.scene();
        let is_new = scene.obstacles != known.obstacles || scene.walls != known.walls;
        frames.push((head, is_new.then(|| scene.clone())));
        known = scene;
    }
    frames
}

/// Mean and 99th percentile of times in nanoseconds, as text in microseconds.
fn described(times_ns: &mut [u64]) -> String {
    times_ns.sort_unstable();
    let mean = times_ns.iter().sum::<u64>() as f64 / times_ns.len().max(1) as f64;
    let p99 = times_ns.get(times_ns.len() * 99 / 100).copied().unwrap_or(0);
    format!("mean {:.0} µs, p99 {:.0} µs", mean / 1e3, p99 as f64 / 1e3)
}

fn main() -> anyhow::Result<()> {
    let seconds = std::env::args().nth(1).map_or(Ok(30.0), |s| s.parse())?;
    let config = preset("d16").expect("the preset is there");
    let scenario = Scenario::new("furnished-room", "natural", config, seconds, 1);
    let settings = Settings::default();
    let frames = frames(scenario.run()?, &scenario, &settings);
    let scenes = frames.iter().filter(|(_, scene)| scene.is_some()).count();
    println!("{} frames, {scenes} scenes that differ", frames.len());
    for (name, last_scene_alone) in [("detected during play", false), ("all known from the start", true)] {
        play(name, &frames, last_scene_alone, &settings)?;
    }
    measure_spatial_displays(&frames, &settings)
}

fn play(name: &str, frames: &[(Pose, Option<Scene>)], last_alone: bool, settings: &Settings) -> anyhow::Result<()> {
    let mut renderer = Renderer::new()?;
    let last = frames.iter().rev().find_map(|(_, scene)| scene.clone()).unwrap_or_default();
    let mut scene = if last_alone { last } else { Scene::default() };
    let mut tracker = WarningTracker::new();
    tracker.update(&scene);
    let (mut see_ns, mut warn_ns, mut quads_ns) = (Vec::new(), Vec::new(), Vec::new());
    let mut shown_frames = BTreeMap::<(u64, bool), u64>::new();
    for (frame, (head, new)) in frames.iter().enumerate() {
        if let Some(new) = new.as_ref().filter(|_| !last_alone) {
            scene = new.clone();
            let start = thread_cpu_ns();
            tracker.update(&scene);
            see_ns.push((thread_cpu_ns() - start) as u64);
        }
        let start = thread_cpu_ns();
        let warnings = tracker.warn(&Wearer::head_only(frame as i64 * FRAME_NS, *head), &settings.warning);
        let between = thread_cpu_ns();
        let quads = renderer.quads(&warnings, &settings.warning)?;
        let end = thread_cpu_ns();
        for quad in &quads {
            *shown_frames.entry((quad.id, quad.on_floor)).or_default() += 1;
        }
        warn_ns.push((between - start) as u64);
        quads_ns.push((end - between) as u64);
    }
    let shown_s = shown_frames.values().sum::<u64>() as f64 * FRAME_NS as f64 * 1e-9;
    let points: usize = scene.obstacles.iter().map(|o| o.shape.len()).sum();
    println!("{name}: {} obstacles of {points} points, {} walls", scene.obstacles.len(), scene.walls.len());
    println!("  {:.1} quads shown on average", shown_s / (frames.len() as f64 * FRAME_NS as f64 * 1e-9));
    let drawn = renderer.textures_drawn();
    println!("  {drawn} textures drawn: {:.2} per second and shown quad", drawn as f64 / shown_s);
    println!("  see, for {} new scenes: {}", see_ns.len(), described(&mut see_ns));
    println!("  warn: {}", described(&mut warn_ns));
    println!("  quads: {}", described(&mut quads_ns));
    Ok(())
}

/// Every tenth frame as drawn by the display modes `stereo` and `projection`.
fn measure_spatial_displays(frames: &[(Pose, Option<Scene>)], settings: &Settings) -> anyhow::Result<()> {
    let mut renderer = Renderer::new()?;
    let mut tracker = WarningTracker::new();
    tracker.update(&frames.iter().rev().find_map(|(_, scene)| scene.clone()).unwrap_or_default());
    let (mut windows_ns, mut eyes_ns) = (Vec::new(), Vec::new());
    for (frame, (head, _)) in frames.iter().enumerate() {
        let warnings = tracker.warn(&Wearer::head_only(frame as i64 * FRAME_NS, *head), &settings.warning);
        if frame % 10 != 0 {
            continue;
        }
        let quads = renderer.quads(&warnings.clone().without_silhouettes(), &settings.warning)?;
        let views = EyeView::pair(head, 0.064, 1.75, [1024, 1024]);
        let start = thread_cpu_ns();
        let shapes = tracker.shapes(&warnings);
        let scenery = StereoScene { quads: &quads, shapes: &shapes, color: settings.warning.color };
        let eyes_m = views.map(|view| view.tracking_from_eye.translation);
        renderer.windows(&scenery, &Window::of_panels(&scenery, eyes_m), eyes_m)?;
        let between = thread_cpu_ns();
        for (side, view) in views.iter().enumerate() {
            renderer.eye(&scenery, side, view)?;
        }
        windows_ns.push((between - start) as u64);
        eyes_ns.push((thread_cpu_ns() - between) as u64);
    }
    println!("all windows of a frame: {}", described(&mut windows_ns));
    println!("both eyes' pictures of a frame: {}", described(&mut eyes_ns));
    Ok(())
}
