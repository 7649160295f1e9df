//! Recordings open in the view from the desktop: this program as one that opens files named *.mcap. Other programs may be too,
//! and which of them a double click starts stays the user's choice.

use std::io;
use std::path::{Path, PathBuf};

#[cfg(not(windows))]
pub use desktop::{add_file_type, remove_file_type};
#[cfg(windows)]
pub use registry::{add_file_type, remove_file_type};

/// Entries of a desktop by freedesktop.org's conventions: "Desktop Entry Specification" and "Shared MIME-info Database".
#[cfg(not(windows))]
mod desktop {
    use std::process::{Command, Stdio};

    use radar_recording::{Existing, Readers, write_whole};

    use super::*;
    use crate::app::folders::user_folder;

    /// Registers `program`; returns where.
    ///
    /// # Errors
    /// There is no home folder; a file cannot be written.
    pub fn add_file_type(program: &Path, icon: &[u8]) -> io::Result<String> {
        let folder = data_folder()?;
        write_files(&folder, program, icon)?;
        update_databases(&folder);
        Ok(desktop_file(&folder).display().to_string())
    }

    /// Removes it; returns whether it was there.
    ///
    /// # Errors
    /// There is no home folder; a file cannot be removed.
    pub fn remove_file_type() -> io::Result<bool> {
        let folder = data_folder()?;
        let was_there = remove_files(&folder)?;
        if was_there {
            update_databases(&folder);
        }
        Ok(was_there)
    }

    fn data_folder() -> io::Result<PathBuf> {
        let own = user_folder("XDG_DATA_HOME", ".local/share");
        own.and_then(|own| own.parent().map(Path::to_path_buf))
            .ok_or_else(|| io::Error::other("there is no home folder: set HOME"))
    }

    fn desktop_file(folder: &Path) -> PathBuf {
        folder.join("applications/radar-chaperone.desktop")
    }

    fn files(folder: &Path) -> [PathBuf; 3] {
        [
            folder.join("mime/packages/radar-chaperone.xml"),
            folder.join("icons/hicolor/256x256/apps/radar-chaperone.png"),
            desktop_file(folder),
        ]
    }

    pub(super) fn write_files(folder: &Path, program: &Path, icon: &[u8]) -> io::Result<()> {
        let kind = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
            <mime-info xmlns=\"http://www.freedesktop.org/standards/shared-mime-info\">\n\
            <mime-type type=\"application/x-mcap\"><comment>MCAP recording</comment><glob pattern=\"*.mcap\"/></mime-type>\n\
            </mime-info>\n";
        let entry = format!(
            "[Desktop Entry]\nType=Application\nName=Radar chaperone\nComment=Views recordings of a radar on a headset\n\
             Exec={} %f\nIcon=radar-chaperone\nTerminal=false\nNoDisplay=true\nMimeType=application/x-mcap;\n",
            quoted(program)?
        );
        for (path, bytes) in files(folder).iter().zip([kind.as_bytes(), icon, entry.as_bytes()]) {
            write_whole(path, bytes, Readers::Usual, Existing::Replace)?;
        }
        Ok(())
    }

    pub(super) fn remove_files(folder: &Path) -> io::Result<bool> {
        let mut were_there = false;
        for path in files(folder).iter().filter(|path| path.exists()) {
            std::fs::remove_file(path)?;
            were_there = true;
        }
        Ok(were_there)
    }

    /// A path as an argument in `Exec`: quoted, with its reserved characters behind backslashes, which are themselves written
    /// twice in any value, and with field codes doubled.
    fn quoted(program: &Path) -> io::Result<String> {
        let path = program.to_str().filter(|path| !path.contains(char::is_control));
        let path =
            path.ok_or_else(|| io::Error::other(format!("{} cannot stand in a desktop entry", program.display())))?;
        let mut quoted = String::from("\"");
        for letter in path.chars() {
            match letter {
                '\\' => quoted.push_str(r"\\\\"),
                '"' | '`' | '$' => quoted.extend([r"\\", letter.encode_utf8(&mut [0; 4])]),
                '%' => quoted.push_str("%%"),
                _ => quoted.push(letter),
            }
        }
        Ok(quoted + "\"")
    }

    /// Desktops look into databases made of these files. One without these tools reads the files themselves.
    fn update_databases(folder: &Path) {
        for (tool, below) in [("update-mime-database", "mime"), ("update-desktop-database", "applications")] {
            let mut command = Command::new(tool);
            command.arg(folder.join(below)).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
            if let Err(error) = command.status() {
                log::info!("{tool} was not run: {error}");
            }
        }
    }
}

/// Keys of the user's part of the registry (Microsoft, "File types and file associations").
#[cfg(windows)]
mod registry {
    use std::process::{Command, Stdio};

    use super::*;

    const KIND: &str = r"HKCU\Software\Classes\radar-chaperone.recording";
    const OPENS_WITH: &str = r"HKCU\Software\Classes\.mcap\OpenWithProgids";

    /// Registers `program`, whose own icon is shown; returns where.
    ///
    /// # Errors
    /// The registry cannot be written.
    pub fn add_file_type(program: &Path, _icon: &[u8]) -> io::Result<String> {
        let program = program.display();
        let command = format!("{KIND}\\shell\\open\\command");
        reg(&["add", KIND, "/ve", "/d", "Radar recording", "/f"])?;
        reg(&["add", &command, "/ve", "/d", &format!("\"{program}\" \"%1\""), "/f"])?;
        reg(&["add", OPENS_WITH, "/v", "radar-chaperone.recording", "/t", "REG_SZ", "/d", "", "/f"])?;
        Ok(KIND.to_owned())
    }

    /// Removes it; returns whether it was there.
    ///
    /// # Errors
    /// The registry cannot be written.
    pub fn remove_file_type() -> io::Result<bool> {
        if reg(&["query", KIND]).is_err() {
            return Ok(false);
        }
        reg(&["delete", OPENS_WITH, "/v", "radar-chaperone.recording", "/f"])?;
        reg(&["delete", KIND, "/f"])?;
        Ok(true)
    }

    fn reg(arguments: &[&str]) -> io::Result<()> {
        let system = std::env::var_os("SystemRoot").map_or_else(|| r"C:\Windows".into(), PathBuf::from);
        let mut command = Command::new(system.join(r"System32\reg.exe"));
        let status =
            command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status()?;
        match status.success() {
            true => Ok(()),
            false => Err(io::Error::other(format!("the registry refuses `reg {}` ({status})", arguments.join(" ")))),
        }
    }
}

#[cfg(all(test, not(windows)))]
mod tests {
    use super::desktop::{remove_files, write_files};
    use super::*;

    #[test]
    fn desktop_entry_names_the_program_whatever_its_path_and_goes_completely() {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-file-type-{}", std::process::id()));
        assert!(!remove_files(&folder).unwrap());
        write_files(&folder, Path::new("/home/a b/100% \"$x\"/radar\\chaperone"), b"icon").unwrap();
        let entry = std::fs::read_to_string(folder.join("applications/radar-chaperone.desktop")).unwrap();
        let exec = r#"Exec="/home/a b/100%% \\"\\$x\\"/radar\\\\chaperone" %f"#;
        assert!(entry.lines().any(|line| line == exec), "{entry}");
        assert!(write_files(&folder, Path::new("/home/two\nlines"), b"icon").is_err());
        assert!(remove_files(&folder).unwrap() && !remove_files(&folder).unwrap());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
