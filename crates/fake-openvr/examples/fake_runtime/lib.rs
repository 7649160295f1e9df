//! A fake of SteamVR's client library, for running programs without a headset and without SteamVR.
//!
//! A program loads it like Valve's library: through the registry file, then `VRClientCoreFactory`.
//! It simulates a headset on a given path, accepts overlays, checks every call, and renders the
//! view of each eye on the CPU from the program's textures, alphas, flags and transforms.
//! `fake_server` creates its folders and acts as SteamVR's server. docs/fake-runtime.md is the
//! manual.

#![cfg(unix)]

mod applications;
mod chaperone;
mod client_core;
mod clock;
mod commands;
mod compositor;
mod config;
mod connection;
mod dashboard;
mod devices;
mod events;
mod eye_picture;
mod eyes;
mod housekeeper;
mod memory;
mod older_tables;
mod overlay;
mod overlay_table;
mod painter;
mod paths;
mod poses;
mod pyramid;
mod report;
mod script;
mod server;
mod settings;
mod snapshot;
mod sys;
mod system;
mod table;
mod track;
mod universes;
mod vulkan;
mod world;
