//! Calls in order and out of order, invalid calls, and shutdown.

use std::ffi::CStr;
use std::os::unix::process::ExitStatusExt;

use serde_json::json;

use crate::rig::{Rig, alone, until};
use crate::runtime::{Runtime, call, placed, text, to_matrix};
use crate::sys;

const STANDING: u32 = sys::ETrackingUniverseOrigin_TrackingUniverseStanding;
const FAILED: u32 = sys::EVROverlayError_VROverlayError_RequestFailed;
const UNKNOWN: u32 = sys::EVROverlayError_VROverlayError_UnknownOverlay;
const BAD_PARAMETER: u32 = sys::EVROverlayError_VROverlayError_InvalidParameter;
const TIMED_OUT: u32 = sys::EVROverlayError_VROverlayError_TimedOut;

#[test]
fn overlay_properties_roundtrip() {
    alone("calls::overlay_properties_roundtrip", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let table = runtime.overlay;
        let handle = runtime.create(c"test.panel");
        let mut found = 0;
        assert_eq!(call!(table, FindOverlay, text(c"test.panel"), &mut found), 0);
        assert_eq!(found, handle);
        assert_eq!(call!(table, FindOverlay, text(c"test.other"), &mut found), UNKNOWN);
        let (mut alpha, mut width_m, mut order, mut set) = (0.0, 0.0, 0, false);
        assert_eq!(call!(table, SetOverlayAlpha, handle, 0.25), 0);
        assert_eq!(call!(table, GetOverlayAlpha, handle, &mut alpha), 0);
        assert_eq!(call!(table, SetOverlayWidthInMeters, handle, 1.5), 0);
        assert_eq!(call!(table, GetOverlayWidthInMeters, handle, &mut width_m), 0);
        assert_eq!(call!(table, SetOverlaySortOrder, handle, 7), 0);
        assert_eq!(call!(table, GetOverlaySortOrder, handle, &mut order), 0);
        let flag = sys::VROverlayFlags_IsPremultiplied;
        assert_eq!(call!(table, SetOverlayFlag, handle, flag, true), 0);
        assert_eq!(call!(table, GetOverlayFlag, handle, flag, &mut set), 0);
        assert_eq!((alpha, width_m, order, set), (0.25, 1.5, 7, true));
        let mut matrix = to_matrix(placed(20.0, [1.0, 2.0, 3.0]));
        assert_eq!(call!(table, SetOverlayTransformAbsolute, handle, STANDING, &mut matrix), 0);
        let (mut origin, mut back) = (9, to_matrix(placed(0.0, [0.0; 3])));
        assert_eq!(call!(table, GetOverlayTransformAbsolute, handle, &mut origin, &mut back), 0);
        assert_eq!(origin, STANDING);
        assert!(back.m.iter().flatten().zip(matrix.m.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6));
        assert!(!call!(table, IsOverlayVisible, handle));
        assert_eq!(call!(table, ShowOverlay, handle), 0);
        assert!(call!(table, IsOverlayVisible, handle));
        assert_eq!(call!(table, DestroyOverlay, handle), 0);
        runtime.create(c"test.left");
        runtime.cleanup();
        let report = rig.report();
        assert_eq!((&report["violations"], &report["left_at_cleanup"]), (&json!({}), &json!(1)));
        assert_eq!(report["calls"]["CreateOverlay"], 2);
    });
}

/// Invalid calls, each with the violation that it is recorded as.
fn wrong_calls(runtime: &Runtime) -> Vec<(&'static str, u32, u32)> {
    let table = runtime.overlay;
    let (handle, gone) = (runtime.create(c"test.panel"), runtime.create(c"test.gone"));
    assert_eq!(call!(table, DestroyOverlay, gone), 0);
    let mut rigid = to_matrix(placed(20.0, [1.0, 2.0, 3.0]));
    let mut stretched = rigid;
    stretched.m[0].iter_mut().for_each(|v| *v *= 1.1);
    let mut mirrored = rigid;
    mirrored.m.iter_mut().for_each(|row| row[0] = -row[0]);
    let mut infinite = rigid;
    infinite.m[2][3] = f32::NAN;
    let mut other = 0;
    let null = std::ptr::null_mut;
    let mut backwards = sys::VROverlayProjection_t { fLeft: 1.0, fRight: -1.0, fTop: -1.0, fBottom: 1.0 };
    let mut bounds = sys::VRTextureBounds_t { uMin: 0.0, vMin: 0.0, uMax: 7.0, vMax: 1.0 };
    let absolute =
        |matrix: &mut sys::HmdMatrix34_t| call!(table, SetOverlayTransformAbsolute, handle, STANDING, matrix);
    let mut bytes = [0u8; 4];
    let raw = call!(table, SetOverlayRaw, handle, bytes.as_mut_ptr().cast(), 1, 1, 4);
    vec![
        ("unknown overlay handle", call!(table, ShowOverlay, 12345), UNKNOWN),
        ("destroyed overlay handle", call!(table, ShowOverlay, gone), UNKNOWN),
        ("SetOverlayAlpha: not a possible value", call!(table, SetOverlayAlpha, handle, 1.5), BAD_PARAMETER),
        (
            "SetOverlayWidthInMeters: not a possible value",
            call!(table, SetOverlayWidthInMeters, handle, 0.0),
            BAD_PARAMETER,
        ),
        (
            "SetOverlayTexelAspect: not a possible value",
            call!(table, SetOverlayTexelAspect, handle, f32::NAN),
            BAD_PARAMETER,
        ),
        ("transform is not rigid", absolute(&mut stretched), BAD_PARAMETER),
        ("transform is not rigid", absolute(&mut mirrored), BAD_PARAMETER),
        ("transform is not rigid", absolute(&mut infinite), BAD_PARAMETER),
        ("null pointer", call!(table, SetOverlayTransformAbsolute, handle, STANDING, null()), BAD_PARAMETER),
        ("no such universe", call!(table, SetOverlayTransformAbsolute, handle, 3, &mut rigid), BAD_PARAMETER),
        (
            "projection not possible",
            call!(table, SetOverlayTransformProjection, handle, STANDING, &mut rigid, &mut backwards, 0),
            BAD_PARAMETER,
        ),
        (
            "SetOverlayTextureBounds: not possible",
            call!(table, SetOverlayTextureBounds, handle, &mut bounds),
            BAD_PARAMETER,
        ),
        ("no such flag", call!(table, SetOverlayFlag, handle, 3, true), BAD_PARAMETER),
        ("no such colour space", call!(table, SetOverlayTextureColorSpace, handle, 9), BAD_PARAMETER),
        (
            "overlay key in use",
            call!(table, CreateOverlay, text(c"test.panel"), text(c"test"), &mut other),
            sys::EVROverlayError_VROverlayError_KeyInUse,
        ),
        (
            "key or name too long",
            call!(table, CreateOverlay, text(LONG), text(c"test"), &mut other),
            sys::EVROverlayError_VROverlayError_KeyTooLong,
        ),
        ("SetOverlayRaw is not for frames", raw, FAILED),
        (
            "not in the fake runtime: IVROverlay::SetOverlayFromFile",
            call!(table, SetOverlayFromFile, handle, text(c"a")),
            FAILED,
        ),
    ]
}

/// 128 bytes and the terminator.
const LONG: &CStr = c"0123456789012345678901234567890123456789012345678901234567890123456789012345678901234567890123456789012345678901234567890123456789";

/// Textures that are rejected before they reach Vulkan.
fn wrong_textures(runtime: &Runtime) -> Vec<(&'static str, u32, u32)> {
    const BAD_TEXTURE: u32 = sys::EVROverlayError_VROverlayError_InvalidTexture;
    let handle = runtime.create(c"test.texture");
    let sound = sys::VRVulkanTextureData_t {
        m_nImage: 1,
        m_pDevice: 8 as *mut _,
        m_pPhysicalDevice: 8 as *mut _,
        m_pInstance: 8 as *mut _,
        m_pQueue: 8 as *mut _,
        m_nQueueFamilyIndex: 0,
        m_nWidth: 64,
        m_nHeight: 64,
        m_nFormat: 43,
        m_nSampleCount: 1,
    };
    let submit = |mut data: sys::VRVulkanTextureData_t, kind: i32| {
        let data: *mut sys::VRVulkanTextureData_t = &mut data;
        let mut texture = sys::Texture_t { handle: data.cast(), eType: kind, eColorSpace: 0 };
        call!(runtime.overlay, SetOverlayTexture, handle, &mut texture)
    };
    let vulkan = sys::ETextureType_TextureType_Vulkan;
    let null = std::ptr::null_mut();
    vec![
        ("texture that is not Vulkan's", submit(sound, sys::ETextureType_TextureType_OpenGL), BAD_TEXTURE),
        ("null handle", submit(sys::VRVulkanTextureData_t { m_pQueue: null, ..sound }, vulkan), BAD_TEXTURE),
        ("size of a texture", submit(sys::VRVulkanTextureData_t { m_nWidth: 0, ..sound }, vulkan), BAD_TEXTURE),
        ("size of a texture", submit(sys::VRVulkanTextureData_t { m_nHeight: 4097, ..sound }, vulkan), BAD_TEXTURE),
        ("format of a texture", submit(sys::VRVulkanTextureData_t { m_nFormat: 97, ..sound }, vulkan), BAD_TEXTURE),
        (
            "samples of a texture",
            submit(sys::VRVulkanTextureData_t { m_nSampleCount: 4, ..sound }, vulkan),
            BAD_TEXTURE,
        ),
    ]
}

#[test]
fn wrong_calls_fail_and_are_reported() {
    alone("calls::wrong_calls_fail_and_are_reported", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let calls: Vec<_> = wrong_calls(&runtime).into_iter().chain(wrong_textures(&runtime)).collect();
        // Violations that can only be detected at the end of a frame.
        let bare = runtime.create(c"test.bare");
        assert_eq!(call!(runtime.overlay, ShowOverlay, bare), 0);
        call!(runtime.overlay, WaitFrameSync, 100);
        assert_eq!(
            runtime.init_as(sys::EVRApplicationType_VRApplication_Overlay),
            sys::EVRInitError_VRInitError_Init_Internal
        );
        call!(runtime.system, AcknowledgeQuit_Exiting);
        runtime.cleanup();
        assert_eq!(call!(runtime.overlay, ShowOverlay, bare), FAILED);
        let violations = rig.report()["violations"].clone();
        for (kind, error, expected) in &calls {
            assert_eq!(error, expected, "{kind}");
            let count = calls.iter().filter(|other| other.0 == *kind).count();
            assert_eq!(violations[kind]["count"], count, "{kind} in {violations:#}");
        }
        let at_the_end = [
            "shown without a texture",
            "shown without a transform",
            "Init without Cleanup",
            "called after Cleanup",
            "quit acknowledged without being asked",
        ];
        for kind in at_the_end {
            assert_eq!(violations[kind]["count"], 1, "{kind} in {violations:#}");
        }
        let kinds: std::collections::BTreeSet<_> = calls.iter().map(|call| call.0).chain(at_the_end).collect();
        assert_eq!(violations.as_object().unwrap().len(), kinds.len(), "{violations:#}");
    });
}

#[test]
fn projections_need_both_eyes_and_overlays_are_limited() {
    alone("calls::projections_need_both_eyes_and_overlays_are_limited", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let mut matrix = to_matrix(placed(0.0, [0.0; 3]));
        let mut edges = sys::VROverlayProjection_t { fLeft: -1.0, fRight: 1.0, fTop: -1.0, fBottom: 1.0 };
        let handle = runtime.create(c"test.left");
        let set = call!(runtime.overlay, SetOverlayTransformProjection, handle, STANDING, &mut matrix, &mut edges, 0);
        assert_eq!((set, call!(runtime.overlay, ShowOverlay, handle)), (0, 0));
        call!(runtime.overlay, WaitFrameSync, 100);
        for number in 1..128 {
            let key = std::ffi::CString::new(format!("test.{number}")).unwrap();
            runtime.create(&key);
        }
        let (mut other, key) = (0, text(c"test.one.too.many"));
        let error = call!(runtime.overlay, CreateOverlay, key, key, &mut other);
        assert_eq!(error, sys::EVROverlayError_VROverlayError_OverlayLimitExceeded);
        runtime.cleanup();
        let report = rig.report();
        assert_eq!(report["violations"]["projection for one eye only"]["count"], 1);
        assert_eq!(report["violations"]["too many overlays"]["count"], 1);
        assert_eq!(report["left_at_cleanup"], 128);
    });
}

#[test]
fn textures_from_a_second_thread_are_reported() {
    alone("calls::textures_from_a_second_thread_are_reported", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let handle = runtime.create(c"test.panel");
        let table = runtime.overlay;
        let submit = move || call!(table, SetOverlayTexture, handle, std::ptr::null_mut());
        assert_eq!(submit(), BAD_PARAMETER);
        assert_eq!(std::thread::spawn(submit).join().unwrap(), BAD_PARAMETER);
        assert_eq!(submit(), BAD_PARAMETER);
        runtime.cleanup();
        let violations = rig.report()["violations"].clone();
        assert_eq!(violations["SetOverlayTexture from more than one thread"]["count"], 1, "{violations:#}");
        assert_eq!(violations["null pointer"]["count"], 3);
    });
}

#[test]
fn dashboard_tab_and_thumbnail_are_destroyed_together() {
    alone("calls::dashboard_tab_and_thumbnail_are_destroyed_together", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let (mut main, mut thumbnail) = (0, 0);
        let key = text(c"test.tab");
        let table = runtime.overlay;
        assert_eq!(call!(table, CreateDashboardOverlay, key, key, &mut main, &mut thumbnail), 0);
        assert!(main != 0 && thumbnail != 0 && main != thumbnail);
        assert_eq!(call!(table, SetOverlayInputMethod, main, 1), 0);
        assert_eq!(call!(table, DestroyOverlay, main), 0);
        assert_eq!(call!(table, SetOverlayWidthInMeters, thumbnail, 1.0), UNKNOWN);
        runtime.cleanup();
        assert_eq!(rig.report()["left_at_cleanup"], 0);
    });
}

/// Whether a function table has no null pointer.
fn is_whole<T>(table: &T) -> bool {
    let words = size_of::<T>() / size_of::<usize>();
    // SAFETY: a table consists only of pointers.
    let words = unsafe { std::slice::from_raw_parts(std::ptr::from_ref(table).cast::<usize>(), words) };
    words.iter().all(|word| *word != 0)
}

#[test]
fn function_tables_have_no_null_pointers() {
    alone("calls::function_tables_have_no_null_pointers", &json!({}), |rig| {
        let runtime = Runtime::connected();
        assert!(is_whole(runtime.system) && is_whole(runtime.overlay) && is_whole(runtime.compositor));
        assert!(is_whole(runtime.applications) && is_whole(runtime.chaperone) && is_whole(runtime.settings));
        let (null, none) = (std::ptr::null_mut(), std::ptr::null_mut());
        let error = call!(runtime.compositor, WaitGetPoses, null, 0, none, 0);
        assert_eq!(error, sys::EVRCompositorError_VRCompositorError_RequestFailed);
        runtime.cleanup();
        assert_eq!(rig.report()["violations"]["not in the fake runtime: IVRCompositor::WaitGetPoses"]["count"], 1);
    });
}

#[test]
fn sdk_version_is_recorded_from_c_and_cpp() {
    alone("calls::sdk_version_is_recorded_from_c_and_cpp", &json!({}), |rig| {
        let runtime = Runtime::connected();
        assert_eq!(runtime.set_sdk_version_in_cpp([2, 14, 3]), 0);
        until("the report", || (rig.try_report()?["sdk_version"] == json!([2, 14, 3])).then_some(()));
        assert_eq!(call!(runtime.system, SetSDKVersion, 2, 15, 6), 0);
        runtime.cleanup();
        assert_eq!(rig.report()["sdk_version"], json!([2, 15, 6]));
    });
}

#[test]
fn frames_are_sequential_and_missed_ones_counted() {
    alone("calls::frames_are_sequential_and_missed_ones_counted", &json!({}), |rig| {
        let runtime = Runtime::connected();
        let mut error = 1;
        let asked = sys::ETrackedDeviceProperty_Prop_DisplayFrequency_Float;
        assert_eq!(call!(runtime.system, GetFloatTrackedDeviceProperty, 0, asked, &mut error), 90.0);
        let frame = || {
            let (mut seconds, mut frame) = (0.0, 0);
            assert!(call!(runtime.system, GetTimeSinceLastVsync, &mut seconds, &mut frame));
            assert!((0.0..0.0112).contains(&seconds), "{seconds}");
            frame
        };
        let first = frame();
        for waited in 1..=20 {
            assert_eq!(call!(runtime.overlay, WaitFrameSync, 1000), 0);
            assert!(frame() >= first + waited);
        }
        // Nine frames begin meanwhile, more on a busy machine.
        std::thread::sleep(std::time::Duration::from_millis(100));
        assert_eq!(call!(runtime.overlay, WaitFrameSync, 1000), 0);
        // A zero timeout is shorter than the rest of a frame, except rarely; then it is tried
        // again.
        until("a wait that is too short", || (call!(runtime.overlay, WaitFrameSync, 0) == TIMED_OUT).then_some(()));
        runtime.cleanup();
        assert!(rig.report()["frames_missed"].as_u64().unwrap() >= 8, "{:#}", rig.report());
    });
}

#[test]
fn server_shutdown_is_requested_and_timed() {
    alone("calls::server_shutdown_is_requested_and_timed", &json!({}), |rig| {
        let runtime = Runtime::connected();
        rig.end_server();
        until("the event", || runtime.event().filter(|event| event.eventType == sys::EVREventType_VREvent_Quit));
        call!(runtime.system, AcknowledgeQuit_Exiting);
        runtime.cleanup();
        let report = rig.report();
        assert_eq!(report["violations"], json!({}));
        let times = ["quit_asked_s", "quit_delivered_s", "quit_acknowledged_s", "cleanup_s"]
            .map(|name| report[name].as_f64().unwrap_or_else(|| panic!("{name} is missing in {report:#}")));
        assert!(times.is_sorted(), "{times:?}");
        // The server has waited for this client and exits.
        let lock = std::fs::File::open(rig.folder.join("runtime/server.lock")).unwrap();
        until("the end of the server", || lock.try_lock_shared().ok());
    });
}

#[test]
fn killed_server_fails_calls() {
    alone("calls::killed_server_fails_calls", &json!({}), |rig: &Rig| {
        let runtime = Runtime::connected();
        let handle = runtime.create(c"test.panel");
        assert!(runtime.poses(STANDING, 0.0)[0].bDeviceIsConnected);
        rig.kill_server();
        until("poses that end", || (!runtime.poses(STANDING, 0.0)[0].bDeviceIsConnected).then_some(()));
        let pose = runtime.poses(STANDING, 0.0)[0];
        assert!(!pose.bPoseIsValid);
        assert_eq!(call!(runtime.overlay, SetOverlayAlpha, handle, 0.5), FAILED);
        assert_eq!(call!(runtime.overlay, WaitFrameSync, 20), TIMED_OUT);
        rig.command(&json!({ "do": "quit" }));
        until("the command to be read", || (rig.try_report()?["commands"] == 1).then_some(()));
        assert!(runtime.event().is_none());
        runtime.cleanup();
        assert_eq!((&rig.report()["violations"], &rig.report()["server_alive"]), (&json!({}), &json!(false)));
        let errors = [
            (
                sys::EVRApplicationType_VRApplication_Background,
                sys::EVRInitError_VRInitError_Init_NoServerForBackgroundApp,
            ),
            (sys::EVRApplicationType_VRApplication_Overlay, sys::EVRInitError_VRInitError_IPC_ServerInitFailed),
        ];
        for (kind, error) in errors {
            assert_eq!(runtime.init_as(kind), error);
        }
    });
}

#[test]
fn scripted_failures_are_counted() {
    let config = json!({ "events": [{ "at_s": 0.0, "do": "fail", "function": "SetOverlayAlpha", "count": 3 }] });
    alone("calls::scripted_failures_are_counted", &config, |_| {
        let runtime = Runtime::connected();
        let handle = runtime.create(c"test.panel");
        let fails = || (call!(runtime.overlay, SetOverlayAlpha, handle, 0.5) == FAILED).then_some(());
        until("the first failure", fails);
        assert_eq!([fails(), fails(), fails(), fails()], [Some(()), Some(()), None, None]);
        runtime.cleanup();
    });
}

#[test]
fn play_area_and_color_follow_the_configuration() {
    alone(
        "calls::play_area_and_color_follow_the_configuration",
        &json!({ "chaperone": { "size_m": [2, 3] } }),
        |rig| {
            let runtime = Runtime::connected();
            let (mut x, mut z) = (0.0, 0.0);
            assert!(call!(runtime.chaperone, GetPlayAreaSize, &mut x, &mut z));
            assert_eq!((x, z), (2.0, 3.0));
            let black = sys::HmdColor_t { r: 0.0, g: 0.0, b: 0.0, a: 0.0 };
            let color = || {
                let (mut color, mut camera) = (black, black);
                call!(runtime.chaperone, GetBoundsColor, &mut color, 1, 0.5, &mut camera);
                [color.r, color.g, color.b, color.a].map(|part| (part * 255.0).round() as i32)
            };
            assert_eq!(color(), [0, 255, 255, 153]);
            rig.command(&json!({ "do": "color", "r": 200, "g": 10, "b": 20, "a": 99 }));
            until("the event", || {
                let kind = sys::EVREventType_VREvent_ChaperoneSettingsHaveChanged;
                runtime.event().filter(|event| event.eventType == kind)
            });
            assert_eq!(color(), [200, 10, 20, 99]);
            let section = text(sys::k_pch_CollisionBounds_Section);
            let mut error = 9;
            let fade = text(sys::k_pch_CollisionBounds_FadeDistance_Float);
            assert_eq!(call!(runtime.settings, GetFloat, section, fade, &mut error), 0.7);
            assert_eq!(error, 0);
            call!(runtime.settings, SetFloat, section, fade, 1.25, &mut error);
            assert_eq!(call!(runtime.settings, GetFloat, section, fade, &mut error), 1.25);
            call!(runtime.settings, GetFloat, section, text(c"NoSuchKey"), &mut error);
            assert_eq!(error, sys::EVRSettingsError_VRSettingsError_UnsetSettingHasNoDefault);
            runtime.cleanup();
        },
    );
}

#[test]
fn second_server_in_a_folder_is_rejected() {
    let folder = crate::rig::folder("second");
    let server = crate::rig::Server::start(folder.clone(), &json!({}), &[]);
    let run = crate::rig::server_command(&folder).output().unwrap();
    assert!(!run.status.success() && run.status.signal().is_none());
    assert!(String::from_utf8_lossy(&run.stderr).contains("another server"), "{run:?}");
    drop(server);
}
