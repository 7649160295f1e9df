//! The log of `run` in the user's folder, since SteamVR starts it without a terminal: what it prints and logs, and why it
//! ended. Two files at most, each bounded.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use super::folders::user_folder;
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
        let file = OpenOptions::new().create(true).append(true).open(&path)?;
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
    let log = LogFile::open(folder.join(NAME))?;
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
        let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let _ = file.write(&format!("{} {}\n", utc(now_s), printable(text)));
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

/// Date and time of seconds since 1970, as in 2026-01-31T12:00:00Z.
fn utc(seconds: u64) -> String {
    let (days, of_day) = (seconds / 86_400, seconds % 86_400);
    // Days since the 1st of March of the year 0, in cycles of 400 years of 146 097 days. Source: H. Hinnant,
    // "chrono-compatible low-level date algorithms", civil_from_days.
    let since = days + 719_468;
    let (cycle, day) = (since / 146_097, since % 146_097);
    let year_of_cycle = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = cycle * 400 + year_of_cycle + u64::from(month <= 2);
    let (hours, minutes, seconds) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{day_of_month:02}T{hours:02}:{minutes:02}:{seconds:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_dates() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_709_251_200, "2024-03-01T00:00:00Z"),
            (1_798_761_599, "2026-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }

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
