//! Which commit and which machine measured.

use std::fmt;
use std::process::Command;

use radar_sar::InstructionSet;

/// Commit and machine of a measurement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    commit: String,
    processor: String,
    cores: usize,
    instructions: InstructionSet,
}

impl Provenance {
    /// Of the checkout that this program was built from, and of this machine.
    pub fn here() -> Self {
        Self {
            commit: commit(),
            processor: processor(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            instructions: InstructionSet::in_use(),
        }
    }
}

impl fmt::Display for Provenance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { commit, processor, cores, instructions } = self;
        let (system, architecture) = (std::env::consts::OS, std::env::consts::ARCH);
        write!(f, "at {commit} on {cores} cores of {processor} with {instructions} ({system}, {architecture})")
    }
}

fn commit() -> String {
    let git = |arguments: &[&str]| {
        let done = Command::new("git").current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).output().ok()?;
        done.status.success().then(|| String::from_utf8_lossy(&done.stdout).trim().to_owned())
    };
    match (git(&["rev-parse", "--short=10", "HEAD"]), git(&["status", "--porcelain", "--untracked-files=no"])) {
        (Some(hash), Some(changes)) if changes.is_empty() => format!("commit {hash}"),
        (Some(hash), _) => format!("commit {hash} with uncommitted changes"),
        // A program that was built here and measures on a machine without the checkout.
        _ => option_env!("RADAR_CHAPERONE_COMMIT").map_or("an unknown commit".into(), |hash| format!("commit {hash}")),
    }
}

/// The processor's name where the system reports it.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| "an unnamed processor".into(), |(_, name)| name.trim().to_owned())
}
