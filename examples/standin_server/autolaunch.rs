//! Starts what is registered to be started with the server.

use std::fs;
use std::process::{Child, Command};

use anyhow::Result;
use serde_json::Value;

use crate::folders::Folders;

/// Starts them all; what cannot be started is said and left out.
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

/// Says which have ended.
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

/// The words of a line of arguments; double quotes hold words together.
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
