//! An open line to a board: a serial port, or a TCP socket to a server on a Raspberry Pi. Only this
//! file, `find`, `remedy` and `platform` do I/O in this module.
//!
//! Reads wait with the precision of the system's timers (`ppoll`), because a payload counts as
//! ended after 300 µs without bytes. On Windows these are milliseconds: a result whose following line
//! does not come is accepted that much later. Nothing here blocks forever. A board that holds its flow
//! control would block a write, a break and even closing. So output is written in pieces that fit
//! the driver's buffer, and is discarded before a break and before closing.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serialport::{ClearBuffer, DataBits, FlowControl, Parity, SerialPort, StopBits};

use super::platform::{self, EXAMPLE_PORT, Watch};
use super::{Action, FIRST_BAUD, find, remedy};

/// TCP port of the server on a Raspberry Pi. Source: the vendor's exploration server.
pub const TCP_PORT: u16 = 6110;
/// Timeout for writing a command. Choice: a command of 1 kB takes 0.1 s at 115 200 baud.
const WRITE_TIMEOUT: Duration = Duration::from_secs(1);
/// Timeout for connecting. Choice: that of a reply, which a local network answers in milliseconds.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Duration of a break. Choice: pySerial's default, which the vendor's tool is built on; it only
/// has to exceed one character at the lowest rate.
const BREAK_DURATION: Duration = Duration::from_millis(250);
/// Bytes per write. Choice: a driver that reports room has room for these.
const WRITE_CHUNK_BYTES: usize = 64;
/// Longest single wait. Choice: the caller's loop waits again; drivers take milliseconds in 32
/// bits.
const MAX_WAIT: Duration = Duration::from_secs(60);

/// Address of a board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A serial port.
    Serial {
        /// Path or name, such as `/dev/ttyACM0` or `COM3`.
        path: String,
        /// RTS/CTS flow control; off for boards with a CH340.
        flow_control: bool,
    },
    /// A socket, `host:port`.
    Tcp(String),
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Serial { path, .. } => f.write_str(path),
            Self::Tcp(host) => write!(f, "tcp:{host}"),
        }
    }
}

/// Why a line cannot be opened, or was lost.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// No port with this name.
    #[error("there is no port {path}: {available}")]
    NotFound {
        /// Requested path.
        path: String,
        /// Text that lists the available ports.
        available: String,
    },
    /// No board was found.
    #[error(
        "no A121 board is found: {available}. Plug one in, or name its port with --port (a path, or tcp:HOST[:PORT] for a \
         Raspberry Pi)"
    )]
    NoBoard {
        /// Text that lists the available ports.
        available: String,
    },
    /// The user lacks the permission.
    #[error("no permission to open {path}: {remedy}")]
    Permission {
        /// Path of the port.
        path: String,
        /// What to do.
        remedy: String,
    },
    /// Another process has the port open.
    #[error("{path} is in use by {holder}: {remedy}")]
    Busy {
        /// Path of the port.
        path: String,
        /// The process, if known.
        holder: String,
        /// What to do.
        remedy: String,
    },
    /// Not a serial port.
    #[error("{0} is not a serial port: give the board's port, such as {port}, or tcp:HOST[:PORT]", port = EXAMPLE_PORT)]
    NotAPort(String),
    /// The board is plugged in, but the system offers no serial port for it.
    #[error("{device} is plugged in, and there is no COM port for it: {remedy}")]
    NoSerialPort {
        /// Which board, with its USB ids.
        device: String,
        /// What to do.
        remedy: String,
    },
    /// Not a valid address.
    #[error("\"{0}\" is not an address: write tcp:HOST or tcp:HOST:PORT")]
    Address(String),
    /// The connection was refused.
    #[error("{address} refuses the connection: start the exploration server there, and check host and port")]
    Refused {
        /// The address.
        address: String,
    },
    /// The host cannot be reached.
    #[error("{address} cannot be reached ({reason}): check host, port and network")]
    Unreachable {
        /// The address.
        address: String,
        /// The system's message.
        reason: String,
    },
    /// The line was lost while open.
    #[error("{address} was disconnected ({reason}): unplugged, or without power")]
    Gone {
        /// The address.
        address: String,
        /// The system's message.
        reason: String,
    },
    /// A command could not be written.
    #[error("{address} accepts no bytes: the board holds its flow control; check that it is the right port")]
    Stuck {
        /// The address.
        address: String,
    },
    /// Any other error.
    #[error("cannot {doing} {address}: {reason}")]
    Other {
        /// The failed operation: "open", "set the speed of", …
        doing: &'static str,
        /// The address.
        address: String,
        /// The system's message.
        reason: String,
    },
}

/// The underlying transport.
enum Transport {
    Serial(Box<dyn SerialPort>),
    Tcp(TcpStream),
}

/// An open line.
pub struct Line {
    address: Address,
    end: Transport,
}

impl Line {
    /// Opens a line; a serial port exclusively, at 115200 8N1.
    ///
    /// # Errors
    /// Not found, no permission, in use, refused: each says what to do.
    pub fn open(address: &Address) -> Result<Self, PortError> {
        let end = match address {
            Address::Serial { path, flow_control } => Transport::Serial(open_serial(path, *flow_control)?),
            Address::Tcp(host) => Transport::Tcp(open_tcp(host)?),
        };
        Ok(Self { address: address.clone(), end })
    }

    /// The address of the line.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// Reads available bytes and waits at most `patience` for the first one; returns 0 if none
    /// arrived.
    ///
    /// # Errors
    /// The line was lost.
    pub fn read(&mut self, buffer: &mut [u8], patience: Duration) -> Result<usize, PortError> {
        let patience = patience.min(MAX_WAIT);
        let read = match &mut self.end {
            Transport::Serial(port) => {
                let _ = port.set_timeout(platform::driver_timeout(patience));
                port.read(buffer)
            }
            Transport::Tcp(socket) => read_socket(socket, buffer, patience),
        };
        match read {
            // End of file: a terminal that hung up, or a closed socket.
            Ok(0) => Err(self.gone("closed by the other side")),
            Ok(count) => Ok(count),
            Err(error) if is_nothing_yet(error.kind()) => Ok(0),
            Err(error) => Err(self.gone(&error.to_string())),
        }
    }

    /// Performs an action of a session, except [`Action::Reopen`], which is up to the owner of the
    /// line.
    ///
    /// # Errors
    /// The line was lost, or accepts no bytes.
    pub fn perform(&mut self, action: &Action) -> Result<(), PortError> {
        match action {
            Action::Send(bytes) => self.write(bytes),
            Action::SendBreak => {
                self.send_break();
                Ok(())
            }
            Action::FlushInput => self.flush_input(),
            Action::SetBaud(baud) => self.set_baud(*baud),
            Action::Reopen => Ok(()),
        }
    }

    /// Writes all bytes, or fails after `WRITE_TIMEOUT`.
    fn write(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        let start = Instant::now();
        let mut rest = bytes;
        while !rest.is_empty() {
            let patience = WRITE_TIMEOUT.saturating_sub(start.elapsed()).max(Duration::from_millis(1));
            let written = match &mut self.end {
                Transport::Serial(port) => {
                    let _ = port.set_timeout(platform::driver_timeout(patience));
                    port.write(&rest[..rest.len().min(WRITE_CHUNK_BYTES)])
                }
                Transport::Tcp(socket) => socket.set_write_timeout(Some(patience)).and_then(|()| socket.write(rest)),
            };
            match written {
                Ok(count) => rest = &rest[count..],
                Err(error) if !is_nothing_yet(error.kind()) => return Err(self.gone(&error.to_string())),
                Err(_) => {}
            }
            if start.elapsed() >= WRITE_TIMEOUT && !rest.is_empty() {
                return Err(PortError::Stuck { address: self.address.to_string() });
            }
        }
        Ok(())
    }

    /// Sends a break. Some ports do not support it (pseudo-terminals, some USB firmware); if such a
    /// board is streaming, the session notices and stops it.
    fn send_break(&mut self) {
        let Transport::Serial(port) = &mut self.end else { return };
        // The system would drain the output first, which a board may block forever.
        let _ = port.clear(ClearBuffer::Output);
        if port.set_break().is_ok() {
            sleep(BREAK_DURATION);
            let _ = port.clear_break();
        }
    }

    fn flush_input(&mut self) -> Result<(), PortError> {
        if let Transport::Serial(port) = &self.end {
            return port.clear(ClearBuffer::Input).map_err(|error| self.gone(&error.to_string()));
        }
        let mut thrown_away = [0; 4096];
        while self.read(&mut thrown_away, Duration::ZERO)? > 0 {}
        Ok(())
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), PortError> {
        let Transport::Serial(port) = &mut self.end else { return Ok(()) };
        port.set_baud_rate(baud).map_err(|error| match error.kind() {
            serialport::ErrorKind::InvalidInput => PortError::Other {
                doing: "set the speed of",
                address: self.address.to_string(),
                reason: format!("{baud} baud is not possible here"),
            },
            _ => self.gone(&error.to_string()),
        })
    }

    fn gone(&self, reason: &str) -> PortError {
        PortError::Gone { address: self.address.to_string(), reason: reason.to_owned() }
    }
}

impl Drop for Line {
    /// Discards pending output: closing would otherwise wait 30 s for a board that accepts none.
    fn drop(&mut self) {
        if let Transport::Serial(port) = &self.end {
            let _ = port.clear(ClearBuffer::Output);
        }
    }
}

fn is_nothing_yet(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

fn open_serial(path: &str, flow_control: bool) -> Result<Box<dyn SerialPort>, PortError> {
    let flow_control = if flow_control { FlowControl::Hardware } else { FlowControl::None };
    let builder = serialport::new(path, FIRST_BAUD)
        .data_bits(DataBits::Eight)
        .parity(Parity::None)
        .stop_bits(StopBits::One)
        .flow_control(flow_control);
    platform::open_serial(builder).map_err(|error| open_error(path, &error))
}

/// Converts an error of the serialport crate.
fn open_error(path: &str, error: &serialport::Error) -> PortError {
    let path = path.to_owned();
    match error.kind() {
        serialport::ErrorKind::Io(ErrorKind::NotFound) => {
            PortError::NotFound { path, available: find::describe_ports(&find::list_ports()) }
        }
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => {
            let remedy = remedy::permission(&path);
            PortError::Permission { path, remedy }
        }
        _ if std::fs::metadata(&path).is_ok_and(|m| m.is_file() || m.is_dir()) => PortError::NotAPort(path),
        serialport::ErrorKind::NoDevice if platform::is_in_use(&path) => {
            let (holder, remedy) = remedy::holder_and_remedy(&path);
            PortError::Busy { path, holder, remedy }
        }
        serialport::ErrorKind::NoDevice => {
            PortError::NotFound { path, available: find::describe_ports(&find::list_ports()) }
        }
        _ => match error.description.as_str() {
            "Not a typewriter" => PortError::NotAPort(path),
            reason => PortError::Other { doing: "open", address: path, reason: reason.to_owned() },
        },
    }
}

fn open_tcp(host: &str) -> Result<TcpStream, PortError> {
    let unreachable = |reason: String| PortError::Unreachable { address: format!("tcp:{host}"), reason };
    let addresses = host.to_socket_addrs().map_err(|error| unreachable(error.to_string()))?;
    let mut failed = unreachable("the name has no address".into());
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(socket) => {
                // Commands are small and each waits for its reply.
                let _ = socket.set_nodelay(true);
                return Ok(socket);
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                failed = PortError::Refused { address: format!("tcp:{host}") };
            }
            Err(error) => failed = unreachable(error.to_string()),
        }
    }
    Err(failed)
}

/// Waits apart from reading, since the timeouts of sockets are as coarse as the system tick.
fn read_socket(socket: &mut TcpStream, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
    let mut watch = [Watch::new(socket, false)];
    platform::wait(&mut watch, patience.as_nanos() as i64)?;
    let [watch] = watch;
    if !(watch.has_input() || watch.is_closed()) {
        return Err(ErrorKind::TimedOut.into());
    }
    socket.read(buffer)
}

#[cfg(all(test, unix))]
mod tests {
    use std::net::TcpListener;

    use serialport::TTYPort;

    use super::*;

    const SHORT: Duration = Duration::from_millis(50);

    fn serial(path: &str) -> Address {
        Address::Serial { path: path.into(), flow_control: true }
    }

    /// A pseudo-terminal: the board's end, and the path of ours.
    fn terminal() -> (TTYPort, String) {
        let (board, ours) = TTYPort::pair().unwrap();
        let path = ours.name().unwrap();
        (board, path)
    }

    fn opened_err(address: &Address) -> PortError {
        Line::open(address).err().expect("must not open")
    }

    #[test]
    fn terminal_transfers_bytes_and_reports_hang_up() {
        let (mut board, path) = terminal();
        let mut line = Line::open(&serial(&path)).unwrap();
        line.perform(&Action::SetBaud(2_000_000)).unwrap();
        line.perform(&Action::SendBreak).unwrap();
        let command: Vec<u8> = (0..1000).map(|n| b'a' + (n % 26) as u8).collect();
        line.perform(&Action::Send(command.clone())).unwrap();
        let mut got = vec![0; 1000];
        board.read_exact(&mut got).unwrap();
        assert_eq!(got, command);
        let raw: Vec<u8> = (0..=255).collect();
        board.write_all(&raw).unwrap();
        let mut buffer = [0; 4096];
        let (start, mut received) = (Instant::now(), Vec::new());
        while received.len() < 256 && start.elapsed() < WRITE_TIMEOUT {
            let count = line.read(&mut buffer, SHORT).unwrap();
            received.extend_from_slice(&buffer[..count]);
        }
        assert_eq!(received, raw);
        assert_eq!(line.read(&mut buffer, Duration::from_micros(300)).unwrap(), 0);
        board.write_all(b"stale").unwrap();
        line.perform(&Action::FlushInput).unwrap();
        assert_eq!(line.read(&mut buffer, SHORT).unwrap(), 0);
        drop(board);
        assert!(matches!(line.read(&mut buffer, SHORT), Err(PortError::Gone { .. })));
        assert!(matches!(line.write(b"x"), Err(PortError::Gone { .. })));
    }

    #[test]
    fn board_that_accepts_no_bytes_does_not_block() {
        let (_board, path) = terminal();
        let mut line = Line::open(&serial(&path)).unwrap();
        let start = Instant::now();
        assert!(matches!(line.write(&vec![b'x'; 1 << 20]), Err(PortError::Stuck { .. })));
        drop(line);
        assert!(start.elapsed() < 3 * WRITE_TIMEOUT, "{:?}", start.elapsed());
    }

    #[test]
    fn open_errors_give_the_reason() {
        assert!(opened_err(&serial("/dev/ttyNONE7")).to_string().contains("there is no port /dev/ttyNONE7"));
        assert!(matches!(opened_err(&serial("/dev/null")), PortError::NotAPort(_)));
        assert!(matches!(opened_err(&serial("/tmp")), PortError::NotAPort(_)));
        let refused =
            serialport::Error::new(serialport::ErrorKind::Io(ErrorKind::PermissionDenied), "Permission denied");
        let error = open_error("/dev/ttyNONE7", &refused).to_string();
        assert!(
            error.starts_with("no permission to open /dev/ttyNONE7: ") && error.contains("sudo usermod -aG"),
            "{error}"
        );
        let (_board, path) = terminal();
        let _first = Line::open(&serial(&path)).unwrap();
        let error = opened_err(&serial(&path));
        assert!(matches!(error, PortError::Busy { .. }), "{error}");
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = Address::Tcp(listener.local_addr().unwrap().to_string());
        drop(Line::open(&address).unwrap());
        drop(listener);
        let error = opened_err(&address);
        assert!(matches!(error, PortError::Refused { .. }), "{error}");
    }

    #[test]
    fn socket_read_waits_and_reports_disconnection() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut line = Line::open(&Address::Tcp(listener.local_addr().unwrap().to_string())).unwrap();
        let (mut board, _) = listener.accept().unwrap();
        let mut buffer = [0; 64];
        let patience = Duration::from_micros(300);
        let start = Instant::now();
        assert_eq!(line.read(&mut buffer, patience).unwrap(), 0);
        assert!(start.elapsed() >= patience);
        board.write_all(b"stale").unwrap();
        std::thread::sleep(SHORT);
        line.perform(&Action::FlushInput).unwrap();
        line.perform(&Action::SetBaud(9600)).unwrap();
        board.write_all(b"fresh").unwrap();
        assert_eq!(line.read(&mut buffer, SHORT).unwrap(), 5);
        drop(board);
        assert!(matches!(line.read(&mut buffer, SHORT), Err(PortError::Gone { .. })));
    }
}
