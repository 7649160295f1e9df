//! Poses, and what moves them: the track, recentring, a change of universe.

use std::fmt::Write;

use serde_json::json;

use crate::rig::{Rig, alone, until};
use crate::runtime::{Runtime, assert_same, call, from_matrix, placed};
use crate::sys;

const SEATED: u32 = sys::ETrackingUniverseOrigin_TrackingUniverseSeated;
const STANDING: u32 = sys::ETrackingUniverseOrigin_TrackingUniverseStanding;
const RAW: u32 = sys::ETrackingUniverseOrigin_TrackingUniverseRawAndUncalibrated;

fn now_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// The next event of a kind; earlier events of other kinds are discarded.
fn event(runtime: &Runtime, kind: u32) -> sys::VREvent_t {
    until("the event", || runtime.event().filter(|event| event.eventType == kind))
}

#[test]
fn poses_match_the_track_at_the_requested_time() {
    let begin_s = now_s();
    // 0.5 m/s along x and 0.25 rad/s about y for ten minutes; then a gap of 5 s.
    let mut track = String::new();
    for step in 0..60_000 {
        let t = f64::from(step) * 0.01;
        let (sin, cos) = (t / 8.0).sin_cos();
        writeln!(track, "{:.6} {:.6} 1.5 0 0 {sin:.9} 0 {cos:.9}", begin_s + t, 0.5 * t).unwrap();
    }
    writeln!(track, "{:.6} 1000 1.5 0 0 0 0 1", begin_s + 605.0).unwrap();
    let config = json!({ "files": { "head.tum": track }, "track": "head.tum" });
    alone("universes::poses_match_the_track_at_the_requested_time", &config, |rig| {
        let runtime = Runtime::connected();
        let given = crate::rig::read_json(&rig.folder.join("runtime/fake.json"));
        let text = std::fs::read_to_string(given["track"].as_str().unwrap()).unwrap();
        let begin_s: f64 = text.split(' ').next().unwrap().parse().unwrap();
        for ahead_s in [0.0f32, 0.1, 5.0] {
            let before_s = now_s() - begin_s + f64::from(ahead_s);
            let pose = runtime.poses(STANDING, ahead_s)[0];
            let after_s = now_s() - begin_s + f64::from(ahead_s);
            assert!(pose.bPoseIsValid && pose.bDeviceIsConnected);
            let x = from_matrix(&pose.mDeviceToAbsoluteTracking).w_axis.x;
            assert!((0.5 * before_s - 1e-4..=0.5 * after_s + 1e-4).contains(&x), "{before_s} {x} {after_s}");
            assert!((pose.vVelocity.v[0] - 0.5).abs() < 1e-3, "{:?}", pose.vVelocity);
            assert!((pose.vAngularVelocity.v[1] - 0.25).abs() < 1e-3, "{:?}", pose.vAngularVelocity);
        }
        runtime.cleanup();
    });
}

#[test]
fn pose_is_invalid_in_gaps_and_constant_beyond_the_ends() {
    let begin_s = now_s();
    let lines = [(-1.0, 1.0), (-0.99, 2.0), (600.0, 3.0), (600.01, 4.0)];
    let text = lines.map(|(t, x)| format!("{:.6} {x} 0 0 0 0 0 1\n", begin_s + t)).concat();
    let config = json!({ "files": { "gap.tum": text }, "track": "gap.tum", "controllers": ["gap.tum"] });
    alone("universes::pose_is_invalid_in_gaps_and_constant_beyond_the_ends", &config, |_| {
        let runtime = Runtime::connected();
        let [head, controller, none] = runtime.poses(STANDING, 0.0);
        for device in [head, controller] {
            assert!(!device.bPoseIsValid && device.bDeviceIsConnected);
            assert_eq!(device.eTrackingResult, sys::ETrackingResult_TrackingResult_Running_OutOfRange);
        }
        assert!(!none.bPoseIsValid && !none.bDeviceIsConnected);
        runtime.cleanup();
    });
}

#[test]
fn looping_track_plays_back_and_forth() {
    let lines: String =
        (0..=10).map(|i| format!("{:.2} {:.2} 1 0 0 0 0 1\n", f64::from(i) * 0.01, f64::from(i) * 0.1)).collect();
    let config =
        json!({ "files": { "loop.tum": lines }, "track": "loop.tum", "track_is_relative": true, "track_loops": true });
    alone("universes::looping_track_plays_back_and_forth", &config, |_| {
        let runtime = Runtime::connected();
        let (mut there, mut back, mut before) = (false, false, runtime.head(STANDING).w_axis.x);
        until("both directions", || {
            let pose = runtime.poses(STANDING, 0.0)[0];
            let x = from_matrix(&pose.mDeviceToAbsoluteTracking).w_axis.x;
            assert!(pose.bPoseIsValid && (-1e-6..=1.0 + 1e-6).contains(&x), "{x}");
            there |= x > before;
            back |= x < before;
            before = x;
            (there && back).then_some(())
        });
        runtime.cleanup();
    });
}

const CONFIG: &str = r#"{"raw_from_standing": {"position_m": [0.3, -0.05, 0.2], "yaw_deg": 30},
    "raw_from_seated": {"position_m": [1, 2, 3], "yaw_deg": -40}, "universe_id": 77,
    "universe_change": {"position_m": [0.5, 0, -1], "yaw_deg": 90}}"#;

fn config() -> serde_json::Value {
    serde_json::from_str(CONFIG).unwrap()
}

fn universe_id(runtime: &Runtime) -> u64 {
    let mut error = u32::MAX;
    let asked = sys::ETrackedDeviceProperty_Prop_CurrentUniverseId_Uint64;
    let id = call!(runtime.system, GetUint64TrackedDeviceProperty, 0, asked, &mut error);
    assert_eq!(error, 0);
    id
}

/// The matrices between universes must match the poses.
fn assert_consistent(runtime: &Runtime) {
    let standing_from_raw = from_matrix(&call!(runtime.system, GetRawZeroPoseToStandingAbsoluteTrackingPose));
    let standing_from_seated = from_matrix(&call!(runtime.system, GetSeatedZeroPoseToStandingAbsoluteTrackingPose));
    assert_same(runtime.head(STANDING), standing_from_raw * runtime.head(RAW));
    assert_same(runtime.head(STANDING), standing_from_seated * runtime.head(SEATED));
}

#[test]
fn universes_match_the_configuration() {
    alone("universes::universes_match_the_configuration", &config(), |_| {
        let runtime = Runtime::connected();
        let standing_from_head = placed(0.0, [0.0, 1.6, 0.0]);
        let raw_from_standing = placed(30.0, [0.3, -0.05, 0.2]);
        assert_same(runtime.head(STANDING), standing_from_head);
        assert_same(runtime.head(RAW), raw_from_standing * standing_from_head);
        let seated_from_raw = placed(-40.0, [1.0, 2.0, 3.0]).inverse();
        assert_same(runtime.head(SEATED), seated_from_raw * raw_from_standing * standing_from_head);
        assert_consistent(&runtime);
        runtime.cleanup();
    });
}

#[test]
fn recentring_moves_standing_and_not_raw() {
    alone("universes::recentring_moves_standing_and_not_raw", &config(), |rig: &Rig| {
        let runtime = Runtime::connected();
        let (standing, raw, seated) = (runtime.head(STANDING), runtime.head(RAW), runtime.head(SEATED));
        rig.command(&json!({ "do": "recenter", "x": 0.4, "z": -0.2, "yaw_deg": 30 }));
        event(&runtime, sys::EVREventType_VREvent_StandingZeroPoseReset);
        let changed = event(&runtime, sys::EVREventType_VREvent_ChaperoneUniverseHasChanged);
        // SAFETY: the event kind determines the content of the union.
        let current = unsafe { (&raw const changed.data.chaperone.m_nCurrentUniverse).read_unaligned() };
        assert_eq!((current, universe_id(&runtime)), (77, 77));
        let old_from_new = placed(30.0, [0.4, 0.0, -0.2]);
        assert_same(runtime.head(STANDING), old_from_new.inverse() * standing);
        assert_same(runtime.head(RAW), raw);
        assert_same(runtime.head(SEATED), seated);
        assert_consistent(&runtime);
        rig.command(&json!({ "do": "recenter", "x": 1, "universe": "seated" }));
        event(&runtime, sys::EVREventType_VREvent_SeatedZeroPoseReset);
        assert_same(runtime.head(SEATED), placed(0.0, [1.0, 0.0, 0.0]).inverse() * seated);
        assert_same(runtime.head(RAW), raw);
        assert_consistent(&runtime);
        runtime.cleanup();
        assert_eq!(rig.report()["violations"], json!({}));
    });
}

#[test]
fn universe_change_moves_everything_and_renames() {
    alone("universes::universe_change_moves_everything_and_renames", &config(), |rig| {
        let runtime = Runtime::connected();
        let (standing, raw) = (runtime.head(STANDING), runtime.head(RAW));
        rig.command(&json!({ "do": "universe" }));
        event(&runtime, sys::EVREventType_VREvent_ChaperoneUniverseHasChanged);
        assert_eq!(universe_id(&runtime), 78);
        let new_from_old = placed(90.0, [0.5, 0.0, -1.0]).inverse();
        assert_same(runtime.head(RAW), new_from_old * raw);
        let raw_from_standing = placed(30.0, [0.3, -0.05, 0.2]);
        assert_same(runtime.head(STANDING), raw_from_standing.inverse() * new_from_old * raw_from_standing * standing);
        assert_consistent(&runtime);
        runtime.cleanup();
    });
}

#[test]
fn tracking_loss_and_standby_are_reported() {
    alone("universes::tracking_loss_and_standby_are_reported", &json!({}), |rig| {
        let runtime = Runtime::connected();
        rig.command(&json!({ "do": "invalid", "for_s": 3600 }));
        until("a lost pose", || (!runtime.poses(STANDING, 0.0)[0].bPoseIsValid).then_some(()));
        assert!(runtime.poses(STANDING, 0.0)[0].bDeviceIsConnected);
        rig.command(&json!({ "do": "invalid", "for_s": 0 }));
        until("a pose again", || runtime.poses(STANDING, 0.0)[0].bPoseIsValid.then_some(()));
        rig.command(&json!({ "do": "standby" }));
        event(&runtime, sys::EVREventType_VREvent_EnterStandbyMode);
        let standby = sys::EDeviceActivityLevel_k_EDeviceActivityLevel_Standby;
        assert_eq!(call!(runtime.system, GetTrackedDeviceActivityLevel, 0), standby);
        rig.command(&json!({ "do": "wake" }));
        event(&runtime, sys::EVREventType_VREvent_LeaveStandbyMode);
        assert_ne!(call!(runtime.system, GetTrackedDeviceActivityLevel, 0), standby);
        runtime.cleanup();
    });
}
