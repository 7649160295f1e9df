//! Smooth borders: where a reflecting or shadowing surface ends, its effect fades over the first
//! Fresnel zone.

use radar_sar::WAVELENGTH_M;

use crate::smooth::smoothstep;

/// Largest Fresnel radius of a path, metres: 8 m long, crossed in the middle. Longer ones are taken as this long. Physics.
pub(super) const MAX_FRESNEL_M: f64 = 0.1;

/// Radius of the first Fresnel zone, metres, at distances from both ends of a path: √(λ d₁ d₂ / (d₁ +
/// d₂)). Source: ITU-R P.526.
pub(super) fn fresnel_radius_m(d1_m: f64, d2_m: f64) -> f64 {
    (WAVELENGTH_M * d1_m * d2_m / (d1_m + d2_m)).max(0.0).sqrt().min(MAX_FRESNEL_M)
}

/// Share of the field that an interval of half-width `half_m` reflects or intercepts where the ray
/// passes `off_m` from its middle: 1 well inside, ½ on the border, 0 beyond one Fresnel radius.
///
/// It is the interval's indicator smoothed by a kernel of one Fresnel radius to either side. For
/// intervals much narrower than that it becomes 1.9 times the half-width over the radius; the
/// physical optics of a small plate, σ = 4π A²/λ², gives 2. The Fresnel integral's ripple and its
/// slow decay are left out: a panel's edges return echoes of their own.
pub(super) fn interval_share(off_m: f64, half_m: f64, radius_m: f64) -> f64 {
    if off_m.abs() >= half_m + radius_m {
        return 0.0;
    }
    if off_m.abs() + radius_m <= half_m {
        return 1.0;
    }
    step((half_m - off_m) / radius_m) - step((-half_m - off_m) / radius_m)
}

/// From 0 at −1 to 1 at +1.
fn step(x: f64) -> f64 {
    smoothstep(0.5 * (x + 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_is_one_inside_half_on_the_border_and_zero_outside() {
        let share = |off_m: f64| interval_share(off_m, 0.5, 0.05);
        assert_eq!((share(0.0), share(0.44), share(0.56), share(-0.56)), (1.0, 1.0, 0.0, 0.0));
        assert!((share(0.5) - 0.5).abs() < 1e-12 && (share(-0.5) - 0.5).abs() < 1e-12);
        let largest = (0..1200)
            .map(|n| f64::from(n) * 1e-3 - 0.6)
            .map(|x| (share(x + 1e-3) - share(x)).abs())
            .fold(0.0, f64::max);
        assert!(largest < 0.02, "{largest}");
    }

    #[test]
    fn small_plate_has_the_cross_section_of_physical_optics() {
        // Plate of 1 cm at 1 m: σ = 4π A²/λ², against a mirror's π d² times the shares' square.
        let (half_m, d_m) = (0.005, 1.0);
        let share = interval_share(0.0, half_m, fresnel_radius_m(d_m, d_m));
        let ours = std::f64::consts::PI * d_m * d_m * share.powi(4);
        let plate = 4.0 * std::f64::consts::PI * (4.0 * half_m * half_m / WAVELENGTH_M).powi(2);
        assert!((10.0 * (ours / plate).log10()).abs() < 1.3, "{ours} {plate}");
    }

    #[test]
    fn neighbouring_intervals_add_up_to_a_whole_one() {
        let sum = interval_share(0.3, 0.3, 0.07) + interval_share(-0.3, 0.3, 0.07);
        assert!((sum - 1.0).abs() < 1e-12);
    }
}
