//! The script: scheduled commands, and the calls that it makes fail.

use std::collections::BTreeMap;

use crate::commands::{Command, TimedCommand};

/// Limit of scheduled commands. Choice: bounds memory; scripts of tests have dozens.
const MAX_SCRIPT_COMMANDS: usize = 10_000;

/// What is still to come.
pub struct Script {
    /// By falling time.
    scheduled: Vec<TimedCommand>,
    /// Number of the next calls that fail, by function.
    failures: BTreeMap<String, u32>,
}

impl Script {
    /// Of the configuration's commands.
    pub fn new(mut commands: Vec<TimedCommand>) -> Self {
        commands.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        commands.reverse();
        Self { scheduled: commands, failures: BTreeMap::new() }
    }

    /// The commands that are due, in order.
    pub fn due(&mut self, seconds: f64) -> Vec<Command> {
        let mut due = Vec::new();
        while self.scheduled.last().is_some_and(|next| next.at_s <= seconds) {
            due.extend(self.scheduled.pop().map(|next| next.command));
        }
        due
    }

    /// Schedules a command; at once if its time has passed.
    pub fn schedule(&mut self, command: TimedCommand) {
        if self.scheduled.len() >= MAX_SCRIPT_COMMANDS {
            return eprintln!(
                "fake runtime: more than {MAX_SCRIPT_COMMANDS} commands are scheduled: {command:?} is dropped"
            );
        }
        let place = self.scheduled.partition_point(|other| other.at_s > command.at_s);
        self.scheduled.insert(place, command);
    }

    /// Makes the next calls of a function fail.
    pub fn fail(&mut self, function: &str, count: u32) {
        self.failures.insert(function.to_owned(), count);
    }

    /// Whether this call fails.
    pub fn fails(&mut self, name: &str) -> bool {
        let name = name.rsplit("::").next().unwrap_or(name);
        match self.failures.get_mut(name) {
            Some(left) if *left > 0 => {
                *left -= 1;
                true
            }
            _ => false,
        }
    }
}
