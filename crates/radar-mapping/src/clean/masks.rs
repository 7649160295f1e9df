//! Masks: the range and direction in each sub-aperture that a detection accounts for, as wide as
//! pulse and aperture resolve them.

use std::ops::Range;

use glam::DVec3;

use super::CleanSettings;
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

/// What is masked in each sub-aperture.
pub(super) struct MaskStore {
    /// `[sub-aperture]`
    masks: Vec<Vec<Mask>>,
}

impl MaskStore {
    /// Only the wearer's tracked hands.
    pub fn of_hands(subapertures: &[&Subaperture], hands: &HandTrail) -> Self {
        Self { masks: subapertures.iter().map(|one| hand_masks(one, hands)).collect() }
    }

    /// Masks in the sub-aperture of this index in the window.
    pub fn of(&self, n: usize) -> &[Mask] {
        &self.masks[n]
    }

    /// `[sub-aperture]`
    pub fn iter(&self) -> impl Iterator<Item = &Vec<Mask>> {
        self.masks.iter()
    }

    /// Removes the responses that are masked.
    pub fn apply(&self, responses: &mut [Option<Response>]) {
        let responses = responses.iter_mut().zip(&self.masks);
        responses.for_each(|(response, masks)| masks.iter().for_each(|mask| mask.apply(response)));
    }

    /// Adds a detection's masks, `[sub-aperture]`.
    pub fn add(&mut self, masks: Vec<Option<Mask>>) {
        self.masks.iter_mut().zip(masks).for_each(|(all, mask)| all.extend(mask));
    }
}

/// What an object with these responses masks, `[sub-aperture]`.
pub(super) fn masks_of(
    subapertures: &[&Subaperture],
    responses: &[Option<Response>],
    settings: &CleanSettings,
) -> Vec<Option<Mask>> {
    let each = subapertures.iter().zip(responses);
    each.map(|(one, response)| response.map(|v| mask_of(one, &v, settings))).collect()
}

fn mask_of(one: &Subaperture, response: &Response, settings: &CleanSettings) -> Mask {
    let half_width_m = one.geometry().pulse_fwhm_m * 0.5;
    // As far as the pulse's skirt stands out of the noise.
    let skirt_m = half_width_m * math::log2(response.power.max(1.0)).sqrt();
    Mask {
        range_m: response.range_m,
        half_range_m: skirt_m.max(settings.mask_range_m),
        cos: response.cos,
        half_cos: settings.mask_lobes * WAVELENGTH_M / (2.0 * one.aperture_m.max(1e-4)),
    }
}
