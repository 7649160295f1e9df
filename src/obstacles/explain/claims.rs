//! Claims: range and direction in each block that something believed accounts for, as wide as pulse and aperture tell them.

use std::ops::Range;

use glam::DVec3;

use super::{Candidate, Window};
use crate::imaging::blocks::Block;
use crate::math;
use crate::obstacles::hands::{HandTrail, echoing_m};
use crate::obstacles::views::View;
use crate::radar::WAVELENGTH_M;

/// Range and direction in one block that are accounted for.
#[derive(Debug, Clone, Copy)]
pub(in crate::obstacles) struct Claim {
    range_m: f64,
    half_range_m: f64,
    cos: f64,
    half_cos: f64,
}

impl Claim {
    /// Whether something seen there is accounted for.
    pub fn covers(&self, range_m: f64, cos: f64) -> bool {
        (range_m - self.range_m).abs() < self.half_range_m && (cos - self.cos).abs() < self.half_cos
    }

    /// Takes a view out that it covers.
    pub fn take(&self, view: &mut Option<View>) {
        view.take_if(|v| self.covers(v.range_m, v.cos));
    }
}

/// What the player's own hands account for: everything at their ranges and their forearms', whatever its direction seems to be, since
/// they move.
pub(in crate::obstacles) fn hand_claims(block: &Block, hands: &HandTrail) -> Vec<Claim> {
    let hands = hands.at(block.mid_time_ns).into_iter().flatten();
    let to_hand = hands.map(|hand| hand - block.middle.translation);
    let ahead = to_hand.filter(|to| to.dot(block.middle.forward()) > 0.0);
    let claim = |to: DVec3| {
        let Range { start, end } = echoing_m(to.length());
        Claim { range_m: (start + end) * 0.5, half_range_m: (end - start) * 0.5, cos: 0.0, half_cos: 2.0 }
    };
    ahead.map(claim).collect()
}

impl Window<'_> {
    /// Claims what a thing accounts for and takes it from the others.
    pub(super) fn claim(&mut self, best: &Candidate, open: &mut [Candidate]) {
        let claims = self.claims_of(best);
        for candidate in open {
            let seen_before = candidate.views.iter().flatten().count();
            let views = candidate.views.iter_mut().zip(&claims);
            views.for_each(|(view, claim)| claim.iter().for_each(|claim| claim.take(view)));
            if candidate.views.iter().flatten().count() < seen_before {
                candidate.left = self.left_of(candidate.thing, candidate.views.iter().map(Option::as_ref));
            }
        }
        self.claims.iter_mut().zip(claims).for_each(|(all, claim)| all.extend(claim));
    }

    /// `[block]`
    pub(super) fn claims_of(&self, candidate: &Candidate) -> Vec<Option<Claim>> {
        candidate.views.iter().enumerate().map(|(n, view)| view.map(|v| self.claim_of(n, &v))).collect()
    }

    fn claim_of(&self, n: usize, view: &View) -> Claim {
        let block = self.blocks[n];
        let half_width_m = block.geometry().profile.envelope_fwhm_m() * 0.5;
        // As far as the pulse's skirt still stands out of the noise.
        let skirt_m = half_width_m * math::log2(view.power.max(1.0)).sqrt();
        Claim {
            range_m: view.range_m,
            half_range_m: skirt_m.max(self.settings.claim_range_m),
            cos: view.cos,
            half_cos: self.settings.claim_lobes * WAVELENGTH_M / (2.0 * block.aperture_m.max(1e-4)),
        }
    }
}
