//! A message on its way out, and what faults do to it.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::Fault;
use super::faults::random_ns;

/// A message with its faults.
pub(super) struct Outgoing {
    pub bytes: Vec<u8>,
    /// Where a fault interrupts the message.
    pub cut_at: Option<usize>,
    /// How long the board hangs there, nanoseconds.
    pub stall_ns: i64,
    /// How long the transport holds back what follows, nanoseconds.
    pub hold_ns: i64,
    /// Fault that ends the board's work there.
    pub ends_with: Option<Fault>,
}

impl Outgoing {
    pub fn new(bytes: Vec<u8>) -> Self {
        Self { bytes, cut_at: None, stall_ns: 0, hold_ns: 0, ends_with: None }
    }

    /// Applies a fault at an offset in the undamaged message; faults that do not touch the message
    /// have no effect.
    pub fn strike(&mut self, fault: Fault, at: usize, rng: &mut ChaCha8Rng) {
        // Earlier faults may have removed bytes.
        let at = at.min(self.bytes.len() - 1);
        match fault {
            Fault::Drop => drop(self.bytes.remove(at)),
            Fault::Double => self.bytes.insert(at, self.bytes[at]),
            Fault::Flip => self.bytes[at] ^= 1 << rng.random_range(0..8),
            Fault::Garbage => {
                let count = rng.random_range(1..=64);
                let noise: Vec<u8> = (0..count).map(|_| rng.random::<u8>()).collect();
                drop(self.bytes.splice(at..at, noise));
            }
            Fault::Stall => (self.cut_at, self.stall_ns) = (Some(at), random_ns(0.05, 5.0, rng)),
            Fault::Delay => (self.cut_at, self.hold_ns) = (Some(at), random_ns(1e-3, 0.2, rng)),
            Fault::Unplug | Fault::Reboot => (self.cut_at, self.ends_with) = (Some(at), Some(fault)),
            _ => {}
        }
    }
}
