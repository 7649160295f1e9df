//! Where the stand-in lives: the runtime's folder, found through the registry file as Valve's own library finds it.

use std::path::{Path, PathBuf};

/// The folders and files of one stand-in.
#[derive(Debug, Clone)]
pub struct Paths {
    /// What the server was given as `--dir`.
    root: PathBuf,
    runtime: PathBuf,
}

impl Paths {
    /// Reads the registry file that the environment names.
    ///
    /// # Errors
    /// No registry file, or one without a runtime, in words.
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
        self.runtime.join("standin.json")
    }

    /// Locked by the server while it lives.
    pub fn server_lock(&self) -> PathBuf {
        self.runtime.join("server.lock")
    }

    /// Locked, shared, by every client from Init to Cleanup.
    pub fn clients_lock(&self) -> PathBuf {
        self.runtime.join("clients.lock")
    }

    /// Applications that are registered.
    pub fn applications(&self) -> PathBuf {
        self.runtime.join("applications.json")
    }

    /// Commands to clients that run.
    pub fn commands(&self) -> PathBuf {
        self.root.join("commands.jsonl")
    }

    /// What a client did and did wrong.
    pub fn report(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// The folder of pictures.
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
