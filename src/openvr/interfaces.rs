//! The interfaces of the runtime, in the versions that this program can use.
//!
//! From version to version Valve has inserted functions into these tables and removed, reordered or
//! changed none (`openvr_capi.h` of SDKs 1.26.7, 2.0.10, 2.2.3, 2.5.1, 2.12.1 and 2.15.6). So an
//! older table is the header's without what came later, and serves with those functions left out.

use std::ffi::{CStr, CString};

use super::error::OpenVrError;
use super::sys;

/// An interface: a table of nothing but function pointers, each of which may be missing.
///
/// # Safety
/// The type has no fields other than `Option`s of function pointers, in the order of the header;
/// each version's table has the functions of the type without those that it lacks, in that order.
pub(super) unsafe trait Interface: Copy + 'static {
    /// Names of the versions, newest first, with the indices of the functions that each lacks.
    const VERSIONS: &'static [(&'static CStr, &'static [usize])];
}

/// Declares an interface by its table, its version in the header, and older versions with what they
/// lack.
macro_rules! interface {
    ($table:ident, $newest:ident $(, $older:literal lacks [$($function:ident),*])*) => {
        // SAFETY: bindgen makes the table from the header; the older versions are those of the SDKs
        // named at the head of this file.
        unsafe impl Interface for sys::$table {
            const VERSIONS: &'static [(&'static CStr, &'static [usize])] = &[
                (sys::$newest, &[]),
                $(($older, &[$(std::mem::offset_of!(sys::$table, $function) / size_of::<usize>()),*]),)*
            ];
        }
    };
}

interface!(VR_IVRSystem_FnTable, IVRSystem_Version,
c"IVRSystem_023" lacks [
    ComputeDistortionSet, GetEyeTrackedFoveationCenter, GetEyeTrackedFoveationCenterForProjection, SetSDKVersion
],
c"IVRSystem_022" lacks [
    ComputeDistortionSet, GetEyeTrackedFoveationCenter, GetEyeTrackedFoveationCenterForProjection, SetSDKVersion,
    PollNextEventWithPoseAndOverlays
]);
interface!(VR_IVRApplications_FnTable, IVRApplications_Version, c"IVRApplications_007" lacks [RegisterSubprocess]);
interface!(VR_IVRCompositor_FnTable, IVRCompositor_Version,
    c"IVRCompositor_028" lacks [GetSubmitTexture],
    c"IVRCompositor_027" lacks [GetSubmitTexture, SubmitWithArrayIndex]);
interface!(VR_IVROverlay_FnTable, IVROverlay_Version,
    c"IVROverlay_027" lacks [CreateSubviewOverlay, SetSubviewPosition]);
interface!(VR_IVRSettings_FnTable, IVRSettings_Version);
interface!(VR_IVRChaperone_FnTable, IVRChaperone_Version);

/// The newest version of an interface that `request` finds: the address of a table by the name of
/// its version. A table with a null pointer counts as missing.
///
/// # Errors
/// There is none.
///
/// # Safety
/// An address belongs to a table of the version asked for, which stays in place for ever.
pub(super) unsafe fn find<T: Interface>(
    request: impl Fn(&CStr) -> Option<*const usize>,
) -> Result<&'static T, OpenVrError> {
    for (version, lacking) in T::VERSIONS {
        let Ok(name) = CString::new([b"FnTable:", version.to_bytes()].concat()) else { continue };
        let Some(found) = request(&name) else { continue };
        let count = size_of::<T>() / size_of::<usize>() - lacking.len();
        // SAFETY: a table of this version has this many pointers (contract of the trait and of this
        // function).
        let words = unsafe { std::slice::from_raw_parts(found, count) };
        if words.contains(&0) {
            continue;
        }
        if lacking.is_empty() {
            // SAFETY: the table is one of the newest version, which is that of the type.
            return Ok(unsafe { &*found.cast::<T>() });
        }
        return Ok(with_gaps(words, lacking));
    }
    let names = T::VERSIONS.iter().map(|(version, _)| version.to_string_lossy().into_owned());
    Err(OpenVrError::Interface(names.collect::<Vec<_>>().join(" or ")))
}

/// The header's table of an older one's functions. It is leaked, as all tables of the library are:
/// once per session and interface, less than a kilobyte.
fn with_gaps<T: Interface>(words: &[usize], lacking: &[usize]) -> &'static T {
    let mut words = words.iter();
    let all: Vec<usize> = (0..size_of::<T>() / size_of::<usize>())
        .map(|index| if lacking.contains(&index) { 0 } else { words.next().copied().unwrap_or(0) })
        .collect();
    let all = Box::leak(all.into_boxed_slice());
    // SAFETY: as many words as the table has, aligned as pointers; the null ones are missing
    // functions, and the others were of the same types in the older table.
    unsafe { &*all.as_ptr().cast::<T>() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A table that stays in place, whose functions are their positions.
    fn positions(count: usize) -> *const usize {
        Box::leak((1..=count).collect::<Vec<usize>>().into_boxed_slice()).as_ptr()
    }

    /// Address of a function in a found table.
    fn address<T: Interface>(table: &T, offset: usize) -> usize {
        // SAFETY: a table consists of words.
        unsafe { *std::ptr::from_ref(table).cast::<usize>().add(offset / size_of::<usize>()) }
    }

    macro_rules! position {
        ($table:expr, $kind:ident, $function:ident) => {
            address($table, std::mem::offset_of!(sys::$kind, $function))
        };
    }

    /// The table that a runtime with this version alone gives.
    fn found<T: Interface>(version: &str, count: usize) -> Result<&'static T, OpenVrError> {
        let request = |name: &CStr| (name.to_str() == Ok(&format!("FnTable:{version}"))).then(|| positions(count));
        // SAFETY: the addresses are never called, and the tables are leaked.
        unsafe { find(request) }
    }

    /// Positions are those in `openvr_capi.h` of SDKs 2.15.6, 2.12.1, 2.5.1 and 2.0.10.
    #[test]
    fn functions_of_every_version_keep_their_places() {
        for (version, count, vsync, event, pulse, exiting) in [
            ("IVRSystem_026", 51, 7, 31, 40, 48),
            ("IVRSystem_023", 47, 6, 30, 37, 45),
            ("IVRSystem_022", 46, 6, 30, 36, 44),
        ] {
            let table: &sys::VR_IVRSystem_FnTable = found(version, count).unwrap();
            assert_eq!(position!(table, VR_IVRSystem_FnTable, GetRecommendedRenderTargetSize), 1);
            assert_eq!(position!(table, VR_IVRSystem_FnTable, GetTimeSinceLastVsync), vsync);
            assert_eq!(position!(table, VR_IVRSystem_FnTable, PollNextEvent), event);
            assert_eq!(position!(table, VR_IVRSystem_FnTable, TriggerHapticPulse), pulse);
            assert_eq!(position!(table, VR_IVRSystem_FnTable, AcknowledgeQuit_Exiting), exiting);
            assert_eq!(table.SetSDKVersion.is_some(), version == "IVRSystem_026");
        }
        for (version, count, wait, texture, tab) in
            [("IVROverlay_028", 82, 48, 61, 68), ("IVROverlay_027", 80, 46, 59, 66)]
        {
            let table: &sys::VR_IVROverlay_FnTable = found(version, count).unwrap();
            assert_eq!(position!(table, VR_IVROverlay_FnTable, WaitFrameSync), wait);
            assert_eq!(position!(table, VR_IVROverlay_FnTable, SetOverlayTexture), texture);
            assert_eq!(position!(table, VR_IVROverlay_FnTable, CreateDashboardOverlay), tab);
        }
        for (version, count, extensions) in
            [("IVRCompositor_029", 53, 43), ("IVRCompositor_028", 52, 42), ("IVRCompositor_027", 51, 41)]
        {
            let table: &sys::VR_IVRCompositor_FnTable = found(version, count).unwrap();
            assert_eq!(position!(table, VR_IVRCompositor_FnTable, GetVulkanDeviceExtensionsRequired), extensions);
        }
        for (version, count) in [("IVRApplications_008", 31), ("IVRApplications_007", 30)] {
            let table: &sys::VR_IVRApplications_FnTable = found(version, count).unwrap();
            assert_eq!(position!(table, VR_IVRApplications_FnTable, IdentifyApplication), 12);
            assert_eq!(position!(table, VR_IVRApplications_FnTable, SetApplicationAutoLaunch), 18);
        }
    }

    #[test]
    fn unknown_versions_and_null_pointers_are_no_interface() {
        let Err(error) = found::<sys::VR_IVRSystem_FnTable>("IVRSystem_021", 46) else { panic!("it is too old") };
        assert_eq!(error, OpenVrError::Interface("IVRSystem_026 or IVRSystem_023 or IVRSystem_022".into()));
        let holes = |name: &CStr| {
            (name == c"FnTable:IVRSettings_003").then(|| [0usize; 11].as_slice().to_vec().leak().as_ptr())
        };
        // SAFETY: as in `found`.
        assert!(unsafe { find::<sys::VR_IVRSettings_FnTable>(holes) }.is_err());
    }
}
