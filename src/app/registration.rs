//! The program's registration in SteamVR.

use std::path::PathBuf;

use anyhow::{Context, Result};

use crate::openvr::{Registration, Runtime};

/// What is wrong with the program's registration in SteamVR, if anything, with the remedy.
pub fn registration_trouble(registration: &Registration) -> Option<String> {
    let Registration { is_registered, binary, .. } = registration;
    if !is_registered {
        return None;
    }
    let binary = binary.as_ref()?;
    let again = "`radar-chaperone install` fixes it";
    if !binary.exists() {
        return Some(format!("SteamVR would start {}, which is not there: {again}", binary.display()));
    }
    let same = |own: PathBuf| binary.canonicalize().ok() == own.canonicalize().ok();
    match own_path().is_ok_and(same) {
        true => None,
        false => Some(format!("SteamVR starts another copy of this program, {}: {again}", binary.display())),
    }
}

/// Path of this program.
///
/// # Errors
/// The system does not report it.
pub fn own_path() -> Result<PathBuf> {
    std::env::current_exe().context("cannot find the path of this program")
}

/// SteamVR starts the path in its manifest, from which the program may have been moved.
pub fn check_registration(runtime: &Runtime) {
    let registration = runtime.registration();
    if let Some(trouble) = registration_trouble(&registration) {
        log::warn!("{trouble}");
    }
    if registration.is_registered
        && let Err(error) = runtime.identify()
    {
        log::info!("{error}");
    }
}
