//! The runtime's library in this process: loading, connecting, function tables, disconnecting.
//!
//! The library exports one function, which returns a C++ object (`IVRClientCore_003`). That object
//! returns the function tables of the interfaces. The order is that of Valve's loader: path,
//! library, factory, Init, SetSDKVersion, tables; Cleanup at the end. Everything returned here
//! lives at most as long as its [`Runtime`]. The library stays loaded, because its threads may
//! still be terminating.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::OpenVrError;
use super::runtime_paths::RuntimePaths;
use super::sys;

/// Interface of the core object.
const CORE: &CStr = c"IVRClientCore_003";
/// Version of Valve's header that the bindings are made from.
const SDK_VERSION: [u32; 3] = [2, 15, 6];
/// The library supports one session per process.
static IS_IN_USE: AtomicBool = AtomicBool::new(false);

type Factory = unsafe extern "C" fn(*const c_char, *mut c_int) -> *mut c_void;

/// How this program connects to the runtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Draws over a game. Starts SteamVR if it is not running.
    Overlay,
    /// Draws nothing, and never starts SteamVR.
    Background,
    /// Needs no headset: for installing.
    Utility,
}

/// The core object: a pointer to its virtual function table.
#[repr(C)]
struct Core {
    functions: *const CoreFunctions,
}

/// In declaration order. `this` comes first, as C++ passes it on every 64-bit system that SteamVR
/// supports.
#[repr(C)]
struct CoreFunctions {
    init: unsafe extern "C" fn(*mut Core, sys::EVRApplicationType, *const c_char) -> sys::EVRInitError,
    cleanup: unsafe extern "C" fn(*mut Core),
    is_interface_version_valid: unsafe extern "C" fn(*mut Core, *const c_char) -> sys::EVRInitError,
    get_generic_interface: unsafe extern "C" fn(*mut Core, *const c_char, *mut sys::EVRInitError) -> *mut c_void,
    _is_hmd_present: unsafe extern "C" fn(*mut Core) -> bool,
    english_for_init_error: unsafe extern "C" fn(*mut Core, sys::EVRInitError) -> *const c_char,
    id_for_init_error: unsafe extern "C" fn(*mut Core, sys::EVRInitError) -> *const c_char,
}

/// A session with the runtime. One at a time per process.
pub struct Runtime {
    core: *mut Core,
    pub(super) system: &'static sys::VR_IVRSystem_FnTable,
    pub(super) applications: &'static sys::VR_IVRApplications_FnTable,
    pub(super) settings: &'static sys::VR_IVRSettings_FnTable,
    /// The following are `None` for [`Role::Utility`].
    pub(super) overlay: Option<&'static sys::VR_IVROverlay_FnTable>,
    pub(super) compositor: Option<&'static sys::VR_IVRCompositor_FnTable>,
    pub(super) chaperone: Option<&'static sys::VR_IVRChaperone_FnTable>,
}

// SAFETY: the interfaces may be called from any thread, as the runtime locks internally (Valve's
// manual, "API overview"). Only SetOverlayTexture is bound to the thread that uses the queue;
// `OverlaySlots` guarantees this by being neither Send nor Sync.
unsafe impl Send for Runtime {}
// SAFETY: as above.
unsafe impl Sync for Runtime {}

/// Calls a function of a table. `table` accepts only tables without null pointers, so the function
/// always exists.
macro_rules! call {
    ($table:expr, $function:ident ( $($argument:expr),* $(,)? )) => {
        match $table.$function {
            // SAFETY: the function belongs to the table of a live session and has the signature in
            // the header; the arguments outlive the call.
            Some(function) => unsafe { function($($argument),*) },
            None => unreachable!("null pointer in a checked function table"),
        }
    };
}
pub(super) use call;

impl Runtime {
    /// Loads the runtime and connects to it.
    ///
    /// # Errors
    /// The library is not a VR runtime; the runtime is not running, rejects the connection, or is
    /// too old; or this process already has a session.
    pub fn start(paths: &RuntimePaths, role: Role) -> Result<Self, OpenVrError> {
        if IS_IN_USE.swap(true, Ordering::AcqRel) {
            let (code, name) =
                (i64::from(sys::EVRInitError_VRInitError_Init_AlreadyRunning), "AlreadyRunning".to_owned());
            return Err(OpenVrError::Refused { code, name, text: "only one session per process".to_owned() });
        }
        let started = Self::connect(paths, role);
        if started.is_err() {
            IS_IN_USE.store(false, Ordering::Release);
        }
        started
    }

    fn connect(paths: &RuntimePaths, role: Role) -> Result<Self, OpenVrError> {
        let core = load(paths)?;
        let kind = match role {
            Role::Overlay => sys::EVRApplicationType_VRApplication_Overlay,
            Role::Background => sys::EVRApplicationType_VRApplication_Background,
            Role::Utility => sys::EVRApplicationType_VRApplication_Utility,
        };
        let functions = functions(core);
        // SAFETY: the core is alive, its table is in the order of its interface, and the startup
        // text may be null.
        let error = unsafe { (functions.init)(core, kind, std::ptr::null()) };
        if error != sys::EVRInitError_VRInitError_None {
            return Err(init_error(core, error));
        }
        // From here on, the session must be ended on every path.
        let guard = CleanupGuard(core);
        // SAFETY: a session is active; the text is zero-terminated.
        let error = unsafe { (functions.is_interface_version_valid)(core, sys::IVRSystem_Version.as_ptr()) };
        if error != sys::EVRInitError_VRInitError_None {
            return Err(OpenVrError::Interface(sys::IVRSystem_Version.to_string_lossy().into_owned()));
        }
        let system: &'static sys::VR_IVRSystem_FnTable = table(core, sys::IVRSystem_Version)?;
        let [major, minor, build] = SDK_VERSION;
        let error = call!(system, SetSDKVersion(major, minor, build));
        let known =
            [sys::EVRInitError_VRInitError_None, sys::EVRInitError_VRInitError_Init_ClientVersionAlreadyProvided];
        if !known.contains(&error) {
            return Err(init_error(core, error));
        }
        let draws = role != Role::Utility;
        let runtime = Self {
            core,
            system,
            applications: table(core, sys::IVRApplications_Version)?,
            settings: table(core, sys::IVRSettings_Version)?,
            overlay: draws.then(|| table(core, sys::IVROverlay_Version)).transpose()?,
            compositor: draws.then(|| table(core, sys::IVRCompositor_Version)).transpose()?,
            chaperone: draws.then(|| table(core, sys::IVRChaperone_Version)).transpose()?,
        };
        std::mem::forget(guard);
        Ok(runtime)
    }

    /// Version of SteamVR, as it reports it.
    pub fn version(&self) -> String {
        string_from(call!(self.system, GetRuntimeVersion()))
    }
}

impl Drop for Runtime {
    fn drop(&mut self) {
        drop(CleanupGuard(self.core));
        IS_IN_USE.store(false, Ordering::Release);
    }
}

/// Ends the session when dropped.
struct CleanupGuard(*mut Core);

impl Drop for CleanupGuard {
    fn drop(&mut self) {
        // SAFETY: the session is active, and nothing of it is used afterwards: tables are only
        // reached through `Runtime`.
        unsafe { (functions(self.0).cleanup)(self.0) }
    }
}

/// Loads the library and returns its core object.
fn load(paths: &RuntimePaths) -> Result<*mut Core, OpenVrError> {
    let bad = |reason: String| OpenVrError::Library { path: paths.library.clone(), reason };
    // SAFETY: loading runs the library's initialisers. It is the runtime named by the user's own
    // registry file, the same one that every SteamVR program loads.
    let library = unsafe { libloading::Library::new(&paths.library) }.map_err(|error| bad(error.to_string()))?;
    // Stays loaded: see the head of this file.
    let library: &'static libloading::Library = Box::leak(Box::new(library));
    // SAFETY: the signature used by Valve's loader.
    let factory: libloading::Symbol<Factory> = unsafe { library.get(b"VRClientCoreFactory\0") }
        .map_err(|error| bad(format!("it is no VR runtime ({error})")))?;
    let mut code: c_int = 0;
    // SAFETY: a zero-terminated text and a variable for a number.
    let core = unsafe { factory(CORE.as_ptr(), &mut code) }.cast::<Core>();
    if core.is_null() {
        return Err(bad(format!("it has no {} (error {code})", CORE.to_string_lossy())));
    }
    Ok(core)
}

fn functions(core: *mut Core) -> &'static CoreFunctions {
    // SAFETY: the core came from the factory and is never freed; its first word points to its
    // table, which is constant.
    unsafe { &*(*core).functions }
}

/// A function table without null pointers.
fn table<T>(core: *mut Core, version: &CStr) -> Result<&'static T, OpenVrError> {
    let missing = || OpenVrError::Interface(version.to_string_lossy().into_owned());
    let name = [b"FnTable:", version.to_bytes()].concat();
    let name = CString::new(name).map_err(|_| missing())?;
    let mut error = sys::EVRInitError_VRInitError_None;
    // SAFETY: a session is active; a zero-terminated text and a variable for a number.
    let found = unsafe { (functions(core).get_generic_interface)(core, name.as_ptr(), &mut error) };
    if found.is_null() || error != sys::EVRInitError_VRInitError_None {
        return Err(missing());
    }
    // SAFETY: an interface of this version has this many functions, and a table consists only of
    // function pointers.
    let words = unsafe { std::slice::from_raw_parts(found.cast::<usize>(), size_of::<T>() / size_of::<usize>()) };
    if words.contains(&0) {
        return Err(missing());
    }
    // SAFETY: as above; the table stays in place while the library is loaded.
    Ok(unsafe { &*found.cast::<T>() })
}

/// The error for a failed Init.
fn init_error(core: *mut Core, error: sys::EVRInitError) -> OpenVrError {
    match error {
        sys::EVRInitError_VRInitError_Init_NoServerForBackgroundApp => OpenVrError::NotRunning,
        sys::EVRInitError_VRInitError_Init_HmdNotFound
        | sys::EVRInitError_VRInitError_Init_HmdNotFoundPresenceFailed => OpenVrError::NoHeadset,
        _ => {
            let functions = functions(core);
            // SAFETY: the core is alive; it returns a constant text or null.
            let name = string_from(unsafe { (functions.id_for_init_error)(core, error) });
            // SAFETY: as above.
            let text = string_from(unsafe { (functions.english_for_init_error)(core, error) });
            OpenVrError::Refused { code: i64::from(error), name, text }
        }
    }
}

/// A text of the runtime, which may be null.
pub(super) fn string_from(text: *const c_char) -> String {
    if text.is_null() {
        return "no error text".to_owned();
    }
    // SAFETY: not null, and the runtime's texts are zero-terminated constants.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
