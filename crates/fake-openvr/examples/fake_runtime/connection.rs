//! The client's connection, from Init to Cleanup.

use std::fs::File;

use crate::housekeeper;
use crate::paths::Paths;

/// A client that has called Init.
pub struct Connection {
    running: bool,
    /// Held, shared, while the client is connected.
    clients_lock: File,
    housekeeper: Option<housekeeper::Handle>,
}

impl Connection {
    /// Connects.
    ///
    /// # Errors
    /// The file of the clients cannot be locked.
    pub fn open(paths: &Paths) -> std::io::Result<Self> {
        let clients_lock = File::options().create(true).truncate(false).write(true).open(paths.clients_lock())?;
        clients_lock.lock_shared()?;
        Ok(Self { running: true, clients_lock, housekeeper: None })
    }

    /// Whether the client has not called Cleanup.
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// Starts the housekeeper.
    pub fn start_housekeeper(&mut self, paths: Paths) {
        self.housekeeper = Some(housekeeper::start(paths));
    }

    /// Begins Cleanup; returns the housekeeper, which is still at work.
    pub fn begin_cleanup(&mut self) -> Option<housekeeper::Handle> {
        self.running = false;
        self.housekeeper.take()
    }

    /// Ends Cleanup: others see that the client is gone.
    pub fn release(&self) {
        let _ = self.clients_lock.unlock();
    }
}
