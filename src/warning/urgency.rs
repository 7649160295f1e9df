//! Urgency of a hazard: by distance, and by time to contact.
//!
//! Distance alone warns a runner too late. Time alone does not warn someone who stands in front of
//! a shelf and is about to lift an arm. The greater of the two counts. The time to contact uses the
//! body part's speed along the line to the hazard. Its weight rises between two speeds, so that
//! swaying, turning the head and fidgeting have no effect, and only within the distance that the
//! body part can cover in that time.

use super::proximity::Proximity;
use super::settings::WarningSettings;

/// Speeds at which the time to contact begins to count and counts fully, m/s: head and torso, and
/// hands. Choice: above swaying and fidgeting, below walking at 1.2 m/s and a reach at 1.5 m/s.
const BODY_SPEEDS_M_PER_S: (f64, f64) = (0.25, 0.5);
const HAND_SPEEDS_M_PER_S: (f64, f64) = (0.5, 1.0);
/// Largest distance for which contact is predicted, metres: range of the map for the body, reach of
/// an arm for hands. Choice: farther predictions would come from obstacles that the map does not
/// hold or that no arm reaches.
pub(super) const MAX_CONTACT_DISTANCE_M: f64 = 3.0;
const MAX_HAND_CONTACT_DISTANCE_M: f64 = 0.8;

/// Urgency for one group of body parts: head and torso, or hands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Urgency {
    /// The body part that determines it.
    pub near: Proximity,
    /// By distance, 0 to 1.
    pub by_distance: f64,
    /// By time to contact, 0 to 1.
    pub by_contact: f64,
}

impl Urgency {
    fn of(near: Proximity, settings: &WarningSettings) -> Self {
        let by_distance = match near.is_hand() {
            true => settings.by_hand_distance(near.setting_distance_m()),
            false => settings.by_distance(near.setting_distance_m()),
        };
        Self { near, by_distance, by_contact: by_contact(&near, settings) }
    }

    /// The greater of both.
    pub fn value(&self) -> f64 {
        self.by_distance.max(self.by_contact)
    }
}

/// Urgencies of head and torso, and of hands: the most urgent part of each, the nearest among
/// equals.
pub(super) fn urgencies(proximities: &[Proximity], settings: &WarningSettings) -> [Option<Urgency>; 2] {
    [false, true].map(|hands| {
        let group = proximities.iter().filter(|near| near.is_hand() == hands).map(|near| Urgency::of(*near, settings));
        group.max_by(|a, b| a.value().total_cmp(&b.value()).then(b.near.gap_m.total_cmp(&a.near.gap_m)))
    })
}

fn by_contact(near: &Proximity, settings: &WarningSettings) -> f64 {
    let (farthest_m, (from, full)) = match near.is_hand() {
        true => (MAX_HAND_CONTACT_DISTANCE_M, HAND_SPEEDS_M_PER_S),
        false => (MAX_CONTACT_DISTANCE_M, BODY_SPEEDS_M_PER_S),
    };
    let Some(time_s) = near.time_to_contact_s().filter(|_| near.gap_m <= farthest_m) else { return 0.0 };
    settings.by_contact(time_s) * ((near.closing_m_per_s - from) / (full - from)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warning::BodyPart;
    use glam::DVec3;

    fn near(part: BodyPart, gap_m: f64, closing_m_per_s: f64) -> Urgency {
        let near = Proximity { part, distance_m: gap_m + 0.25, gap_m, nearest_m: DVec3::ZERO, closing_m_per_s };
        Urgency::of(near, &WarningSettings::default())
    }

    #[test]
    fn fast_approach_raises_urgency_earlier() {
        let value = |speed| near(BodyPart::Torso, 1.4, speed).value();
        assert_eq!(value(0.0), 0.0);
        assert_eq!(value(0.3), 0.0, "4.7 s away");
        assert!(value(1.2) > 0.1 && value(2.0) > value(1.2));
        assert_eq!(value(2.5), 1.0, "0.56 s away");
        assert_eq!(value(-2.5), 0.0, "goes away");
    }

    #[test]
    fn slow_motion_does_not_raise_urgency() {
        let (still, sways) = (near(BodyPart::Head, 0.2, 0.0), near(BodyPart::Head, 0.2, 0.24));
        assert_eq!((sways.by_contact, sways.by_distance), (0.0, still.by_distance));
    }

    #[test]
    fn hand_swing_counts_within_arm_reach() {
        assert_eq!(near(BodyPart::LeftHand, 0.7, 2.0).value(), 1.0);
        assert_eq!(near(BodyPart::LeftHand, 1.0, 5.0).value(), 0.0);
        assert_eq!(near(BodyPart::LeftHand, 0.7, 0.0).value(), 0.0, "a hand at rest has room");
        assert!(near(BodyPart::LeftHand, 0.2, 0.0).value() > 0.8);
    }

    #[test]
    fn most_urgent_body_part_is_used() {
        let settings = WarningSettings::default();
        let parts = [near(BodyPart::Head, 0.9, 0.0).near, near(BodyPart::Torso, 0.4, 0.0).near];
        let [body, hands] = urgencies(&parts, &settings);
        assert_eq!((body.unwrap().near.part, hands), (BodyPart::Torso, None));
    }
}
