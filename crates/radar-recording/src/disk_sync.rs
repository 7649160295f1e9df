//! Passes a growing file to the disk on a thread of its own: a disk may take a second, and a stream does not wait.

use std::fs::File;
use std::io;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// The thread, and what went wrong on it.
#[derive(Debug)]
pub(super) struct DiskSync {
    requests: Option<SyncSender<()>>,
    failure: Arc<Mutex<Option<io::Error>>>,
    thread: Option<JoinHandle<()>>,
}

impl DiskSync {
    /// For a file that is written elsewhere.
    pub fn of(file: &File) -> io::Result<Self> {
        let file = file.try_clone()?;
        Self::start(move || file.sync_data())
    }

    fn start(sync: impl Fn() -> io::Result<()> + Send + 'static) -> io::Result<Self> {
        // One request waits while another is served: it covers all that was written before it is served.
        let (requests, served) = sync_channel(1);
        let failure = Arc::new(Mutex::new(None));
        let failed = Arc::clone(&failure);
        let serve = move || {
            for () in served {
                if let Err(error) = sync() {
                    failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                }
            }
        };
        let thread = Builder::new().name("recording sync".into()).spawn(serve)?;
        Ok(Self { requests: Some(requests), failure, thread: Some(thread) })
    }

    /// Requests that what has been written so far is passed to the disk.
    ///
    /// # Errors
    /// An earlier request failed.
    pub fn request(&self) -> io::Result<()> {
        if let Some(requests) = &self.requests {
            // One that waits already is enough.
            let _ = requests.try_send(());
        }
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            // A panic was reported on its thread.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn what_was_requested_is_done_before_the_end_and_failures_are_reported() {
        let done = Arc::new(AtomicU32::new(0));
        let count = Arc::clone(&done);
        let sync = DiskSync::start(move || match count.fetch_add(1, Ordering::Relaxed) {
            0 => Err(io::Error::other("the disk is gone")),
            _ => Ok(()),
        })
        .unwrap();
        let failed = std::iter::repeat_with(|| sync.request()).find(Result::is_err).unwrap();
        assert!(failed.unwrap_err().to_string().contains("gone"));
        let before = done.load(Ordering::Relaxed);
        sync.request().unwrap();
        drop(sync);
        assert!(done.load(Ordering::Relaxed) > before || before > 1);
    }
}
