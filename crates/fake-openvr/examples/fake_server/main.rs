//! Acts as SteamVR's server for the fake client library (`fake_runtime`): creates the folders
//! through which programs find the library, holds the lock that shows that the server is running,
//! and asks the programs to quit when it ends. docs/fake-runtime.md is the manual.
//!
//! Use: `fake_server --dir DIR [--track HEAD.tum] [--controller TRACK.tum]... [--config
//! FILE.json] [--library PATH] [--autolaunch]`.

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
    anyhow::bail!("the fake SteamVR runtime runs only on Linux")
}
