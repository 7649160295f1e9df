//! Reads a fuzzer's bytes as numbers and slices; missing bytes at the end are 0.

/// The remaining bytes.
pub struct Script<'a>(pub &'a [u8]);

impl<'a> Script<'a> {
    /// Up to `count` bytes.
    pub fn bytes(&mut self, count: usize) -> &'a [u8] {
        let (bytes, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        bytes
    }

    pub fn u8(&mut self) -> u8 {
        self.bytes(1).first().copied().unwrap_or(0)
    }

    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes([self.u8(), self.u8()])
    }

    pub fn i64(&mut self) -> i64 {
        let mut bytes = [0; 8];
        let given = self.bytes(8);
        bytes[..given.len()].copy_from_slice(given);
        i64::from_le_bytes(bytes)
    }

    pub fn is_over(&self) -> bool {
        self.0.is_empty()
    }
}
