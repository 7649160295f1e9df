//! Passes a growing file to the disk on a thread of its own: a disk may take a second, and a stream does not wait.

use std::fs::OpenOptions;
use std::io;
use std::path::Path;
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
    /// For a file that is written elsewhere. It is opened once more: Windows lets a handle do one thing at a time, and Linux
    /// reports a failed write to each.
    pub fn of(path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().write(true).open(path)?;
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
        self.failed()
    }

    /// Waits until what was requested is done.
    ///
    /// # Errors
    /// A request failed.
    pub fn finish(mut self) -> io::Result<()> {
        self.end();
        self.failed()
    }

    fn failed(&self) -> io::Result<()> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }

    fn end(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            // A panic was reported on its thread.
            let _ = thread.join();
        }
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// Counts what is done; the first time, `first` decides.
    fn counted(first: fn() -> io::Result<()>) -> (DiskSync, Arc<AtomicU32>) {
        let done = Arc::new(AtomicU32::new(0));
        let count = Arc::clone(&done);
        let sync = move || if count.fetch_add(1, Ordering::Relaxed) == 0 { first() } else { Ok(()) };
        (DiskSync::start(sync).unwrap(), done)
    }

    #[test]
    fn what_was_requested_is_done_before_the_end() {
        let (sync, done) = counted(|| Ok(()));
        sync.request().unwrap();
        sync.finish().unwrap();
        assert_eq!(done.load(Ordering::Relaxed), 1);
    }

    #[test]
    fn failure_is_reported_once_at_the_latest_at_the_end() {
        let (sync, _) = counted(|| Err(io::Error::other("the disk is gone")));
        let requested = sync.request();
        let finished = sync.finish();
        let reported = [requested, finished].into_iter().filter(Result::is_err).count();
        assert_eq!(reported, 1);
    }
}
