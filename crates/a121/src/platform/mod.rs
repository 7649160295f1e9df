//! What differs between operating systems and is not in a crate: the clock, waiting for sockets, and what a serial port needs.
//! Both files have the same functions.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;
#[cfg(windows)]
mod windows_usb;

#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;
