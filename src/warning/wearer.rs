//! The player's body: head and neck, torso, arms.
//!
//! Of a player the headset and the controllers are tracked. The torso is taken to be upright, from below the head to the floor, so
//! that crouching lowers it. Its place follows the head: a head that leans leaves it behind by up to 15 cm, which is what
//! trunk and neck give before hips or feet follow, and within a third of a second it stands under the head again. It cannot be known better:
//! a head alone does not tell a step from a bow, and the error that is left leans to the careful side, a body believed to
//! have come along. An arm runs straight from its shoulder to its hand.
//!
//! Distances are from these parts' axes: the torso's upright line, the line from between the eyes to the neck, the line along an arm. What
//! room there is to the body's surface is that less the part's radius, half the breadth across the shoulders (about half a
//! metre in adults), the head's with a headset on it, a hand's with its controller.

use glam::DVec3;

use super::body::is_place;
use super::player::{BodyPart, Player};
use super::speed::Speed;
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Half the breadth across the shoulders, metres.
const TORSO_RADIUS_M: f64 = 0.25;
/// Head with a headset, metres.
const HEAD_RADIUS_M: f64 = 0.12;
/// A hand that holds a controller, metres.
const HAND_RADIUS_M: f64 = 0.08;
/// From the eyes down to where the shoulders begin, metres.
const NECK_M: f64 = 0.25;
/// From the spine to a shoulder's joint, metres.
const SHOULDER_M: f64 = 0.18;
/// The torso reaches at least so far down: the floor may be lower than the tracking frame says, metres.
const LEAST_TORSO_M: f64 = 1.6;
/// A head leans so far before hips follow, metres.
const LEAN_M: f64 = 0.15;
/// Time in which the torso comes under the head, seconds.
const FOLLOW_S: f64 = 0.3;
/// A hand farther from the head than this is not this player's, metres.
const FARTHEST_HAND_M: f64 = 1.5;
/// Faster than this no head moves: the frame has leapt, m/s.
const FASTEST_HEAD_M_PER_S: f64 = 6.0;
/// Faster than this no hand moves, m/s.
const FASTEST_HAND_M_PER_S: f64 = 15.0;
/// Smoothing of a head's speed and a hand's, seconds.
const HEAD_SMOOTHING_S: f64 = 0.08;
const HAND_SMOOTHING_S: f64 = 0.04;

/// A part of the body: a line with a thickness, and how its ends move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limb {
    pub part: BodyPart,
    pub ends: [DVec3; 2],
    pub velocities_m_per_s: [DVec3; 2],
    pub radius_m: f64,
}

impl Limb {
    /// Where on the axis, 0 to 1, a place is nearest.
    pub fn share_near(&self, place: DVec3) -> f64 {
        let along = self.ends[1] - self.ends[0];
        let length = along.length_squared();
        if length < 1e-9 { 0.0 } else { ((place - self.ends[0]).dot(along) / length).clamp(0.0, 1.0) }
    }

    /// The place on the axis and how it moves.
    pub fn at(&self, share: f64) -> (DVec3, DVec3) {
        let [from, to] = self.ends;
        let [from_moves, to_moves] = self.velocities_m_per_s;
        (from.lerp(to, share), from_moves.lerp(to_moves, share))
    }
}

/// The body at one time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wearer {
    pub head_m: DVec3,
    /// The head's forward direction.
    pub ahead: DVec3,
    /// How fast the head moves, m/s.
    pub head_speed_m_per_s: f64,
    pub limbs: Vec<Limb>,
}

impl Wearer {
    /// Standing straight and still; `None` when the pose is none.
    pub fn still(tracking_from_head: &Pose) -> Option<Self> {
        Self::of(&Player::head_only(0, *tracking_from_head), None, [DVec3::ZERO; 4])
    }

    /// With the torso at x and z of `hips`, or straight below the head. Velocities of head, hips, left and right hand.
    fn of(player: &Player, hips: Option<DVec3>, velocities: [DVec3; 4]) -> Option<Self> {
        let head = player.tracking_from_head.translation;
        let ahead = player.tracking_from_head.forward();
        if !is_place(head) || !ahead.is_finite() {
            return None;
        }
        let hips = hips.unwrap_or(head);
        let [head_moves, hips_move, hand_moves @ ..] = velocities;
        let neck = DVec3::new(hips.x, head.y - NECK_M, hips.z);
        let feet = DVec3::new(hips.x, (neck.y - LEAST_TORSO_M).min(0.0), hips.z);
        let limb = |part, ends, velocities_m_per_s, radius_m| Limb { part, ends, velocities_m_per_s, radius_m };
        let mut limbs = vec![
            limb(BodyPart::Head, [head, neck], [head_moves, hips_move], HEAD_RADIUS_M),
            limb(BodyPart::Torso, [neck, feet], [hips_move, hips_move], TORSO_RADIUS_M),
        ];
        let right = ahead.cross(DVec3::Y).normalize_or_zero();
        let sides = [(BodyPart::LeftHand, -1.0), (BodyPart::RightHand, 1.0)];
        for ((part, side), (hand, moves)) in sides.into_iter().zip(player.hands_m.into_iter().zip(hand_moves)) {
            let Some(hand) = hand.filter(|hand| is_place(*hand) && hand.distance(head) <= FARTHEST_HAND_M) else {
                continue;
            };
            let shoulder = neck + right * (side * SHOULDER_M);
            limbs.push(limb(part, [shoulder, hand], [hips_move, moves], HAND_RADIUS_M));
        }
        Some(Self { head_m: head, ahead, head_speed_m_per_s: head_moves.length(), limbs })
    }
}

/// What is remembered of the player from frame to frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Stance {
    head: Speed,
    hips: Speed,
    hands: [Speed; 2],
    /// Where the hips are, as x and z of it, and when.
    hips_m: Option<(i64, DVec3)>,
}

impl Stance {
    /// The body now; `None` when the head's pose is none.
    pub fn take(&mut self, player: &Player) -> Option<Wearer> {
        let head = player.tracking_from_head.translation;
        if !is_place(head) {
            return None;
        }
        let time_ns = player.time_ns;
        let head_moves = self.head.take(time_ns, head, FASTEST_HEAD_M_PER_S, HEAD_SMOOTHING_S);
        if self.head.has_begun() {
            *self = Self { head: self.head.clone(), ..Self::default() };
        }
        let hips = self.follow(time_ns, head);
        let hips_move = self.hips.take(time_ns, hips, FASTEST_HEAD_M_PER_S, HEAD_SMOOTHING_S);
        let mut velocities = [head_moves, DVec3::new(hips_move.x, 0.0, hips_move.z), DVec3::ZERO, DVec3::ZERO];
        for (hand, (place, moves)) in player.hands_m.iter().zip(self.hands.iter_mut().zip(&mut velocities[2..])) {
            if let Some(hand) = hand.filter(|hand| is_place(*hand)) {
                *moves = place.take(time_ns, hand, FASTEST_HAND_M_PER_S, HAND_SMOOTHING_S);
            }
        }
        Wearer::of(player, Some(hips), velocities)
    }

    fn follow(&mut self, time_ns: i64, head: DVec3) -> DVec3 {
        let Some((then_ns, hips)) = self.hips_m else {
            self.hips_m = Some((time_ns, head));
            return head;
        };
        let passed_s = (time_ns.saturating_sub(then_ns) as f64 * 1e-9).max(0.0);
        let behind = (hips - head) * DVec3::new(1.0, 0.0, 1.0) * math::exp(-passed_s / FOLLOW_S);
        let hips = head + behind.clamp_length_max(LEAN_M);
        self.hips_m = Some((time_ns.max(then_ns), hips));
        hips
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_s: f64, place: DVec3) -> Player {
        Player::head_only((time_s * 1e9) as i64, Pose::from_translation(place))
    }

    fn torso(wearer: &Wearer) -> Limb {
        *wearer.limbs.iter().find(|limb| limb.part == BodyPart::Torso).unwrap()
    }

    #[test]
    fn a_leaning_head_leaves_the_torso_behind_and_a_walking_one_takes_it_along() {
        let mut stance = Stance::default();
        for step in 0..100 {
            stance.take(&at(f64::from(step) * 0.01, DVec3::Y * 1.7));
        }
        let lean = |step: i32| {
            at(1.0 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7 - 0.01 * f64::from(step), -0.01 * f64::from(step)))
        };
        let leant = (0..=10).filter_map(|step| stance.take(&lean(step))).last().unwrap();
        assert!(torso(&leant).ends[0].z > -0.03 && leant.limbs[0].ends[0].z == -0.1, "{leant:?}");
        let mut z_m = -0.1;
        for step in 0..200 {
            z_m -= 0.01;
            let walking = stance.take(&at(1.11 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7, z_m))).unwrap();
            assert!(torso(&walking).ends[0].z - z_m <= LEAN_M + 1e-9);
            if step > 100 {
                assert!((walking.limbs[1].velocities_m_per_s[0] + DVec3::Z).length() < 0.01, "{walking:?}");
            }
        }
        for step in 0..200 {
            stance.take(&at(3.2 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7, z_m)));
        }
        let stands = stance.take(&at(5.3, DVec3::new(0.0, 1.7, z_m))).unwrap();
        assert!((torso(&stands).ends[0].z - z_m).abs() < 0.01);
    }

    #[test]
    fn crouching_lowers_it_and_hands_have_arms() {
        let mut player = at(0.0, DVec3::Y * 0.9);
        player.hands_m = [Some(DVec3::new(-0.5, 0.8, -0.3)), Some(DVec3::splat(f64::NAN))];
        let wearer = Stance::default().take(&player).unwrap();
        assert!((torso(&wearer).ends[0].y - 0.65).abs() < 1e-9);
        let parts: Vec<_> = wearer.limbs.iter().map(|limb| limb.part).collect();
        assert_eq!(parts, [BodyPart::Head, BodyPart::Torso, BodyPart::LeftHand]);
        assert!(wearer.limbs[2].ends[0].x < -0.1, "the left shoulder is to the left");
        player.hands_m = [Some(DVec3::new(9.0, 1.0, 0.0)), None];
        assert_eq!(Stance::default().take(&player).unwrap().limbs.len(), 2, "that hand is somebody else's");
        player.tracking_from_head.translation.x = f64::NAN;
        assert_eq!(Stance::default().take(&player), None);
    }

    #[test]
    fn a_leap_takes_the_whole_body_along_and_no_speed() {
        let mut stance = Stance::default();
        for step in 0..50 {
            stance.take(&at(f64::from(step) * 0.01, DVec3::new(0.01 * f64::from(step), 1.7, 0.0)));
        }
        let leapt = stance.take(&at(0.5, DVec3::new(3.0, 1.7, 2.0))).unwrap();
        assert_eq!(leapt.limbs, Wearer::still(&Pose::from_translation(DVec3::new(3.0, 1.7, 2.0))).unwrap().limbs);
    }
}
