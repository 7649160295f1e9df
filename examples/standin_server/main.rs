//! Stands for SteamVR's server beside the stand-in client library (`standin_runtime`): makes the folders through which
//! programs find the library, holds the lock by which they know that the server lives, and asks them to quit when it is
//! told to end. docs/stand-in.md is the manual.
//!
//! Use: `standin_server --dir DIR [--track HEAD.tum] [--controller TRACK.tum]... [--config FILE.json] [--library PATH]
//! [--autolaunch]`.

#[cfg(unix)]
mod autolaunch;
#[cfg(unix)]
mod folders;
#[cfg(unix)]
mod server;

#[cfg(unix)]
fn main() -> anyhow::Result<()> {
    server::run()
}

#[cfg(not(unix))]
fn main() -> anyhow::Result<()> {
    anyhow::bail!("the stand-in for SteamVR runs on Linux alone")
}
