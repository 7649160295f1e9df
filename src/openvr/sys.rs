//! SteamVR's C interfaces as bindgen read them from Valve's `openvr_capi.h` (build.rs).
//!
//! Two of its structures differ on Linux from what the runtime means, `VRControllerState_t` and
//! `Compositor_FrameTiming`: neither is used.

#![allow(non_upper_case_globals, non_camel_case_types, non_snake_case, dead_code, missing_docs)]
#![allow(clippy::all, clippy::pedantic)]

include!(concat!(env!("OUT_DIR"), "/openvr.rs"));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structure_sizes_match_the_runtime() {
        assert_eq!(size_of::<VREvent_t>(), if cfg!(unix) { 60 } else { 64 });
        assert_eq!(size_of::<TrackedDevicePose_t>(), 80);
        assert_eq!(size_of::<VRVulkanTextureData_t>(), 64);
        assert_eq!(size_of::<HmdMatrix34_t>(), 48);
        assert_eq!(size_of::<VROverlayProjection_t>(), 16);
    }

    #[test]
    fn interface_versions_match_the_code() {
        assert_eq!(IVRSystem_Version, c"IVRSystem_026");
        assert_eq!(IVROverlay_Version, c"IVROverlay_028");
        assert_eq!(IVRCompositor_Version, c"IVRCompositor_029");
    }
}
