//! Whether a known place still has something in it: log odds that grow when blocks see it and fall when blocks should and do not.
//!
//! A thing that returned so much, at its range and in the beam's gain there, is expected to return as much again. Echoes fluctuate
//! (Swerling's first case), so under presence m is exponential with mean 1 + m̂, under absence with mean 1, and a block's log likelihood
//! ratio is m·m̂/(1 + m̂) − ln(1 + m̂). Other energy at the same range lowers m̂ as it lowers m: a thing that is drowned is not gone.
//! Furniture returns well into some directions and badly into others, so what was seen from a direction is expected from there more
//! surely than from elsewhere: the ratio is that of a mixture, and never being seen from a new side costs little.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::views::View;
use crate::imaging::blocks::Block;
use crate::radar::Beam;

/// Parameters of forgetting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ForgetSettings {
    /// Log odds that a thing needs to be confirmed.
    pub confirm: f64,
    /// Log odds that are not exceeded: how much it takes to forget what was seen for long.
    pub most: f64,
    /// How sure it is that a thing is seen from where it was seen before, 0 to 1.
    pub familiar: f64,
    /// How sure it is from a side that it was never seen from, 0 to 1.
    pub unfamiliar: f64,
}

impl Default for ForgetSettings {
    fn default() -> Self {
        Self { confirm: 3.0, most: 5.0, familiar: 0.5, unfamiliar: 0.2 }
    }
}

/// Sides that a thing is seen from, around the vertical.
pub(super) const SIDES: usize = 16;
/// Log odds that what is remembered begins with: two or three blocks that miss it do away with it.
const REMEMBERED: f64 = 1.5;
/// Share that a new echo has in what is expected of a side.
const NEWEST_SHARE: f64 = 0.2;
/// A block that says so much more than noise is an echo.
const ECHO_COHERENCE: f64 = 3.0;
/// From an unfamiliar side so much of the strongest side's power is expected.
const UNFAMILIAR_SHARE: f64 = 0.3;
/// Greatest that one block adds to the log odds.
const MOST_A_BLOCK: f64 = 1.0;

/// Log odds do not fall lower: what comes to a place where nothing was is believed soon.
const LEAST: f64 = -2.0;

/// The log odds of one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Existence {
    log_odds: f64,
    /// Power at 1 m on the axis, in units of the noise, by side; 0: never seen.
    strengths: [f64; SIDES],
    newest_ns: i64,
}

impl Existence {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self { log_odds: 0.0, strengths: [0.0; SIDES], newest_ns: i64::MIN }
    }

    /// Remembered from before, with what it returned to each side.
    pub fn remembered(strengths: [f64; SIDES]) -> Self {
        Self { log_odds: REMEMBERED, strengths, ..Self::new() }
    }

    /// What it returned to each side.
    pub fn strengths(&self) -> [f64; SIDES] {
        self.strengths
    }

    /// How surely something is there: 0 is even odds.
    pub fn log_odds(&self) -> f64 {
        self.log_odds
    }

    /// Takes what blocks that are newer than the last ones say of it.
    pub fn look<'b>(
        &mut self,
        views: impl Iterator<Item = (&'b Block, &'b View)>,
        beam: &Beam,
        settings: &ForgetSettings,
    ) {
        let since_ns = self.newest_ns;
        for (block, view) in views.filter(|(block, _)| block.mid_time_ns > since_ns) {
            self.newest_ns = self.newest_ns.max(block.mid_time_ns);
            self.take(view, gain(block, view, beam), settings);
        }
    }

    fn take(&mut self, view: &View, gain: f64, settings: &ForgetSettings) {
        let side = side_of(-view.toward);
        let (strength, surely) = self.expected(side, settings);
        // What else is in this range drowns it as it drowned m.
        let expected = strength * gain / view.drowning();
        let ratio = (view.m * expected / (1.0 + expected)).min(30.0).exp() / (1.0 + expected);
        let change = (surely * ratio + 1.0 - surely).ln().min(MOST_A_BLOCK);
        self.log_odds = (self.log_odds + change).clamp(LEAST, settings.most);
        if view.m >= ECHO_COHERENCE && gain > 0.0 {
            let newest = view.power / gain;
            let known = &mut self.strengths[side];
            *known = if *known > 0.0 { *known + NEWEST_SHARE * (newest - *known) } else { newest };
        }
    }

    /// The strength that is expected from a side, and how surely.
    fn expected(&self, side: usize, settings: &ForgetSettings) -> (f64, f64) {
        let beside = [side, (side + 1) % SIDES, (side + SIDES - 1) % SIDES].map(|n| self.strengths[n]);
        if beside[0] > 0.0 {
            return (beside[0], settings.familiar);
        }
        let near = beside[1].max(beside[2]);
        if near > 0.0 {
            return (near * 0.5, 0.5 * (settings.familiar + settings.unfamiliar));
        }
        (self.strengths.iter().copied().fold(0.0, f64::max) * UNFAMILIAR_SHARE, settings.unfamiliar)
    }
}

/// Two-way power gain of beam and distance, 1 at 1 m on the axis.
fn gain(block: &Block, view: &View, beam: &Beam) -> f64 {
    let amplitude = beam.amplitude(view.toward.dot(block.middle.forward()));
    (amplitude / view.range_m.max(0.1).powi(2)).powi(2)
}

/// The direction from the thing that a side's middle lies in.
pub(super) fn middle_of_side(side: usize) -> DVec3 {
    let turn = (side as f64 + 0.5) / SIDES as f64 * TAU;
    DVec3::new(turn.sin(), 0.0, turn.cos())
}

/// The side that a direction from the thing leads to.
pub(super) fn side_of(from_thing: DVec3) -> usize {
    let turn = from_thing.x.atan2(from_thing.z).rem_euclid(TAU) / TAU;
    ((turn * SIDES as f64) as usize).min(SIDES - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(m: f64, power: f64, toward: DVec3) -> View {
        View { m, evidence: 0.0, power, range_m: 1.0, toward, cos: 0.0 }
    }

    fn after(views: &[View]) -> f64 {
        let settings = ForgetSettings::default();
        let mut existence = Existence::new();
        views.iter().for_each(|view| existence.take(view, 1.0, &settings));
        existence.log_odds
    }

    #[test]
    fn what_is_seen_stays_and_what_is_gone_goes() {
        let (seen, empty) = (view(30.0, 30.0, DVec3::X), view(0.5, 0.5, DVec3::X));
        assert_eq!(after(&[seen; 10]), ForgetSettings::default().most);
        let gone: Vec<View> = [vec![seen; 10], vec![empty; 12]].concat();
        assert!(after(&gone) <= 0.0, "{}", after(&gone));
        let glimpse: Vec<View> = [vec![seen; 10], vec![empty; 3], vec![seen; 1]].concat();
        assert!(after(&glimpse) > 4.0, "{}", after(&glimpse));
    }

    #[test]
    fn from_another_side_it_need_not_be_seen() {
        let (seen, empty) = (view(30.0, 30.0, DVec3::X), view(0.5, 0.5, DVec3::NEG_X));
        let elsewhere: Vec<View> = [vec![seen; 10], vec![empty; 10]].concat();
        let there: Vec<View> = [vec![seen; 10], vec![view(0.5, 0.5, DVec3::X); 10]].concat();
        assert!(after(&elsewhere) > 2.5 && after(&there) <= 0.0, "{} {}", after(&elsewhere), after(&there));
    }

    #[test]
    fn what_is_drowned_is_not_gone() {
        // Ten times its power from beside it at the same range.
        let (seen, drowned) = (view(30.0, 30.0, DVec3::X), view(1.0, 300.0, DVec3::X));
        let views: Vec<View> = [vec![seen; 10], vec![drowned; 30]].concat();
        assert!(after(&views) > 4.0, "{}", after(&views));
    }

    #[test]
    fn a_far_thing_that_cannot_be_seen_is_not_missed() {
        let settings = ForgetSettings::default();
        let mut existence = Existence::new();
        (0..10).for_each(|_| existence.take(&view(30.0, 30.0, DVec3::X), 1.0, &settings));
        (0..100).for_each(|_| existence.take(&view(0.8, 0.8, DVec3::X), 0.002, &settings));
        assert!(existence.log_odds > 4.0, "{}", existence.log_odds);
    }
}
