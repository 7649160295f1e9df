//! Endpoint at which a simulated board is served: a pseudo-terminal or a TCP port.
//!
//! A pseudo-terminal knows the baud rate that the client set, so differing rates give noise. It
//! cannot transmit a break. These events count as one: a client opens it; the client sets 115 200
//! baud while the board has another rate; and, while the board streams, the first command of a
//! session.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;

use super::FIRST_BAUD;

/// Address at which a board is served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ServeAddress {
    /// A symbolic link of this name, to a pseudo-terminal.
    Pty(PathBuf),
    /// A TCP address.
    Tcp(SocketAddr),
}

/// An address that cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Neither `pty:PATH` nor `tcp:ADDRESS:PORT`.
    #[error(
        "\"{0}\" is not an address to serve a board at: write pty:PATH, or tcp:ADDRESS:PORT such as tcp:127.0.0.1:6110"
    )]
    InvalidAddress(String),
    /// An address that other computers can reach.
    #[error("{0} can be reached from other computers: use 127.0.0.1, or pass --any-address")]
    NotLoopback(SocketAddr),
    /// The path exists and is not a link.
    #[error("{0} exists and is not a link to a terminal: choose another name")]
    Taken(PathBuf),
    /// The system refuses.
    #[error("cannot serve at {place}: {source}")]
    Io {
        /// The address.
        place: String,
        /// The system's error.
        source: std::io::Error,
    },
}

impl ServeAddress {
    /// Parses `pty:PATH` or `tcp:ADDRESS:PORT`; addresses other than loopback need `any_address`.
    ///
    /// # Errors
    /// Another form, or an address that other computers can reach.
    pub fn parse(text: &str, any_address: bool) -> Result<Self, ServeError> {
        let no_place = || ServeError::InvalidAddress(text.to_owned());
        match text.split_once(':').ok_or_else(no_place)? {
            ("pty", path) if !path.is_empty() => Ok(Self::Pty(path.into())),
            ("tcp", address) => {
                let address: SocketAddr = address.parse().map_err(|_| no_place())?;
                match any_address || address.ip().is_loopback() {
                    true => Ok(Self::Tcp(address)),
                    false => Err(ServeError::NotLoopback(address)),
                }
            }
            _ => Err(no_place()),
        }
    }

    /// The name of the port for a client.
    pub fn port(&self) -> String {
        match self {
            Self::Pty(path) => path.display().to_string(),
            Self::Tcp(address) => format!("tcp:{address}"),
        }
    }

    pub(super) fn open(&self) -> Result<Endpoint, ServeError> {
        let io = |source| ServeError::Io { place: self.port(), source };
        match self {
            Self::Pty(path) => {
                if std::fs::symlink_metadata(path).is_ok_and(|there| !there.is_symlink()) {
                    return Err(ServeError::Taken(path.clone()));
                }
                open_pty(path).map_err(io)
            }
            Self::Tcp(address) => {
                let listener = TcpListener::bind(address).map_err(io)?;
                listener.set_nonblocking(true).map_err(io)?;
                Ok(Endpoint::Tcp { listener, stream: None })
            }
        }
    }
}

/// An open endpoint.
pub(super) enum Endpoint {
    Pty { link: PathBuf, terminal: PathBuf, master: File, is_open: bool },
    Tcp { listener: TcpListener, stream: Option<TcpStream> },
}

fn open_pty(path: &Path) -> std::io::Result<Endpoint> {
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
    Ok(Endpoint::Pty { link: path.to_owned(), terminal, master: master.into(), is_open: false })
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        if let Self::Pty { link, terminal, .. } = self
            && std::fs::read_link(&*link).is_ok_and(|leads_to| leads_to == *terminal)
        {
            let _ = std::fs::remove_file(link);
        }
    }
}

/// An event of the endpoint.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum EndpointEvent {
    /// A client connected (true) or disconnected (false).
    Connected(bool),
    Bytes(Vec<u8>),
}

/// Polling interval while no client has the pseudo-terminal open, nanoseconds. Choice: a hundred
/// polls a second take no measurable time, and a client notices no delay.
const POLL_NS: i64 = 10_000_000;

impl Endpoint {
    pub fn is_open(&self) -> bool {
        match self {
            Self::Pty { is_open, .. } => *is_open,
            Self::Tcp { stream, .. } => stream.is_some(),
        }
    }

    /// The baud rate that the client set, if any.
    pub fn baud(&self) -> Option<u32> {
        match self {
            Self::Pty { master, .. } => rustix::termios::tcgetattr(master).ok().map(|modes| modes.output_speed()),
            Self::Tcp { .. } => None,
        }
    }

    /// Writes as many bytes as the client accepts; returns their number.
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        let written = match self {
            Self::Pty { master, is_open: true, .. } => master.write(bytes),
            Self::Tcp { stream: Some(stream), .. } => stream.write(bytes),
            // Without a client, the board's output is lost.
            _ => return bytes.len(),
        };
        match written {
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => 0,
            Err(_) => bytes.len(),
        }
    }

    /// Waits for an event, for room to write if wanted, or for the timeout.
    pub fn wait(&mut self, timeout_ns: i64, wants_room: bool, heard: &mut Vec<EndpointEvent>) -> std::io::Result<()> {
        let events = if wants_room { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN };
        match self {
            Self::Pty { master, is_open: false, .. } => {
                sleep(&mut [], timeout_ns.min(POLL_NS))?;
                let mut look = [PollFd::new(master, PollFlags::IN)];
                sleep(&mut look, 0)?;
                if look[0].revents().contains(PollFlags::HUP) {
                    return Ok(());
                }
                heard.push(EndpointEvent::Connected(true));
            }
            Self::Pty { master, .. } => {
                let mut look = [PollFd::new(master, events)];
                sleep(&mut look, timeout_ns)?;
                let revents = look[0].revents();
                if revents.contains(PollFlags::IN) {
                    read(&*master, heard);
                } else if revents.intersects(PollFlags::HUP | PollFlags::ERR) {
                    heard.push(EndpointEvent::Connected(false));
                }
            }
            Self::Tcp { listener, stream: None } => {
                sleep(&mut [PollFd::new(listener, PollFlags::IN)], timeout_ns)?;
                if let Ok((client, _)) = listener.accept() {
                    client.set_nonblocking(true)?;
                    client.set_nodelay(true)?;
                    heard.push(EndpointEvent::Connected(true));
                    *self = Self::Tcp { listener: listener.try_clone()?, stream: Some(client) };
                }
                return Ok(());
            }
            Self::Tcp { listener, stream: Some(client) } => {
                let mut look = [PollFd::new(client, events), PollFd::new(listener, PollFlags::IN)];
                sleep(&mut look, timeout_ns)?;
                let (of_client, of_listener) = (look[0].revents(), look[1].revents());
                if of_client.intersects(PollFlags::IN | PollFlags::HUP | PollFlags::ERR) {
                    read(&*client, heard);
                } else if of_listener.contains(PollFlags::IN) {
                    // One client at a time: others are refused, unless this one may be about to
                    // disconnect.
                    drop(listener.accept());
                }
            }
        }
        if let (Some(EndpointEvent::Connected(came)), Self::Pty { is_open, .. }) = (heard.last(), &mut *self) {
            *is_open = *came;
        }
        if let (Some(EndpointEvent::Connected(false)), Self::Tcp { stream, .. }) = (heard.last(), self) {
            *stream = None;
        }
        Ok(())
    }
}

fn read(mut from: impl Read, heard: &mut Vec<EndpointEvent>) {
    let mut buffer = [0; 4096];
    match from.read(&mut buffer) {
        Ok(count) if count > 0 => heard.push(EndpointEvent::Bytes(buffer[..count].to_vec())),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
        _ => heard.push(EndpointEvent::Connected(false)),
    }
}

/// Waits with the system's finest timer; a signal ends the wait early.
pub(super) fn sleep(look: &mut [PollFd], timeout_ns: i64) -> std::io::Result<()> {
    let timeout_ns = timeout_ns.clamp(0, 1_000_000_000);
    let timeout = Timespec { tv_sec: timeout_ns / 1_000_000_000, tv_nsec: (timeout_ns % 1_000_000_000) as _ };
    match rustix::event::poll(look, Some(&timeout)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
