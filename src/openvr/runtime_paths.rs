//! Finds the VR runtime as Valve's loader does: a JSON registry file in the user's folder names it.
//! Environment variables name another file (`VR_PATHREG_OVERRIDE`) or another runtime
//! (`VR_OVERRIDE`).

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::error::OpenVrError;

/// Limit of the registry file, bytes. Choice: the file has under 1 kB; a link to an endless file
/// must not fill memory.
const MAX_REGISTRY_BYTES: u64 = 1 << 20;
/// Path of the library within a runtime.
const LIBRARY: &str = if cfg!(windows) {
    r"bin\vrclient_x64.dll"
} else if cfg!(target_os = "macos") {
    "bin/vrclient.dylib"
} else {
    "bin/linux64/vrclient.so"
};

/// An installed runtime.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RuntimePaths {
    /// Its folder.
    pub runtime: PathBuf,
    /// Its library.
    pub library: PathBuf,
    /// Its configuration folder, if given.
    pub config: Option<PathBuf>,
}

/// SteamVR's server within its folder.
const SERVER: &str = if cfg!(windows) { r"bin\win64\vrserver.exe" } else { "bin/linux64/vrserver" };

impl RuntimePaths {
    /// What the runtime is: SteamVR, or another program that offers OpenVR. All of them report a version of SteamVR.
    pub fn name(&self) -> String {
        match self.is_steamvr() {
            true => "SteamVR".to_owned(),
            false => format!("the VR runtime in {} (not SteamVR)", self.runtime.display()),
        }
    }

    /// Whether it is SteamVR.
    pub fn is_steamvr(&self) -> bool {
        self.runtime.join(SERVER).exists() || cfg!(target_os = "macos")
    }

    /// The runtime that Valve's loader would use.
    ///
    /// # Errors
    /// The registry file is missing or cannot be used, or there is no library where it points.
    pub fn find() -> Result<Self, OpenVrError> {
        Self::find_with(|name| std::env::var_os(name).filter(|value| !value.is_empty()))
    }

    fn find_with(variable: impl Fn(&str) -> Option<OsString>) -> Result<Self, OpenVrError> {
        let chosen = variable("VR_OVERRIDE").map(PathBuf::from);
        // If all three variables are set, the file is not needed.
        let is_needed = chosen.is_none() || variable("VR_CONFIG_PATH").is_none() || variable("VR_LOG_PATH").is_none();
        let registry = if is_needed { Some(Registry::read(&registry_path(&variable))?) } else { None };
        let config = variable("VR_CONFIG_PATH").map(PathBuf::from).or(registry.as_ref().and_then(|r| r.config.clone()));
        let runtime = match (chosen, registry) {
            (Some(chosen), _) => chosen,
            (None, Some(registry)) => registry.runtime,
            (None, None) => return Err(OpenVrError::NotInstalled(registry_path(&variable))),
        };
        let library = runtime.join(LIBRARY);
        if !library.is_file() {
            return Err(OpenVrError::NoLibrary(library));
        }
        Ok(Self { runtime, library, config })
    }
}

/// Path of the registry file.
fn registry_path(variable: &impl Fn(&str) -> Option<OsString>) -> PathBuf {
    if let Some(path) = variable("VR_PATHREG_OVERRIDE") {
        return path.into();
    }
    let folder = if cfg!(windows) {
        variable("LOCALAPPDATA").map(PathBuf::from)
    } else {
        variable("XDG_CONFIG_HOME").map(PathBuf::from).or(variable("HOME").map(|home| Path::new(&home).join(".config")))
    };
    folder.unwrap_or_default().join("openvr").join("openvrpaths.vrpath")
}

/// Contents of the registry file, as far as needed.
struct Registry {
    runtime: PathBuf,
    config: Option<PathBuf>,
}

impl Registry {
    fn read(path: &Path) -> Result<Self, OpenVrError> {
        let bad = |reason: String| OpenVrError::Registry { path: path.to_owned(), reason };
        let file = match std::fs::File::open(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(OpenVrError::NotInstalled(path.to_owned()));
            }
            file => file.map_err(|error| bad(error.to_string()))?,
        };
        let mut text = String::new();
        let length =
            file.take(MAX_REGISTRY_BYTES + 1).read_to_string(&mut text).map_err(|error| bad(error.to_string()))?;
        if length as u64 > MAX_REGISTRY_BYTES {
            return Err(bad(format!("it is longer than {MAX_REGISTRY_BYTES} bytes")));
        }
        // Windows programs often write a byte order mark.
        let json: serde_json::Value =
            serde_json::from_str(text.trim_start_matches('\u{feff}')).map_err(|error| bad(error.to_string()))?;
        let first = |key: &str| json[key][0].as_str().filter(|text| !text.is_empty()).map(PathBuf::from);
        let runtime = first("runtime").ok_or_else(|| bad("it names no runtime".to_owned()))?;
        Ok(Self { runtime, config: first("config") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Creates a folder with a runtime and a registry file, and returns the variable that names the
    /// registry file.
    fn installed(name: &str, list: &str) -> (PathBuf, impl Fn(&str) -> Option<OsString> + use<>) {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-place-{name}-{}", std::process::id()));
        let library = folder.join("SteamVR").join(LIBRARY);
        fs::create_dir_all(library.parent().unwrap()).unwrap();
        fs::write(&library, "").unwrap();
        let list_path = folder.join("openvrpaths.vrpath");
        fs::write(&list_path, list.replace("FOLDER", folder.to_str().unwrap())).unwrap();
        (folder, move |name: &str| (name == "VR_PATHREG_OVERRIDE").then(|| list_path.clone().into_os_string()))
    }

    #[test]
    #[cfg(unix)]
    fn first_runtime_in_registry_is_used() {
        let (folder, variable) = installed(
            "first",
            "\u{feff}{\"runtime\": [\"FOLDER/SteamVR\", \"/other\"], \"config\": [\"/c\"], \"version\": 1}",
        );
        let paths = RuntimePaths::find_with(variable).unwrap();
        assert_eq!(paths.runtime, folder.join("SteamVR"));
        assert_eq!(paths.config, Some(PathBuf::from("/c")));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    #[cfg(unix)]
    fn environment_overrides_runtime() {
        let (folder, variable) = installed("other", "{\"runtime\": [\"/nowhere\"]}");
        assert_eq!(
            RuntimePaths::find_with(&variable),
            Err(OpenVrError::NoLibrary(Path::new("/nowhere").join(LIBRARY)))
        );
        let own = folder.join("SteamVR");
        let chosen =
            |name: &str| if name == "VR_OVERRIDE" { Some(own.clone().into_os_string()) } else { variable(name) };
        assert_eq!(RuntimePaths::find_with(chosen).unwrap().runtime, own);
        // Without the registry file, the configuration and log folders must be given as well.
        let alone = |name: &str| (name == "VR_OVERRIDE").then(|| own.clone().into_os_string());
        assert!(matches!(RuntimePaths::find_with(alone), Err(OpenVrError::NotInstalled(_))));
        let all = |name: &str| match name {
            "VR_OVERRIDE" => Some(own.clone().into_os_string()),
            "VR_CONFIG_PATH" | "VR_LOG_PATH" => Some("/tmp".into()),
            _ => None,
        };
        assert_eq!(RuntimePaths::find_with(all).unwrap().config, Some(PathBuf::from("/tmp")));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn unusable_registry_errors_state_the_reason() {
        for (name, list, message) in [
            ("json", "runtime = 1", "expected value"),
            ("none", "{\"runtime\": []}", "names no runtime"),
            ("kind", "{\"runtime\": [7]}", "names no runtime"),
        ] {
            let (folder, variable) = installed(name, list);
            let error = RuntimePaths::find_with(variable).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
            fs::remove_dir_all(folder).unwrap();
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn registry_is_searched_in_config_folders() {
        let home = |name: &str| (name == "HOME").then(|| OsString::from("/home/me"));
        assert_eq!(registry_path(&home), Path::new("/home/me/.config/openvr/openvrpaths.vrpath"));
        let xdg = |name: &str| (name == "XDG_CONFIG_HOME").then(|| OsString::from("/cfg"));
        assert_eq!(registry_path(&xdg), Path::new("/cfg/openvr/openvrpaths.vrpath"));
    }
}
