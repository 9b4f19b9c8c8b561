//! The program `surfelcast`: serve, render, doctor. Reads the command line, wires the crates together, maps outcomes to
//! exit codes: 0 done, 1 runtime failure, 2 bad usage or bad input.

mod cli;
mod doctor;
mod ply;
mod progress;
mod render;
mod serve;
mod stats;

use std::process::ExitCode;

use clap::Parser;
use surfelcast::process;

use cli::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    process::start(cli.verbose);
    let outcome = match cli.command {
        Command::Serve(args) => serve::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Doctor => doctor::run(),
    };
    process::exit_code("surfelcast", outcome)
}
