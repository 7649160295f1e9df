//! What a sub-aperture answers when asked for a plane or a point: its response, where range and
//! beam let it answer at all.

use glam::DVec3;

use super::masks::Mask;
use crate::responses::{CachedResponse, Response};
use radar_sar::Beam;
use radar_sar::geometry::Plane;
use radar_sar::subaperture::{PlaneAt, Subaperture, SubapertureSettings};

/// Beam and ranges of the sensor.
#[derive(Debug, Clone, Copy)]
pub struct SubapertureQuery<'a> {
    settings: &'a SubapertureSettings,
    beam: &'a Beam,
    /// Least cosine to the beam's axis at which a point returns anything.
    min_cos: f64,
    /// Same of a plane.
    plane_min_cos: f64,
}

impl<'a> SubapertureQuery<'a> {
    /// With the least cosines to the boresight of points and of planes, which follow from the others
    /// and take long to find.
    pub fn new(settings: &'a SubapertureSettings, beam: &'a Beam, [min_cos, plane_min_cos]: [f64; 2]) -> Self {
        Self { settings, beam, min_cos, plane_min_cos }
    }

    #[cfg(test)]
    pub fn of(settings: &'a SubapertureSettings, beam: &'a Beam) -> Self {
        Self::new(settings, beam, [settings.min_cos(beam), settings.plane_min_cos(beam)])
    }

    /// Time constant with which old sub-apertures lose weight, seconds.
    pub fn decay_s(&self) -> f64 {
        self.settings.decay_s
    }

    /// `None` for a sub-aperture that has the plane out of range, or so far off the beam's axis
    /// that not even a mirror returns anything.
    pub fn plane(&self, subapertures: &[&Subaperture], plane: &Plane) -> Vec<Option<Response>> {
        let response = |one: &&Subaperture| {
            let range_m = plane.distance(one.middle.translation);
            let axis = &one.geometry().axis;
            let in_range = range_m >= self.settings.min_range_m && axis.contains(range_m);
            if !in_range || plane.outward.dot(one.middle.forward()) < self.plane_min_cos {
                return None;
            }
            let toward = plane.outward.as_vec3().to_array();
            let coherence = one.uncancelled().coherence_of_planes(&[PlaneAt { toward, distance_m: range_m as f32 }])[0];
            Some(Response::new((&one.middle, one.motion), coherence, range_m, plane.outward, self.beam))
        };
        subapertures.iter().map(response).collect()
    }

    /// Responses of one sub-aperture to points; masked points count as not queried.
    pub fn points(&self, one: &Subaperture, masks: &[Mask], places: &[DVec3]) -> Vec<CachedResponse> {
        let settings = self.settings.within(&one.geometry().axis);
        let origin = one.middle.translation;
        let mut cached = vec![Some(None); places.len()];
        let (mut seen, mut relative) = (Vec::new(), Vec::new());
        for (n, &place) in places.iter().enumerate() {
            if !settings.sees(&one.middle, self.min_cos, place) {
                continue;
            }
            let (range_m, toward, cos) = range_and_direction(one, place);
            if masks.iter().any(|mask| mask.covers(range_m, cos)) {
                cached[n] = None;
                continue;
            }
            seen.push((n, range_m, toward));
            relative.push((place - origin).as_vec3().to_array());
        }
        for ((n, range_m, toward), coherence) in seen.into_iter().zip(one.coherence_at_points(&relative)) {
            cached[n] = Some(Some(Response::new((&one.middle, one.motion), coherence, range_m, toward, self.beam)));
        }
        cached
    }
}

/// Range of a point, the direction towards it, and the cosine of that direction to the sensor's
/// motion.
fn range_and_direction(one: &Subaperture, place: DVec3) -> (f64, DVec3, f64) {
    let range_m = one.distance_m(place);
    let toward = (place - one.middle.translation) / range_m.max(1e-9);
    (range_m, toward, toward.dot(one.motion))
}
