//! Whether the server is running: it holds a lock on a file until its process ends.

use std::fs::{File, TryLockError};
use std::path::Path;

/// How long an answer is cached, nanoseconds. Choice: less than a frame, so that a killed server is
/// noticed in the next; each call would otherwise ask the system.
const ALIVE_CACHE_NS: i64 = 5_000_000;

/// The server as seen by a client.
#[derive(Debug)]
pub struct Server {
    lock: File,
    asked_ns: i64,
    alive: bool,
}

impl Server {
    /// The server with this lock file, running or not; `None` if there never was one.
    pub fn find(lock: &Path, now_ns: i64) -> Option<Self> {
        let mut server = Self { lock: File::open(lock).ok()?, asked_ns: i64::MIN / 2, alive: true };
        server.alive(now_ns);
        Some(server)
    }

    /// Whether it is running. After it has ended the answer stays false: another server does not
    /// know this client.
    pub fn alive(&mut self, now_ns: i64) -> bool {
        if self.alive && now_ns - self.asked_ns > ALIVE_CACHE_NS {
            self.asked_ns = now_ns;
            self.alive = matches!(self.lock.try_lock_shared(), Err(TryLockError::WouldBlock));
            if !self.alive {
                // The lock was free and is held now; release it for a new server.
                let _ = self.lock.unlock();
            }
        }
        self.alive
    }
}
