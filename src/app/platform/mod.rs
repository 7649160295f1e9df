//! What differs between operating systems and is not in a crate: how a program is asked to end, thread priorities, processor
//! time, timers and the identity of files. Both files have the same functions.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;
