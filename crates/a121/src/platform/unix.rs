//! Linux and macOS.

use std::io;
use std::os::fd::AsFd;
use std::path::Path;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::time::{ClockId, clock_gettime};
use serialport::{SerialPort, SerialPortBuilder};

use crate::find::{PortDescription, UsbDescription};

/// A port's name in messages.
pub const EXAMPLE_PORT: &str = "/dev/ttyACM0";
/// Longest wait for sockets, nanoseconds. Choice: the caller's loop waits again.
const MAX_WAIT_NS: i64 = 60_000_000_000;

/// The host's monotonic clock, nanoseconds (`CLOCK_MONOTONIC`).
pub fn monotonic_ns() -> i64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec as i64)
}

/// A socket or terminal to wait for.
pub struct Watch<'a>(PollFd<'a>);

impl<'a> Watch<'a> {
    /// Waits for input, and for room to write if wanted.
    pub fn new(source: &'a impl AsFd, wants_room: bool) -> Self {
        Self(PollFd::new(source, if wants_room { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN }))
    }

    /// Whether there is input, or a client to accept.
    pub fn has_input(&self) -> bool {
        self.0.revents().contains(PollFlags::IN)
    }

    /// Whether the other side has hung up.
    pub fn is_closed(&self) -> bool {
        self.0.revents().intersects(PollFlags::HUP | PollFlags::ERR)
    }
}

/// Waits with the system's finest timer until one of them is ready; a signal ends the wait early.
pub fn wait<const N: usize>(watches: &mut [Watch; N], timeout_ns: i64) -> io::Result<()> {
    let timeout_ns = timeout_ns.clamp(0, MAX_WAIT_NS);
    let timeout = Timespec { tv_sec: timeout_ns / 1_000_000_000, tv_nsec: (timeout_ns % 1_000_000_000) as _ };
    let mut polled = watches.each_ref().map(|watch| watch.0.clone());
    match rustix::event::poll(&mut polled, Some(&timeout)) {
        Ok(_) => {
            watches.iter_mut().zip(polled).for_each(|(watch, polled)| watch.0 = polled);
            Ok(())
        }
        Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// The time-out that a port's driver is given: here it takes any.
pub fn driver_timeout(patience: Duration) -> Duration {
    patience
}

/// Opens a serial port; opening raises DTR here.
pub fn open_serial(builder: SerialPortBuilder) -> serialport::Result<Box<dyn SerialPort>> {
    builder.open()
}

/// Whether a port that does not open is there and open elsewhere.
pub fn is_in_use(path: &str) -> bool {
    Path::new(path).exists()
}

/// Adds what the serialport crate does not tell of USB devices: the name of the interface.
pub fn complete_usb(ports: &mut [PortDescription]) {
    for PortDescription { path, usb } in ports {
        if let Some(usb) = usb {
            usb.interface = interface_name(path);
        }
    }
}

/// The tty of a UART is below its interface; the tty of a modem is the interface itself.
fn interface_name(path: &str) -> Option<String> {
    let device = Path::new("/sys/class/tty").join(Path::new(path).file_name()?).join("device").canonicalize().ok()?;
    let places = [device.join("interface"), device.parent()?.join("interface")];
    let text = places.iter().find_map(|place| std::fs::read_to_string(place).ok())?;
    Some(text.trim().to_owned())
}

/// USB devices that have no serial port: none is known here, as every board gets one.
pub fn usb_without_port() -> Vec<UsbDescription> {
    Vec::new()
}
