//! The fake runtime as a program sees it: through the folders that its server creates, the library
//! in them, and the function tables. Each test has its own server, folder and process.

#![cfg(unix)]

mod applications;
mod calls;
mod gpu;
mod pictures;
mod rig;
mod runtime;
mod sys;
mod universes;
