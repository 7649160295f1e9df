//! Linux and macOS.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// Sets the flag at Ctrl-C, termination, and when the terminal closes; a second signal ends the program at once.
pub fn stop_when_asked(stop: &Arc<AtomicBool>) -> std::io::Result<()> {
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        // `nohup` starts a program with this signal ignored: it is to outlive its terminal.
        if signal == SIGHUP && is_ignored(signal) {
            continue;
        }
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(stop))?;
        signal_hook::flag::register(signal, Arc::clone(stop))?;
    }
    Ok(())
}

/// Whether the process ignores a signal, as it may have inherited.
fn is_ignored(signal: i32) -> bool {
    let mut now = std::mem::MaybeUninit::<libc::sigaction>::uninit();
    // SAFETY: without a new action the call changes nothing, and on success it fills in the whole structure.
    unsafe {
        libc::sigaction(signal, std::ptr::null(), now.as_mut_ptr()) == 0
            && now.assume_init().sa_sigaction == libc::SIG_IGN
    }
}

/// Ends the process at once: at an orderly exit a hanging library would wait for its own threads.
pub fn exit_now(code: i32) -> ! {
    signal_hook::low_level::exit(code)
}

/// From now on the process gets no more memory than this; an allocation beyond it ends the process.
///
/// # Errors
/// The system refuses.
pub fn limit_memory_of_this_process(bytes: u64) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    // Limits that are lower already stay. Counted is what the process may write to, with what the allocator reserves.
    let now = getrlimit(Resource::Data);
    let least = |now: Option<u64>| Some(now.map_or(bytes, |now| now.min(bytes)));
    Ok(setrlimit(Resource::Data, Rlimit { current: least(now.current), maximum: least(now.maximum) })?)
}

/// Device and inode: equal for two open files only if they are the same file, whatever their names.
///
/// # Errors
/// The system refuses.
pub fn file_identity(file: &std::fs::File) -> std::io::Result<[u64; 2]> {
    use std::os::unix::fs::MetadataExt;
    let metadata = file.metadata()?;
    Ok([metadata.dev(), metadata.ino()])
}

/// Processor time of the calling thread, nanoseconds.
pub fn thread_cpu_ns() -> i64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
}

/// Lowers the calling thread by this many steps of `nice`; ten leave it about a tenth of a contended core.
#[cfg(target_os = "linux")]
pub fn lower_priority_of_this_thread(by: u8) {
    use rustix::process::{getpriority_process, setpriority_process};
    // On Linux the value is per thread, unlike in POSIX.
    if let Ok(now) = getpriority_process(None) {
        let _ = setpriority_process(None, (now + i32::from(by)).min(19));
    }
}

/// Does nothing: this system has no priority per thread.
#[cfg(not(target_os = "linux"))]
pub fn lower_priority_of_this_thread(_by: u8) {}

/// Does nothing: here only administrators may raise a priority.
pub fn raise_priority_of_this_thread() {}

/// Does nothing: waits are as fine as the system's timers.
pub fn refine_timers() {}

/// Does nothing: a program has the terminal that it was started in.
pub fn open_missing_console() {}

/// Does nothing: a program never has a terminal of its own.
pub fn leave_own_console() {}

/// False: as [`leave_own_console`].
pub fn has_own_console() -> bool {
    false
}
