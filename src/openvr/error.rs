//! What goes wrong between this program and SteamVR, with what to do about it.

use std::path::PathBuf;

/// An error of SteamVR or on the way to it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OpenVrError {
    /// No list of runtimes where Valve's loader looks for one.
    #[error("SteamVR is not installed: there is no {}. Install it in Steam and start it once", .0.display())]
    NotInstalled(PathBuf),
    /// The list of runtimes cannot be used.
    #[error("the list of VR runtimes {} cannot be used: {reason}. Starting SteamVR once writes it anew", path.display())]
    Registry {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The runtime's library is not there.
    #[error("SteamVR's library {} is not there: let Steam check its files, or mend VR_OVERRIDE", .0.display())]
    NoLibrary(PathBuf),
    /// The runtime's library does not load, or is none.
    #[error("SteamVR's library {} cannot be used: {reason}", path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// SteamVR does not run, and nobody asked to start it.
    #[error("SteamVR is not running: start it, or wait for it with `radar-chaperone run --wait`")]
    NotRunning,
    /// SteamVR has no headset.
    #[error("SteamVR finds no headset: is it plugged in and switched on?")]
    NoHeadset,
    /// It does not let this program in.
    #[error("SteamVR does not let this program in: {text} ({name}, {code})")]
    Refused {
        /// Number of the error.
        code: i64,
        /// Its name.
        name: String,
        /// The runtime's own words.
        text: String,
    },
    /// An interface that this program was written for is missing.
    #[error("SteamVR has no {0}: it is older than this program needs. Let Steam update it")]
    Interface(String),
    /// A call was refused.
    #[error("SteamVR refused {call}: {name}")]
    Call {
        /// What was asked.
        call: &'static str,
        /// Name of the error.
        name: String,
    },
    /// SteamVR went away without a word.
    #[error("SteamVR does not answer any more")]
    Gone,
}
