//! The folders of a fake runtime and their files.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde_json::{Value, json};

/// Paths of a fake runtime.
pub struct Folders {
    root: PathBuf,
}

impl Folders {
    /// Under a root folder, which is created.
    pub fn new(root: &Path) -> Result<Self> {
        fs::create_dir_all(root).with_context(|| format!("{} cannot be made", root.display()))?;
        Ok(Self { root: root.canonicalize()? })
    }

    fn runtime(&self) -> PathBuf {
        self.root.join("runtime")
    }

    /// The registry file; `VR_PATHREG_OVERRIDE` must name it.
    pub fn registry(&self) -> PathBuf {
        self.root.join("openvrpaths.vrpath")
    }

    /// Locked while the server runs. Creates its folder.
    pub fn server_lock(&self) -> Result<PathBuf> {
        fs::create_dir_all(self.runtime()).with_context(|| format!("{} cannot be made", self.runtime().display()))?;
        Ok(self.runtime().join("server.lock"))
    }

    /// Locked, shared, by clients.
    pub fn clients_lock(&self) -> PathBuf {
        self.runtime().join("clients.lock")
    }

    /// Applications that clients registered.
    pub fn applications(&self) -> PathBuf {
        self.runtime().join("applications.json")
    }

    /// Creates folders, configuration and registry file.
    pub fn make(&self, config: &Value, library: &Path) -> Result<()> {
        let binaries = self.runtime().join("bin").join("linux64");
        for folder in [&binaries, &self.root.join("config"), &self.root.join("logs")] {
            fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        }
        link(library, &binaries.join("vrclient.so"))?;
        // By this file programs recognise SteamVR.
        fs::write(binaries.join("vrserver"), "")?;
        fs::write(self.runtime().join("fake.json"), serde_json::to_vec_pretty(config)?)?;
        self.remove_temporary()?;
        let registry = json!({
            "config": [self.root.join("config")],
            "external_drivers": null,
            "jsonid": "vrpathreg",
            "log": [self.root.join("logs")],
            "runtime": [self.runtime()],
            "version": 1,
        });
        Ok(fs::write(self.registry(), serde_json::to_vec_pretty(&registry)?)?)
    }

    /// Removes applications that were registered temporarily.
    fn remove_temporary(&self) -> Result<()> {
        let Ok(bytes) = fs::read(self.applications()) else { return Ok(()) };
        let mut applications: serde_json::Map<String, Value> =
            serde_json::from_slice(&bytes).with_context(|| format!("{} is damaged", self.applications().display()))?;
        applications.retain(|_, application| application["temporary"] != true);
        Ok(fs::write(self.applications(), serde_json::to_vec_pretty(&applications)?)?)
    }

    /// Sends a command to the running clients.
    pub fn command(&self, line: &str) -> Result<()> {
        let path = self.root.join("commands.jsonl");
        let mut file = fs::File::options().create(true).append(true).open(&path)?;
        writeln!(file, "{line}").with_context(|| format!("{} cannot be written", path.display()))
    }
}

/// Creates a symbolic link, replacing an existing link or file.
fn link(to: &Path, at: &Path) -> Result<()> {
    if at.symlink_metadata().is_ok() {
        fs::remove_file(at)?;
    }
    std::os::unix::fs::symlink(to, at).with_context(|| format!("{} cannot be linked", at.display()))
}

/// The configuration: from the file, with the tracks of the command line. Tracks named in the file
/// are relative to its folder.
pub fn config(file: Option<&Path>, track: Option<&Path>, controllers: &[PathBuf]) -> Result<Value> {
    let mut config = file.map_or_else(|| Ok(json!({})), read_config)?;
    if let Some(track) = track {
        config["track"] = json!(full(track)?);
    }
    if !controllers.is_empty() {
        config["controllers"] = json!(controllers.iter().map(|path| full(path)).collect::<Result<Vec<_>>>()?);
    }
    Ok(config)
}

fn full(track: &Path) -> Result<PathBuf> {
    track.canonicalize().with_context(|| format!("no track {}", track.display()))
}

fn read_config(file: &Path) -> Result<Value> {
    let text = fs::read_to_string(file).with_context(|| format!("{} cannot be read", file.display()))?;
    let mut config: Value = serde_json::from_str(&text).with_context(|| format!("{} is no JSON", file.display()))?;
    anyhow::ensure!(config.is_object(), "{} is no JSON object", file.display());
    let folder = file.parent().unwrap_or(Path::new("."));
    let tracks = config["controllers"].as_array().cloned().unwrap_or_default();
    let beside = |track: &Value| full(&folder.join(track.as_str().context("a track is no text")?));
    if !config["track"].is_null() {
        config["track"] = json!(beside(&config["track"])?);
    }
    if !tracks.is_empty() {
        config["controllers"] = json!(tracks.iter().map(beside).collect::<Result<Vec<_>>>()?);
    }
    Ok(config)
}
