//! Benchmark of run time against error: one reflector, many ways to image it.
//!
//! Every case images the same simulated recordings, one per seed. Each run is timed from raw sweeps
//! to the estimated position; its error is the distance of that position from the truth.

mod plan;
pub mod present;
mod record;
mod rolling;
mod row;
mod trial;

use std::collections::BTreeMap;

use radar_sar::backprojection::RollingError;
use radar_simulation::ScenarioError;

use crate::experiments::trial_recording::TrialRecording;

pub use plan::{Case, Plan, Search};
pub use row::Row;

/// Why a benchmark failed.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    /// A recording cannot be simulated.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A rolling image cannot be made.
    #[error(transparent)]
    Rolling(#[from] RollingError),
    /// Unknown sensor preset.
    #[error("preset \"{0}\" is not known")]
    Preset(&'static str),
}

/// A plan with its simulated recordings.
#[derive(Debug)]
pub struct Benchmark {
    plan: Plan,
    /// By motion, one recording per seed.
    recorded: BTreeMap<&'static str, Vec<TrialRecording>>,
}

impl Benchmark {
    /// Simulates the recordings that the plan needs.
    ///
    /// # Errors
    /// A scenario that cannot be simulated.
    pub fn new(plan: Plan) -> Result<Self, BenchmarkError> {
        let mut recorded = BTreeMap::new();
        for motion in plan.cases.iter().map(|case| case.motion) {
            if !recorded.contains_key(motion) {
                let all: Result<Vec<TrialRecording>, _> =
                    (1..=plan.seeds).map(|seed| record::record(motion, seed)).collect();
                recorded.insert(motion, all?);
            }
        }
        Ok(Self { plan, recorded })
    }

    /// Runs the cases one after the other, each on all cores. `done` receives each row when its
    /// case has finished.
    ///
    /// # Errors
    /// A case that cannot be imaged.
    pub fn run(&self, mut done: impl FnMut(&Row)) -> Result<Vec<Row>, BenchmarkError> {
        let mut rows = Vec::new();
        for case in &self.plan.cases {
            let seeds = self.plan.seeds_of(case) as usize;
            let recorded = &self.recorded[case.motion][..seeds];
            let samples = match case.search {
                Search::Rolling | Search::Window => rolling::samples(case, recorded)?,
                _ => trial::samples(case, recorded),
            };
            let row = Row::of(case, &samples);
            done(&row);
            rows.push(row);
        }
        row::mark_front(&mut rows);
        Ok(rows)
    }

    /// Number of cases.
    pub fn cases(&self) -> usize {
        self.plan.cases.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::{Selection, Statistic};

    fn case(search: Search) -> Case {
        Case {
            motion: "sphere-50cm",
            statistic: Statistic::Ls,
            voxel_m: 0.1,
            sweeps: 20,
            selection: Selection::FarthestPoint,
            search,
            refined: false,
        }
    }

    #[test]
    fn every_search_finds_the_same_place_and_the_refined_one_is_nearer() {
        let searches = [Search::Dense, Search::Adaptive, Search::Peak, Search::Oracle];
        let mut cases: Vec<Case> = searches.map(case).to_vec();
        cases.push(Case { refined: true, ..case(Search::Peak) });
        let benchmark = Benchmark::new(Plan { cases, seeds: 3, oracle_seeds: 3, rolling_seeds: 1 }).unwrap();
        let mut reported = 0;
        let rows = benchmark.run(|_| reported += 1).unwrap();
        assert_eq!(reported, 5);
        let [dense, adaptive, peak, oracle, refined] = rows.as_slice() else { panic!("a row a case") };
        for other in [adaptive, peak, oracle] {
            assert_eq!((dense.error_m, dense.error_p95_m), (other.error_m, other.error_p95_m));
        }
        assert!(dense.error_m < 0.15 && refined.error_m < 0.03, "{rows:?}");
        assert!(peak.updates <= adaptive.updates && adaptive.updates < dense.updates);
        assert!(rows.iter().any(|row| row.on_front));
    }

    #[test]
    fn the_rolling_image_gives_the_place_of_a_fresh_one() {
        let window = |search| Case { sweeps: 200, voxel_m: 0.05, ..case(search) };
        let cases = vec![window(Search::Rolling), window(Search::Window)];
        let benchmark = Benchmark::new(Plan { cases, seeds: 1, oracle_seeds: 1, rolling_seeds: 1 }).unwrap();
        let rows = benchmark.run(|_| ()).unwrap();
        assert_eq!((rows[0].error_m, rows[0].error_p95_m), (rows[1].error_m, rows[1].error_p95_m));
        assert!(rows[0].error_m < 0.1 && rows[0].updates < rows[1].updates, "{rows:?}");
        assert!(rows.iter().all(|row| !row.on_front), "another workload");
    }
}
