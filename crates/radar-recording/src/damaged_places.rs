//! Finds what is whole behind damage: chunks and copies of the header, by what their first bytes always are.

use std::io::{self, Read, Seek, SeekFrom};

use super::chunk::MAX_RECORD_BYTES;
use super::record::{Fields, op};

/// In the head of a chunk: length and name of its compression.
const ZSTD: &[u8] = b"\x04\0\0\0zstd";
/// Bytes from a chunk record's opcode to that: opcode, length, two times, unpacked size, checksum.
const BYTES_BEFORE_ZSTD: usize = 1 + 8 + 8 + 8 + 8 + 4;
/// Bytes of a chunk record up to the end of that, and up to its packed records.
pub(super) const CHUNK_START_BYTES: u64 = (BYTES_BEFORE_ZSTD + ZSTD.len()) as u64;
const HEAD_BYTES: usize = BYTES_BEFORE_ZSTD + ZSTD.len() + 8;
/// Bytes of a record before its content: opcode and length.
const RECORD_HEAD_BYTES: usize = 9;
/// Bytes that are searched at a time. Choice: what a disk reads at once.
const WINDOW_BYTES: usize = 1 << 16;
/// At most so much memory is reserved for what a file claims, bytes. Choice: a chunk as it is written is little longer when unpacked.
const RESERVED_BYTES: u64 = 1 << 20;
/// Longest header or truth, and what all places that may hold one may have together, bytes. Choice: many times what they have.
pub(super) const MAX_HEADER_BYTES: u64 = 4 << 20;
const MAX_HEADERS_BYTES: u64 = 4 * MAX_HEADER_BYTES;

/// A place where a chunk record may begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChunkPlace {
    /// Offset of its opcode.
    pub start: u64,
    /// Whether its opcode or length is a chunk's as well; both may be damaged.
    pub is_likely: bool,
    /// Lengths that its content may have: by that of its packed records, and by its own length field where that differs.
    pub lengths: [Option<u64>; 2],
}

/// Searches a file for chunks; keeps what it has read.
#[derive(Debug, Default)]
pub(super) struct ChunkSearch {
    window_at: u64,
    window: Vec<u8>,
}

impl ChunkSearch {
    /// The next place from `from` on whose bytes are those of a chunk's head.
    pub fn next(&mut self, input: &mut (impl Read + Seek), from: u64) -> io::Result<Option<ChunkPlace>> {
        let mut from = from;
        loop {
            let end = self.window_at + self.window.len() as u64;
            if from < self.window_at || from + HEAD_BYTES as u64 > end {
                (self.window, self.window_at) = (read_at(input, from, WINDOW_BYTES as u64)?, from);
                if self.window.len() < HEAD_BYTES {
                    return Ok(None);
                }
            }
            let begin = (from - self.window_at) as usize;
            let heads = self.window[begin..].windows(HEAD_BYTES).enumerate();
            let mut heads = heads.filter(|(_, head)| head[BYTES_BEFORE_ZSTD..].starts_with(ZSTD));
            if let Some(place) = heads.find_map(|(n, head)| chunk_place(from + n as u64, head)) {
                return Ok(Some(place));
            }
            from = self.window_at + (self.window.len() - HEAD_BYTES + 1) as u64;
        }
    }
}

fn chunk_place(start: u64, head: &[u8]) -> Option<ChunkPlace> {
    let mut fields = Fields(head);
    let ([opcode], length) = (fields.array()?, fields.u64()?);
    fields.bytes(HEAD_BYTES - RECORD_HEAD_BYTES - 8)?;
    let by_packed = fields.u64()?.saturating_add((HEAD_BYTES - RECORD_HEAD_BYTES) as u64);
    let is_possible = |length: &u64| *length <= MAX_RECORD_BYTES as u64;
    let own = Some(length).filter(|own| is_possible(own) && *own != by_packed);
    let is_likely = opcode == op::CHUNK || length == by_packed;
    let lengths = [Some(by_packed).filter(is_possible), own.filter(|_| is_likely)];
    lengths.iter().any(Option::is_some).then_some(ChunkPlace { start, is_likely, lengths })
}

/// Whether a record that is no chunk holds the head of one: then its length is wrong.
pub(super) fn holds_chunk(record: &[u8]) -> bool {
    record.windows(ZSTD.len()).any(|bytes| bytes == ZSTD)
}

/// Whether a record is the index of one chunk and nothing more. It names the chunk's compression, as a chunk's head does.
pub(super) fn is_chunk_index(record: &[u8]) -> bool {
    let mut fields = Fields(record);
    let mut is_whole = || {
        let (_times_and_place, offsets) = (fields.bytes(4 * 8)?, fields.sized()?);
        let (_offsets_bytes, _compression, _sizes) = (fields.u64()?, fields.text()?, fields.bytes(2 * 8)?);
        Some(!holds_chunk(offsets))
    };
    is_whole() == Some(true) && fields.0.is_empty()
}

/// Whether a chunk's content is not as long as its packed records say, or holds the head of another chunk.
pub(super) fn has_wrong_length(chunk: &[u8]) -> bool {
    let head_bytes = HEAD_BYTES - RECORD_HEAD_BYTES;
    let packed_bytes = chunk.get(head_bytes - 8..).and_then(|bytes| Fields(bytes).u64());
    packed_bytes.is_none_or(|packed| packed.saturating_add(head_bytes as u64) != chunk.len() as u64)
        || holds_chunk(&chunk[head_bytes - 8..])
}

/// What `read` gives for the first metadata record with this name for which it gives something, wherever in the file that is.
pub(super) fn find_metadata<T>(
    input: &mut (impl Read + Seek),
    name: &str,
    read: impl Fn(&[u8]) -> Option<T>,
) -> io::Result<Option<T>> {
    let pattern = [&(name.len() as u32).to_le_bytes(), name.as_bytes()].concat();
    let (mut window_at, mut bytes_left) = (0, MAX_HEADERS_BYTES);
    loop {
        let window = read_at(input, window_at, WINDOW_BYTES as u64)?;
        // A record begins with its opcode and length.
        let places = window.windows(pattern.len()).enumerate().skip(RECORD_HEAD_BYTES).filter(|(_, at)| *at == pattern);
        for (at, _) in places {
            let length = Fields(&window[at - 8..]).u64().filter(|length| *length <= bytes_left.min(MAX_HEADER_BYTES));
            let Some(length) = length else { continue };
            bytes_left -= length;
            if let found @ Some(_) = read(&read_at(input, window_at + at as u64, length)?) {
                return Ok(found);
            }
        }
        if window.len() < WINDOW_BYTES {
            return Ok(None);
        }
        window_at += (WINDOW_BYTES - pattern.len() - RECORD_HEAD_BYTES + 1) as u64;
    }
}

/// Up to this many bytes from an offset on.
pub(super) fn read_at(input: &mut (impl Read + Seek), at: u64, bytes: u64) -> io::Result<Vec<u8>> {
    input.seek(SeekFrom::Start(at))?;
    read_up_to(input, bytes)
}

/// Reads up to this many bytes. Beyond [`RESERVED_BYTES`] memory grows with what is there, not with what is requested.
pub(super) fn read_up_to(input: &mut impl Read, bytes: u64) -> io::Result<Vec<u8>> {
    let mut read = Vec::with_capacity(bytes.min(RESERVED_BYTES) as usize);
    input.take(bytes).read_to_end(&mut read)?;
    Ok(read)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn head(length: u64, packed_bytes: u64) -> Vec<u8> {
        [&[op::CHUNK], length.to_le_bytes().as_slice(), &[7; 28], ZSTD, &packed_bytes.to_le_bytes()].concat()
    }

    #[test]
    fn chunks_are_found_wherever_their_heads_are() {
        for at in [0, 5, WINDOW_BYTES - 60, WINDOW_BYTES - 40, WINDOW_BYTES - 3, WINDOW_BYTES, 3 * WINDOW_BYTES - 1] {
            let mut bytes = vec![0; 4 * WINDOW_BYTES];
            let head = head(144, 100);
            bytes[at..at + head.len()].copy_from_slice(&head);
            let (mut input, mut search) = (Cursor::new(&bytes), ChunkSearch::default());
            let place = ChunkPlace { start: at as u64, is_likely: true, lengths: [Some(144), None] };
            assert_eq!(search.next(&mut input, 0).unwrap(), Some(place), "{at}");
            assert_eq!(search.next(&mut input, at as u64).unwrap(), Some(place), "{at}");
            assert_eq!(search.next(&mut input, at as u64 + 1).unwrap(), None, "{at}");
        }
    }
}
