//! `lab`: experiments, benchmarks and play sessions for radar-chaperone, with its allocator.

mod commands;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use radar_sar::InstructionSet;

use commands::{BenchmarkCommand, ExperimentCommand, PlaySessions, ResultsCommand};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Measures radar-chaperone: the thesis' experiments, run time against error, simulated play.
#[derive(Debug, Parser)]
#[command(name = "lab", version, arg_required_else_help = true, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Experiment(ExperimentCommand),
    Benchmark(BenchmarkCommand),
    Play(Box<PlaySessions>),
    Results(ResultsCommand),
}

fn main() -> ExitCode {
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn")).format_timestamp(None).init();
    let command = Arguments::parse().command;
    let done = InstructionSet::limit().map_err(anyhow::Error::from).and_then(|_| match command {
        Command::Experiment(command) => command.run(),
        Command::Benchmark(command) => command.run(),
        Command::Play(command) => command.run(),
        Command::Results(command) => command.run(),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
