//! IVRCompositor: the functions that overlay programs use, mainly the required Vulkan extensions.

use std::ffi::c_char;

use crate::clock::now_ns;
use crate::memory::write_text;
use crate::table::table;
use crate::world::call;
use crate::{sys, table};

unsafe extern "C" fn set_tracking_space(origin: u32) {
    call("SetTrackingSpace", 0, |world| {
        world.report.violation("SetTrackingSpace is for scene applications", format!("{origin}"));
    });
}

unsafe extern "C" fn tracking_space() -> u32 {
    call("GetTrackingSpace", 0, |_| sys::ETrackingUniverseOrigin_TrackingUniverseStanding)
}

unsafe extern "C" fn time_remaining() -> f32 {
    call("GetFrameTimeRemaining", 0, |world| {
        let now_ns = now_ns();
        let next = world.frames.start_ns(world.frames.at(now_ns) + 1);
        ((next - now_ns) as f64 * 1e-9) as f32
    })
}

unsafe extern "C" fn instance_extensions(value: *mut c_char, room: u32) -> u32 {
    call("GetVulkanInstanceExtensionsRequired", 0, |world| {
        write_text(value, room, &world.config.instance_extensions.join(" "))
    })
}

unsafe extern "C" fn device_extensions(gpu: *mut sys::VkPhysicalDevice_T, value: *mut c_char, room: u32) -> u32 {
    call("GetVulkanDeviceExtensionsRequired", 0, |world| {
        if gpu.is_null() {
            world.report.violation("null pointer", "GetVulkanDeviceExtensionsRequired");
            return 0;
        }
        write_text(value, room, &world.config.device_extensions.join(" "))
    })
}

unsafe extern "C" fn is_fullscreen() -> bool {
    call("IsFullscreen", 0, |_| true)
}

unsafe extern "C" fn can_render_scene() -> bool {
    call("CanRenderScene", 0, |_| false)
}

unsafe extern "C" fn low_resources() -> bool {
    call("ShouldAppRenderWithLowResources", 0, |_| false)
}

unsafe extern "C" fn smoothing() -> bool {
    call("IsMotionSmoothingEnabled", 0, |_| false)
}

const FAILED: u32 = sys::EVRCompositorError_VRCompositorError_RequestFailed;

/// IVRCompositor_029.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVRCompositor_FnTable, "IVRCompositor";
        given {
            SetTrackingSpace: set_tracking_space,
            GetTrackingSpace: tracking_space,
            GetFrameTimeRemaining: time_remaining,
            GetVulkanInstanceExtensionsRequired: instance_extensions,
            GetVulkanDeviceExtensionsRequired: device_extensions,
            IsFullscreen: is_fullscreen,
            CanRenderScene: can_render_scene,
            ShouldAppRenderWithLowResources: low_resources,
            IsMotionSmoothingEnabled: smoothing,
        }
        fails(FAILED) {
            WaitGetPoses, GetLastPoses, GetLastPoseForTrackedDeviceIndex, GetSubmitTexture, Submit,
            SubmitWithArrayIndex, SetSkyboxOverride, GetMirrorTextureD3D11, GetMirrorTextureGL,
            SubmitExplicitTimingData, SetStageOverride_Async, GetLastPosePredictionIDs, GetPosesForFrame,
        }
        fails(0) {
            ClearLastSubmittedFrame, PostPresentHandoff, GetFrameTiming, GetFrameTimings, GetCumulativeStats,
            FadeToColor, GetCurrentFadeColor, FadeGrid, GetCurrentGridAlpha, ClearSkyboxOverride,
            CompositorBringToFront, CompositorGoToBack, CompositorQuit, GetCurrentSceneFocusProcess,
            GetLastFrameRenderer, ShowMirrorWindow, HideMirrorWindow, IsMirrorWindowVisible, CompositorDumpImages,
            ForceInterleavedReprojectionOn, ForceReconnectProcess, SuspendRendering, ReleaseMirrorTextureD3D11,
            ReleaseSharedGLTexture, LockGLSharedTextureForAccess, UnlockGLSharedTextureForAccess,
            SetExplicitTimingMode, IsMotionSmoothingSupported, IsCurrentSceneFocusAppLoading, ClearStageOverride,
            GetCompositorBenchmarkResults,
        }
    })
}
