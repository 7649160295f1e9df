//! Unpacks one MCAP chunk. Every claimed size is checked first, and nothing is returned before the chunk's checksum is right.
//!
//! Of a chunk that is cut off nothing is taken: what is left of it may be zeros in places, which no checksum shows.

use std::borrow::Cow;

use super::record::{ChunkHeader, Fields, chunk_header, op};

/// Limit of a record, and of an unpacked chunk, bytes. Choice: chunks are written with about 1 MiB.
pub(super) const MAX_RECORD_BYTES: usize = 32 << 20;

/// Passes each record (opcode, content) of a chunk record to `take`. `left`: to how many bytes this chunk and those after it may be
/// unpacked.
///
/// # Errors
/// Why the chunk, or the rest of it, was skipped.
pub(super) fn unpack(record: &[u8], left: &mut u64, mut take: impl FnMut(u8, &[u8])) -> Result<(), String> {
    let chunk = chunk_header(record).ok_or("its head is cut off or unreadable")?;
    let records = unpacked_records(&chunk, left)?;
    if records.len() as u64 != chunk.unpacked_bytes {
        return Err(format!("it claims {} bytes when unpacked and holds {}", chunk.unpacked_bytes, records.len()));
    }
    // MCAP allows 0 where none is stated. Every recording states them, so that 0 is damage like any other.
    if chunk.checksum != crc32fast::hash(&records) {
        return Err("its checksum differs".into());
    }
    let mut rest = Fields(&records);
    while !rest.0.is_empty() {
        let ([opcode], length) = rest.array().zip(rest.u64()).ok_or("its last record is cut off")?;
        let content = usize::try_from(length).ok().and_then(|length| rest.bytes(length));
        let content = content.ok_or_else(|| format!("a record in it claims {length} bytes, more than it holds"))?;
        // A damaged head that takes sound chunks for its content would hide them.
        if opcode == op::CHUNK {
            return Err("there is a chunk in it".into());
        }
        take(opcode, content);
    }
    Ok(())
}

/// The records of a chunk that claims nothing implausible. Unpacking ends at the claimed size, whatever follows.
fn unpacked_records<'a>(chunk: &ChunkHeader<'a>, left: &mut u64) -> Result<Cow<'a, [u8]>, String> {
    let (claimed, held_bytes) = (chunk.unpacked_bytes, chunk.packed.len() as u64);
    if claimed > MAX_RECORD_BYTES as u64 {
        return Err(format!("it claims {claimed} bytes when unpacked, more than the {MAX_RECORD_BYTES} allowed"));
    }
    // Bytes beyond the claimed ones would be taken for records, or hide the next chunk.
    if chunk.packed_bytes != held_bytes {
        return Err(format!("it claims {} packed bytes and holds {held_bytes}", chunk.packed_bytes));
    }
    match chunk.compression {
        "" => Ok(Cow::Borrowed(chunk.packed)),
        "zstd" if held_bytes == 0 => Ok(Cow::Borrowed(&[])),
        "zstd" => {
            match zstd_safe::find_frame_compressed_size(chunk.packed) {
                Ok(frame_bytes) if frame_bytes as u64 == held_bytes => {}
                Ok(frame_bytes) => {
                    return Err(format!("its packed records end after {frame_bytes} of {held_bytes} bytes"));
                }
                Err(_) => return Err("its packed records are cut off or damaged".into()),
            }
            // What only looks like a chunk has not come this far.
            *left = left.checked_sub(claimed).ok_or(
                "the chunks before it unpack to so much more than the file holds that it cannot be a recording of a sensor",
            )?;
            let mut records = Vec::with_capacity(claimed as usize);
            let unpacked = zstd_safe::decompress(&mut records, chunk.packed);
            let reason = |code| format!("its records cannot be unpacked: {}", zstd_safe::get_error_name(code));
            unpacked.map(|_| Cow::Owned(records)).map_err(reason)
        }
        other => Err(format!("it is packed with {other:?}, which is not read; only zstd is")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chunk record with uncompressed content.
    fn chunk(content: &[u8], packed_bytes: u64) -> Vec<u8> {
        let mut record = vec![0; 16];
        record.extend((content.len() as u64).to_le_bytes());
        record.extend(crc32fast::hash(content).to_le_bytes());
        record.extend([0; 4]);
        record.extend(packed_bytes.to_le_bytes());
        record.extend(content);
        record
    }

    fn record(opcode: u8, claimed_bytes: u64, content: &[u8]) -> Vec<u8> {
        [&[opcode], claimed_bytes.to_le_bytes().as_slice(), content].concat()
    }

    fn unpacked(chunk: &[u8]) -> (Vec<u8>, Result<(), String>) {
        let mut opcodes = Vec::new();
        let mut left = u64::MAX;
        let result = unpack(chunk, &mut left, |opcode, _| opcodes.push(opcode));
        (opcodes, result)
    }

    #[test]
    fn uncompressed_chunks_are_read_without_trusting_lengths() {
        let two = [record(5, 2, b"ab"), record(9, 0, b"")].concat();
        assert_eq!(unpacked(&chunk(&two, 20)), (vec![5, 9], Ok(())));
        let beyond = [record(5, 2, b"ab"), record(9, 1 << 20, b"x")].concat();
        let (opcodes, result) = unpacked(&chunk(&beyond, beyond.len() as u64));
        assert_eq!((opcodes, result.is_err()), (vec![5], true));
        let huge = record(5, u64::MAX, b"x");
        assert!(unpacked(&chunk(&huge, huge.len() as u64)).1.is_err());
        let nested = record(op::CHUNK, 2, b"ab");
        assert!(unpacked(&chunk(&nested, nested.len() as u64)).1.unwrap_err().contains("chunk in it"));
        for packed_bytes in [0, 5, 21, u64::MAX] {
            assert!(unpacked(&chunk(&two, packed_bytes)).1.unwrap_err().contains("holds 20"));
        }
    }

    #[test]
    fn packed_records_are_unpacked_up_to_their_claim() {
        let content = record(5, 1 << 20, &vec![0; 1 << 20]);
        let mut packed = Vec::with_capacity(1 << 16);
        zstd_safe::compress(&mut packed, &content, 3).unwrap();
        let chunk = |claimed: u64, checksum: u32| {
            let mut head = vec![0; 16];
            head.extend(claimed.to_le_bytes());
            head.extend(checksum.to_le_bytes());
            head.extend(b"\x04\0\0\0zstd");
            head.extend((packed.len() as u64).to_le_bytes());
            [head, packed.clone()].concat()
        };
        let (claimed, checksum) = (content.len() as u64, crc32fast::hash(&content));
        assert_eq!(unpacked(&chunk(claimed, checksum)), (vec![5], Ok(())));
        for (claimed, checksum, reason) in [
            (claimed, checksum ^ 1, "checksum differs"),
            (claimed, 0, "checksum differs"),
            (claimed - 1, checksum, "cannot be unpacked"),
            (0, checksum, "cannot be unpacked"),
            (claimed + 1, 0, "holds 1048585"),
            (u64::MAX, checksum, "allowed"),
        ] {
            let (opcodes, result) = unpacked(&chunk(claimed, checksum));
            assert!(opcodes.is_empty());
            assert!(result.as_ref().is_err_and(|error| error.contains(reason)), "{reason}: {result:?}");
        }
    }

    #[test]
    fn unsupported_compression_is_named() {
        let mut record = chunk(b"", 0);
        record.splice(28..32, [3, 0, 0, 0, b'l', b'z', b'4']);
        assert!(unpacked(&record).1.unwrap_err().contains("\"lz4\""));
    }
}
