//! Mirror ambiguity: sweeps from within a plane measure the same ranges to points on both of its
//! sides.
//!
//! Three sweeps always lie in a plane, and a head that rotates about its neck nearly does. Each
//! position then has a mirror image, and only the beam can distinguish them. Where neither the beam
//! nor sweeps outside the plane do, the better fitting position is kept, its covariance extends to
//! the other one, and the direction between them counts as unobserved.

use glam::{DMat3, DVec3};

use super::{OBSERVED_SHARE, PointEstimate, Prior, Refined, climb, longest_axis, objective, scatter, trace};
use crate::range_power::RangePower;
use crate::symmetric::outer;

/// Log-likelihood by which a position must fit better than its mirror image to be unambiguous.
/// Choice: odds of a thousand to one.
const MIN_LOG_LIKELIHOOD_GAIN: f64 = 6.9;
/// Least share of the position's log-likelihood that the image needs before it is optimised. The
/// true position starts near its maximum. Choice: an image that begins lower does not catch up, and
/// optimising costs as much as the position itself.
const MIN_IMAGE_SHARE: f64 = 0.3;
/// Greatest distance of the image's maximum from the image, in distances between the two. Choice:
/// farther on, the climb would return to the position itself.
const MAX_IMAGE_SHIFT: f64 = 0.25;

/// The maximum near the mirror image, if it is a distinct position and fits about as well.
pub(super) fn equally_likely_image(power: &RangePower, weighed: &PointEstimate, prior: &Prior) -> Option<DVec3> {
    let normal = plane_normal(&scatter(power, &weighed.readings, prior.seen_from))?;
    let apart_m = 2.0 * (weighed.place - prior.seen_from).dot(normal);
    let distance_m = weighed.place.distance(prior.seen_from);
    // A position next to the plane is close to its image, which the covariance covers already.
    if apart_m.abs() < 2.0 * OBSERVED_SHARE * distance_m {
        return None;
    }
    let image = weighed.place - normal * apart_m;
    let best = objective(&weighed.readings, prior, weighed.place);
    if objective(&power.readings(image), prior, image) < MIN_IMAGE_SHARE * best {
        return None;
    }
    let other = climb(power, image, Some(MAX_IMAGE_SHIFT * apart_m.abs()), prior);
    let readings = power.readings(other);
    let enough = readings.len() >= weighed.readings.len().min(super::MIN_SWEEPS);
    (enough && objective(&readings, prior, other) > best - MIN_LOG_LIKELIHOOD_GAIN).then_some(other)
}

/// Widens the uncertainty of a position to include `other`.
pub(super) fn with_image(refined: Refined, other: DVec3) -> Refined {
    let apart = other - refined.position_m;
    Refined {
        // Each of the two with weight one half: the second moment about this one.
        covariance_m2: refined.covariance_m2 + outer(apart) * 0.5,
        cross_range_sigma_m: [
            refined.cross_range_sigma_m[0].max(apart.length() * 0.5f64.sqrt()),
            refined.cross_range_sigma_m[1],
        ],
        ..refined
    }
}

/// The axis of least scatter; `None` when the sweeps lie on a line, whose circle is handled
/// elsewhere.
fn plane_normal(scatter: &DMat3) -> Option<DVec3> {
    let first = longest_axis(scatter);
    let rest = *scatter - outer(first) * first.dot(*scatter * first);
    let second = longest_axis(&rest).reject_from_normalized(first).normalize_or_zero();
    let wide = second.dot(*scatter * second) > 1e-6 * trace(scatter);
    wide.then(|| first.cross(second).normalize_or_zero()).filter(|normal| *normal != DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Beam;
    use crate::PositionErrors;
    use crate::refine::refine;
    use crate::test_data::{Echo, sweeps};

    /// Sweeps from the plane of the line of sight and an axis across it, or displaced from it.
    fn refined(at: DVec3, count: usize, out_of_plane_m: f64, start: DVec3) -> Refined {
        let path = |t: f64| DVec3::new(0.25 * (4.0 * t).sin(), out_of_plane_m * (7.0 * t).sin(), 0.2 * (5.5 * t).cos());
        let all = sweeps(1.5, path, &[(Echo::Point(at), 30.0)], 3);
        let some: Vec<_> = all.iter().step_by(all.len() / count).take(count).cloned().collect();
        let power = RangePower::new(&some, &Beam::Lensless, 0.15);
        refine(&power, start, None, &PositionErrors::default()).unwrap()
    }

    const AT: DVec3 = DVec3::new(0.1, 0.2, -1.2);
    const IMAGE: DVec3 = DVec3::new(0.1, -0.2, -1.2);

    #[test]
    fn coplanar_sweeps_leave_two_positions() {
        for (count, start) in [(3, AT), (3, IMAGE), (40, AT), (40, IMAGE)] {
            let one = refined(AT, count, 0.0, start);
            assert_eq!(one.observed_directions(), 1, "{count} sweeps from {start}: {one:?}");
            let off = AT - one.position_m;
            let normalised = off.dot(one.covariance_m2.inverse() * off);
            assert!(
                normalised < 9.0,
                "{count} sweeps from {start}: the truth is {normalised} squared deviations off {one:?}"
            );
        }
    }

    #[test]
    fn sweeps_out_of_the_plane_resolve_the_ambiguity() {
        let one = refined(AT, 40, 0.2, AT);
        assert!(one.observed_directions() == 2 && one.position_m.distance(AT) < 0.01, "{one:?}");
    }

    #[test]
    fn point_in_the_plane_is_unambiguous() {
        let at = DVec3::new(0.1, 0.0, -1.2);
        let one = refined(at, 40, 0.0, at);
        assert!(one.position_m.distance(at) < 0.1, "{one:?}");
    }
}
