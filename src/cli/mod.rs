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

use std::io::Write;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand};

use radar_sar::{INSTRUCTIONS_VARIABLE, InstructionSet};

use crate::app::{begin_log_file, leave_own_console, log_line, open_missing_console, printable};

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
    let arguments = Arguments::parse();
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn"))
        .format(|out, record| {
            let text = printable(&record.args().to_string());
            log_line(&format!("[{:<5} {}] {text}", record.level(), record.target()));
            writeln!(out, "[{:<5} {}] {text}", record.level(), record.target())
        })
        .init();
    if is_run && let Err(error) = begin_log_file() {
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
