//! Serves a simulated board in real time, on one thread that sleeps until something is due.

use super::endpoint::{Endpoint, EndpointEvent};
use super::{Device, FIRST_BAUD, Output, ServeAddress, ServeError};
use crate::platform::{monotonic_ns, wait};

/// Buffer of a port for a late reader, bytes; a pseudo-terminal itself holds 12 kB. Choice: 0.3 s
/// of preset d16; a later reader makes the board delay frames.
const PORT_BYTES: usize = 64 << 10;
/// Longest step, nanoseconds. Choice: a caller that is asked to end is not noticeably late.
const MAX_STEP_NS: i64 = 500_000_000;
/// Start of the first command of every session.
const FIRST_COMMAND: &[u8] = b"{\"cmd\":\"get_system_info\"";

/// A board served at an address.
pub struct Server {
    place: ServeAddress,
    device: Device,
    endpoint: Option<Endpoint>,
    /// Bytes that the client has not accepted yet.
    unsent: Vec<u8>,
    clients: u64,
}

impl Server {
    /// Opens the address.
    ///
    /// # Errors
    /// The address cannot be opened.
    pub fn open(place: ServeAddress, device: Device) -> Result<Self, ServeError> {
        let endpoint = Some(place.open()?);
        Ok(Self { place, device, endpoint, unsent: Vec::new(), clients: 0 })
    }

    /// The board.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Number of connections so far.
    pub fn clients(&self) -> u64 {
        self.clients
    }

    /// Performs one step: serves until a host time, or until an event that may change what is due.
    ///
    /// # Errors
    /// The system fails, or the address cannot be opened again after unplugging.
    pub fn step(&mut self, until_ns: i64) -> Result<(), ServeError> {
        let mut out = Vec::new();
        self.device.poll(monotonic_ns(), &mut out);
        for output in out {
            match output {
                Output::Bytes { bytes, baud } => self.send(bytes, baud),
                Output::Unplugged => {
                    self.endpoint = None;
                    self.unsent.clear();
                }
                Output::Plugged => self.endpoint = Some(self.place.open()?),
            }
        }
        self.flush();
        let due_ns = self.device.next_ns().min(until_ns);
        let timeout_ns = due_ns.saturating_sub(monotonic_ns()).min(MAX_STEP_NS);
        let mut heard = Vec::new();
        let waited = match &mut self.endpoint {
            Some(endpoint) => endpoint.wait(timeout_ns, !self.unsent.is_empty(), &mut heard),
            None => wait(&mut [], timeout_ns),
        };
        waited.map_err(|source| ServeError::Io { place: self.place.port(), source })?;
        heard.into_iter().for_each(|heard| self.handle_event(heard));
        Ok(())
    }

    fn send(&mut self, bytes: Vec<u8>, baud: Option<u32>) {
        let Some(endpoint) = self.endpoint.as_ref().filter(|endpoint| endpoint.is_open()) else { return };
        let host_baud = baud.and_then(|_| endpoint.baud());
        match (baud, host_baud) {
            (Some(baud), Some(host)) if host != baud => {
                if host == FIRST_BAUD {
                    self.device.receive_break();
                }
                self.unsent.extend(noise(&bytes));
            }
            _ => self.unsent.extend(bytes),
        }
    }

    fn flush(&mut self) {
        if let Some(endpoint) = self.endpoint.as_mut().filter(|_| !self.unsent.is_empty()) {
            let taken = endpoint.write(&self.unsent);
            self.unsent.drain(..taken);
        }
        self.device.set_blocked(self.unsent.len() > PORT_BYTES, monotonic_ns());
    }

    fn handle_event(&mut self, heard: EndpointEvent) {
        match heard {
            EndpointEvent::Connected(came) => {
                self.clients += u64::from(came);
                self.unsent.clear();
                self.device.receive_break();
            }
            EndpointEvent::Bytes(bytes) => {
                let host_baud = self.endpoint.as_ref().and_then(Endpoint::baud);
                let is_pty = host_baud.is_some();
                let board_baud = self.device.baud().filter(|_| is_pty);
                let differs = board_baud.is_some() && board_baud != host_baud;
                if (differs && host_baud == Some(FIRST_BAUD))
                    || (is_pty && self.device.is_streaming() && bytes.starts_with(FIRST_COMMAND))
                {
                    self.device.receive_break();
                } else if differs {
                    return self.device.receive(&noise(&bytes), monotonic_ns());
                }
                self.device.receive(&bytes, monotonic_ns());
            }
        }
    }
}

/// What bytes look like at a wrong baud rate.
fn noise(bytes: &[u8]) -> Vec<u8> {
    bytes.iter().map(|byte| byte.rotate_left(3) ^ 0xA5).collect()
}
