//! A stand-in for SteamVR's client library, to run programs against where there is no headset and no SteamVR.
//!
//! A program loads it as it loads Valve's: through the registry file, then by `VRClientCoreFactory`. It plays a headset
//! that moves on a given path, takes overlays, checks every call, and draws what each eye would see on the CPU, from the
//! program's textures, alphas, flags and transforms. `standin_server` makes its folders and stands for SteamVR's server.
//! docs/stand-in.md is the manual.

#![cfg(unix)]

mod applications;
mod chaperone;
mod client_core;
mod clock;
mod commands;
mod compositor;
mod config;
mod dashboard;
mod events;
mod eye_picture;
mod eyes;
mod housekeeper;
mod memory;
mod overlay;
mod overlay_table;
mod painter;
mod paths;
mod poses;
mod pyramid;
mod report;
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
