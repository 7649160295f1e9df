//! Detection of furniture and false reports in simulated rooms of 30 s.

use std::ops::Range;

use a121::preset;
use rayon::prelude::*;

use super::quantile;
use radar_chaperone::report::{Limits, Score, Table, score};
use radar_chaperone::settings::Settings;
use radar_mapping::Mapper;
use radar_mapping::in_time_order;
use radar_simulation::{Scenario, ScenarioError};

/// Length of a session, seconds. Choice: as in the study that chose the method, so that figures can
/// be compared.
const DURATION_S: f64 = 30.0;
/// Minimum time in the beam before an object counts, seconds: as in play sessions.
const SEEN_S: f64 = 0.75;

/// Natural play in rooms, preset d16.
#[derive(Debug, Clone)]
pub struct RoomTrial {
    /// The simulated scene, for example `furnished-room`.
    pub scene: String,
    /// Poses per second; `None`: as simulated by default.
    pub poses_hz: Option<f64>,
    /// Settings of the mapper.
    pub settings: Settings,
}

impl RoomTrial {
    /// The scenes of these seeds, each against its truth.
    ///
    /// # Errors
    /// There is no such scene.
    pub fn scores(&self, seeds: &Range<u64>) -> Result<Vec<Score>, ScenarioError> {
        seeds.clone().collect::<Vec<_>>().par_iter().map(|seed| self.score(*seed)).collect()
    }

    fn score(&self, seed: u64) -> Result<Score, ScenarioError> {
        let config = preset("d16").expect("d16 exists");
        let mut scenario = Scenario::new(&self.scene, "natural", config, DURATION_S, seed);
        scenario.errors.rate_hz = self.poses_hz.unwrap_or(scenario.errors.rate_hz);
        let simulated = scenario.run()?;
        let mut mapper = Mapper::new(&scenario.config, &scenario.head_from_sensor, &self.settings.mapping());
        mapper.push_all(in_time_order(simulated.frames, simulated.poses));
        Ok(score(&mapper.scene(), &simulated.truth, &Limits::default()))
    }
}

/// The figures of these scores together.
pub fn room_table(scores: &[Score]) -> Table {
    let sum = |of: fn(&Score) -> usize| scores.iter().map(of).sum::<usize>();
    let mut errors_mm: Vec<f64> = scores
        .iter()
        .flat_map(|score| &score.obstacles)
        .filter(|obstacle| obstacle.due)
        .filter_map(|obstacle| Some(obstacle.nearest_report_m? * 1e3))
        .collect();
    let in_beam = |score: &Score, found: bool| {
        let counts =
            |o: &&radar_chaperone::report::ObstacleScore| o.due && o.in_beam_s >= SEEN_S && (o.found || !found);
        score.obstacles.iter().filter(counts).count()
    };
    let in_beam = |found: bool| scores.iter().map(|score| in_beam(score, found)).sum::<usize>();
    let of = |part: usize, all: usize| format!("{part} of {all}");
    let rows = [
        ("objects that came within 1 m: found", of(sum(|s| s.due_found), sum(|s| s.due))),
        ("… of these in the beam for at least 0.75 s", of(in_beam(true), in_beam(false))),
        ("median error of those found, mm", format!("{:.0}", quantile(&mut errors_mm, 0.5))),
        ("reports where nothing is", of(sum(|s| s.false_reports), sum(|s| s.reports))),
        ("reports of points at walls, floor or ceiling", sum(|s| s.wall_reports).to_string()),
        ("walls, floor and ceiling found", of(sum(|s| s.walls_found), sum(|s| s.walls))),
        ("planes where none is", sum(|s| s.walls_false).to_string()),
        ("rooms of 30 s", scores.len().to_string()),
    ];
    let caption = "Found: a report within 10 cm of one of the object's points. Where nothing is: farther than 25 cm \
        from every point and wall.";
    Table {
        head: ["figure", "value"].map(str::to_owned).to_vec(),
        rows: rows.map(|(name, value)| vec![name.to_owned(), value]).to_vec(),
        caption: caption.into(),
    }
}
