//! The exports of the library: the client core object that Valve's loader and this program request.
//! It has the C++ layout: its first word points to a table of functions, each of which takes the
//! object as first argument.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::LazyLock;

use crate::memory::{read_text, write};
use crate::older_tables::OlderTable;
use crate::table::text;
use crate::{applications, chaperone, compositor, overlay_table, settings, sys, system, world};

const NONE: u32 = sys::EVRInitError_VRInitError_None;
const NOT_FOUND: u32 = sys::EVRInitError_VRInitError_Init_InterfaceNotFound;
const NOT_INITIALIZED: u32 = sys::EVRInitError_VRInitError_Init_NotInitialized;
/// Number of functions of IVRSystem_026. The last one is SetSDKVersion.
const SYSTEM_FUNCTIONS: usize = size_of::<sys::VR_IVRSystem_FnTable>() / size_of::<usize>();

#[repr(C)]
struct ClientCoreTable {
    init: unsafe extern "C" fn(*mut c_void, u32, *const c_char) -> u32,
    cleanup: unsafe extern "C" fn(*mut c_void),
    is_interface_version_valid: unsafe extern "C" fn(*mut c_void, *const c_char) -> u32,
    get_generic_interface: unsafe extern "C" fn(*mut c_void, *const c_char, *mut u32) -> *mut c_void,
    is_hmd_present: unsafe extern "C" fn(*mut c_void) -> bool,
    error_text: unsafe extern "C" fn(*mut c_void, u32) -> *const c_char,
    error_name: unsafe extern "C" fn(*mut c_void, u32) -> *const c_char,
}

static CLIENT_CORE_TABLE: ClientCoreTable = ClientCoreTable {
    init,
    cleanup,
    is_interface_version_valid,
    get_generic_interface,
    is_hmd_present,
    error_text,
    error_name,
};
static CLIENT_CORE: &ClientCoreTable = &CLIENT_CORE_TABLE;

/// Function tables by interface. Created on first use and never freed, because clients keep
/// pointers to them.
static TABLES: LazyLock<[(&'static CStr, usize); 6]> = LazyLock::new(|| {
    [
        (sys::IVRSystem_Version, system::new_table()),
        (sys::IVROverlay_Version, overlay_table::new_table()),
        (sys::IVRCompositor_Version, compositor::new_table()),
        (sys::IVRApplications_Version, applications::new_table()),
        (sys::IVRChaperone_Version, chaperone::new_table()),
        (sys::IVRSettings_Version, settings::new_table()),
    ]
});

/// IVRSystem as a C++ object: Valve's loader calls SetSDKVersion through it.
static SYSTEM_OBJECT: LazyLock<usize> = LazyLock::new(|| {
    let mut functions = [cpp_unsupported as *const () as usize; SYSTEM_FUNCTIONS];
    functions[SYSTEM_FUNCTIONS - 1] = cpp_set_sdk_version as *const () as usize;
    let functions = Box::leak(Box::new(functions));
    std::ptr::from_mut(Box::leak(Box::new(functions.as_ptr()))) as usize
});

/// Returns the client core.
///
/// # Safety
/// `name` is null or zero-terminated; `error` is null or points to an integer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn VRClientCoreFactory(name: *const c_char, error: *mut c_int) -> *mut c_void {
    if read_text(name) == Some("IVRClientCore_003") {
        write(error, NONE as c_int);
        return std::ptr::from_ref(&CLIENT_CORE).cast_mut().cast();
    }
    write(error, NOT_FOUND as c_int);
    std::ptr::null_mut()
}

unsafe extern "C" fn init(_this: *mut c_void, application_type: u32, _startup_info: *const c_char) -> u32 {
    match world::init(application_type) {
        Ok(()) => NONE,
        Err((code, why)) => {
            eprintln!("fake runtime: Init: {why}");
            code
        }
    }
}

unsafe extern "C" fn cleanup(_this: *mut c_void) {
    world::cleanup();
}

/// The table of a version, if the SDK of this runtime has it.
fn find(name: &str) -> Option<usize> {
    let older = world::sdk().older();
    if let Some(older) = older.iter().find(|older| older.version == name) {
        return older_table(older);
    }
    let (version, table) = TABLES.iter().find(|(version, _)| version.to_str() == Ok(name))?;
    let is_replaced =
        older.iter().any(|older| interface_of(older.version) == version.to_str().ok().and_then(interface_of));
    (!is_replaced).then_some(*table)
}

/// An interface's name without its version.
fn interface_of(version: &str) -> Option<&str> {
    version.split_once('_').map(|(interface, _)| interface)
}

/// The functions of the newest table in the order of an older one.
fn older_table(older: &OlderTable) -> Option<usize> {
    let is_same = |version: &CStr| version.to_str().ok().and_then(interface_of) == interface_of(older.version);
    let (_, newest) = TABLES.iter().find(|(version, _)| is_same(version))?;
    // SAFETY: the positions are within the newest table, which is leaked and holds only pointers.
    let function = |position: &usize| unsafe { *(*newest as *const usize).add(*position) };
    let table: Vec<usize> = older.positions.iter().map(function).collect();
    Some(table.leak().as_ptr() as usize)
}

unsafe extern "C" fn is_interface_version_valid(_this: *mut c_void, name: *const c_char) -> u32 {
    let found = read_text(name).and_then(find);
    if found.is_some() { NONE } else { NOT_FOUND }
}

unsafe extern "C" fn get_generic_interface(_this: *mut c_void, name: *const c_char, error: *mut u32) -> *mut c_void {
    let name = read_text(name).unwrap_or_default();
    if !world::is_running() {
        eprintln!("fake runtime: violation: {name:?} was requested without Init");
        write(error, NOT_INITIALIZED);
        return std::ptr::null_mut();
    }
    let found = match name.strip_prefix("FnTable:") {
        Some(version) => find(version),
        None => (find(name) == find("IVRSystem_026") && find(name).is_some()).then(|| *SYSTEM_OBJECT),
    };
    write(error, if found.is_some() { NONE } else { NOT_FOUND });
    if found.is_none() {
        eprintln!("fake runtime: there is no interface {name:?}");
    }
    found.map_or(std::ptr::null_mut(), |address| address as *mut c_void)
}

unsafe extern "C" fn is_hmd_present(_this: *mut c_void) -> bool {
    true
}

/// Name and text of the errors that the fake runtime returns.
fn error(code: u32) -> (&'static CStr, &'static CStr) {
    match code {
        NONE => (c"VRInitError_None", c"No Error (0)"),
        sys::EVRInitError_VRInitError_Init_NoServerForBackgroundApp => {
            (c"VRInitError_Init_NoServerForBackgroundApp", c"VR server is not running (121)")
        }
        sys::EVRInitError_VRInitError_IPC_ServerInitFailed => {
            (c"VRInitError_IPC_ServerInitFailed", c"VR server could not be started (300)")
        }
        sys::EVRInitError_VRInitError_Init_NoConfigPath => {
            (c"VRInitError_Init_NoConfigPath", c"VR configuration could not be read (111)")
        }
        NOT_FOUND => (c"VRInitError_Init_InterfaceNotFound", c"Interface Not Found (105)"),
        NOT_INITIALIZED => (c"VRInitError_Init_NotInitialized", c"Not Initialized (109)"),
        _ => (c"VRInitError_Unknown", c"Unknown error"),
    }
}

unsafe extern "C" fn error_text(_this: *mut c_void, code: u32) -> *const c_char {
    text(error(code).1)
}

unsafe extern "C" fn error_name(_this: *mut c_void, code: u32) -> *const c_char {
    text(error(code).0)
}

unsafe extern "C" fn cpp_unsupported(_this: *mut c_void) -> usize {
    world::unsupported("IVRSystem as a C++ object");
    0
}

unsafe extern "C" fn cpp_set_sdk_version(_this: *mut c_void, major: u32, minor: u32, build: u32) -> u32 {
    system::sdk_version([major, minor, build])
}
