//! IVRApplications: manifests and autolaunch, stored in `applications.json` across processes.

use std::collections::BTreeMap;
use std::ffi::c_char;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::clock::now_ns;
use crate::memory::{read_text, write, write_text};
use crate::report::write_whole;
use crate::table::{table, text};
use crate::world::{World, call};
use crate::{sys, table};

const NONE: u32 = sys::EVRApplicationError_VRApplicationError_None;
const NO_MANIFEST: u32 = sys::EVRApplicationError_VRApplicationError_NoManifest;
const UNKNOWN: u32 = sys::EVRApplicationError_VRApplicationError_UnknownApplication;
const BAD_MANIFEST: u32 = sys::EVRApplicationError_VRApplicationError_InvalidManifest;
const BAD_APPLICATION: u32 = sys::EVRApplicationError_VRApplicationError_InvalidApplication;
const BAD_INDEX: u32 = sys::EVRApplicationError_VRApplicationError_InvalidIndex;
const BAD_PARAMETER: u32 = sys::EVRApplicationError_VRApplicationError_InvalidParameter;
const EXISTS: u32 = sys::EVRApplicationError_VRApplicationError_AppKeyAlreadyExists;
const TOO_SMALL: u32 = sys::EVRApplicationError_VRApplicationError_BufferTooSmall;
const NOT_SET: u32 = sys::EVRApplicationError_VRApplicationError_PropertyNotSet;
const NO_PROPERTY: u32 = sys::EVRApplicationError_VRApplicationError_UnknownProperty;
const NO_CONTACT: u32 = sys::EVRApplicationError_VRApplicationError_IPCFailed;
/// Limit of a manifest's size, bytes. Choice: manifests have some kilobytes; anything larger is
/// another file.
const MAX_MANIFEST_BYTES: u64 = 1 << 20;

/// A stored application.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Application {
    manifest: PathBuf,
    /// Whether it is removed when the server ends.
    temporary: bool,
    autolaunch: bool,
    name: String,
    description: String,
    binary: String,
    arguments: String,
    /// Path of its image; empty if the manifest names none.
    #[serde(default)]
    image: String,
    is_dashboard_overlay: bool,
    /// The last process that identified itself as this application.
    #[serde(default)]
    pid: u32,
}

type Applications = BTreeMap<String, Application>;

/// The stored applications; none if the file cannot be read.
fn load(path: &Path) -> Applications {
    std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

/// Runs a call that may change the applications.
fn with_applications<T>(name: &'static str, failed: T, body: impl FnOnce(&mut World, &mut Applications) -> T) -> T {
    let mut value = None;
    call(name, NO_CONTACT, |world| {
        if world.is_utility() || world.server.alive(now_ns()) {
            let path = world.paths.applications();
            let mut applications = load(&path);
            let before = serde_json::to_vec_pretty(&applications).unwrap_or_default();
            value = Some(body(world, &mut applications));
            let after = serde_json::to_vec_pretty(&applications).unwrap_or_default();
            let written = if after == before { Ok(()) } else { write_whole(&path, &after) };
            written.unwrap_or_else(|error| eprintln!("fake runtime: {}: {error}", path.display()));
        }
        NONE
    });
    value.unwrap_or(failed)
}

/// A text from the client. Missing, empty or non-UTF-8 texts are recorded as violations.
fn checked<'a>(world: &mut World, name: &str, text: *const c_char) -> Option<&'a str> {
    let text = read_text(text).filter(|text| !text.is_empty());
    if text.is_none() {
        world.report.violation("null pointer", format!("{name}: a text is missing, empty or no UTF-8"));
    }
    text
}

/// Parses the applications of a manifest.
fn parse(path: &Path, temporary: bool) -> Result<Applications, u32> {
    let metadata = std::fs::metadata(path).map_err(|_| NO_MANIFEST)?;
    if !metadata.is_file() || metadata.len() > MAX_MANIFEST_BYTES {
        return Err(NO_MANIFEST);
    }
    let bytes = std::fs::read(path).map_err(|_| NO_MANIFEST)?;
    let manifest: Value = serde_json::from_slice(&bytes).map_err(|_| BAD_MANIFEST)?;
    let list = manifest["applications"].as_array().filter(|list| !list.is_empty()).ok_or(BAD_MANIFEST)?;
    list.iter().map(|entry| application(path, entry, temporary)).collect()
}

fn application(manifest: &Path, entry: &Value, temporary: bool) -> Result<(String, Application), u32> {
    let field = |name: &str| entry[name].as_str().filter(|text| !text.is_empty());
    let key = field("app_key").filter(|key| key.len() < sys::k_unMaxApplicationKeyLength as usize);
    let key = key.ok_or(BAD_APPLICATION)?;
    if field("launch_type") != Some("binary") {
        return Err(BAD_APPLICATION);
    }
    let binary = PathBuf::from(field("binary_path_linux").ok_or(BAD_APPLICATION)?);
    let folder = manifest.parent().unwrap_or(Path::new("/"));
    let text = |name: &str| entry["strings"]["en_us"][name].as_str().unwrap_or_default().to_owned();
    let application = Application {
        manifest: manifest.to_owned(),
        temporary,
        autolaunch: false,
        name: text("name"),
        description: text("description"),
        binary: folder.join(binary).display().to_string(),
        arguments: field("arguments").unwrap_or_default().to_owned(),
        image: field("image_path").map(|image| folder.join(image).display().to_string()).unwrap_or_default(),
        is_dashboard_overlay: entry["is_dashboard_overlay"].as_bool().unwrap_or(false),
        pid: 0,
    };
    Ok((key.to_owned(), application))
}

unsafe extern "C" fn add_manifest(path: *mut c_char, temporary: bool) -> u32 {
    with_applications("AddApplicationManifest", NO_CONTACT, |world, applications| {
        let Some(path) = checked(world, "AddApplicationManifest", path).map(Path::new) else {
            return BAD_PARAMETER;
        };
        if !path.is_absolute() {
            world.report.violation("manifest without a full path", path.display().to_string());
            return NO_MANIFEST;
        }
        let new = match parse(path, temporary) {
            Ok(new) => new,
            Err(code) => {
                world.report.violation("manifest refused", format!("{}: error {code}", path.display()));
                return code;
            }
        };
        if new.keys().any(|key| applications.get(key).is_some_and(|other| other.manifest != path)) {
            return EXISTS;
        }
        for (key, mut application) in new {
            if !application.image.is_empty() && !Path::new(&application.image).is_file() {
                world.report.violation("manifest names a missing image", application.image.clone());
            }
            application.autolaunch = applications.get(&key).is_some_and(|before| before.autolaunch);
            applications.insert(key, application);
        }
        NONE
    })
}

unsafe extern "C" fn remove_manifest(path: *mut c_char) -> u32 {
    with_applications("RemoveApplicationManifest", NO_CONTACT, |world, applications| {
        let Some(path) = checked(world, "RemoveApplicationManifest", path).map(Path::new) else {
            return BAD_PARAMETER;
        };
        let before = applications.len();
        applications.retain(|_, application| application.manifest != path);
        if applications.len() < before { NONE } else { NO_MANIFEST }
    })
}

unsafe extern "C" fn is_installed(key: *mut c_char) -> bool {
    with_applications("IsApplicationInstalled", false, |world, applications| {
        checked(world, "IsApplicationInstalled", key).is_some_and(|key| applications.contains_key(key))
    })
}

unsafe extern "C" fn count() -> u32 {
    with_applications("GetApplicationCount", 0, |_, applications| applications.len() as u32)
}

unsafe extern "C" fn key_by_index(index: u32, key: *mut c_char, room: u32) -> u32 {
    with_applications("GetApplicationKeyByIndex", NO_CONTACT, |_, applications| {
        let found = applications.keys().nth(index as usize);
        found.map_or(BAD_INDEX, |found| if write_text(key, room, found) > room { TOO_SMALL } else { NONE })
    })
}

unsafe extern "C" fn key_by_process(pid: u32, key: *mut c_char, room: u32) -> u32 {
    with_applications("GetApplicationKeyByProcessId", NO_CONTACT, |world, applications| {
        let game = world.game.clone().filter(|_| pid == GAME_PROCESS);
        let known = applications.iter().find(|(_, application)| pid != 0 && application.pid == pid);
        let found = game.or_else(|| known.map(|(found, _)| found.clone()));
        found.map_or(UNKNOWN, |found| if write_text(key, room, &found) > room { TOO_SMALL } else { NONE })
    })
}

unsafe extern "C" fn identify(pid: u32, key: *mut c_char) -> u32 {
    with_applications("IdentifyApplication", NO_CONTACT, |world, applications| {
        let application = checked(world, "IdentifyApplication", key).and_then(|key| applications.get_mut(key));
        application.map_or(UNKNOWN, |application| {
            application.pid = pid;
            NONE
        })
    })
}

unsafe extern "C" fn process_of(key: *mut c_char) -> u32 {
    with_applications("GetApplicationProcessId", 0, |world, applications| {
        let found = checked(world, "GetApplicationProcessId", key).and_then(|key| applications.get(key));
        found.map_or(0, |application| application.pid)
    })
}

unsafe extern "C" fn error_name(error: u32) -> *mut c_char {
    text(match error {
        NONE => c"VRApplicationError_None",
        EXISTS => c"VRApplicationError_AppKeyAlreadyExists",
        NO_MANIFEST => c"VRApplicationError_NoManifest",
        BAD_INDEX => c"VRApplicationError_InvalidIndex",
        UNKNOWN => c"VRApplicationError_UnknownApplication",
        NO_CONTACT => c"VRApplicationError_IPCFailed",
        BAD_MANIFEST => c"VRApplicationError_InvalidManifest",
        BAD_APPLICATION => c"VRApplicationError_InvalidApplication",
        TOO_SMALL => c"VRApplicationError_BufferTooSmall",
        NOT_SET => c"VRApplicationError_PropertyNotSet",
        NO_PROPERTY => c"VRApplicationError_UnknownProperty",
        BAD_PARAMETER => c"VRApplicationError_InvalidParameter",
        _ => c"VRApplicationError",
    })
}

/// Returns a property of an application, and its error.
fn property<T>(
    name: &'static str,
    key: *const c_char,
    error: *mut u32,
    failed: T,
    value: impl FnOnce(&Application) -> Result<T, u32>,
) -> T {
    let found = with_applications(name, Err(NO_CONTACT), |world, applications| {
        let application = checked(world, name, key).and_then(|key| applications.get(key));
        application.ok_or(UNKNOWN).and_then(value)
    });
    write(error, found.as_ref().err().copied().unwrap_or(NONE));
    found.unwrap_or(failed)
}

unsafe extern "C" fn text_property(
    key: *mut c_char,
    asked: u32,
    value: *mut c_char,
    room: u32,
    error: *mut u32,
) -> u32 {
    let needed = property("GetApplicationPropertyString", key, error, 0, |application| {
        let found = match asked {
            sys::EVRApplicationProperty_VRApplicationProperty_Name_String => &application.name,
            sys::EVRApplicationProperty_VRApplicationProperty_Description_String => &application.description,
            sys::EVRApplicationProperty_VRApplicationProperty_BinaryPath_String => &application.binary,
            sys::EVRApplicationProperty_VRApplicationProperty_Arguments_String => &application.arguments,
            sys::EVRApplicationProperty_VRApplicationProperty_ImagePath_String => &application.image,
            sys::EVRApplicationProperty_VRApplicationProperty_LaunchType_String => "binary",
            sys::EVRApplicationProperty_VRApplicationProperty_Source_String => "builtin",
            _ => return Err(NO_PROPERTY),
        };
        if found.is_empty() { Err(NOT_SET) } else { Ok(write_text(value, room, found)) }
    });
    if needed > room {
        write(error, TOO_SMALL);
    }
    needed
}

unsafe extern "C" fn bool_property(key: *mut c_char, asked: u32, error: *mut u32) -> bool {
    property("GetApplicationPropertyBool", key, error, false, |application| match asked {
        sys::EVRApplicationProperty_VRApplicationProperty_IsDashboardOverlay_Bool => {
            Ok(application.is_dashboard_overlay)
        }
        _ => Err(NO_PROPERTY),
    })
}

unsafe extern "C" fn set_autolaunch(key: *mut c_char, autolaunch: bool) -> u32 {
    with_applications("SetApplicationAutoLaunch", NO_CONTACT, |world, applications| {
        let application = checked(world, "SetApplicationAutoLaunch", key).and_then(|key| applications.get_mut(key));
        application.map_or(UNKNOWN, |application| {
            application.autolaunch = autolaunch;
            NONE
        })
    })
}

unsafe extern "C" fn autolaunch(key: *mut c_char) -> bool {
    with_applications("GetApplicationAutoLaunch", false, |world, applications| {
        let found = checked(world, "GetApplicationAutoLaunch", key).and_then(|key| applications.get(key));
        found.is_some_and(|application| application.autolaunch)
    })
}

/// Process of a game that is shown. Choice: no process of the system has this number.
const GAME_PROCESS: u32 = u32::MAX - 1;

unsafe extern "C" fn scene_state() -> u32 {
    call("GetSceneApplicationState", 0, |_| sys::EVRSceneApplicationState_None)
}

unsafe extern "C" fn scene_process() -> u32 {
    call("GetCurrentSceneProcessId", 0, |world| if world.game.is_some() { GAME_PROCESS } else { 0 })
}

const REFUSED: u32 = sys::EVRApplicationError_VRApplicationError_NotImplemented;

/// IVRApplications_008.
pub fn new_table() -> usize {
    table::leaked(table! { VR_IVRApplications_FnTable, "IVRApplications";
        given {
            AddApplicationManifest: add_manifest,
            RemoveApplicationManifest: remove_manifest,
            IsApplicationInstalled: is_installed,
            GetApplicationCount: count,
            GetApplicationKeyByIndex: key_by_index,
            GetApplicationKeyByProcessId: key_by_process,
            IdentifyApplication: identify,
            GetApplicationProcessId: process_of,
            GetApplicationsErrorNameFromEnum: error_name,
            GetApplicationPropertyString: text_property,
            GetApplicationPropertyBool: bool_property,
            SetApplicationAutoLaunch: set_autolaunch,
            GetApplicationAutoLaunch: autolaunch,
            GetSceneApplicationState: scene_state,
            GetCurrentSceneProcessId: scene_process,
        }
        fails(REFUSED) {
            LaunchApplication, LaunchTemplateApplication, LaunchApplicationFromMimeType, LaunchDashboardOverlay,
            SetDefaultApplicationForMimeType, GetStartingApplication, PerformApplicationPrelaunchCheck,
            LaunchInternalProcess, RegisterSubprocess,
        }
        fails(0) {
            CancelApplicationLaunch, GetApplicationPropertyUint64, GetDefaultApplicationForMimeType,
            GetApplicationSupportedMimeTypes, GetApplicationsThatSupportMimeType, GetApplicationLaunchArguments,
            GetSceneApplicationStateNameFromEnum,
        }
    })
}
