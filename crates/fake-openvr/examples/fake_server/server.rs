//! Life cycle of the server: folders, lock, applications, shutdown.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::Parser;

use crate::autolaunch;
use crate::folders;
use crate::folders::Folders;

/// Time that clients have to exit after they are asked to quit. Source: as in SteamVR.
const PATIENCE: Duration = Duration::from_secs(5);
/// Attempts to take a lock that clients probe briefly. Choice: two seconds, while a probe holds a
/// lock for microseconds.
const LOCK_TRIES: u32 = 100;
const PAUSE: Duration = Duration::from_millis(20);

/// A fake SteamVR server.
#[derive(Parser)]
struct Arguments {
    /// Folder for all files.
    #[arg(long)]
    dir: PathBuf,
    /// The head's path (TUM); overrides the configuration.
    #[arg(long)]
    track: Option<PathBuf>,
    /// A controller's path (TUM); overrides the configuration. The first is in the left hand.
    #[arg(long = "controller")]
    controllers: Vec<PathBuf>,
    /// Configuration to start from.
    #[arg(long)]
    config: Option<PathBuf>,
    /// The client library; default: the one beside this program.
    #[arg(long)]
    library: Option<PathBuf>,
    /// Starts the applications that are registered for automatic start, as SteamVR does.
    #[arg(long)]
    autolaunch: bool,
}

/// Runs the server from argument parsing to shutdown.
pub fn run() -> Result<()> {
    let arguments = Arguments::parse();
    let folders = Folders::new(&arguments.dir)?;
    let config = folders::config(arguments.config.as_deref(), arguments.track.as_deref(), &arguments.controllers)?;
    let library = library(arguments.library.as_deref())?;
    // Held until the process ends.
    let _lock = lock(&folders.server_lock()?)?;
    folders.make(&config, &library)?;
    let end = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, end.clone())?;
    }
    println!("VR_PATHREG_OVERRIDE={}", folders.registry().display());
    let mut children = if arguments.autolaunch { autolaunch::start(&folders)? } else { Vec::new() };
    while !end.load(Ordering::Relaxed) {
        autolaunch::reap(&mut children);
        std::thread::sleep(PAUSE);
    }
    quit(&folders, &mut children)
}

fn library(given: Option<&Path>) -> Result<PathBuf> {
    let path = match given {
        Some(path) => path.to_owned(),
        None => std::env::current_exe()?.with_file_name("libfake_runtime.so"),
    };
    path.canonicalize().with_context(|| format!("no client library at {}", path.display()))
}

/// Locks a file exclusively. Clients that check whether the server is running hold the lock
/// briefly.
fn lock(path: &Path) -> Result<File> {
    let file = File::options().create(true).truncate(false).write(true).open(path)?;
    for _ in 0..LOCK_TRIES {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(std::fs::TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
            Err(std::fs::TryLockError::Error(error)) => return Err(error.into()),
        }
    }
    bail!("{} is locked: another server runs in that folder", path.display())
}

/// Asks the clients to quit and waits for them.
fn quit(folders: &Folders, children: &mut Vec<std::process::Child>) -> Result<()> {
    folders.command(r#"{"do": "quit"}"#)?;
    let clients = File::options().create(true).truncate(false).write(true).open(folders.clients_lock())?;
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE {
        autolaunch::reap(children);
        if clients.try_lock().is_ok() {
            return Ok(());
        }
        std::thread::sleep(PAUSE);
    }
    eprintln!("clients were still connected {} s after they were asked to quit", PATIENCE.as_secs());
    Ok(())
}
