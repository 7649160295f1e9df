//! Peaks of the spectrum, extracted in order of their excess over the threshold. Each is
//! interpolated between its neighbours; then its own possible contribution everywhere is subtracted
//! from the excess.
//!
//! Over range, the contribution is a triangle of two pulse widths at either side. Over speed the
//! description is silent; a tone without a window function has side lobes below 1 / (N sin(πx/N))
//! at x bins from it, so this bound is used.

use std::f64::consts::PI;

use num_complex::Complex64;

use super::RangeVelocity;
use super::threshold::Thresholds;
use a121::Profile;
use radar_sar::math;

/// Limit of the peaks per window. Choice: more objects than scenes hold; bounds the work on noise.
const MAX_REFLECTIONS: usize = 10;
/// Peaks closer than this in range, metres, and speed, m/s, are merged (source: the vendor's
/// description).
const MERGE_M: f64 = 0.05;
const MERGE_M_PER_S: f64 = 0.05;

/// A reflection found in a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflection {
    /// Distance, metres.
    pub distance_m: f64,
    /// Radial velocity, m/s; positive when the distance grows.
    pub velocity_m_per_s: f64,
    /// Magnitude of the spectrum at the peak, LSB times sweeps.
    pub magnitude: f64,
}

/// All peaks, by falling excess.
pub(super) fn peaks(spectrum: &RangeVelocity, thresholds: &Thresholds, profile: Profile) -> Vec<Reflection> {
    let (bins, ranges) = (spectrum.bins.len(), spectrum.axis.points);
    let magnitude = |(bin, range): (usize, usize)| math::norm(spectrum.bins[bin][range]);
    let cells: Vec<(usize, usize)> = (0..bins).flat_map(|bin| (0..ranges).map(move |range| (bin, range))).collect();
    let mut excess: Vec<f64> = cells.iter().map(|&at| magnitude(at) - thresholds.at(at.0, at.1)).collect();
    let mut found = Vec::new();
    while found.len() < MAX_REFLECTIONS {
        let Some(best) = (0..cells.len()).max_by(|&a, &b| excess[a].total_cmp(&excess[b])) else { break };
        // Also stops at NaN.
        if excess[best].total_cmp(&0.0).is_le() || !excess[best].is_finite() {
            break;
        }
        let (bin, range) = cells[best];
        let fine_range = range as f64
            + parabola(
                &[-1, 0, 1]
                    .map(|step| range.checked_add_signed(step).filter(|&n| n < ranges).map(|n| magnitude((bin, n)))),
            );
        let fine_bin = bin as f64 + quinn(&[bins - 1, 0, 1].map(|step| spectrum.bins[(bin + step) % bins][range]));
        found.push(Reflection {
            distance_m: spectrum.axis.first_m + fine_range * spectrum.axis.step_m,
            velocity_m_per_s: spectrum.velocity_m_per_s(fine_bin),
            magnitude: magnitude((bin, range)),
        });
        // Magnitude of the tone at its own speed, between the bins.
        let whole = magnitude((bin, range)) / side_lobe(bin as f64 - fine_bin, bins).max(0.5);
        let reach = 2.0 * profile.envelope_fwhm_m() / spectrum.axis.step_m;
        for (&(b, n), excess) in cells.iter().zip(&mut excess) {
            let triangle = 1.0 - (n as f64 - fine_range).abs() / reach;
            if triangle > 0.0 {
                *excess -= whole * triangle * bound(b as f64 - fine_bin, bins);
            }
        }
        excess[best] = f64::NEG_INFINITY;
    }
    found
}

/// Magnitude of a tone at `off` bins from it, relative to its peak.
fn side_lobe(off: f64, bins: usize) -> f64 {
    let count = bins as f64;
    let below = count * math::sin(PI * off / count);
    if below.abs() < 1e-9 { 1.0 } else { (math::sin(PI * off) / below).abs() }
}

/// Upper bound of [`side_lobe`].
fn bound(off: f64, bins: usize) -> f64 {
    let count = bins as f64;
    (1.0 / (count * math::sin(PI * off / count)).abs()).min(1.0)
}

/// Offset of the vertex of the parabola through three magnitudes from the middle one, in steps; 0
/// at an edge.
fn parabola(three: &[Option<f64>; 3]) -> f64 {
    let &[Some(before), Some(at), Some(after)] = three else { return 0.0 };
    let curvature = before - 2.0 * at + after;
    if curvature < 0.0 { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Offset of a tone's frequency from the middle of three bins, in bins: Quinn's second estimator
/// (1997).
fn quinn(three: &[Complex64; 3]) -> f64 {
    let [before, at, after] = three;
    let ratio = |side: &Complex64| (side / at).re;
    let (low, high) = (ratio(before) / (1.0 - ratio(before)), -ratio(after) / (1.0 - ratio(after)));
    let root = (2.0f64 / 3.0).sqrt();
    let tau = |x: f64| {
        0.25 * math::ln(3.0 * x * x + 6.0 * x + 1.0)
            - 6f64.sqrt() / 24.0 * math::ln((x + 1.0 - root) / (x + 1.0 + root))
    };
    let off = 0.5 * (low + high) + tau(low * low) - tau(high * high);
    if off.is_finite() { off.clamp(-1.0, 1.0) } else { 0.0 }
}

/// Merges peaks that are close in range and speed; the stronger one stays.
pub(super) fn merged(peaks: Vec<Reflection>) -> Vec<Reflection> {
    let mut kept: Vec<Reflection> = Vec::new();
    for peak in peaks {
        let near = |other: &Reflection| {
            let (d, v) = (peak.distance_m - other.distance_m, peak.velocity_m_per_s - other.velocity_m_per_s);
            (d / MERGE_M).powi(2) + (v / MERGE_M_PER_S).powi(2) < 1.0
        };
        match kept.iter_mut().find(|other| near(other)) {
            Some(other) if other.magnitude < peak.magnitude => *other = peak,
            Some(_) => {}
            None => kept.push(peak),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_between_bins_is_interpolated() {
        for off in [-0.45, -0.2, 0.0, 0.3, 0.49] {
            let tone = |sweep: usize| Complex64::from_polar(1.0, 2.0 * PI * (5.0 + off) * sweep as f64 / 16.0);
            let bin = |k: usize| -> Complex64 {
                (0..16).map(|m| tone(m) * Complex64::from_polar(1.0, -2.0 * PI * (k * m) as f64 / 16.0)).sum()
            };
            let found = quinn(&[bin(4), bin(5), bin(6)]);
            assert!((found - off).abs() < 0.01, "{found} {off}");
            assert!((bin(7).norm() / 16.0 - side_lobe(2.0 - off, 16)).abs() < 1e-9);
            assert!(bin(9).norm() / 16.0 <= bound(4.0 - off, 16) + 1e-9);
        }
        assert_eq!(quinn(&[Complex64::ZERO; 3]), 0.0);
    }

    #[test]
    fn parabola_peak_is_interpolated() {
        let value = |x: f64| Some(3.0 - (x - 0.2).powi(2));
        assert!((parabola(&[value(-1.0), value(0.0), value(1.0)]) - 0.2).abs() < 1e-12);
        assert_eq!(parabola(&[None, Some(1.0), Some(0.5)]), 0.0);
        assert_eq!(parabola(&[Some(1.0); 3]), 0.0);
    }

    #[test]
    fn close_peaks_merge_into_the_stronger() {
        let at = |distance_m: f64, velocity_m_per_s: f64, magnitude: f64| Reflection {
            distance_m,
            velocity_m_per_s,
            magnitude,
        };
        let merged = merged(vec![at(0.4, -0.3, 5.0), at(0.43, -0.28, 9.0), at(0.4, -0.2, 1.0), at(0.5, -0.3, 2.0)]);
        assert_eq!(merged, [at(0.43, -0.28, 9.0), at(0.4, -0.2, 1.0), at(0.5, -0.3, 2.0)]);
    }
}
