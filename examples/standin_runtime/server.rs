//! Whether the server lives: it holds a lock on a file for as long as it does, however it ends.

use std::fs::{File, TryLockError};
use std::path::Path;

/// How long an answer is believed.
const ALIVE_CACHE_NS: i64 = 5_000_000;

/// The server as a client sees it.
#[derive(Debug)]
pub struct Server {
    lock: File,
    asked_ns: i64,
    alive: bool,
}

impl Server {
    /// The server whose lock is that file, alive or dead; `None` where there never was one.
    pub fn find(lock: &Path, now_ns: i64) -> Option<Self> {
        let mut server = Self { lock: File::open(lock).ok()?, asked_ns: i64::MIN / 2, alive: true };
        server.alive(now_ns);
        Some(server)
    }

    /// Whether it lives. Once dead it stays so: another server knows nothing of this client.
    pub fn alive(&mut self, now_ns: i64) -> bool {
        if self.alive && now_ns - self.asked_ns > ALIVE_CACHE_NS {
            self.asked_ns = now_ns;
            self.alive = matches!(self.lock.try_lock_shared(), Err(TryLockError::WouldBlock));
            if !self.alive {
                // The lock was free and is ours now; a new server wants it.
                let _ = self.lock.unlock();
            }
        }
        self.alive
    }
}
