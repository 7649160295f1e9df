//! Runs `src/app/queue.rs`, compiled with the locks of shuttle, under schedulers that choose which thread goes on at each lock. A
//! violated claim, or threads that wait for each other for ever, ends the program with the schedule that led there.
//!
//! A wait never times out here: what only a time-out would repair is found as a deadlock.

mod sync {
    pub use shuttle::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
}
// Parts that the models do not need.
#[allow(dead_code)]
#[path = "../../src/app/queue.rs"]
mod queue;

use std::time::Duration;

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

fn main() {
    let models: [(&str, fn()); 2] = [
        ("every message is received or counted", every_message_is_received_or_counted),
        ("a waiting consumer is woken", a_waiting_consumer_is_woken),
    ];
    for (name, model) in models {
        shuttle::check_random(model, SCHEDULES);
        shuttle::check_pct(model, SCHEDULES, DEPTH);
        println!("{name}: {} schedules", 2 * SCHEDULES);
    }
}
