//! Values passed from the thread that makes them to those that show them: these take the newest one and never wait for work.
//! `interleavings/` runs this file under schedulers that choose which thread goes on.

use super::sync::{Arc, AtomicU64, Mutex, MutexGuard, Ordering, PoisonError, TryLockError};

/// The newest of a sequence of values, each of which replaces the one before.
pub struct Newest<T> {
    value: Mutex<Arc<T>>,
    version: AtomicU64,
}

impl<T> Newest<T> {
    /// The first value has version 1.
    pub fn new(first: T) -> Self {
        Self { value: Mutex::new(Arc::new(first)), version: AtomicU64::new(1) }
    }

    /// The newest value.
    pub fn get(&self) -> Arc<T> {
        Arc::clone(&lock(&self.value))
    }

    /// The newest value, if it is newer than that version; never waits.
    pub fn newer_than(&self, version: &mut u64) -> Option<Arc<T>> {
        // Read before the value: at worst the next call gives the same value again.
        let now = self.version.load(Ordering::Acquire);
        if now == *version {
            return None;
        }
        let newest = try_get(&self.value)?;
        *version = now;
        Some(newest)
    }

    /// Replaces the value, which it returns.
    pub fn publish(&self, value: Arc<T>) -> Arc<T> {
        let before = std::mem::replace(&mut *lock(&self.value), value);
        self.version.fetch_add(1, Ordering::Release);
        before
    }
}

/// A value that belongs to an epoch: what was made before a reset means nothing after it.
pub trait OfEpoch {
    /// The value at the beginning of an epoch.
    fn nothing(epoch: u64) -> Self;
    fn epoch(&self) -> u64;
}

/// The newest value of the current epoch.
pub struct NewestOfEpoch<T> {
    epoch: AtomicU64,
    newest: Mutex<Arc<T>>,
    /// The last value returned to a reader.
    last_given: Mutex<Arc<T>>,
}

impl<T: OfEpoch> NewestOfEpoch<T> {
    pub fn new() -> Self {
        let nothing = Arc::new(T::nothing(0));
        Self { epoch: AtomicU64::new(0), newest: Mutex::new(Arc::clone(&nothing)), last_given: Mutex::new(nothing) }
    }

    /// Number of resets.
    pub fn epoch(&self) -> u64 {
        self.epoch.load(Ordering::SeqCst)
    }

    pub fn publish(&self, value: T) {
        let before = std::mem::replace(&mut *lock(&self.newest), Arc::new(value));
        // Dropped after the lock is released.
        drop(before);
    }

    /// The newest value, none of before a reset; the last one again while the maker replaces it.
    pub fn latest(&self) -> Arc<T> {
        let mut last_given = lock(&self.last_given);
        if let Some(newest) = try_get(&self.newest).filter(|newest| newest.epoch() == self.epoch()) {
            *last_given = newest;
        }
        Arc::clone(&last_given)
    }

    /// Begins an epoch, which it returns.
    pub fn reset(&self) -> u64 {
        let mut last_given = lock(&self.last_given);
        let epoch = self.epoch.fetch_add(1, Ordering::SeqCst) + 1;
        *last_given = Arc::new(T::nothing(epoch));
        epoch
    }
}

/// The value, unless it is being replaced.
fn try_get<T>(value: &Mutex<Arc<T>>) -> Option<Arc<T>> {
    match value.try_lock() {
        Ok(value) => Some(Arc::clone(&value)),
        Err(TryLockError::Poisoned(poisoned)) => Some(Arc::clone(&poisoned.into_inner())),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// The values are whole at any time, even after a panic.
fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Map(u64);

    impl OfEpoch for Map {
        fn nothing(epoch: u64) -> Self {
            Self(epoch)
        }

        fn epoch(&self) -> u64 {
            self.0
        }
    }

    #[test]
    fn readers_never_wait_for_the_maker() {
        let maps = NewestOfEpoch::<Map>::new();
        let is_being_replaced = lock(&maps.newest);
        assert_eq!(maps.latest().epoch(), 0);
        assert_eq!((maps.reset(), maps.latest().epoch()), (1, 1));
        drop(is_being_replaced);
        let settings = Newest::new(1);
        let is_being_replaced = lock(&settings.value);
        assert!(settings.newer_than(&mut 0).is_none());
        drop(is_being_replaced);
        assert_eq!(settings.newer_than(&mut 0).as_deref(), Some(&1));
    }
}
