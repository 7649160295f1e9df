//! The tables of older SDKs: the functions of each version in the order of its header,
//! `openvr_capi.h` of SDKs 2.12.1 and 2.5.1.

use serde::Deserialize;

use crate::sys;

/// The SDK that the runtime is built from. Its interfaces are the newest that it has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
pub enum Sdk {
    #[serde(rename = "2.5")]
    V2_5,
    #[serde(rename = "2.12")]
    V2_12,
    #[default]
    #[serde(rename = "2.15")]
    V2_15,
}

/// An interface of an older SDK: its version, and the positions of its functions in the header's
/// table.
pub struct OlderTable {
    pub version: &'static str,
    pub positions: &'static [usize],
}

/// The positions in the header's table of functions given by name.
macro_rules! positions {
    ($table:ident: $($function:ident),* $(,)?) => {
        &[$(std::mem::offset_of!(sys::$table, $function) / size_of::<usize>()),*]
    };
}

impl Sdk {
    /// The interfaces that differ from those of the newest SDK.
    pub fn older(self) -> &'static [OlderTable] {
        match self {
            Self::V2_15 => &[],
            Self::V2_12 => &[SYSTEM_023, APPLICATIONS_007, COMPOSITOR_028],
            Self::V2_5 => &[SYSTEM_022, APPLICATIONS_007, COMPOSITOR_028, OVERLAY_027],
        }
    }
}

const SYSTEM_023: OlderTable = OlderTable {
    version: "IVRSystem_023",
    positions: positions![VR_IVRSystem_FnTable:
        GetRecommendedRenderTargetSize, GetProjectionMatrix, GetProjectionRaw, ComputeDistortion,
        GetEyeToHeadTransform, GetTimeSinceLastVsync, GetD3D9AdapterIndex, GetDXGIOutputInfo,
        GetOutputDevice, IsDisplayOnDesktop, SetDisplayVisibility, GetDeviceToAbsoluteTrackingPose,
        GetSeatedZeroPoseToStandingAbsoluteTrackingPose, GetRawZeroPoseToStandingAbsoluteTrackingPose,
        GetSortedTrackedDeviceIndicesOfClass, GetTrackedDeviceActivityLevel, ApplyTransform,
        GetTrackedDeviceIndexForControllerRole, GetControllerRoleForTrackedDeviceIndex,
        GetTrackedDeviceClass, IsTrackedDeviceConnected, GetBoolTrackedDeviceProperty,
        GetFloatTrackedDeviceProperty, GetInt32TrackedDeviceProperty, GetUint64TrackedDeviceProperty,
        GetMatrix34TrackedDeviceProperty, GetArrayTrackedDeviceProperty, GetStringTrackedDeviceProperty,
        GetPropErrorNameFromEnum, PollNextEvent, PollNextEventWithPose, PollNextEventWithPoseAndOverlays,
        GetEventTypeNameFromEnum, GetHiddenAreaMesh, GetControllerState, GetControllerStateWithPose,
        TriggerHapticPulse, GetButtonIdNameFromEnum, GetControllerAxisTypeNameFromEnum, IsInputAvailable,
        IsSteamVRDrawingControllers, ShouldApplicationPause, ShouldApplicationReduceRenderingWork,
        PerformFirmwareUpdate, AcknowledgeQuit_Exiting, GetAppContainerFilePaths, GetRuntimeVersion,
    ],
};

const SYSTEM_022: OlderTable = OlderTable {
    version: "IVRSystem_022",
    positions: positions![VR_IVRSystem_FnTable:
        GetRecommendedRenderTargetSize, GetProjectionMatrix, GetProjectionRaw, ComputeDistortion,
        GetEyeToHeadTransform, GetTimeSinceLastVsync, GetD3D9AdapterIndex, GetDXGIOutputInfo,
        GetOutputDevice, IsDisplayOnDesktop, SetDisplayVisibility, GetDeviceToAbsoluteTrackingPose,
        GetSeatedZeroPoseToStandingAbsoluteTrackingPose, GetRawZeroPoseToStandingAbsoluteTrackingPose,
        GetSortedTrackedDeviceIndicesOfClass, GetTrackedDeviceActivityLevel, ApplyTransform,
        GetTrackedDeviceIndexForControllerRole, GetControllerRoleForTrackedDeviceIndex,
        GetTrackedDeviceClass, IsTrackedDeviceConnected, GetBoolTrackedDeviceProperty,
        GetFloatTrackedDeviceProperty, GetInt32TrackedDeviceProperty, GetUint64TrackedDeviceProperty,
        GetMatrix34TrackedDeviceProperty, GetArrayTrackedDeviceProperty, GetStringTrackedDeviceProperty,
        GetPropErrorNameFromEnum, PollNextEvent, PollNextEventWithPose, GetEventTypeNameFromEnum,
        GetHiddenAreaMesh, GetControllerState, GetControllerStateWithPose, TriggerHapticPulse,
        GetButtonIdNameFromEnum, GetControllerAxisTypeNameFromEnum, IsInputAvailable,
        IsSteamVRDrawingControllers, ShouldApplicationPause, ShouldApplicationReduceRenderingWork,
        PerformFirmwareUpdate, AcknowledgeQuit_Exiting, GetAppContainerFilePaths, GetRuntimeVersion,
    ],
};

const APPLICATIONS_007: OlderTable = OlderTable {
    version: "IVRApplications_007",
    positions: positions![VR_IVRApplications_FnTable:
        AddApplicationManifest, RemoveApplicationManifest, IsApplicationInstalled, GetApplicationCount,
        GetApplicationKeyByIndex, GetApplicationKeyByProcessId, LaunchApplication,
        LaunchTemplateApplication, LaunchApplicationFromMimeType, LaunchDashboardOverlay,
        CancelApplicationLaunch, IdentifyApplication, GetApplicationProcessId,
        GetApplicationsErrorNameFromEnum, GetApplicationPropertyString, GetApplicationPropertyBool,
        GetApplicationPropertyUint64, SetApplicationAutoLaunch, GetApplicationAutoLaunch,
        SetDefaultApplicationForMimeType, GetDefaultApplicationForMimeType,
        GetApplicationSupportedMimeTypes, GetApplicationsThatSupportMimeType, GetApplicationLaunchArguments,
        GetStartingApplication, GetSceneApplicationState, PerformApplicationPrelaunchCheck,
        GetSceneApplicationStateNameFromEnum, LaunchInternalProcess, GetCurrentSceneProcessId,
    ],
};

const COMPOSITOR_028: OlderTable = OlderTable {
    version: "IVRCompositor_028",
    positions: positions![VR_IVRCompositor_FnTable:
        SetTrackingSpace, GetTrackingSpace, WaitGetPoses, GetLastPoses, GetLastPoseForTrackedDeviceIndex,
        Submit, SubmitWithArrayIndex, ClearLastSubmittedFrame, PostPresentHandoff, GetFrameTiming,
        GetFrameTimings, GetFrameTimeRemaining, GetCumulativeStats, FadeToColor, GetCurrentFadeColor,
        FadeGrid, GetCurrentGridAlpha, SetSkyboxOverride, ClearSkyboxOverride, CompositorBringToFront,
        CompositorGoToBack, CompositorQuit, IsFullscreen, GetCurrentSceneFocusProcess, GetLastFrameRenderer,
        CanRenderScene, ShowMirrorWindow, HideMirrorWindow, IsMirrorWindowVisible, CompositorDumpImages,
        ShouldAppRenderWithLowResources, ForceInterleavedReprojectionOn, ForceReconnectProcess,
        SuspendRendering, GetMirrorTextureD3D11, ReleaseMirrorTextureD3D11, GetMirrorTextureGL,
        ReleaseSharedGLTexture, LockGLSharedTextureForAccess, UnlockGLSharedTextureForAccess,
        GetVulkanInstanceExtensionsRequired, GetVulkanDeviceExtensionsRequired, SetExplicitTimingMode,
        SubmitExplicitTimingData, IsMotionSmoothingEnabled, IsMotionSmoothingSupported,
        IsCurrentSceneFocusAppLoading, SetStageOverride_Async, ClearStageOverride,
        GetCompositorBenchmarkResults, GetLastPosePredictionIDs, GetPosesForFrame,
    ],
};

const OVERLAY_027: OlderTable = OlderTable {
    version: "IVROverlay_027",
    positions: positions![VR_IVROverlay_FnTable:
        FindOverlay, CreateOverlay, DestroyOverlay, GetOverlayKey, GetOverlayName, SetOverlayName,
        GetOverlayImageData, GetOverlayErrorNameFromEnum, SetOverlayRenderingPid, GetOverlayRenderingPid,
        SetOverlayFlag, GetOverlayFlag, GetOverlayFlags, SetOverlayColor, GetOverlayColor, SetOverlayAlpha,
        GetOverlayAlpha, SetOverlayTexelAspect, GetOverlayTexelAspect, SetOverlaySortOrder,
        GetOverlaySortOrder, SetOverlayWidthInMeters, GetOverlayWidthInMeters, SetOverlayCurvature,
        GetOverlayCurvature, SetOverlayPreCurvePitch, GetOverlayPreCurvePitch, SetOverlayTextureColorSpace,
        GetOverlayTextureColorSpace, SetOverlayTextureBounds, GetOverlayTextureBounds,
        GetOverlayTransformType, SetOverlayTransformAbsolute, GetOverlayTransformAbsolute,
        SetOverlayTransformTrackedDeviceRelative, GetOverlayTransformTrackedDeviceRelative,
        SetOverlayTransformTrackedDeviceComponent, GetOverlayTransformTrackedDeviceComponent,
        SetOverlayTransformCursor, GetOverlayTransformCursor, SetOverlayTransformProjection, ShowOverlay,
        HideOverlay, IsOverlayVisible, GetTransformForOverlayCoordinates, WaitFrameSync,
        PollNextOverlayEvent, GetOverlayInputMethod, SetOverlayInputMethod, GetOverlayMouseScale,
        SetOverlayMouseScale, ComputeOverlayIntersection, IsHoverTargetOverlay, SetOverlayIntersectionMask,
        TriggerLaserMouseHapticVibration, SetOverlayCursor, SetOverlayCursorPositionOverride,
        ClearOverlayCursorPositionOverride, SetOverlayTexture, ClearOverlayTexture, SetOverlayRaw,
        SetOverlayFromFile, GetOverlayTexture, ReleaseNativeOverlayHandle, GetOverlayTextureSize,
        CreateDashboardOverlay, IsDashboardVisible, IsActiveDashboardOverlay,
        SetDashboardOverlaySceneProcess, GetDashboardOverlaySceneProcess, ShowDashboard,
        GetPrimaryDashboardDevice, ShowKeyboard, ShowKeyboardForOverlay, GetKeyboardText, HideKeyboard,
        SetKeyboardTransformAbsolute, SetKeyboardPositionForOverlay, ShowMessageOverlay,
        CloseMessageOverlay,
    ],
};
