//! Body model of the wearer: head and neck, torso, arms.
//!
//! Only the headset and the controllers are tracked. The torso is assumed upright, from below the
//! head to the floor, so crouching lowers it. Its position follows the head: a leaning head leaves
//! it behind by up to 15 cm, as far as trunk and neck give before hips or feet follow, and it is
//! under the head again within a third of a second. A head alone does not distinguish a step from a
//! bow; the remaining error is on the safe side, a body assumed to have followed. An arm is a
//! straight line from the shoulder to the hand.
//!
//! Distances start from the axes of these parts: the torso's vertical line, the line from between
//! the eyes to the neck, the line along an arm. The gap to the body's surface is that distance less
//! the part's radius.

use glam::DVec3;

use super::obstacle_body::is_valid_position;
use super::velocity_filter::VelocityFilter;
use super::wearer::{BodyPart, Wearer};
use radar_sar::geometry::Pose;
use radar_sar::math;

/// Half of the shoulder breadth, metres. Choice: that of a broad adult; a narrower body is warned a
/// little early, not late.
const TORSO_RADIUS_M: f64 = 0.25;
/// Radius of the head with a headset, metres. Choice: half an adult head's depth, and the headset
/// before it.
const HEAD_RADIUS_M: f64 = 0.12;
/// Radius of a hand with a controller, metres. Choice: a fist around a controller.
const HAND_RADIUS_M: f64 = 0.08;
/// From the eyes down to the shoulders, metres. Choice: of a tall adult; the upper arms may start a
/// little low.
const NECK_M: f64 = 0.25;
/// From the spine to a shoulder joint, metres. Choice: the shoulder's radius less the muscle beyond
/// the joint.
const SHOULDER_M: f64 = 0.18;
/// Least length of the torso, metres: the floor may be lower than in the tracking frame. Choice:
/// a tall adult's shoulder height, so the legs end at the floor in any frame.
const MIN_TORSO_M: f64 = 1.6;
/// Largest lean of the head before the hips follow, metres. Choice: someone who leans farther takes
/// a step.
const LEAN_M: f64 = 0.15;
/// Time constant of the torso following the head, seconds. Choice: about half a step; faster would
/// turn each nod into motion of the hips.
const TORSO_FOLLOW_S: f64 = 0.3;
/// A hand farther from the head than this is not the wearer's, metres. Choice: more than an arm's
/// reach plus a held controller; farther away it lies on a table.
const MAX_HAND_DISTANCE_M: f64 = 1.5;
/// A faster head is a leap of the tracking frame, m/s. Choice: more than anyone runs in a room;
/// recentring moves a head farther within a frame.
const MAX_HEAD_M_PER_S: f64 = 6.0;
/// A faster hand is a tracking error, m/s. Choice: fast throws reach this; more is a tracking
/// error.
const MAX_HAND_M_PER_S: f64 = 15.0;
/// Smoothing time constants of the velocities of head and hands, seconds. Choice: seven frames of a
/// head, four of a hand, which may strike; jitter of a millimetre stays below 0.05 m/s.
const HEAD_SMOOTHING_S: f64 = 0.08;
const HAND_SMOOTHING_S: f64 = 0.04;

/// A body part: a line with a radius and the velocities of its ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limb {
    pub part: BodyPart,
    pub ends: [DVec3; 2],
    pub velocities_m_per_s: [DVec3; 2],
    pub radius_m: f64,
}

impl Limb {
    /// Position on the axis nearest to a point, 0 to 1.
    pub fn share_near(&self, point: DVec3) -> f64 {
        let along = self.ends[1] - self.ends[0];
        let length = along.length_squared();
        if length < 1e-9 { 0.0 } else { ((point - self.ends[0]).dot(along) / length).clamp(0.0, 1.0) }
    }

    /// Point and velocity at a position on the axis.
    pub fn at(&self, share: f64) -> (DVec3, DVec3) {
        let [from, to] = self.ends;
        let [from_moves, to_moves] = self.velocities_m_per_s;
        (from.lerp(to, share), from_moves.lerp(to_moves, share))
    }
}

/// The body at one time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BodyModel {
    pub head_m: DVec3,
    /// The head's forward direction.
    pub ahead: DVec3,
    /// Speed of the head, m/s.
    pub head_speed_m_per_s: f64,
    pub limbs: Vec<Limb>,
}

impl BodyModel {
    /// Standing upright and still; `None` for an invalid pose.
    pub fn still(tracking_from_head: &Pose) -> Option<Self> {
        Self::of(&Wearer::head_only(0, *tracking_from_head), None, [DVec3::ZERO; 4])
    }

    /// With the torso at x and z of `hips`, or straight below the head. Velocities of head, hips,
    /// left and right hand.
    fn of(wearer: &Wearer, hips: Option<DVec3>, velocities: [DVec3; 4]) -> Option<Self> {
        let head = wearer.tracking_from_head.translation;
        let ahead = wearer.tracking_from_head.forward();
        if !is_valid_position(head) || !ahead.is_finite() {
            return None;
        }
        let hips = hips.unwrap_or(head);
        let [head_moves, hips_move, hand_moves @ ..] = velocities;
        let neck = DVec3::new(hips.x, head.y - NECK_M, hips.z);
        let feet = DVec3::new(hips.x, (neck.y - MIN_TORSO_M).min(0.0), hips.z);
        let limb = |part, ends, velocities_m_per_s, radius_m| Limb { part, ends, velocities_m_per_s, radius_m };
        let mut limbs = vec![
            limb(BodyPart::Head, [head, neck], [head_moves, hips_move], HEAD_RADIUS_M),
            limb(BodyPart::Torso, [neck, feet], [hips_move, hips_move], TORSO_RADIUS_M),
        ];
        let right = ahead.cross(DVec3::Y).normalize_or_zero();
        let sides = [(BodyPart::LeftHand, -1.0), (BodyPart::RightHand, 1.0)];
        for ((part, side), (hand, moves)) in sides.into_iter().zip(wearer.hands_m.into_iter().zip(hand_moves)) {
            let Some(hand) = hand.filter(|hand| is_valid_position(*hand) && hand.distance(head) <= MAX_HAND_DISTANCE_M)
            else {
                continue;
            };
            let shoulder = neck + right * (side * SHOULDER_M);
            limbs.push(limb(part, [shoulder, hand], [hips_move, moves], HAND_RADIUS_M));
        }
        Some(Self { head_m: head, ahead, head_speed_m_per_s: head_moves.length(), limbs })
    }
}

/// Estimates the wearer's posture from frame to frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct PostureEstimator {
    head: VelocityFilter,
    hips: VelocityFilter,
    hands: [VelocityFilter; 2],
    /// Time and position of the hips; only x and z are used.
    hips_m: Option<(i64, DVec3)>,
}

impl PostureEstimator {
    /// The body now; `None` for an invalid head pose.
    pub fn update(&mut self, wearer: &Wearer) -> Option<BodyModel> {
        let head = wearer.tracking_from_head.translation;
        if !is_valid_position(head) {
            return None;
        }
        let time_ns = wearer.time_ns;
        let head_moves = self.head.update(time_ns, head, MAX_HEAD_M_PER_S, HEAD_SMOOTHING_S);
        if self.head.has_restarted() {
            *self = Self { head: self.head.clone(), ..Self::default() };
        }
        let hips = self.follow(time_ns, head);
        let hips_move = self.hips.update(time_ns, hips, MAX_HEAD_M_PER_S, HEAD_SMOOTHING_S);
        let mut velocities = [head_moves, DVec3::new(hips_move.x, 0.0, hips_move.z), DVec3::ZERO, DVec3::ZERO];
        for (hand, (velocity, moves)) in wearer.hands_m.iter().zip(self.hands.iter_mut().zip(&mut velocities[2..])) {
            if let Some(hand) = hand.filter(|hand| is_valid_position(*hand)) {
                *moves = velocity.update(time_ns, hand, MAX_HAND_M_PER_S, HAND_SMOOTHING_S);
            }
        }
        BodyModel::of(wearer, Some(hips), velocities)
    }

    fn follow(&mut self, time_ns: i64, head: DVec3) -> DVec3 {
        let Some((then_ns, hips)) = self.hips_m else {
            self.hips_m = Some((time_ns, head));
            return head;
        };
        let passed_s = (time_ns.saturating_sub(then_ns) as f64 * 1e-9).max(0.0);
        let behind = (hips - head) * DVec3::new(1.0, 0.0, 1.0) * math::exp(-passed_s / TORSO_FOLLOW_S);
        let hips = head + behind.clamp_length_max(LEAN_M);
        self.hips_m = Some((time_ns.max(then_ns), hips));
        hips
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_s: f64, position: DVec3) -> Wearer {
        Wearer::head_only((time_s * 1e9) as i64, Pose::from_translation(position))
    }

    fn torso(body_model: &BodyModel) -> Limb {
        *body_model.limbs.iter().find(|limb| limb.part == BodyPart::Torso).unwrap()
    }

    #[test]
    fn torso_lags_leaning_and_follows_walking() {
        let mut posture = PostureEstimator::default();
        for step in 0..100 {
            posture.update(&at(f64::from(step) * 0.01, DVec3::Y * 1.7));
        }
        let lean = |step: i32| {
            at(1.0 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7 - 0.01 * f64::from(step), -0.01 * f64::from(step)))
        };
        let leant = (0..=10).filter_map(|step| posture.update(&lean(step))).last().unwrap();
        assert!(torso(&leant).ends[0].z > -0.03 && leant.limbs[0].ends[0].z == -0.1, "{leant:?}");
        let mut z_m = -0.1;
        for step in 0..200 {
            z_m -= 0.01;
            let walking = posture.update(&at(1.11 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7, z_m))).unwrap();
            assert!(torso(&walking).ends[0].z - z_m <= LEAN_M + 1e-9);
            if step > 100 {
                assert!((walking.limbs[1].velocities_m_per_s[0] + DVec3::Z).length() < 0.01, "{walking:?}");
            }
        }
        for step in 0..200 {
            posture.update(&at(3.2 + f64::from(step) * 0.01, DVec3::new(0.0, 1.7, z_m)));
        }
        let stands = posture.update(&at(5.3, DVec3::new(0.0, 1.7, z_m))).unwrap();
        assert!((torso(&stands).ends[0].z - z_m).abs() < 0.01);
    }

    #[test]
    fn crouching_lowers_the_torso_and_hands_get_arms() {
        let mut wearer = at(0.0, DVec3::Y * 0.9);
        wearer.hands_m = [Some(DVec3::new(-0.5, 0.8, -0.3)), Some(DVec3::splat(f64::NAN))];
        let body_model = PostureEstimator::default().update(&wearer).unwrap();
        assert!((torso(&body_model).ends[0].y - 0.65).abs() < 1e-9);
        let parts: Vec<_> = body_model.limbs.iter().map(|limb| limb.part).collect();
        assert_eq!(parts, [BodyPart::Head, BodyPart::Torso, BodyPart::LeftHand]);
        assert!(body_model.limbs[2].ends[0].x < -0.1, "the left shoulder is to the left");
        wearer.hands_m = [Some(DVec3::new(9.0, 1.0, 0.0)), None];
        assert_eq!(PostureEstimator::default().update(&wearer).unwrap().limbs.len(), 2, "that hand is somebody else's");
        wearer.tracking_from_head.translation.x = f64::NAN;
        assert_eq!(PostureEstimator::default().update(&wearer), None);
    }

    #[test]
    fn tracking_leap_moves_the_body_without_velocity() {
        let mut posture = PostureEstimator::default();
        for step in 0..50 {
            posture.update(&at(f64::from(step) * 0.01, DVec3::new(0.01 * f64::from(step), 1.7, 0.0)));
        }
        let leapt = posture.update(&at(0.5, DVec3::new(3.0, 1.7, 2.0))).unwrap();
        assert_eq!(leapt.limbs, BodyModel::still(&Pose::from_translation(DVec3::new(3.0, 1.7, 2.0))).unwrap().limbs);
    }
}
