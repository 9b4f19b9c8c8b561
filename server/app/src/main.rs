//! The program `surfelcast`: serve, render, settings, doctor. Reads the command line, wires the crates together, maps
//! outcomes to exit codes: 0 done, 1 runtime failure, 2 bad usage or bad input.

mod doctor;
mod progress;
mod render;
mod serve;
mod stats;

use std::process::ExitCode;

use surfelcast::cli::{Cli, Command};
use surfelcast::{process, settings};
use surfelcast_techniques::{TECHNIQUES, registry};

fn main() -> ExitCode {
    let catalogue = registry::catalogue(TECHNIQUES);
    let cli = Cli::read(&catalogue);
    process::start(cli.verbose);
    let outcome = match cli.command {
        Command::Serve(args) => serve::run(&args),
        Command::Render(args) => render::run(&args, &catalogue),
        Command::Settings(args) => settings::run(&args, &catalogue),
        Command::Doctor => doctor::run(),
    };
    process::exit_code("surfelcast", outcome)
}
