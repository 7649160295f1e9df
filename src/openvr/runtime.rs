//! The runtime's library in this process: loading, connecting, function tables, disconnecting.
//!
//! The library exports one function, which returns a C++ object (`IVRClientCore_003`). That object
//! returns the function tables of the interfaces. The order is that of Valve's loader: path,
//! library, factory, Init, SetSDKVersion, tables; Cleanup at the end. Everything returned here
//! lives at most as long as its [`Runtime`]. The library stays loaded, because its threads may
//! still be terminating.

use std::cell::Cell;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::error::OpenVrError;
use super::interfaces::{self, Interface};
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
    _is_interface_version_valid: unsafe extern "C" fn(*mut Core, *const c_char) -> sys::EVRInitError,
    get_generic_interface: unsafe extern "C" fn(*mut Core, *const c_char, *mut sys::EVRInitError) -> *mut c_void,
    _is_hmd_present: unsafe extern "C" fn(*mut Core) -> bool,
    english_for_init_error: unsafe extern "C" fn(*mut Core, sys::EVRInitError) -> *const c_char,
    id_for_init_error: unsafe extern "C" fn(*mut Core, sys::EVRInitError) -> *const c_char,
}

/// A session with the runtime. One at a time per process.
pub struct Runtime {
    core: *mut Core,
    /// What it is, as [`RuntimePaths::name`].
    name: String,
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

/// Calls a function of a table. It exists: `interfaces::find` accepts only tables without null
/// pointers, and none of what older versions lack is called but SetSDKVersion, where it exists.
macro_rules! call {
    ($table:expr, $function:ident ( $($argument:expr),* $(,)? )) => {
        match $table.$function {
            Some(function) => {
                let _timed = $crate::openvr::runtime::TimedCall::begin();
                // SAFETY: the function belongs to the table of a live session and has the signature in
                // the header; the arguments outlive the call.
                unsafe { function($($argument),*) }
            }
            None => unreachable!("null pointer in a checked function table"),
        }
    };
}
pub(super) use call;

thread_local! {
    /// Time that this thread has spent in calls of the runtime, nanoseconds.
    static IN_RUNTIME_NS: Cell<i64> = const { Cell::new(0) };
}

/// Time that this thread has spent in calls of the runtime so far, nanoseconds.
pub fn time_in_runtime_ns() -> i64 {
    IN_RUNTIME_NS.get()
}

/// Measures a call until it is dropped.
pub(super) struct TimedCall(Instant);

impl TimedCall {
    pub fn begin() -> Self {
        Self(Instant::now())
    }
}

impl Drop for TimedCall {
    fn drop(&mut self) {
        IN_RUNTIME_NS.set(IN_RUNTIME_NS.get() + self.0.elapsed().as_nanos() as i64);
    }
}

impl Runtime {
    /// Loads the runtime and connects to it.
    ///
    /// # Errors
    /// The library is not a VR runtime; the runtime is not running, rejects the connection, or is
    /// too old; or this process already has a session.
    pub fn start(paths: &RuntimePaths, role: Role) -> Result<Self, OpenVrError> {
        if IS_IN_USE.swap(true, Ordering::AcqRel) {
            let code = i64::from(sys::EVRInitError_VRInitError_Init_AlreadyRunning);
            let text = Some("only one session per process".to_owned());
            return Err(OpenVrError::Refused { code, name: None, text });
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
        let system: &'static sys::VR_IVRSystem_FnTable = table(core)?;
        // Runtimes before SDK 2.15 do not ask for it.
        if system.SetSDKVersion.is_some() {
            let [major, minor, build] = SDK_VERSION;
            let error = call!(system, SetSDKVersion(major, minor, build));
            let known =
                [sys::EVRInitError_VRInitError_None, sys::EVRInitError_VRInitError_Init_ClientVersionAlreadyProvided];
            if !known.contains(&error) {
                return Err(init_error(core, error));
            }
        }
        let draws = role != Role::Utility;
        let runtime = Self {
            core,
            name: paths.name(),
            system,
            applications: table(core)?,
            settings: table(core)?,
            overlay: draws.then(|| table(core)).transpose()?,
            compositor: draws.then(|| table(core)).transpose()?,
            chaperone: draws.then(|| table(core)).transpose()?,
        };
        std::mem::forget(guard);
        Ok(runtime)
    }

    /// What the runtime is, with the version that it reports.
    pub fn name_and_version(&self) -> String {
        let version = string_from(call!(self.system, GetRuntimeVersion()));
        match version {
            Some(version) => format!("{} {version}", self.name),
            None => format!("{}, of unknown version", self.name),
        }
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

/// Windows looks for the libraries that this one needs in its folder, as with Valve's loader.
#[cfg(windows)]
unsafe fn open_library(path: &std::path::Path) -> Result<libloading::Library, libloading::Error> {
    use libloading::os::windows::{LOAD_WITH_ALTERED_SEARCH_PATH, Library};
    // The flag is for paths with backslashes alone; the registry file may have others.
    let path: std::path::PathBuf = path.components().collect();
    // SAFETY: as for the caller.
    unsafe { Library::load_with_flags(path, LOAD_WITH_ALTERED_SEARCH_PATH) }.map(libloading::Library::from)
}

#[cfg(not(windows))]
unsafe fn open_library(path: &std::path::Path) -> Result<libloading::Library, libloading::Error> {
    // SAFETY: as for the caller.
    unsafe { libloading::Library::new(path) }
}

/// The error with the system's reason, which on Windows is its source.
fn reason(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or(error.to_string(), |source| format!("{error}: {source}"))
}

/// Loads the library and returns its core object.
fn load(paths: &RuntimePaths) -> Result<*mut Core, OpenVrError> {
    let bad = |reason: String| OpenVrError::Library { path: paths.library.clone(), reason };
    // SAFETY: loading runs the library's initialisers. It is the runtime named by the user's own
    // registry file, the same one that every SteamVR program loads.
    let library = unsafe { open_library(&paths.library) }.map_err(|error| bad(reason(&error)))?;
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

/// The newest of the versions of an interface that this program can use.
fn table<T: Interface>(core: *mut Core) -> Result<&'static T, OpenVrError> {
    let request = |name: &CStr| {
        let mut error = sys::EVRInitError_VRInitError_None;
        // SAFETY: a session is active; a zero-terminated text and a variable for a number.
        let found = unsafe { (functions(core).get_generic_interface)(core, name.as_ptr(), &mut error) };
        (!found.is_null() && error == sys::EVRInitError_VRInitError_None).then_some(found.cast_const().cast::<usize>())
    };
    // SAFETY: the library gives tables of the version asked for, and stays loaded.
    unsafe { interfaces::find(request) }
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

/// A text of the runtime, which may be null or empty.
pub(super) fn string_from(text: *const c_char) -> Option<String> {
    if text.is_null() {
        return None;
    }
    // SAFETY: not null, and the runtime's texts are zero-terminated constants.
    let text = unsafe { CStr::from_ptr(text) }.to_string_lossy();
    (!text.trim().is_empty()).then(|| text.into_owned())
}
