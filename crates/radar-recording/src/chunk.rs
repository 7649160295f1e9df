//! Unpacks one MCAP chunk. Every claimed size is checked first.
//!
//! The mcap crate's sans-I/O reader does the unpacking. A chunk is checked against its checksum before any record is returned.
//! Of one that is cut off nothing is taken: what is left of it may be zeros in places, which no checksum shows.

use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::record::{chunk_header, op};

/// Limit of a record, and of an unpacked chunk, bytes. Choice: chunks are written with about 1 MiB.
pub(super) const MAX_RECORD_BYTES: usize = 32 << 20;

/// Passes each record (opcode, content) of a chunk record to `take`.
///
/// # Errors
/// Why the chunk, or the rest of it, was skipped.
pub(super) fn unpack(record: &[u8], mut take: impl FnMut(u8, &[u8])) -> Result<(), String> {
    check_chunk_header(record)?;
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = LinearReader::new_with_options(options);
    let start: Vec<u8> = std::iter::once(op::CHUNK).chain((record.len() as u64).to_le_bytes()).collect();
    let mut rest = start.as_slice();
    let mut next = record;
    loop {
        match reader.next_event() {
            None => return Ok(()),
            Some(Ok(LinearReadEvent::Record { data, opcode })) => take(opcode, data),
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                if rest.is_empty() {
                    rest = std::mem::take(&mut next);
                }
                let (given, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = later;
            }
            Some(Err(error)) => return Err(error.to_string()),
        }
    }
}

/// Rejects implausible sizes, and everything that the unpacking would trust.
fn check_chunk_header(record: &[u8]) -> Result<(), String> {
    let claims = chunk_header(record).ok_or("its head is cut off or unreadable")?;
    let held_bytes = claims.packed.len() as u64;
    if claims.unpacked_bytes > MAX_RECORD_BYTES as u64 {
        return Err(format!(
            "it claims {} bytes when unpacked, more than the {MAX_RECORD_BYTES} allowed",
            claims.unpacked_bytes
        ));
    }
    if claims.unpacked_bytes == 0 && claims.packed_bytes > 0 {
        return Err(format!("it claims to be empty and holds {} packed bytes", claims.packed_bytes));
    }
    // Bytes beyond the claimed ones would be taken for records, or hide the next chunk.
    if claims.packed_bytes != held_bytes {
        return Err(format!("it claims {} packed bytes and holds {held_bytes}", claims.packed_bytes));
    }
    match claims.compression {
        "" => Ok(()),
        "zstd" => match zstd_safe::find_frame_compressed_size(claims.packed) {
            Ok(frame_bytes) if frame_bytes as u64 == held_bytes => Ok(()),
            Ok(frame_bytes) => Err(format!("its packed records end after {frame_bytes} of {held_bytes} bytes")),
            Err(_) => Err("its packed records are cut off or damaged".into()),
        },
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
        record.extend([0; 8]);
        record.extend(packed_bytes.to_le_bytes());
        record.extend(content);
        record
    }

    fn record(opcode: u8, claimed_bytes: u64, content: &[u8]) -> Vec<u8> {
        [&[opcode], claimed_bytes.to_le_bytes().as_slice(), content].concat()
    }

    fn unpacked(chunk: &[u8]) -> (Vec<u8>, Result<(), String>) {
        let mut opcodes = Vec::new();
        let result = unpack(chunk, |opcode, _| opcodes.push(opcode));
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
        for packed_bytes in [0, 5, 21, u64::MAX] {
            assert!(unpacked(&chunk(&two, packed_bytes)).1.unwrap_err().contains("holds 20"));
        }
    }

    #[test]
    fn unsupported_compression_is_named() {
        let mut record = chunk(b"", 0);
        record.splice(28..32, [3, 0, 0, 0, b'l', b'z', b'4']);
        assert!(unpacked(&record).1.unwrap_err().contains("\"lz4\""));
    }
}
