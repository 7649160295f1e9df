//! The log of `run` in the user's folder, since SteamVR starts it without a terminal: what it prints and logs, and why it
//! ended. Two files at most, each bounded.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use super::folders::{open_own_file, user_folder};
use super::printable;

/// Largest file, bytes; then it becomes the older one. Choice: thousands of lines, which a mail still takes.
const MAX_BYTES: u64 = 1 << 20;
const NAME: &str = "run.log";

static LOG: Mutex<Option<LogFile>> = Mutex::new(None);

/// The open file.
struct LogFile {
    path: PathBuf,
    file: File,
    bytes: u64,
}

impl LogFile {
    fn open(path: PathBuf) -> io::Result<Self> {
        let file = open_own_file(OpenOptions::new().append(true), &path)?;
        let bytes = file.metadata()?.len();
        Ok(Self { path, file, bytes })
    }

    fn write(&mut self, line: &str) -> io::Result<()> {
        if self.bytes.saturating_add(line.len() as u64) > MAX_BYTES {
            std::fs::rename(&self.path, older(&self.path))?;
            *self = Self::open(self.path.clone())?;
        }
        self.file.write_all(line.as_bytes())?;
        self.bytes += line.len() as u64;
        Ok(())
    }
}

fn older(path: &Path) -> PathBuf {
    path.with_extension("old.log")
}

/// Writes from now on what is printed and logged to the user's log file, too; panics as well.
///
/// # Errors
/// There is no folder for it, or it cannot be written.
pub fn begin_log_file() -> io::Result<()> {
    let folder = user_folder("XDG_STATE_HOME", ".local/state").ok_or(io::ErrorKind::NotFound)?;
    std::fs::create_dir_all(&folder)?;
    let path = folder.join(NAME);
    let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let log = LogFile::open(path.clone()).map_err(named)?;
    *LOG.lock().unwrap_or_else(PoisonError::into_inner) = Some(log);
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        log_line(&panic.to_string());
        print(panic);
    }));
    Ok(())
}

/// Adds a line to the log file, if there is one. A disk that is full keeps nobody from warning.
pub fn log_line(text: &str) {
    let mut log = LOG.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = &mut *log {
        let now = humantime::format_rfc3339_seconds(SystemTime::now());
        let _ = file.write(&format!("{now} {}\n", printable(text)));
    }
}

/// Prints a line to standard output and to the log file.
///
/// # Errors
/// Standard output refuses it; a closed pipe is no error.
pub fn print_line(text: &str) -> anyhow::Result<()> {
    log_line(text);
    match writeln!(io::stdout(), "{}", printable(text)) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(anyhow::Error::new(error).context("cannot write to standard output"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_stay_bounded_and_nothing_of_the_newest_is_lost() {
        let folder = std::env::temp_dir().join(format!("radar-chaperone-log-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join(NAME);
        let line = |number: usize| format!("{number:06} {}\n", "x".repeat(9_992));
        let mut log = LogFile::open(path.clone()).unwrap();
        for number in 0..150 {
            log.write(&line(number)).unwrap();
        }
        drop(log);
        let mut log = LogFile::open(path.clone()).unwrap();
        for number in 150..300 {
            log.write(&line(number)).unwrap();
        }
        let text = std::fs::read_to_string(older(&path)).unwrap() + &std::fs::read_to_string(&path).unwrap();
        let numbers: Vec<usize> = text.lines().map(|line| line[..6].parse().unwrap()).collect();
        assert!(numbers.len() >= 105 && numbers == (300 - numbers.len()..300).collect::<Vec<_>>(), "{numbers:?}");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
        assert!(text.len() as u64 <= 2 * MAX_BYTES);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
