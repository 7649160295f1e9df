//! Registration of this program with SteamVR: its manifest, and whether SteamVR starts it
//! automatically.

use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};

use serde_json::json;

use super::error::OpenVrError;
use super::runtime::{Runtime, call, string_from};
use super::sys;

/// Application key of this program in SteamVR.
pub const APP_KEY: &str = "radar-chaperone.overlay";
const KEY: &CStr = c"radar-chaperone.overlay";

/// The manifest: which binary SteamVR starts, with which arguments, and its display name.
pub fn manifest(binary: &Path, arguments: &str) -> String {
    let path = binary.display().to_string();
    let path_key = if cfg!(windows) { "binary_path_windows" } else { "binary_path_linux" };
    let manifest = json!({
        "source": "builtin",
        "applications": [{
            "app_key": APP_KEY,
            "launch_type": "binary",
            path_key: path,
            "arguments": arguments,
            "is_dashboard_overlay": true,
            "strings": {
                "en_us": {
                    "name": "Radar chaperone",
                    "description": "Warns of furniture, seen by a radar on the headset",
                }
            }
        }]
    });
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
        Err(OpenVrError::Call { call, name: format!("{name} ({error})") })
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
    fn manifest_names_binary_and_arguments() {
        assert_eq!(KEY.to_str(), Ok(APP_KEY));
        let text = manifest(Path::new("/opt/a \"b\"/radar-chaperone"), "run --wait");
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let application = &json["applications"][0];
        let key = if cfg!(windows) { "binary_path_windows" } else { "binary_path_linux" };
        assert_eq!(application[key], "/opt/a \"b\"/radar-chaperone");
        assert_eq!(application["arguments"], "run --wait");
        assert_eq!(application["is_dashboard_overlay"], true);
        assert_eq!(json["source"], "builtin");
    }
}
