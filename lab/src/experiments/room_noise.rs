//! How far a receiver's noise alone gets in the search in rooms: a head that moves as in play, no scene, the whole search.
//!
//! Noise comes from the simulated receiver, so blocks, their noise estimates and all that follows are what a sensor in empty space would
//! give. What is counted are alarms: scores above a threshold that are nearer than [`SAME_ALARM_M`] and [`SAME_ALARM_S`] to each other are one, since a
//! voxel keeps most of its score from look to look.
//!
//! How often noise exceeds a score is the tail of a block score on noise ([`NoiseTail`]) times the number of places an hour that score by
//! themselves. How many these are depends on beam, range axis, pulse and path, and no formula tells; the alarms at a low score do
//! ([`RoomNoise::independent_cells_per_h`]). Then every score has its rate and every rate its score, far beyond what can be waited for.

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

/// Scores above a threshold this near to each other are one alarm, metres.
pub const SAME_ALARM_M: f64 = 0.3;
/// See [`SAME_ALARM_M`], seconds.
pub const SAME_ALARM_S: f64 = 1.0;
/// Where alarms are more, some are taken for one: a quarter of them at five times as many.
const MAX_SEPARABLE_ALARMS_PER_H: f64 = 1000.0;
/// Places that each block is asked for, to tell what noise does there.
const SAMPLES_PER_SUBAPERTURE: usize = 32;
const BEAM: Beam = Beam::Lensless;

/// What noise did in a session, or in several of one preset.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RoomNoise {
    /// Thresholds that alarms are counted at.
    pub scores: Vec<f64>,
    /// Alarms among the field's maxima, by threshold.
    pub candidates: Vec<u64>,
    /// Alarms among what is left of them after explaining away, by threshold.
    pub places: Vec<u64>,
    /// Greatest score of a maximum, of a place after explaining away, and of a plane; −∞ without any.
    pub greatest: [f64; 3],
    /// Looks at which a place, and a wall, counted as sighted.
    pub sightings: [u64; 2],
    /// Obstacles and walls that were confirmed in the end.
    pub confirmed: [usize; 2],
    /// Time played, seconds.
    pub played_s: f64,
    /// Blocks imaged.
    pub blocks: u64,
    /// Looks at the evidence.
    pub looks: u64,
    sweeps: u64,
    voxel_updates: u64,
    evidence: ScoreMoments,
}

/// ln(1 + m) − 0.596 at places anywhere in beam and range: how many, their sum and the sum of their squares.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct ScoreMoments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl RoomNoise {
    /// A head's moves of a seed in empty space. The least of the scores, thresholds to count alarms at, is what the search looks at and
    /// believes from; what it confirms stays as it is, but that there are no hands, so that nothing is left for later.
    ///
    /// # Errors
    /// A configuration that the sensor would refuse, a length that is none.
    pub fn of(config: &SensorConfig, seed: u64, duration_s: f64, scores: &[f64]) -> Result<Self, ScenarioError> {
        let recorded = TrialRecording::of(&Scenario::new("nothing", "natural", config.clone(), duration_s, seed))?;
        let mut settings = RoomMapperSettings::default();
        let least = scores.iter().copied().fold(settings.explain.min_score, f64::min);
        (settings.explain.min_candidate_score, settings.explain.min_score) = (least, least);
        settings.map.hands_reach_m = 0.0;
        let mut session = NoiseSession::new(settings, scores, seed);
        recorded.observations.into_iter().for_each(|observation| session.push(observation));
        Ok(Self { played_s: duration_s, ..session.noise() })
    }

    /// Both together; thresholds are those of the first.
    pub fn merged(mut self, other: &Self) -> Self {
        let add = |to: &mut u64, from: &u64| *to += from;
        self.candidates.iter_mut().zip(&other.candidates).for_each(|(to, from)| add(to, from));
        self.places.iter_mut().zip(&other.places).for_each(|(to, from)| add(to, from));
        for n in 0..3 {
            self.greatest[n] = self.greatest[n].max(other.greatest[n]);
        }
        for n in 0..2 {
            self.sightings[n] += other.sightings[n];
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

    /// Sweeps in a block, on average.
    pub fn sweeps_per_subaperture(&self) -> f64 {
        self.sweeps as f64 / self.blocks.max(1) as f64
    }

    /// Voxels in the beam of a block, on average.
    pub fn voxels(&self) -> f64 {
        self.voxel_updates as f64 / self.sweeps.max(1) as f64
    }

    /// Mean and standard deviation of what a block adds to a place's score.
    pub fn of_subaperture(&self) -> [f64; 2] {
        let ScoreMoments { count, sum, squares } = self.evidence;
        let mean = sum / count.max(1.0);
        [mean, (squares / count.max(1.0) - mean * mean).max(0.0).sqrt()]
    }

    /// The tail that a place's score should have: of a window's worth of blocks as long as those that there were.
    pub fn tail(&self) -> NoiseTail {
        let settings = RoomMapperSettings::default();
        let block_s = self.played_s / self.blocks.max(1) as f64;
        let blocks = (settings.explain.window_s / block_s.max(1e-3)) as usize;
        NoiseTail::new(self.sweeps_per_subaperture(), blocks, block_s, settings.blocks.memory_s)
    }

    /// Places an hour that score by themselves, as alarms tell: those of the threshold with most of them at which they are too rare to run
    /// into each other; 0 without any.
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

/// The rate that so many events within some hours do not exceed, at 95 % confidence, an hour: 3/T without any.
pub fn rate_upper_bound_per_h(events: u64, hours: f64) -> f64 {
    // A gamma variable's quantile, by Wilson and Hilferty.
    let shape = events as f64 + 1.0;
    shape * (1.0 - 1.0 / (9.0 * shape) + 1.6449 / (3.0 * shape.sqrt())).powi(3) / hours
}

/// Alarms above one threshold.
#[derive(Debug, Clone, Default)]
struct Alarms {
    /// Those that may go on: where, and when last above.
    open: Vec<(DVec3, i64)>,
    count: u64,
}

impl Alarms {
    fn take(&mut self, places: impl Iterator<Item = DVec3>, time_ns: i64) {
        for place in places {
            match self.open.iter_mut().find(|(at, _)| at.distance(place) < SAME_ALARM_M) {
                Some(open) => *open = (place, time_ns),
                None => {
                    self.open.push((place, time_ns));
                    self.count += 1;
                }
            }
        }
        self.open.retain(|(_, last_ns)| (time_ns - last_ns) as f64 * 1e-9 < SAME_ALARM_S);
    }
}

/// A search that noise goes through, watched.
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
            builder: SubapertureBuilder::new(settings.blocks),
            planes: PlaneField::new(settings.blocks, settings.blocks.min_cos(&BEAM)),
            rng: ChaCha8Rng::seed_from_u64(seed ^ 0x0E71_DE7C),
            candidates: none.clone(),
            places: none,
            totals: RoomNoise { scores: scores.to_vec(), greatest: [f64::NEG_INFINITY; 3], ..RoomNoise::default() },
            settings,
        }
    }

    fn push(&mut self, observation: Observation) {
        let time_ns = observation.mid_time_ns;
        if let Some(block) = self.builder.push(observation.clone()) {
            self.planes.add(&block);
            let said = sample_scores(&block, &self.settings.blocks, &mut self.rng);
            let sums = &mut self.totals.evidence;
            sums.count += said.len() as f64;
            sums.sum += said.iter().sum::<f64>();
            sums.squares += said.iter().map(|one| one * one).sum::<f64>();
            self.totals.sweeps += block.sweep_count() as u64;
        }
        let looks = self.totals.looks;
        self.search.push(observation);
        self.totals.looks = self.search.counters().looks;
        if self.totals.looks > looks {
            self.count_update(time_ns);
        }
    }

    /// Counts what a look came upon.
    fn count_update(&mut self, time_ns: i64) {
        let Update { peaks, places, point_hits, wall_hits, .. } = self.search.last_update();
        for (n, score) in self.totals.scores.iter().enumerate() {
            let peaks = peaks.iter().filter(|peak| peak.score >= *score);
            self.candidates[n].take(peaks.map(|peak| peak.position_m), time_ns);
            let places = places.iter().filter(|place| place.score >= *score);
            self.places[n].take(places.map(|place| place.estimate), time_ns);
        }
        let explain = &self.settings.explain;
        let planes = self.planes.peaks(0.0, explain.plane_min_blocks, time_ns - (explain.window_s * 1e9) as i64);
        let here = [
            peaks.first().map(|peak| peak.score),
            places.iter().map(|place| place.score).reduce(f64::max),
            planes.first().map(|plane| plane.score),
        ];
        for (greatest, here) in self.totals.greatest.iter_mut().zip(here) {
            *greatest = greatest.max(here.unwrap_or(f64::NEG_INFINITY));
        }
        self.totals.sightings[0] += u64::from(*point_hits > 0);
        self.totals.sightings[1] += u64::from(*wall_hits > 0);
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

/// What a block says of some places, anywhere in its beam and range.
fn sample_scores(block: &Subaperture, settings: &SubapertureSettings, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let within = settings.within(&block.geometry().axis);
    let min_cos = settings.min_cos(&BEAM);
    let mut place = |_: usize| {
        let (cos, turn) = (rng.random_range(min_cos..1.0), rng.random_range(0.0..std::f64::consts::TAU));
        let sin = (1.0 - cos * cos).sqrt();
        let toward = block.middle.rotation * DVec3::new(sin * math::cos(turn), sin * math::sin(turn), -cos);
        (toward * rng.random_range(within.min_range_m..within.max_range_m)).as_vec3().to_array()
    };
    let places: Vec<[f32; 3]> = (0..SAMPLES_PER_SUBAPERTURE).map(&mut place).collect();
    let said = block.coherence_at_points(&places).into_iter();
    said.map(|coherence| math::ln_1p(f64::from(coherence.m)) - MEAN_LOG_OF_NOISE).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use a121::preset;

    /// Preset, seconds, and the places an hour that score by themselves by the alarms above [`SCORE`], from 24 minutes of other seeds
    /// (`examples/room_false_alarms.rs`).
    const CALIBRATED: [(&str, f64, f64); 4] =
        [("d16", 40.0, 2.8e8), ("c16", 40.0, 3.5e8), ("far", 80.0, 2.2e8), ("close", 400.0, 1.8e7)];
    const SCORE: f64 = 1.75;

    #[test]
    fn noise_alarm_rate_matches_the_model_in_every_room_preset() {
        for (name, duration_s, independent_cells_per_h) in CALIBRATED {
            let config = preset(name).unwrap();
            let noise = RoomNoise::of(&config, 9001, duration_s, &[SCORE, 2.25]).unwrap();
            // What one block adds: mean and spread, by the model of noise.
            let (measured, stated) = (noise.of_subaperture(), noise.tail().of_subaperture());
            assert!((measured[0] - stated[0]).abs() < 0.02, "{name}: {measured:?} {stated:?}");
            assert!((measured[1] / stated[1] - 1.0).abs() < 0.05, "{name}: {measured:?} {stated:?}");
            // Alarms: neither more nor fewer than stated, by the spread of their count and a fifth. Neither none nor twice as many.
            let expected = independent_cells_per_h * (-noise.tail().surprisal(SCORE)).exp() * noise.hours();
            let alarms = noise.candidates[0] as f64;
            assert!(expected > 35.0, "{name}: too short to tell: {expected}");
            let allowed = 4.0 * expected.sqrt() + 0.2 * expected;
            assert!((alarms - expected).abs() < allowed, "{name}: {alarms} alarms, stated {expected}");
            // Ten times and more fewer half a unit on.
            assert!(noise.candidates[1] * 10 < noise.candidates[0], "{name}: {noise:?}");
            assert!(noise.places[0] > 0 && noise.places[0] < noise.candidates[0], "{name}: {noise:?}");
            assert_eq!((noise.sightings, noise.confirmed), ([0, 0], [0, 0]), "{name}");
        }
    }

    #[test]
    fn persistent_score_counts_as_one_alarm() {
        let mut alarms = Alarms::default();
        let seconds = |s: f64| (s * 1e9) as i64;
        for n in 0..8 {
            // It drifts, as a maximum does.
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
        // Alarms every second say nothing of how many places score by themselves.
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
