//! Detection at a constant false-alarm rate (CFAR). For every preset: the threshold on the greatest
//! value of a least-squares image that noise exceeds at a stated rate, how often other noise
//! exceeds it, and the SNR from which on a reflector does.

use glam::DVec3;
use radar_mapping::range_axis;
use rayon::prelude::*;

use super::{ExperimentError, Outcome, Trials, head};
use crate::experiments::trial_recording::TrialRecording;
use a121::{PRESETS, SensorConfig, frame_timing, preset};
use radar_chaperone::report::{Chart, Series, Table};
use radar_sar::backprojection::{BrickGrid, SweepStack, dense_volume};
use radar_sar::geometry::Aabb;
use radar_sar::{Beam, Observation};
use radar_sar::{NoiseMaxima, Statistic, noise_like, sum_from_surprisal, surprisal, sweep_noise_rms};
use radar_simulation::Scenario;

/// Sweeps of one trial, as many as the thesis images.
const SWEEPS: usize = 50;
/// Maximum number of trials taken from a recording of noise. Choice: over all seeds hundreds, of
/// which a rate of 1 % can be stated.
const NOISE_TRIALS: usize = 60;
/// Recordings whose paths calibrate the thresholds, and trials per path. Choice: how many sweeps
/// see a point depends on the path, so many paths count more than many trials.
const PATHS: u64 = 12;
const TRIALS_PER_PATH: usize = 10;
/// Stated false-alarm rates per trial. Choice: from what one would notice to what one would accept,
/// countable in hundreds of trials.
const RATES: [f64; 2] = [0.1, 0.01];
/// Presets whose detections are counted (presets of equal range points behave as `d16`), and the
/// SNRs, dB.
const DETECTION_PRESETS: [&str; 3] = ["d16", "far", "fine"];
const SNRS_DB: [f64; 11] = [-12.0, -10.0, -8.0, -6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0];
/// Trials taken from a recording with a reflector, and its duration, seconds. Choice: trials half a
/// second apart are nearly independent.
const REFLECTOR_TRIALS: usize = 8;
const REFLECTOR_DURATION_S: f64 = 4.0;
/// The detection threshold of reflectors, standard deviations. Source: the default of the setting
/// `reflectors.threshold_sigma`.
const DEFAULT_SIGMA: f64 = 7.0;
/// Parts of the experiment's progress; `filters.rs` accounts for the first twenty.
const PARTS: usize = 50;
const BEAM: Beam = Beam::Lensless;

/// Search grid of a preset.
struct Search {
    grid: BrickGrid,
}

impl Search {
    /// A cube as deep as the preset's range, at most 3 m, in voxels of half a pulse.
    fn of(config: &SensorConfig) -> Self {
        let subsweep = &config.subsweeps[0];
        let edge_m = (2.0 * range_axis(subsweep).last_m()).min(3.0);
        let middle = DVec3::new(0.0, 1.5, -0.5 * edge_m);
        let region = Aabb { min: middle - 0.5 * edge_m, max: middle + 0.5 * edge_m };
        Self { grid: BrickGrid::covering(&region, 0.5 * subsweep.profile.envelope_fwhm_m()) }
    }

    /// Surprise of the greatest Σ|z|², in units of the sweeps' own noise.
    fn greatest(&self, sweeps: &[Observation]) -> f64 {
        let (stack, _) = SweepStack::of(Statistic::Ls, &BEAM, sweeps, self.grid.middle_m());
        let greatest = dense_volume(&stack, &self.grid).volume.peak().map_or(0.0, |peak| f64::from(peak.1));
        let noise = sweeps.iter().map(|o| sweep_noise_rms(&o.samples).powi(2)).sum::<f64>();
        surprisal(greatest * sweeps.len() as f64 / noise, sweeps.len())
    }
}

/// Splits a recording into trials of every n-th sweep, each beginning at another sweep, so that
/// every trial spans the whole path; `most` at most.
fn sweep_sets(recorded: &TrialRecording, most: usize) -> Vec<Vec<Observation>> {
    let count = (recorded.observations.len() / SWEEPS).max(1);
    let sweeps = |n: usize| recorded.observations.iter().skip(n).step_by(count).take(SWEEPS).cloned().collect();
    (0..count.min(most)).map(sweeps).collect()
}

/// A recording of empty space, long enough for all trials.
fn noise(name: &str, config: &SensorConfig, seed: u64) -> Result<TrialRecording, ExperimentError> {
    let sweeps_hz = f64::from(config.sweeps_per_frame) / frame_timing(config).frame_period_s;
    let duration_s = ((NOISE_TRIALS * SWEEPS) as f64 / sweeps_hz).max(1.0) * 1.02;
    // A sensor whose range is shorter than its motion would see no point from all of its path.
    let motion = if name == "close" { "sphere-10cm" } else { "sphere-50cm" };
    Ok(TrialRecording::of(&Scenario::new("nothing", motion, config.clone(), duration_s, seed))?)
}

/// Adds the CFAR part to the matched-filter experiment, whose progress it takes the last three
/// fifths of.
pub(super) fn add(trials: &Trials, outcome: &mut Outcome) -> Result<(), ExperimentError> {
    let (mut rows, mut pooled, mut all_near, mut maxima) = (Vec::new(), [0usize; 2], true, Vec::new());
    let mut searched = 0;
    for (n, name) in PRESETS.into_iter().enumerate() {
        trials.report_progress(20 + 3 * n, PARTS);
        let config = preset(name).ok_or(ExperimentError::Preset(name))?;
        let search = Search::of(&config);
        let mut paths = Vec::new();
        for seed in 0..PATHS {
            paths.extend(sweep_sets(&noise(name, &config, 501 + seed)?, TRIALS_PER_PATH));
        }
        // The noise strength is arbitrary: thresholds are in units of the noise.
        let made = |(seed, path): (usize, &Vec<Observation>)| search.greatest(&noise_like(path, 100.0, seed as u64));
        let calibrated = paths.par_iter().enumerate().map(made);
        let Some(of_noise) = NoiseMaxima::of(&calibrated.collect::<Vec<_>>()) else { continue };
        let mut others = Vec::new();
        for seed in 0..trials.seeds {
            let other = sweep_sets(&noise(name, &config, 2001 + seed)?, NOISE_TRIALS);
            others.extend(other.par_iter().map(|sweeps| search.greatest(sweeps)).collect::<Vec<f64>>());
        }
        let passed = RATES.map(|rate| others.iter().filter(|value| **value > of_noise.threshold(rate)).count());
        let [often, seldom] = passed.map(|count| count as f64 / others.len().max(1) as f64);
        all_near &= (0.05..=0.2).contains(&often);
        pooled = [pooled[0] + passed[0], pooled[1] + passed[1]];
        searched += others.len();
        let sigmas = |surprised: f64| (sum_from_surprisal(surprised, SWEEPS) - SWEEPS as f64) / (SWEEPS as f64).sqrt();
        let default = SWEEPS as f64 + DEFAULT_SIGMA * (SWEEPS as f64).sqrt();
        let by_default = of_noise.rate_above(surprisal(default, SWEEPS));
        rows.push(vec![
            name.to_owned(),
            search.grid.voxels().to_string(),
            format!("{:.2}", sigmas(of_noise.threshold(RATES[0]))),
            format!("{:.1}", 100.0 * often),
            format!("{:.2}", sigmas(of_noise.threshold(RATES[1]))),
            format!("{:.1}", 100.0 * seldom),
            others.len().to_string(),
            format!("{by_default:.0e}"),
        ]);
        maxima.push((name, search, of_noise));
    }
    let [often, seldom] = pooled.map(|count| count as f64 / searched.max(1) as f64);
    let curves = detected(trials, &maxima)?;
    draw(outcome, &curves);
    let half = |curve: &Series| half_crossing(&curve.points).map_or("–".into(), |snr| format!("{snr:.0} dB"));
    let halves: Vec<String> = curves.iter().map(|curve| format!("{} {}", curve.name, half(curve))).collect();
    outcome.add_finding(
        "CFAR detection, a threshold that follows the noise, can find targets in noise (5.8.1).",
        all_near && (0.005..=0.02).contains(&seldom),
        format!(
            "thresholds calibrated on noise for 10 and 1 false alarms in 100 trials: other noise exceeds them {:.1} \
             and {:.2} times in 100 ({searched} trials of all presets); at the second threshold half of all trials \
             detect a reflector from {} on",
            100.0 * often,
            100.0 * seldom,
            halves.join(", ")
        ),
    );
    outcome.tables.push(Table {
        head: head(&[
            "preset",
            "voxels",
            "threshold for 10 % (σ)",
            "measured (%)",
            "threshold for 1 % (σ)",
            "measured (%)",
            "trials",
            "rate at the default of 7 σ",
        ]),
        rows,
        caption: format!(
            "False alarms. A trial: least squares over {SWEEPS} sweeps from within a sphere of 50 cm (close: 10 cm), \
             all voxels (half a pulse wide) ahead within the preset's range, at most 3 m. σ: excess of the greatest \
             sum over the mean of noise, in standard deviations of a sum. Thresholds from {} trials of synthetic noise \
             along {PATHS} paths, measured on simulated recordings of empty space with other seeds and paths.",
            TRIALS_PER_PATH * PATHS as usize
        ),
    });
    Ok(())
}

/// Share of trials in which the greatest value exceeds the threshold of one false alarm in a
/// hundred, over the SNR.
fn detected(trials: &Trials, maxima: &[(&'static str, Search, NoiseMaxima)]) -> Result<Vec<Series>, ExperimentError> {
    let mut curves = Vec::new();
    for (n, (name, search, of_noise)) in maxima.iter().filter(|(name, ..)| DETECTION_PRESETS.contains(name)).enumerate()
    {
        trials.report_progress(20 + 3 * (PRESETS.len() + n), PARTS);
        let config = preset(name).ok_or(ExperimentError::Preset(name))?;
        let mut points = Vec::new();
        for snr_db in SNRS_DB {
            let mut all = Vec::new();
            for seed in 1..=trials.seeds {
                let scenario = Scenario {
                    snr_db: Some(snr_db),
                    ..Scenario::new("corner-reflector", "sphere-50cm", config.clone(), REFLECTOR_DURATION_S, seed)
                };
                all.extend(sweep_sets(&TrialRecording::of(&scenario)?, REFLECTOR_TRIALS));
            }
            let threshold = of_noise.threshold(RATES[1]);
            let found = all.par_iter().filter(|sweeps| search.greatest(sweeps) > threshold).count();
            points.push([snr_db, 100.0 * found as f64 / all.len().max(1) as f64]);
        }
        curves.push(Series { name: (*name).to_owned(), points, joined: true });
    }
    Ok(curves)
}

/// Where a rising curve crosses 50 %.
fn half_crossing(points: &[[f64; 2]]) -> Option<f64> {
    let pair = points.windows(2).find(|pair| pair[0][1] < 50.0 && pair[1][1] >= 50.0)?;
    Some(pair[0][0] + (pair[1][0] - pair[0][0]) * (50.0 - pair[0][1]) / (pair[1][1] - pair[0][1]))
}

fn draw(outcome: &mut Outcome, curves: &[Series]) {
    let chart = Chart {
        title: format!("Probability that {SWEEPS} sweeps detect a reflector, at one false alarm in 100 trials"),
        x_label: "signal to noise of one range point on the axis at 1 m (dB)".into(),
        y_label: "trials that detect it (%)".into(),
        series: curves.to_vec(),
        ..Chart::default()
    };
    outcome.draw(
        "detection",
        chart.draw(),
        "Probability of detection. The finer the range points, the more of them a pulse fills: fine has six times those of d16.",
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_crossing_is_interpolated() {
        assert_eq!(half_crossing(&[[-2.0, 0.0], [0.0, 25.0], [2.0, 75.0]]), Some(1.0));
        assert_eq!(half_crossing(&[[0.0, 60.0], [2.0, 75.0]]), None);
    }

    #[test]
    fn sweep_sets_share_no_sweep() {
        let recorded = noise("c16", &preset("c16").unwrap(), 3).unwrap();
        let sets = sweep_sets(&recorded, NOISE_TRIALS);
        assert!(sets.len() >= NOISE_TRIALS - 1 && sets.iter().all(|sweeps| sweeps.len() == SWEEPS), "{}", sets.len());
        let mut times: Vec<i64> = sets.iter().flatten().map(|o| o.mid_time_ns).collect();
        let count = times.len();
        times.sort_unstable();
        times.dedup();
        assert_eq!(times.len(), count);
    }
}
