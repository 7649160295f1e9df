//! Registration of this program with SteamVR: its manifest, and whether SteamVR starts it
//! automatically.

use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::error::{OpenVrError, described};
use super::runtime::{Runtime, call, string_from};
use super::sys;

/// Application key of this program in SteamVR.
pub const APP_KEY: &str = "radar-chaperone.overlay";
const KEY: &CStr = c"radar-chaperone.overlay";

/// Template of the manifest. As it is, it serves a program in the same folder.
const TEMPLATE: &str = include_str!("../../manifest.vrmanifest");

/// The manifest: which binary SteamVR starts, with which arguments, its display name and its icon.
pub fn manifest(binary: &Path, image: &Path, arguments: &str) -> String {
    let Ok(mut manifest) = serde_json::from_str::<Value>(TEMPLATE) else {
        unreachable!("the template inside the program is valid JSON");
    };
    let (own, other) = match cfg!(windows) {
        true => ("binary_path_windows", "binary_path_linux"),
        false => ("binary_path_linux", "binary_path_windows"),
    };
    if let Some(application) = manifest.pointer_mut("/applications/0").and_then(Value::as_object_mut) {
        application.remove(other);
        application.insert(own.to_owned(), json!(binary.display().to_string()));
        application.insert("arguments".to_owned(), json!(arguments));
        application.insert("image_path".to_owned(), json!(image.display().to_string()));
    }
    format!("{manifest:#}\n")
}

/// Registration of this program in SteamVR.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Registration {
    /// Whether this program is registered.
    pub is_registered: bool,
    /// The binary that SteamVR would start.
    pub binary: Option<PathBuf>,
    /// Whether SteamVR starts it automatically.
    pub autolaunch: bool,
}

impl Runtime {
    /// The current registration.
    pub fn registration(&self) -> Registration {
        let is_registered = call!(self.applications, IsApplicationInstalled(key()));
        Registration {
            is_registered,
            binary: if is_registered { self.registered_binary() } else { None },
            autolaunch: is_registered && call!(self.applications, GetApplicationAutoLaunch(key())),
        }
    }

    /// Application key of the game that is shown, if there is one and the runtime knows it.
    pub fn shown_game(&self) -> Option<String> {
        let process = call!(self.applications, GetCurrentSceneProcessId());
        let mut text = [0u8; sys::k_unMaxApplicationKeyLength as usize];
        let length = text.len() as u32;
        let error = call!(self.applications, GetApplicationKeyByProcessId(process, text.as_mut_ptr().cast(), length));
        let until = text.iter().position(|byte| *byte == 0).filter(|until| *until > 0)?;
        (process != 0 && error == sys::EVRApplicationError_VRApplicationError_None)
            .then(|| String::from_utf8_lossy(&text[..until]).into_owned())
    }

    fn registered_binary(&self) -> Option<PathBuf> {
        let (mut text, mut error) = ([0u8; 4096], 0);
        let property = sys::EVRApplicationProperty_VRApplicationProperty_BinaryPath_String;
        let length = text.len() as u32;
        call!(
            self.applications,
            GetApplicationPropertyString(key(), property, text.as_mut_ptr().cast(), length, &mut error)
        );
        let until = text.iter().position(|byte| *byte == 0).filter(|until| *until > 0)?;
        (error == sys::EVRApplicationError_VRApplicationError_None)
            .then(|| PathBuf::from(String::from_utf8_lossy(&text[..until]).into_owned()))
    }

    /// Registers the manifest permanently.
    ///
    /// # Errors
    /// SteamVR rejects the manifest.
    pub fn register(&self, manifest: &Path) -> Result<(), OpenVrError> {
        let path = path_text(manifest)?;
        self.check_call(
            "the manifest",
            call!(self.applications, AddApplicationManifest(path.as_ptr().cast_mut(), false)),
        )
    }

    /// Removes the manifest.
    ///
    /// # Errors
    /// SteamVR rejects the call, or the manifest is not registered.
    pub fn unregister(&self, manifest: &Path) -> Result<(), OpenVrError> {
        let path = path_text(manifest)?;
        let error = call!(self.applications, RemoveApplicationManifest(path.as_ptr().cast_mut()));
        self.check_call("to remove the manifest", error)
    }

    /// Sets whether SteamVR starts this program automatically.
    ///
    /// # Errors
    /// SteamVR rejects the call, or this program is not registered.
    pub fn set_autolaunch(&self, starts: bool) -> Result<(), OpenVrError> {
        self.check_call("automatic start", call!(self.applications, SetApplicationAutoLaunch(key(), starts)))
    }

    /// Tells SteamVR that this process is the application of the manifest, however it was started.
    ///
    /// # Errors
    /// The application is not registered.
    pub fn identify(&self) -> Result<(), OpenVrError> {
        let error = call!(self.applications, IdentifyApplication(std::process::id(), key()));
        self.check_call("to identify this program", error)
    }

    fn check_call(&self, call: &'static str, error: sys::EVRApplicationError) -> Result<(), OpenVrError> {
        if error == sys::EVRApplicationError_VRApplicationError_None {
            return Ok(());
        }
        let name = string_from(call!(self.applications, GetApplicationsErrorNameFromEnum(error)));
        Err(OpenVrError::Call { call, name: described(i64::from(error), name.as_deref(), None) })
    }
}

fn key() -> *mut c_char {
    KEY.as_ptr().cast_mut()
}

fn path_text(path: &Path) -> Result<CString, OpenVrError> {
    let bad = |_| OpenVrError::Call { call: "the manifest", name: format!("{} is no path", path.display()) };
    CString::new(path.display().to_string()).map_err(bad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn manifest_has_paths_and_arguments_filled_in() {
        let (binary, image) = ("/opt/a \"b\"/radar-chaperone", "/home/a/icon.png");
        let text = manifest(Path::new(binary), Path::new(image), "run --wait");
        let (own, other) = match cfg!(windows) {
            true => ("binary_path_windows", "binary_path_linux"),
            false => ("binary_path_linux", "binary_path_windows"),
        };
        let mut expected: Value = serde_json::from_str(TEMPLATE).unwrap();
        let application = expected["applications"][0].as_object_mut().unwrap();
        assert!(application.remove(other).is_some());
        for (key, value) in [(own, binary), ("image_path", image), ("arguments", "run --wait")] {
            assert!(application.insert(key.to_owned(), json!(value)).is_some(), "{key}");
        }
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), expected);
    }

    #[test]
    fn template_is_a_manifest_of_this_program() {
        assert_eq!(KEY.to_str(), Ok(APP_KEY));
        let template: Value = serde_json::from_str(TEMPLATE).unwrap();
        assert_eq!(template["source"], "builtin");
        assert_eq!(template["applications"].as_array().unwrap().len(), 1);
        let application = &template["applications"][0];
        assert_eq!(application["app_key"], APP_KEY);
        assert_eq!(application["launch_type"], "binary");
        assert_eq!(application["arguments"], "run");
        assert_eq!(application["is_dashboard_overlay"], true);
        assert_eq!(application["strings"]["en_us"]["name"], "Radar chaperone");
        assert!(application["strings"]["en_us"]["description"].is_string());
        let image = Path::new(env!("CARGO_MANIFEST_DIR")).join(application["image_path"].as_str().unwrap());
        assert!(image.is_file(), "{}", image.display());
    }
}
