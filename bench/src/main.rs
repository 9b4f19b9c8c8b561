//! The program `surfelcast-bench`: the laboratory. Each study measures one thing and writes its table.

mod hit;
mod report;
mod stage;
mod studies;

use std::process::ExitCode;

use clap::Parser;
use surfelcast::process;

use studies::Study;

/// Measurements of surfelcast: errors, times, sizes.
#[derive(Debug, Parser)]
#[command(name = "surfelcast-bench", version, about, propagate_version = true)]
struct Cli {
    /// Say more (twice: debug).
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    verbose: u8,
    #[command(subcommand)]
    study: Study,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    process::start(cli.verbose);
    process::exit_code("surfelcast-bench", cli.study.run())
}
