//! IVRSystem: devices, their poses and properties, events, the display's timing.

use std::ffi::{c_char, c_void};

use radar_sar::geometry::Pose;

use crate::clock::now_ns;
use crate::config::Defect;
use crate::memory::{write, write_all, write_part, write_text};
use crate::poses::{matrix, no_pose};
use crate::table::{table, text};
use crate::world::{World, call};
use crate::{sys, table};

const OK: u32 = sys::ETrackedPropertyError_TrackedProp_Success;
const INVALID_DEVICE: u32 = sys::ETrackedPropertyError_TrackedProp_InvalidDevice;
const NOT_PROVIDED: u32 = sys::ETrackedPropertyError_TrackedProp_ValueNotProvidedByDevice;
const NO_CONTACT: u32 = sys::ETrackedPropertyError_TrackedProp_CouldNotContactServer;
const TOO_SMALL: u32 = sys::ETrackedPropertyError_TrackedProp_BufferTooSmall;
const NO_DEVICE: u32 = u32::MAX;

unsafe extern "C" fn render_target_size(width: *mut u32, height: *mut u32) {
    call("GetRecommendedRenderTargetSize", 0, |world| {
        let [w, h] = world.config.display.render_target;
        write(width, w);
        write(height, h);
    });
}

/// The tangents of an eye, as in the interface: `top` is the lower edge and negative, `bottom` the
/// upper edge.
unsafe extern "C" fn projection_raw(eye: u32, left: *mut f32, right: *mut f32, top: *mut f32, bottom: *mut f32) {
    call("GetProjectionRaw", 0, |world| {
        let edges = world.eye_edges(eye == sys::EVREye_Eye_Left);
        write(left, edges.left as f32);
        write(right, edges.right as f32);
        write(top, edges.down as f32);
        write(bottom, edges.up as f32);
    });
}

unsafe extern "C" fn eye_to_head(eye: u32) -> sys::HmdMatrix34_t {
    call("GetEyeToHeadTransform", 0, |world| matrix(&world.head_from_eye(eye == sys::EVREye_Eye_Left)))
}

unsafe extern "C" fn since_vsync(seconds: *mut f32, frame: *mut u64) -> bool {
    call("GetTimeSinceLastVsync", 0, |world| {
        let now_ns = now_ns();
        let number = world.frames.at(now_ns);
        write(seconds, ((now_ns - world.frames.start_ns(number)) as f64 * 1e-9) as f32);
        write(frame, number.max(0) as u64);
        world.server.alive(now_ns)
    })
}

unsafe extern "C" fn output_device(device: *mut u64, kind: i32, instance: *mut sys::VkInstance_T) {
    call("GetOutputDevice", 0, |world| {
        write(device, 0);
        if kind != sys::ETextureType_TextureType_Vulkan {
            return world.report.violation("GetOutputDevice for an API other than Vulkan", format!("type {kind}"));
        }
        match crate::vulkan::output_device(instance, world.config.gpu.as_deref()) {
            Ok(found) => write(device, found),
            Err(why) => world.report.violation("GetOutputDevice finds no device", why),
        }
    });
}

unsafe extern "C" fn poses(origin: u32, ahead_s: f32, poses: *mut sys::TrackedDevicePose_t, room: u32) {
    call("GetDeviceToAbsoluteTrackingPose", 0, |world| {
        if poses.is_null() || room == 0 {
            return world.report.violation("null pointer", "GetDeviceToAbsoluteTrackingPose");
        }
        if !ahead_s.is_finite() || ahead_s.abs() > 10.0 {
            return world.report.violation("poses asked for too far ahead", format!("{ahead_s} s"));
        }
        let Some(from_world) = world.universes.universe_from_world(origin) else {
            return world.report.violation("no such universe", format!("{origin}"));
        };
        let time_ns = now_ns() + (f64::from(ahead_s) * 1e9) as i64;
        let count = world.devices.len().min(room as usize);
        let known: Vec<_> = (0..count).map(|device| world.tracked_pose(device, time_ns, &from_world)).collect();
        write_all(poses, room, &known, no_pose());
    });
}

unsafe extern "C" fn seated_to_standing() -> sys::HmdMatrix34_t {
    call("GetSeatedZeroPoseToStandingAbsoluteTrackingPose", 0, |world| matrix(&world.universes.standing_from_seated()))
}

unsafe extern "C" fn raw_to_standing() -> sys::HmdMatrix34_t {
    call("GetRawZeroPoseToStandingAbsoluteTrackingPose", 0, |world| matrix(&world.universes.standing_from_raw()))
}

unsafe extern "C" fn sorted_devices(class: u32, out: *mut u32, room: u32, _relative_to: u32) -> u32 {
    call("GetSortedTrackedDeviceIndicesOfClass", 0, |world| {
        let devices: Vec<u32> = (0..world.devices.len() as u32).filter(|d| class_of(world, *d) == class).collect();
        write_all(out, room.min(devices.len() as u32), &devices, NO_DEVICE);
        devices.len() as u32
    })
}

unsafe extern "C" fn activity(_device: u32) -> i32 {
    call("GetTrackedDeviceActivityLevel", 0, |world| match world.standby {
        true => sys::EDeviceActivityLevel_k_EDeviceActivityLevel_Standby,
        false => sys::EDeviceActivityLevel_k_EDeviceActivityLevel_UserInteraction,
    })
}

fn class_of(world: &World, device: u32) -> u32 {
    match device as usize {
        0 => sys::ETrackedDeviceClass_TrackedDeviceClass_HMD,
        controller if controller < world.devices.len() => sys::ETrackedDeviceClass_TrackedDeviceClass_Controller,
        _ => sys::ETrackedDeviceClass_TrackedDeviceClass_Invalid,
    }
}

/// The first controller is in the left hand, the second in the right hand.
fn role_of(world: &World, device: u32) -> u32 {
    match device {
        1 | 2 if (device as usize) < world.devices.len() => device,
        _ => sys::ETrackedControllerRole_TrackedControllerRole_Invalid,
    }
}

unsafe extern "C" fn device_of_role(role: u32) -> u32 {
    call("GetTrackedDeviceIndexForControllerRole", NO_DEVICE, |world| {
        let known = role != sys::ETrackedControllerRole_TrackedControllerRole_Invalid && role_of(world, role) == role;
        if known { role } else { NO_DEVICE }
    })
}

unsafe extern "C" fn role_of_device(device: u32) -> u32 {
    call("GetControllerRoleForTrackedDeviceIndex", 0, |world| role_of(world, device))
}

unsafe extern "C" fn haptic_pulse(device: u32, _axis: u32, length_us: u16) {
    call("TriggerHapticPulse", 0, |world| {
        if class_of(world, device) != sys::ETrackedDeviceClass_TrackedDeviceClass_Controller {
            return world.report.violation("haptic pulse for a non-controller", format!("device {device}"));
        }
        if !(1..4000).contains(&length_us) {
            return world.report.violation("haptic pulse of an invalid length", format!("{length_us} microseconds"));
        }
        // A controller accepts the next pulse after 5 ms; 1 ms is allowed for the call's jitter.
        let now_ns = now_ns();
        let then_ns = world.devices.pulse(device, now_ns);
        if then_ns.is_some_and(|then_ns| now_ns - then_ns < 4_000_000) {
            world.report.violation("haptic pulses too soon after each other", format!("device {device}"));
        }
        *world.report.pulses.entry(device).or_default() += 1;
    });
}

unsafe extern "C" fn device_class(device: u32) -> u32 {
    call("GetTrackedDeviceClass", 0, |world| class_of(world, device))
}

unsafe extern "C" fn is_connected(device: u32) -> bool {
    call("IsTrackedDeviceConnected", 0, |world| (device as usize) < world.devices.len() && world.server.alive(now_ns()))
}

/// Returns a property, and its error.
fn property<T: table::Failure>(
    name: &'static str,
    device: u32,
    error: *mut u32,
    value: impl FnOnce(&World) -> Option<T>,
) -> T {
    call(name, 0, |world| {
        let alive = world.server.alive(now_ns());
        let value = value(world).filter(|_| alive && (device as usize) < world.devices.len());
        write(
            error,
            match &value {
                Some(_) => OK,
                None if !alive => NO_CONTACT,
                None if device as usize >= world.devices.len() => INVALID_DEVICE,
                None => NOT_PROVIDED,
            },
        );
        value.unwrap_or(T::failure(0))
    })
}

unsafe extern "C" fn bool_property(device: u32, asked: u32, error: *mut u32) -> bool {
    property("GetBoolTrackedDeviceProperty", device, error, |_| {
        (asked == sys::ETrackedDeviceProperty_Prop_DeviceIsWireless_Bool).then_some(device != 0)
    })
}

unsafe extern "C" fn float_property(device: u32, asked: u32, error: *mut u32) -> f32 {
    property("GetFloatTrackedDeviceProperty", device, error, |world| {
        let display = &world.config.display;
        let value = match asked {
            sys::ETrackedDeviceProperty_Prop_DisplayFrequency_Float => display.frequency_hz,
            sys::ETrackedDeviceProperty_Prop_SecondsFromVsyncToPhotons_Float => display.vsync_to_photons_s,
            sys::ETrackedDeviceProperty_Prop_UserIpdMeters_Float => display.ipd_m,
            _ => return None,
        };
        (device == 0).then_some(value as f32)
    })
}

unsafe extern "C" fn int_property(device: u32, asked: u32, error: *mut u32) -> i32 {
    property("GetInt32TrackedDeviceProperty", device, error, |world| match asked {
        sys::ETrackedDeviceProperty_Prop_DeviceClass_Int32 => Some(class_of(world, device) as i32),
        sys::ETrackedDeviceProperty_Prop_ControllerRoleHint_Int32 if device > 0 => Some(role_of(world, device) as i32),
        _ => None,
    })
}

unsafe extern "C" fn u64_property(device: u32, asked: u32, error: *mut u32) -> u64 {
    property("GetUint64TrackedDeviceProperty", device, error, |world| {
        let is_universe = asked == sys::ETrackedDeviceProperty_Prop_CurrentUniverseId_Uint64;
        let known = device == 0 && is_universe && !world.config.has(Defect::NoUniverseId);
        known.then_some(world.universes.id)
    })
}

unsafe extern "C" fn string_property(device: u32, asked: u32, value: *mut c_char, room: u32, error: *mut u32) -> u32 {
    let needed = property("GetStringTrackedDeviceProperty", device, error, |_| {
        let known = match asked {
            sys::ETrackedDeviceProperty_Prop_TrackingSystemName_String => "fake",
            sys::ETrackedDeviceProperty_Prop_ManufacturerName_String => "Fake",
            sys::ETrackedDeviceProperty_Prop_ModelNumber_String if device == 0 => "Fake headset",
            sys::ETrackedDeviceProperty_Prop_ModelNumber_String => "Fake controller",
            sys::ETrackedDeviceProperty_Prop_SerialNumber_String => {
                return Some(write_text(value, room, &format!("STANDIN-{device}")));
            }
            _ => return None,
        };
        Some(write_text(value, room, known))
    });
    if needed > room {
        write(error, TOO_SMALL);
    }
    needed
}

unsafe extern "C" fn property_error_name(error: u32) -> *mut c_char {
    text(match error {
        OK => c"TrackedProp_Success",
        INVALID_DEVICE => c"TrackedProp_InvalidDevice",
        NOT_PROVIDED => c"TrackedProp_ValueNotProvidedByDevice",
        NO_CONTACT => c"TrackedProp_CouldNotContactServer",
        TOO_SMALL => c"TrackedProp_BufferTooSmall",
        _ => c"TrackedProp_UnknownProperty",
    })
}

fn next_event(world: &mut World, event: *mut sys::VREvent_t, room: u32) -> bool {
    let now_ns = now_ns();
    if event.is_null() {
        world.report.violation("null pointer", "PollNextEvent");
        return false;
    }
    if !world.server.alive(now_ns) {
        return false;
    }
    let Some(next) = world.events.pop(now_ns) else { return false };
    if next.eventType == sys::EVREventType_VREvent_Quit {
        let seconds = world.seconds(now_ns);
        world.report.ending.quit_delivered_s.get_or_insert(seconds);
    }
    write_part(event, room, &next);
    true
}

unsafe extern "C" fn poll_event(event: *mut sys::VREvent_t, room: u32) -> bool {
    call("PollNextEvent", 0, |world| next_event(world, event, room))
}

unsafe extern "C" fn poll_event_with_pose(
    origin: u32,
    event: *mut sys::VREvent_t,
    room: u32,
    pose: *mut sys::TrackedDevicePose_t,
) -> bool {
    call("PollNextEventWithPose", 0, |world| {
        let from_world = world.universes.universe_from_world(origin).unwrap_or(Pose::IDENTITY);
        let head = world.tracked_pose(0, now_ns(), &from_world);
        let found = next_event(world, event, room);
        if found {
            write(pose, head);
        }
        found
    })
}

unsafe extern "C" fn event_name(kind: u32) -> *mut c_char {
    text(match kind {
        sys::EVREventType_VREvent_Quit => c"VREvent_Quit",
        sys::EVREventType_VREvent_EnterStandbyMode => c"VREvent_EnterStandbyMode",
        sys::EVREventType_VREvent_LeaveStandbyMode => c"VREvent_LeaveStandbyMode",
        sys::EVREventType_VREvent_ChaperoneDataHasChanged => c"VREvent_ChaperoneDataHasChanged",
        sys::EVREventType_VREvent_ChaperoneUniverseHasChanged => c"VREvent_ChaperoneUniverseHasChanged",
        sys::EVREventType_VREvent_ChaperoneSettingsHaveChanged => c"VREvent_ChaperoneSettingsHaveChanged",
        sys::EVREventType_VREvent_SeatedZeroPoseReset => c"VREvent_SeatedZeroPoseReset",
        sys::EVREventType_VREvent_StandingZeroPoseReset => c"VREvent_StandingZeroPoseReset",
        _ => c"Unknown",
    })
}

unsafe extern "C" fn input_available() -> bool {
    call("IsInputAvailable", 0, |world| world.server.alive(now_ns()))
}

unsafe extern "C" fn drawing_controllers() -> bool {
    call("IsSteamVRDrawingControllers", 0, |_| false)
}

unsafe extern "C" fn should_pause() -> bool {
    call("ShouldApplicationPause", 0, |world| world.standby)
}

unsafe extern "C" fn should_reduce() -> bool {
    call("ShouldApplicationReduceRenderingWork", 0, |_| false)
}

unsafe extern "C" fn acknowledge_quit() {
    call("AcknowledgeQuit_Exiting", 0, |world| {
        let seconds = world.seconds(now_ns());
        if world.report.ending.quit_delivered_s.is_none() {
            world.report.violation("quit acknowledged without being asked", "AcknowledgeQuit_Exiting");
        }
        world.report.ending.quit_acknowledged_s.get_or_insert(seconds);
    });
}

unsafe extern "C" fn runtime_version() -> *mut c_char {
    call("GetRuntimeVersion", 0, |_| text(c"2.15.6-fake"))
}

/// Records the SDK version of the client.
pub fn sdk_version(version: [u32; 3]) -> u32 {
    call("SetSDKVersion", sys::EVRInitError_VRInitError_Init_NotInitialized, |world| {
        world.report.sdk_version = Some(version);
        sys::EVRInitError_VRInitError_None
    })
}

unsafe extern "C" fn set_sdk_version(major: u32, minor: u32, build: u32) -> u32 {
    sdk_version([major, minor, build])
}

unsafe extern "C" fn array_property(
    device: u32,
    _asked: u32,
    _tag: u32,
    _out: *mut c_void,
    _room: u32,
    error: *mut u32,
) -> u32 {
    property("GetArrayTrackedDeviceProperty", device, error, |_| None)
}

/// IVRSystem_026.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVRSystem_FnTable, "IVRSystem";
        given {
            GetRecommendedRenderTargetSize: render_target_size,
            GetProjectionRaw: projection_raw,
            GetEyeToHeadTransform: eye_to_head,
            GetTimeSinceLastVsync: since_vsync,
            GetOutputDevice: output_device,
            GetDeviceToAbsoluteTrackingPose: poses,
            GetSeatedZeroPoseToStandingAbsoluteTrackingPose: seated_to_standing,
            GetRawZeroPoseToStandingAbsoluteTrackingPose: raw_to_standing,
            GetSortedTrackedDeviceIndicesOfClass: sorted_devices,
            GetTrackedDeviceActivityLevel: activity,
            GetTrackedDeviceIndexForControllerRole: device_of_role,
            GetControllerRoleForTrackedDeviceIndex: role_of_device,
            GetTrackedDeviceClass: device_class,
            IsTrackedDeviceConnected: is_connected,
            GetBoolTrackedDeviceProperty: bool_property,
            GetFloatTrackedDeviceProperty: float_property,
            GetInt32TrackedDeviceProperty: int_property,
            GetUint64TrackedDeviceProperty: u64_property,
            GetArrayTrackedDeviceProperty: array_property,
            GetStringTrackedDeviceProperty: string_property,
            GetPropErrorNameFromEnum: property_error_name,
            TriggerHapticPulse: haptic_pulse,
            PollNextEvent: poll_event,
            PollNextEventWithPose: poll_event_with_pose,
            GetEventTypeNameFromEnum: event_name,
            IsInputAvailable: input_available,
            IsSteamVRDrawingControllers: drawing_controllers,
            ShouldApplicationPause: should_pause,
            ShouldApplicationReduceRenderingWork: should_reduce,
            AcknowledgeQuit_Exiting: acknowledge_quit,
            GetRuntimeVersion: runtime_version,
            SetSDKVersion: set_sdk_version,
        }
        fails(0) {
            GetProjectionMatrix, ComputeDistortion, ComputeDistortionSet, GetD3D9AdapterIndex, GetDXGIOutputInfo,
            IsDisplayOnDesktop, SetDisplayVisibility, ApplyTransform, GetMatrix34TrackedDeviceProperty,
            PollNextEventWithPoseAndOverlays, GetHiddenAreaMesh, GetEyeTrackedFoveationCenter,
            GetEyeTrackedFoveationCenterForProjection, GetControllerState, GetControllerStateWithPose,
            GetButtonIdNameFromEnum, GetControllerAxisTypeNameFromEnum, PerformFirmwareUpdate,
            GetAppContainerFilePaths,
        }
    })
}
