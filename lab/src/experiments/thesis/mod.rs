//! The experiments of the master's thesis "Arbitrary Motion Synthetic Aperture Radar" (Lund 2023,
//! chapters 3.5, 4 and 5), repeated in simulation. Where the thesis shows pictures of one trial,
//! these give figures over several seeds, the truth, and whether each finding holds.
//!
//! An experiment is a row in [`ALL`] and a file. Scenes and motions are the thesis'. "The thesis'
//! method" is its reduced filter (eq. 3.2) over voxels of 10 cm with its thinning; "ours" is what
//! this program does.

mod common_objects;
mod data_set_size;
mod false_alarms;
mod filters;
mod imaging_methods;
mod imu;
mod lens;
mod outcome;
mod outputs;
mod peak_separation;
mod pose_sources;
mod resolution;
mod sensor_motion;
mod shape_accuracy;
mod shape_image;
mod subapertures;
mod synchronisation;
mod thinning;
mod velocity;
mod vendor_detector;

use crate::experiments::trial_recording::TrialRecording;
use a121::preset;
use radar_chaperone::report::ReportError;
use radar_recording::ImportError;
use radar_simulation::{Scenario, ScenarioError};

pub use outcome::{Finding, NamedPicture, Outcome, OutputFile, markdown, report};

/// Why an experiment failed.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A recording cannot be simulated.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A file cannot be made.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A track cannot be read back.
    #[error(transparent)]
    Track(#[from] ImportError),
    /// Unknown sensor preset.
    #[error("preset \"{0}\" is not known")]
    Preset(&'static str),
}

/// One experiment.
#[derive(Debug, Clone, Copy)]
pub struct Experiment {
    /// Name on the command line.
    pub name: &'static str,
    /// Heading in the report.
    pub title: &'static str,
    /// Section of the thesis.
    pub section: &'static str,
    run: fn(&Trials) -> Result<Outcome, ExperimentError>,
}

/// All experiments, in the thesis' order.
pub const ALL: &[Experiment] = &[
    Experiment {
        name: "vendor-detector",
        title: "Obstacle detector of the vendor",
        section: "2.5",
        run: vendor_detector::run,
    },
    Experiment { name: "lens", title: "Lens choice", section: "3.5.2, 4.1.1, 5.2", run: lens::run },
    Experiment { name: "data-set-size", title: "Data set size", section: "4.1.2, 5.1", run: data_set_size::run },
    Experiment {
        name: "synchronisation",
        title: "Synchronisation",
        section: "3.5.4, 4.1.3, 5.3",
        run: synchronisation::run,
    },
    Experiment { name: "sensor-motion", title: "Sensor motion", section: "4.1.4, 5.4", run: sensor_motion::run },
    Experiment { name: "velocity", title: "Sensor velocity", section: "4.1.5, 5.5", run: velocity::run },
    Experiment { name: "common-objects", title: "Common objects", section: "4.1.6, 5.6", run: common_objects::run },
    Experiment { name: "resolution", title: "Resolution and search area", section: "5.6, 5.8.3", run: resolution::run },
    Experiment { name: "thinning", title: "Thinning the data set", section: "3.4.1", run: thinning::run },
    Experiment { name: "matched-filter", title: "Matched filter and others", section: "3.3, 5.8.1", run: filters::run },
    Experiment { name: "imu", title: "The IMU prototype", section: "3.6, 4.2, 5.7", run: imu::run },
    Experiment { name: "pose-sources", title: "Pose sources beyond VR", section: "6.1, 6.3", run: pose_sources::run },
    Experiment {
        name: "outputs",
        title: "Volumes and clouds for other tools",
        section: "5.8.2, 6.3",
        run: outputs::run,
    },
];

impl Experiment {
    /// Runs it with this number of seeds. `progress` is called from time to time with the share
    /// that is done, 0 to 1.
    ///
    /// # Errors
    /// A scenario that cannot be simulated.
    pub fn run(&self, seeds: u64, progress: &dyn Fn(f64)) -> Result<Outcome, ExperimentError> {
        (self.run)(&Trials { seeds: seeds.max(1), progress })
    }
}

/// Number of seeds and progress callback of an experiment.
struct Trials<'a> {
    seeds: u64,
    /// Receives the share that is done, 0 to 1.
    progress: &'a dyn Fn(f64),
}

/// Power SNR of the reflector at 1 m, dB. Choice: well below that of a corner reflector of 10 cm,
/// which is 12 dBsm.
const SNR_DB: f64 = 40.0;

impl Trials<'_> {
    /// Reports progress: a number of parts of about equal length are done.
    fn report_progress(&self, parts: usize, of: usize) {
        (self.progress)(parts as f64 / of.max(1) as f64);
    }

    /// The thesis' corner reflector, 1 m deep and 0.3 m to the left, recorded with a preset, once
    /// per seed.
    fn reflector(
        &self,
        motion: &str,
        name: &'static str,
        duration_s: f64,
    ) -> Result<Vec<TrialRecording>, ExperimentError> {
        self.recorded(name, duration_s, |scenario| {
            scenario.motion = motion.into();
            scenario.snr_db = Some(SNR_DB);
        })
    }

    /// Recordings of a preset, one per seed: a corner reflector from within a sphere of 50 cm, with
    /// the changes applied.
    fn recorded(
        &self,
        name: &'static str,
        duration_s: f64,
        change: impl Fn(&mut Scenario),
    ) -> Result<Vec<TrialRecording>, ExperimentError> {
        let config = preset(name).ok_or(ExperimentError::Preset(name))?;
        let of = |seed| {
            let mut scenario = Scenario::new("corner-reflector", "sphere-50cm", config.clone(), duration_s, seed);
            change(&mut scenario);
            TrialRecording::of(&scenario)
        };
        Ok((1..=self.seeds).map(of).collect::<Result<_, _>>()?)
    }
}

/// Metres as text in centimetres.
fn cm(metres: f64) -> String {
    if metres.is_finite() { format!("{:.1}", metres * 100.0) } else { "–".into() }
}

/// Metres as text in millimetres.
fn mm(metres: f64) -> String {
    if metres.is_finite() { format!("{:.1}", metres * 1e3) } else { "–".into() }
}

/// A share as text in per cent.
fn percent(share: f64) -> String {
    format!("{:.0}", share * 100.0)
}

fn head(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs an experiment and checks that its progress rises and stays within 0 to 1.
    fn run_and_watch(experiment: &Experiment) -> Outcome {
        let last = std::cell::Cell::new(0.0);
        let progress =
            |share: f64| assert!((last.replace(share)..=1.0).contains(&share), "{}: {share}", experiment.name);
        experiment.run(1, &progress).unwrap()
    }

    #[test]
    fn every_experiment_has_findings_tables_and_pictures_and_a_report() {
        let done: Vec<_> = ALL.iter().map(|experiment| (experiment, run_and_watch(experiment))).collect();
        for (experiment, outcome) in &done {
            assert!(!outcome.findings.is_empty() && !outcome.pictures.is_empty(), "{}", experiment.name);
            for table in &outcome.tables {
                assert!(!table.rows.is_empty() && table.rows.iter().all(|row| row.len() == table.head.len()));
            }
            let mut names: Vec<_> = outcome.pictures.iter().map(|drawn| &drawn.name).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), outcome.pictures.len(), "a name a picture");
            let mut files: Vec<_> = outcome.files.iter().map(|file| &file.name).collect();
            files.sort();
            files.dedup();
            assert_eq!(files.len(), outcome.files.len(), "a name a file");
        }
        let text = markdown(&done);
        assert!(ALL.iter().all(|experiment| text.contains(&format!("\n## {}\n", experiment.title))));
        let page = report(&done).unwrap().html();
        assert!(
            ALL.iter().all(|experiment| page.contains(experiment.title)) && page.contains("data:image/png;base64,")
        );
    }
}
