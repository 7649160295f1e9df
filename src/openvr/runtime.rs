//! The runtime's library in this process: loaded, let in, its function tables, and let go again.
//!
//! The library exports one function, which gives an object of C++ (`IVRClientCore_003`); that one gives the function tables
//! of the interfaces. The order is that of Valve's loader: path, library, factory, Init, SetSDKVersion, tables; Cleanup at the
//! end. Everything handed out here lives at most as long as the [`Runtime`] it came from. The library stays loaded: its threads may
//! still be ending.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::OpenVrError;
use super::runtime_paths::RuntimePaths;
use super::sys;

/// The core's interface.
const CORE: &CStr = c"IVRClientCore_003";
/// The version of Valve's header that the bindings are of.
const SDK_VERSION: [u32; 3] = [2, 15, 6];
/// The library knows one session a process.
static IS_IN_USE: AtomicBool = AtomicBool::new(false);

type Factory = unsafe extern "C" fn(*const c_char, *mut c_int) -> *mut c_void;

/// What this program is to the runtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Draws beside a game; starts SteamVR when it does not run.
    Overlay,
    /// Draws nothing and never starts SteamVR.
    Background,
    /// Needs no headset: for installing.
    Utility,
}

/// The core object: a pointer to its table of virtual functions.
#[repr(C)]
struct Core {
    functions: *const CoreFunctions,
}

/// In the order of their declaration; `this` first, as C++ passes it on every system that SteamVR runs on in 64 bits.
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

/// A session with the runtime. One at a time in a process.
pub struct Runtime {
    core: *mut Core,
    pub(super) system: &'static sys::VR_IVRSystem_FnTable,
    pub(super) applications: &'static sys::VR_IVRApplications_FnTable,
    pub(super) settings: &'static sys::VR_IVRSettings_FnTable,
    /// The following are not there for [`Role::Utility`].
    pub(super) overlay: Option<&'static sys::VR_IVROverlay_FnTable>,
    pub(super) compositor: Option<&'static sys::VR_IVRCompositor_FnTable>,
    pub(super) chaperone: Option<&'static sys::VR_IVRChaperone_FnTable>,
}

// SAFETY: the interfaces may be called from any thread; the runtime locks within (Valve's manual, "API overview"; SetOverlayTexture alone is
// bound to the thread that uses the queue, which `OverlaySlots` sees to by being neither Send nor Sync).
unsafe impl Send for Runtime {}
// SAFETY: as above.
unsafe impl Sync for Runtime {}

/// Calls a function of a table. Tables without a hole alone are taken (`table`), so there is always one.
macro_rules! call {
    ($table:expr, $function:ident ( $($argument:expr),* $(,)? )) => {
        match $table.$function {
            // SAFETY: a function of the table of a live session, by the signature that its header gives; what is passed outlives the call.
            Some(function) => unsafe { function($($argument),*) },
            None => unreachable!("a hole in a table that was looked through"),
        }
    };
}
pub(super) use call;

impl Runtime {
    /// Loads the runtime and asks it to let this program in.
    ///
    /// # Errors
    /// A library that is none, a runtime that does not run or lets nobody in, or is too old. A second session at a time is
    /// refused.
    pub fn start(place: &RuntimePaths, role: Role) -> Result<Self, OpenVrError> {
        if IS_IN_USE.swap(true, Ordering::AcqRel) {
            let (code, name) =
                (i64::from(sys::EVRInitError_VRInitError_Init_AlreadyRunning), "AlreadyRunning".to_owned());
            return Err(OpenVrError::Refused { code, name, text: "one session at a time in a program".to_owned() });
        }
        let started = Self::connect(place, role);
        if started.is_err() {
            IS_IN_USE.store(false, Ordering::Release);
        }
        started
    }

    fn connect(place: &RuntimePaths, role: Role) -> Result<Self, OpenVrError> {
        let core = load(place)?;
        let kind = match role {
            Role::Overlay => sys::EVRApplicationType_VRApplication_Overlay,
            Role::Background => sys::EVRApplicationType_VRApplication_Background,
            Role::Utility => sys::EVRApplicationType_VRApplication_Utility,
        };
        let functions = functions(core);
        // SAFETY: the core is alive, its table is in the order of its interface, no startup text is allowed to be null.
        let error = unsafe { (functions.init)(core, kind, std::ptr::null()) };
        if error != sys::EVRInitError_VRInitError_None {
            return Err(init_error(core, error));
        }
        // From here on it has to be let go again.
        let guard = CleanupGuard(core);
        // SAFETY: a session is alive; a text that ends in 0.
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

    /// Version of SteamVR, as it tells it.
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
        // SAFETY: the session is alive, and nothing of it is used afterwards: tables are reached through `Runtime` alone.
        unsafe { (functions(self.0).cleanup)(self.0) }
    }
}

/// The library's core object.
fn load(place: &RuntimePaths) -> Result<*mut Core, OpenVrError> {
    let bad = |reason: String| OpenVrError::Library { path: place.library.clone(), reason };
    // SAFETY: loading runs the library's initialisers. It is the runtime that this user's own list names, the one that every
    // program for SteamVR loads.
    let library = unsafe { libloading::Library::new(&place.library) }.map_err(|error| bad(error.to_string()))?;
    // Stays loaded: see the file's head.
    let library: &'static libloading::Library = Box::leak(Box::new(library));
    // SAFETY: the signature that Valve's loader gives it.
    let factory: libloading::Symbol<Factory> = unsafe { library.get(b"VRClientCoreFactory\0") }
        .map_err(|error| bad(format!("it is no VR runtime ({error})")))?;
    let mut code: c_int = 0;
    // SAFETY: a text that ends in 0 and a place for a number.
    let core = unsafe { factory(CORE.as_ptr(), &mut code) }.cast::<Core>();
    if core.is_null() {
        return Err(bad(format!("it has no {} (error {code})", CORE.to_string_lossy())));
    }
    Ok(core)
}

fn functions(core: *mut Core) -> &'static CoreFunctions {
    // SAFETY: the core came from the factory and is never freed; its first word is its table, which is constant.
    unsafe { &*(*core).functions }
}

/// A table of functions without a hole.
fn table<T>(core: *mut Core, version: &CStr) -> Result<&'static T, OpenVrError> {
    let missing = || OpenVrError::Interface(version.to_string_lossy().into_owned());
    let name = [b"FnTable:", version.to_bytes()].concat();
    let name = CString::new(name).map_err(|_| missing())?;
    let mut error = sys::EVRInitError_VRInitError_None;
    // SAFETY: a session is alive; a text that ends in 0 and a place for a number.
    let found = unsafe { (functions(core).get_generic_interface)(core, name.as_ptr(), &mut error) };
    if found.is_null() || error != sys::EVRInitError_VRInitError_None {
        return Err(missing());
    }
    // SAFETY: an interface of this version has this many functions, and a table is nothing but pointers to them.
    let words = unsafe { std::slice::from_raw_parts(found.cast::<usize>(), size_of::<T>() / size_of::<usize>()) };
    if words.contains(&0) {
        return Err(missing());
    }
    // SAFETY: as above; the table stays where it is while the library is loaded.
    Ok(unsafe { &*found.cast::<T>() })
}

/// Why Init did not let us in.
fn init_error(core: *mut Core, error: sys::EVRInitError) -> OpenVrError {
    match error {
        sys::EVRInitError_VRInitError_Init_NoServerForBackgroundApp => OpenVrError::NotRunning,
        sys::EVRInitError_VRInitError_Init_HmdNotFound
        | sys::EVRInitError_VRInitError_Init_HmdNotFoundPresenceFailed => OpenVrError::NoHeadset,
        _ => {
            let functions = functions(core);
            // SAFETY: the core is alive; it gives a constant text or null.
            let name = string_from(unsafe { (functions.id_for_init_error)(core, error) });
            // SAFETY: as above.
            let text = string_from(unsafe { (functions.english_for_init_error)(core, error) });
            OpenVrError::Refused { code: i64::from(error), name, text }
        }
    }
}

/// A text of the runtime's, which may be missing.
pub(super) fn string_from(text: *const c_char) -> String {
    if text.is_null() {
        return "no word on it".to_owned();
    }
    // SAFETY: not null, and the runtime's texts are constants that end in 0.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
