//! False alarms of the room mapper on receiver noise: natural head motion, empty scene, the whole
//! mapper.
//!
//! The noise comes from the simulated receiver, so sub-apertures, their noise estimates and all
//! later stages work as with a sensor in empty space. Alarms are counted: scores above a threshold
//! that are nearer than [`SAME_ALARM_M`] and [`SAME_ALARM_S`] to each other are one alarm, since a
//! voxel keeps most of its score from one update to the next.
//!
//! The rate at which noise exceeds a score is the tail of a coherence score on noise
//! ([`NoiseTail`]) times the number of independent cells per hour. That number depends on beam,
//! range axis, pulse and path and has no closed form; it is estimated from the alarms at a low
//! score ([`RoomNoise::independent_cells_per_h`]). With it every score has a rate and every rate a
//! score, far beyond what a simulation can reach.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::trial_recording::TrialRecording;
use a121::SensorConfig;
use radar_mapping::{RoomMapper, RoomMapperSettings, Update};
use radar_sar::PositionErrors;
use radar_sar::math;
use radar_sar::subaperture::{
    MEAN_LOG_OF_NOISE, NoiseTail, PlaneField, Subaperture, SubapertureBuilder, SubapertureSettings,
};
use radar_sar::{Beam, Observation};
use radar_simulation::{Scenario, ScenarioError};

/// Alarms nearer than this to each other are one, metres. Choice: six voxels, the width of a
/// point's response across the range.
pub const SAME_ALARM_M: f64 = 0.3;
/// Alarms nearer than this in time are one, seconds. Choice; see [`SAME_ALARM_M`]. Choice: four
/// updates; see [`SAME_ALARM_M`].
pub const SAME_ALARM_S: f64 = 1.0;
/// Rate of alarms up to which they rarely merge, per hour. Choice: at five times as many, a quarter
/// of them merge.
const MAX_SEPARABLE_ALARMS_PER_H: f64 = 1000.0;
/// Number of random points at which each sub-aperture's score on noise is sampled. Choice: enough
/// for tails of 1e-5 within minutes, few enough to be nearly independent.
const SAMPLES_PER_SUBAPERTURE: usize = 32;
const BEAM: Beam = Beam::Lensless;

/// Effect of noise in one session, or in several of one preset.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RoomNoise {
    /// Thresholds at which alarms are counted.
    pub scores: Vec<f64>,
    /// Alarms among the maxima of the score field, by threshold.
    pub candidates: Vec<u64>,
    /// Alarms among the detections that remain after CLEAN, by threshold.
    pub places: Vec<u64>,
    /// Greatest score of a maximum, of a detection after CLEAN, and of a plane; −∞ without any.
    pub greatest: [f64; 3],
    /// Number of updates with an observation of an obstacle, and of a wall.
    pub hits: [u64; 2],
    /// Number of obstacles and of walls confirmed at the end.
    pub confirmed: [usize; 2],
    /// Time played, seconds.
    pub played_s: f64,
    /// Sub-apertures imaged.
    pub blocks: u64,
    /// Updates of the map.
    pub looks: u64,
    sweeps: u64,
    voxel_updates: u64,
    evidence: ScoreMoments,
}

/// ln(1 + m) − 0.596 at random points in beam and range: count, sum and sum of squares.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct ScoreMoments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl RoomNoise {
    /// Simulates one seed's natural head motion in empty space. The lowest of `scores` replaces the
    /// default thresholds of candidates and detections. The confirmation thresholds keep their
    /// defaults. The hands' reach is 0, so that confirmation is never postponed.
    ///
    /// # Errors
    /// A configuration that the sensor refuses, or an invalid duration.
    pub fn of(config: &SensorConfig, seed: u64, duration_s: f64, scores: &[f64]) -> Result<Self, ScenarioError> {
        let recorded = TrialRecording::of(&Scenario::new("nothing", "natural", config.clone(), duration_s, seed))?;
        let mut settings = RoomMapperSettings::default();
        let least = scores.iter().copied().fold(settings.clean.min_score, f64::min);
        (settings.clean.min_candidate_score, settings.clean.min_score) = (least, least);
        settings.tracks.hands_reach_m = 0.0;
        let mut session = NoiseSession::new(settings, scores, seed);
        recorded.observations.into_iter().for_each(|observation| session.push(observation));
        Ok(Self { played_s: duration_s, ..session.noise() })
    }

    /// Both sessions together, with the thresholds of the first.
    pub fn merged(mut self, other: &Self) -> Self {
        let add = |to: &mut u64, from: &u64| *to += from;
        self.candidates.iter_mut().zip(&other.candidates).for_each(|(to, from)| add(to, from));
        self.places.iter_mut().zip(&other.places).for_each(|(to, from)| add(to, from));
        for n in 0..3 {
            self.greatest[n] = self.greatest[n].max(other.greatest[n]);
        }
        for n in 0..2 {
            self.hits[n] += other.hits[n];
            self.confirmed[n] += other.confirmed[n];
        }
        let (a, b) = (self.evidence, other.evidence);
        self.evidence = ScoreMoments { count: a.count + b.count, sum: a.sum + b.sum, squares: a.squares + b.squares };
        self.played_s += other.played_s;
        self.blocks += other.blocks;
        self.looks += other.looks;
        self.sweeps += other.sweeps;
        self.voxel_updates += other.voxel_updates;
        self
    }

    /// Mean number of sweeps per sub-aperture.
    pub fn sweeps_per_subaperture(&self) -> f64 {
        self.sweeps as f64 / self.blocks.max(1) as f64
    }

    /// Mean number of voxels in the beam of a sub-aperture.
    pub fn voxels(&self) -> f64 {
        self.voxel_updates as f64 / self.sweeps.max(1) as f64
    }

    /// Mean and standard deviation of what one sub-aperture adds to a score.
    pub fn of_subaperture(&self) -> [f64; 2] {
        let ScoreMoments { count, sum, squares } = self.evidence;
        let mean = sum / count.max(1.0);
        [mean, (squares / count.max(1.0) - mean * mean).max(0.0).sqrt()]
    }

    /// Theoretical tail of a score on noise, for a window of sub-apertures as long as the measured
    /// ones.
    pub fn tail(&self) -> NoiseTail {
        let settings = RoomMapperSettings::default();
        let period_s = self.played_s / self.blocks.max(1) as f64;
        let blocks = (settings.clean.window_s / period_s.max(1e-3)) as usize;
        NoiseTail::new(self.sweeps_per_subaperture(), blocks, period_s, settings.subapertures.decay_s)
    }

    /// Independent cells per hour, estimated from the alarms at the threshold with the highest rate
    /// that still counts as rare; 0 without any.
    pub fn independent_cells_per_h(&self) -> f64 {
        let rates =
            self.scores.iter().zip(&self.candidates).map(|(score, alarms)| (*score, *alarms as f64 / self.hours()));
        let most = rates.filter(|(_, rate)| *rate <= MAX_SEPARABLE_ALARMS_PER_H).max_by(|a, b| a.1.total_cmp(&b.1));
        most.map_or(0.0, |(score, rate)| rate * math::exp(self.tail().surprisal(score)))
    }

    /// Time played, hours.
    pub fn hours(&self) -> f64 {
        self.played_s / 3600.0
    }
}

/// Upper bound of an event rate, per hour, at 95 % confidence, given the number of events in some
/// hours: 3/T without events.
pub fn rate_upper_bound_per_h(events: u64, hours: f64) -> f64 {
    // Quantile of a gamma variable (Wilson and Hilferty).
    let shape = events as f64 + 1.0;
    shape * (1.0 - 1.0 / (9.0 * shape) + 1.6449 / (3.0 * shape.sqrt())).powi(3) / hours
}

/// Alarms above one threshold.
#[derive(Debug, Clone, Default)]
struct Alarms {
    /// Alarms that may continue: position, and time at which last exceeded, nanoseconds.
    open: Vec<(DVec3, i64)>,
    count: u64,
}

impl Alarms {
    fn take(&mut self, points: impl Iterator<Item = DVec3>, time_ns: i64) {
        for point in points {
            match self.open.iter_mut().find(|(at, _)| at.distance(point) < SAME_ALARM_M) {
                Some(open) => *open = (point, time_ns),
                None => {
                    self.open.push((point, time_ns));
                    self.count += 1;
                }
            }
        }
        self.open.retain(|(_, last_ns)| (time_ns - last_ns) as f64 * 1e-9 < SAME_ALARM_S);
    }
}

/// A mapper fed with noise, and its counts.
struct NoiseSession {
    settings: RoomMapperSettings,
    search: RoomMapper,
    builder: SubapertureBuilder,
    planes: PlaneField,
    rng: ChaCha8Rng,
    candidates: Vec<Alarms>,
    places: Vec<Alarms>,
    totals: RoomNoise,
}

impl NoiseSession {
    fn new(settings: RoomMapperSettings, scores: &[f64], seed: u64) -> Self {
        let none = vec![Alarms::default(); scores.len()];
        Self {
            search: RoomMapper::new(settings, &BEAM, PositionErrors::default()),
            builder: SubapertureBuilder::new(settings.subapertures),
            planes: PlaneField::new(settings.subapertures, settings.subapertures.min_cos(&BEAM)),
            rng: ChaCha8Rng::seed_from_u64(seed ^ 0x0E71_DE7C),
            candidates: none.clone(),
            places: none,
            totals: RoomNoise { scores: scores.to_vec(), greatest: [f64::NEG_INFINITY; 3], ..RoomNoise::default() },
            settings,
        }
    }

    fn push(&mut self, observation: Observation) {
        let time_ns = observation.mid_time_ns;
        if let Some(subaperture) = self.builder.push(observation.clone()) {
            self.planes.add(&subaperture);
            let scores = sample_scores(&subaperture, &self.settings.subapertures, &mut self.rng);
            let sums = &mut self.totals.evidence;
            sums.count += scores.len() as f64;
            sums.sum += scores.iter().sum::<f64>();
            sums.squares += scores.iter().map(|one| one * one).sum::<f64>();
            self.totals.sweeps += subaperture.sweep_count() as u64;
        }
        let updates = self.totals.looks;
        self.search.push(observation);
        self.totals.looks = self.search.counters().looks;
        if self.totals.looks > updates {
            self.count_update(time_ns);
        }
    }

    /// Counts the results of one update.
    fn count_update(&mut self, time_ns: i64) {
        let Update { peaks, places, point_hits, wall_hits, .. } = self.search.last_update();
        for (n, score) in self.totals.scores.iter().enumerate() {
            let peaks = peaks.iter().filter(|peak| peak.score >= *score);
            self.candidates[n].take(peaks.map(|peak| peak.position_m), time_ns);
            let places = places.iter().filter(|detection| detection.score >= *score);
            self.places[n].take(places.map(|detection| detection.estimate), time_ns);
        }
        let explain = &self.settings.clean;
        let planes = self.planes.peaks(0.0, explain.plane_min_subapertures, time_ns - (explain.window_s * 1e9) as i64);
        let here = [
            peaks.first().map(|peak| peak.score),
            places.iter().map(|detection| detection.score).reduce(f64::max),
            planes.first().map(|plane| plane.score),
        ];
        for (greatest, here) in self.totals.greatest.iter_mut().zip(here) {
            *greatest = greatest.max(here.unwrap_or(f64::NEG_INFINITY));
        }
        self.totals.hits[0] += u64::from(*point_hits > 0);
        self.totals.hits[1] += u64::from(*wall_hits > 0);
    }

    fn noise(self) -> RoomNoise {
        let counters = self.search.counters();
        RoomNoise {
            candidates: self.candidates.iter().map(|alarms| alarms.count).collect(),
            places: self.places.iter().map(|alarms| alarms.count).collect(),
            confirmed: [self.search.obstacles().len(), self.search.walls().len()],
            blocks: counters.blocks,
            voxel_updates: counters.voxel_updates,
            ..self.totals
        }
    }
}

/// A sub-aperture's score at random points in its beam and range.
fn sample_scores(subaperture: &Subaperture, settings: &SubapertureSettings, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let within = settings.within(&subaperture.geometry().axis);
    let min_cos = settings.min_cos(&BEAM);
    let mut point = |_: usize| {
        let (cos, turn) = (rng.random_range(min_cos..1.0), rng.random_range(0.0..std::f64::consts::TAU));
        let sin = (1.0 - cos * cos).sqrt();
        let toward = subaperture.middle.rotation * DVec3::new(sin * math::cos(turn), sin * math::sin(turn), -cos);
        (toward * rng.random_range(within.min_range_m..within.max_range_m)).as_vec3().to_array()
    };
    let points: Vec<[f32; 3]> = (0..SAMPLES_PER_SUBAPERTURE).map(&mut point).collect();
    let coherences = subaperture.coherence_at_points(&points).into_iter();
    coherences.map(|coherence| math::ln_1p(f64::from(coherence.m)) - MEAN_LOG_OF_NOISE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;

    /// Preset, duration in seconds, and independent cells per hour by the alarms above [`SCORE`],
    /// measured on 24 minutes of other seeds (`lab/examples/room_false_alarms.rs`).
    const CALIBRATED: [(&str, f64, f64); 4] =
        [("d16", 40.0, 2.8e8), ("c16", 40.0, 3.5e8), ("far", 80.0, 2.2e8), ("close", 400.0, 1.8e7)];
    const SCORE: f64 = 1.75;

    #[test]
    fn noise_alarm_rate_matches_the_model_in_every_room_preset() {
        for (name, duration_s, independent_cells_per_h) in CALIBRATED {
            let config = preset(name).unwrap();
            let noise = RoomNoise::of(&config, 9001, duration_s, &[SCORE, 2.25]).unwrap();
            // Mean and spread of one sub-aperture's score against the model of noise.
            let (measured, stated) = (noise.of_subaperture(), noise.tail().of_subaperture());
            assert!((measured[0] - stated[0]).abs() < 0.02, "{name}: {measured:?} {stated:?}");
            assert!((measured[1] / stated[1] - 1.0).abs() < 0.05, "{name}: {measured:?} {stated:?}");
            // The number of alarms agrees with the stated one within four standard deviations of
            // the count plus 20 %.
            let expected = independent_cells_per_h * (-noise.tail().surprisal(SCORE)).exp() * noise.hours();
            let alarms = noise.candidates[0] as f64;
            assert!(expected > 35.0, "{name}: too few expected alarms: {expected}");
            let allowed = 4.0 * expected.sqrt() + 0.2 * expected;
            assert!((alarms - expected).abs() < allowed, "{name}: {alarms} alarms, stated {expected}");
            // More than ten times fewer alarms at a score half a unit higher.
            assert!(noise.candidates[1] * 10 < noise.candidates[0], "{name}: {noise:?}");
            assert!(noise.places[0] > 0 && noise.places[0] < noise.candidates[0], "{name}: {noise:?}");
            assert_eq!((noise.hits, noise.confirmed), ([0, 0], [0, 0]), "{name}");
        }
    }

    #[test]
    fn persistent_score_counts_as_one_alarm() {
        let mut alarms = Alarms::default();
        let seconds = |s: f64| (s * 1e9) as i64;
        for n in 0..8 {
            // The position drifts, as a maximum does.
            alarms.take([DVec3::X * 0.1 * f64::from(n)].into_iter(), seconds(0.25 * f64::from(n)));
        }
        assert_eq!(alarms.count, 1);
        alarms.take([DVec3::X * 0.7, DVec3::Y].into_iter(), seconds(2.0));
        assert_eq!(alarms.count, 2);
        alarms.take(std::iter::empty(), seconds(3.1));
        alarms.take([DVec3::Y].into_iter(), seconds(3.2));
        assert_eq!(alarms.count, 3);
    }

    #[test]
    fn sessions_add_up() {
        let config = preset("c16").unwrap();
        let [a, b] = [1, 2].map(|seed| RoomNoise::of(&config, seed, 3.0, &[1.5]).unwrap());
        assert_eq!(a, RoomNoise::of(&config, 1, 3.0, &[1.5]).unwrap());
        let both = a.clone().merged(&b);
        assert_eq!(both.candidates[0], a.candidates[0] + b.candidates[0]);
        assert!((both.sweeps_per_subaperture() - 45.0).abs() < 0.5 && (both.hours() - 6.0 / 3600.0).abs() < 1e-12);
        // Frequent alarms merge, so they give no estimate of the number of independent cells.
        assert!(
            both.candidates[0] as f64 > MAX_SEPARABLE_ALARMS_PER_H * both.hours()
                && both.independent_cells_per_h() == 0.0
        );
        let rare = RoomNoise { candidates: vec![1], ..both.clone() };
        assert!((rare.independent_cells_per_h() / (600.0 * rare.tail().surprisal(1.5).exp()) - 1.0).abs() < 1e-9);
        assert!(both.greatest[0] >= a.greatest[0].max(b.greatest[0]) && both.greatest[0] > 1.0);
    }

    #[test]
    fn bounds_are_those_of_the_poisson_distribution() {
        // 95 % bounds for 0, 3 and 10 events.
        for (events, bound) in [(0, 2.996), (3, 7.754), (10, 16.96)] {
            assert!((rate_upper_bound_per_h(events, 2.0) * 2.0 - bound).abs() < 0.04, "{events}");
        }
    }
}
