//! How well furniture is found in simulated rooms, and how many ghosts come with it.
//!
//!     cargo run --release --example rooms -- [FIRST_SEED..END_SEED] [SCENE] [--each] [explain.min_score=3 …]
//!
//! Plays 30 s with preset d16 for every seed, runs the block field, the planes and explaining away four times a second,
//! and compares what was confirmed with the truth: things that came within 1 m are due and count as found when something
//! was confirmed within 10 cm of one of their points; what is farther than 25 cm from every point and wall is a ghost.
//! Settings are given by section (block, explain, map) and name. `--each` lists every thing, ghost and plane.

use std::collections::VecDeque;
use std::time::Instant;

use glam::DVec3;
use radar_chaperone::geometry::Plane;
use radar_chaperone::imaging::blocks::{Block, BlockBuilder, BlockSettings, Field, PlaneField};
use radar_chaperone::obstacles::{ExplainSettings, MapSettings, Sightings, Window, same_place, same_plane};
use radar_chaperone::radar::preset;
use radar_chaperone::simulation::{Scenario, Simulated};
use radar_chaperone::tracking::{HistorySettings, ObserverSettings, observe_all};
use radar_chaperone::truth::Truth;
use serde::{Deserialize, Serialize};

const DURATION_S: f64 = 30.0;
const FOUND_M: f64 = 0.10;
const DUE_M: f64 = 1.0;
const GHOST_M: f64 = 0.25;
/// Time between updates, nanoseconds.
const UPDATE_NS: i64 = 250_000_000;

#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Settings {
    block: BlockSettings,
    explain: ExplainSettings,
    map: MapSettings,
}

/// What one seed gave.
#[derive(Debug, Default)]
struct Outcome {
    due: usize,
    found: usize,
    ghosts: usize,
    /// Ghosts within a metre of where the head ever was.
    near_ghosts: usize,
    reports: usize,
    true_planes: usize,
    false_planes: usize,
    errors_m: Vec<f64>,
    field_s: f64,
    planes_s: f64,
    explain_s: f64,
}

fn main() {
    let (mut seeds, mut scene, mut each) = (0..4, "furnished-room".to_string(), false);
    let mut table = toml::Table::new();
    for argument in std::env::args().skip(1) {
        if let Some((key, value)) = argument.split_once('=') {
            let (section, name) = key.split_once('.').expect("settings are named section.name");
            let value: toml::Table = format!("value = {value}").parse().expect("a TOML value");
            let section = table.entry(section).or_insert(toml::Table::new().into());
            section.as_table_mut().expect("a section").insert(name.into(), value["value"].clone());
        } else if let Some((first, end)) = argument.split_once("..") {
            seeds = first.parse().expect("a seed")..end.parse().expect("a seed");
        } else if argument == "--each" {
            each = true;
        } else {
            scene = argument;
        }
    }
    let settings: Settings = table.try_into().expect("known settings");
    let mut all = Outcome::default();
    for seed in seeds {
        let scenario = Scenario::new(&scene, "natural", preset("d16").expect("d16 exists"), DURATION_S, seed);
        let outcome = play(&scenario, &settings, each);
        println!("seed {seed}: {}", outcome.summary());
        all.add(outcome);
    }
    println!("all: {}", all.summary());
}

fn play(scenario: &Scenario, settings: &Settings, each: bool) -> Outcome {
    let simulated = scenario.run().expect("a known scene");
    let observer = ObserverSettings {
        history: HistorySettings::default(),
        head_from_sensor: scenario.head_from_sensor,
        time_offset_s: 0.0,
    };
    let (observations, _) = observe_all(&scenario.config, observer, &simulated.frames, &simulated.poses);
    let Settings { block: block_settings, explain, map } = settings;
    let min_cos = block_settings.min_cos(&scenario.beam);
    let mut builder = BlockBuilder::new(*block_settings);
    let mut field = Field::new(*block_settings, min_cos);
    let mut planes = PlaneField::new(*block_settings, min_cos);
    let mut window: VecDeque<Block> = VecDeque::new();
    let (mut places, mut walls) = (Sightings::<DVec3>::default(), Sightings::<Plane>::default());
    let mut outcome = Outcome::default();
    let mut next_ns = 0;
    for block in observations.into_iter().filter_map(|o| builder.push(o)) {
        let now_ns = block.mid_time_ns;
        let since_ns = now_ns - (explain.window_s * 1e9) as i64;
        outcome.field_s += timed(|| field.add(&block));
        outcome.planes_s += timed(|| planes.add(&block));
        window.push_back(block);
        while window.front().is_some_and(|b| b.mid_time_ns < since_ns) {
            window.pop_front();
        }
        if now_ns < next_ns {
            continue;
        }
        next_ns = now_ns + UPDATE_NS;
        outcome.explain_s += timed(|| {
            let found = planes.peaks(explain.plane_min_score, explain.plane_min_blocks, since_ns);
            let planes: Vec<Plane> = found.iter().map(|p| p.plane).collect();
            let peaks = field.peaks(explain.min_candidate_score, map.match_m, since_ns);
            let peaks: Vec<DVec3> = peaks.iter().map(|p| p.position_m).take(explain.max_candidates).collect();
            let mut window = Window::new(window.iter(), explain, block_settings, min_cos);
            // What is known claims before anything new does.
            let known_walls: Vec<Plane> = walls.confirmed().map(|w| w.thing).collect();
            let known_places: Vec<DVec3> = places.confirmed().map(|p| p.thing).collect();
            let mut believed = window.explain(&known_walls, &known_places);
            let new = window.explain(&planes, &peaks);
            believed.planes.extend(new.planes);
            believed.places.extend(new.places);
            walls.update(&believed.planes, map, same_plane(DVec3::new(0.0, 1.2, 0.0)));
            places.update(&believed.places, map, same_place(map.match_m));
        });
    }
    judge(&simulated, &places, &walls, each, &mut outcome);
    outcome
}

fn timed(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

fn judge(sim: &Simulated, places: &Sightings<DVec3>, walls: &Sightings<Plane>, each: bool, outcome: &mut Outcome) {
    let truth = &sim.truth;
    for report in places.confirmed() {
        outcome.reports += 1;
        let (to_point, to_wall) = (distance_to_things(truth, report.thing), distance_to_walls(truth, report.thing));
        if to_point > GHOST_M && to_wall > GHOST_M {
            outcome.ghosts += 1;
            let to_head = sim.poses.iter().map(|p| DVec3::from_array(p.position_m).distance(report.thing));
            let to_head = to_head.fold(f64::INFINITY, f64::min);
            outcome.near_ghosts += usize::from(to_head < 1.0);
            if each {
                let at = report.thing.to_array();
                let times = [report.first_ns, report.last_ns].map(|t| t as f64 * 1e-9);
                println!(
                    "  ghost {at:.2?} score {:.1}, {times:.1?} s, {to_point:.2} m from the nearest point, {to_wall:.2} m from a wall, {to_head:.2} m from the head",
                    report.score
                );
            }
        }
    }
    for wall in walls.confirmed() {
        let same =
            |t: &Plane| t.outward.dot(wall.thing.outward) > 0.99 && (t.offset_m - wall.thing.offset_m).abs() < 0.1;
        let is_true = truth.walls.iter().any(|w| same(&w.plane));
        outcome.true_planes += usize::from(is_true);
        outcome.false_planes += usize::from(!is_true);
        if each {
            let Plane { outward, offset_m } = wall.thing;
            println!("  plane {:.2?} at {offset_m:.2} score {:.1} true {is_true}", outward.to_array(), wall.score);
        }
    }
    for thing in &truth.obstacles {
        let to = |p: DVec3| thing.points_m.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
        let nearest = places.confirmed().map(|r| to(r.thing)).fold(9.0, f64::min);
        let due = thing.closest_approach_m <= DUE_M;
        outcome.due += usize::from(due);
        outcome.found += usize::from(due && nearest <= FOUND_M);
        if due {
            outcome.errors_m.push(nearest);
        }
        if each {
            let (name, closest_m) = (&thing.name, thing.closest_approach_m);
            println!("  {name}: came within {closest_m:.2} m, nearest report {nearest:.3} m");
        }
    }
}

fn distance_to_things(truth: &Truth, place: DVec3) -> f64 {
    truth.obstacles.iter().flat_map(|o| &o.points_m).map(|p| p.distance(place)).fold(f64::INFINITY, f64::min)
}

fn distance_to_walls(truth: &Truth, place: DVec3) -> f64 {
    truth.walls.iter().map(|w| w.extent.distance(place)).fold(f64::INFINITY, f64::min)
}

impl Outcome {
    fn add(&mut self, other: Self) {
        self.due += other.due;
        self.found += other.found;
        self.ghosts += other.ghosts;
        self.near_ghosts += other.near_ghosts;
        self.reports += other.reports;
        self.true_planes += other.true_planes;
        self.false_planes += other.false_planes;
        self.errors_m.extend(other.errors_m);
        self.field_s += other.field_s;
        self.planes_s += other.planes_s;
        self.explain_s += other.explain_s;
    }

    fn summary(&self) -> String {
        let mut errors = self.errors_m.clone();
        errors.sort_by(f64::total_cmp);
        let median_mm = errors.get(errors.len() / 2).map_or(0.0, |e| e * 1e3);
        format!(
            "found {}/{} (median error {median_mm:.0} mm), {} ghosts ({} near) of {} reports, planes {} true {} false, field {:.1} s planes {:.1} s explain {:.1} s",
            self.found,
            self.due,
            self.ghosts,
            self.near_ghosts,
            self.reports,
            self.true_planes,
            self.false_planes,
            self.field_s,
            self.planes_s,
            self.explain_s
        )
    }
}
