//! A bounded time series. When it is full, every second value is dropped, and later values are kept
//! at the halved rate. The first and the newest value are always kept.

/// Values in ascending time, limited in number.
#[derive(Debug, Clone)]
pub struct DecimatedSeries<T> {
    entries: Vec<(i64, T)>,
    capacity: usize,
    /// Smallest distance between kept values, except for the newest, nanoseconds; 0 until values
    /// had to be dropped.
    step_ns: i64,
}

impl<T> DecimatedSeries<T> {
    /// An empty series for at most `capacity` values, 4 at least.
    pub fn new(capacity: usize) -> Self {
        Self { entries: Vec::new(), capacity: capacity.max(4), step_ns: 0 }
    }

    /// Adds a value. A value that is not later than the newest replaces it.
    pub fn push(&mut self, time_ns: i64, value: T) {
        if let Some(last) = self.entries.last_mut().filter(|last| time_ns <= last.0) {
            last.1 = value;
            return;
        }
        // The newest value is replaced until it is far enough from the one before it.
        let before = self.entries.len().checked_sub(2).map(|at| self.entries[at].0);
        let last = self.entries.last().map(|last| last.0);
        if let (Some(before), Some(last)) = (before, last)
            && last.saturating_sub(before) < self.step_ns
        {
            self.entries.pop();
        }
        self.entries.push((time_ns, value));
        if self.entries.len() > self.capacity {
            self.decimate();
        }
    }

    fn decimate(&mut self) {
        let last = self.entries.len() - 1;
        let mut at = 0;
        self.entries.retain(|_| {
            at += 1;
            (at - 1) % 2 == 0 || at - 1 == last
        });
        let span_ns = self.entries[self.entries.len() - 1].0.saturating_sub(self.entries[0].0);
        self.step_ns = (span_ns / (self.capacity as i64 / 2)).max(self.step_ns);
    }

    /// The newest value that is not later than a time, with its own time.
    pub fn at(&self, time_ns: i64) -> Option<&(i64, T)> {
        self.entries.get(self.count_until(time_ns).checked_sub(1)?)
    }

    /// The first value later than a time.
    pub fn after(&self, time_ns: i64) -> Option<&(i64, T)> {
        self.entries.get(self.count_until(time_ns))
    }

    /// The last value before a time.
    pub fn before(&self, time_ns: i64) -> Option<&(i64, T)> {
        self.entries.get(self.entries.partition_point(|entry| entry.0 < time_ns).checked_sub(1)?)
    }

    /// All values that are not later than a time.
    pub fn until(&self, time_ns: i64) -> &[(i64, T)] {
        &self.entries[..self.count_until(time_ns)]
    }

    /// The first value.
    pub fn first(&self) -> Option<&(i64, T)> {
        self.entries.first()
    }

    /// The newest value.
    pub fn last(&self) -> Option<&(i64, T)> {
        self.entries.last()
    }

    /// Number of values.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    fn count_until(&self, time_ns: i64) -> usize {
        self.entries.partition_point(|entry| entry.0 <= time_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn series_is_complete_until_full() {
        let mut row = DecimatedSeries::new(10);
        (0..10).for_each(|n| row.push(n * 7, n));
        assert_eq!(row.until(i64::MAX).iter().map(|e| e.1).collect::<Vec<_>>(), (0..10).collect::<Vec<_>>());
        assert_eq!((row.at(13).map(|e| e.1), row.at(14).map(|e| e.1), row.at(-1)), (Some(1), Some(2), None));
        assert_eq!((row.after(14).map(|e| e.1), row.before(14).map(|e| e.1)), (Some(3), Some(1)));
        assert_eq!((row.after(63), row.before(0)), (None, None));
    }

    #[test]
    fn non_increasing_time_replaces_the_newest() {
        let mut row = DecimatedSeries::new(10);
        [(5, 'a'), (5, 'b'), (3, 'c')].into_iter().for_each(|(t, v)| row.push(t, v));
        assert_eq!(row.until(i64::MAX), [(5, 'c')]);
    }

    #[test]
    fn decimation_keeps_even_spacing() {
        let mut row = DecimatedSeries::new(64);
        (0..100_000).for_each(|n| row.push(n, n));
        let kept = row.until(i64::MAX);
        let steps = kept.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let (least, capacity) =
            steps.clone().take(kept.len() - 2).fold((i64::MAX, 0), |(a, b), step| (a.min(step), b.max(step)));
        assert!(kept.len() >= 16 && capacity <= 4 * least, "{} kept, steps {least} to {capacity}", kept.len());
    }

    proptest! {
        #[test]
        fn series_is_bounded_sorted_and_keeps_its_ends(
            steps in prop::collection::vec(0i64..1000, 1..600),
            capacity in 4usize..40,
        ) {
            let mut row = DecimatedSeries::new(capacity);
            let mut time_ns = 0;
            for (n, step) in steps.iter().enumerate() {
                time_ns += step;
                row.push(time_ns, n);
                prop_assert!(row.len() <= capacity);
                prop_assert_eq!(row.last().unwrap(), &(time_ns, n));
            }
            prop_assert_eq!(row.first().unwrap().0, steps[0]);
            prop_assert!(row.until(i64::MAX).windows(2).all(|pair| pair[0].0 < pair[1].0));
        }
    }
}
