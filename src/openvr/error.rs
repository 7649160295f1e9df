//! Errors between this program and SteamVR, with their remedies.

use std::path::PathBuf;

use super::sys;

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
    #[error("the VR runtime rejected the connection: {}{}", described(*code, name.as_deref(), text.as_deref()), remedy(*code))]
    Refused {
        /// Error number.
        code: i64,
        /// Error name, if the runtime gives one.
        name: Option<String>,
        /// Error text of the runtime, if it gives one.
        text: Option<String>,
    },
    /// A required interface is missing.
    #[error("the VR runtime has no {0}: it is older than this program needs. Let Steam update SteamVR")]
    Interface(String),
    /// SteamVR rejected a call.
    #[error("the VR runtime refused {call}: {name}")]
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

/// An error number with what the runtime says about it.
pub(super) fn described(code: i64, name: Option<&str>, text: Option<&str>) -> String {
    match (text, name) {
        (Some(text), Some(name)) => format!("{text} ({name}, {code})"),
        (Some(said), None) | (None, Some(said)) => format!("{said} ({code})"),
        (None, None) => format!("error {code}"),
    }
}

/// What to do about a rejected connection, where something can be done.
fn remedy(code: i64) -> &'static str {
    match u32::try_from(code) {
        Ok(sys::EVRInitError_VRInitError_Init_InvalidApplicationType) => {
            ". It takes no overlay applications; if it is not SteamVR, start SteamVR on it"
        }
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(code: i64, name: Option<&str>, text: Option<&str>) -> String {
        OpenVrError::Refused { code, name: name.map(Into::into), text: text.map(Into::into) }.to_string()
    }

    #[test]
    fn what_the_runtime_does_not_say_is_left_out() {
        let begin = "the VR runtime rejected the connection: ";
        assert_eq!(refused(150, None, None), format!("{begin}error 150"));
        assert_eq!(refused(150, Some("Name"), None), format!("{begin}Name (150)"));
        assert_eq!(refused(150, Some("Name"), Some("Text")), format!("{begin}Text (Name, 150)"));
        let no_overlays = refused(130, None, None);
        assert!(no_overlays.contains("takes no overlay applications") && no_overlays.contains("SteamVR"));
    }
}
