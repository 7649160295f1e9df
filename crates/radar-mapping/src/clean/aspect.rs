//! Aspect of a point: averages over its significant responses.
//!
//! Of all points on a range circle the one near the middle of the beam is the likeliest. An object
//! that was seen from several sides is surer than one from a single side. Artefacts lie towards the
//! beam's edge, near the sensor, and are stronger than the objects that they are taken for.

use glam::DVec3;

use super::super::responses::Response;

use radar_sar::math;

/// Means over the significant responses of a point; zeros when there are none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Aspect {
    /// Distance from the sensor, metres.
    pub range_m: f64,
    /// Amplitude of the beam towards it, two-way, 1 on the axis.
    pub beam: f64,
    /// Logarithm of the power that it reflects at 1 m on the axis, relative to noise.
    pub ln_strength: f64,
    /// Spread of the directions to it: 0 when all are the same, 1 when they cancel.
    pub spread: f64,
    /// Logarithm of m, the coherent power relative to noise and clutter.
    pub ln_coherence: f64,
    /// 1σ of its height, metres.
    pub sigma_up_m: f64,
}

impl Aspect {
    /// Of significant responses.
    pub(super) fn of<'v>(responses: impl Iterator<Item = &'v Response>, sigma_up_m: f64) -> Self {
        let (mut sums, mut toward, mut count) = ([0.0; 4], DVec3::ZERO, 0.0);
        for response in responses {
            let beam = response.gain.sqrt() * response.range_m.max(0.1).powi(2);
            let values = [response.range_m, beam, response.ln_strength.unwrap_or(0.0), math::ln(response.m.max(0.1))];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
            toward += response.toward;
            count += 1.0;
        }
        if count == 0.0 {
            return Self { sigma_up_m, ..Self::default() };
        }
        let [range_m, beam, ln_strength, ln_coherence] = sums.map(|sum| sum / count);
        Self { range_m, beam, ln_strength, spread: 1.0 - toward.length() / count, ln_coherence, sigma_up_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radar_sar::Beam;
    use radar_sar::geometry::Pose;
    use radar_sar::subaperture::Coherence;

    fn response(toward: DVec3, range_m: f64, m: f32) -> Response {
        let toward = toward.normalize();
        let coherence = Coherence { m, power: 2.0 * m };
        Response::new((&Pose::IDENTITY, DVec3::X), coherence, range_m, toward, &Beam::Lensless)
    }

    #[test]
    fn aspect_of_one_response_equals_it() {
        let ahead = Aspect::of([response(DVec3::NEG_Z, 2.0, 5.0)].iter(), 0.1);
        let expected = [2.0, 1.0, (10.0f64 * 16.0).ln(), 0.0, 5f64.ln(), 0.1];
        let is = [ahead.range_m, ahead.beam, ahead.ln_strength, ahead.spread, ahead.ln_coherence, ahead.sigma_up_m];
        assert!(is.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{is:?} {expected:?}");
    }

    #[test]
    fn off_axis_beam_is_weaker_and_two_directions_spread() {
        let aside = response(DVec3::new(0.5, 0.0, -0.866), 1.0, 5.0);
        let both = Aspect::of([aside, response(DVec3::new(-0.5, 0.0, -0.866), 1.0, 5.0)].iter(), 0.0);
        assert!((0.4..0.6).contains(&both.beam), "{both:?}");
        assert!((both.spread - (1.0 - 0.866)).abs() < 1e-3, "{both:?}");
    }

    #[test]
    fn aspect_of_no_response_is_default() {
        assert_eq!(Aspect::of([].iter(), 0.0), Aspect::default());
    }
}
