//! The benchmark's cases.

use crate::experiments::trial_recording::CUBE_M;
use radar_sar::{Selection, Statistic};

/// How the position is searched for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Search {
    /// Every voxel, in f64 straight from the formula.
    Oracle,
    /// Every voxel, by the production code.
    Dense,
    /// The voxels of at least half of the peak, by branch and bound.
    Adaptive,
    /// The greatest voxel alone, by branch and bound.
    Peak,
    /// After each new sweep, the voxels of at least half of the peak over the newest sweeps,
    /// updated from the previous image.
    Rolling,
    /// The same window, imaged from scratch.
    Window,
}

impl Search {
    /// Name in tables and case names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Oracle => "oracle",
            Self::Dense => "dense",
            Self::Adaptive => "adaptive",
            Self::Peak => "peak",
            Self::Rolling => "rolling",
            Self::Window => "window",
        }
    }
}

/// One way to image a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Motion of the head.
    pub motion: &'static str,
    /// Statistic to be imaged.
    pub statistic: Statistic,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Number of sweeps chosen, or in the window; 0: all.
    pub sweeps: usize,
    /// How sweeps are chosen. Unused by windows, which take the newest.
    pub selection: Selection,
    /// How the position is searched for.
    pub search: Search,
    /// Whether the voxel is refined to a continuous position.
    pub refined: bool,
}

impl Case {
    /// Whether the case images a window that advances with every sweep.
    pub fn has_window(&self) -> bool {
        matches!(self.search, Search::Rolling | Search::Window)
    }

    /// Number of sweeps as text, or "all".
    pub fn sweeps_text(&self) -> String {
        if self.sweeps == 0 { "all".into() } else { self.sweeps.to_string() }
    }

    /// Selection as text.
    pub fn selection_name(&self) -> &'static str {
        match self.sweeps {
            _ if self.has_window() => "newest",
            0 => "all",
            _ => self.selection.name(),
        }
    }

    /// Name that is unique among cases of one workload.
    pub fn name(&self) -> String {
        let refined = if self.refined { "/refined" } else { "" };
        let (statistic, search) = (self.statistic.name(), self.search.name());
        let (voxel_mm, sweeps) = (self.voxel_m * 1e3, self.sweeps_text());
        format!("{statistic}/{voxel_mm:.0}mm/x{sweeps}/{}/{search}{refined}", self.selection_name())
    }
}

/// Cases, and the number of recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// In the order of the table.
    pub cases: Vec<Case>,
    /// Recordings per motion: seeds 1 to this.
    pub seeds: u64,
    /// Recordings imaged by the oracle: the first of them. Choice: run time.
    pub oracle_seeds: u64,
    /// Recordings imaged by rolling and fresh windows: the first of them. Choice: run time.
    pub rolling_seeds: u64,
}

/// Statistics of the benchmark. Not `subaperture`: it needs a faster sensor than the preset `fine`.
const STATISTICS: [Statistic; 5] =
    [Statistic::Thesis, Statistic::Ls, Statistic::Log, Statistic::Glrt, Statistic::Coherent];
/// Dense volumes with more updates are left out; the second limit applies to `ls`. Choice: bounds
/// the run time, with a second a case for `ls`, whose dense and adaptive costs are compared.
const MAX_DENSE_UPDATES: f64 = 3e7;
const MAX_DENSE_UPDATES_LS: f64 = 4e8;

const BASE: Case = Case {
    motion: "sphere-50cm",
    statistic: Statistic::Ls,
    voxel_m: 0.05,
    sweeps: 50,
    selection: Selection::FarthestPoint,
    search: Search::Adaptive,
    refined: false,
};

impl Plan {
    /// The full benchmark.
    pub fn full() -> Self {
        let mut cases = vec![Case { voxel_m: 0.1, sweeps: 20, search: Search::Oracle, ..BASE }];
        for statistic in STATISTICS {
            cases.extend(voxel_sweep_grid(statistic, &[0.1, 0.05, 0.024, 0.012], &[20, 50, 200]));
            cases.extend([50, 200].map(|sweeps| Case { statistic, sweeps, refined: true, ..BASE }));
        }
        for voxel_m in [0.1, 0.05, 0.024] {
            let peak = Case { voxel_m, search: Search::Peak, refined: true, ..BASE };
            cases.extend([10, 20, 50, 100, 200, 0].map(|sweeps| Case { sweeps, ..peak }));
        }
        for selection in Selection::ALL {
            let refined = Case { selection, search: Search::Peak, refined: true, ..BASE };
            cases.extend([5, 10, 20, 50].map(|sweeps| Case { sweeps, ..refined }));
        }
        for statistic in STATISTICS {
            let small = Case { motion: "sphere-10cm", statistic, ..BASE };
            cases.extend([50, 200, 0].map(|sweeps| Case { sweeps, ..small }));
            cases.extend([50, 200, 0].map(|sweeps| Case { sweeps, refined: true, ..small }));
        }
        for voxel_m in [0.024, 0.012] {
            cases.extend([Search::Window, Search::Rolling].map(|search| Case { voxel_m, sweeps: 200, search, ..BASE }));
        }
        Self { cases: deduplicated(cases), seeds: 6, oracle_seeds: 2, rolling_seeds: 1 }
    }

    /// A small selection that runs within seconds.
    pub fn quick() -> Self {
        let mut cases = vec![Case { voxel_m: 0.2, sweeps: 20, search: Search::Oracle, ..BASE }];
        for statistic in STATISTICS {
            cases.extend(voxel_sweep_grid(statistic, &[0.1, 0.05], &[20]));
        }
        cases.push(Case { refined: true, search: Search::Peak, ..BASE });
        cases.push(Case { selection: Selection::ThesisHull, ..cases[cases.len() - 1] });
        cases.push(Case { motion: "sphere-10cm", ..BASE });
        cases.extend([Search::Window, Search::Rolling].map(|search| Case { sweeps: 200, search, ..BASE }));
        Self { cases: deduplicated(cases), seeds: 3, oracle_seeds: 1, rolling_seeds: 1 }
    }

    /// Number of recordings that a case images.
    pub fn seeds_of(&self, case: &Case) -> u64 {
        match case.search {
            Search::Oracle => self.oracle_seeds.min(self.seeds),
            Search::Rolling | Search::Window => self.rolling_seeds.min(self.seeds),
            _ => self.seeds,
        }
    }
}

/// Every voxel size with every number of sweeps: adaptive, and dense where the number of updates
/// allows it.
fn voxel_sweep_grid(statistic: Statistic, voxels_m: &[f64], sweeps: &[usize]) -> Vec<Case> {
    let most = if statistic == Statistic::Ls { MAX_DENSE_UPDATES_LS } else { MAX_DENSE_UPDATES };
    let mut cases = Vec::new();
    for &voxel_m in voxels_m {
        for &sweeps in sweeps {
            let adaptive = Case { statistic, voxel_m, sweeps, ..BASE };
            if (CUBE_M / voxel_m).powi(3) * sweeps as f64 <= most {
                cases.push(Case { search: Search::Dense, ..adaptive });
            }
            cases.push(adaptive);
        }
    }
    cases
}

/// Removes repeated cases and keeps the first of each.
fn deduplicated(cases: Vec<Case>) -> Vec<Case> {
    let mut kept: Vec<Case> = Vec::new();
    for case in cases {
        if !kept.contains(&case) {
            kept.push(case);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn case_names_are_unique() {
        for plan in [Plan::full(), Plan::quick()] {
            let names: BTreeSet<(String, &str)> = plan.cases.iter().map(|c| (c.name(), c.motion)).collect();
            assert_eq!(names.len(), plan.cases.len());
        }
    }
}
