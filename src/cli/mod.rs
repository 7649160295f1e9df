//! The command line: one file per command; the module documentation of a command is its manual.

mod board;
mod calibrate;
mod demo;
mod doctor;
mod doctor_steamvr;
mod files;
mod findings;
mod import;
mod info;
mod install;
mod outputs;
mod reconstruct;
mod record;
mod recover;
mod replay;
mod results;
mod run;
mod sensor;
mod serve;
mod simulate;
mod view;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};

use radar_sar::{INSTRUCTIONS_VARIABLE, InstructionSet};

use crate::app::{begin_log_file, has_own_console, leave_own_console, log_line, open_missing_console, printable};

/// Sees the room around a VR headset with a 60 GHz radar and warns of obstacles.
///
/// No hardware is needed to try it: `radar-chaperone demo` simulates a sensor on a headset in a
/// furnished room, detects the obstacles there, and writes a report that compares them with the
/// truth.
#[derive(Debug, Parser)]
#[command(name = "radar-chaperone", version, arg_required_else_help = true, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::Run),
    Demo(demo::Demo),
    Simulate(Box<simulate::Simulate>),
    Doctor(doctor::Doctor),
    Install(install::Install),
    Uninstall(install::Uninstall),
    Record(record::Record),
    Replay(replay::Replay),
    Reconstruct(reconstruct::Reconstruct),
    Calibrate(calibrate::Calibrate),
    Import(import::Import),
    Info(info::Info),
    Recover(recover::Recover),
}

/// Checks arguments of `radar-chaperone run`.
///
/// # Errors
/// The arguments that it does not accept.
fn check_run(arguments: &[String]) -> anyhow::Result<()> {
    let words = ["radar-chaperone", "run"].into_iter().chain(arguments.iter().map(String::as_str));
    let Command::Run(run) = Arguments::try_parse_from(words)?.command else {
        anyhow::bail!("`run` does not take these arguments: {}", arguments.join(" "))
    };
    run.check()
}

/// The error and its causes. Repetitions are dropped, because many errors contain the text of their
/// cause.
fn error_text(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(cause.trim_end()) {
            text = format!("{text}: {cause}");
        }
    }
    text.trim_end().to_owned()
}

/// Runs the program; prints errors with their causes to standard error.
pub fn run() -> ExitCode {
    let is_run = std::env::args_os().nth(1).is_some_and(|word| word == "run");
    if is_run {
        leave_own_console()
    } else {
        open_missing_console()
    }
    let words: Vec<OsString> = std::env::args_os().collect();
    let clicked = words_of_click(&words, has_own_console());
    let exit = run_command(Arguments::parse_from(clicked.as_ref().unwrap_or(&words)));
    if clicked.is_some() && has_own_console() {
        // The window closes with the program, and nobody could have read it.
        let _ = writeln!(std::io::stdout(), "\nPress Enter to close this window.");
        let _ = std::io::stdin().read_line(&mut String::new());
    }
    exit
}

/// What a double click stands for: on the program, a session; on a recording, its view.
fn words_of_click(words: &[OsString], has_own_console: bool) -> Option<Vec<OsString>> {
    match words {
        [program] if has_own_console => Some(vec![program.clone(), "run".into()]),
        [program, file] if Path::new(file).extension().is_some_and(|kind| kind.eq_ignore_ascii_case("mcap")) => {
            Some(vec![program.clone(), "replay".into(), "--view".into(), "--".into(), file.clone()])
        }
        _ => None,
    }
}

fn run_command(arguments: Arguments) -> ExitCode {
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn"))
        .format(|out, record| {
            let text = printable(&record.args().to_string());
            log_line(&format!("[{:<5} {}] {text}", record.level(), record.target()));
            writeln!(out, "[{:<5} {}] {text}", record.level(), record.target())
        })
        .init();
    if matches!(arguments.command, Command::Run(_))
        && let Err(error) = begin_log_file()
    {
        log::warn!("there is no log file: {error}");
    }
    let done = InstructionSet::limit()
        .with_context(|| format!("{INSTRUCTIONS_VARIABLE} in the environment"))
        .and_then(|_| arguments.command.run());
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let text = error_text(&error);
            log_line(&format!("error: {text}"));
            // If nobody reads it, the exit code still reports the failure.
            let _ = writeln!(std::io::stderr(), "error: {}", printable(&text));
            ExitCode::FAILURE
        }
    }
}

impl Command {
    fn run(self) -> Result<()> {
        match self {
            Self::Run(command) => command.run(),
            Self::Demo(command) => command.run(),
            Self::Simulate(command) => command.run(),
            Self::Doctor(command) => command.run(),
            Self::Install(command) => command.run(),
            Self::Uninstall(command) => command.run(),
            Self::Record(command) => command.run(),
            Self::Replay(command) => command.run(),
            Self::Reconstruct(command) => command.run(),
            Self::Calibrate(command) => command.run(),
            Self::Import(command) => command.run(),
            Self::Info(command) => command.run(),
            Self::Recover(command) => command.run(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn double_clicks_are_a_session_or_a_view() {
        let meant = |words: &[&str], has_own_console| {
            let words: Vec<OsString> = words.iter().map(OsString::from).collect();
            words_of_click(&words, has_own_console).map(|words| Arguments::try_parse_from(words).unwrap().command)
        };
        assert!(meant(&["radar-chaperone"], false).is_none());
        assert!(matches!(meant(&["radar-chaperone"], true), Some(Command::Run(_))));
        for file in ["room.mcap", "/a b/Room.MCAP", "-x.mcap"] {
            assert!(matches!(meant(&["radar-chaperone", file], false), Some(Command::Replay(_))));
        }
        assert!(meant(&["radar-chaperone", "demo"], true).is_none());
        assert!(meant(&["radar-chaperone", "info", "room.mcap"], true).is_none());
    }
}
