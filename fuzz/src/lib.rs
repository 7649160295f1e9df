//! Shared code of the fuzz targets: an allocation counter, a temporary file, a board, and seeds for
//! the corpora.

pub mod board;
pub mod file;
pub mod memory;
pub mod script;
pub mod seeds;
