//! What studies share: where results go, records that a later run goes on from, tables and plots.

pub(crate) mod chart;
mod markers;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use serde::de::DeserializeOwned;
use surfelcast::Failure;
use surfelcast::args::DeviceArgs;
use surfelcast_gpu::{Gpu, GpuOptions};
use surfelcast_measure::MeasureError;

use markers::replace_between_markers;

/// Where a study's tables go.
#[derive(Debug, Args)]
pub(crate) struct TableArgs {
    /// Document to write the tables into, between the markers of their name, such as `<!-- error: begin -->` and
    /// `<!-- error: end -->`.
    #[arg(long, value_name = "FILE.md")]
    table: Option<PathBuf>,
}

/// Where results go, shared by studies that render themselves.
#[derive(Debug, Args)]
pub(crate) struct OutputArgs {
    /// Folder for CSV, JSON and plots. What is in it already is not measured again.
    #[arg(long, value_name = "DIR", default_value = "data/bench")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) table: TableArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Opens the device of the command line.
pub(crate) fn open_gpu(device: &DeviceArgs) -> Result<Gpu, Failure> {
    Ok(Gpu::open(&GpuOptions {
        adapter: device.adapter.clone(),
        memory_budget_bytes: device.memory_budget_bytes(),
        ..GpuOptions::default()
    })?)
}

impl OutputArgs {
    pub(crate) fn gpu(&self) -> Result<Gpu, Failure> {
        open_gpu(&self.device)
    }
}

impl TableArgs {
    /// Refuses a document without a place for the tables before anything is measured.
    pub(crate) fn check(&self, name: &str) -> Result<(), Failure> {
        let Some(path) = &self.table else { return Ok(()) };
        replace_between_markers(&read_text(path)?, name, "")
            .map(drop)
            .map_err(|error| Failure::input(format!("--table {}: {error}", path.display())))
    }

    /// Prints the tables, and writes them into the document where there is one.
    #[allow(clippy::print_stdout, reason = "the tables are the command's output")]
    pub(crate) fn publish(&self, name: &str, markdown: &str) -> Result<(), Failure> {
        println!("{markdown}");
        let Some(path) = &self.table else { return Ok(()) };
        write_file(path, replace_between_markers(&read_text(path)?, name, markdown)?.as_bytes())
    }
}

/// A fault of a file that was to be measured.
#[allow(clippy::needless_pass_by_value, reason = "the form that `map_err` takes")]
pub(crate) fn input(error: MeasureError) -> Failure {
    Failure::input(error.to_string())
}

/// Adapter, driver and the processors that a software adapter runs on.
pub(crate) fn device_name(gpu: &Gpu) -> String {
    let info = gpu.info();
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    format!("{} ({}), {threads} threads", info.name, info.driver)
}

/// A bar on a terminal, nothing in a pipe.
pub(crate) fn progress_bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len}  {msg}  {elapsed}") {
        bar.set_style(style);
    }
    bar
}

/// What an earlier run wrote down; nothing where there is no such file.
pub(crate) fn read_record<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, Failure> {
    match std::fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map_err(|error| {
            Failure::input(format!(
                "{}: not a record of this program ({error}); choose another --out, or remove it",
                path.display()
            ))
        }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(Failure::input(format!("{}: {error}", path.display()))),
    }
}

/// Writes a record down, and the same as CSV beside it.
pub(crate) fn write_record<T: Serialize>(path: &Path, record: &[T], csv: &str) -> Result<(), Failure> {
    let json = serde_json::to_vec_pretty(record).map_err(|error| Failure::runtime(error.to_string()))?;
    // Written beside and renamed, so that an interrupt leaves the old file or the new one.
    let written = path.with_extension("new");
    write_file(&written, &json)?;
    std::fs::rename(&written, path).map_err(|error| Failure::runtime(format!("{}: {error}", path.display())))?;
    write_file(&path.with_extension("csv"), csv.as_bytes())
}

pub(crate) fn read_text(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| Failure::input(format!("{}: {error}", path.display())))
}

/// Writes a file, and the folder it lies in.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let written = match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder),
        None => Ok(()),
    };
    written
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(|error| Failure::runtime(format!("{} could not be written: {error}", path.display())))
}
