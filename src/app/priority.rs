//! Lowers the priority of background threads, so that the frame loop runs first.

/// Lowers the priority of the calling thread by this many steps of `nice`; ten leave it about a
/// tenth of a contended core. Does nothing where the system has no thread priorities or refuses:
/// the work is the same, only later.
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
