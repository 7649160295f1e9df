//! Runs `src/app/queue.rs` and `src/app/handover.rs`, compiled with the locks of shuttle, under schedulers that choose which thread goes on at each lock. A
//! violated claim, or threads that wait for each other for ever, ends the program with the schedule that led there.
//!
//! A wait never times out here: what only a time-out would repair is found as a deadlock.

mod sync {
    pub use shuttle::sync::atomic::{AtomicU64, Ordering};
    pub use shuttle::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
}
// Parts that the models do not need.
#[allow(dead_code)]
#[path = "../../src/app/handover.rs"]
mod handover;
#[allow(dead_code)]
#[path = "../../src/app/queue.rs"]
mod queue;

use std::time::Duration;

use handover::{Newest, NewestOfEpoch, OfEpoch};
use queue::{MapperInput, Queue, Received};
use shuttle::sync::Arc;
use shuttle::thread;

/// Schedules of each model and each scheduler. Choice: some seconds in all.
const SCHEDULES: usize = 20_000;
/// Changes of priority of the second scheduler, which finds what needs that many in the right places.
const DEPTH: usize = 3;
/// Longer than any schedule.
const FOR_EVER: Duration = Duration::from_secs(1 << 20);

/// Channels and their bounds: two inputs of the mapper, and one whose sender waits for the lock.
const BOUNDS: [usize; 3] = [2, 3, 2];
const WAITING: usize = 2;
/// Messages of each sender.
const SENT: u32 = 4;

fn received(queue: &Queue<(usize, u32), 3>) -> Vec<(usize, u32)> {
    let next = || match queue.receive(FOR_EVER) {
        Received::Event(message) => Some(message),
        Received::Closed => None,
        Received::TimedOut => panic!("nothing times out"),
    };
    std::iter::from_fn(next).collect()
}

/// Of what is sent by three threads, each message is received once and in the order of its sender, or counted as dropped.
fn every_message_is_received_or_counted() {
    let queue = Arc::new(Queue::new(BOUNDS));
    let inputs = [0, 1].map(|channel| Arc::new(MapperInput::new(&queue, channel)));
    let consumer = thread::spawn({
        let queue = Arc::clone(&queue);
        move || received(&queue)
    });
    let mut senders: Vec<_> = inputs
        .iter()
        .enumerate()
        .map(|(channel, input)| {
            let input = Arc::clone(input);
            thread::spawn(move || {
                (0..SENT).for_each(|n| input.push((channel, n)));
                input.flush();
            })
        })
        .collect();
    senders.push(thread::spawn({
        let queue = Arc::clone(&queue);
        move || (0..SENT).for_each(|n| queue.push(WAITING, (WAITING, n)))
    }));
    senders.into_iter().for_each(|sender| sender.join().unwrap());
    queue.end();
    let received = consumer.join().unwrap();
    let dropped = queue.dropped();
    for channel in 0..BOUNDS.len() {
        let of_channel: Vec<u32> = received.iter().filter(|(of, _)| *of == channel).map(|(_, n)| *n).collect();
        assert!(of_channel.is_sorted_by(|a, b| a < b), "channel {channel}: {of_channel:?}");
        assert_eq!(of_channel.last(), Some(&(SENT - 1)), "the newest message is never the one dropped");
        let in_backlog = inputs.get(channel).map_or(0, |input| input.dropped());
        let counted = of_channel.len() as u64 + dropped[channel] + in_backlog;
        assert_eq!(counted, u64::from(SENT), "channel {channel}: {of_channel:?}, dropped {dropped:?} and {in_backlog}");
    }
}

/// A consumer that waits is woken by a message alone, and the next time by the end.
fn a_waiting_consumer_is_woken() {
    let queue = Arc::new(Queue::new(BOUNDS));
    let input = MapperInput::new(&queue, 0);
    let next = || {
        let queue = Arc::clone(&queue);
        thread::spawn(move || queue.receive(FOR_EVER))
    };
    let consumer = next();
    input.push(7);
    input.flush();
    assert_eq!(consumer.join().unwrap(), Received::Event(7));
    let consumer = next();
    queue.end();
    assert_eq!(consumer.join().unwrap(), Received::Closed);
}

/// Settings: a reader takes changes in their order, and with its next look after the last change it has that.
fn no_change_of_the_settings_is_missed() {
    let settings = Arc::new(Newest::new(0));
    let maker = thread::spawn({
        let settings = Arc::clone(&settings);
        move || (1..=SENT).for_each(|n| assert_eq!(*settings.publish(Arc::new(n)), n - 1))
    });
    let (mut version, mut taken) = (1, 0);
    let mut look = || {
        if let Some(newer) = settings.newer_than(&mut version) {
            assert!(*newer >= taken, "{newer} after {taken}");
            taken = *newer;
        }
        taken
    };
    (0..SENT).for_each(|_| _ = look());
    maker.join().unwrap();
    assert_eq!(look(), SENT);
    assert_eq!(*settings.get(), SENT);
}

/// A map with a number that grows with each one.
struct Map {
    epoch: u64,
    number: u32,
}

impl OfEpoch for Map {
    fn nothing(epoch: u64) -> Self {
        Self { epoch, number: 0 }
    }

    fn epoch(&self) -> u64 {
        self.epoch
    }
}

/// Maps: after a reset no reader gets one from before it, and within an epoch none gets an older one than it had.
fn no_map_of_before_a_reset_is_given() {
    let maps = Arc::new(NewestOfEpoch::<Map>::new());
    let maker = thread::spawn({
        let maps = Arc::clone(&maps);
        // As the mapper does: the epoch is asked before a map is made.
        move || (1..=SENT).for_each(|number| maps.publish(Map { epoch: maps.epoch(), number }))
    });
    let reader = |resets: u64| {
        let maps = Arc::clone(&maps);
        thread::spawn(move || {
            let mut had = (0, 0);
            for look in 0..2 * SENT {
                let least = if look % 2 == 0 && u64::from(look / 2) < resets { maps.reset() } else { maps.epoch() };
                let map = maps.latest();
                assert!(map.epoch >= least, "a map of epoch {} in epoch {least}", map.epoch);
                assert!((map.epoch, map.number) >= had, "{}, {} after {had:?}", map.epoch, map.number);
                had = (map.epoch, map.number);
            }
        })
    };
    // The frame loop resets; the desktop's view only reads.
    let readers = [reader(2), reader(0)];
    readers.into_iter().for_each(|reader| reader.join().unwrap());
    maker.join().unwrap();
    let last = maps.latest();
    assert_eq!(last.epoch, 2);
    assert!(last.number == SENT || last.number == 0);
}

fn main() {
    let models: [(&str, fn()); 4] = [
        ("no change of the settings is missed", no_change_of_the_settings_is_missed),
        ("no map of before a reset is given", no_map_of_before_a_reset_is_given),
        ("every message is received or counted", every_message_is_received_or_counted),
        ("a waiting consumer is woken", a_waiting_consumer_is_woken),
    ];
    for (name, model) in models {
        shuttle::check_random(model, SCHEDULES);
        shuttle::check_pct(model, SCHEDULES, DEPTH);
        println!("{name}: {} schedules", 2 * SCHEDULES);
    }
}
