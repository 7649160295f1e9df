//! Errors between this program and SteamVR, with their remedies.

use std::path::PathBuf;

/// An error of SteamVR or of finding it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OpenVrError {
    /// There is no registry file where Valve's loader looks for it.
    #[error("SteamVR is not installed: there is no {}. Install it in Steam and start it once", .0.display())]
    NotInstalled(PathBuf),
    /// The registry file cannot be used.
    #[error("the list of VR runtimes {} cannot be used: {reason}. Starting SteamVR once creates it again", path.display())]
    Registry {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The runtime's library is missing.
    #[error("SteamVR's library {} is missing: let Steam verify its files, or correct VR_OVERRIDE", .0.display())]
    NoLibrary(PathBuf),
    /// The runtime's library does not load, or is not a VR runtime.
    #[error("SteamVR's library {} cannot be used: {reason}", path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// SteamVR is not running, and this role does not start it.
    #[error("SteamVR is not running: start it, or wait for it with `radar-chaperone run --wait`")]
    NotRunning,
    /// SteamVR has no headset.
    #[error("SteamVR finds no headset: is it plugged in and switched on?")]
    NoHeadset,
    /// SteamVR rejected the connection.
    #[error("SteamVR rejected the connection: {text} ({name}, {code})")]
    Refused {
        /// Error number.
        code: i64,
        /// Error name.
        name: String,
        /// Error text of the runtime.
        text: String,
    },
    /// A required interface is missing.
    #[error("SteamVR has no {0}: it is older than this program needs. Let Steam update it")]
    Interface(String),
    /// SteamVR rejected a call.
    #[error("SteamVR refused {call}: {name}")]
    Call {
        /// What was requested.
        call: &'static str,
        /// Error name.
        name: String,
    },
    /// SteamVR exited unexpectedly.
    #[error("SteamVR exited unexpectedly")]
    Gone,
}
