//! Masks: the range and direction in each sub-aperture that a detection accounts for, as wide as
//! pulse and aperture resolve them.

use std::ops::Range;

use glam::DVec3;

use super::{Candidate, CleanWindow};
use crate::hands::{HandTrail, hand_ranges_m};
use crate::responses::Response;
use radar_sar::WAVELENGTH_M;
use radar_sar::math;
use radar_sar::subaperture::Subaperture;

/// A masked range and direction in one sub-aperture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mask {
    range_m: f64,
    half_range_m: f64,
    cos: f64,
    half_cos: f64,
}

impl Mask {
    /// Whether a response there is masked.
    pub fn covers(&self, range_m: f64, cos: f64) -> bool {
        (range_m - self.range_m).abs() < self.half_range_m && (cos - self.cos).abs() < self.half_cos
    }

    /// Removes a response that it covers.
    pub fn apply(&self, response: &mut Option<Response>) {
        response.take_if(|v| self.covers(v.range_m, v.cos));
    }
}

/// What the wearer's own hands account for: everything at the ranges of hand and forearm, whatever
/// its apparent direction, because they move.
pub(crate) fn hand_masks(subaperture: &Subaperture, hands: &HandTrail) -> Vec<Mask> {
    let hands = hands.at(subaperture.mid_time_ns).into_iter().flatten();
    let to_hand = hands.map(|hand| hand - subaperture.middle.translation);
    let ahead = to_hand.filter(|to| to.dot(subaperture.middle.forward()) > 0.0);
    let mask = |to: DVec3| {
        let Range { start, end } = hand_ranges_m(to.length());
        Mask { range_m: (start + end) * 0.5, half_range_m: (end - start) * 0.5, cos: 0.0, half_cos: 2.0 }
    };
    ahead.map(mask).collect()
}

impl CleanWindow<'_> {
    /// Masks what a detection accounts for and removes it from the other candidates.
    pub(super) fn mask(&mut self, best: &Candidate, open: &mut [Candidate]) {
        let masks = self.masks_of(best);
        for candidate in open {
            let seen_before = candidate.responses.iter().flatten().count();
            let responses = candidate.responses.iter_mut().zip(&masks);
            responses.for_each(|(response, mask)| mask.iter().for_each(|mask| mask.apply(response)));
            if candidate.responses.iter().flatten().count() < seen_before {
                candidate.unmasked =
                    self.unmasked_score(candidate.hypothesis, candidate.responses.iter().map(Option::as_ref));
            }
        }
        self.masks.iter_mut().zip(masks).for_each(|(all, mask)| all.extend(mask));
    }

    /// `[sub-aperture]`
    pub(super) fn masks_of(&self, candidate: &Candidate) -> Vec<Option<Mask>> {
        candidate.responses.iter().enumerate().map(|(n, response)| response.map(|v| self.mask_of(n, &v))).collect()
    }

    fn mask_of(&self, n: usize, response: &Response) -> Mask {
        let subaperture = self.subapertures[n];
        let half_width_m = subaperture.geometry().pulse_fwhm_m * 0.5;
        // As far as the pulse's skirt stands out of the noise.
        let skirt_m = half_width_m * math::log2(response.power.max(1.0)).sqrt();
        Mask {
            range_m: response.range_m,
            half_range_m: skirt_m.max(self.settings.mask_range_m),
            cos: response.cos,
            half_cos: self.settings.mask_lobes * WAVELENGTH_M / (2.0 * subaperture.aperture_m.max(1e-4)),
        }
    }
}
