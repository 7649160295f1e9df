//! Time that a thread was runnable without a processor core: the effect of other load on the
//! thread.
//!
//! Linux counts it per thread: the second number of `schedstat`, nanoseconds
//! (Documentation/scheduler/sched-stats.rst).

use std::fs::File;

/// The counter of the thread that created it.
#[derive(Debug)]
pub struct CoreWait {
    schedstat: Option<File>,
}

impl CoreWait {
    /// For the calling thread.
    pub fn of_this_thread() -> Self {
        let path = if cfg!(target_os = "linux") { "/proc/thread-self/schedstat" } else { "" };
        Self { schedstat: File::open(path).ok() }
    }

    /// Total since the thread began, nanoseconds; 0 where the system does not report it.
    pub fn total_ns(&self) -> i64 {
        self.schedstat.as_ref().and_then(waited_ns).unwrap_or(0)
    }
}

#[cfg(unix)]
fn waited_ns(schedstat: &File) -> Option<i64> {
    use std::os::unix::fs::FileExt;
    let mut text = [0; 96];
    let length = schedstat.read_at(&mut text, 0).ok()?;
    std::str::from_utf8(text.get(..length)?).ok()?.split_whitespace().nth(1)?.parse().ok()
}

#[cfg(not(unix))]
fn waited_ns(_schedstat: &File) -> Option<i64> {
    None
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use crate::app::{now_ns, thread_cpu_ns};

    const SLEEP: std::time::Duration = std::time::Duration::from_millis(300);

    #[test]
    fn core_wait_counts_contention_and_not_sleep() {
        let wait = CoreWait::of_this_thread();
        assert!(wait.schedstat.is_some(), "no /proc/thread-self/schedstat: use a kernel with CONFIG_SCHED_INFO");
        // A machine whose cores are taken wakes the thread late; only that delay is waiting.
        let (before_ns, start_ns) = (wait.total_ns(), now_ns());
        std::thread::sleep(SLEEP);
        let late_ns = now_ns() - start_ns - SLEEP.as_nanos() as i64;
        let waited_ns = wait.total_ns() - before_ns;
        assert!(waited_ns < late_ns + 50_000_000, "sleeping is not waiting: {waited_ns} ns, {late_ns} ns late");
        // More threads than cores: time neither running nor sleeping was waiting.
        let busy = || {
            let (wait, start_ns, start_cpu_ns) = (CoreWait::of_this_thread(), now_ns(), thread_cpu_ns());
            while now_ns() - start_ns < 200_000_000 {}
            let ran_ns = thread_cpu_ns() - start_cpu_ns;
            (now_ns() - start_ns - ran_ns, wait.total_ns())
        };
        let cores = std::thread::available_parallelism().unwrap().get();
        let threads: Vec<_> = (0..2 * cores).map(|_| std::thread::spawn(busy)).collect();
        let measured: Vec<(i64, i64)> = threads.into_iter().map(|thread| thread.join().unwrap()).collect();
        let (lost_ns, waited_ns) = measured.into_iter().reduce(|a, b| (a.0 + b.0, a.1 + b.1)).unwrap();
        assert!(waited_ns > lost_ns / 2, "{waited_ns} of {lost_ns} ns");
    }
}
