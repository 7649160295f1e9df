//! Brightness of one hazard from frame to frame: it appears at the fade distance, disappears beyond
//! it and after a delay, and follows the wanted brightness at a limited rate.

use super::body_model::BodyModel;
use super::habituation::{FAST_HEAD_M_PER_S, Habituation};
use super::hazard::{Hazard, WarningVisual};
use super::label::DistanceLabel;
use super::proximity::Proximity;
use super::settings::WarningSettings;
use super::urgency::{Urgency, urgencies};

use radar_sar::math;

/// Least urgency that starts or keeps a warning. Choice: fainter light cannot be seen, and the
/// fade's long tail would keep overlays in use.
const MIN_URGENCY: f64 = 0.02;
/// Least brightness of a held warning. Choice: visible to someone who looks for it.
const MIN_HELD_BRIGHTNESS: f64 = 0.04;
/// A warning is held this far beyond the fade distance, metres. Choice: more than a standing body
/// sways, so a warning at the limit does not blink.
const HOLD_MARGIN_M: f64 = 0.15;
/// A warning is held this long after that, and after the hazard has left the scene, nanoseconds.
/// Choice: two updates of the map.
const HOLD_NS: i64 = 500_000_000;
/// Rise of the brightness. Choice: from dark to full in 0.1 s, before a step has covered 10 cm.
const RISE_PER_S: f64 = 10.0;
/// Rise for a panel that fills the view. Choice: 0.25 s, so that it does not flash.
const WIDE_RISE_PER_S: f64 = 4.0;
/// Fall from full to dark. Choice: 0.5 s, slow enough not to draw the eye, fast enough not to hide
/// the game.
const FALL_PER_S: f64 = 2.0;
/// Fall for a hazard that has left the scene. Choice: twice as fast, because a removed obstacle
/// should not be believed any longer.
const MISSING_FALL_PER_S: f64 = 4.0;
/// Least speed at which a body part counts as receding, m/s. Choice: as fast as a standing body
/// sways.
const MIN_RECEDING_M_PER_S: f64 = 0.1;
/// Angular size from which on a panel fills the view, radians. Choice: 92°, most of a headset's
/// field of view.
const WIDE_PANEL_RAD: f64 = 1.6;

/// Warning state of one hazard.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct WarningState {
    /// The last visual.
    pub drawn: Option<WarningVisual>,
    /// Brightness, 0 to 1, before the user's factor.
    pub shown: f64,
    /// Wanted brightness.
    pub wanted: f64,
    is_on: bool,
    off_since_ns: Option<i64>,
    is_missing: bool,
    habituation: [Habituation; 2],
    version: u64,
    label: DistanceLabel,
    near: Option<Proximity>,
}

impl WarningState {
    /// Nothing shown yet.
    pub fn new(version: u64) -> Self {
        Self { version, ..Self::default() }
    }

    /// Updates the wanted brightness. `version` differs from the last one when the hazard has
    /// changed.
    pub fn update(
        &mut self,
        now_ns: i64,
        hazard: &Hazard,
        version: u64,
        body_model: &BodyModel,
        settings: &WarningSettings,
    ) {
        let is_other = self.version != version;
        let is_fast = body_model.head_speed_m_per_s > FAST_HEAD_M_PER_S;
        (self.version, self.is_missing) = (version, false);
        let urgencies = urgencies(&hazard.proximities(body_model, settings), settings);
        let (mut urgency, mut wanted) = (0.0f64, 0.0f64);
        let mut most: Option<Urgency> = None;
        for (habituation, this) in self.habituation.iter_mut().zip(&urgencies) {
            let Some(this) = this else {
                *habituation = Habituation::default();
                continue;
            };
            // Someone who moves away fast must not make the warning brighter behind them.
            let is_active = is_other || (is_fast && this.near.closing_m_per_s > -MIN_RECEDING_M_PER_S);
            let left = habituation.brightness_factor(now_ns, this, is_active, settings);
            urgency = urgency.max(this.value());
            wanted = wanted.max(this.by_contact).max(this.by_distance * left);
            if most.is_none_or(|most| this.value() > most.value()) {
                most = Some(*this);
            }
        }
        self.near = most.map(|most| most.near);
        let is_within_margin =
            urgencies[0].is_some_and(|body| body.near.distance_m < settings.fade_distance_m + HOLD_MARGIN_M);
        self.hold(now_ns, urgency > MIN_URGENCY, is_within_margin && settings.by_distance(0.0) > 0.0);
        self.wanted = if self.is_on { (wanted * hazard.brightness(settings)).max(MIN_HELD_BRIGHTNESS) } else { 0.0 };
    }

    /// The hazard has left the scene.
    pub fn mark_missing(&mut self, now_ns: i64) {
        self.is_missing = true;
        self.hold(now_ns, false, false);
        if !self.is_on {
            self.wanted = 0.0;
        }
    }

    fn hold(&mut self, now_ns: i64, comes: bool, stays: bool) {
        if comes || (stays && self.is_on) {
            (self.is_on, self.off_since_ns) = (true, None);
        } else if self.is_on {
            // After time ran backwards, it counts as off from now on.
            let since_ns = self.off_since_ns.unwrap_or(now_ns).min(now_ns);
            self.off_since_ns = Some(since_ns);
            self.is_on = now_ns.saturating_sub(since_ns) < HOLD_NS;
        }
    }

    /// Change of the brightness within a time, limited by the rates.
    pub fn change(&self, passed_s: f64, eyes_m: glam::DVec3) -> f64 {
        let is_wide = self.drawn.as_ref().is_some_and(|drawn| {
            let away_m = drawn.panel.tracking_from_panel.translation.distance(eyes_m).max(0.1);
            2.0 * math::atan(drawn.panel.size_m.max_element() / 2.0 / away_m) > WIDE_PANEL_RAD
        });
        let rise = if is_wide { WIDE_RISE_PER_S } else { RISE_PER_S };
        let fall = if self.is_missing { MISSING_FALL_PER_S } else { FALL_PER_S };
        (self.wanted - self.shown).clamp(-fall * passed_s, rise * passed_s)
    }

    /// Updates the visual; a hazard with nothing to show from here goes dark.
    pub fn update_visual(&mut self, now_ns: i64, hazard: &Hazard, body_model: &BodyModel, settings: &WarningSettings) {
        let before = self.drawn.as_ref();
        let draw = |near| hazard.draw(body_model, &near, 0.0, settings, before).map(|drawn| (drawn, near));
        let drawn = self.near.and_then(draw);
        match drawn {
            Some((mut drawn, near)) => {
                drawn.panel.label_m = settings.labels.then(|| self.label.update(now_ns, near.gap_m));
                self.drawn = Some(drawn);
            }
            None => self.wanted = 0.0,
        }
    }

    /// Whether nothing is shown or held any more.
    pub fn is_over(&self) -> bool {
        !self.is_on && self.shown <= 0.0
    }

    /// The visual with its brightness; `None` when dark.
    pub fn visual(&self, settings: &WarningSettings) -> Option<WarningVisual> {
        let alpha = settings.alpha_of(self.shown);
        let mut drawn = self.drawn.clone().filter(|_| alpha > 0.0)?;
        drawn.set_alpha(alpha);
        Some(drawn)
    }
}
