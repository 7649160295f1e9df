//! Endpoint at which a simulated board is served: a pseudo-terminal or a TCP port.
//!
//! A pseudo-terminal knows the baud rate that the client set, so differing rates give noise. It
//! cannot transmit a break. These events count as one: a client opens it; the client sets 115 200
//! baud while the board has another rate; and, while the board streams, the first command of a
//! session.

#[cfg(unix)]
mod pty;

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
#[cfg(unix)]
use std::path::PathBuf;

use crate::platform::{Watch, wait};
#[cfg(unix)]
use pty::Pty;

/// Forms of an address.
const FORMS: &str = if cfg!(unix) {
    "pty:PATH, or tcp:ADDRESS:PORT such as tcp:127.0.0.1:6110"
} else {
    "tcp:ADDRESS:PORT such as tcp:127.0.0.1:6110; there are no pseudo-terminals on this system"
};

/// Address at which a board is served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ServeAddress {
    /// A symbolic link of this name, to a pseudo-terminal.
    #[cfg(unix)]
    Pty(PathBuf),
    /// A TCP address.
    Tcp(SocketAddr),
}

/// An address that cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Neither `pty:PATH` nor `tcp:ADDRESS:PORT`.
    #[error("\"{0}\" is not an address to serve a board at: write {forms}", forms = FORMS)]
    InvalidAddress(String),
    /// An address that other computers can reach.
    #[error("{0} can be reached from other computers: use 127.0.0.1, or pass --any-address")]
    NotLoopback(SocketAddr),
    /// The path exists and is not a link.
    #[error("{0} exists and is not a link to a terminal: choose another name")]
    #[cfg(unix)]
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
            #[cfg(unix)]
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
            #[cfg(unix)]
            Self::Pty(path) => path.display().to_string(),
            Self::Tcp(address) => format!("tcp:{address}"),
        }
    }

    pub(super) fn open(&self) -> Result<Endpoint, ServeError> {
        let io = |source| ServeError::Io { place: self.port(), source };
        match self {
            #[cfg(unix)]
            Self::Pty(path) => {
                if std::fs::symlink_metadata(path).is_ok_and(|there| !there.is_symlink()) {
                    return Err(ServeError::Taken(path.clone()));
                }
                Pty::open(path).map(Endpoint::Pty).map_err(io)
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
    #[cfg(unix)]
    Pty(Pty),
    Tcp {
        listener: TcpListener,
        stream: Option<TcpStream>,
    },
}

/// An event of the endpoint.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum EndpointEvent {
    /// A client connected (true) or disconnected (false).
    Connected(bool),
    Bytes(Vec<u8>),
}

impl Endpoint {
    pub fn is_open(&self) -> bool {
        match self {
            #[cfg(unix)]
            Self::Pty(pty) => pty.is_open(),
            Self::Tcp { stream, .. } => stream.is_some(),
        }
    }

    /// The baud rate that the client set, if any.
    pub fn baud(&self) -> Option<u32> {
        match self {
            #[cfg(unix)]
            Self::Pty(pty) => pty.baud(),
            Self::Tcp { .. } => None,
        }
    }

    /// Writes as many bytes as the client accepts; returns their number.
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        let written = match self {
            #[cfg(unix)]
            Self::Pty(pty) if pty.is_open() => pty.write(bytes),
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
        match self {
            #[cfg(unix)]
            Self::Pty(pty) => return pty.wait(timeout_ns, wants_room, heard),
            Self::Tcp { listener, stream: stream @ None } => {
                wait(&mut [Watch::new(listener, false)], timeout_ns)?;
                if let Ok((client, _)) = listener.accept() {
                    client.set_nonblocking(true)?;
                    client.set_nodelay(true)?;
                    heard.push(EndpointEvent::Connected(true));
                    *stream = Some(client);
                }
            }
            Self::Tcp { listener, stream } => {
                let Some(client) = stream.as_ref() else { return Ok(()) };
                let mut watches = [Watch::new(client, wants_room), Watch::new(listener, false)];
                wait(&mut watches, timeout_ns)?;
                let [of_client, of_listener] = watches;
                if of_client.has_input() || of_client.is_closed() {
                    read(client, heard);
                } else if of_listener.has_input() {
                    // One client at a time: others are refused, unless this one may be about to
                    // disconnect.
                    drop(listener.accept());
                }
                if heard.last() == Some(&EndpointEvent::Connected(false)) {
                    *stream = None;
                }
            }
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
