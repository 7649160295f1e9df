//! A file on a disk of which some places cannot be read: these read as zeros, so that a checksum, not the disk, ends what was
//! recorded there. Behind a run of bad sectors, up to as many good ones are passed over as well.

use std::fmt;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

/// What a disk reads or refuses as a whole, bytes. Source: sectors of hard disks and pages of memory have 4 KiB.
const SECTOR_BYTES: u64 = 4096;
/// Most bytes that are passed over without trying each sector. Choice: each refusal may take a disk seconds; where many sectors in a row
/// are refused, twice as much is passed over each time, up to this.
const MAX_STEP_BYTES: u64 = 1 << 20;
/// After so many refusals in a row nothing more is read. Choice: half a hundred megabytes; a network that is gone may take a minute for
/// each.
const MAX_REFUSALS: u32 = 60;

/// Where the bytes come from: a file, in tests one with bad sectors.
pub(super) trait Medium: Read + Seek + Send + fmt::Debug {}

impl<M: Read + Seek + Send + fmt::Debug> Medium for M {}

/// A file that reads to its end, whatever the disk refuses.
#[derive(Debug)]
pub(super) struct Disk {
    medium: Box<dyn Medium>,
    file_bytes: u64,
    position: u64,
    /// Places that were refused, in order and apart from each other. They are not tried again.
    refused: Vec<Range<u64>>,
    /// How much the next refusal passes over, bytes.
    step_bytes: u64,
    refusals_in_a_row: u32,
    first_refusal: Option<String>,
}

impl Disk {
    /// At the medium's beginning.
    ///
    /// # Errors
    /// Its length cannot be found.
    pub fn new(mut medium: Box<dyn Medium>) -> io::Result<Self> {
        let file_bytes = medium.seek(SeekFrom::End(0))?;
        let position = medium.seek(SeekFrom::Start(0))?;
        Ok(Self {
            medium,
            file_bytes,
            position,
            refused: Vec::new(),
            step_bytes: SECTOR_BYTES,
            refusals_in_a_row: 0,
            first_refusal: None,
        })
    }

    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// How many bytes could not be read so far.
    pub fn refused_bytes(&self) -> u64 {
        self.refused.iter().map(|place| place.end - place.start).sum()
    }

    /// Where and why the first of them could not be read.
    pub fn first_refusal(&self) -> Option<&str> {
        self.first_refusal.as_deref()
    }

    /// Notes that what begins at the position cannot be read.
    fn refuse(&mut self, error: &io::Error) {
        let start = self.position;
        let sector_end = (start / SECTOR_BYTES + 1) * SECTOR_BYTES;
        let next = self.refused.partition_point(|place| place.start < start);
        let known_from = self.refused.get(next).map_or(self.file_bytes, |place| place.start);
        self.refusals_in_a_row += 1;
        let end = match self.refusals_in_a_row {
            MAX_REFUSALS.. => known_from,
            _ => (sector_end + self.step_bytes - SECTOR_BYTES).min(known_from),
        };
        self.step_bytes = (2 * self.step_bytes).min(MAX_STEP_BYTES);
        self.first_refusal.get_or_insert_with(|| format!("the disk cannot read byte {start}: {error}"));
        match self.refused[..next].last_mut().filter(|place| place.end == start) {
            Some(before) => before.end = end,
            None => self.refused.insert(next, start..end),
        }
    }

    /// Zeros up to the end of a place that was refused.
    fn read_zeros(&mut self, into: &mut [u8], end: u64) -> io::Result<usize> {
        let count = into.len().min((end - self.position) as usize);
        into[..count].fill(0);
        self.medium.seek(SeekFrom::Start(self.position + count as u64))?;
        Ok(count)
    }

    fn read_some(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let at = self.position;
        let next = self.refused.iter().find(|place| place.end > at).cloned();
        let sound_end = match next {
            Some(place) if place.start <= at => return self.read_zeros(into, place.end),
            next => next.map_or(u64::MAX, |place| place.start),
        };
        let sector_rest = (SECTOR_BYTES - at % SECTOR_BYTES) as usize;
        let is_among_bad = self.step_bytes > SECTOR_BYTES;
        let most = if is_among_bad { into.len().min(sector_rest) } else { into.len() };
        let mut most = most.min(usize::try_from(sound_end - at).unwrap_or(usize::MAX));
        loop {
            match self.medium.read(&mut into[..most]) {
                Ok(count) => {
                    (self.step_bytes, self.refusals_in_a_row) = (SECTOR_BYTES, 0);
                    return Ok(count);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted || at >= self.file_bytes => return Err(error),
                // Some systems refuse all of a read of which one sector is bad.
                Err(_) if most > sector_rest => {
                    most = (most / 2).max(sector_rest);
                    self.medium.seek(SeekFrom::Start(at))?;
                }
                Err(error) => {
                    self.refuse(&error);
                    return self.read_some(into);
                }
            }
        }
    }
}

impl Read for Disk {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.read_some(into)?;
        self.position += count as u64;
        Ok(count)
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.position = self.medium.seek(to)?;
        Ok(self.position)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Cursor;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Bytes of which some sectors cannot be read.
    #[derive(Debug)]
    pub struct BadSectors {
        pub bytes: Cursor<Vec<u8>>,
        pub bad: Vec<u64>,
        /// Whether a read ends before a bad sector, as on Linux, or fails as a whole.
        pub ends_before: bool,
        pub refusals: Arc<AtomicU64>,
    }

    impl Seek for BadSectors {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.bytes.seek(to)
        }
    }

    impl Read for BadSectors {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            let at = self.bytes.position();
            let end = (at + into.len() as u64).min(self.bytes.get_ref().len() as u64);
            if at >= end {
                return Ok(0);
            }
            let first_bad = self.bad.iter().map(|sector| sector * SECTOR_BYTES).filter(|bad| bad + SECTOR_BYTES > at);
            match first_bad.min().filter(|bad| *bad < end) {
                Some(bad) if bad > at && self.ends_before => self.bytes.read(&mut into[..(bad - at) as usize]),
                Some(_) => {
                    self.refusals.fetch_add(1, Ordering::Relaxed);
                    Err(io::Error::other("bad sector"))
                }
                None => self.bytes.read(into),
            }
        }
    }

    pub fn bad_sectors(bytes: &[u8], bad: impl IntoIterator<Item = u64>, ends_before: bool) -> BadSectors {
        let bad = bad.into_iter().collect();
        BadSectors { bytes: Cursor::new(bytes.to_vec()), bad, ends_before, refusals: Default::default() }
    }

    #[test]
    fn what_cannot_be_read_is_zeros_and_nothing_else_is() {
        let bytes: Vec<u8> = (0..40 * SECTOR_BYTES + 99).map(|n| (n % 251 + 1) as u8).collect();
        for (bad, ends_before) in [(vec![0, 7, 9, 40], true), (vec![0, 7, 9, 40], false), (vec![], true)] {
            let mut disk = Disk::new(Box::new(bad_sectors(&bytes, bad.clone(), ends_before))).unwrap();
            for from in [0, 5, 7 * SECTOR_BYTES + 1, 39 * SECTOR_BYTES - 1] {
                disk.seek(SeekFrom::Start(from)).unwrap();
                let mut read = Vec::new();
                disk.read_to_end(&mut read).unwrap();
                assert_eq!(read.len() as u64, bytes.len() as u64 - from);
                for (n, (read, written)) in read.iter().zip(&bytes[from as usize..]).enumerate() {
                    let is_bad = bad.contains(&((from + n as u64) / SECTOR_BYTES));
                    assert_eq!(*read, if is_bad { 0 } else { *written }, "byte {n} from {from}");
                }
            }
            assert_eq!(disk.refused_bytes(), if bad.is_empty() { 0 } else { 3 * SECTOR_BYTES + 99 });
        }
    }

    #[test]
    fn a_disk_that_is_gone_is_asked_seldom_and_each_bad_sector_once() {
        let bytes = vec![1; 64 << 20];
        let gone = bad_sectors(&bytes, 10..16_384, false);
        let refusals = Arc::clone(&gone.refusals);
        let mut disk = Disk::new(Box::new(gone)).unwrap();
        for _ in 0..2 {
            disk.seek(SeekFrom::Start(0)).unwrap();
            let mut read = Vec::new();
            disk.read_to_end(&mut read).unwrap();
            assert_eq!(read.iter().filter(|byte| **byte == 1).count() as u64, 10 * SECTOR_BYTES);
        }
        let refusals = refusals.load(Ordering::Relaxed);
        assert!(refusals < 80, "{refusals}");
        assert!(disk.first_refusal().unwrap().contains("byte 40960: bad sector"));
    }
}
