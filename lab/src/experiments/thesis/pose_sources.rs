//! Thesis experiment "pose sources": poses from sources other than a headset. A robot arm's track
//! is written, read back and imaged with.

use std::path::Path;

use glam::DVec3;

use super::imaging_methods::{
    MIN_RANGE_M, Quality, THESIS_VOXEL_M, chosen, locate_with_errors, observed, volume, volume_around,
};
use super::{ExperimentError, Outcome, SNR_DB, Trials, cm, head, mm};
use crate::experiments::trial_recording::{TrialRecording, quantile};
use a121::preset;
use radar_chaperone::report::{Marks, Table, cross_sections, motion_plot};
use radar_recording::{TrackFormat, read_track_from};
use radar_sar::PoseSample;
use radar_sar::geometry::Pose;
use radar_sar::{PositionErrors, Selection, Statistic};
use radar_simulation::{Scenario, TrackingErrors};

/// Length of the recordings, seconds. Choice: every motion passes all its points.
const DURATION_S: f64 = 12.0;
/// Number of sweeps of the thesis' image, and of the coherent one.
const SWEEPS: usize = 50;
const COHERENT_SWEEPS: usize = 300;
/// Voxel edge and edge of the cube of the coherent image, metres. Choice: its finest resolution is
/// half a wavelength.
const COHERENT_VOXEL_M: f64 = 2.5e-3;
const COHERENT_CUBE_M: f64 = 0.12;
/// Voxel edge of the incoherent image, metres. Choice: below the blur to be seen, above what the
/// run time allows.
const FINE_VOXEL_M: f64 = 0.04;
/// Accuracy sufficient for gripping or warning, metres. Choice: sufficient for gripping or warning.
const ACCURATE_M: f64 = 0.01;

/// A source of poses: motion, its measurement errors, and the errors that the reconstruction
/// assumes.
struct PoseSource {
    name: &'static str,
    motion: &'static str,
    track: TrackingErrors,
    known: PositionErrors,
    is_arm: bool,
}

/// An industrial arm repeats to some hundredths of a millimetre; its tool centre point is
/// calibrated to half a millimetre.
fn sources() -> [PoseSource; 3] {
    let arm = TrackingErrors {
        rate_hz: 125.0,
        jitter_m: 0.03e-3,
        wander_m: 0.1e-3,
        mount_m: 0.5e-3,
        rotation_deg: 0.01,
        ..TrackingErrors::none()
    };
    let known = PositionErrors {
        wander_m: 0.1e-3,
        mount_m: 0.5e-3,
        jitter_m: 0.015e-3,
        rotation_deg: 0.01,
        ..Default::default()
    };
    let headset = |name, motion| PoseSource {
        name,
        motion,
        track: TrackingErrors::default(),
        known: PositionErrors::default(),
        is_arm: false,
    };
    [
        PoseSource { name: "robot arm, raster", motion: "robot-arm", track: arm, known, is_arm: true },
        headset("headset, hand-held within 50 cm", "sphere-50cm"),
        headset("headset, natural play", "natural"),
    ]
}

/// Results of one recording.
struct RecordingResult {
    thesis_m: f64,
    footprint_l: f64,
    refined_error_m: f64,
    /// Root of the covariance's trace, metres, and the normalised squared error eᵀC⁻¹e, 3 on
    /// average.
    sigma_m: f64,
    misfit: f64,
    known: &'static str,
    coherent_m: f64,
    coherent_cm3: f64,
    coherent_db: f64,
}

impl RecordingResult {
    fn of(recorded: &TrialRecording, errors: &PositionErrors) -> Self {
        let (seed, truth_m) = (recorded.seed, recorded.truth_m);
        let thesis = volume(&chosen(recorded, SWEEPS, Selection::ThesisHull), Statistic::Thesis, THESIS_VOXEL_M, seed);
        let fine =
            volume(&chosen(recorded, COHERENT_SWEEPS, Selection::FarthestPoint), Statistic::Ls, FINE_VOXEL_M, seed);
        let (refined, _) = locate_with_errors(&recorded.observations, seed, errors);
        let off = refined.as_ref().map(|refined| refined.position_m - truth_m);
        let coherent = coherent(recorded, refined.as_ref().map_or(truth_m, |refined| refined.position_m));
        let covariance = refined.as_ref().map(|refined| refined.covariance_m2);
        let trace = covariance.map(|c| c.x_axis.x + c.y_axis.y + c.z_axis.z);
        let misfit = off.zip(covariance).map(|(off, covariance)| off.dot(covariance.inverse() * off));
        Self {
            thesis_m: Quality::of(&thesis, truth_m).error_m(),
            footprint_l: Quality::of(&fine, truth_m).footprint_l,
            refined_error_m: off.map_or(f64::INFINITY, DVec3::length),
            sigma_m: trace.map_or(f64::INFINITY, f64::sqrt),
            misfit: misfit.unwrap_or(f64::INFINITY),
            known: observed(&[refined]),
            coherent_m: coherent.error_m(),
            coherent_cm3: coherent.footprint_l * 1e3,
            coherent_db: coherent.contrast_db,
        }
    }
}

/// The coherent image around a point, from sweeps that have it in the beam, evenly spaced in time.
fn coherent(recorded: &TrialRecording, around_m: DVec3) -> Quality {
    let has_it = |sweep: &&radar_sar::Observation| {
        let range_m = sweep.distance_m(around_m);
        range_m >= MIN_RANGE_M && sweep.geometry.axis.contains(range_m) && sweep.cos_off_boresight(around_m) > 0.8
    };
    let seeing: Vec<_> = recorded.observations.iter().filter(has_it).collect();
    let every = seeing.len().div_ceil(COHERENT_SWEEPS).max(1);
    let sweeps: Vec<_> = seeing.into_iter().step_by(every).cloned().collect();
    let image = volume_around(&sweeps, Statistic::Coherent, COHERENT_VOXEL_M, around_m, COHERENT_CUBE_M);
    Quality::of(&image, recorded.truth_m)
}

/// Writes a track and reads it back with the program's own reader.
fn read_back(poses: &[PoseSample], format: TrackFormat) -> Result<Vec<PoseSample>, ExperimentError> {
    let text = format.write(poses);
    Ok(read_track_from(text.as_bytes(), format, Path::new("track"))?)
}

pub(super) fn run(trials: &Trials) -> Result<Outcome, ExperimentError> {
    let mut outcome = Outcome {
        procedure: format!(
            "The reflector, 1 m deep and 0.3 m to the left, imaged from a robot arm in nine rows of 50 cm, and with \
             a headset's tracking: hand-held, and in natural play. {DURATION_S:.0} s with preset fine, 40 dB, {} \
             seeds, medians. Errors of the arm's poses, 125 per second: jitter 0.03 mm, drift 0.1 mm and 0.01°, mount \
             0.5 mm; of the headset's: 0.3 mm, 1 mm and 0.1°, 2 mm. Each track is written as TUM and as CSV, read back \
             as `import` reads it, and imaged from that.",
            trials.seeds
        ),
        ..Outcome::default()
    };
    let mut figures = Vec::new();
    let (mut written, mut changed) = (0, 0);
    for source in sources() {
        let mut all = Vec::new();
        for seed in 1..=trials.seeds {
            let recorded = recorded(&source, seed, &mut written, &mut changed)?;
            all.push(RecordingResult::of(&recorded, &source.known));
            if seed == 1 {
                pictures(&mut outcome, &source, &recorded);
            }
        }
        figures.push((source.name, all));
    }
    findings(&mut outcome, &figures, written, changed);
    outcome.tables.push(table(&figures));
    Ok(outcome)
}

/// A recording with the poses as read back from CSV. Counts the poses written, and those that TUM
/// or CSV changed.
fn recorded(
    source: &PoseSource,
    seed: u64,
    written: &mut usize,
    changed: &mut usize,
) -> Result<TrialRecording, ExperimentError> {
    let config = preset("fine").ok_or(ExperimentError::Preset("fine"))?;
    let mut scenario = Scenario {
        snr_db: Some(SNR_DB),
        errors: source.track,
        ..Scenario::new("corner-reflector", source.motion, config, DURATION_S, seed)
    };
    if source.is_arm {
        // An arm's controller reports the pose of its tool, which is the sensor.
        scenario.head_from_sensor = Pose::IDENTITY;
    }
    let simulated = scenario.run()?;
    let [tum, csv] = [TrackFormat::Tum, TrackFormat::Csv].map(|format| read_back(&simulated.poses, format));
    let (tum, csv) = (tum?, csv?);
    *written += 2 * simulated.poses.len();
    for read in [&tum, &csv] {
        let same = read.iter().zip(&simulated.poses).filter(|(a, b)| a == b).count();
        *changed += simulated.poses.len().max(read.len()) - same;
    }
    Ok(TrialRecording::joined(&scenario, &simulated, &csv))
}

fn pictures(outcome: &mut Outcome, source: &PoseSource, recorded: &TrialRecording) {
    let start_ns = recorded.observations.first().map_or(0, |sweep| sweep.mid_time_ns);
    let at = |sweep: &radar_sar::Observation| {
        ((sweep.mid_time_ns - start_ns) as f64 * 1e-9, sweep.tracking_from_sensor.translation)
    };
    let path: Vec<(f64, DVec3)> = recorded.observations.iter().map(at).collect();
    let title = format!("The sensor's path: {}", source.name);
    outcome.draw(format!("path-{}", source.motion), motion_plot(&path, &title), format!("{title}."));
    let sweeps = chosen(recorded, SWEEPS, Selection::ThesisHull);
    let image = volume(&sweeps, Statistic::Thesis, THESIS_VOXEL_M, recorded.seed);
    let positions: Vec<DVec3> = sweeps.iter().map(|sweep| sweep.tracking_from_sensor.translation).collect();
    let marks = Marks { truth_m: &[recorded.truth_m], found_m: &[], path_m: &positions };
    let title = format!("The thesis' image: {}", source.name);
    let picture = cross_sections(&image, &title, "correlation (amplitude)", &marks);
    outcome.draw(format!("image-{}", source.motion), picture, format!("{title}."));
}

type Figures = [(&'static str, Vec<RecordingResult>)];

fn middle(all: &[RecordingResult], of: fn(&RecordingResult) -> f64) -> f64 {
    quantile(&all.iter().map(of).collect::<Vec<_>>(), 0.5)
}

fn findings(outcome: &mut Outcome, figures: &Figures, written: usize, changed: usize) {
    let own = |source: usize| middle(&figures[source].1, |seen| seen.refined_error_m);
    let worst = quantile(&figures[0].1.iter().map(|seen| seen.refined_error_m).collect::<Vec<_>>(), 1.0);
    outcome.add_finding(
        "The system can be mounted on something whose motion is controlled with fine precision, such as a robot arm \
         (6.3).",
        worst < ACCURATE_M && changed == 0,
        format!(
            "from the arm's track the reflector's error is {} mm, at most {} mm; of {written} poses written as TUM \
             and CSV and read back {changed} changed",
            mm(own(0)),
            mm(worst)
        ),
    );
    outcome.add_finding(
        "A completely arbitrary aperture works as long as the path is measured with precision (6.1).",
        own(1) < 2.0 * ACCURATE_M && own(2) < 2.0 * ACCURATE_M,
        format!("arm {} mm, hand-held headset {} mm, natural play {} mm off", mm(own(0)), mm(own(1)), mm(own(2))),
    );
    let coherent = |source: usize, of: fn(&RecordingResult) -> f64| middle(&figures[source].1, of);
    outcome.add_finding(
        "If the path is measured with precision the algorithm works at a level comparable to traditional SAR (6).",
        coherent(0, |seen| seen.coherent_m) < ACCURATE_M && coherent(0, |seen| seen.coherent_cm3) < 10.0,
        format!(
            "the coherent sum of traditional SAR: from the arm's poses {} mm off, footprint {:.1} cm³, contrast \
             {:.0} dB; from the hand-held headset's {} mm, {:.1} cm³ and {:.0} dB",
            mm(coherent(0, |seen| seen.coherent_m)),
            coherent(0, |seen| seen.coherent_cm3),
            coherent(0, |seen| seen.coherent_db),
            mm(coherent(1, |seen| seen.coherent_m)),
            coherent(1, |seen| seen.coherent_cm3),
            coherent(1, |seen| seen.coherent_db)
        ),
    );
    outcome.add_finding(
        "In the place of a stereoscopic camera it could save greatly on cost and development time (6.3).",
        None,
        "costs are not simulated".into(),
    );
}

fn table(figures: &Figures) -> Table {
    let row = |(name, all): &(&str, Vec<RecordingResult>)| {
        let known = all.last().map_or("–", |seen| seen.known);
        vec![
            (*name).to_owned(),
            cm(middle(all, |seen| seen.thesis_m)),
            format!("{:.0}", middle(all, |seen| seen.footprint_l)),
            mm(middle(all, |seen| seen.refined_error_m)),
            mm(middle(all, |seen| seen.sigma_m)),
            format!("{:.1}", middle(all, |seen| seen.misfit)),
            known.to_owned(),
            mm(middle(all, |seen| seen.coherent_m)),
            format!("{:.1}", middle(all, |seen| seen.coherent_cm3)),
            format!("{:.1}", middle(all, |seen| seen.coherent_db)),
        ]
    };
    Table {
        head: head(&[
            "poses by",
            "thesis: error (cm)",
            "footprint (l)",
            "ours: error (mm)",
            "stated 1σ (mm)",
            "error² over covariance",
            "observed",
            "coherent: error (mm)",
            "footprint (cm³)",
            "contrast (dB)",
        ]),
        rows: figures.iter().map(row).collect(),
        caption: format!(
            "Footprint: volume of the voxels of at least half of the greatest value, least squares, \
             {COHERENT_SWEEPS} sweeps, voxels of 4 cm. 1σ: root of the covariance's trace. Error² over covariance: \
             about 3 where the covariance is right (median 2.4). Coherent: up to {COHERENT_SWEEPS} sweeps summed in \
             phase over voxels of 2.5 mm in 12 cm around the estimated position."
        ),
    }
}
