//! Actions and events that the caller has not read yet. Events are bounded: the oldest is dropped.

use std::collections::VecDeque;

use super::event::{Action, Event};

/// Limit of unread events. Choice: several seconds of the fastest frames; more would be stale, and
/// take memory without bound.
pub(super) const MAX_EVENTS: usize = 4096;

/// Queues from the session to its caller.
#[derive(Default)]
pub(super) struct Outbox {
    actions: VecDeque<Action>,
    events: VecDeque<Event>,
    dropped_events: u64,
}

impl Outbox {
    pub fn act(&mut self, action: Action) {
        self.actions.push_back(action);
    }

    /// Discards the actions of a line that was lost.
    pub fn cancel_actions(&mut self) {
        self.actions.clear();
    }

    pub fn report(&mut self, event: Event) {
        if self.events.len() >= MAX_EVENTS {
            self.events.pop_front();
            self.dropped_events += 1;
        }
        self.events.push_back(event);
    }

    pub fn next_action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    pub fn dropped_events(&self) -> u64 {
        self.dropped_events
    }
}
