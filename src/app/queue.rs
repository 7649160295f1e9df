//! A bounded queue between threads that never blocks its producer for work.
//!
//! The queue has one channel per kind of message, each with its own bound, so that a flood of one
//! kind does not displace another. A full channel drops and counts its oldest message. Messages
//! come out in the order in which they went in. A [`MapperInput`] does not even wait for the lock: the
//! consumer may be a thread of lower priority that the system has preempted while it holds the
//! lock.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};

/// Attempts at the lock before the messages stay in the backlog: a few microseconds. Choice: longer
/// than the lock is held to move a message, far shorter than a sweep.
const LOCK_ATTEMPTS: usize = 64;

/// Messages dropped because nobody fetched them in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dropped {
    /// Results with their frames.
    pub frames: u64,
    /// Lines of the board's log.
    pub logs: u64,
    /// Other events.
    pub others: u64,
}

/// Result of waiting for the next message.
#[derive(Debug, Clone, PartialEq)]
pub enum Received<T> {
    /// The next message.
    Event(T),
    /// Nothing arrived in time.
    TimedOut,
    /// The queue is closed and empty.
    Closed,
}

struct Channel<T> {
    entries: VecDeque<(u64, T)>,
    most: usize,
    dropped: u64,
}

struct Channels<T, const CHANNELS: usize> {
    channels: [Channel<T>; CHANNELS],
    next: u64,
    is_over: bool,
}

/// The queue; see the module documentation.
pub(super) struct Queue<T, const CHANNELS: usize> {
    channels: Mutex<Channels<T, CHANNELS>>,
    filled: Condvar,
}

impl<T, const CHANNELS: usize> Queue<T, CHANNELS> {
    /// `most`: the bound of each channel, at least one message.
    pub fn new(most: [usize; CHANNELS]) -> Self {
        let channels = most.map(|most| Channel { entries: VecDeque::new(), most: most.max(1), dropped: 0 });
        Self { channels: Mutex::new(Channels { channels, next: 0, is_over: false }), filled: Condvar::new() }
    }

    pub fn push(&self, channel: usize, entry: T) {
        let gone = self.lock().insert(channel, entry);
        self.filled.notify_one();
        // Dropped after the lock is released.
        drop(gone);
    }

    /// Closes the queue.
    pub fn end(&self) {
        self.lock().is_over = true;
        self.filled.notify_all();
    }

    pub fn receive(&self, patience: Duration) -> Received<T> {
        let start = Instant::now();
        let mut channels = self.lock();
        loop {
            if let Some(entry) = channels.take_oldest() {
                return Received::Event(entry);
            }
            if channels.is_over {
                return Received::Closed;
            }
            let Some(left) = patience.checked_sub(start.elapsed()).filter(|left| !left.is_zero()) else {
                return Received::TimedOut;
            };
            channels = self.filled.wait_timeout(channels, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Dropped messages of each channel.
    pub fn dropped(&self) -> [u64; CHANNELS] {
        let channels = self.lock();
        std::array::from_fn(|channel| channels.channels[channel].dropped)
    }

    fn lock(&self) -> MutexGuard<'_, Channels<T, CHANNELS>> {
        // Nothing panics while the lock is held.
        self.channels.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tries to take the lock for a few microseconds.
    fn try_lock(&self) -> Option<MutexGuard<'_, Channels<T, CHANNELS>>> {
        for _ in 0..LOCK_ATTEMPTS {
            match self.channels.try_lock() {
                Ok(channels) => return Some(channels),
                Err(TryLockError::Poisoned(poisoned)) => return Some(poisoned.into_inner()),
                Err(TryLockError::WouldBlock) => std::hint::spin_loop(),
            }
        }
        None
    }
}

impl<T, const CHANNELS: usize> Channels<T, CHANNELS> {
    /// Returns the message that was dropped.
    fn insert(&mut self, channel: usize, entry: T) -> Option<T> {
        let number = self.next;
        self.next += 1;
        let channel = &mut self.channels[channel];
        let gone = if channel.entries.len() >= channel.most { channel.entries.pop_front() } else { None };
        channel.dropped += u64::from(gone.is_some());
        channel.entries.push_back((number, entry));
        gone.map(|(_, entry)| entry)
    }

    fn take_oldest(&mut self) -> Option<T> {
        let first = |channel: &&mut Channel<T>| channel.entries.front().map_or(u64::MAX, |(number, _)| *number);
        let oldest = self.channels.iter_mut().min_by_key(first)?;
        oldest.entries.pop_front().map(|(_, entry)| entry)
    }
}

/// Non-blocking input of one channel. Messages that find the queue locked stay in a backlog, within
/// the channel's bound, and are sent with the next message.
pub(super) struct MapperInput<T, const CHANNELS: usize> {
    queue: Arc<Queue<T, CHANNELS>>,
    channel: usize,
    backlog: Mutex<Backlog<T>>,
}

struct Backlog<T> {
    entries: VecDeque<T>,
    most: usize,
    dropped: u64,
}

impl<T, const CHANNELS: usize> MapperInput<T, CHANNELS> {
    pub fn new(queue: &Arc<Queue<T, CHANNELS>>, channel: usize) -> Self {
        let most = queue.lock().channels[channel].most;
        let backlog = Mutex::new(Backlog { entries: VecDeque::new(), most, dropped: 0 });
        Self { queue: Arc::clone(queue), channel, backlog }
    }

    /// Sends a message now or with the next one.
    pub fn push(&self, entry: T) {
        let mut backlog = self.lock();
        backlog.entries.push_back(entry);
        if let Some(mut channels) = self.queue.try_lock() {
            let gone: Vec<T> =
                backlog.entries.drain(..).filter_map(|entry| channels.insert(self.channel, entry)).collect();
            drop(channels);
            self.queue.filled.notify_one();
            drop(gone);
        } else if backlog.entries.len() > backlog.most {
            backlog.entries.pop_front();
            backlog.dropped += 1;
        }
    }

    /// Sends the backlog, waiting for the lock if necessary.
    pub fn flush(&self) {
        let entries = std::mem::take(&mut self.lock().entries);
        entries.into_iter().for_each(|entry| self.queue.push(self.channel, entry));
    }

    /// Messages dropped from the backlog.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    /// Only the sending thread and the reader of the counters take this lock.
    fn lock(&self) -> MutexGuard<'_, Backlog<T>> {
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 0;
    const LOG: usize = 1;
    const OTHER: usize = 2;

    fn taken<const CHANNELS: usize>(queue: &Queue<u32, CHANNELS>) -> Vec<u32> {
        let next = || match queue.receive(Duration::ZERO) {
            Received::Event(entry) => Some(entry),
            _ => None,
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn order_is_kept_and_each_channel_drops_its_oldest() {
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
    fn receive_returns_on_entry_timeout_or_close() {
        let queue = Queue::new([3, 256, 1024]);
        assert_eq!(queue.receive(Duration::from_millis(1)), Received::TimedOut);
        std::thread::scope(|scope| {
            scope.spawn(|| queue.push(FRAMES, 5));
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Event(5));
            scope.spawn(|| queue.end());
            assert_eq!(queue.receive(Duration::from_secs(60)), Received::Closed);
        });
        queue.push(OTHER, 6);
        assert_eq!(
            (queue.receive(Duration::ZERO), queue.receive(Duration::ZERO)),
            (Received::Event(6), Received::Closed)
        );
    }

    #[test]
    fn mapper_input_never_blocks_and_keeps_a_backlog() {
        let queue = Arc::new(Queue::new([3, 3]));
        let feeders = [MapperInput::new(&queue, 0), MapperInput::new(&queue, 1)];
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
