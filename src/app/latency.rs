//! A histogram of durations in fixed memory: sixteen steps per octave, so a quantile is accurate to
//! 5 %. The maximum is exact.

/// Steps per octave as a power of two. Choice: sixteen, which bounds a quantile's error to 1/16 of
/// an octave, 5 %.
const STEP_BITS: u32 = 4;
/// Steps for durations of up to 63 bits.
const STEPS: usize = (64 - STEP_BITS as usize) << STEP_BITS;

/// A histogram of durations.
#[derive(Clone)]
pub struct Latency {
    counts: Box<[u64; STEPS]>,
    count: u64,
    max_ns: i64,
}

/// Statistics of a [`Latency`]; all in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LatencyReport {
    /// Number of durations.
    pub count: u64,
    /// Median.
    pub median_s: f64,
    /// 99th percentile.
    pub p99_s: f64,
    /// 99.9th percentile.
    pub p999_s: f64,
    /// Maximum.
    pub max_s: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { counts: Box::new([0; STEPS]), count: 0, max_ns: 0 }
    }
}

impl Latency {
    /// Adds a duration; negative ones count as 0.
    pub fn push(&mut self, duration_ns: i64) {
        let duration_ns = duration_ns.max(0);
        self.counts[step(duration_ns as u64)] += 1;
        self.count += 1;
        self.max_ns = self.max_ns.max(duration_ns);
    }

    /// Statistics so far.
    pub fn report(&self) -> LatencyReport {
        let at = |part: f64| {
            let rank = (part * self.count as f64).ceil() as u64;
            let mut below = 0;
            let step = self.counts.iter().position(|&count| {
                below += count;
                below >= rank
            });
            (step.map_or(0.0, upper_ns).min(self.max_ns as f64)) * 1e-9
        };
        match self.count {
            0 => LatencyReport::default(),
            count => LatencyReport {
                count,
                median_s: at(0.5),
                p99_s: at(0.99),
                p999_s: at(0.999),
                max_s: self.max_ns as f64 * 1e-9,
            },
        }
    }
}

/// Step of a duration: its octave and the bits after the leading one.
fn step(duration_ns: u64) -> usize {
    let octave = (63 - (duration_ns | 1).leading_zeros()).saturating_sub(STEP_BITS);
    let within = duration_ns >> octave;
    ((octave << STEP_BITS) as usize + within as usize).min(STEPS - 1)
}

/// Upper end of a step, nanoseconds.
fn upper_ns(step: usize) -> f64 {
    let (octave, within) = match step >> STEP_BITS {
        0 | 1 => (0, step),
        octaves => (octaves - 1, step - ((octaves - 1) << STEP_BITS)),
    };
    (within as f64 + 1.0) * 2f64.powi(octave as i32) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_a_sorted_list() {
        let mut latency = Latency::default();
        assert_eq!(latency.report(), LatencyReport::default());
        let mut all: Vec<i64> = (0..5000i64).map(|n| (n * n * n) % 3_000_017 + n).collect();
        all.iter().for_each(|&ns| latency.push(ns));
        all.sort_unstable();
        let report = latency.report();
        for (told_s, rank) in [(report.median_s, 2499), (report.p99_s, 4949)] {
            let true_s = all[rank] as f64 * 1e-9;
            assert!(told_s >= true_s && told_s <= true_s * 1.07, "{told_s} {true_s}");
        }
        assert_eq!((report.max_s, report.count), (all[4999] as f64 * 1e-9, 5000));
    }

    #[test]
    fn histogram_steps_cover_all_durations() {
        for ns in (0..100_000u64).chain([1 << 40, u64::MAX >> 1]) {
            let step = step(ns);
            assert!(upper_ns(step) >= ns as f64 && (step == 0 || upper_ns(step - 1) < ns as f64 + 0.5), "{ns} {step}");
        }
        let mut latency = Latency::default();
        [i64::MIN, -1, 0, i64::MAX].into_iter().for_each(|ns| latency.push(ns));
        assert_eq!(latency.report().count, 4);
    }
}
