//! Priorities of threads, so that the frame loop and the sensor's reader run before the reconstruction. Where the system has
//! no priorities of threads or refuses, the work is the same, only later.

pub use super::platform::{lower_priority_of_this_thread, raise_priority_of_this_thread};

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
