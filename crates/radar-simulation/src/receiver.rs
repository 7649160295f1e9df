//! The sum of the echoes of all scatterers and walls, in each point at its own sampling time.

use glam::DVec3;
use num_complex::Complex64;

use super::{Room, Scatterer};
use a121::{Subsweep, noise_rms_lsb, snr_db};
use radar_sar::geometry::Pose;
use radar_sar::math;
use radar_sar::{Beam, CARRIER_HZ, RangeAxis, SPEED_OF_LIGHT_M_PER_S};

/// Echoes below this fraction of the noise are omitted (−40 dB). Choice: a hundred such echoes in
/// phase would still be no more than the noise.
const MIN_ECHO_TO_NOISE: f64 = 0.01;

/// A subsweep's receiver in a room.
pub(super) struct Receiver<'a> {
    pub room: &'a Room,
    /// Scatterers that move during the sweep.
    pub moving: &'a [MovingScatterer],
    pub subsweep: &'a Subsweep,
    pub beam: &'a Beam,
    /// Offset added to every radar cross-section, dB.
    pub rcs_offset_db: f64,
    /// Measured range minus true range, metres.
    pub range_bias_m: f64,
}

/// A moving scatterer: its state in the middle of a sweep, and its displacement during the sweep.
#[derive(Debug, Clone, Copy)]
pub(super) struct MovingScatterer {
    pub scatterer: Scatterer,
    /// Displacement from the time of the first point to that of the last one, metres.
    pub way: DVec3,
}

/// An echo at the middle of a sweep.
struct Echo {
    /// Source of the echo.
    source: Source,
    /// Amplitude at the envelope's peak, LSB.
    amplitude: f64,
    phase_rad: f64,
    mid_distance_m: f64,
}

enum Source {
    Point(DVec3),
    /// Position in the middle of the sweep and displacement during it, metres.
    Moving(DVec3, DVec3),
    Wall(usize),
}

impl Receiver<'_> {
    fn amplitude_lsb(&self, rcs_dbsm: f64, distance_m: f64, cos_off_boresight: f64) -> f64 {
        let snr = snr_db(self.subsweep.profile, self.subsweep.hwaas, rcs_dbsm + self.rcs_offset_db, distance_m)
            + self.beam.gain_db();
        noise_rms_lsb(self.subsweep) * math::powf(10f64, snr / 20.0) * self.beam.amplitude(cos_off_boresight)
    }

    fn echoes(&self, sensor: &Pose) -> Vec<Echo> {
        let mut echoes = Vec::new();
        let floor = MIN_ECHO_TO_NOISE * noise_rms_lsb(self.subsweep);
        let still = self.room.scatterers().map(|scatterer| (scatterer, Source::Point(scatterer.position_m)));
        let moving = self.moving.iter().map(|p| (&p.scatterer, Source::Moving(p.scatterer.position_m, p.way)));
        for (scatterer, source) in still.chain(moving) {
            let to = scatterer.position_m - sensor.translation;
            let distance_m = to.length();
            if distance_m < 1e-3 {
                continue;
            }
            let direction = to / distance_m;
            let rcs = scatterer.rcs_towards_dbsm(-direction);
            let amplitude = self.amplitude_lsb(rcs, distance_m, direction.dot(sensor.forward()));
            if amplitude > floor {
                echoes.push(Echo { source, amplitude, phase_rad: scatterer.phase_rad, mid_distance_m: distance_m });
            }
        }
        for (index, wall) in self.room.walls.iter().enumerate() {
            let distance_m = wall.plane.distance(sensor.translation);
            if distance_m < 1e-3 || wall.extent.distance(wall.plane.foot(sensor.translation)) > 1e-6 {
                continue;
            }
            let cos = wall.plane.outward.dot(sensor.forward());
            let amplitude = self.amplitude_lsb(wall.equivalent_rcs_dbsm(distance_m), distance_m, cos);
            if amplitude > floor {
                let source = Source::Wall(index);
                echoes.push(Echo { source, amplitude, phase_rad: 0.0, mid_distance_m: distance_m });
            }
        }
        echoes
    }

    /// Distance from a sensor position to the source of an echo, metres, at a share of the sweep.
    fn distance_m(&self, echo: &Echo, position: DVec3, share: f64) -> f64 {
        match echo.source {
            Source::Point(at) => at.distance(position),
            Source::Moving(middle, way) => (middle + way * (share - 0.5)).distance(position),
            Source::Wall(wall) => self.room.walls[wall].plane.distance(position),
        }
    }

    /// The echoes in each point of one sweep, LSB; `sensor_at` gives the pose at a time after the
    /// sweep's first point, seconds.
    pub fn sweep(&self, sensor_at: impl Fn(f64) -> Pose, point_period_s: f64) -> Vec<Complex64> {
        let axis = range_axis(self.subsweep);
        let last = axis.points.saturating_sub(1) as f64;
        let (start, end) = (sensor_at(0.0), sensor_at(last * point_period_s));
        let middle = sensor_at(0.5 * last * point_period_s);
        let mut signal = vec![Complex64::ZERO; axis.points];
        let width_m = self.subsweep.profile.envelope_fwhm_m();
        for echo in self.echoes(&middle) {
            // Beyond 1.6 widths the pulse is 60 dB down; 2 cm allow for motion during a sweep.
            let reach_m = 1.6 * width_m + 0.02;
            let mid_m = echo.mid_distance_m + self.range_bias_m;
            let first = axis.point_at(mid_m - reach_m).ceil().max(0.0) as usize;
            let beyond = (axis.point_at(mid_m + reach_m).floor() + 1.0).clamp(0.0, axis.points as f64);
            for (n, sample) in signal.iter_mut().enumerate().take(beyond as usize).skip(first) {
                // During a sweep (≤ 6 ms) the path is straight.
                let share = if last > 0.0 { n as f64 / last } else { 0.0 };
                let position = start.translation.lerp(end.translation, share);
                let distance_m = self.distance_m(&echo, position, share) + self.range_bias_m;
                let off = (axis.range_m(n) - distance_m) / width_m;
                let amplitude = echo.amplitude * math::powf(0.5f64, 4.0 * off * off);
                let turns = 2.0 * distance_m * CARRIER_HZ / SPEED_OF_LIGHT_M_PER_S;
                *sample += math::from_polar(amplitude, std::f64::consts::TAU * turns.fract() + echo.phase_rad);
            }
        }
        signal
    }
}

fn range_axis(subsweep: &Subsweep) -> RangeAxis {
    RangeAxis { first_m: subsweep.first_m(), step_m: subsweep.step_m(), points: subsweep.num_points as usize }
}

#[cfg(test)]
mod tests {
    use super::super::{Scatterer, SceneObject};
    use super::*;
    use a121::Profile;
    use radar_sar::WAVELENGTH_M;

    fn room(rcs_dbsm: f64, z: f64) -> Room {
        let scatterer = Scatterer { position_m: DVec3::new(0.0, 0.0, -z), rcs_dbsm, lobe: DVec3::ZERO, phase_rad: 0.0 };
        Room { things: vec![SceneObject { name: "point".into(), scatterers: vec![scatterer] }], walls: Vec::new() }
    }

    fn subsweep() -> Subsweep {
        Subsweep { num_points: 300, step_length: 4, hwaas: 16, ..Default::default() }
    }

    fn receiver<'a>(room: &'a Room, moving: &'a [MovingScatterer], subsweep: &'a Subsweep) -> Receiver<'a> {
        Receiver { room, moving, subsweep, beam: &Beam::Uniform, rcs_offset_db: 0.0, range_bias_m: 0.0 }
    }

    #[test]
    fn echo_has_expected_range_strength_and_phase() {
        let axis = range_axis(&subsweep());
        let range = axis.range_m(100);
        let samples = receiver(&room(0.0, range), &[], &subsweep()).sweep(|_| Pose::IDENTITY, 1e-5);
        let peak = samples.iter().map(|s| s.norm()).fold(0.0, f64::max);
        assert!((samples[100].norm() - peak).abs() < 1e-6 * peak);
        let snr = 20.0 * (peak / noise_rms_lsb(&subsweep())).log10();
        assert!((snr - snr_db(Profile::P3, 16, 0.0, range)).abs() < 0.01);
        let phase = samples[100].arg();
        let turns = range / (WAVELENGTH_M / 2.0);
        let expected = std::f64::consts::TAU * turns.fract();
        let difference = (phase - expected).rem_euclid(std::f64::consts::TAU);
        assert!(difference.min(std::f64::consts::TAU - difference) < 0.01, "{phase} {expected}");
    }

    #[test]
    fn moving_scatterer_shifts_phase_within_a_sweep() {
        // 1 cm away from the sensor during the sweep, i.e. four periods of the phase over 300
        // points.
        let at = DVec3::new(0.0, 0.0, -0.6);
        let scatterer = Scatterer { position_m: at, rcs_dbsm: 0.0, lobe: DVec3::ZERO, phase_rad: 0.0 };
        let (subsweep, empty) = (subsweep(), Room::default());
        let sweep_of = |way: DVec3| {
            let moving = [MovingScatterer { scatterer, way }];
            let samples = receiver(&empty, &moving, &subsweep).sweep(|_| Pose::IDENTITY, 1e-5);
            samples.iter().map(|s| s.arg()).collect::<Vec<_>>()
        };
        let middle = range_axis(&subsweep).point_at(0.6).round() as usize;
        let turned = |way: DVec3, n: usize| {
            let (still, moved) = (sweep_of(DVec3::ZERO)[n], sweep_of(way)[n]);
            (moved - still + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
        };
        let way = DVec3::NEG_Z * 0.01;
        let shares = [middle, middle + 20].map(|n| n as f64 / 299.0 - 0.5);
        let expected = (shares[1] - shares[0]) * 0.01 * 2.0 / WAVELENGTH_M * std::f64::consts::TAU;
        let found = turned(way, middle + 20) - turned(way, middle);
        assert!((found - expected).abs() < 0.02, "{found} {expected}");
    }

    #[test]
    fn range_bias_moves_an_echo() {
        let (room, subsweep) = (room(0.0, 0.7), subsweep());
        let peak = |range_bias_m: f64| {
            let biased = Receiver { range_bias_m, ..receiver(&room, &[], &subsweep) };
            let samples = biased.sweep(|_| Pose::IDENTITY, 1e-5);
            (0..300).max_by(|a, b| samples[*a].norm().total_cmp(&samples[*b].norm())).unwrap()
        };
        assert_eq!(peak(-3.0 * subsweep.step_m()) + 3, peak(0.0));
    }
}
