//! The program `surfelcast`: serve, render, bench, doctor. Reads the command line, wires the rooms together, maps outcomes to exit
//! codes: 0 done, 1 runtime failure, 2 bad usage or bad input.

mod bench;
mod cli;
mod doctor;
mod failure;
mod ply;
mod progress;
mod render;
mod scene_file;
mod serve;
mod stats;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};

fn main() -> ExitCode {
    quiet_loader();
    let cli = Cli::parse();
    init_log(cli.verbose);
    let outcome = match cli.command {
        Command::Serve(args) => serve::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Doctor => doctor::run(),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.report();
            failure.exit_code()
        }
    }
}

/// Mesa's device-select layer writes to stderr at every look for adapters where there is no desktop session, and choosing
/// a device is our own matter anyway.
#[allow(unsafe_code, reason = "the environment can only be changed so")]
fn quiet_loader() {
    // SAFETY: no other thread has been started yet.
    unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
}

/// Logs go to stderr: warnings by default, more with `-v` or by `RUST_LOG`.
fn init_log(verbose: u8) {
    let level = match verbose {
        0 => "warn,surfelcast=warn",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| {
        tracing_subscriber::EnvFilter::new(format!("{level},wgpu_hal=error,wgpu_core=error,naga=error"))
    });
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
}
