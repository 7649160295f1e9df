//! Between threads: bounded, and never a reason to wait for the one who fills it.
//!
//! Entries lie on shelves with a bound each, so that a flood of one kind costs none of another; the oldest of its own shelf
//! goes and is counted. What comes out keeps the order in which it went in. A [`Feeder`] does not even wait for the lock:
//! who takes entries out may be a thread of lower priority, put aside by the system while it holds it.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

/// Times that a feeder tries for the lock before it keeps its entries for the next time: some microseconds.
const TRIES: usize = 64;

/// What nobody fetched in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dropped {
    /// Results with their frames.
    pub frames: u64,
    /// Lines of the board's log.
    pub logs: u64,
    /// Other events.
    pub others: u64,
}

/// What waiting for the next entry gave.
#[derive(Debug, Clone, PartialEq)]
pub enum Received<T> {
    /// The next one.
    Event(T),
    /// Nothing came in time.
    TimedOut,
    /// Nothing will come any more.
    Over,
}

struct Shelf<T> {
    entries: VecDeque<(u64, T)>,
    most: usize,
    dropped: u64,
}

struct Shelves<T, const SHELVES: usize> {
    shelves: [Shelf<T>; SHELVES],
    next: u64,
    is_over: bool,
}

/// The queue. See the file's head.
pub(super) struct Queue<T, const SHELVES: usize> {
    shelves: Mutex<Shelves<T, SHELVES>>,
    filled: Condvar,
}

impl<T, const SHELVES: usize> Queue<T, SHELVES> {
    /// Shelves that hold at most so many entries each, and at least one.
    pub fn new(most: [usize; SHELVES]) -> Self {
        let shelves = most.map(|most| Shelf { entries: VecDeque::new(), most: most.max(1), dropped: 0 });
        Self { shelves: Mutex::new(Shelves { shelves, next: 0, is_over: false }), filled: Condvar::new() }
    }

    pub fn push(&self, shelf: usize, entry: T) {
        let gone = self.lock().put(shelf, entry);
        self.filled.notify_one();
        // Let go after the lock is.
        drop(gone);
    }

    /// Nothing more will come.
    pub fn end(&self) {
        self.lock().is_over = true;
        self.filled.notify_all();
    }

    pub fn receive(&self, patience: Duration) -> Received<T> {
        let start = Instant::now();
        let mut shelves = self.lock();
        loop {
            if let Some(entry) = shelves.take_oldest() {
                return Received::Event(entry);
            }
            if shelves.is_over {
                return Received::Over;
            }
            let Some(left) = patience.checked_sub(start.elapsed()).filter(|left| !left.is_zero()) else {
                return Received::TimedOut;
            };
            shelves = self.filled.wait_timeout(shelves, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Entries of each shelf that nobody fetched in time.
    pub fn dropped(&self) -> [u64; SHELVES] {
        let shelves = self.lock();
        std::array::from_fn(|shelf| shelves.shelves[shelf].dropped)
    }

    fn lock(&self) -> MutexGuard<'_, Shelves<T, SHELVES>> {
        // Nothing in here panics halfway.
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The lock, if it is to be had within some microseconds.
    fn try_lock(&self) -> Option<MutexGuard<'_, Shelves<T, SHELVES>>> {
        for _ in 0..TRIES {
            match self.shelves.try_lock() {
                Ok(shelves) => return Some(shelves),
                Err(TryLockError::Poisoned(poisoned)) => return Some(poisoned.into_inner()),
                Err(TryLockError::WouldBlock) => std::hint::spin_loop(),
            }
        }
        None
    }
}

impl<T, const SHELVES: usize> Shelves<T, SHELVES> {
    /// Gives the entry that had to go.
    fn put(&mut self, shelf: usize, entry: T) -> Option<T> {
        let number = self.next;
        self.next += 1;
        let shelf = &mut self.shelves[shelf];
        let gone = if shelf.entries.len() >= shelf.most { shelf.entries.pop_front() } else { None };
        shelf.dropped += u64::from(gone.is_some());
        shelf.entries.push_back((number, entry));
        gone.map(|(_, entry)| entry)
    }

    fn take_oldest(&mut self) -> Option<T> {
        let first = |shelf: &&mut Shelf<T>| shelf.entries.front().map_or(u64::MAX, |(number, _)| *number);
        let oldest = self.shelves.iter_mut().min_by_key(first)?;
        oldest.entries.pop_front().map(|(_, entry)| entry)
    }
}

/// One end of a shelf, for a thread that must not be held up: what finds the queue locked is kept, within the shelf's
/// bound, and goes with the next entry.
pub(super) struct Feeder<T, const SHELVES: usize> {
    queue: Arc<Queue<T, SHELVES>>,
    shelf: usize,
    kept: Mutex<Kept<T>>,
}

struct Kept<T> {
    entries: VecDeque<T>,
    most: usize,
    dropped: u64,
}

impl<T, const SHELVES: usize> Feeder<T, SHELVES> {
    pub fn new(queue: &Arc<Queue<T, SHELVES>>, shelf: usize) -> Self {
        let most = queue.lock().shelves[shelf].most;
        let kept = Mutex::new(Kept { entries: VecDeque::new(), most, dropped: 0 });
        Self { queue: Arc::clone(queue), shelf, kept }
    }

    /// Puts an entry on the shelf, now or with the next one.
    pub fn push(&self, entry: T) {
        let mut kept = self.lock();
        kept.entries.push_back(entry);
        if let Some(mut shelves) = self.queue.try_lock() {
            let gone: Vec<T> = kept.entries.drain(..).filter_map(|entry| shelves.put(self.shelf, entry)).collect();
            drop(shelves);
            self.queue.filled.notify_one();
            drop(gone);
        } else if kept.entries.len() > kept.most {
            kept.entries.pop_front();
            kept.dropped += 1;
        }
    }

    /// Puts everything that was kept on the shelf, waiting for the lock if need be.
    pub fn flush(&self) {
        let entries = std::mem::take(&mut self.lock().entries);
        entries.into_iter().for_each(|entry| self.queue.push(self.shelf, entry));
    }

    /// Entries that were kept for too long.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    /// Only the feeding thread and who counts ever hold this one.
    fn lock(&self) -> MutexGuard<'_, Kept<T>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 0;
    const LOG: usize = 1;
    const OTHER: usize = 2;

    fn taken<const SHELVES: usize>(queue: &Queue<u32, SHELVES>) -> Vec<u32> {
        let next = || match queue.receive(Duration::ZERO) {
            Received::Event(entry) => Some(entry),
            _ => None,
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn order_is_kept_and_the_oldest_of_its_own_kind_goes() {
        let queue = Queue::new([3, 256, 1024]);
        queue.push(OTHER, 0);
        (1..=5).for_each(|n| queue.push(FRAMES, n));
        queue.push(LOG, 6);
        queue.push(FRAMES, 7);
        assert_eq!(taken(&queue), [0, 4, 5, 6, 7]);
        assert_eq!(queue.dropped(), [3, 0, 0]);
        (0..2000).for_each(|n| queue.push(LOG, n));
        queue.push(FRAMES, 9999);
        assert_eq!((taken(&queue).len(), queue.dropped()[LOG]), (256 + 1, 2000 - 256));
    }

    #[test]
    fn waiting_ends_with_an_entry_with_time_or_with_the_end() {
        let queue = Queue::new([3, 256, 1024]);
        assert_eq!(queue.receive(Duration::from_millis(1)), Received::TimedOut);
        std::thread::scope(|scope| {
            scope.spawn(|| queue.push(FRAMES, 5));
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Event(5));
            scope.spawn(|| queue.end());
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Over);
        });
        queue.push(OTHER, 6);
        assert_eq!(
            (queue.receive(Duration::ZERO), queue.receive(Duration::ZERO)),
            (Received::Event(6), Received::Over)
        );
    }

    #[test]
    fn a_feeder_never_waits_and_keeps_what_finds_the_queue_locked() {
        let queue = Arc::new(Queue::new([3, 3]));
        let feeders = [Feeder::new(&queue, 0), Feeder::new(&queue, 1)];
        feeders[0].push(1);
        let lock = queue.lock();
        (2..=6).for_each(|n| feeders[1].push(n));
        drop(lock);
        assert_eq!((taken(&queue), feeders[1].dropped()), (vec![1], 2));
        feeders[1].push(7);
        assert_eq!((taken(&queue), queue.dropped()), (vec![5, 6, 7], [0, 1]));
        let lock = queue.lock();
        feeders[0].push(8);
        drop(lock);
        feeders[0].flush();
        assert_eq!(taken(&queue), [8]);
    }
}
