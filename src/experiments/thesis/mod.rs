//! The experiments of the master's thesis "Arbitrary Motion Synthetic Aperture Radar" (Lund 2023, chapters 3.5, 4 and 5) once more: where it
//! had pictures of one trial, here are figures over several seeds, the truth beside them, and whether each finding holds.
//!
//! An experiment is a row in [`ALL`] and a file. Everything is simulated with the thesis' scenes and motions; the thesis' way is its
//! reduced filter (eq. 3.2) over voxels of 10 cm with its thinning, ours what this program does.

mod data_set_size;
mod filters;
mod imaged;
mod imu;
mod outcome;
mod pose_sources;
mod sensor_motion;
mod synchronisation;
mod thinning;
mod velocity;

use crate::experiments::recorded::Recorded;
use crate::radar::preset;
use crate::recording::ImportError;
use crate::simulation::{Scenario, ScenarioError};

pub use outcome::{Drawn, Finding, Outcome, report};

/// Why an experiment came to nothing.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A recording that could not be simulated.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A track that cannot be read back.
    #[error(transparent)]
    Track(#[from] ImportError),
    /// No such sensor preset.
    #[error("preset \"{0}\" is not known")]
    Preset(&'static str),
}

/// One experiment.
#[derive(Debug, Clone, Copy)]
pub struct Experiment {
    /// As the command line spells it.
    pub name: &'static str,
    /// As the report's heading has it.
    pub title: &'static str,
    /// Section of the thesis.
    pub section: &'static str,
    run: fn(&Trials) -> Result<Outcome, ExperimentError>,
}

/// All there are, in the thesis' order.
pub const ALL: &[Experiment] = &[
    Experiment { name: "data-set-size", title: "Data set size", section: "4.1.2, 5.1", run: data_set_size::run },
    Experiment {
        name: "synchronisation",
        title: "Synchronisation",
        section: "3.5.4, 4.1.3, 5.3",
        run: synchronisation::run,
    },
    Experiment { name: "sensor-motion", title: "Sensor motion", section: "4.1.4, 5.4", run: sensor_motion::run },
    Experiment { name: "velocity", title: "Sensor velocity", section: "4.1.5, 5.5", run: velocity::run },
    Experiment { name: "thinning", title: "Thinning the data set", section: "3.4.1", run: thinning::run },
    Experiment { name: "matched-filter", title: "Matched filter and others", section: "3.3, 5.8.1", run: filters::run },
    Experiment { name: "imu", title: "The IMU prototype", section: "3.6, 4.2, 5.7", run: imu::run },
    Experiment { name: "pose-sources", title: "Pose sources beyond VR", section: "6.1, 6.3", run: pose_sources::run },
];

impl Experiment {
    /// Runs it with so many seeds.
    ///
    /// # Errors
    /// A scenario that cannot be simulated.
    pub fn run(&self, seeds: u64) -> Result<Outcome, ExperimentError> {
        (self.run)(&Trials { seeds: seeds.max(1) })
    }
}

/// What experiments are made of.
struct Trials {
    seeds: u64,
}

/// Power signal to noise ratio of the reflector at 1 m, dB: well below that of a corner reflector of 10 cm, which is 12 dBsm.
const SNR_DB: f64 = 40.0;

impl Trials {
    /// The thesis' corner reflector 1 m deep and 0.3 m to the left, seen with a preset for so long, once a seed.
    fn reflector(&self, motion: &str, name: &'static str, duration_s: f64) -> Result<Vec<Recorded>, ExperimentError> {
        let config = preset(name).ok_or(ExperimentError::Preset(name))?;
        let scenario = |seed| Scenario {
            snr_db: Some(SNR_DB),
            ..Scenario::new("corner-reflector", motion, config.clone(), duration_s, seed)
        };
        Ok((1..=self.seeds).map(|seed| Recorded::of(&scenario(seed))).collect::<Result<_, _>>()?)
    }
}

/// Metres as centimetres.
fn cm(metres: f64) -> String {
    if metres.is_finite() { format!("{:.1}", metres * 100.0) } else { "–".into() }
}

/// Metres as millimetres.
fn mm(metres: f64) -> String {
    if metres.is_finite() { format!("{:.1}", metres * 1e3) } else { "–".into() }
}

fn head(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_experiment_has_findings_tables_and_pictures_and_a_report() {
        let done: Vec<_> = ALL.iter().map(|experiment| (experiment, experiment.run(1).unwrap())).collect();
        for (experiment, outcome) in &done {
            assert!(!outcome.findings.is_empty() && !outcome.pictures.is_empty(), "{}", experiment.name);
            for table in &outcome.tables {
                assert!(!table.rows.is_empty() && table.rows.iter().all(|row| row.len() == table.head.len()));
            }
            let mut names: Vec<_> = outcome.pictures.iter().map(|drawn| &drawn.name).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), outcome.pictures.len(), "a name a picture");
        }
        let page = report(&done).unwrap().html();
        assert!(
            ALL.iter().all(|experiment| page.contains(experiment.title)) && page.contains("data:image/png;base64,")
        );
    }
}
