//! `radar-chaperone install` and `uninstall`: whether SteamVR starts this program.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use radar_recording::{Existing, Readers, write_whole};

use super::check_run;
use crate::app::{add_file_type, own_path, remove_file_type, user_folder};
use crate::openvr::{Role, Runtime, RuntimePaths, manifest};

/// The picture that SteamVR shows beside the program's name.
const ICON: &[u8] = include_bytes!("../../overlay_assets/icon.png");

/// Has SteamVR start this program with the headset
///
/// Writes a manifest and an icon into the user's folder and registers it with SteamVR; SteamVR then starts
/// `radar-chaperone run`. Repeat it after moving the program. `radar-chaperone doctor` checks it;
/// SteamVR shows the switch under Settings, Startup / Shutdown, Choose Startup Overlay Apps.
#[derive(Debug, Args)]
pub(super) struct Install {
    /// Registers the program without having it started
    #[arg(long)]
    no_autolaunch: bool,
    /// Has the desktop open recordings (.mcap) in the view, and leaves SteamVR alone
    #[arg(long, conflicts_with_all = ["no_autolaunch", "arguments"])]
    open_recordings: bool,
    /// Arguments of `run`, for example -- --port /dev/ttyUSB0, or COM3
    #[arg(last = true, value_name = "ARGUMENTS")]
    arguments: Vec<String>,
}

/// Removes this program from SteamVR and from the desktop
#[derive(Debug, Args)]
pub(super) struct Uninstall {}

impl Install {
    pub fn run(&self) -> Result<()> {
        if self.open_recordings {
            let place = add_file_type(&own_path()?, ICON).context("cannot register the program for recordings")?;
            outln!("Registered in {place}: the desktop offers this program for recordings (.mcap)")?;
            return outln!("`radar-chaperone uninstall` takes it back; repeat this after moving the program");
        }
        // SteamVR would report errors in them to nobody.
        check_run(&self.arguments)?;
        let paths = RuntimePaths::find()?;
        let binary = own_path()?;
        let path = manifest_path()?;
        // Connects first: a manifest that SteamVR does not know would stay behind.
        let runtime = Runtime::start(&paths, Role::Utility)?;
        let was_there = path.exists();
        let registered = write_files(&path, &binary, &self.run_arguments()).and_then(|()| {
            runtime.register(&path)?;
            Ok(runtime.set_autolaunch(!self.no_autolaunch)?)
        });
        if let Err(error) = registered {
            if !was_there {
                remove_files(&path)?;
            }
            return Err(error);
        }
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
        if remove_file_type().context("cannot take back the registration for recordings")? {
            outln!("The desktop does not offer this program for recordings any more")?;
        }
        let path = manifest_path()?;
        let paths = RuntimePaths::find()?;
        let runtime = Runtime::start(&paths, Role::Utility)?;
        let was_known = runtime.registration().is_registered;
        if was_known {
            // The autolaunch switch would outlive the manifest and apply to the next one.
            if let Err(error) = runtime.set_autolaunch(false) {
                log::warn!("{error}");
            }
            runtime.unregister(&path)?;
        }
        let had_files = remove_files(&path)?;
        match was_known || had_files {
            true => outln!("SteamVR does not know this program any more; {} is gone", path.display()),
            false => outln!("SteamVR did not know this program: nothing to do"),
        }
    }
}

/// Writes the manifest, and the icon that it names beside it.
fn write_files(path: &Path, binary: &Path, arguments: &str) -> Result<()> {
    let icon = icon_path(path);
    let text = manifest(binary, &icon, arguments);
    // The icon first: SteamVR may read the manifest as soon as it is there.
    for (path, bytes) in [(icon.as_path(), ICON), (path, text.as_bytes())] {
        write_whole(path, bytes, Readers::Usual, Existing::Replace)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Removes the manifest and its icon; returns whether any of them was there.
fn remove_files(path: &Path) -> Result<bool> {
    let mut were_there = false;
    for path in [path, &icon_path(path)] {
        if path.exists() {
            std::fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
            were_there = true;
        }
    }
    Ok(were_there)
}

/// Path of the manifest.
pub(super) fn manifest_path() -> Result<PathBuf> {
    let folder = user_folder("XDG_DATA_HOME", ".local/share").context("there is no home folder: set HOME")?;
    Ok(folder.join("manifest.vrmanifest"))
}

/// Path of the icon that the manifest names.
fn icon_path(manifest: &Path) -> PathBuf {
    manifest.with_file_name("icon.png")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_written_together_and_removed_together() {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-install-{}", std::process::id()));
        let path = folder.join("share").join("manifest.vrmanifest");
        assert!(!remove_files(&path).unwrap());
        for arguments in ["run", "run --port \"a b\""] {
            write_files(&path, Path::new("/opt/radar-chaperone"), arguments).unwrap();
            let manifest: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            let application = &manifest["applications"][0];
            assert_eq!(application["arguments"], arguments);
            let icon = Path::new(application["image_path"].as_str().unwrap());
            assert!(icon.is_absolute() && std::fs::read(icon).unwrap() == ICON, "{}", icon.display());
        }
        // Only the icon is left: it goes as well.
        std::fs::remove_file(&path).unwrap();
        assert!(remove_files(&path).unwrap() && !remove_files(&path).unwrap());
        assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 0);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn icon_is_a_square_with_transparent_corners() {
        let icon = image::load_from_memory(ICON).unwrap().to_rgba8();
        assert_eq!(icon.dimensions(), (256, 256));
        for (x, y) in [(0, 0), (255, 0), (0, 255), (255, 255)] {
            assert_eq!(icon.get_pixel(x, y)[3], 0, "({x}, {y})");
        }
        assert_eq!(icon.get_pixel(128, 128)[3], 255);
    }
}
