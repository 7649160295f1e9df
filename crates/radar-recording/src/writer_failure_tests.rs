//! Tests of a disk that fails at any write.

use std::io::{Seek, SeekFrom, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use super::super::Recording;
use super::super::test_files::{TestFile, events, header};
use super::*;

/// What happens at a write.
#[derive(Debug, Clone, Copy)]
enum Fault {
    /// Half of it still fits; later writes do not.
    Full,
    /// It is refused; later ones are not.
    Refused,
    /// Half of it is written, and it is reported as failed; later ones succeed.
    Torn,
}

struct FailingDisk {
    file: File,
    writes: Arc<AtomicU32>,
    fails_at: u32,
    fault: Fault,
}

impl Write for FailingDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let write = self.writes.fetch_add(1, Ordering::Relaxed);
        let (is_first, half) = (write == self.fails_at, &bytes[..bytes.len() / 2]);
        match self.fault {
            Fault::Full if is_first && !half.is_empty() => self.file.write(half),
            Fault::Full if write >= self.fails_at => Err(io::ErrorKind::StorageFull.into()),
            Fault::Refused if is_first => Err(io::Error::other("the device is gone")),
            Fault::Torn if is_first => {
                self.file.write_all(half)?;
                Err(io::Error::other("the device is gone"))
            }
            _ => self.file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for FailingDisk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Storage for FailingDisk {
    fn sync_all(&self) -> io::Result<()> {
        self.file.sync_all()
    }
}

/// Records until the disk fails, in `file` or beside it; how many events were passed to the system before, and whether all
/// went well. Flushes as the recorder does.
fn record(file: &TestFile, is_live: bool, disk: impl Fn(File) -> FailingDisk, events: &[Event]) -> (usize, bool) {
    let (place, handle) = match is_live {
        true => {
            let (live, handle) = LiveFile::create(&file.0).unwrap();
            (Place::Live(live, DiskSync::of(&file.0).unwrap()), handle)
        }
        false => {
            let (whole, handle) = WholeFile::create(&file.0, Readers::Usual, Existing::Keep).unwrap();
            (Place::Beside(whole), handle)
        }
    };
    let Ok(mut writer) = RecordingWriter::start(&file.0, place, Box::new(disk(handle)), &header()) else {
        return (0, false);
    };
    let mut flushed = 0;
    for (n, event) in events.iter().enumerate() {
        if writer.write(event).is_err() {
            return (flushed, false);
        }
        if n % 30 == 29 {
            if writer.flush().is_err() {
                return (flushed, false);
            }
            flushed = n + 1;
        }
    }
    (flushed, writer.finish().is_ok())
}

#[test]
fn a_disk_that_fails_at_any_write_costs_nothing_that_was_passed_to_it() {
    let written = events(20);
    let texts: Vec<String> = written.iter().map(|event| format!("{event:?}")).collect();
    let writes = Arc::new(AtomicU32::new(0));
    let disk = |fails_at, fault| {
        let writes = Arc::clone(&writes);
        writes.store(0, Ordering::Relaxed);
        move |file| FailingDisk { file, writes: Arc::clone(&writes), fails_at, fault }
    };
    let whole = TestFile::new();
    assert!(record(&whole, true, disk(u32::MAX, Fault::Full), &written).1);
    let count = writes.load(Ordering::Relaxed);
    assert!(count > 20, "{count} writes");
    for fault in [Fault::Full, Fault::Refused, Fault::Torn] {
        for fails_at in 0..count {
            let place = format!("{fault:?} at write {fails_at} of {count}");
            let file = TestFile::new();
            let (flushed, went_well) = record(&file, true, disk(fails_at, fault), &written);
            assert!(!went_well, "{place}: unnoticed");
            match Recording::open(&file.0) {
                Ok(recording) => {
                    let found: Vec<String> = recording.map(|event| format!("{event:?}")).collect();
                    assert!(found.len() >= flushed, "{place}: {} of {flushed}", found.len());
                    assert!(texts.starts_with(&found), "{place}: not what was written");
                }
                Err(error) => assert_eq!(flushed, 0, "{place}: {error}"),
            }
            let beside = TestFile::new();
            assert!(!record(&beside, false, disk(fails_at, fault), &written).1, "{place}: unnoticed");
            assert!(!beside.0.exists(), "{place}: half a file appeared");
        }
    }
}
