//! The locks of [`super::queue`] and [`super::handover`]: `interleavings/` compiles these files with others in their place.

pub(super) use std::sync::atomic::{AtomicU64, Ordering};
pub(super) use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
