//! The locks of [`super::queue`]: `interleavings/` compiles that file with others in their place.

pub(super) use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
