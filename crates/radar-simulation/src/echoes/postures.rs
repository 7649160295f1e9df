//! Postures of moving bodies: a walking person, the wearer of the headset, a cat.

use glam::{DQuat, DVec3};

use radar_sar::geometry::Pose;
use radar_sar::math;

use super::bodies::{BodyShape, Limb, Posture};

const fn limb(joints: [usize; 2], radius_m: f64, rcs_dbsm: f64, points: usize) -> Limb {
    Limb { joints, radius_m, rcs_dbsm, points, shadows: true }
}

/// A person's joints, in the order of [`Posture::joints_m`].
const PERSON_JOINTS: usize = 21;
const CROWN: usize = 0;
const NECK: usize = 1;
const WAIST: usize = 2;
const PELVIS: usize = 3;
/// Left and right.
const SHOULDER: [usize; 2] = [4, 5];
const ELBOW: [usize; 2] = [6, 7];
const WRIST: [usize; 2] = [8, 9];
const FINGERS: [usize; 2] = [10, 11];
const HIP: [usize; 2] = [12, 13];
const KNEE: [usize; 2] = [14, 15];
const ANKLE: [usize; 2] = [16, 17];
const TOES: [usize; 2] = [18, 19];
const CHIN: usize = 20;

/// Mean cross-sections. Measured for the chest (vendor's recordings, by the loop gain: median −11 to −20
/// dBsm at 1.8 to 2.7 m, so a mean of −13.5, as the power's distribution is exponential); the others. Choice:
/// in proportion to length times radius, and 4 dB less for what is bare or thin.
fn person_limbs() -> Vec<Limb> {
    let mut limbs = vec![
        limb([NECK, WAIST], 0.15, -13.5, 28),
        limb([WAIST, PELVIS], 0.15, -15.0, 16),
        limb([CROWN, CHIN], 0.09, -19.0, 12),
    ];
    for side in 0..2 {
        limbs.extend([
            limb([SHOULDER[side], ELBOW[side]], 0.05, -21.0, 8),
            limb([ELBOW[side], WRIST[side]], 0.04, -23.0, 8),
            limb([WRIST[side], FINGERS[side]], 0.04, -23.0, 6),
            limb([HIP[side], KNEE[side]], 0.08, -18.0, 10),
            limb([KNEE[side], ANKLE[side]], 0.055, -20.0, 10),
            limb([ANKLE[side], TOES[side]], 0.04, -24.0, 6),
        ]);
    }
    limbs
}

/// A person.
pub(crate) fn person_shape(seed: u64) -> BodyShape {
    BodyShape::new(&person_limbs(), seed)
}

/// The headset's wearer: a person with a controller in each hand, whose head does not shadow the sensor on it.
pub(crate) fn wearer_shape(seed: u64) -> BodyShape {
    let mut limbs = person_limbs();
    limbs[2].shadows = false;
    // Controllers: plastic with electronics. Choice: as in the room of point scatterers.
    limbs.extend([0, 1].map(|side| limb([WRIST[side], FINGERS[side]], 0.055, -21.0, 6)));
    BodyShape::new(&limbs, seed)
}

/// A walking or standing person at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Walk {
    /// The place on the floor below the pelvis, metres.
    pub at_m: DVec3,
    /// Unit horizontal direction of the walk.
    pub facing: DVec3,
    /// Phase of the gait, rad: 2π for two steps.
    pub stride_phase_rad: f64,
    /// Length of the steps, against an unhurried walk: 1; standing: 0.
    pub stride: f64,
}

/// Lengths of an adult, metres. Source: DIN 33402-2, between the medians of women and men.
const THIGH_M: f64 = 0.43;
const SHIN_M: f64 = 0.42;
const ANKLE_M: f64 = 0.08;
const UPPER_ARM_M: f64 = 0.30;
const FOREARM_M: f64 = 0.26;
const HAND_M: f64 = 0.15;

/// Greatest angles of the limbs in a walk, rad. Source: Perry, Gait Analysis: hip ±20°, knee up to 60° in
/// swing; arms ±20°.
const HIP_SWING_RAD: f64 = 0.36;
const KNEE_SWING_RAD: f64 = 0.9;
const ARM_SWING_RAD: f64 = 0.35;

/// A person who walks.
pub(crate) fn walking_person(walk: &Walk) -> Posture {
    let (facing, up) = (walk.facing, DVec3::Y);
    let right = facing.cross(up);
    let along = |angle: f64| facing * math::sin(angle) - up * math::cos(angle);
    let bob_m = 0.015 * walk.stride * (1.0 - math::cos(2.0 * walk.stride_phase_rad));
    let pelvis = walk.at_m + up * (THIGH_M + SHIN_M + ANKLE_M - bob_m);
    let mut joints_m = vec![DVec3::ZERO; PERSON_JOINTS];
    joints_m[PELVIS] = pelvis;
    joints_m[WAIST] = pelvis + up * 0.20;
    joints_m[NECK] = pelvis + up * 0.53;
    joints_m[CHIN] = pelvis + up * 0.60 + facing * 0.02;
    joints_m[CROWN] = pelvis + up * 0.78 + facing * 0.02;
    for (side, sign) in [(0, -1.0), (1, 1.0)] {
        let phase = walk.stride_phase_rad + if side == 0 { 0.0 } else { std::f64::consts::PI };
        let swing = math::sin(phase) * walk.stride;
        let hip = pelvis + right * (0.09 * sign);
        let thigh = HIP_SWING_RAD * swing;
        // The knee bends while the leg swings forwards.
        let bend = KNEE_SWING_RAD * walk.stride * (0.5 * (1.0 + math::cos(phase))).powi(2) + 0.05;
        joints_m[HIP[side]] = hip;
        joints_m[KNEE[side]] = hip + along(thigh) * THIGH_M;
        joints_m[ANKLE[side]] = joints_m[KNEE[side]] + along(thigh - bend) * SHIN_M;
        joints_m[TOES[side]] = joints_m[ANKLE[side]] + facing * 0.2 - up * 0.05;
        let arm = -ARM_SWING_RAD * swing;
        joints_m[SHOULDER[side]] = pelvis + up * 0.48 + right * (0.2 * sign);
        joints_m[ELBOW[side]] = joints_m[SHOULDER[side]] + along(arm) * UPPER_ARM_M + right * (0.04 * sign);
        joints_m[WRIST[side]] = joints_m[ELBOW[side]] + along(arm + 0.3) * FOREARM_M;
        joints_m[FINGERS[side]] = joints_m[WRIST[side]] + along(arm + 0.3) * HAND_M;
    }
    Posture { joints_m, facing }
}

/// From the eyes to the shoulders and the base of the neck, metres; −z is ahead. Choice: as in the session's
/// hands.
const EYES_TO_SHOULDER_M: DVec3 = DVec3::new(0.19, -0.28, 0.08);

/// The wearer: `room_from_head` (between the eyes), the chest's direction and both palms, left and right.
pub(crate) fn wearer(head: &Pose, facing: DVec3, palms_m: [DVec3; 2]) -> Posture {
    let turn = DQuat::from_rotation_y(math::atan2(-facing.x, -facing.z));
    let body = |offset: DVec3| head.translation + turn * offset;
    let mut joints_m = vec![DVec3::ZERO; PERSON_JOINTS];
    joints_m[CROWN] = head.transform_point(DVec3::new(0.0, 0.08, 0.10));
    joints_m[CHIN] = head.transform_point(DVec3::new(0.0, -0.10, 0.08));
    joints_m[NECK] = body(DVec3::new(0.0, -0.25, 0.10));
    joints_m[WAIST] = body(DVec3::new(0.0, -0.55, 0.10));
    let pelvis = body(DVec3::new(0.0, -0.74, 0.10));
    joints_m[PELVIS] = DVec3::new(pelvis.x, pelvis.y.max(0.2), pelvis.z);
    for (side, sign) in [(0, -1.0), (1, 1.0)] {
        let shoulder = body(EYES_TO_SHOULDER_M * DVec3::new(sign, 1.0, 1.0));
        let to_palm = (palms_m[side] - shoulder).normalize_or(DVec3::NEG_Y);
        let wrist = palms_m[side] - to_palm * 0.07;
        joints_m[SHOULDER[side]] = shoulder;
        joints_m[ELBOW[side]] = knee(shoulder, wrist, UPPER_ARM_M, FOREARM_M, DVec3::NEG_Y);
        joints_m[WRIST[side]] = wrist;
        joints_m[FINGERS[side]] = palms_m[side] + to_palm * 0.08;
        let hip = joints_m[PELVIS] + turn * DVec3::X * (0.09 * sign);
        let ankle = DVec3::new(hip.x, ANKLE_M, hip.z) + turn * DVec3::X * (0.06 * sign);
        joints_m[HIP[side]] = hip;
        joints_m[KNEE[side]] = knee(hip, ankle, THIGH_M, SHIN_M, turn * DVec3::NEG_Z);
        joints_m[ANKLE[side]] = ankle;
        joints_m[TOES[side]] = ankle + turn * DVec3::NEG_Z * 0.2 - DVec3::Y * 0.05;
    }
    Posture { joints_m, facing }
}

/// The joint between two bones of these lengths, bent towards a direction.
fn knee(from_m: DVec3, to_m: DVec3, upper_m: f64, lower_m: f64, towards: DVec3) -> DVec3 {
    let way = to_m - from_m;
    let length_m = way.length().max(1e-6);
    let share = ((length_m * length_m + upper_m * upper_m - lower_m * lower_m) / (2.0 * length_m)).clamp(0.0, upper_m);
    let share = if length_m > upper_m + lower_m { 0.5 * length_m } else { share };
    let off_m = (upper_m * upper_m - share * share).max(0.0).sqrt();
    let axis = way / length_m;
    from_m + axis * share + (towards - axis * towards.dot(axis)).normalize_or_zero() * off_m
}

/// A cat's joints: nose, neck, rump, tip of the tail, shoulders, hips and paws.
const CAT_JOINTS: usize = 12;

/// A cat. Choice of cross-sections: a chest's per area; no measurement was found.
pub(crate) fn cat_shape(seed: u64) -> BodyShape {
    let mut limbs = vec![limb([1, 2], 0.07, -21.0, 14), limb([0, 1], 0.045, -27.0, 8), limb([2, 3], 0.015, -36.0, 5)];
    limbs.extend((0..4).map(|leg| limb([4 + leg, 8 + leg], 0.018, -34.0, 4)));
    BodyShape::new(&limbs, seed)
}

/// A walking cat, at a place on the floor below its middle.
pub(crate) fn walking_cat(at_m: DVec3, facing: DVec3, stride_phase_rad: f64) -> Posture {
    let right = facing.cross(DVec3::Y);
    let at = |ahead: f64, side: f64, up: f64| at_m + facing * ahead + right * side + DVec3::Y * up;
    let mut joints_m = vec![DVec3::ZERO; CAT_JOINTS];
    joints_m[0] = at(0.27, 0.0, 0.27);
    joints_m[1] = at(0.15, 0.0, 0.23);
    joints_m[2] = at(-0.15, 0.0, 0.22);
    joints_m[3] = at(-0.38, 0.06 * math::sin(0.5 * stride_phase_rad), 0.32);
    for (leg, (ahead, side, phase)) in
        [(0.13, -0.05, 0.0), (0.13, 0.05, 3.1), (-0.13, -0.05, 3.1), (-0.13, 0.05, 0.0)].into_iter().enumerate()
    {
        let swing = math::sin(stride_phase_rad + phase);
        joints_m[4 + leg] = at(ahead, side, 0.20);
        joints_m[8 + leg] = at(ahead + 0.07 * swing, side, 0.02);
    }
    Posture { joints_m, facing }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walking_person_keeps_bone_lengths_and_feet_near_the_floor() {
        for n in 0..40 {
            let walk = Walk { at_m: DVec3::X, facing: DVec3::Z, stride_phase_rad: 0.16 * f64::from(n), stride: 1.0 };
            let Posture { joints_m, .. } = walking_person(&walk);
            for side in 0..2 {
                assert!((joints_m[HIP[side]].distance(joints_m[KNEE[side]]) - THIGH_M).abs() < 1e-9);
                assert!((joints_m[KNEE[side]].distance(joints_m[ANKLE[side]]) - SHIN_M).abs() < 1e-9);
            }
            let lowest = joints_m[ANKLE[0]].y.min(joints_m[ANKLE[1]].y);
            assert!((0.03..0.16).contains(&lowest), "{lowest} at {n}");
            assert!((1.6..1.75).contains(&joints_m[CROWN].y));
        }
    }

    #[test]
    fn wearers_arms_reach_the_palms_and_legs_the_floor() {
        for height_m in [1.65, 1.1] {
            let head = Pose::from_translation(DVec3::new(0.2, height_m, 0.0));
            let palms_m = [DVec3::new(0.0, height_m - 0.5, -0.3), DVec3::new(0.45, height_m - 0.3, -0.5)];
            let Posture { joints_m, .. } = wearer(&head, DVec3::NEG_Z, palms_m);
            for side in 0..2 {
                assert!(joints_m[WRIST[side]].distance(palms_m[side]) < 0.08);
                let upper_m = joints_m[SHOULDER[side]].distance(joints_m[ELBOW[side]]);
                assert!((0.15..0.36).contains(&upper_m), "{upper_m}");
                assert!(joints_m[ANKLE[side]].y < 0.1 && joints_m[KNEE[side]].y < joints_m[PELVIS].y + 0.3);
            }
        }
    }
}
