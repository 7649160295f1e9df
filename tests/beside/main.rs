//! The program with the fake SteamVR runtime and the simulated sensor on a pseudo terminal: the
//! complete system except for the hardware. These tests run in real time and need the machine to
//! themselves: they run one after the other, in a binary of their own, because `cargo test` runs one
//! binary after the other.
#![cfg(target_os = "linux")]

mod dashboard;
mod desktop_view;
mod displays;
mod eyes;
mod graphics;
mod install;
mod lifecycle;
mod mount;
mod notice;
mod other_runtimes;
mod recorded;
mod rig;
mod room;
mod saved_map;
mod settings;
mod warnings;
