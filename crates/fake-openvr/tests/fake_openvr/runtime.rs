//! Loads the library and calls it as a program does.

use std::ffi::{CStr, CString, c_char, c_int, c_void};

use glam::{DMat4, DVec3, DVec4};

use crate::sys;

/// Calls a function of a table.
macro_rules! call {
    ($table:expr, $name:ident $(, $argument:expr)* $(,)?) => {
        // SAFETY: the function of a loaded library; the arguments are as the interface requires, or
        // null on purpose.
        unsafe { ($table.$name.expect(stringify!($name)))($($argument),*) }
    };
}
pub(crate) use call;

#[repr(C)]
struct CoreTable {
    init: unsafe extern "C" fn(*mut c_void, u32, *const c_char) -> u32,
    cleanup: unsafe extern "C" fn(*mut c_void),
    is_interface_version_valid: unsafe extern "C" fn(*mut c_void, *const c_char) -> u32,
    get_generic_interface: unsafe extern "C" fn(*mut c_void, *const c_char, *mut u32) -> *mut c_void,
}

type Factory = unsafe extern "C" fn(*const c_char, *mut c_int) -> *mut c_void;

/// The loaded library.
pub struct Runtime {
    core: *mut c_void,
    pub system: &'static sys::VR_IVRSystem_FnTable,
    pub overlay: &'static sys::VR_IVROverlay_FnTable,
    pub compositor: &'static sys::VR_IVRCompositor_FnTable,
    pub applications: &'static sys::VR_IVRApplications_FnTable,
    pub chaperone: &'static sys::VR_IVRChaperone_FnTable,
    pub settings: &'static sys::VR_IVRSettings_FnTable,
}

fn core_table(core: *mut c_void) -> &'static CoreTable {
    // SAFETY: the first word of the client core points to its functions, for as long as the library
    // is loaded.
    unsafe { &**core.cast::<*const CoreTable>() }
}

fn table<T>(core: *mut c_void, version: &CStr) -> &'static T {
    let name = CString::new(format!("FnTable:{}", version.to_str().unwrap())).unwrap();
    let (mut error, table) = (u32::MAX, core_table(core));
    // SAFETY: a live core, a zero-terminated text and room for a number; the table is valid for as
    // long as the library is loaded.
    unsafe {
        assert_eq!((table.is_interface_version_valid)(core, version.as_ptr()), 0);
        let found = (table.get_generic_interface)(core, name.as_ptr(), &mut error).cast::<T>();
        assert_eq!(error, 0);
        found.as_ref().unwrap()
    }
}

/// Loads the library named by the registry file. Returns its client core.
fn load() -> *mut c_void {
    let registry = crate::rig::read_json(std::env::var("VR_PATHREG_OVERRIDE").unwrap().as_ref());
    let path = format!("{}/bin/linux64/vrclient.so", registry["runtime"][0].as_str().unwrap());
    let mut error = -1;
    // SAFETY: the library of the fake runtime, which is never unloaded; the factory takes a
    // zero-terminated text and room for a number.
    let core = unsafe {
        let library = Box::leak(Box::new(libloading::Library::new(path).unwrap()));
        let factory = library.get::<Factory>(b"VRClientCoreFactory\0").unwrap();
        assert!(factory(c"IVRClientCore_999".as_ptr(), &mut error).is_null());
        factory(c"IVRClientCore_003".as_ptr(), &mut error)
    };
    assert!(!core.is_null() && error == 0);
    core
}

fn init(core: *mut c_void, kind: sys::EVRApplicationType) -> u32 {
    // SAFETY: a live core; no startup info.
    unsafe { (core_table(core).init)(core, kind, std::ptr::null()) }
}

/// Without Init, no interface is available.
fn assert_nothing_before_init(core: *mut c_void) {
    let mut error = 0;
    let name = c"FnTable:IVRSystem_026".as_ptr();
    // SAFETY: a live core, a zero-terminated text, room for a number.
    let found = unsafe { (core_table(core).get_generic_interface)(core, name, &mut error) };
    assert_eq!((found.is_null(), error), (true, sys::EVRInitError_VRInitError_Init_NotInitialized));
}

impl Runtime {
    /// Loads the library, connects with an application type, and requests the tables.
    pub fn connected_as(kind: sys::EVRApplicationType) -> Self {
        let core = load();
        assert_nothing_before_init(core);
        assert_eq!(init(core, kind), 0);
        Self {
            core,
            system: table(core, sys::IVRSystem_Version),
            overlay: table(core, sys::IVROverlay_Version),
            compositor: table(core, sys::IVRCompositor_Version),
            applications: table(core, sys::IVRApplications_Version),
            chaperone: table(core, sys::IVRChaperone_Version),
            settings: table(core, sys::IVRSettings_Version),
        }
    }

    /// Loads the library and connects as an overlay.
    pub fn connected() -> Self {
        Self::connected_as(sys::EVRApplicationType_VRApplication_Overlay)
    }

    /// Connects again. Returns the error code.
    pub fn init_as(&self, kind: sys::EVRApplicationType) -> u32 {
        init(self.core, kind)
    }

    /// Sets the SDK version through IVRSystem as a C++ object, as Valve's loader does. Returns the
    /// error code.
    pub fn set_sdk_version_in_cpp(&self, [major, minor, build]: [u32; 3]) -> u32 {
        type SetSdkVersion = unsafe extern "C" fn(*mut c_void, u32, u32, u32) -> u32;
        // The last function of the class.
        let last = size_of::<sys::VR_IVRSystem_FnTable>() / size_of::<usize>() - 1;
        let (mut error, name) = (u32::MAX, sys::IVRSystem_Version.as_ptr());
        // SAFETY: the first word of a C++ object points to its functions, each of which takes the
        // object first.
        unsafe {
            let object = (core_table(self.core).get_generic_interface)(self.core, name, &mut error);
            assert_eq!((object.is_null(), error), (false, 0));
            (*(*object.cast::<*const SetSdkVersion>()).add(last))(object, major, minor, build)
        }
    }

    /// Disconnects.
    pub fn cleanup(&self) {
        // SAFETY: a live core.
        unsafe { (core_table(self.core).cleanup)(self.core) }
    }

    /// Poses of the first devices.
    pub fn poses(&self, origin: u32, ahead_s: f32) -> [sys::TrackedDevicePose_t; 3] {
        let mut poses = [NO_POSE; 3];
        call!(self.system, GetDeviceToAbsoluteTrackingPose, origin, ahead_s, poses.as_mut_ptr(), 3);
        poses
    }

    /// Pose of the head in a universe.
    pub fn head(&self, origin: u32) -> DMat4 {
        let pose = self.poses(origin, 0.0)[0];
        assert!(pose.bPoseIsValid);
        from_matrix(&pose.mDeviceToAbsoluteTracking)
    }

    /// The next event.
    pub fn event(&self) -> Option<sys::VREvent_t> {
        // SAFETY: an event consists of numbers, for which zeros are valid.
        let mut event: sys::VREvent_t = unsafe { std::mem::zeroed() };
        call!(self.system, PollNextEvent, &mut event, size_of::<sys::VREvent_t>() as u32).then_some(event)
    }

    /// Creates an overlay.
    pub fn create(&self, key: &CStr) -> u64 {
        let mut handle = 0;
        let error = call!(self.overlay, CreateOverlay, text(key), text(key), &mut handle);
        assert_eq!((error, handle != 0), (0, true));
        handle
    }
}

const NO_POSE: sys::TrackedDevicePose_t = sys::TrackedDevicePose_t {
    mDeviceToAbsoluteTracking: sys::HmdMatrix34_t { m: [[0.0; 4]; 3] },
    vVelocity: sys::HmdVector3_t { v: [0.0; 3] },
    vAngularVelocity: sys::HmdVector3_t { v: [0.0; 3] },
    eTrackingResult: 0,
    bPoseIsValid: false,
    bDeviceIsConnected: false,
};

/// A text as the interfaces take it.
pub fn text(text: &CStr) -> *mut c_char {
    text.as_ptr().cast_mut()
}

/// A runtime's matrix as a 4 × 4 matrix.
pub fn from_matrix(matrix: &sys::HmdMatrix34_t) -> DMat4 {
    let row = |r: usize| DVec4::from_array(matrix.m[r].map(f64::from));
    DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose()
}

/// A matrix as the runtime takes it.
pub fn to_matrix(matrix: DMat4) -> sys::HmdMatrix34_t {
    let row = |r: usize| matrix.row(r).to_array().map(|v| v as f32);
    sys::HmdMatrix34_t { m: [row(0), row(1), row(2)] }
}

/// A rotation about y and a translation.
pub fn placed(yaw_deg: f64, place: [f64; 3]) -> DMat4 {
    DMat4::from_translation(DVec3::from_array(place)) * DMat4::from_rotation_y(yaw_deg.to_radians())
}

/// Asserts that two transforms are equal to the precision of 32-bit numbers.
#[track_caller]
pub fn assert_same(a: DMat4, b: DMat4) {
    assert!(a.abs_diff_eq(b, 2e-6), "{a}\n{b}");
}
