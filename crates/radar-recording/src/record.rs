//! Parses MCAP records from a slice without trusting any length.
//!
//! The mcap crate's own `parse_record` allocates as many bytes as a string's length field claims
//! (up to 4 GiB), so it is unsuitable for untrusted files.

use std::collections::BTreeMap;

/// Opcodes of the records used here.
pub(super) mod op {
    pub const INVALID: u8 = 0x00;
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0B;
    pub const METADATA: u8 = 0x0C;
    pub const DATA_END: u8 = 0x0F;
}

/// Reads little-endian fields from the front of a slice; `None` if it is too short.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*taken)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes after a 32-bit count.
    pub fn sized(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()?;
        self.bytes(usize::try_from(count).ok()?)
    }

    pub fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.sized()?).ok()
    }
}

/// Name and fields of a metadata record; `None` when it is longer or shorter than these.
pub(super) fn metadata(record: &[u8]) -> Option<(&str, BTreeMap<String, String>)> {
    let mut fields = Fields(record);
    let name = fields.text()?;
    let mut map = Fields(fields.sized()?);
    let mut values = BTreeMap::new();
    while !map.0.is_empty() {
        values.insert(map.text()?.to_owned(), map.text()?.to_owned());
    }
    fields.0.is_empty().then_some((name, values))
}

/// Id, topic and message encoding of a channel record.
pub(super) fn channel(record: &[u8]) -> Option<(u16, &str, &str)> {
    let mut fields = Fields(record);
    let (id, _schema) = (fields.u16()?, fields.u16()?);
    Some((id, fields.text()?, fields.text()?))
}

/// Channel id and content of a message record.
pub(super) fn message(record: &[u8]) -> Option<(u16, &[u8])> {
    let mut fields = Fields(record);
    let channel = fields.u16()?;
    let (_sequence, _log_time, _publish_time) = (fields.u32()?, fields.u64()?, fields.u64()?);
    Some((channel, fields.0))
}

/// Number of messages of each channel, of a statistics record.
pub(super) fn message_counts(record: &[u8]) -> Option<BTreeMap<u16, u64>> {
    let mut fields = Fields(record);
    // All messages; schemas; channels, attachments, metadata, chunks; the first and the last time.
    fields.bytes(8 + 2 + 4 * 4 + 8 + 8)?;
    let mut counts = Fields(fields.sized()?);
    let mut by_channel = BTreeMap::new();
    while !counts.0.is_empty() {
        by_channel.insert(counts.u16()?, counts.u64()?);
    }
    Some(by_channel)
}

/// Header of a chunk, with sizes as claimed by the file.
pub(super) struct ChunkHeader<'a> {
    /// Size of its records when unpacked, bytes.
    pub unpacked_bytes: u64,
    /// CRC-32 of the unpacked records; 0 for none.
    pub checksum: u32,
    /// "zstd", or empty for none.
    pub compression: &'a str,
    /// Size of its packed records, bytes.
    pub packed_bytes: u64,
    /// The packed records, as far as present.
    pub packed: &'a [u8],
}

/// Parses the header of a chunk record.
pub(super) fn chunk_header(record: &[u8]) -> Option<ChunkHeader<'_>> {
    let mut fields = Fields(record);
    let (_start, _end) = (fields.u64()?, fields.u64()?);
    let (unpacked_bytes, checksum) = (fields.u64()?, fields.u32()?);
    let compression = fields.text()?;
    let packed_bytes = fields.u64()?;
    Some(ChunkHeader { unpacked_bytes, checksum, compression, packed_bytes, packed: fields.0 })
}
