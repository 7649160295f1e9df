//! Starts the applications that are registered for automatic start.

use std::fs;
use std::process::{Child, Command};

use anyhow::Result;
use serde_json::Value;

use crate::folders::Folders;

/// Starts all of them. Failures are printed and skipped.
pub fn start(folders: &Folders) -> Result<Vec<Child>> {
    let Ok(bytes) = fs::read(folders.applications()) else { return Ok(Vec::new()) };
    let applications: serde_json::Map<String, Value> = serde_json::from_slice(&bytes)?;
    let mut children = Vec::new();
    for (key, application) in applications.iter().filter(|(_, application)| application["autolaunch"] == true) {
        let binary = application["binary"].as_str().unwrap_or_default();
        let arguments = words(application["arguments"].as_str().unwrap_or_default());
        let started = Command::new(binary).args(&arguments).env("VR_PATHREG_OVERRIDE", folders.registry()).spawn();
        match started {
            Ok(child) => {
                eprintln!("started {key}: {binary} {arguments:?}, process {}", child.id());
                children.push(child);
            }
            Err(error) => eprintln!("{key} cannot be started: {binary}: {error}"),
        }
    }
    Ok(children)
}

/// Prints which applications have ended.
pub fn reap(children: &mut Vec<Child>) {
    children.retain_mut(|child| match child.try_wait() {
        Ok(None) => true,
        Ok(Some(status)) => {
            eprintln!("process {} ended: {status}", child.id());
            false
        }
        Err(_) => false,
    });
}

/// Splits an argument line into words; double quotes group words.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quoted = false;
    for character in line.chars() {
        match character {
            '"' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            _ if character.is_whitespace() && !quoted => words.extend(word.take()),
            _ => word.get_or_insert_default().push(character),
        }
    }
    words.extend(word);
    words
}
