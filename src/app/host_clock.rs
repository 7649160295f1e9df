//! The host's monotonic clock in nanoseconds, which other programs' timestamps use, and the
//! processor time of a thread. `Instant` reads the same clock but hides its origin.

pub use super::platform::thread_cpu_ns;
pub use a121::monotonic_ns as now_ns;

/// The clock of [`now_ns`] for those who write timestamps in another program.
pub const CLOCK_NAME: &str = if cfg!(windows) {
    "QueryPerformanceCounter over its frequency, in Python time.perf_counter()"
} else {
    "CLOCK_MONOTONIC, in Python time.monotonic()"
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes_and_work_is_counted() {
        let (start_ns, cpu_ns) = (now_ns(), thread_cpu_ns());
        let mut state = 1u64;
        // Windows counts processor time in steps of 16 ms.
        while thread_cpu_ns() == cpu_ns {
            for _ in 0..1_000_000 {
                state = std::hint::black_box(state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
            }
        }
        assert!(now_ns() > start_ns && thread_cpu_ns() > cpu_ns);
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
