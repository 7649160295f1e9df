//! Folders of the user's files.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

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

/// Opens a file of this program for writing, which need not exist.
///
/// # Errors
/// The system refuses; it is a folder, a device or a pipe: opening a pipe would wait for another program, perhaps for ever.
pub fn open_own_file(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    match std::fs::metadata(path) {
        Ok(there) if !there.is_file() => {
            Err(io::Error::other("it is a folder, a device or a pipe, not a file: remove it"))
        }
        _ => options.create(true).open(path),
    }
}

/// A text for others to read: the home folder is `~` in it, and folders that bear the user's name are `USER`.
pub fn without_personal_names(text: &str) -> String {
    let home = std::env::home_dir().and_then(|home| home.to_str().map(str::to_owned)).unwrap_or_default();
    without_names_of(text, home.trim_end_matches(['/', MAIN_SEPARATOR]))
}

fn without_names_of(text: &str, home: &str) -> String {
    let is_separator = |letter: char| letter == '/' || letter == MAIN_SEPARATOR;
    let Some((_, name)) = home.rsplit_once(is_separator).filter(|(_, name)| !name.is_empty()) else {
        return text.to_owned();
    };
    // Ends of a folder's name in running text. A name may stand after more characters than before: "anna's".
    let ends =
        |rest: &str| rest.chars().next().is_none_or(|next| !next.is_alphanumeric() && next != '-' && next != '_');
    let mut shown = String::new();
    let mut rest = text;
    while let Some(next) = rest.chars().next() {
        let is_in_path = shown.ends_with(is_separator);
        let (replaced, by) = match () {
            () if rest.starts_with(home) && ends(&rest[home.len()..]) => (home.len(), "~"),
            () if is_in_path && rest.starts_with(name) && ends(&rest[name.len()..]) => (name.len(), "USER"),
            () => (next.len_utf8(), &rest[..next.len_utf8()]),
        };
        shown.push_str(by);
        rest = &rest[replaced..];
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_for_others_do_not_name_the_user() {
        let shown = |text: &str| without_names_of(text, "/home/anna");
        assert_eq!(shown("in /home/anna/.steam/root, /home/anna"), "in ~/.steam/root, ~");
        assert_eq!(shown("/run/media/anna/games"), "/run/media/USER/games");
        assert_eq!(shown("/home/annabel/x, anna, hannah"), "/home/annabel/x, anna, hannah");
        assert_eq!(without_names_of("/dev/ttyUSB0 ümlaut", ""), "/dev/ttyUSB0 ümlaut");
        assert_eq!(without_names_of("/root/x", "/root"), "~/x");
    }
}
