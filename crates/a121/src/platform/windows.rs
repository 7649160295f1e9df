//! Windows.

use std::io;
use std::marker::PhantomData;
use std::os::windows::fs::OpenOptionsExt;
use std::os::windows::io::{AsRawHandle, AsRawSocket};
use std::sync::OnceLock;
use std::time::Duration;

use serialport::{COMPort, SerialPort, SerialPortBuilder};
use windows_sys::Win32::Devices::Communication::{DCB, GetCommState, SetCommState};
use windows_sys::Win32::Foundation::{ERROR_ACCESS_DENIED, ERROR_SHARING_VIOLATION};
use windows_sys::Win32::Networking::WinSock::{
    POLLERR, POLLHUP, POLLRDNORM, POLLWRNORM, SOCKET_ERROR, WSAPOLLFD, WSAPoll,
};
use windows_sys::Win32::System::Performance::{QueryPerformanceCounter, QueryPerformanceFrequency};

pub use super::windows_usb::{complete_usb, usb_without_port};

/// A port's name in messages.
pub const EXAMPLE_PORT: &str = "COM3";
/// Longest wait for sockets, milliseconds. Choice: the caller's loop waits again.
const MAX_WAIT_MS: u64 = 60_000;
/// The bits of `fDtrControl` in the bit field of a `DCB`, and its value `DTR_CONTROL_ENABLE`. Source: winbase.h.
const DTR_MASK: u32 = 0b11 << 4;
const DTR_CONTROL_ENABLE: u32 = 1 << 4;

/// The host's monotonic clock, nanoseconds: the performance counter over its frequency, as `std::chrono::steady_clock` and
/// Python's `time.perf_counter` have it.
pub fn monotonic_ns() -> i64 {
    static FREQUENCY: OnceLock<i64> = OnceLock::new();
    let frequency = *FREQUENCY.get_or_init(|| {
        let mut frequency = 0;
        // SAFETY: a variable for the number. It never fails (Microsoft, since Windows XP).
        unsafe { QueryPerformanceFrequency(&mut frequency) };
        frequency.max(1)
    });
    let mut count = 0;
    // SAFETY: as above.
    unsafe { QueryPerformanceCounter(&mut count) };
    // Split, as the product would overflow after minutes.
    let (seconds, rest) = (count / frequency, count % frequency);
    seconds.saturating_mul(1_000_000_000).saturating_add(rest * 1_000_000_000 / frequency)
}

/// A socket to wait for.
pub struct Watch<'a>(WSAPOLLFD, PhantomData<&'a ()>);

impl<'a> Watch<'a> {
    /// Waits for input, and for room to write if wanted.
    pub fn new(source: &'a impl AsRawSocket, wants_room: bool) -> Self {
        let events = if wants_room { POLLRDNORM | POLLWRNORM } else { POLLRDNORM };
        Self(WSAPOLLFD { fd: source.as_raw_socket() as usize, events, revents: 0 }, PhantomData)
    }

    /// Whether there is input, or a client to accept.
    pub fn has_input(&self) -> bool {
        self.0.revents & POLLRDNORM != 0
    }

    /// Whether the other side has hung up.
    pub fn is_closed(&self) -> bool {
        self.0.revents & (POLLHUP | POLLERR) != 0
    }
}

/// Waits until one of them is ready. The system counts milliseconds: the wait is rounded up, so that nobody turns in circles.
pub fn wait<const N: usize>(watches: &mut [Watch; N], timeout_ns: i64) -> io::Result<()> {
    let timeout = Duration::from_nanos(timeout_ns.max(0) as u64);
    if N == 0 {
        std::thread::sleep(timeout.min(Duration::from_millis(MAX_WAIT_MS)));
        return Ok(());
    }
    let timeout_ms = timeout.as_nanos().div_ceil(1_000_000).min(u128::from(MAX_WAIT_MS)) as i32;
    let mut polled = watches.each_ref().map(|watch| watch.0);
    // SAFETY: as many entries as is said, each with a socket that is borrowed for longer than the call.
    if unsafe { WSAPoll(polled.as_mut_ptr(), N as u32, timeout_ms) } == SOCKET_ERROR {
        return Err(io::Error::last_os_error());
    }
    watches.iter_mut().zip(polled).for_each(|(watch, polled)| watch.0 = polled);
    Ok(())
}

/// The time-out that a port's driver is given: whole milliseconds, rounded up. The serialport crate rounds down, and what a
/// driver makes of 0 is its own affair.
pub fn driver_timeout(patience: Duration) -> Duration {
    Duration::from_millis(patience.as_nanos().div_ceil(1_000_000).max(1) as u64)
}

/// Opens a serial port and raises DTR, as other systems do: much firmware with its own USB sends nothing without. It stays
/// raised when the speed changes, for which the driver's settings are read and written as a whole.
pub fn open_serial(builder: SerialPortBuilder) -> serialport::Result<Box<dyn SerialPort>> {
    let port = builder.dtr_on_open(true).open_native()?;
    keep_dtr_raised(&port);
    Ok(Box::new(port))
}

/// Does nothing for a driver that refuses, whose port has no such line.
fn keep_dtr_raised(port: &COMPort) {
    let handle = port.as_raw_handle();
    // SAFETY: the handle is that of the open port; a structure of the length that it states.
    unsafe {
        let mut settings = DCB { DCBlength: size_of::<DCB>() as u32, ..std::mem::zeroed() };
        if GetCommState(handle, &mut settings) != 0 {
            settings._bitfield = settings._bitfield & !DTR_MASK | DTR_CONTROL_ENABLE;
            SetCommState(handle, &settings);
        }
    }
}

/// Whether a port that does not open is there and open elsewhere. The serialport crate reports both alike.
pub fn is_in_use(path: &str) -> bool {
    let name = if path.starts_with('\\') { path.to_owned() } else { format!(r"\\.\{path}") };
    match std::fs::OpenOptions::new().read(true).write(true).share_mode(0).open(name) {
        // It has just become free.
        Ok(_) => true,
        Err(error) => {
            [ERROR_ACCESS_DENIED, ERROR_SHARING_VIOLATION].map(|code| Some(code as i32)).contains(&error.raw_os_error())
        }
    }
}
