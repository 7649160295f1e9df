//! Who stands still by a wall need not be told of it for ever: after some seconds a warning dims.
//!
//! Calm is who has come no nearer, is not about to touch and does not move fast, before a thing that is what it was. Distance
//! counts from the farthest since, so that creeping up is not calm either. The first step nearer ends it, and the brightness rises as
//! fast as it does at first. The nearer to the thing within `full_distance_m`, the less it dims; at distance 0, beyond a wall or
//! within a thing, not at all: the longer one stands there unawares, the more one needs it.

use super::settings::WarningSettings;
use super::urgency::Urgency;

/// So much nearer is approaching, metres: more than a standing body sways.
const MIN_APPROACH_M: f64 = 0.08;
/// Contact this urgent is approaching.
const MIN_CONTACT_URGENCY: f64 = 0.1;
/// A head faster than this is on its way, m/s.
pub(super) const FAST_HEAD_M_PER_S: f64 = 0.7;
/// Dimming takes so long, seconds.
const DIM_DURATION_S: f64 = 2.0;

/// How calm the player is before one thing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Habituation {
    since: Option<(i64, f64)>,
}

impl Habituation {
    /// How much is left of the brightness by distance, `calm_brightness` to 1.
    pub fn brightness_factor(
        &mut self,
        now_ns: i64,
        urgency: &Urgency,
        is_active: bool,
        settings: &WarningSettings,
    ) -> f64 {
        let distance_m = urgency.near.setting_distance_m();
        let before = self.since.filter(|(since_ns, farthest_m)| {
            !is_active
                && now_ns >= *since_ns
                && distance_m > farthest_m - MIN_APPROACH_M
                && urgency.by_contact < MIN_CONTACT_URGENCY
        });
        let (since_ns, farthest_m) = before.unwrap_or((now_ns, distance_m));
        self.since = Some((since_ns, farthest_m.max(distance_m)));
        let calm_s = now_ns.saturating_sub(since_ns) as f64 * 1e-9 - settings.calm_after_s;
        let dimmed = (calm_s / DIM_DURATION_S).clamp(0.0, 1.0);
        1.0 - dimmed * (1.0 - min_brightness_factor(urgency, settings))
    }
}

/// What is left in the end: 1 at distance 0, `calm_brightness` from the distance of full brightness on.
fn min_brightness_factor(urgency: &Urgency, settings: &WarningSettings) -> f64 {
    let distance_m = urgency.near.setting_distance_m();
    let full_m = if urgency.near.is_hand() { settings.full_hand_distance_m() } else { settings.full_distance_m };
    let beyond =
        if full_m > 0.0 { (distance_m / full_m).clamp(0.0, 1.0) } else { f64::from(u8::from(distance_m > 0.0)) };
    1.0 - beyond * (1.0 - settings.calm_brightness)
}
