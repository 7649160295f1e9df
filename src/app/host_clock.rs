//! The host's monotonic clock in nanoseconds, which other programs' timestamps use, and the
//! processor time of a thread. `Instant` reads the same clock but hides its origin.

/// The host's monotonic clock, nanoseconds (`CLOCK_MONOTONIC`).
#[cfg(unix)]
pub fn now_ns() -> i64 {
    nanoseconds(rustix::time::clock_gettime(rustix::time::ClockId::Monotonic))
}

/// Processor time of the calling thread, nanoseconds; 0 where the system does not report it.
#[cfg(unix)]
pub fn thread_cpu_ns() -> i64 {
    nanoseconds(rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime))
}

#[cfg(unix)]
fn nanoseconds(time: rustix::time::Timespec) -> i64 {
    time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec)
}

/// Nanoseconds since the first call. On this system, timestamps of other programs are not
/// comparable.
#[cfg(not(unix))]
pub fn now_ns() -> i64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_nanos() as i64
}

/// Processor time of the calling thread, nanoseconds; 0 where the system does not report it.
#[cfg(not(unix))]
pub fn thread_cpu_ns() -> i64 {
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes_and_work_is_counted() {
        let (start_ns, cpu_ns) = (now_ns(), thread_cpu_ns());
        let mut state = 1u64;
        for _ in 0..1_000_000 {
            state = std::hint::black_box(state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        }
        assert!(now_ns() > start_ns && thread_cpu_ns() >= cpu_ns);
        assert!(cfg!(not(unix)) || thread_cpu_ns() > cpu_ns);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn now_ns_is_the_system_monotonic_clock() {
        // Seconds since boot without suspend: never more than the uptime.
        let text = std::fs::read_to_string("/proc/uptime").unwrap();
        let up_s: f64 = text.split(' ').next().unwrap().parse().unwrap();
        let now_s = now_ns() as f64 * 1e-9;
        assert!(now_s > 0.0 && now_s <= up_s + 1.0, "{now_s} {up_s}");
    }
}
