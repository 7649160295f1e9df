//! Dims a warning after the wearer has stood still near a hazard for some seconds.
//!
//! The wearer is calm when they have not come nearer, are not about to touch the hazard and do not
//! move fast, and the hazard is unchanged. The distance is compared with the largest one since
//! then, so slow creeping is not calm either. The first approach ends the state, and the brightness
//! rises as fast as for a new warning. Within `full_distance_m` the warning dims less the nearer
//! the hazard is. At distance 0, beyond a wall or inside an obstacle, it does not dim at all: that
//! is where the wearer needs it most.

use super::settings::WarningSettings;
use super::urgency::Urgency;

/// Decrease of distance that counts as an approach, metres. Choice: more than a standing body
/// sways.
const MIN_APPROACH_M: f64 = 0.08;
/// Contact urgency from which on the wearer counts as approaching, 0 to 1. Choice: above what sway
/// and fidgeting give, so that only steps and reaches restore the brightness.
const MIN_CONTACT_URGENCY: f64 = 0.1;
/// Head speed from which on the wearer counts as moving, m/s. Choice: half of walking speed;
/// turning and leaning stay below.
pub(super) const FAST_HEAD_M_PER_S: f64 = 0.7;
/// Duration of the dimming, seconds. Choice: too slow to catch the eye as a change.
const DIM_DURATION_S: f64 = 2.0;

/// How long the wearer has been calm near one hazard: since when, and the largest distance since
/// then.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Habituation {
    since: Option<(i64, f64)>,
}

impl Habituation {
    /// Factor on the brightness by distance, from `calm_brightness` to 1.
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

/// Factor after full dimming: 1 at distance 0, `calm_brightness` from the distance of full
/// brightness on.
fn min_brightness_factor(urgency: &Urgency, settings: &WarningSettings) -> f64 {
    let distance_m = urgency.near.setting_distance_m();
    let full_m = if urgency.near.is_hand() { settings.full_hand_distance_m() } else { settings.full_distance_m };
    let beyond =
        if full_m > 0.0 { (distance_m / full_m).clamp(0.0, 1.0) } else { f64::from(u8::from(distance_m > 0.0)) };
    1.0 - beyond * (1.0 - settings.calm_brightness)
}
