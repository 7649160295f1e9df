//! Finds out why a port cannot be opened, and what to do about it.

use crate::find::Board;

use std::fs;
use std::path::{Path, PathBuf};

/// Limit of the number of processes examined. Choice: bounds the time of an error message; a
/// desktop runs some hundreds.
const MAX_PROCESSES: usize = 65_536;

/// How a board that has no serial port on Windows gets one.
pub(super) fn missing_driver(board: Board) -> String {
    match board {
        Board::Xe125 => "install the driver of its USB chip, Silicon Labs' CP210x; Windows Update has it too".to_owned(),
        Board::SparkfunXm125 => "install the driver of its USB chip, WCH's CH341SER; Windows Update has it too".to_owned(),
        _ => {
            "another driver has it, such as WinUSB. In the Device Manager: Update driver, Browse my computer, Let me pick, \
             Ports (COM & LPT), Microsoft, USB Serial Device; or the driver \"USB Serial (CDC)\" by the program Zadig"
                .to_owned()
        }
    }
}

/// How this user can get access to a port.
pub(super) fn permission(path: &str) -> String {
    match owning_group(path) {
        Some(group) => format!(
            "it belongs to group {group}: run `sudo usermod -aG {group} $USER`, then log out and in again (until then, \
             `newgrp {group}`)"
        ),
        None => {
            "join the group that owns it, `sudo usermod -aG dialout $USER` on Debian, Ubuntu and Fedora, `uucp` on \
                 Arch; then log out and in again"
                .to_owned()
        }
    }
}

/// The process that has a port open, and what to do.
pub(super) fn holder_and_remedy(path: &str) -> (String, String) {
    let holder = holder(path);
    let remedy = if holder.as_deref().is_some_and(|name| name.starts_with("ModemManager")) || modem_manager_runs() {
        MODEM_MANAGER_REMEDY.to_owned()
    } else {
        "end that program, or name another port with --port".to_owned()
    };
    (holder.unwrap_or_else(|| "another program".to_owned()), remedy)
}

/// How to keep ModemManager away from boards.
pub const MODEM_MANAGER_REMEDY: &str = "ModemManager asks new ports whether they are modems, for some 30 s; wait, or \
     tell it to leave the board alone: put ATTRS{idVendor}==\"0483\", ENV{ID_MM_DEVICE_IGNORE}=\"1\" (the vendor's id as \
     doctor shows it) into /etc/udev/rules.d/99-a121.rules, run `sudo udevadm control --reload`, plug the board in again";

/// Whether ModemManager is running.
pub fn modem_manager_runs() -> bool {
    processes().any(|process| name_of(&process).is_some_and(|name| name == "ModemManager"))
}

/// Name of the group that owns a port.
#[cfg(unix)]
pub fn owning_group(path: &str) -> Option<String> {
    use std::os::unix::fs::MetadataExt;
    group_name(fs::metadata(path).ok()?.gid(), &fs::read_to_string("/etc/group").ok()?)
}

/// Name of the group that owns a port: always `None` on this system.
#[cfg(not(unix))]
pub fn owning_group(_path: &str) -> Option<String> {
    None
}

/// Name of a group in the format of `/etc/group`; `None` for root, which users cannot join.
#[cfg(unix)]
fn group_name(gid: u32, table: &str) -> Option<String> {
    let rows = table.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let mut named = rows.filter(|row| row.get(2).and_then(|id| id.parse().ok()) == Some(gid));
    named.next().map(|row| row[0].to_owned()).filter(|name| gid != 0 && !name.is_empty())
}

/// The process that has a port open, if this user may see it.
fn holder(path: &str) -> Option<String> {
    let path = Path::new(path).canonicalize().ok()?;
    let has_it = |process: &PathBuf| {
        let open = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        open.take(4096).any(|file| fs::read_link(file.path()).is_ok_and(|target| target == path))
    };
    let process = processes().find(has_it)?;
    let id = process.file_name()?.to_string_lossy().into_owned();
    Some(format!("{} (process {id})", name_of(&process)?))
}

fn processes() -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten().take(MAX_PROCESSES);
    entries.map(|entry| entry.path()).filter(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().bytes().all(|byte| byte.is_ascii_digit()))
    })
}

fn name_of(process: &Path) -> Option<String> {
    Some(fs::read_to_string(process.join("comm")).ok()?.trim().to_owned())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn owning_group_is_named_except_root() {
        let table = "root:x:0:\ndialout:x:20:me\n\nuucp:x:14:\nbroken\n:x:30:\n";
        assert_eq!(group_name(20, table).as_deref(), Some("dialout"));
        assert_eq!(group_name(14, table).as_deref(), Some("uucp"));
        assert!(group_name(0, table).is_none() && group_name(30, table).is_none() && group_name(7, table).is_none());
        assert!(permission("/dev/none").contains("sudo usermod -aG dialout $USER"));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn process_with_open_file_is_found() {
        let path = std::env::temp_dir().join(format!("radar-chaperone-holder-{}", std::process::id()));
        let file = fs::File::create(&path).unwrap();
        let (holder, remedy) = holder_and_remedy(path.to_str().unwrap());
        assert!(holder.ends_with(&format!("(process {})", std::process::id())), "{holder}");
        assert!(!remedy.is_empty());
        drop(file);
        fs::remove_file(&path).unwrap();
    }
}
