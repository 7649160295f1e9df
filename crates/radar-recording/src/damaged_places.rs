//! Finds what is whole behind damage: chunks and copies of the header, by what their first bytes always are.

use std::io::{self, Read, Seek, SeekFrom};

use super::chunk::MAX_RECORD_BYTES;
use super::record::{Fields, op};

/// In the head of a chunk: length and name of its compression.
const ZSTD: &[u8] = b"\x04\0\0\0zstd";
/// Bytes from a chunk record's opcode to that: opcode, length, two times, unpacked size, checksum.
const BYTES_BEFORE_ZSTD: u64 = 1 + 8 + 8 + 8 + 8 + 4;
/// Bytes of a chunk record up to the end of that.
pub(super) const CHUNK_START_BYTES: u64 = BYTES_BEFORE_ZSTD + ZSTD.len() as u64;
/// Bytes of a chunk's content before its packed records.
const CHUNK_HEAD_BYTES: u64 = 8 + 8 + 8 + 4 + 4 + 4 + 8;
/// Bytes that are searched at a time. Choice: what a disk reads at once.
const WINDOW_BYTES: usize = 1 << 16;

/// A place where a chunk record may begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChunkPlace {
    /// Offset of its opcode.
    pub start: u64,
    /// Lengths that its content may have: by its own length field, and by that of its packed records.
    pub lengths: [Option<u64>; 2],
}

/// The next place from `from` on whose bytes are those of a chunk's head.
pub(super) fn next_chunk(input: &mut (impl Read + Seek), from: u64) -> io::Result<Option<ChunkPlace>> {
    let mut search_from = from.saturating_add(BYTES_BEFORE_ZSTD);
    while let Some(at) = find(input, ZSTD, search_from)? {
        let start = at - BYTES_BEFORE_ZSTD;
        if let Some(place) = chunk_place(input, start)? {
            return Ok(Some(place));
        }
        search_from = at + 1;
    }
    Ok(None)
}

/// Whether a record that is no chunk holds the head of one: then its length is wrong.
pub(super) fn holds_chunk(record: &[u8]) -> bool {
    record.windows(ZSTD.len()).any(|bytes| bytes == ZSTD)
}

/// Whether a chunk's content is not as long as its packed records say, or holds the head of another chunk.
pub(super) fn has_wrong_length(chunk: &[u8]) -> bool {
    let (head_bytes, start_bytes) = (CHUNK_HEAD_BYTES as usize, CHUNK_START_BYTES as usize - 9);
    let packed_bytes = chunk.get(head_bytes - 8..).and_then(|bytes| Fields(bytes).u64());
    packed_bytes.is_none_or(|packed| packed.saturating_add(CHUNK_HEAD_BYTES) != chunk.len() as u64)
        || holds_chunk(&chunk[start_bytes..])
}

fn chunk_place(input: &mut (impl Read + Seek), start: u64) -> io::Result<Option<ChunkPlace>> {
    let head = read_at(input, start, 9 + CHUNK_HEAD_BYTES)?;
    let mut fields = Fields(&head);
    let (Some([opcode]), Some(length)) = (fields.array(), fields.u64()) else { return Ok(None) };
    let (Some(_), Some(packed_bytes)) = (fields.bytes(CHUNK_HEAD_BYTES as usize - 8), fields.u64()) else {
        return Ok(None);
    };
    let by_packed = packed_bytes.saturating_add(CHUNK_HEAD_BYTES);
    let is_possible = |length: &u64| *length <= MAX_RECORD_BYTES as u64;
    let lengths =
        [Some(length).filter(is_possible), Some(by_packed).filter(|other| is_possible(other) && *other != length)];
    // One field may be damaged, not all.
    let is_chunk = opcode == op::CHUNK || length == by_packed;
    Ok(Some(ChunkPlace { start, lengths }).filter(|_| is_chunk))
}

/// Content of the first metadata record with this name for which `read` gives something.
pub(super) fn find_metadata<T>(
    input: &mut (impl Read + Seek),
    name: &str,
    read: impl Fn(&[u8]) -> Option<T>,
) -> io::Result<Option<T>> {
    let pattern = [&(name.len() as u32).to_le_bytes(), name.as_bytes()].concat();
    let mut search_from = 9;
    while let Some(at) = find(input, &pattern, search_from)? {
        let length = Fields(&read_at(input, at - 8, 8)?).u64().unwrap_or(0);
        if length <= MAX_RECORD_BYTES as u64
            && let Some(found) = read(&read_at(input, at, length)?)
        {
            return Ok(Some(found));
        }
        search_from = at + 1;
    }
    Ok(None)
}

/// Offset of the first of these bytes from `from` on.
fn find(input: &mut (impl Read + Seek), pattern: &[u8], from: u64) -> io::Result<Option<u64>> {
    let mut at = from;
    loop {
        let window = read_at(input, at, WINDOW_BYTES as u64)?;
        if let Some(found) = window.windows(pattern.len()).position(|bytes| bytes == pattern) {
            return Ok(Some(at + found as u64));
        }
        if window.len() < WINDOW_BYTES {
            return Ok(None);
        }
        // The pattern may lie across two windows.
        at += (WINDOW_BYTES + 1 - pattern.len()) as u64;
    }
}

/// Up to this many bytes from an offset on. Memory grows with what is there, not with what is requested.
pub(super) fn read_at(input: &mut (impl Read + Seek), at: u64, bytes: u64) -> io::Result<Vec<u8>> {
    input.seek(SeekFrom::Start(at))?;
    read_up_to(input, bytes)
}

/// Reads up to this many bytes.
pub(super) fn read_up_to(input: &mut impl Read, bytes: u64) -> io::Result<Vec<u8>> {
    let mut read = Vec::new();
    input.take(bytes).read_to_end(&mut read)?;
    Ok(read)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn patterns_are_found_across_windows() {
        for at in [0, 5, WINDOW_BYTES - 8, WINDOW_BYTES - 3, WINDOW_BYTES, 3 * WINDOW_BYTES - 1] {
            let mut bytes = vec![0; 4 * WINDOW_BYTES];
            bytes[at..at + ZSTD.len()].copy_from_slice(ZSTD);
            let mut input = Cursor::new(&bytes);
            assert_eq!(find(&mut input, ZSTD, 0).unwrap(), Some(at as u64));
            assert_eq!(find(&mut input, ZSTD, at as u64 + 1).unwrap(), None);
        }
    }
}
