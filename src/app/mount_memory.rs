//! Where the sensor sits on each headset, kept from one session to the next.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use radar_mapping::MountInUse;

use super::folders::user_folder;
use radar_recording::{Existing, Readers, read_small_text, write_whole};

/// The file of all headsets, and the one in use.
#[derive(Debug, Clone)]
pub struct MountMemory {
    file: PathBuf,
    headset: String,
}

impl MountMemory {
    /// In the user's folder; `None` when there is none. `headset`: its name.
    pub fn new(headset: &str) -> Option<Self> {
        Some(Self { file: file_in(&user_folder("XDG_DATA_HOME", ".local/share")?), headset: headset.to_owned() })
    }

    /// What the last session with this headset had in use. A file that cannot be read is logged and ignored.
    pub fn recall(&self) -> Option<MountInUse> {
        let kept = read(&self.file).unwrap_or_else(|error| {
            log::warn!("the sensor's place on the headset is not known from before: {error:#}");
            BTreeMap::new()
        });
        kept.get(&self.headset).copied()
    }

    /// Keeps it for the next session. A damaged file is moved aside, in place of an earlier one.
    ///
    /// # Errors
    /// The file cannot be read, which may pass and would cost the other headsets' places; it cannot be moved or written.
    pub fn keep(&self, mount: &MountInUse) -> Result<()> {
        let mut kept = match read(&self.file) {
            Err(error) if is_damage(&error) => {
                let aside = self.file.with_extension("json.bad");
                std::fs::rename(&self.file, &aside)
                    .with_context(|| format!("cannot move the damaged {} aside", self.file.display()))?;
                log::warn!("{error:#}: it is now {}, and the sensor's places are kept anew", aside.display());
                BTreeMap::new()
            }
            kept => kept?,
        };
        kept.insert(self.headset.clone(), *mount);
        let text = serde_json::to_string_pretty(&kept)?;
        write_whole(&self.file, (text + "\n").as_bytes(), Readers::Owner, Existing::Replace)
            .with_context(|| format!("cannot write {}", self.file.display()))
    }
}

/// The mounts in use by headset, for `doctor`.
///
/// # Errors
/// The file is damaged or cannot be read.
pub fn known_mounts() -> Result<BTreeMap<String, MountInUse>> {
    user_folder("XDG_DATA_HOME", ".local/share").map_or(Ok(BTreeMap::new()), |folder| read(&file_in(&folder)))
}

fn file_in(folder: &Path) -> PathBuf {
    folder.join("mounts.json")
}

fn read(path: &Path) -> Result<BTreeMap<String, MountInUse>> {
    let about = || format!("cannot read {}", path.display());
    let text = match read_small_text(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeMap::new()),
        text => text.with_context(about)?,
    };
    serde_json::from_str(&text).with_context(about)
}

/// Whether the file was read and holds something else.
fn is_damage(error: &anyhow::Error) -> bool {
    let is_no_text = |error: &std::io::Error| error.kind() == ErrorKind::InvalidData;
    error.is::<serde_json::Error>() || error.downcast_ref().is_some_and(is_no_text)
}

/// By how much the mount in use differs from the assumed one.
pub fn correction_text(mount: &MountInUse) -> String {
    let (by_mm, by_deg) = (mount.correction_m() * 1e3, mount.correction_rad().to_degrees());
    if by_deg < 0.5 { format!("{by_mm:.0} mm") } else { format!("{by_mm:.0} mm and {by_deg:.0}°") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use radar_sar::geometry::Pose;

    fn memory(folder: &Path, headset: &str) -> MountMemory {
        MountMemory { file: file_in(folder), headset: headset.to_owned() }
    }

    #[test]
    fn each_headset_has_its_own_and_damage_is_survived() {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-mounts-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let at = |x: f64| {
            let assumed = Pose::from_translation(DVec3::new(0.0, 0.02, -0.08));
            MountInUse { assumed, in_use: assumed * Pose::from_translation(DVec3::X * x), estimate: None }
        };
        let (index, quest) = (memory(&folder, "Index"), memory(&folder, "Quest"));
        assert_eq!(index.recall(), None);
        index.keep(&at(0.03)).unwrap();
        quest.keep(&at(-0.01)).unwrap();
        index.keep(&at(0.04)).unwrap();
        assert_eq!([index.recall(), quest.recall()], [Some(at(0.04)), Some(at(-0.01))]);
        for damage in ["", "{\"Index\": {\"assumed\": 3}}", "[1e999]", "{\"Index"] {
            std::fs::write(file_in(&folder), damage).unwrap();
            assert_eq!(index.recall(), None);
            quest.keep(&at(0.01)).unwrap();
            assert_eq!(quest.recall(), Some(at(0.01)));
            assert_eq!(
                std::fs::read(folder.join("mounts.json.bad")).unwrap(),
                damage.as_bytes(),
                "what was there is gone"
            );
        }
        // Something that cannot be read at all stays as it is.
        std::fs::remove_file(file_in(&folder)).unwrap();
        std::fs::create_dir(file_in(&folder)).unwrap();
        quest.keep(&at(0.01)).unwrap_err();
        assert!(file_in(&folder).is_dir());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
