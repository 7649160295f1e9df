//! Damage found while reading a recording.

use std::fmt;

/// Damage of a recording; everything readable was returned nevertheless.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Damage {
    /// Where and why reading stopped before the proper end of the file.
    pub ended_early: Option<String>,
    /// Chunks (of at most a second each) that were skipped, completely or in part.
    pub chunks_damaged: u64,
    /// Messages skipped because their length or numbers are invalid.
    pub messages_skipped: u64,
    /// Bytes between whole chunks that were passed over, because no record could be read there.
    pub bytes_skipped: u64,
    /// Bytes that the disk could not read, as far as reading came across them.
    pub unreadable_bytes: u64,
    /// Whether the checksum of all data differs. Headers of chunks and of messages' indexes are covered by it alone.
    pub checksum_differs: bool,
    /// Whether the index behind the data, or the end of the file, is not as written. No frame or pose is in it.
    pub index_damaged: bool,
    /// Reason for the first skipped chunk or message.
    pub first_reason: Option<String>,
}

impl Damage {
    /// Whether there is no damage.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    pub(super) fn chunk(&mut self, reason: impl Into<String>) {
        self.chunks_damaged += 1;
        self.first_reason.get_or_insert_with(|| reason.into());
    }

    pub(super) fn skip(&mut self, bytes: u64, reason: impl Into<String>) {
        self.bytes_skipped += bytes;
        self.first_reason.get_or_insert_with(|| reason.into());
    }

    pub(super) fn message(&mut self, reason: impl Into<String>) {
        self.messages_skipped += 1;
        self.first_reason.get_or_insert_with(|| reason.into());
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_none() {
            return write!(f, "none");
        }
        let mut parts = Vec::new();
        parts.extend(self.ended_early.clone());
        if self.chunks_damaged > 0 {
            let chunks = if self.chunks_damaged == 1 { "chunk" } else { "chunks" };
            parts.push(format!("{} {chunks} (a second at most) not or only partly readable", self.chunks_damaged));
        }
        if self.messages_skipped > 0 {
            parts.push(format!("{} messages left out", self.messages_skipped));
        }
        if self.bytes_skipped > 0 {
            parts.push(format!("{} bytes passed over", self.bytes_skipped));
        }
        if self.unreadable_bytes > 0 {
            parts.push(format!("{} bytes that the disk cannot read", self.unreadable_bytes));
        }
        if self.checksum_differs {
            parts.push("the file's checksum differs".to_owned());
        }
        if self.index_damaged {
            parts.push("the index behind the frames and poses is damaged".to_owned());
        }
        if let Some(reason) = &self.first_reason {
            parts.push(format!("first of them: {reason}"));
        }
        write!(f, "{}", parts.join("; "))
    }
}
