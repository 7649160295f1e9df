//! What the sensor illuminates, and how strongly it returns: the upper bound of what a reconstruction can find.

use glam::DVec3;

use super::super::echoes::EchoPath;
use super::super::truth_builder::{IN_BEAM_AMPLITUDE, IN_BEAM_M};
use super::physical::PhysicalRoom;
use super::{Scatterer, Session};
use a121::{Subsweep, snr_db};
use radar_sar::geometry::Pose;
use radar_sar::math;

impl Session {
    /// Whether a point is in the beam, by amplitude and distance.
    pub fn is_in_beam(&self, tracking_from_sensor: &Pose, point: DVec3) -> bool {
        let to = point - tracking_from_sensor.translation;
        let cos = to.normalize_or_zero().dot(tracking_from_sensor.forward());
        to.length() <= IN_BEAM_M && self.play.beam.amplitude(cos) >= IN_BEAM_AMPLITUDE
    }

    /// Whether a point is in the beam with a line of sight to the sensor.
    pub fn is_seen(&self, time_s: f64, point: DVec3) -> bool {
        self.sees(&self.sensor_at(time_s), time_s, point)
    }

    /// Whether a part of an object is seen. `object` is its index in [`Self::things`]. Of an object that was carried
    /// away: no.
    pub fn is_illuminated(&self, object: usize, time_s: f64) -> bool {
        let sensor = self.sensor_at(time_s);
        let mut parts = self.things[object].scatterers.iter();
        !self.is_gone(object, time_s) && parts.any(|part| self.sees(&sensor, time_s, part.position_m))
    }

    fn sees(&self, tracking_from_sensor: &Pose, time_s: f64, point: DVec3) -> bool {
        let room_from_tracking = self.tracking_from_room.inverse();
        let [from_m, to_m] = [tracking_from_sensor.translation, point].map(|p| room_from_tracking.transform_point(p));
        let is_free = |room: &PhysicalRoom| room.has_line_of_sight(time_s >= self.removed_s, from_m, to_m);
        self.is_in_beam(tracking_from_sensor, point) && self.physical.as_ref().is_none_or(is_free)
    }

    /// Power SNR of an object's direct echoes in one sweep, dB: at the range at which they are strongest, with what is
    /// in between taken into account. Echoes of its parts within a pulse's length add by power. −∞ without any. `object`
    /// is its index in [`Self::things`].
    pub fn echo_snr_db(&self, object: usize, time_s: f64) -> f64 {
        let mut subsweeps = self.play.config.subsweeps.iter().enumerate();
        let hears = subsweeps.find(|(index, _)| self.sensor.hears_echoes(*index));
        let Some((_, subsweep)) = hears.filter(|_| !self.is_gone(object, time_s)) else { return f64::NEG_INFINITY };
        let power = match &self.physical {
            None => self.strongest_part(object, &self.sensor_at(time_s)),
            Some(room) => {
                let sensor = self.sensor_in_room(time_s);
                let movers = self.movers([time_s; 3]);
                let removed = time_s >= self.removed_s;
                let paths = room.direct_paths(object, removed, &sensor, &self.play.beam, self.path_limits(), &movers);
                strongest_power(&paths, subsweep)
            }
        };
        snr_db(subsweep.profile, subsweep.hwaas, 0.0, 1.0) + self.play.beam.gain_db() + 10.0 * math::log10(power)
    }

    fn is_gone(&self, object: usize, time_s: f64) -> bool {
        Some(object) == self.removed && time_s >= self.removed_s
    }

    /// Power of the strongest part, relative to 0 dBsm at 1 m on the axis.
    fn strongest_part(&self, object: usize, sensor: &Pose) -> f64 {
        let power = |part: &Scatterer| {
            let to: DVec3 = part.position_m - sensor.translation;
            let direction = to.normalize_or_zero();
            let amplitude = self.play.beam.amplitude(direction.dot(sensor.forward()));
            let sigma_m2 = math::powf(10.0, 0.1 * part.rcs_towards_dbsm(-direction));
            sigma_m2 * (amplitude / to.length_squared()).powi(2)
        };
        self.things[object].scatterers.iter().map(power).fold(0.0, f64::max)
    }
}

/// Greatest power of the echoes within a pulse's length, at the ranges that a subsweep measures.
fn strongest_power(paths: &[EchoPath], subsweep: &Subsweep) -> f64 {
    let measured = subsweep.first_m()..=subsweep.last_m();
    let half_m = 0.5 * subsweep.profile.envelope_fwhm_m();
    let about = |center: &EchoPath| -> f64 {
        let near = paths.iter().filter(|path| (path.range_m[1] - center.range_m[1]).abs() <= half_m);
        near.map(|path| path.amplitude.powi(2)).sum()
    };
    paths.iter().filter(|path| measured.contains(&path.range_m[1])).map(about).fold(0.0, f64::max)
}
