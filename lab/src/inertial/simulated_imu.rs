//! Simulated inertial measurement unit on a path, with the errors of a part's figures.
//!
//! A measured triad is (I + M)·true + bias + white noise. M holds scale errors and misalignments.
//! The bias is the sum of a turn-on bias, a first-order Gauss-Markov process with the size of the
//! bias instability, and a random walk. Means over a sample's interval are computed from parts of
//! it.

use glam::{DMat3, DVec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{GRAVITY_M_PER_S2, INSTABILITY_TIME_S, ImuSample, ImuSpec, NavState, TriadSpec};
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_simulation::{TruePath, normal_vector};

/// Parts of a sample's interval. Choice: a chip averages over its interval, which a few points
/// follow at the speeds of an arm.
const INTERVAL_PARTS: usize = 4;
/// Half the interval of the difference quotient for velocities, seconds. Choice: rounding and
/// curvature both stay below 1e-6 m/s for a head's motion.
const VELOCITY_STEP_S: f64 = 1e-4;

/// The true state of the head at a host time.
pub fn true_state(path: &TruePath, time_ns: i64) -> NavState {
    let time_s = (time_ns - path.host_ns(0.0)) as f64 * 1e-9;
    NavState {
        time_ns,
        tracking_from_body: path.tracking_from_head(time_s),
        velocity_m_per_s: velocity_m_per_s(|t| path.tracking_from_head(t).translation, time_s),
    }
}

/// What a unit on the head measures, from before the first sweep until after the last one.
pub fn simulated_imu(path: &TruePath, figures: &ImuSpec) -> Vec<ImuSample> {
    measured(|t| path.tracking_from_head(t), |t| path.host_ns(t), path.span_s(), figures, path.seed())
}

fn velocity_m_per_s(position: impl Fn(f64) -> DVec3, time_s: f64) -> DVec3 {
    (position(time_s + VELOCITY_STEP_S) - position(time_s - VELOCITY_STEP_S)) / (2.0 * VELOCITY_STEP_S)
}

/// Errors of three gyroscopes or three accelerometers over time.
struct Triad {
    figures: TriadSpec,
    matrix: DMat3,
    turn_on: DVec3,
    instability: DVec3,
    walk: DVec3,
}

impl Triad {
    fn new(figures: TriadSpec, rng: &mut ChaCha8Rng) -> Self {
        let TriadSpec { scale, cross, turn_on, instability, .. } = figures;
        let columns = [0, 1, 2].map(|axis: usize| {
            let mut sizes = DVec3::splat(cross);
            sizes[axis] = scale;
            normal_vector(rng) * sizes
        });
        Self {
            figures,
            matrix: DMat3::IDENTITY + DMat3::from_cols_array_2d(&columns.map(|column| column.to_array())),
            turn_on: normal_vector(rng) * turn_on,
            instability: normal_vector(rng) * instability,
            walk: DVec3::ZERO,
        }
    }

    /// Measured value for a true mean over an interval.
    fn measured(&mut self, mean: DVec3, interval_s: f64, rng: &mut ChaCha8Rng) -> DVec3 {
        let TriadSpec { white, instability, walk, .. } = self.figures;
        let keeps = math::exp(-interval_s / INSTABILITY_TIME_S);
        self.instability = self.instability * keeps + normal_vector(rng) * instability * (1.0 - keeps * keeps).sqrt();
        self.walk += normal_vector(rng) * walk * interval_s.sqrt();
        let noise = normal_vector(rng) * white / interval_s.sqrt();
        self.matrix * mean + self.turn_on + self.instability + self.walk + noise
    }
}

fn measured(
    path: impl Fn(f64) -> Pose,
    host_ns: impl Fn(f64) -> i64,
    (first_s, last_s): (f64, f64),
    figures: &ImuSpec,
    seed: u64,
) -> Vec<ImuSample> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x1315_0A11);
    let mut gyroscope = Triad::new(figures.gyroscope, &mut rng);
    let mut accelerometer = Triad::new(figures.accelerometer, &mut rng);
    let interval_s = 1.0 / figures.rate_hz;
    let part_s = interval_s / INTERVAL_PARTS as f64;
    let velocity = |t: f64| velocity_m_per_s(|t| path(t).translation, t);
    let (mut pose, mut speed) = (path(first_s), velocity(first_s));
    let samples = ((last_s - first_s) * figures.rate_hz).floor() as usize;
    let mut sample = |n: usize| {
        let (mut turn, mut gain) = (DVec3::ZERO, DVec3::ZERO);
        for part in 1..=INTERVAL_PARTS {
            let t = first_s + n as f64 * interval_s + part as f64 * part_s;
            let (next, next_speed) = (path(t), velocity(t));
            let turned = pose.rotation.conjugate() * next.rotation;
            turn += (if turned.w < 0.0 { -turned } else { turned }).to_scaled_axis();
            let middle = pose.rotation.slerp(next.rotation, 0.5);
            gain += middle.conjugate() * (next_speed - speed - GRAVITY_M_PER_S2 * part_s);
            (pose, speed) = (next, next_speed);
        }
        ImuSample {
            time_ns: host_ns(first_s + (n + 1) as f64 * interval_s),
            angular_rate_rad_per_s: gyroscope.measured(turn / interval_s, interval_s, &mut rng),
            specific_force_m_per_s2: accelerometer.measured(gain / interval_s, interval_s, &mut rng),
        }
    };
    (0..samples).map(&mut sample).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{FusionSettings, ICM_42688, MPU_6050, PoseFusion, Strapdown};
    use super::*;
    use a121::preset;
    use radar_sar::PoseSample;
    use radar_simulation::{Scenario, TrackingErrors};

    fn scenario(motion: &str, seed: u64) -> Scenario {
        Scenario::new("corner-reflector", motion, preset("fine").unwrap(), 6.0, seed)
    }

    #[test]
    fn perfect_imu_reproduces_every_path() {
        for motion in ["swinging-arm", "sphere-50cm", "natural", "to-and-fro"] {
            let path = scenario(motion, 3).path().unwrap();
            let samples = simulated_imu(&path, &ImuSpec::PERFECT);
            let mut strapdown = Strapdown::new(true_state(&path, samples[0].time_ns));
            for sample in &samples {
                let found = strapdown.push(sample).tracking_from_body;
                let truth = true_state(&path, sample.time_ns).tracking_from_body;
                let off_m = found.translation.distance(truth.translation);
                let off_rad = found.rotation.angle_between(truth.rotation);
                assert!(off_m < 0.5e-3 && off_rad < 1e-4, "{motion}: {off_m} {off_rad}");
            }
        }
    }

    #[test]
    fn allan_deviation_at_rest_matches_the_figures() {
        let still = |_: f64| Pose::IDENTITY;
        let samples = measured(still, |t| (t * 1e9) as i64, (0.0, 1000.0), &MPU_6050, 1);
        let deviation = |cluster: usize| {
            let means: Vec<f64> = samples
                .chunks_exact(cluster)
                .map(|chunk| chunk.iter().map(|s| s.angular_rate_rad_per_s.y).sum::<f64>() / cluster as f64)
                .collect();
            let differences = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2));
            (differences.sum::<f64>() / (2.0 * (means.len() - 1) as f64)).sqrt()
        };
        let white = MPU_6050.gyroscope.white;
        // White noise falls with the square root of time; at long times other errors exceed it.
        assert!((deviation(400) / white - 1.0).abs() < 0.1, "{}", deviation(400) / white);
        assert!((deviation(4) / (10.0 * white) - 1.0).abs() < 0.05);
        assert!(deviation(40_000) > 0.12 * white, "{}", deviation(40_000) / white);
    }

    /// Mean normalised squared error eᵀ P⁻¹ e of position, velocity and attitude over seeds; 3 for
    /// each if the covariance is right.
    fn misfit(errors: TrackingErrors, settings: FusionSettings, lost_s: f64) -> [f64; 3] {
        const SEEDS: u64 = 24;
        let mut sums = [0.0; 3];
        for seed in 1..=SEEDS {
            let scenario = Scenario { errors, ..scenario("sphere-50cm", seed) };
            let path = scenario.path().unwrap();
            let poses = scenario.tracked().unwrap();
            let mut fusion = PoseFusion::new(settings);
            let end_ns = path.host_ns(5.0 + lost_s);
            let mut poses = poses.iter().filter(|pose: &&PoseSample| pose.time_ns < path.host_ns(5.0)).peekable();
            for sample in simulated_imu(&path, &settings.imu).iter().filter(|sample| sample.time_ns <= end_ns) {
                while let Some(pose) = poses.next_if(|pose| pose.time_ns <= sample.time_ns) {
                    fusion.push_pose(pose).unwrap();
                }
                let _ = fusion.push_imu(sample);
            }
            let (found, truth) = (*fusion.state().unwrap(), true_state(&path, fusion.state().unwrap().time_ns));
            let turn = truth.tracking_from_body.rotation * found.tracking_from_body.rotation.conjugate();
            let turn = if turn.w < 0.0 { -turn } else { turn };
            let off = [
                truth.tracking_from_body.translation - found.tracking_from_body.translation,
                truth.velocity_m_per_s - found.velocity_m_per_s,
                turn.to_scaled_axis(),
            ];
            for ((sum, off), covariance) in sums.iter_mut().zip(off).zip(fusion.covariances()) {
                *sum += off.dot(covariance.inverse() * off) / SEEDS as f64;
            }
        }
        sums
    }

    #[test]
    fn fusion_covariance_matches_its_errors() {
        let white = TrackingErrors { wander_m: 0.0, rotation_deg: 0.0, mount_m: 0.0, ..Default::default() };
        let settings =
            FusionSettings { wander_m: 1e-6, wander_rad: 1e-6, jitter_rad: 1e-5, ..FusionSettings::of(ICM_42688) };
        for lost_s in [0.0, 1.0] {
            let misfit = misfit(white, settings, lost_s);
            // The mean of 24 values with three degrees of freedom lies within 3 ± 1.5 in all but
            // one of a thousand cases.
            assert!((1.5..4.5).contains(&misfit[0]) && (1.5..4.5).contains(&misfit[1]), "{lost_s}: {misfit:?}");
            // Rotations have no own noise here, which is less than the filter assumes.
            assert!(misfit[2] < 4.5, "{lost_s}: {misfit:?}");
        }
    }

    #[test]
    fn fusion_is_not_overconfident_with_a_drifting_tracker() {
        let usual = TrackingErrors { mount_m: 0.0, ..Default::default() };
        for (figures, lost_s) in [(ICM_42688, 0.0), (ICM_42688, 1.0), (MPU_6050, 0.5)] {
            let misfit = misfit(usual, FusionSettings::of(figures), lost_s);
            assert!(misfit.iter().all(|misfit| *misfit < 6.0), "{} {lost_s}: {misfit:?}", figures.name);
        }
    }
}
