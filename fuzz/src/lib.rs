//! What the targets share: a count of the memory that the code under test takes, a file to hand bytes over in, a board,
//! and what every corpus begins with.

pub mod board;
pub mod file;
pub mod memory;
pub mod script;
pub mod seeds;
