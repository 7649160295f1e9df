//! The first structure of an HDF5 file, read for one question: did the writer close the file?
//!
//! The HDF5 library updates the superblock when it flushes or closes a file. Before that it says
//! what held at the creation.

/// First bytes of a superblock.
const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";
/// An address that is not set.
const UNDEFINED: u64 = u64::MAX;
/// Bytes of an object's header that tell whether it was written. Choice: every version has its
/// version, size or signature in the first 16.
const HEADER_START_BYTES: usize = 16;
/// Bit of the consistency flags: open for writing. Source: HDF5 file format specification 3.0,
/// superblock version 3.
const OPEN_FOR_WRITING: u8 = 1;

/// A file that its writer did not close.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LeftOpen {
    /// Whether the root group was written.
    pub has_root: bool,
    /// Bytes after the end of what was flushed.
    pub unindexed_bytes: u64,
}

/// Where a superblock's fields are.
struct Superblock {
    /// What the other addresses count from.
    base: u64,
    /// End of the file.
    end: u64,
    /// Header of the root group.
    root: u64,
    open_for_writing: bool,
}

/// Whether the writer left the file open: it is marked so, its root group was never written, or it
/// grew beyond the end that it states. A file that is shorter than it states was cut, and one that
/// is not HDF5 is none of these.
pub(super) fn left_open(bytes: &[u8]) -> Option<LeftOpen> {
    let superblock = Superblock::read(bytes)?;
    let end = superblock.base.checked_add(superblock.end)?;
    let unindexed_bytes = (bytes.len() as u64).saturating_sub(end);
    let is_cut = end > bytes.len() as u64;
    let has_root = superblock.has_root(bytes);
    let is_open = superblock.open_for_writing || !(is_cut || has_root) || unindexed_bytes > 0;
    is_open.then_some(LeftOpen { has_root, unindexed_bytes })
}

impl Superblock {
    /// `None` if there is none, or one with addresses of another size than 8 bytes, which the
    /// vendor's tool does not write.
    fn read(bytes: &[u8]) -> Option<Self> {
        let later = std::iter::successors(Some(512usize), |at| at.checked_mul(2)).take_while(|&at| at < bytes.len());
        let at = std::iter::once(0).chain(later).find(|&at| bytes[at..].starts_with(&SIGNATURE))?;
        let block = &bytes[at..];
        let address = |at: usize| Some(u64::from_le_bytes(*block.get(at..)?.first_chunk()?));
        let byte = |at: usize| block.get(at).copied();
        match byte(8)? {
            version @ (0 | 1) if byte(13)? == 8 && byte(14)? == 8 => {
                let addresses = if version == 0 { 24 } else { 28 };
                // Base, free space, end, driver; then the root group's name and header.
                let [base, end, root] = [0, 16, 40].map(|after| address(addresses + after));
                Some(Self { base: base?, end: end?, root: root?, open_for_writing: false })
            }
            2 | 3 if byte(9)? == 8 => {
                // Base, extension, end, root.
                let [base, end, root] = [12, 28, 36].map(address);
                let open_for_writing = byte(11)? & OPEN_FOR_WRITING != 0;
                Some(Self { base: base?, end: end?, root: root?, open_for_writing })
            }
            _ => None,
        }
    }

    /// Whether something was written where the root group's header is said to be.
    fn has_root(&self, bytes: &[u8]) -> bool {
        if self.root == UNDEFINED {
            return false;
        }
        let at = self.base.checked_add(self.root).and_then(|at| usize::try_from(at).ok());
        let start = at.and_then(|at| bytes.get(at..)?.get(..HEADER_START_BYTES));
        start.is_some_and(|start| start.iter().any(|&byte| byte != 0))
    }
}
