//! Faults of the simulated board and their schedule: at seeded rates, at a given byte, or on
//! request.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// A byte is lost.
    Drop,
    /// A byte is sent twice.
    Double,
    /// A bit of a byte is flipped.
    Flip,
    /// Up to 64 bytes of noise are inserted.
    Garbage,
    /// The board hangs in the middle of a message, for 0.05 to 5 s; frames of that time are lost.
    Stall,
    /// The transport delays a message by 1 to 200 ms.
    Delay,
    /// For 1 s, bytes arrive in bursts every 30 ms, as with USB or a late reader.
    Burst,
    /// The board sends an error without a command, between two messages.
    Error,
    /// The board answers the next command with an error.
    Refuse,
    /// The samples of a frame are at the limit of the converter.
    Saturate,
    /// The sensor requests a calibration, until it is set up again.
    Calibrate,
    /// The tick counter wraps 0.2 to 2 s after the next start of streaming.
    Wrap,
    /// The tick counter jumps.
    Jump,
    /// The board is unplugged for 0.1 to 3 s; then it restarts.
    Unplug,
    /// The board restarts: it is silent for 0.3 s and loses its state.
    Reboot,
    /// The board prints its start-up banner.
    Banner,
}

impl Fault {
    /// All kinds.
    pub const ALL: [Self; 16] = [
        Self::Drop,
        Self::Double,
        Self::Flip,
        Self::Garbage,
        Self::Stall,
        Self::Delay,
        Self::Burst,
        Self::Error,
        Self::Refuse,
        Self::Saturate,
        Self::Calibrate,
        Self::Wrap,
        Self::Jump,
        Self::Unplug,
        Self::Reboot,
        Self::Banner,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Drop => "drop",
            Self::Double => "double",
            Self::Flip => "flip",
            Self::Garbage => "garbage",
            Self::Stall => "stall",
            Self::Delay => "delay",
            Self::Burst => "burst",
            Self::Error => "error",
            Self::Refuse => "refuse",
            Self::Saturate => "saturate",
            Self::Calibrate => "calibrate",
            Self::Wrap => "wrap",
            Self::Jump => "jump",
            Self::Unplug => "unplug",
            Self::Reboot => "reboot",
            Self::Banner => "banner",
        }
    }

    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.name() == name)
    }

    /// Whether the fault hits a random byte of the next message.
    pub(super) fn corrupts_bytes(self) -> bool {
        matches!(self, Self::Drop | Self::Double | Self::Flip | Self::Garbage | Self::Stall | Self::Delay)
    }
}

/// Plan of the faults to inject.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FaultPlan {
    /// Mean rate, per minute.
    pub rates_per_minute: BTreeMap<Fault, f64>,
    /// Faults at given bytes, counted from 0 over all that the board sends.
    pub at_bytes: BTreeMap<u64, Fault>,
}

/// Highest rate of one kind, per minute. Choice: one for each frame at 100 Hz, beyond which no
/// session gets a result.
pub const MAX_FAULTS_PER_MINUTE: f64 = 6000.0;

/// An invalid plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FaultPlanError {
    /// Not `kind=rate`.
    #[error("\"{0}\" is not a fault: write kind=times-a-minute, for example flip=60")]
    NoFault(String),
    /// No such kind.
    #[error("fault \"{0}\" is not known: use {list}", list = Fault::ALL.map(Fault::name).join(", "))]
    UnknownKind(String),
    /// A rate out of range.
    #[error("{0} times a minute: give 0 to {MAX_FAULTS_PER_MINUTE}")]
    Rate(f64),
}

impl FaultPlan {
    /// Parses `kind=rate,kind=rate`, with rates per minute.
    ///
    /// # Errors
    /// The text does not have this form.
    pub fn parse(text: &str) -> Result<Self, FaultPlanError> {
        let mut plan = Self::default();
        for part in text.split(',').filter(|part| !part.is_empty()) {
            let no_fault = || FaultPlanError::NoFault(part.to_owned());
            let (name, rate) = part.split_once('=').ok_or_else(no_fault)?;
            let fault = Fault::from_name(name).ok_or_else(|| FaultPlanError::UnknownKind(name.to_owned()))?;
            let rate: f64 = rate.parse().map_err(|_| no_fault())?;
            if !(0.0..=MAX_FAULTS_PER_MINUTE).contains(&rate) {
                return Err(FaultPlanError::Rate(rate));
            }
            plan.rates_per_minute.insert(fault, rate);
        }
        Ok(plan)
    }
}

/// Effects of faults that wait for their occasion.
#[derive(Debug, Clone, Default)]
pub(super) struct Effects {
    /// The next command is refused.
    pub refuses: bool,
    /// The next result is at the limit of the converter.
    pub saturates: bool,
    /// The tick counter wraps soon after the next start.
    pub wraps: bool,
    /// The sensors request a calibration, until they are set up again.
    pub asks_for_calibration: bool,
}

/// A plan in progress, faults whose occasion is still to come, and the random numbers of all
/// faults.
#[derive(Debug, Clone)]
pub(super) struct Faults {
    pub rng: ChaCha8Rng,
    /// Kind, mean pause (s) and next time (host ns).
    due: Vec<(Fault, f64, i64)>,
    at_bytes: BTreeMap<u64, Fault>,
    /// For a random byte of the next message.
    pending: Vec<Fault>,
    pub effects: Effects,
    sent_bytes: u64,
    counts: BTreeMap<Fault, u64>,
}

impl Faults {
    pub fn new(plan: FaultPlan, seed: u64, now_ns: i64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xFA17);
        let rates = plan.rates_per_minute.into_iter().filter(|(_, rate)| *rate > 0.0);
        let due = rates.map(|(fault, rate)| {
            let pause_s = 60.0 / rate;
            (fault, pause_s, now_ns.saturating_add(random_pause_ns(pause_s, &mut rng)))
        });
        let due = due.collect();
        Self {
            rng,
            due,
            at_bytes: plan.at_bytes,
            pending: Vec::new(),
            effects: Effects::default(),
            sent_bytes: 0,
            counts: BTreeMap::new(),
        }
    }

    /// When [`Self::take`] is due, host nanoseconds.
    pub fn next_ns(&self) -> i64 {
        self.due.iter().map(|(_, _, at)| *at).min().unwrap_or(i64::MAX)
    }

    /// Returns a fault that is due.
    pub fn take(&mut self, now_ns: i64) -> Option<Fault> {
        let (fault, pause_s, at_ns) = self.due.iter_mut().find(|(_, _, at)| *at <= now_ns)?;
        *at_ns = now_ns.saturating_add(random_pause_ns(*pause_s, &mut self.rng));
        Some(*fault)
    }

    /// Keeps a fault for a random byte of the next message.
    pub fn defer(&mut self, fault: Fault) {
        self.pending.push(fault);
    }

    /// Faults for the bytes of the next message, as (offset in the message, kind).
    pub fn of_message(&mut self, count: usize) -> Vec<(usize, Fault)> {
        let beyond = self.sent_bytes + count as u64;
        let later = self.at_bytes.split_off(&beyond);
        let now = std::mem::replace(&mut self.at_bytes, later);
        let mut struck: Vec<_> =
            now.into_iter().map(|(at, fault)| (at.saturating_sub(self.sent_bytes) as usize, fault)).collect();
        self.sent_bytes = beyond;
        for fault in std::mem::take(&mut self.pending) {
            struck.push((self.rng.random_range(0..count), fault));
        }
        struck
    }

    pub fn count(&mut self, fault: Fault) {
        *self.counts.entry(fault).or_default() += 1;
    }

    /// How often each kind struck.
    pub fn counts(&self) -> &BTreeMap<Fault, u64> {
        &self.counts
    }
}

/// A random duration between two in seconds, nanoseconds.
pub(super) fn random_ns(low_s: f64, high_s: f64, rng: &mut ChaCha8Rng) -> i64 {
    (rng.random_range(low_s..high_s) * 1e9) as i64
}

fn random_pause_ns(mean_s: f64, rng: &mut ChaCha8Rng) -> i64 {
    (-libm::log(1.0 - rng.random_range(0.0f64..1.0)) * mean_s * 1e9) as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_plans_are_parsed_and_rejected() {
        let plan = FaultPlan::parse("flip=60,unplug=0.5").unwrap();
        assert_eq!(plan.rates_per_minute, BTreeMap::from([(Fault::Flip, 60.0), (Fault::Unplug, 0.5)]));
        assert!(matches!(FaultPlan::parse("flip"), Err(FaultPlanError::NoFault(_))));
        assert!(matches!(FaultPlan::parse("flip=x"), Err(FaultPlanError::NoFault(_))));
        assert!(matches!(FaultPlan::parse("fly=1"), Err(FaultPlanError::UnknownKind(_))));
        assert!(matches!(FaultPlan::parse("flip=nan"), Err(FaultPlanError::Rate(_))));
        assert!(matches!(FaultPlan::parse("flip=-1"), Err(FaultPlanError::Rate(_))));
        assert!(Fault::ALL.iter().all(|fault| Fault::from_name(fault.name()) == Some(*fault)));
    }

    #[test]
    fn fault_rates_are_kept_and_seeds_repeat() {
        let times = |seed| {
            let mut faults = Faults::new(FaultPlan::parse("flip=600,stall=60").unwrap(), seed, 0);
            let mut times = Vec::new();
            while faults.next_ns() < 100_000_000_000 {
                let now_ns = faults.next_ns();
                times.push((now_ns, faults.take(now_ns).unwrap()));
            }
            times
        };
        let drawn = times(1);
        let stalls = drawn.iter().filter(|(_, fault)| *fault == Fault::Stall).count();
        assert!((900..1350).contains(&drawn.len()) && (60..140).contains(&stalls), "{} {stalls}", drawn.len());
        assert_eq!(drawn, times(1));
        assert_ne!(drawn, times(2));
    }

    #[test]
    fn faults_at_given_bytes_hit_their_message() {
        let at_bytes = BTreeMap::from([(3, Fault::Drop), (10, Fault::Flip), (25, Fault::Reboot)]);
        let mut faults = Faults::new(FaultPlan { at_bytes, ..FaultPlan::default() }, 1, 0);
        assert_eq!(faults.of_message(10), [(3, Fault::Drop)]);
        assert_eq!(faults.of_message(10), [(0, Fault::Flip)]);
        assert_eq!(faults.of_message(5), []);
        assert_eq!(faults.of_message(1), [(0, Fault::Reboot)]);
    }
}
