//! The file of a recording as a sequence of top-level records, of which some places may be damaged.

use std::io::{self, BufReader, Seek, SeekFrom};

use super::chunk::MAX_RECORD_BYTES;
use super::damaged_places::{CHUNK_START_BYTES, ChunkSearch, find_metadata, read_at, read_up_to};
use super::disk::Disk;
use super::header::{HEADER_RECORD, Header, TRUTH_RECORD};
use super::reader::Content;
use super::record::{Fields, metadata, op};
use radar_sar::truth::Truth;

/// How many times the file's bytes may be read again in search of whole chunks. Choice: a damaged file needs less than one;
/// bounds the time that a hostile one takes.
const REREADS: u64 = 4;
/// Content of the record that ends a file: two places and a checksum, bytes (MCAP specification, "Footer").
pub(super) const FOOTER_BYTES: usize = 8 + 8 + CHECKSUM_BYTES;
pub(super) const CHECKSUM_BYTES: usize = 4;

/// The file as a sequence of top-level records.
#[derive(Debug)]
pub(super) struct RecordSource {
    input: BufReader<Disk>,
    pub offset: u64,
    /// Offset of the last record, bytes.
    pub record_start: u64,
    /// End of the last whole chunk.
    pub sound_until: u64,
    /// Over all bytes so far, or since the end of the data; `None` once some were passed over.
    checksum: Option<crc32fast::Hasher>,
    search: ChunkSearch,
    /// Bytes that may still be read in search of whole chunks.
    reread_bytes: u64,
    /// From here on there is no whole chunk.
    barren_from: u64,
}

#[derive(Debug)]
pub(super) enum FetchedRecord {
    Record(u8, Vec<u8>),
    /// The file ends inside a record.
    Cut,
    /// The file ends between records.
    End,
    Broken(String),
}

/// What is behind the last record of a file.
#[derive(Debug)]
pub(super) enum FileEnd {
    /// The end that every file has, and nothing more.
    Proper,
    /// That end, and from this byte on the beginning of another file.
    Another(u64),
    /// Anything else, or the file ends before.
    Wrong,
}

impl RecordSource {
    /// Behind the first bytes of the file, and these bytes.
    ///
    /// # Errors
    /// The system cannot read on.
    pub fn new(disk: Disk) -> io::Result<(Self, Vec<u8>)> {
        let reread_bytes = disk.file_bytes().saturating_mul(REREADS);
        let mut input = BufReader::new(disk);
        let start = read_up_to(&mut input, mcap::MAGIC.len() as u64)?;
        let mut checksum = crc32fast::Hasher::new();
        checksum.update(&start);
        let source = Self {
            input,
            offset: 8,
            record_start: 8,
            sound_until: 8,
            checksum: Some(checksum),
            search: ChunkSearch::default(),
            reread_bytes,
            barren_from: u64::MAX,
        };
        Ok((source, start))
    }

    pub fn disk(&self) -> &Disk {
        self.input.get_ref()
    }

    /// Reads on where it was, after a search.
    pub fn go_to_unchanged(&mut self) {
        // A place that cannot be reached gives an error when it is read.
        let _ = self.input.seek(SeekFrom::Start(self.offset));
    }

    /// Reads on from there.
    pub fn go_to(&mut self, offset: u64) {
        (self.offset, self.checksum) = (offset, None);
        self.go_to_unchanged();
    }

    /// Whether the bytes so far, or since this was last asked, differ from the checksum that is stated for them; 0: none is.
    pub fn checksum_differs(&mut self, stated: Option<u32>) -> bool {
        let counted = self.checksum.replace(crc32fast::Hasher::new());
        let found = counted.map(crc32fast::Hasher::finalize);
        stated.filter(|stated| *stated != 0).zip(found).is_some_and(|(stated, found)| stated != found)
    }

    /// What follows the last record.
    pub fn file_end(&mut self) -> FileEnd {
        let magic = mcap::MAGIC;
        match read_up_to(&mut self.input, 2 * magic.len() as u64) {
            Ok(end) if end == magic => FileEnd::Proper,
            Ok(end) if end == [magic, magic].concat() => FileEnd::Another(self.offset + magic.len() as u64),
            _ => FileEnd::Wrong,
        }
    }

    /// A header, with its truth, wherever it is whole.
    pub fn find_header(&mut self) -> io::Result<Option<Header>> {
        let fields = |record: &[u8]| metadata(record).map(|(_, fields)| fields);
        let header = |record: &[u8]| Header::from_fields(&fields(record)?).ok();
        let Some(header) = find_metadata(&mut self.input, HEADER_RECORD, header)? else { return Ok(None) };
        Ok(Some(Header { truth: self.find_truth()?, ..header }))
    }

    pub fn find_truth(&mut self) -> io::Result<Option<Truth>> {
        let fields = |record: &[u8]| metadata(record).map(|(_, fields)| fields);
        let truth = |record: &[u8]| Header::truth_from_fields(&fields(record)?).ok();
        find_metadata(&mut self.input, TRUTH_RECORD, truth)
    }

    /// Takes the first whole chunk from `from` on; its beginning and end. Chunks that are not whole are counted.
    pub fn whole_chunk(
        &mut self,
        from: u64,
        failed: Option<u64>,
        content: &mut Content,
    ) -> io::Result<Option<(u64, u64)>> {
        let search_from = from.saturating_sub(CHUNK_START_BYTES).max(self.sound_until);
        let mut next = search_from;
        while next < self.barren_from
            && let Some(place) = self.search.next(&mut self.input, next)?
        {
            for length in place.lengths.into_iter().flatten() {
                let (begin, is_failed) = (place.start + 9, place.start == from && failed == Some(length));
                if is_failed || length > self.reread_bytes || begin + length > self.disk().file_bytes() {
                    continue;
                }
                self.reread_bytes -= length;
                let record = read_at(&mut self.input, begin, length)?;
                let before = content.state();
                if content.take_chunk(&record).is_ok() {
                    return Ok(Some((place.start, begin + length)));
                }
                content.go_back(before);
            }
            if place.start != from && place.is_likely {
                content.damage.chunk(format!("the chunk at byte {} cannot be read", place.start));
            }
            next = place.start + 1;
        }
        self.barren_from = self.barren_from.min(search_from);
        Ok(None)
    }

    pub fn fetch(&mut self) -> FetchedRecord {
        self.try_fetch().unwrap_or_else(|error| FetchedRecord::Broken(format!("the system cannot read on: {error}")))
    }

    fn try_fetch(&mut self) -> io::Result<FetchedRecord> {
        self.record_start = self.offset;
        let head = read_up_to(&mut self.input, 9)?;
        self.offset += head.len() as u64;
        let mut fields = Fields(&head);
        let (opcode, length) = match (fields.array(), fields.u64()) {
            (Some([opcode]), Some(length)) => (opcode, length),
            (None, _) => return Ok(FetchedRecord::End),
            (Some(_), None) => return Ok(FetchedRecord::Cut),
        };
        // One checksum is over what comes before the end of the data, one over what follows up to itself, in the footer.
        let counted_bytes = match (opcode, length) {
            (op::DATA_END, length) if length == CHECKSUM_BYTES as u64 => 0,
            (op::FOOTER, length) if length == FOOTER_BYTES as u64 => head.len() + FOOTER_BYTES - CHECKSUM_BYTES,
            _ => usize::MAX,
        };
        self.count(&head[..head.len().min(counted_bytes)]);
        if opcode == op::INVALID {
            return Ok(FetchedRecord::Broken("there are zeros where a record should begin".into()));
        }
        if length > MAX_RECORD_BYTES as u64 {
            let reason = format!("a record claims {length} bytes, more than the {MAX_RECORD_BYTES} allowed");
            return Ok(FetchedRecord::Broken(reason));
        }
        let record = read_up_to(&mut self.input, length)?;
        self.offset += record.len() as u64;
        self.count(&record[..record.len().min(counted_bytes.saturating_sub(head.len()))]);
        Ok(match record.len() as u64 == length {
            true => FetchedRecord::Record(opcode, record),
            false => FetchedRecord::Cut,
        })
    }

    fn count(&mut self, bytes: &[u8]) {
        if let Some(checksum) = &mut self.checksum {
            checksum.update(bytes);
        }
    }
}
