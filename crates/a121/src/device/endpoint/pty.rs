//! A pseudo-terminal with a symbolic link to it.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

use super::{EndpointEvent, read};
use crate::FIRST_BAUD;
use crate::platform::{Watch, wait};

/// Polling interval while no client has the pseudo-terminal open, nanoseconds. Choice: a hundred
/// polls a second take no measurable time, and a client notices no delay.
const POLL_NS: i64 = 10_000_000;

/// A pseudo-terminal. The link is removed with it.
pub struct Pty {
    link: PathBuf,
    terminal: PathBuf,
    master: File,
    is_open: bool,
}

impl Pty {
    pub fn open(path: &Path) -> std::io::Result<Self> {
        let master = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        rustix::pty::grantpt(&master)?;
        rustix::pty::unlockpt(&master)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        let name = rustix::pty::ptsname(&master, Vec::new())?;
        let terminal = PathBuf::from(String::from_utf8_lossy(name.as_bytes()).into_owned());
        // Raw mode from the start, or it would echo. After it was opened and closed once, a hang-up
        // shows that no client has it open.
        let slave = File::options().read(true).write(true).open(&terminal)?;
        let mut modes = rustix::termios::tcgetattr(&slave)?;
        modes.make_raw();
        modes.set_speed(FIRST_BAUD)?;
        rustix::termios::tcsetattr(&slave, OptionalActions::Now, &modes)?;
        drop(slave);
        let new = path.with_file_name(format!(".a121-{}", std::process::id()));
        let _ = std::fs::remove_file(&new);
        std::os::unix::fs::symlink(&terminal, &new)?;
        std::fs::rename(&new, path)?;
        Ok(Self { link: path.to_owned(), terminal, master: master.into(), is_open: false })
    }

    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// The baud rate that the client set.
    pub fn baud(&self) -> Option<u32> {
        rustix::termios::tcgetattr(&self.master).ok().map(|modes| modes.output_speed())
    }

    pub fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.master.write(bytes)
    }

    /// See [`super::Endpoint::wait`].
    pub fn wait(&mut self, timeout_ns: i64, wants_room: bool, heard: &mut Vec<EndpointEvent>) -> std::io::Result<()> {
        if !self.is_open {
            wait(&mut [], timeout_ns.min(POLL_NS))?;
            let mut watch = [Watch::new(&self.master, false)];
            wait(&mut watch, 0)?;
            self.is_open = !watch[0].is_closed();
            heard.extend(self.is_open.then_some(EndpointEvent::Connected(true)));
            return Ok(());
        }
        let mut watch = [Watch::new(&self.master, wants_room)];
        wait(&mut watch, timeout_ns)?;
        let [watch] = watch;
        if watch.has_input() {
            read(&self.master, heard);
        } else if watch.is_closed() {
            heard.push(EndpointEvent::Connected(false));
        }
        self.is_open = heard.last() != Some(&EndpointEvent::Connected(false));
        Ok(())
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if std::fs::read_link(&self.link).is_ok_and(|leads_to| leads_to == self.terminal) {
            let _ = std::fs::remove_file(&self.link);
        }
    }
}
