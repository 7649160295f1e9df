//! Folders of the user's files.

use std::path::PathBuf;

/// This program's folder in the user's home, by the platform's conventions.
pub fn user_folder(variable: &str, below_home: &str) -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = if cfg!(windows) {
        named("LOCALAPPDATA")
    } else {
        named(variable).or_else(|| named("HOME").map(|home| home.join(below_home)))
    };
    folder.map(|folder| folder.join("radar-chaperone"))
}
