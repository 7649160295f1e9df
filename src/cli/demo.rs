//! `radar-chaperone demo [--out DIR] [--view]`: the whole mapper without hardware.
//!
//! Six scenes: each is simulated and recorded, replayed from its recording through the mapper,
//! imaged, scored against the truth and rendered for both eyes. The result is one self-contained
//! report.html.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use clap::Args;
use glam::DVec3;
use indicatif::ProgressBar;

use super::files::SweepSource;
use super::outputs::{CommandFiles, Outputs, ReplaceArgument, begins_with};
use super::replay::{
    Replay, is_found_cloud, is_found_picture, is_obstacles, obstacle_table, obstacles_bytes, result_text, sensor_path,
};
use super::simulate::{effects_in, write_scenario};
use super::view::{ViewArguments, is_shot};
use crate::app::progress;
use crate::render::{EyeView, Renderer};
use crate::report::{
    Figure, Limits, Marks, Report, RoomMap, Score, Section, Table, cross_sections, ply_bytes, point_cloud,
    points_above, room_map, score,
};
use crate::settings::Settings;
use crate::warning::{Warnings, warn};
use a121::preset;
use radar_mapping::ObserverSettings;
use radar_mapping::Scene;
use radar_mapping::{Mapper, cube_ahead};
use radar_recording::{Header, Recording};
use radar_sar::Observation;
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::{Aabb, Pose};
use radar_sar::truth::Truth;
use radar_sar::{Statistic, Volume, farthest_points, subaperture_volume};
use radar_simulation::Scenario;

/// Shows everything without hardware: simulated rooms, recordings, obstacles, figures, eye
/// previews, report.html
///
/// With --view or --view-shot only the furnished room is simulated, recorded and shown.
#[derive(Debug, Args)]
pub(super) struct Demo {
    /// Folder for everything that the demo writes
    #[arg(long, default_value = "demo-out", value_name = "DIR")]
    out: PathBuf,
    /// Seed of all randomness
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    replace: ReplaceArgument,
    // With it, only the furnished room is simulated, recorded and shown.
    #[command(flatten)]
    view: ViewArguments,
}

/// One scene of the demo.
struct DemoScene {
    heading: &'static str,
    text: &'static str,
    folder: &'static str,
    scene: &'static str,
    motion: &'static str,
    preset: &'static str,
    duration_s: f64,
    snr_db: Option<f64>,
    image: Image,
}

/// Content of a scene's volume.
#[derive(Clone, Copy, PartialEq)]
enum Image {
    /// Σ |z|² over this many sweeps, in the cube ahead.
    Ls(usize),
    /// Sub-aperture scores of the whole recording, in the cube ahead.
    Subaperture,
    /// Sub-aperture scores of the obstacles that the mapper found, in the room.
    Found,
}

const SCENES: [DemoScene; 6] = [
    DemoScene {
        heading: "Furnished room, natural play",
        text: "Thirty seconds of standing play in a room of 4 × 5 m with specular walls: chairs, a table, a shelf, a sofa, \
               a lamp and a clothes hanger. Sensor preset d16, sub-aperture scores, walls and strong obstacles detected first.",
        folder: "furnished-room",
        scene: "furnished-room",
        motion: "natural",
        preset: "d16",
        duration_s: 30.0,
        snr_db: None,
        image: Image::Found,
    },
    DemoScene {
        heading: "Corner reflector, 50 cm sphere",
        text: "The thesis' test target, 1 m deep and 0.3 m left, 20 dB, by range alone: least squares over 120 sweeps a \
               second, refined to a continuous position with its covariance.",
        folder: "corner-reflector",
        scene: "corner-reflector",
        motion: "sphere-50cm",
        preset: "fine",
        duration_s: 10.0,
        snr_db: Some(20.0),
        image: Image::Ls(200),
    },
    DemoScene {
        heading: "Corner reflector, sensor at rest",
        text: "Without motion only the range can be known. The report says so instead of inventing a direction.",
        folder: "corner-reflector-at-rest",
        scene: "corner-reflector",
        motion: "stationary",
        preset: "fine",
        duration_s: 3.0,
        snr_db: Some(20.0),
        image: Image::Ls(100),
    },
    DemoScene {
        heading: "Metal clothes hanger",
        text: "The thesis' hanger from within a 50 cm sphere, sub-aperture scores.",
        folder: "clothes-hanger",
        scene: "clothes-hanger",
        motion: "sphere-50cm",
        preset: "d16",
        duration_s: 8.0,
        snr_db: None,
        image: Image::Subaperture,
    },
    DemoScene {
        heading: "Chair of metal and wood",
        text: "Metal legs reflect more than the wooden seat and back.",
        folder: "chair",
        scene: "chair",
        motion: "sphere-50cm",
        preset: "d16",
        duration_s: 8.0,
        snr_db: None,
        image: Image::Subaperture,
    },
    DemoScene {
        heading: "Two chairs of different reflectivity",
        text: "The plastic chair reflects 8 dB less; the strong one does not mask it.",
        folder: "two-chairs",
        scene: "two-chairs",
        motion: "sphere-50cm",
        preset: "d16",
        duration_s: 8.0,
        snr_db: None,
        image: Image::Subaperture,
    },
];

/// Edge of the voxels in the demo's volumes, metres. Choice: the mapper's own; finer would make the
/// page's volumes and the run larger without showing more.
const VOXEL_M: f64 = 0.05;
/// Side of an eye preview, pixels. Choice: two fit side by side on the page.
const PREVIEW_PX: u32 = 640;

const TITLE: &str = "Radar chaperone: demo";
/// Pictures of a scene.
const PICTURES: [&str; 5] = ["cross_sections.png", "point_cloud.png", "map.png", "eye_left.png", "eye_right.png"];

/// Result of one scene.
struct SceneResult {
    section: Section,
    row: Vec<String>,
    score: Score,
}

impl Demo {
    pub fn run(&self) -> Result<()> {
        if self.view.is_wanted() {
            return self.show_room();
        }
        let start = Instant::now();
        let outputs = self.files().check(self.replace)?;
        let mut renderer = match Renderer::new() {
            Ok(renderer) => Some(renderer),
            Err(error) => {
                log::warn!("no eye previews: {error}");
                None
            }
        };
        // Recording, replay, image, figures and previews of each scene.
        let bar = progress::bar(SCENES.len() as u64 * 4, "");
        let mut played = Vec::new();
        for act in &SCENES {
            bar.set_message(act.scene);
            let one = self.run_scene(act, renderer.as_mut(), &outputs, &bar);
            played.push(one.with_context(|| format!("the demo's \"{}\"", act.heading))?);
        }
        bar.finish_and_clear();
        let report = self.out.join("report.html");
        outputs.write(&report, self.report(&played, renderer.as_ref()).html().as_bytes())?;
        for (act, one) in SCENES.iter().zip(&played) {
            let Score { due_found, due, false_reports, direction_unknown_reports, .. } = one.score;
            let found = match direction_unknown_reports {
                0 => format!("{due_found} of {due} found that came within 1 m"),
                _ => "its distance found, its direction reported as not observed".into(),
            };
            outln!("{:37} {found}; {false_reports} reported where nothing is", act.heading)?;
        }
        outln!("\nDone in {:.1} s. Open {}", start.elapsed().as_secs_f64(), report.display())?;
        Ok(())
    }

    fn files(&self) -> CommandFiles {
        SCENES.iter().fold(CommandFiles::default().writes([self.out.join("report.html")], is_report), |files, act| {
            let folder = self.out.join(act.folder);
            files
                .writes([folder.join("recording.mcap")], is_simulated)
                .writes([folder.join("obstacles.json")], is_obstacles)
                .writes([folder.join("point_cloud.ply")], is_found_cloud)
                .writes(PICTURES.map(|name| folder.join(name)), is_found_picture)
        })
    }

    /// Simulates and records the furnished room and shows its replay.
    fn show_room(&self) -> Result<()> {
        let folder = self.out.join(SCENES[0].folder);
        let file = folder.join("recording.mcap");
        let files = CommandFiles::default().writes([&file], is_simulated).writes(self.view.shots(), is_shot);
        let outputs = files.check(self.replace)?;
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let spinner = progress::spinner("simulating a furnished room");
        self.record(&SCENES[0], &file, &outputs)?;
        spinner.finish_and_clear();
        Replay::for_viewing(file, self.view.clone(), self.replace).run()
    }

    fn report(&self, played: &[SceneResult], renderer: Option<&Renderer>) -> Report {
        let head = ["scene", "came within 1 m", "found within 10 cm", "median error", "reported where nothing is"];
        let table = Table {
            head: head.map(String::from).to_vec(),
            rows: played.iter().map(|p| p.row.clone()).collect(),
            caption: "Found against the truth. Where nothing is: more than 25 cm from everything that stands there."
                .into(),
        };
        let drawn_by = renderer.map_or("No graphics adapter: there are no eye previews.".to_owned(), |r| {
            format!("Eye previews drawn by {}.", r.adapter_name())
        });
        let mut report = Report::new(TITLE)
            .intro(format!(
                "A simulated 60 GHz radar on a headset (seed {}): every scene was recorded, replayed from its recording \
                 through the mapper, and compared with the truth. {drawn_by}",
                self.seed
            ))
            .section(Section::new("At a glance").table(table));
        for one in played {
            report = report.section(one.section.clone());
        }
        report
    }

    fn run_scene(
        &self,
        act: &DemoScene,
        renderer: Option<&mut Renderer>,
        outputs: &Outputs,
        bar: &ProgressBar,
    ) -> Result<SceneResult> {
        let folder = self.out.join(act.folder);
        let file = folder.join("recording.mcap");
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        self.record(act, &file, outputs)?;
        bar.inc(1);
        let (header, settings, mapper) = replay(&file)?;
        let scene = mapper.scene();
        outputs.write(&folder.join("obstacles.json"), &obstacles_bytes(&scene, &mapper)?)?;
        let truth = header.truth.clone().ok_or_else(|| anyhow!("the recording contains no truth"))?;
        bar.inc(1);
        let image = volume(act.image, &file, &settings, &mapper, &truth)?;
        bar.inc(1);
        let score = score(&scene, &truth, &Limits::default());
        let mut section = Section::new(act.heading)
            .text(act.text)
            .preformatted(result_text(&scene, &mapper, None))
            .preformatted(score.to_string());
        let folder = Folder { path: &folder, outputs };
        for figure in figures(act, &folder, &image, &scene, &truth, &mapper)? {
            section = section.figure(figure);
        }
        if let Some(renderer) = renderer {
            for figure in eye_previews(renderer, &folder, &scene, &truth, &mapper, &header, &settings)? {
                section = section.figure(figure);
            }
        }
        bar.inc(1);
        let row = vec![
            act.heading.to_owned(),
            score.due.to_string(),
            score.due_found.to_string(),
            score.median_error_m.map_or("–".into(), |m| format!("{:.1} cm", m * 100.0)),
            score.false_reports.to_string(),
        ];
        Ok(SceneResult { section: section.table(obstacle_table(&scene)), row, score })
    }

    fn record(&self, act: &DemoScene, file: &Path, outputs: &Outputs) -> Result<()> {
        let config = preset(act.preset).ok_or_else(|| anyhow!("preset {} is gone", act.preset))?;
        let mut scenario = Scenario::new(act.scene, act.motion, config, act.duration_s, self.seed);
        scenario.snr_db = act.snr_db;
        scenario.effects = effects_in(act.scene);
        if act.motion == "natural" {
            scenario.errors.dropouts_per_minute = 4.0;
        }
        write_scenario(file, outputs.existing(file), &scenario)?;
        Ok(())
    }
}

/// Whether a file is the page of an earlier demo.
fn is_report(file: &Path) -> bool {
    let page = Report::new(TITLE).html();
    page.find("<style>").is_some_and(|end| begins_with(file, &page.as_bytes()[..end]))
}

/// Whether a file is a simulated recording.
fn is_simulated(file: &Path) -> bool {
    Recording::open(file).is_ok_and(|recording| recording.header().source.starts_with("simulation: "))
}

/// The folder of a scene.
struct Folder<'a> {
    path: &'a Path,
    outputs: &'a Outputs,
}

impl Folder<'_> {
    fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.outputs.write(&self.path.join(name), bytes)
    }
}

/// Runs the recording through the mapper, as `replay` does.
fn replay(file: &Path) -> Result<(Header, Settings, Mapper)> {
    let mut recording = Recording::open(file)?;
    let header = recording.header().clone();
    let settings = Settings::from_toml(&header.settings, &[])?;
    let mut mapper = Mapper::new(&header.config, &header.head_from_sensor, &settings.mapping());
    mapper.push_all(&mut recording);
    Ok((header, settings, mapper))
}

/// The evidence volume of a scene.
fn volume(image: Image, file: &Path, settings: &Settings, mapper: &Mapper, truth: &Truth) -> Result<Volume> {
    if image == Image::Found {
        let walls = truth.walls.iter().flat_map(|w| [w.extent.min, w.extent.max]);
        let room = Aabb::around(walls).unwrap_or_else(|| cube_ahead(&Pose::IDENTITY));
        return Ok(volume_of_shapes(&room, &mapper.scene()));
    }
    let recording = Recording::open(file)?;
    let of_mapping = ObserverSettings::new(&settings.mapping(), &recording.header().head_from_sensor);
    let observer = ObserverSettings { time_offset_s: mapper.time_offset_s(), ..of_mapping };
    let mut observations = Vec::new();
    SweepSource { path: file, observer }.each(|observation| observations.push(observation))?;
    let region = cube_ahead(&observations.first().map_or(Pose::IDENTITY, |o| o.tracking_from_sensor));
    Ok(match image {
        Image::Ls(sweeps) => {
            let (sweeps, grid) = (farthest_sweeps(&observations, sweeps), BrickGrid::covering(&region, VOXEL_M));
            let (stack, _) = SweepStack::of(Statistic::Ls, &settings.radar.beam, &sweeps, grid.middle_m());
            dense_volume(&stack, &grid).volume
        }
        Image::Subaperture | Image::Found => {
            // All sub-apertures have the same weight: the picture covers the whole recording.
            let subapertures =
                radar_sar::subaperture::SubapertureSettings { decay_s: 100.0, ..settings.rooms.subapertures };
            subaperture_volume(&observations, &settings.radar.beam, &subapertures, &region, VOXEL_M)
        }
    })
}

/// The shapes of the obstacles found, as a volume.
fn volume_of_shapes(room: &Aabb, scene: &Scene) -> Volume {
    let mut volume = Volume::covering(room, VOXEL_M);
    for (point, score) in scene.obstacles.iter().flat_map(|o| &o.shape).filter(|(point, _)| room.contains(*point)) {
        let voxel = ((*point - volume.origin_m) / volume.voxel_m).floor().to_array().map(|n| n.max(0.0) as usize);
        if (0..3).all(|axis| voxel[axis] < volume.size[axis]) {
            let index = volume.index(voxel);
            volume.values[index] = volume.values[index].max(*score);
        }
    }
    volume
}

fn farthest_sweeps(observations: &[Observation], count: usize) -> Vec<Observation> {
    let positions: Vec<DVec3> = observations.iter().map(|o| o.tracking_from_sensor.translation).collect();
    farthest_points(&positions, count).into_iter().map(|n| observations[n].clone()).collect()
}

/// Cross-sections, point cloud and map, also written as separate files.
fn figures(
    act: &DemoScene,
    folder: &Folder,
    image: &Volume,
    scene: &Scene,
    truth: &Truth,
    mapper: &Mapper,
) -> Result<Vec<Figure>> {
    let mut image = image.clone();
    let (quantity, floor) = match act.image {
        // Range alone gives shells; the reflector is where they all intersect.
        Image::Ls(_) => ("Σ|z|² above 70 % of its peak", 0.7 * image.peak().map_or(0.0, |peak| peak.1)),
        // Noise reaches scores of 2.
        Image::Subaperture => ("sub-aperture score above 2", 2.0),
        Image::Found => ("sub-aperture score of the obstacles found", 0.0),
    };
    image.values.iter_mut().for_each(|v| *v = (*v - floor).max(0.0));
    let truth_m: Vec<DVec3> = truth.obstacles.iter().flat_map(|o| o.points_m.clone()).collect();
    let found_m: Vec<DVec3> = scene.obstacles.iter().map(|o| o.position_m).collect();
    let path_m = sensor_path(mapper);
    let marks = Marks { truth_m: &truth_m, found_m: &found_m, path_m: &path_m };
    // A picture says what it shows wherever it ends up.
    let title = format!("Simulation: {}", act.heading);
    let sections = cross_sections(&image, &title, quantity, &marks);
    let share = if act.image == Image::Found { 0.0 } else { 0.3 };
    let cloud = point_cloud(&image, &title, quantity, share, &marks);
    let map = room_map(&RoomMap { title: &title, scene, truth: Some(truth), path_m: &path_m, region: None });
    folder.write("cross_sections.png", &sections.png()?)?;
    folder.write("point_cloud.png", &cloud.png()?)?;
    folder.write("map.png", &map.png()?)?;
    folder.write("point_cloud.ply", &ply_bytes(&points_above(&image, share)))?;
    Ok(vec![
        Figure::new(&map, "From above: what was found and what stands there")?,
        Figure::new(&sections, "Accumulated cross-sections: side, top and front")?,
        Figure::new(&cloud, format!("Point cloud: {quantity}"))?,
    ])
}

/// Previews of both eyes at the head pose with the brightest warnings ahead.
fn eye_previews(
    renderer: &mut Renderer,
    folder: &Folder,
    scene: &Scene,
    truth: &Truth,
    mapper: &Mapper,
    header: &Header,
    settings: &Settings,
) -> Result<Vec<Figure>> {
    let sensor_from_head = header.head_from_sensor.inverse();
    let heads = mapper.sensor_path().map(|(_, pose)| pose * sensor_from_head);
    let brightness = |head: &Pose| brightness_ahead(&warn(scene, head, &settings.warning), head);
    let Some(head) = heads.max_by(|a, b| brightness(a).total_cmp(&brightness(b))) else { return Ok(Vec::new()) };
    let warnings = warn(scene, &head, &settings.warning);
    let dots: Vec<(DVec3, f64)> = truth.obstacles.iter().flat_map(|o| &o.points_m).map(|p| (*p, 0.02)).collect();
    let mut figures = Vec::new();
    let views = EyeView::pair(&head, 0.064, 100f64.to_radians(), [PREVIEW_PX; 2]);
    for (view, side) in views.iter().zip(["left", "right"]) {
        let picture = renderer.preview(&warnings, &settings.warning, view, &dots)?;
        let mut png = Vec::new();
        picture.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)?;
        folder.write(&format!("eye_{side}.png"), &png)?;
        let caption = format!("What the {side} eye sees; dots: the truth");
        figures.push(Figure { png, alt: caption.clone(), caption });
    }
    Ok(figures)
}

/// Sum of the panels' brightness, weighted by their nearness to the gaze.
fn brightness_ahead(warnings: &Warnings, head: &Pose) -> f64 {
    let each = warnings.panels.iter().map(|panel| {
        let to = (panel.tracking_from_panel.translation - head.translation).normalize_or_zero();
        f64::from(panel.alpha) * to.dot(head.forward()).max(0.0).powi(4)
    });
    each.sum()
}
