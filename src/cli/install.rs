//! `radar-chaperone install` and `uninstall`: whether SteamVR starts this program.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;

use super::check_run;
use super::files::user_folder;
use crate::openvr::{Registration, Role, Runtime, RuntimePaths, manifest};

/// Has SteamVR start this program with the headset
///
/// Writes a manifest into the user's folder and registers it with SteamVR; SteamVR then starts
/// `radar-chaperone run`. Repeat it after moving the program. `radar-chaperone doctor` checks it;
/// SteamVR shows the switch under Settings, Startup / Shutdown, Choose Startup Overlay Apps.
#[derive(Debug, Args)]
pub(super) struct Install {
    /// Registers the program without having it started
    #[arg(long)]
    no_autolaunch: bool,
    /// Arguments of `run`, for example -- --port /dev/ttyUSB0
    #[arg(last = true, value_name = "ARGUMENTS")]
    arguments: Vec<String>,
}

/// Removes this program from SteamVR
#[derive(Debug, Args)]
pub(super) struct Uninstall {}

impl Install {
    pub fn run(&self) -> Result<()> {
        // SteamVR would report errors in them to nobody.
        check_run(&self.arguments)?;
        let place = RuntimePaths::find()?;
        let binary = own_path()?;
        let path = manifest_path()?;
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        std::fs::write(&path, manifest(&binary, &self.run_arguments()))
            .with_context(|| format!("cannot write {}", path.display()))?;
        let runtime = Runtime::start(&place, Role::Utility)?;
        runtime.register(&path)?;
        runtime.set_autolaunch(!self.no_autolaunch)?;
        let registration = runtime.registration();
        outln!("Manifest  {}", path.display())?;
        outln!("Program   {}", binary.display())?;
        if !registration.is_registered {
            bail!("SteamVR took the manifest and does not know the program: start SteamVR once, then do this again");
        }
        match (self.no_autolaunch, registration.autolaunch) {
            (true, _) => outln!("SteamVR knows it and does not start it"),
            (false, true) => outln!("SteamVR starts it with the headset"),
            (false, false) => {
                outln!(
                    "SteamVR knows it. It does not confirm that it will start it: look under Settings, Startup / Shutdown,"
                )?;
                outln!("Choose Startup Overlay Apps")
            }
        }
    }

    /// The arguments as one line, as the manifest requires.
    fn run_arguments(&self) -> String {
        let quoted = |word: &String| match word.contains(char::is_whitespace) {
            true => format!("\"{word}\""),
            false => word.clone(),
        };
        [vec!["run".to_owned()], self.arguments.iter().map(quoted).collect()].concat().join(" ")
    }
}

impl Uninstall {
    pub fn run(&self) -> Result<()> {
        let path = manifest_path()?;
        let place = RuntimePaths::find()?;
        let runtime = Runtime::start(&place, Role::Utility)?;
        let was_known = runtime.registration().is_registered;
        if was_known {
            // The autolaunch switch would outlive the manifest and apply to the next one.
            if let Err(error) = runtime.set_autolaunch(false) {
                log::warn!("{error}");
            }
            runtime.unregister(&path)?;
        }
        let had_file = path.exists();
        if had_file {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        match was_known || had_file {
            true => outln!("SteamVR does not know this program any more; {} is gone", path.display()),
            false => outln!("SteamVR did not know this program: nothing to do"),
        }
    }
}

/// What is wrong with the program's registration in SteamVR, if anything, with the remedy.
pub(super) fn registration_trouble(registration: &Registration) -> Option<String> {
    let Registration { is_registered, binary, .. } = registration;
    if !is_registered {
        return None;
    }
    let binary = binary.as_ref()?;
    let again = "`radar-chaperone install` fixes it";
    if !binary.exists() {
        return Some(format!("SteamVR would start {}, which is not there: {again}", binary.display()));
    }
    let same = |own: PathBuf| binary.canonicalize().ok() == own.canonicalize().ok();
    match own_path().is_ok_and(same) {
        true => None,
        false => Some(format!("SteamVR starts another copy of this program, {}: {again}", binary.display())),
    }
}

fn own_path() -> Result<PathBuf> {
    std::env::current_exe().context("cannot tell where this program is")
}

/// Path of the manifest.
pub(super) fn manifest_path() -> Result<PathBuf> {
    let folder = user_folder("XDG_DATA_HOME", ".local/share").context("there is no home folder: set HOME")?;
    Ok(folder.join("manifest.vrmanifest"))
}
