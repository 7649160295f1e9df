//! Between the reader thread and whoever uses its frames: bounded, and never a reason to wait for the one who fills it.
//!
//! Frames, the board's log and all else have a bound each, so that a flood of one costs none of another; the oldest of
//! its own kind goes. What comes out keeps the order in which it went in.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Lines of the board's log kept.
const MAX_LOGS: usize = 256;
/// Other events kept.
const MAX_OTHERS: usize = 1024;

/// What an entry is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Frames,
    Log,
    Other,
}

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

struct Shelves<T> {
    /// As in [`Kind`].
    shelves: [Shelf<T>; 3],
    next: u64,
    is_over: bool,
}

/// The queue. See the file's head.
pub(super) struct Queue<T> {
    shelves: Mutex<Shelves<T>>,
    filled: Condvar,
}

impl<T> Queue<T> {
    pub fn new(max_frames: usize) -> Self {
        let shelves =
            [max_frames.max(1), MAX_LOGS, MAX_OTHERS].map(|most| Shelf { entries: VecDeque::new(), most, dropped: 0 });
        Self { shelves: Mutex::new(Shelves { shelves, next: 0, is_over: false }), filled: Condvar::new() }
    }

    pub fn push(&self, kind: Kind, entry: T) {
        let mut shelves = self.lock();
        let number = shelves.next;
        shelves.next += 1;
        let shelf = &mut shelves.shelves[kind as usize];
        // Let go after the lock is.
        let gone = if shelf.entries.len() >= shelf.most { shelf.entries.pop_front() } else { None };
        shelf.dropped += u64::from(gone.is_some());
        shelf.entries.push_back((number, entry));
        drop(shelves);
        self.filled.notify_one();
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

    pub fn dropped(&self) -> Dropped {
        let shelves = self.lock();
        let [frames, logs, others] = [0, 1, 2].map(|kind| shelves.shelves[kind].dropped);
        Dropped { frames, logs, others }
    }

    fn lock(&self) -> MutexGuard<'_, Shelves<T>> {
        // Nothing in here panics halfway.
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> Shelves<T> {
    fn take_oldest(&mut self) -> Option<T> {
        let first = |shelf: &&mut Shelf<T>| shelf.entries.front().map_or(u64::MAX, |(number, _)| *number);
        let oldest = self.shelves.iter_mut().min_by_key(first)?;
        oldest.entries.pop_front().map(|(_, entry)| entry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(queue: &Queue<u32>) -> Vec<u32> {
        let next = || match queue.receive(Duration::ZERO) {
            Received::Event(entry) => Some(entry),
            _ => None,
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn order_is_kept_and_the_oldest_of_its_own_kind_goes() {
        let queue = Queue::new(3);
        queue.push(Kind::Other, 0);
        (1..=5).for_each(|n| queue.push(Kind::Frames, n));
        queue.push(Kind::Log, 6);
        queue.push(Kind::Frames, 7);
        assert_eq!(taken(&queue), [0, 4, 5, 6, 7]);
        assert_eq!(queue.dropped(), Dropped { frames: 3, logs: 0, others: 0 });
        (0..2000).for_each(|n| queue.push(Kind::Log, n));
        queue.push(Kind::Frames, 9999);
        assert_eq!((taken(&queue).len(), queue.dropped().logs), (MAX_LOGS + 1, 2000 - MAX_LOGS as u64));
    }

    #[test]
    fn waiting_ends_with_an_entry_with_time_or_with_the_end() {
        let queue = Queue::new(3);
        assert_eq!(queue.receive(Duration::from_millis(1)), Received::TimedOut);
        std::thread::scope(|scope| {
            scope.spawn(|| queue.push(Kind::Frames, 5));
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Event(5));
            scope.spawn(|| queue.end());
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Over);
        });
        queue.push(Kind::Other, 6);
        assert_eq!(
            (queue.receive(Duration::ZERO), queue.receive(Duration::ZERO)),
            (Received::Event(6), Received::Over)
        );
    }
}
