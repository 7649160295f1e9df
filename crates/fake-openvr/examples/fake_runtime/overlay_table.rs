//! IVROverlay: the functions and their checks.
//!
//! Longer than other files: it is one table of the interface's functions, in their order.

use std::ffi::{c_char, c_void};

use ash::vk;
use ash::vk::Handle;
use radar_sar::geometry::Pose;

use crate::clock::{now_ns, sleep_until};
use crate::eyes::Edges;
use crate::memory::{read, read_text, write, write_part, write_text};
use crate::older_tables::Sdk;
use crate::overlay::{MAX_OVERLAYS, Overlay, Texture, Transform, thumbnail_key};
use crate::poses::{matrix, pose};
use crate::report::Report;
use crate::table::{table, text};
use crate::vulkan::{Copier, Handles, Image};
use crate::world::{World, call};
use crate::{sys, table};

const NONE: u32 = sys::EVROverlayError_VROverlayError_None;
const UNKNOWN: u32 = sys::EVROverlayError_VROverlayError_UnknownOverlay;
const BAD_PARAMETER: u32 = sys::EVROverlayError_VROverlayError_InvalidParameter;
const BAD_TEXTURE: u32 = sys::EVROverlayError_VROverlayError_InvalidTexture;
const WRONG_TRANSFORM: u32 = sys::EVROverlayError_VROverlayError_WrongTransformType;
const FAILED: u32 = sys::EVROverlayError_VROverlayError_RequestFailed;
const TIMED_OUT: u32 = sys::EVROverlayError_VROverlayError_TimedOut;
/// Largest side of a texture, pixels. Choice: every Vulkan device supports it (required
/// `maxImageDimension2D`), and no overlay needs more.
const MAX_TEXTURE_SIDE: u32 = 4096;
const FORMATS: [vk::Format; 4] =
    [vk::Format::R8G8B8A8_SRGB, vk::Format::R8G8B8A8_UNORM, vk::Format::B8G8R8A8_SRGB, vk::Format::B8G8R8A8_UNORM];

type Outcome = Result<(), u32>;

/// Runs a call on an existing overlay.
fn with_overlay(name: &'static str, handle: u64, body: impl FnOnce(&mut Overlay, &mut Report) -> Outcome) -> u32 {
    call(name, FAILED, |world| {
        let overlay = match world.overlays.get(handle) {
            Ok(overlay) => overlay,
            Err(why) => {
                world.report.violation(why, format!("{name}({handle:#x})"));
                return UNKNOWN;
            }
        };
        if !world.server.alive(now_ns()) {
            return FAILED;
        }
        body(overlay, &mut world.report).err().unwrap_or(NONE)
    })
}

/// Sets a number after checking its range.
fn set_number(
    name: &'static str,
    handle: u64,
    value: f32,
    allowed: impl FnOnce(f32) -> bool,
    field: impl FnOnce(&mut Overlay) -> &mut f32,
) -> u32 {
    with_overlay(name, handle, |overlay, report| {
        if !value.is_finite() || !allowed(value) {
            report.violation(&format!("{name}: not a possible value"), format!("{value} for {}", overlay.key));
            return Err(BAD_PARAMETER);
        }
        *field(overlay) = value;
        Ok(())
    })
}

/// Returns a value.
fn get<T>(name: &'static str, handle: u64, to: *mut T, value: impl FnOnce(&Overlay) -> T) -> u32 {
    with_overlay(name, handle, |overlay, report| {
        not_null(report, name, to)?;
        write(to, value(overlay));
        Ok(())
    })
}

fn not_null<T>(report: &mut Report, name: &str, pointer: *const T) -> Outcome {
    if pointer.is_null() {
        report.violation("null pointer", name);
        return Err(BAD_PARAMETER);
    }
    Ok(())
}

/// A text of at most 127 bytes.
fn checked_text<'a>(report: &mut Report, name: &str, text: *const c_char, too_long: u32) -> Result<&'a str, u32> {
    let Some(text) = read_text(text).filter(|text| !text.is_empty()) else {
        report.violation("null pointer", format!("{name}: a key or name is missing, empty or no UTF-8"));
        return Err(BAD_PARAMETER);
    };
    if text.len() >= sys::k_unVROverlayMaxKeyLength as usize {
        report.violation("key or name too long", format!("{name}: {} bytes", text.len()));
        return Err(too_long);
    }
    Ok(text)
}

fn create(world: &mut World, name: &str, key: *const c_char, label: *const c_char) -> Result<u64, u32> {
    let report = &mut world.report;
    let key = checked_text(report, name, key, sys::EVROverlayError_VROverlayError_KeyTooLong)?;
    let label = checked_text(report, name, label, sys::EVROverlayError_VROverlayError_NameTooLong)?;
    if !world.server.alive(now_ns()) {
        return Err(FAILED);
    }
    if world.overlays.handle(key).is_some() {
        report.violation("overlay key in use", key);
        return Err(sys::EVROverlayError_VROverlayError_KeyInUse);
    }
    if world.overlays.len() >= MAX_OVERLAYS {
        report.violation("too many overlays", format!("{MAX_OVERLAYS} at most"));
        return Err(sys::EVROverlayError_VROverlayError_OverlayLimitExceeded);
    }
    Ok(world.overlays.create(key, label))
}

unsafe extern "C" fn find_overlay(key: *mut c_char, handle: *mut u64) -> u32 {
    call("FindOverlay", FAILED, |world| {
        write(handle, 0);
        let found = read_text(key).and_then(|key| world.overlays.handle(key));
        found.inspect(|found| write(handle, *found)).map_or(UNKNOWN, |_| NONE)
    })
}

unsafe extern "C" fn create_overlay(key: *mut c_char, name: *mut c_char, handle: *mut u64) -> u32 {
    call("CreateOverlay", FAILED, |world| {
        write(handle, 0);
        if let Err(code) = not_null(&mut world.report, "CreateOverlay", handle) {
            return code;
        }
        let created = create(world, "CreateOverlay", key, name);
        created.map(|created| write(handle, created)).err().unwrap_or(NONE)
    })
}

unsafe extern "C" fn create_dashboard_overlay(
    key: *mut c_char,
    name: *mut c_char,
    main: *mut u64,
    thumbnail: *mut u64,
) -> u32 {
    call("CreateDashboardOverlay", FAILED, |world| {
        let created = create(world, "CreateDashboardOverlay", key, name);
        let created = created.and_then(|handle| {
            let overlay = world.overlays.get(handle).map_err(|_| FAILED)?;
            overlay.dashboard = true;
            let (key, name) = (thumbnail_key(&overlay.key), overlay.name.clone());
            let thumb = world.overlays.create(&key, &name);
            world.overlays.get(thumb).map_err(|_| FAILED)?.dashboard = true;
            write(main, handle);
            write(thumbnail, thumb);
            Ok(())
        });
        created.err().unwrap_or(NONE)
    })
}

unsafe extern "C" fn destroy_overlay(handle: u64) -> u32 {
    call("DestroyOverlay", FAILED, |world| {
        if let Err(why) = world.overlays.get(handle) {
            world.report.violation(why, format!("DestroyOverlay({handle:#x})"));
            return UNKNOWN;
        }
        world.overlays.destroy(handle);
        if world.server.alive(now_ns()) { NONE } else { FAILED }
    })
}

/// Returns a text, and its error.
fn get_text(
    name: &'static str,
    handle: u64,
    value: *mut c_char,
    room: u32,
    error: *mut u32,
    of: impl FnOnce(&Overlay) -> &str,
) -> u32 {
    let mut needed = 0;
    let code = with_overlay(name, handle, |overlay, _| {
        needed = write_text(value, room, of(overlay));
        if needed > room { Err(sys::EVROverlayError_VROverlayError_ArrayTooSmall) } else { Ok(()) }
    });
    write(error, code);
    needed
}

unsafe extern "C" fn overlay_key(handle: u64, value: *mut c_char, room: u32, error: *mut u32) -> u32 {
    get_text("GetOverlayKey", handle, value, room, error, |overlay| &overlay.key)
}

unsafe extern "C" fn overlay_name(handle: u64, value: *mut c_char, room: u32, error: *mut u32) -> u32 {
    get_text("GetOverlayName", handle, value, room, error, |overlay| &overlay.name)
}

unsafe extern "C" fn set_name(handle: u64, name: *mut c_char) -> u32 {
    with_overlay("SetOverlayName", handle, |overlay, report| {
        let too_long = sys::EVROverlayError_VROverlayError_NameTooLong;
        overlay.name = checked_text(report, "SetOverlayName", name, too_long)?.to_owned();
        Ok(())
    })
}

unsafe extern "C" fn error_name(error: u32) -> *mut c_char {
    text(match error {
        NONE => c"VROverlayError_None",
        UNKNOWN => c"VROverlayError_UnknownOverlay",
        11 => c"VROverlayError_InvalidHandle",
        12 => c"VROverlayError_PermissionDenied",
        13 => c"VROverlayError_OverlayLimitExceeded",
        14 => c"VROverlayError_WrongVisibilityType",
        15 => c"VROverlayError_KeyTooLong",
        16 => c"VROverlayError_NameTooLong",
        17 => c"VROverlayError_KeyInUse",
        WRONG_TRANSFORM => c"VROverlayError_WrongTransformType",
        19 => c"VROverlayError_InvalidTrackedDevice",
        BAD_PARAMETER => c"VROverlayError_InvalidParameter",
        22 => c"VROverlayError_ArrayTooSmall",
        FAILED => c"VROverlayError_RequestFailed",
        BAD_TEXTURE => c"VROverlayError_InvalidTexture",
        TIMED_OUT => c"VROverlayError_TimedOut",
        _ => c"VROverlayError",
    })
}

unsafe extern "C" fn set_flag(handle: u64, flag: u32, enabled: bool) -> u32 {
    let is_older = crate::world::sdk() != Sdk::V2_15;
    with_overlay("SetOverlayFlag", handle, |overlay, report| {
        if is_older && flag == sys::VROverlayFlags_NoBackside {
            return Err(BAD_PARAMETER);
        }
        let known = sys::VROverlayFlags_NoDashboardTab..=sys::VROverlayFlags_NoBackside;
        if !flag.is_power_of_two() || !known.contains(&flag) {
            report.violation("no such flag", format!("{flag:#x}"));
            return Err(BAD_PARAMETER);
        }
        overlay.flags = if enabled { overlay.flags | flag } else { overlay.flags & !flag };
        Ok(())
    })
}

unsafe extern "C" fn get_flag(handle: u64, flag: u32, enabled: *mut bool) -> u32 {
    get("GetOverlayFlag", handle, enabled, |overlay| overlay.has(flag))
}

unsafe extern "C" fn get_flags(handle: u64, flags: *mut u32) -> u32 {
    get("GetOverlayFlags", handle, flags, |overlay| overlay.flags)
}

unsafe extern "C" fn set_color(handle: u64, red: f32, green: f32, blue: f32) -> u32 {
    with_overlay("SetOverlayColor", handle, |overlay, report| {
        let color = [red, green, blue];
        if !color.iter().all(|part| part.is_finite() && *part >= 0.0) {
            report.violation("SetOverlayColor: not a possible value", format!("{color:?} for {}", overlay.key));
            return Err(BAD_PARAMETER);
        }
        overlay.look.color = color;
        Ok(())
    })
}

unsafe extern "C" fn get_color(handle: u64, red: *mut f32, green: *mut f32, blue: *mut f32) -> u32 {
    with_overlay("GetOverlayColor", handle, |overlay, _| {
        [red, green, blue].iter().zip(overlay.look.color).for_each(|(to, part)| write(*to, part));
        Ok(())
    })
}

unsafe extern "C" fn set_alpha(handle: u64, alpha: f32) -> u32 {
    set_number("SetOverlayAlpha", handle, alpha, |v| (0.0..=1.0).contains(&v), |overlay| &mut overlay.look.alpha)
}

unsafe extern "C" fn get_alpha(handle: u64, alpha: *mut f32) -> u32 {
    get("GetOverlayAlpha", handle, alpha, |overlay| overlay.look.alpha)
}

unsafe extern "C" fn set_texel_aspect(handle: u64, aspect: f32) -> u32 {
    set_number("SetOverlayTexelAspect", handle, aspect, |v| v > 0.0, |overlay| &mut overlay.look.texel_aspect)
}

unsafe extern "C" fn get_texel_aspect(handle: u64, aspect: *mut f32) -> u32 {
    get("GetOverlayTexelAspect", handle, aspect, |overlay| overlay.look.texel_aspect)
}

unsafe extern "C" fn set_sort_order(handle: u64, order: u32) -> u32 {
    with_overlay("SetOverlaySortOrder", handle, |overlay, _| {
        overlay.look.sort_order = order;
        Ok(())
    })
}

unsafe extern "C" fn get_sort_order(handle: u64, order: *mut u32) -> u32 {
    get("GetOverlaySortOrder", handle, order, |overlay| overlay.look.sort_order)
}

unsafe extern "C" fn set_width(handle: u64, width_m: f32) -> u32 {
    set_number("SetOverlayWidthInMeters", handle, width_m, |v| v > 0.0, |overlay| &mut overlay.look.width_m)
}

unsafe extern "C" fn get_width(handle: u64, width_m: *mut f32) -> u32 {
    get("GetOverlayWidthInMeters", handle, width_m, |overlay| overlay.look.width_m)
}

unsafe extern "C" fn set_curvature(handle: u64, curvature: f32) -> u32 {
    let flat = |v: f32| v == 0.0;
    set_number("SetOverlayCurvature", handle, curvature, flat, |overlay| &mut overlay.look.curvature)
}

unsafe extern "C" fn get_curvature(handle: u64, curvature: *mut f32) -> u32 {
    get("GetOverlayCurvature", handle, curvature, |overlay| overlay.look.curvature)
}

unsafe extern "C" fn set_color_space(handle: u64, space: u32) -> u32 {
    with_overlay("SetOverlayTextureColorSpace", handle, |overlay, report| {
        if space > sys::EColorSpace_ColorSpace_Linear {
            report.violation("no such colour space", format!("{space}"));
            return Err(BAD_PARAMETER);
        }
        overlay.look.color_space = space;
        Ok(())
    })
}

unsafe extern "C" fn get_color_space(handle: u64, space: *mut u32) -> u32 {
    get("GetOverlayTextureColorSpace", handle, space, |overlay| overlay.look.color_space)
}

unsafe extern "C" fn set_bounds(handle: u64, bounds: *mut sys::VRTextureBounds_t) -> u32 {
    with_overlay("SetOverlayTextureBounds", handle, |overlay, report| {
        // Null means the whole texture.
        let whole = sys::VRTextureBounds_t { uMin: 0.0, vMin: 0.0, uMax: 1.0, vMax: 1.0 };
        let b = read(bounds).unwrap_or(whole);
        let numbers = [b.uMin, b.vMin, b.uMax, b.vMax];
        let inside = numbers.iter().all(|v| v.is_finite() && (-1e-3..=1.001).contains(v));
        if !inside || b.uMin == b.uMax || b.vMin == b.vMax {
            report.violation("SetOverlayTextureBounds: not possible", format!("{numbers:?} for {}", overlay.key));
            return Err(BAD_PARAMETER);
        }
        overlay.look.bounds = numbers;
        Ok(())
    })
}

unsafe extern "C" fn get_bounds(handle: u64, bounds: *mut sys::VRTextureBounds_t) -> u32 {
    get("GetOverlayTextureBounds", handle, bounds, |overlay| {
        let [u_min, v_min, u_max, v_max] = overlay.look.bounds;
        sys::VRTextureBounds_t { uMin: u_min, vMin: v_min, uMax: u_max, vMax: v_max }
    })
}

unsafe extern "C" fn transform_type(handle: u64, kind: *mut i32) -> u32 {
    get("GetOverlayTransformType", handle, kind, |overlay| match overlay.transform {
        Transform::Unset => sys::VROverlayTransformType_VROverlayTransform_Invalid,
        Transform::Absolute { .. } => sys::VROverlayTransformType_VROverlayTransform_Absolute,
        Transform::Device { .. } => sys::VROverlayTransformType_VROverlayTransform_TrackedDeviceRelative,
        Transform::Projection { .. } => sys::VROverlayTransformType_VROverlayTransform_Projection,
    })
}

/// The pose of a matrix. Non-rigid matrices are recorded as violations.
fn checked_pose(report: &mut Report, name: &str, from: *const sys::HmdMatrix34_t) -> Result<Pose, u32> {
    not_null(report, name, from)?;
    let parsed = read(from).ok_or(BAD_PARAMETER).map(|matrix| pose(&matrix))?;
    parsed.map_err(|why| {
        report.violation("transform is not rigid", format!("{name}: {why}"));
        BAD_PARAMETER
    })
}

/// Rejects dashboard tabs, which SteamVR places.
fn not_a_tab(overlay: &Overlay, report: &mut Report) -> Outcome {
    if overlay.dashboard {
        report.violation("a transform for a tab of the dashboard", &overlay.key);
        return Err(WRONG_TRANSFORM);
    }
    Ok(())
}

fn checked_origin(report: &mut Report, name: &str, origin: u32) -> Outcome {
    if origin > sys::ETrackingUniverseOrigin_TrackingUniverseRawAndUncalibrated {
        report.violation("no such universe", format!("{name}: {origin}"));
        return Err(BAD_PARAMETER);
    }
    Ok(())
}

unsafe extern "C" fn set_absolute(handle: u64, origin: u32, matrix: *mut sys::HmdMatrix34_t) -> u32 {
    with_overlay("SetOverlayTransformAbsolute", handle, |overlay, report| {
        not_a_tab(overlay, report)?;
        checked_origin(report, "SetOverlayTransformAbsolute", origin)?;
        let universe_from_overlay = checked_pose(report, "SetOverlayTransformAbsolute", matrix)?;
        overlay.transform = Transform::Absolute { origin, universe_from_overlay };
        Ok(())
    })
}

unsafe extern "C" fn get_absolute(handle: u64, origin: *mut u32, to: *mut sys::HmdMatrix34_t) -> u32 {
    with_overlay("GetOverlayTransformAbsolute", handle, |overlay, _| match overlay.transform {
        Transform::Absolute { origin: is, universe_from_overlay } => {
            write(origin, is);
            write(to, matrix(&universe_from_overlay));
            Ok(())
        }
        _ => Err(WRONG_TRANSFORM),
    })
}

unsafe extern "C" fn set_relative(handle: u64, device: u32, matrix: *mut sys::HmdMatrix34_t) -> u32 {
    with_overlay("SetOverlayTransformTrackedDeviceRelative", handle, |overlay, report| {
        not_a_tab(overlay, report)?;
        if device >= sys::k_unMaxTrackedDeviceCount as u32 {
            report.violation("no such device", format!("{device} for {}", overlay.key));
            return Err(sys::EVROverlayError_VROverlayError_InvalidTrackedDevice);
        }
        let device_from_overlay = checked_pose(report, "SetOverlayTransformTrackedDeviceRelative", matrix)?;
        overlay.transform = Transform::Device { device, device_from_overlay };
        Ok(())
    })
}

unsafe extern "C" fn get_relative(handle: u64, device: *mut u32, to: *mut sys::HmdMatrix34_t) -> u32 {
    with_overlay("GetOverlayTransformTrackedDeviceRelative", handle, |overlay, _| match overlay.transform {
        Transform::Device { device: is, device_from_overlay } => {
            write(device, is);
            write(to, matrix(&device_from_overlay));
            Ok(())
        }
        _ => Err(WRONG_TRANSFORM),
    })
}

unsafe extern "C" fn set_projection(
    handle: u64,
    origin: u32,
    matrix: *mut sys::HmdMatrix34_t,
    projection: *mut sys::VROverlayProjection_t,
    eye: u32,
) -> u32 {
    const NAME: &str = "SetOverlayTransformProjection";
    with_overlay(NAME, handle, |overlay, report| {
        not_a_tab(overlay, report)?;
        checked_origin(report, NAME, origin)?;
        not_null(report, NAME, projection)?;
        let matrix = checked_pose(report, NAME, matrix)?;
        let p = read(projection).ok_or(BAD_PARAMETER)?;
        // As in GetProjectionRaw: top is the tangent of the lower edge, bottom that of the upper
        // edge.
        let [left, right, down, up] = [p.fLeft, p.fRight, p.fTop, p.fBottom].map(f64::from);
        if ![left, right, down, up].iter().all(|v| v.is_finite()) || left >= right || down >= up || eye > 1 {
            report.violation("projection not possible", format!("left {left} right {right} top {down} bottom {up}"));
            return Err(BAD_PARAMETER);
        }
        let is_left = eye == sys::EVREye_Eye_Left;
        overlay.transform = Transform::Projection { origin, matrix, edges: Edges { left, right, up, down }, is_left };
        Ok(())
    })
}

unsafe extern "C" fn show(handle: u64) -> u32 {
    with_overlay("ShowOverlay", handle, |overlay, report| {
        if overlay.dashboard {
            report.violation("a tab is shown by the dashboard alone", &overlay.key);
            return Err(BAD_PARAMETER);
        }
        overlay.shown = true;
        Ok(())
    })
}

unsafe extern "C" fn hide(handle: u64) -> u32 {
    with_overlay("HideOverlay", handle, |overlay, _| {
        overlay.shown = false;
        Ok(())
    })
}

unsafe extern "C" fn is_visible(handle: u64) -> bool {
    let code = with_overlay("IsOverlayVisible", handle, |_, _| Ok(()));
    code == NONE && crate::world::lock().as_mut().is_some_and(|world| world.overlays.is_seen(handle))
}

/// Outcome of WaitFrameSync.
enum Wait {
    /// Returns at the begin of this frame.
    Frame(i64),
    /// Times out.
    TimesOut,
    /// Returns at this time, however late, as if the frame had just begun.
    Hangs,
}

fn plan_wait(world: &mut World, timeout_ms: u32) -> (Wait, i64) {
    let now_ns = now_ns();
    world.overlays.check_frame(&mut world.report);
    // Query the loss now: the next texture may come from another device.
    world.overlays.is_device_lost();
    let gives_up_ns = now_ns + i64::from(timeout_ms) * 1_000_000;
    let current = world.frames.at(now_ns);
    let begins_ns = world.frames.start_ns(current + 1);
    if world.hangs_until_ns > now_ns {
        return (Wait::Hangs, world.hangs_until_ns);
    }
    if !world.server.alive(now_ns) || begins_ns > gives_up_ns {
        return (Wait::TimesOut, gives_up_ns);
    }
    world.report.frames_missed += world.frames.missed(current);
    (Wait::Frame(current + 1), begins_ns)
}

unsafe extern "C" fn wait_frame_sync(timeout_ms: u32) -> u32 {
    let mut plan = None;
    let code = call("WaitFrameSync", FAILED, |world| {
        plan = Some(plan_wait(world, timeout_ms));
        NONE
    });
    let Some((wait, until_ns)) = plan else { return code };
    // Sleeps outside the lock.
    sleep_until(until_ns);
    if matches!(wait, Wait::TimesOut) {
        return TIMED_OUT;
    }
    if let Some(world) = crate::world::lock().as_mut() {
        if let Wait::Frame(frame) = wait {
            world.frames.begin(frame);
        }
        world.report.frames += 1;
    }
    NONE
}

unsafe extern "C" fn poll_overlay_event(handle: u64, event: *mut sys::VREvent_t, room: u32) -> bool {
    let mut next = None;
    with_overlay("PollNextOverlayEvent", handle, |overlay, report| {
        not_null(report, "PollNextOverlayEvent", event)?;
        next = overlay.input.events.pop(now_ns());
        Ok(())
    });
    // Without an event, the client's structure is cleared.
    let none = crate::events::event(sys::EVREventType_VREvent_None, u32::MAX);
    write_part(event, room, next.as_ref().unwrap_or(&none));
    next.is_some()
}

unsafe extern "C" fn get_input_method(handle: u64, method: *mut u32) -> u32 {
    get("GetOverlayInputMethod", handle, method, |overlay| overlay.input.method)
}

unsafe extern "C" fn set_input_method(handle: u64, method: u32) -> u32 {
    with_overlay("SetOverlayInputMethod", handle, |overlay, _| {
        overlay.input.method = method;
        Ok(())
    })
}

unsafe extern "C" fn get_mouse_scale(handle: u64, scale: *mut sys::HmdVector2_t) -> u32 {
    get("GetOverlayMouseScale", handle, scale, |overlay| sys::HmdVector2_t { v: overlay.input.mouse_scale })
}

unsafe extern "C" fn set_mouse_scale(handle: u64, scale: *mut sys::HmdVector2_t) -> u32 {
    with_overlay("SetOverlayMouseScale", handle, |overlay, report| {
        not_null(report, "SetOverlayMouseScale", scale)?;
        let new = read(scale).ok_or(BAD_PARAMETER)?.v;
        if !new.iter().all(|v| v.is_finite() && *v > 0.0) {
            report.violation("SetOverlayMouseScale: not a possible value", format!("{new:?} for {}", overlay.key));
            return Err(BAD_PARAMETER);
        }
        overlay.input.mouse_scale = new;
        Ok(())
    })
}

/// Checks the description of a texture.
fn checked_image(report: &mut Report, data: &sys::VRVulkanTextureData_t) -> Result<Image, u32> {
    let mut wrong = |kind: &str, text: String| {
        report.violation(kind, format!("SetOverlayTexture: {text}"));
        Err(BAD_TEXTURE)
    };
    let (width, height) = (data.m_nWidth, data.m_nHeight);
    let format = vk::Format::from_raw(data.m_nFormat as i32);
    if data.m_nImage == 0 || Handles::of(data).any_null() {
        return wrong("null handle", format!("{data:?}"));
    }
    if !(1..=MAX_TEXTURE_SIDE).contains(&width) || !(1..=MAX_TEXTURE_SIDE).contains(&height) {
        return wrong("size of a texture", format!("{width} x {height}"));
    }
    if !FORMATS.contains(&format) {
        return wrong("format of a texture", format!("{format:?}"));
    }
    if data.m_nSampleCount != 1 {
        return wrong("samples of a texture", format!("{}", data.m_nSampleCount));
    }
    Ok(Image { image: vk::Image::from_raw(data.m_nImage), width, height, format })
}

/// The copier of the client's device. Created at its first texture.
fn copier(world: &mut World, handles: Handles) -> Result<&mut Copier, u32> {
    let overlays = &mut world.overlays;
    if let Some(before) = overlays.copier.as_ref().map(Copier::handles).filter(|before| *before != handles) {
        if overlays.is_device_lost() {
            world.report.devices_lost += 1;
        } else {
            world.report.violation("handles change from texture to texture", format!("{before:?}, now {handles:?}"));
        }
        overlays.forget_copies();
    }
    if overlays.copier.is_none() {
        let made = Copier::new(handles).inspect_err(|why| world.report.violation("Vulkan refuses", why.as_str()));
        overlays.copier = Some(made.map_err(|_| BAD_TEXTURE)?);
    }
    overlays.copier.as_mut().ok_or(BAD_TEXTURE)
}

fn take_texture(world: &mut World, handle: u64, texture: *const sys::Texture_t) -> Result<(), u32> {
    const NAME: &str = "SetOverlayTexture";
    let thread = std::thread::current().id();
    if *world.overlays.thread.get_or_insert(thread) != thread {
        world.report.violation("SetOverlayTexture from more than one thread", format!("{thread:?}"));
    }
    not_null(&mut world.report, NAME, texture)?;
    let texture = read(texture).ok_or(BAD_PARAMETER)?;
    if texture.eType != sys::ETextureType_TextureType_Vulkan {
        world.report.violation("texture that is not Vulkan's", format!("type {}", texture.eType));
        return Err(BAD_TEXTURE);
    }
    not_null(&mut world.report, NAME, texture.handle)?;
    let data = read(texture.handle.cast::<sys::VRVulkanTextureData_t>()).ok_or(BAD_PARAMETER)?;
    let image = checked_image(&mut world.report, &data)?;
    world.report.textures += 1;
    let copied = copier(world, Handles::of(&data))?.copy(image);
    let copied = copied.map_err(|why| {
        // A lost device is no violation: the client learns of it from its own device.
        if !world.overlays.is_device_lost() {
            world.report.violation("Vulkan refuses", why);
        }
        BAD_TEXTURE
    })?;
    if copied.is_none() {
        world.report.textures_not_copied += 1;
    }
    let overlay = world.overlays.get(handle).map_err(|_| UNKNOWN)?;
    // If the copy could not be started, the previous texture stays visible.
    let copied = copied.or_else(|| overlay.texture.take().and_then(|before| before.copied));
    if overlay.dashboard {
        world.report.dashboard_textures += 1;
    }
    let size = [image.width, image.height];
    if overlay.texture.as_ref().is_some_and(|before| before.size != size) {
        world.report.texture_size_changes += 1;
    }
    overlay.texture = Some(Texture { size, color_space: texture.eColorSpace, copied });
    Ok(())
}

unsafe extern "C" fn set_texture(handle: u64, texture: *mut sys::Texture_t) -> u32 {
    call("SetOverlayTexture", FAILED, |world| {
        if let Err(why) = world.overlays.get(handle) {
            world.report.violation(why, format!("SetOverlayTexture({handle:#x})"));
            return UNKNOWN;
        }
        if !world.server.alive(now_ns()) {
            return FAILED;
        }
        take_texture(world, handle, texture).err().unwrap_or(NONE)
    })
}

unsafe extern "C" fn clear_texture(handle: u64) -> u32 {
    with_overlay("ClearOverlayTexture", handle, |overlay, _| {
        overlay.texture = None;
        Ok(())
    })
}

unsafe extern "C" fn set_raw(handle: u64, _buffer: *mut c_void, _width: u32, _height: u32, _bytes: u32) -> u32 {
    with_overlay("SetOverlayRaw", handle, |overlay, report| {
        report.violation("SetOverlayRaw is not for frames", &overlay.key);
        Err(FAILED)
    })
}

unsafe extern "C" fn texture_size(handle: u64, width: *mut u32, height: *mut u32) -> u32 {
    with_overlay("GetOverlayTextureSize", handle, |overlay, _| {
        let [w, h] = overlay.texture.as_ref().ok_or(BAD_TEXTURE)?.size;
        write(width, w);
        write(height, h);
        Ok(())
    })
}

unsafe extern "C" fn dashboard_visible() -> bool {
    call("IsDashboardVisible", 0, |world| world.overlays.dashboard_open)
}

unsafe extern "C" fn is_active_dashboard(handle: u64) -> bool {
    call("IsActiveDashboardOverlay", 0, |world| {
        if let Err(why) = world.overlays.get(handle) {
            world.report.violation(why, format!("IsActiveDashboardOverlay({handle:#x})"));
        }
        world.overlays.dashboard_open && world.overlays.is_seen(handle)
    })
}

unsafe extern "C" fn primary_dashboard_device() -> u32 {
    call("GetPrimaryDashboardDevice", u32::MAX, |_| u32::MAX)
}

unsafe extern "C" fn is_hover_target(handle: u64) -> bool {
    with_overlay("IsHoverTargetOverlay", handle, |_, _| Ok(()));
    false
}

/// IVROverlay_028.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVROverlay_FnTable, "IVROverlay";
        given {
            FindOverlay: find_overlay,
            CreateOverlay: create_overlay,
            DestroyOverlay: destroy_overlay,
            GetOverlayKey: overlay_key,
            GetOverlayName: overlay_name,
            SetOverlayName: set_name,
            GetOverlayErrorNameFromEnum: error_name,
            SetOverlayFlag: set_flag,
            GetOverlayFlag: get_flag,
            GetOverlayFlags: get_flags,
            SetOverlayColor: set_color,
            GetOverlayColor: get_color,
            SetOverlayAlpha: set_alpha,
            GetOverlayAlpha: get_alpha,
            SetOverlayTexelAspect: set_texel_aspect,
            GetOverlayTexelAspect: get_texel_aspect,
            SetOverlaySortOrder: set_sort_order,
            GetOverlaySortOrder: get_sort_order,
            SetOverlayWidthInMeters: set_width,
            GetOverlayWidthInMeters: get_width,
            SetOverlayCurvature: set_curvature,
            GetOverlayCurvature: get_curvature,
            SetOverlayTextureColorSpace: set_color_space,
            GetOverlayTextureColorSpace: get_color_space,
            SetOverlayTextureBounds: set_bounds,
            GetOverlayTextureBounds: get_bounds,
            GetOverlayTransformType: transform_type,
            SetOverlayTransformAbsolute: set_absolute,
            GetOverlayTransformAbsolute: get_absolute,
            SetOverlayTransformTrackedDeviceRelative: set_relative,
            GetOverlayTransformTrackedDeviceRelative: get_relative,
            SetOverlayTransformProjection: set_projection,
            ShowOverlay: show,
            HideOverlay: hide,
            IsOverlayVisible: is_visible,
            WaitFrameSync: wait_frame_sync,
            PollNextOverlayEvent: poll_overlay_event,
            GetOverlayInputMethod: get_input_method,
            SetOverlayInputMethod: set_input_method,
            GetOverlayMouseScale: get_mouse_scale,
            SetOverlayMouseScale: set_mouse_scale,
            SetOverlayTexture: set_texture,
            ClearOverlayTexture: clear_texture,
            SetOverlayRaw: set_raw,
            GetOverlayTextureSize: texture_size,
            CreateDashboardOverlay: create_dashboard_overlay,
            IsDashboardVisible: dashboard_visible,
            IsActiveDashboardOverlay: is_active_dashboard,
            GetPrimaryDashboardDevice: primary_dashboard_device,
            IsHoverTargetOverlay: is_hover_target,
        }
        fails(FAILED) {
            CreateSubviewOverlay, GetOverlayImageData, SetOverlayRenderingPid, SetOverlayPreCurvePitch,
            GetOverlayPreCurvePitch, SetOverlayTransformTrackedDeviceComponent,
            GetOverlayTransformTrackedDeviceComponent, SetOverlayTransformCursor, GetOverlayTransformCursor,
            SetSubviewPosition, GetTransformForOverlayCoordinates, SetOverlayIntersectionMask,
            TriggerLaserMouseHapticVibration, SetOverlayCursor, SetOverlayCursorPositionOverride,
            ClearOverlayCursorPositionOverride, SetOverlayFromFile, GetOverlayTexture, ReleaseNativeOverlayHandle,
            SetDashboardOverlaySceneProcess, GetDashboardOverlaySceneProcess, ShowKeyboard, ShowKeyboardForOverlay,
        }
        fails(0) {
            GetOverlayRenderingPid, ComputeOverlayIntersection, ShowDashboard, GetKeyboardText, HideKeyboard,
            SetKeyboardTransformAbsolute, SetKeyboardPositionForOverlay, ShowMessageOverlay, CloseMessageOverlay,
        }
    })
}
