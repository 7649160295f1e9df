//! Paths of the fake runtime, found through the registry file as in Valve's library.

use std::path::{Path, PathBuf};

/// The folders and files of one fake runtime.
#[derive(Debug, Clone)]
pub struct Paths {
    /// The `--dir` argument of the server.
    root: PathBuf,
    runtime: PathBuf,
}

impl Paths {
    /// Reads the registry file named by the environment.
    ///
    /// # Errors
    /// There is no registry file, or it names no runtime.
    pub fn find() -> Result<Self, String> {
        let file = registry_file().ok_or("neither VR_PATHREG_OVERRIDE nor a home folder is known")?;
        let text = std::fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        let json: serde_json::Value =
            serde_json::from_str(&text).map_err(|error| format!("{}: {error}", file.display()))?;
        let runtime = json["runtime"][0].as_str().ok_or_else(|| format!("{}: no runtime", file.display()))?;
        let runtime = PathBuf::from(runtime);
        let root = runtime.parent().unwrap_or(Path::new("/")).to_owned();
        Ok(Self { root, runtime })
    }

    /// The configuration.
    pub fn config(&self) -> PathBuf {
        self.runtime.join("fake.json")
    }

    /// Locked by the server while it runs.
    pub fn server_lock(&self) -> PathBuf {
        self.runtime.join("server.lock")
    }

    /// Locked, shared, by every client from Init to Cleanup.
    pub fn clients_lock(&self) -> PathBuf {
        self.runtime.join("clients.lock")
    }

    /// Registered applications.
    pub fn applications(&self) -> PathBuf {
        self.runtime.join("applications.json")
    }

    /// Commands to running clients.
    pub fn commands(&self) -> PathBuf {
        self.root.join("commands.jsonl")
    }

    /// Report about a client: its calls and violations.
    pub fn report(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Folder of images.
    pub fn shots(&self) -> PathBuf {
        self.root.join("shots")
    }
}

fn registry_file() -> Option<PathBuf> {
    let named = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    named("VR_PATHREG_OVERRIDE").or_else(|| {
        let folder = named("XDG_CONFIG_HOME").or_else(|| named("HOME").map(|home| home.join(".config")))?;
        Some(folder.join("openvr").join("openvrpaths.vrpath"))
    })
}
