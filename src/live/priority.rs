//! Work that may take its time steps back behind the frame loop.

/// Lowers the priority of the calling thread by so many steps (of `nice`: ten give it about a tenth of a contended core).
/// Where the system knows no priority of a thread, or grants none, nothing happens: the work is the same, only later.
#[cfg(target_os = "linux")]
pub fn lower_priority_of_this_thread(by: u8) {
    use rustix::process::{getpriority_process, setpriority_process};
    // On Linux this is the thread's own, other than POSIX has it.
    if let Ok(now) = getpriority_process(None) {
        let _ = setpriority_process(None, (now + i32::from(by)).min(19));
    }
}

/// Lowers the priority of the calling thread: here the system has none that is a thread's own.
#[cfg(not(target_os = "linux"))]
pub fn lower_priority_of_this_thread(_by: u8) {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use rustix::process::getpriority_process;

    #[test]
    fn only_the_calling_thread_is_lowered() {
        let before = getpriority_process(None).unwrap();
        let lowered = std::thread::spawn(|| {
            lower_priority_of_this_thread(3);
            getpriority_process(None).unwrap()
        });
        assert_eq!(lowered.join().unwrap(), (before + 3).min(19));
        assert_eq!(getpriority_process(None).unwrap(), before);
    }
}
