//! The stand-in runtime itself, as a program meets it: through the folders that its server makes, the library that lies
//! there, and the function tables. Each test has a server, a folder and a process of its own.

#![cfg(unix)]

mod applications;
mod calls;
mod gpu;
mod pictures;
mod rig;
mod runtime;
mod sys;
mod universes;
