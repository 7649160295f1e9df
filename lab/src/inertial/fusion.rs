//! Fusion of inertial samples with intermittent optical poses: an error-state Kalman filter with
//! the unit's biases, scales and misalignments, and with the tracker's slow error (Solà,
//! "Quaternion kinematics for the error-state Kalman filter", 2017, §5 and §7: attitude errors in
//! the outer frame; Markley 2003 on why errors and not quaternions).
//!
//! The nominal state is dead reckoning with corrected measurements, `ω = (I + M_g)⁻¹(ω_m − b_g)`
//! and likewise for the force. Its error, in blocks of three:
//!
//! | block | what | propagation over h |
//! |---|---|---|
//! | p | position, m | p + h v + ½ δv |
//! | v | velocity, m/s | v + δv, δv = −[R F h]× θ − R C_a h Σ_j u_j a_j + white |
//! | θ | attitude, tracking frame, rad | θ − R C_g h Σ_j w_j g_j + white |
//! | g_0…g_3 | gyroscope: bias, columns of M_g; w = (1, ω) | walk |
//! | a_0…a_3 | accelerometer: bias, columns of M_a; u = (1, F) | walk |
//! | s, r | the tracker's drift, m and rad | e^(−h/T), Gauss–Markov |
//!
//! An optical pose measures p + s and θ + r with white noise. One that contradicts the state (χ²
//! with three degrees of freedom, beyond 1 in 10⁶) is ignored and counted. After half a second of
//! nothing but contradictions the tracker is trusted and the filter restarts.
//!
//! Times: a pose waits until a sample covers its time, and the sample's interval is divided there.
//! Poses and samples before the state's time are refused, so both streams must have rising times;
//! poses are late by at most one sample.

use std::collections::VecDeque;

use glam::{DMat3, DQuat, DVec3};

use super::strapdown::{MAX_INTERVAL_S, Means, Slopes};
use super::{ImuSample, ImuSpec, NavState, TriadSpec};
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::{PoseRefusal, PoseSample};

/// Most poses that wait for samples. Choice: a second of poses at the fastest tracker's rate;
/// bounds memory when the samples stop.
const MAX_WAITING: usize = 256;
/// χ² gate. Choice: with three degrees of freedom, exceeded once in a million, so no good pose is
/// lost.
const GATE_CHI2: f64 = 30.7;
/// Duration of contradictions in a row from which on the tracker is trusted, seconds. Choice:
/// single bad poses are shorter, and inertia alone drifts by centimetres in this time.
const MAX_CONTRADICTION_S: f64 = 0.5;
/// 1σ of a body's speed before any measurement, m/s. Choice: above the speeds of a head in play.
const SPEED_PRIOR_M_PER_S: f64 = 2.0;
/// Random walk without samples: of the speed, m/s/√s, and of the rotation, rad/√s. Choice: above
/// the accelerations and turns of a head, so that the filter does not trust its prediction.
const COASTING_WALK: f64 = 5.0;
/// The filter restarts after a longer pause of the samples, seconds. Choice: inertia has drifted by
/// metres after this time.
const MAX_COAST_S: f64 = 5.0;

/// Blocks of three of the error state.
const P: usize = 0;
const V: usize = 1;
const TURN: usize = 2;
const GYRO: usize = 3;
const ACCEL: usize = 7;
const S: usize = 11;
const R: usize = 12;
const BLOCKS: usize = 13;

type Blocks = [[DMat3; BLOCKS]; BLOCKS];

/// Error model of the unit and of the tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FusionSettings {
    /// The unit.
    pub imu: ImuSpec,
    /// White noise of an optical position, one axis, metres.
    pub jitter_m: f64,
    /// White noise of an optical rotation, one axis, rad.
    pub jitter_rad: f64,
    /// Rms drift of the tracker's positions, one axis, metres.
    pub wander_m: f64,
    /// Rms drift of its rotations, one axis, rad.
    pub wander_rad: f64,
    /// Correlation time of the drift, seconds.
    pub wander_time_s: f64,
}

impl FusionSettings {
    /// A unit with good lighthouse tracking.
    pub fn of(imu: ImuSpec) -> Self {
        Self {
            imu,
            jitter_m: 0.3e-3,
            jitter_rad: 0.2e-3,
            wander_m: 1e-3,
            wander_rad: 0.1f64.to_radians(),
            wander_time_s: 1.0,
        }
    }
}

/// Why a pose or a sample was not used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FusionRefusal {
    /// A pose that was refused.
    #[error(transparent)]
    Pose(#[from] PoseRefusal),
    /// Before the state.
    #[error("time {time_ns} ns lies before {before_ns} ns, which was taken already")]
    Late {
        /// Its time.
        time_ns: i64,
        /// The time of the state.
        before_ns: i64,
    },
    /// A sample that is not finite.
    #[error("the sample's numbers are not finite")]
    Numbers,
}

/// What arrived and what became of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FusionCounters {
    /// Samples that moved the state.
    pub samples: u64,
    /// Poses that corrected it.
    pub poses: u64,
    /// Poses that contradicted it.
    pub contradictions: u64,
    /// Restarts of the filter.
    pub restarts: u64,
    /// Poses dropped while waiting.
    pub dropped: u64,
}

/// Estimated bias and sensitivity of a triad.
#[derive(Debug, Clone, Copy)]
struct Triad {
    bias: DVec3,
    matrix: DMat3,
}

impl Triad {
    const NONE: Self = Self { bias: DVec3::ZERO, matrix: DMat3::ZERO };

    /// (I + M)⁻¹.
    fn inverse(&self) -> DMat3 {
        (DMat3::IDENTITY + self.matrix).inverse()
    }

    /// Adds the correction of its four blocks.
    fn correct(&mut self, by: &[DVec3]) {
        self.bias += by[0];
        self.matrix += DMat3::from_cols(by[1], by[2], by[3]);
    }
}

/// The filter.
#[derive(Debug, Clone)]
pub struct PoseFusion {
    settings: FusionSettings,
    waiting: VecDeque<(i64, Pose)>,
    state: Option<NavState>,
    gyroscope: Triad,
    accelerometer: Triad,
    wander_m: DVec3,
    wander_rad: DVec3,
    covariance: Box<Blocks>,
    before: Option<(Means, f64)>,
    /// Time since which every pose contradicts.
    contradicted_since_ns: Option<i64>,
    newest_pose_ns: Option<i64>,
    counters: FusionCounters,
}

impl PoseFusion {
    /// Nothing known but the settings.
    pub fn new(settings: FusionSettings) -> Self {
        let mut covariance = Box::new([[DMat3::ZERO; BLOCKS]; BLOCKS]);
        for (first, figures) in [(GYRO, &settings.imu.gyroscope), (ACCEL, &settings.imu.accelerometer)] {
            covariance[first][first] = variance(math::hypot(figures.turn_on, figures.instability));
            for column in 0..3 {
                let mut rows = DVec3::splat(figures.cross * figures.cross);
                rows[column] = figures.scale * figures.scale;
                covariance[first + 1 + column][first + 1 + column] = DMat3::from_diagonal(rows);
            }
        }
        covariance[S][S] = variance(settings.wander_m);
        covariance[R][R] = variance(settings.wander_rad);
        Self {
            settings,
            waiting: VecDeque::new(),
            state: None,
            gyroscope: Triad::NONE,
            accelerometer: Triad::NONE,
            wander_m: DVec3::ZERO,
            wander_rad: DVec3::ZERO,
            covariance,
            before: None,
            contradicted_since_ns: None,
            newest_pose_ns: None,
            counters: FusionCounters::default(),
        }
    }

    /// The state at the newest sample; `None` before the first pose.
    pub fn state(&self) -> Option<&NavState> {
        self.state.as_ref()
    }

    /// The state as a pose of a tracker.
    pub fn pose(&self) -> Option<PoseSample> {
        self.state.map(|state| PoseSample::valid(state.time_ns, &state.tracking_from_body))
    }

    /// Covariances of position (m²), velocity (m²/s²) and attitude (rad²), tracking frame.
    pub fn covariances(&self) -> [DMat3; 3] {
        [P, V, TURN].map(|block| self.covariance[block][block])
    }

    /// What arrived and what became of it.
    pub fn counters(&self) -> &FusionCounters {
        &self.counters
    }

    /// Adds an optical pose. It corrects the state when the next sample covers its time.
    ///
    /// # Errors
    /// A pose that is refused, or a pose before the state or before another one.
    pub fn push_pose(&mut self, sample: &PoseSample) -> Result<(), FusionRefusal> {
        let pose = sample.tracking_from_head()?;
        let state_ns = self.state.map(|state| state.time_ns);
        if let Some(before_ns) = state_ns.max(self.newest_pose_ns).filter(|&before_ns| sample.time_ns < before_ns) {
            return Err(FusionRefusal::Late { time_ns: sample.time_ns, before_ns });
        }
        self.newest_pose_ns = Some(sample.time_ns);
        if self.state.is_none() {
            self.initialise(sample.time_ns, pose);
            return Ok(());
        }
        self.waiting.push_back((sample.time_ns, pose));
        if self.waiting.len() > MAX_WAITING {
            self.waiting.pop_front();
            self.counters.dropped += 1;
        }
        Ok(())
    }

    /// Adds a sample: moves the state to its time, correcting it by the poses that waited for it.
    /// Before the first pose it does nothing.
    ///
    /// # Errors
    /// Numbers that are not finite, or a time not later than the state's.
    pub fn push_imu(&mut self, sample: &ImuSample) -> Result<(), FusionRefusal> {
        if !sample.is_finite() {
            return Err(FusionRefusal::Numbers);
        }
        let Some(state) = self.state else { return Ok(()) };
        if sample.time_ns <= state.time_ns {
            return Err(FusionRefusal::Late { time_ns: sample.time_ns, before_ns: state.time_ns });
        }
        self.counters.samples += 1;
        if sample.time_ns.saturating_sub(state.time_ns) as f64 * 1e-9 > MAX_COAST_S {
            self.counters.restarts += 1;
            self.state = None;
        }
        while let Some((time_ns, pose)) = self.waiting.pop_front_if(|(time_ns, _)| *time_ns <= sample.time_ns) {
            match self.state {
                None => self.initialise(time_ns, pose),
                Some(_) => {
                    self.advance(time_ns, sample);
                    self.correct(time_ns, &pose);
                }
            }
        }
        self.advance(sample.time_ns, sample);
        Ok(())
    }

    /// Initialises at a pose, with an unknown velocity.
    fn initialise(&mut self, time_ns: i64, pose: Pose) {
        self.state = Some(NavState::at_rest(time_ns, pose));
        let FusionSettings { jitter_m, jitter_rad, wander_m, wander_rad, .. } = self.settings;
        (self.wander_m, self.wander_rad, self.before) = (DVec3::ZERO, DVec3::ZERO, None);
        for block in [P, V, TURN, S, R] {
            for other in 0..BLOCKS {
                self.covariance[block][other] = DMat3::ZERO;
                self.covariance[other][block] = DMat3::ZERO;
            }
        }
        let c = &mut self.covariance;
        c[V][V] = variance(SPEED_PRIOR_M_PER_S);
        // The pose is wrong by the tracker's drift, so the two errors are correlated.
        for (block, wander, jitter_1s, wander_1s) in [(P, S, jitter_m, wander_m), (TURN, R, jitter_rad, wander_rad)] {
            c[wander][wander] = variance(wander_1s);
            c[block][block] = variance(jitter_1s) + c[wander][wander];
            c[block][wander] = -c[wander][wander];
            c[wander][block] = -c[wander][wander];
        }
    }

    /// Moves the state to a time, with a sample that covers it.
    fn advance(&mut self, to_ns: i64, sample: &ImuSample) {
        let Some(state) = self.state else { return };
        let all_s = to_ns.saturating_sub(state.time_ns) as f64 * 1e-9;
        if all_s <= 0.0 {
            return;
        }
        let coasted_s = (all_s - MAX_INTERVAL_S).max(0.0);
        if coasted_s > 0.0 {
            self.coast(coasted_s);
        }
        let h = all_s - coasted_s;
        let [gyro, accel] = [self.gyroscope.inverse(), self.accelerometer.inverse()];
        let means = Means {
            rate: gyro * (sample.angular_rate_rad_per_s - self.gyroscope.bias),
            force: accel * (sample.specific_force_m_per_s2 - self.accelerometer.bias),
        };
        let slopes = Slopes::between(self.before, &means, h);
        let Some(state) = self.state else { return };
        let next = NavState { time_ns: to_ns, ..state.advanced(h, &means, &slopes) };
        let middle = state.tracking_from_body.rotation * DQuat::from_scaled_axis(means.rate * (0.5 * h));
        self.propagate_covariance(h, middle, &means, [gyro, accel]);
        (self.state, self.before) = (Some(next), Some((means, h)));
    }

    /// Constant velocity, with growing uncertainty.
    fn coast(&mut self, time_s: f64) {
        let Some(state) = &mut self.state else { return };
        state.tracking_from_body.translation += state.velocity_m_per_s * time_s;
        let still = Means { rate: DVec3::ZERO, force: DVec3::ZERO };
        let rotation = state.tracking_from_body.rotation;
        self.propagate_covariance(time_s, rotation, &still, [DMat3::ZERO; 2]);
        let walk = COASTING_WALK * COASTING_WALK * time_s;
        self.covariance[P][P] += DMat3::from_diagonal(DVec3::splat(walk * time_s * time_s / 3.0));
        self.covariance[P][V] += DMat3::from_diagonal(DVec3::splat(walk * time_s / 2.0));
        self.covariance[V][P] = self.covariance[P][V].transpose();
        self.covariance[V][V] += DMat3::from_diagonal(DVec3::splat(walk));
        self.covariance[TURN][TURN] += DMat3::from_diagonal(DVec3::splat(walk));
        self.before = None;
    }

    /// P ← Φ P Φᵀ + Q over an interval h; `inverses` are (I + M)⁻¹ of both triads.
    fn propagate_covariance(&mut self, h: f64, rotation: DQuat, means: &Means, inverses: [DMat3; 2]) {
        let turned = DMat3::from_quat(rotation);
        let lever = skew(rotation * means.force * h);
        let [by_gyro, by_accel] = inverses.map(|inverse| turned * inverse * h);
        let FusionSettings { imu, wander_m, wander_rad, wander_time_s, .. } = self.settings;
        let keeps = math::exp(-h / wander_time_s.max(1e-3));
        let on = |column: [DMat3; BLOCKS]| {
            let mut next = column;
            let of = |first: usize, by: DVec3| {
                column[first] + column[first + 1] * by.x + column[first + 2] * by.y + column[first + 3] * by.z
            };
            let gain = lever * column[TURN] + by_accel * of(ACCEL, means.force);
            next[P] = column[P] + column[V] * h - gain * (0.5 * h);
            next[V] = column[V] - gain;
            next[TURN] = column[TURN] - by_gyro * of(GYRO, means.rate);
            next[S] = column[S] * keeps;
            next[R] = column[R] * keeps;
            next
        };
        let c = &mut self.covariance;
        // Φ on the columns, and on the columns of the transpose.
        for _ in 0..2 {
            for column in 0..BLOCKS {
                let mapped = on(std::array::from_fn(|row| c[row][column]));
                (0..BLOCKS).for_each(|row| c[row][column] = mapped[row]);
            }
            transpose(c);
        }
        let white = |figures: &TriadSpec| variance(figures.white);
        let (rate, force) = (white(&imu.gyroscope), white(&imu.accelerometer));
        c[TURN][TURN] += rate * h;
        c[V][V] += force * h;
        c[P][V] += force * (h * h / 2.0);
        c[V][P] += force * (h * h / 2.0);
        c[P][P] += force * (h * h * h / 3.0);
        c[GYRO][GYRO] += variance(imu.gyroscope.bias_walk()) * h;
        c[ACCEL][ACCEL] += variance(imu.accelerometer.bias_walk()) * h;
        let fresh = 1.0 - keeps * keeps;
        c[S][S] += variance(wander_m) * fresh;
        c[R][R] += variance(wander_rad) * fresh;
        self.wander_m *= keeps;
        self.wander_rad *= keeps;
    }

    /// Corrects the state by a pose at its time.
    fn correct(&mut self, time_ns: i64, pose: &Pose) {
        let FusionSettings { jitter_m, jitter_rad, .. } = self.settings;
        let measured = [(P, S, jitter_m), (TURN, R, jitter_rad)];
        let agrees = measured.iter().all(|&(block, wander, jitter)| {
            let off = self.innovation(block, pose);
            off.dot(self.innovation_covariance(block, wander, jitter).inverse() * off) <= GATE_CHI2
        });
        if !agrees {
            self.counters.contradictions += 1;
            let since_ns = *self.contradicted_since_ns.get_or_insert(time_ns);
            if time_ns.saturating_sub(since_ns) as f64 * 1e-9 >= MAX_CONTRADICTION_S {
                self.counters.restarts += 1;
                self.contradicted_since_ns = None;
                self.initialise(time_ns, *pose);
            }
            return;
        }
        self.contradicted_since_ns = None;
        self.counters.poses += 1;
        for (block, wander, jitter) in measured {
            let off = self.innovation(block, pose);
            self.apply_measurement(block, wander, jitter, off);
        }
    }

    /// Difference of a pose from the state's prediction: in position, or in attitude.
    fn innovation(&self, block: usize, pose: &Pose) -> DVec3 {
        let Some(NavState { tracking_from_body: nominal, .. }) = self.state else { return DVec3::ZERO };
        if block == P {
            return pose.translation - nominal.translation - self.wander_m;
        }
        let turn = pose.rotation * nominal.rotation.conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        turn.to_scaled_axis() - self.wander_rad
    }

    /// Covariance of the difference.
    fn innovation_covariance(&self, block: usize, wander: usize, jitter: f64) -> DMat3 {
        let c = &self.covariance;
        c[block][block] + c[block][wander] + c[wander][block] + c[wander][wander] + variance(jitter)
    }

    /// Kalman update with a measurement of a block plus the tracker's drift.
    fn apply_measurement(&mut self, block: usize, wander: usize, jitter: f64, off: DVec3) {
        let weight = self.innovation_covariance(block, wander, jitter).inverse();
        let c = &mut self.covariance;
        let shared: [DMat3; BLOCKS] = std::array::from_fn(|row| c[row][block] + c[row][wander]);
        let gains = shared.map(|shared| shared * weight);
        for row in 0..BLOCKS {
            for column in row..BLOCKS {
                let next = c[row][column] - gains[row] * shared[column].transpose();
                c[row][column] = if row == column { (next + next.transpose()) * 0.5 } else { next };
                c[column][row] = c[row][column].transpose();
            }
        }
        let by = gains.map(|gain| gain * off);
        let Some(state) = &mut self.state else { return };
        let Pose { translation, rotation } = state.tracking_from_body;
        state.tracking_from_body = Pose::new(translation + by[P], DQuat::from_scaled_axis(by[TURN]) * rotation);
        state.velocity_m_per_s += by[V];
        self.gyroscope.correct(&by[GYRO..ACCEL]);
        self.accelerometer.correct(&by[ACCEL..S]);
        self.wander_m += by[S];
        self.wander_rad += by[R];
    }
}

/// The same 1σ on all axes.
fn variance(sigma: f64) -> DMat3 {
    DMat3::from_diagonal(DVec3::splat(sigma * sigma))
}

/// [v]×.
fn skew(v: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0))
}

fn transpose(blocks: &mut Blocks) {
    let from = *blocks;
    *blocks = std::array::from_fn(|row| std::array::from_fn(|column| from[column][row].transpose()));
}

#[cfg(test)]
mod tests {
    use super::super::{GRAVITY_M_PER_S2, ICM_42688};
    use super::*;

    fn resting(time_ns: i64) -> ImuSample {
        ImuSample { time_ns, angular_rate_rad_per_s: DVec3::ZERO, specific_force_m_per_s2: -GRAVITY_M_PER_S2 }
    }

    const STEP_NS: i64 = 2_500_000;

    /// At rest for these samples, with a pose at every fourth.
    fn rested(fusion: &mut PoseFusion, samples: std::ops::Range<i64>, pose: Pose) {
        for n in samples {
            if n % 4 == 0 {
                fusion.push_pose(&PoseSample::valid(n * STEP_NS - 1_000_000, &pose)).unwrap();
            }
            fusion.push_imu(&resting(n * STEP_NS)).unwrap();
        }
    }

    #[test]
    fn covariance_shrinks_with_poses_and_grows_without() {
        let mut fusion = PoseFusion::new(FusionSettings::of(ICM_42688));
        assert!(fusion.pose().is_none());
        rested(&mut fusion, 0..400, Pose::from_translation(DVec3::X));
        let known = fusion.covariances().map(|c| c.to_cols_array()[0].sqrt());
        assert!(known[0] < 1.1e-3 && known[1] < 5e-3 && known[2] < 2e-3, "{known:?}");
        for n in 400..2000 {
            fusion.push_imu(&resting(n * STEP_NS)).unwrap();
        }
        let later = fusion.covariances().map(|c| c.to_cols_array()[0].sqrt());
        assert!(later[0] > 5.0 * known[0] && later[1] > known[1] && later[2] > known[2], "{known:?} {later:?}");
        let off = fusion.pose().unwrap().position_m[0] - 1.0;
        assert!(off.abs() < 3.0 * later[0], "{off} {later:?}");
    }

    #[test]
    fn outlier_is_rejected_and_lasting_jump_restarts_filter() {
        let mut fusion = PoseFusion::new(FusionSettings::of(ICM_42688));
        rested(&mut fusion, 0..400, Pose::IDENTITY);
        fusion.push_pose(&PoseSample::valid(400 * STEP_NS - 1, &Pose::from_translation(DVec3::X))).unwrap();
        fusion.push_imu(&resting(400 * STEP_NS)).unwrap();
        assert_eq!(fusion.counters().contradictions, 1);
        assert!(fusion.pose().unwrap().position_m[0].abs() < 0.01);
        rested(&mut fusion, 404..800, Pose::from_translation(DVec3::X));
        assert_eq!(fusion.counters().restarts, 1);
        assert!((fusion.pose().unwrap().position_m[0] - 1.0).abs() < 0.01);
    }

    #[test]
    fn bad_input_is_refused_with_reason_and_state_unchanged() {
        let mut fusion = PoseFusion::new(FusionSettings::of(ICM_42688));
        let bad = PoseSample { quaternion_xyzw: [0.0; 4], ..PoseSample::valid(0, &Pose::IDENTITY) };
        assert!(matches!(fusion.push_pose(&bad), Err(FusionRefusal::Pose(_))));
        let lost = PoseSample { valid: false, ..PoseSample::valid(0, &Pose::IDENTITY) };
        assert!(matches!(fusion.push_pose(&lost), Err(FusionRefusal::Pose(PoseRefusal::Invalid))));
        rested(&mut fusion, 0..40, Pose::IDENTITY);
        let before = fusion.pose();
        let nan = ImuSample { angular_rate_rad_per_s: DVec3::NAN, ..resting(i64::MAX) };
        assert_eq!(fusion.push_imu(&nan), Err(FusionRefusal::Numbers));
        assert!(matches!(fusion.push_imu(&resting(0)), Err(FusionRefusal::Late { .. })));
        let old = PoseSample::valid(0, &Pose::IDENTITY);
        assert!(matches!(fusion.push_pose(&old), Err(FusionRefusal::Late { .. })));
        assert_eq!(fusion.pose(), before);
        // A short pause is coasted over, a long one restarts, and waiting poses are bounded.
        fusion.push_imu(&resting(40 * STEP_NS + 1_000_000_000)).unwrap();
        assert!(fusion.covariances()[0].x_axis.x > 1.0 && fusion.counters().restarts == 0);
        for n in 0..1000 {
            fusion.push_pose(&PoseSample::valid(i64::MAX / 2 + n, &Pose::IDENTITY)).unwrap();
        }
        assert_eq!(fusion.counters().dropped, 1000 - MAX_WAITING as u64);
        fusion.push_imu(&resting(i64::MAX)).unwrap();
        assert!(fusion.pose().unwrap().tracking_from_head().is_ok());
    }

    #[test]
    fn covariance_stays_symmetric_and_positive() {
        let mut fusion = PoseFusion::new(FusionSettings::of(ICM_42688));
        rested(&mut fusion, 0..8000, Pose::IDENTITY);
        let c = &fusion.covariance;
        for row in 0..BLOCKS {
            for column in 0..BLOCKS {
                assert!((c[row][column] - c[column][row].transpose()).abs_diff_eq(DMat3::ZERO, 1e-12));
            }
            let [a, b, d] = [0, 1, 2].map(|n| c[row][row].col(n)[n]);
            assert!(a > 0.0 && b > 0.0 && d > 0.0, "block {row}: {a} {b} {d}");
        }
    }
}
