//! What studies share: where their results go, records that a later run continues, tables, plots and pages.

pub(crate) mod chart;
mod file;
mod origin;
mod page;
mod record;
mod table;

pub(crate) use file::{read_text, write_file};
pub(crate) use origin::{Origin, describe};
pub(crate) use page::{Page, links};
pub(crate) use record::{Measured, Record};
pub(crate) use table::Table;

use std::io::IsTerminal;
use std::path::PathBuf;

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use surfelcast::Failure;
use surfelcast::args::DeviceArgs;
use surfelcast_gpu::{Gpu, GpuOptions};
use surfelcast_measure::MeasureError;

/// Where results go.
#[derive(Debug, Args)]
pub(crate) struct OutputArgs {
    /// Folder for JSON, CSV and plots. A later run continues what is in it.
    #[arg(long, value_name = "DIR", default_value = "data/bench")]
    pub(crate) out: PathBuf,
    /// Folder of the pages; without it the tables are only printed.
    #[arg(long, value_name = "DIR")]
    docs: Option<PathBuf>,
    /// Take what is recorded, whatever commit and device it was measured with: the page states both.
    #[arg(long)]
    pub(crate) reuse: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

impl OutputArgs {
    /// Opens the device of the command line.
    pub(crate) fn gpu(&self) -> Result<Gpu, Failure> {
        open_gpu(&self.device)
    }

    /// The choice of the device, for the command line of the finished program.
    pub(crate) fn device_words(&self) -> Vec<String> {
        let adapter = self.device.adapter.iter().flat_map(|name| ["--adapter".to_owned(), name.clone()]);
        let memory = self.device.gpu_memory.iter().flat_map(|mib| ["--gpu-memory".to_owned(), mib.to_string()]);
        adapter.chain(memory).collect()
    }

    /// Opens the record of a study.
    pub(crate) fn record<T: Measured>(&self, study: &str) -> Result<Record<T>, Failure> {
        Record::open(&self.out.join(study).with_extension("json"), self.reuse)
    }

    /// Refuses a page of a part of the study.
    pub(crate) fn refuse_page_of_part(&self, option: &str) -> Result<(), Failure> {
        match &self.docs {
            Some(_) => {
                Err(Failure::input(format!("{option} leaves rows out: the page (--docs) is of the whole study")))
            }
            None => Ok(()),
        }
    }

    /// Prints the parts of a page, and writes the page and the plots that it shows.
    #[allow(clippy::print_stdout, reason = "the tables are the command's output")]
    pub(crate) fn publish(&self, page: &Page, parts: &[(&str, String)]) -> Result<(), Failure> {
        for (_, text) in parts {
            println!("{text}");
        }
        let Some(folder) = &self.docs else { return Ok(()) };
        let text = page.fill(parts)?;
        for plot in links(&text) {
            let drawn = self.out.join(plot);
            if drawn.extension().is_some_and(|ending| ending == "svg") && drawn.is_file() {
                write_file(&folder.join(plot), read_text(&drawn)?.as_bytes())?;
            }
        }
        write_file(&folder.join(page.name).with_extension("md"), text.as_bytes())
    }
}

/// Opens a device.
pub(crate) fn open_gpu(device: &DeviceArgs) -> Result<Gpu, Failure> {
    Ok(Gpu::open(&GpuOptions {
        adapter: device.adapter.clone(),
        memory_budget_bytes: device.memory_budget_bytes(),
        ..GpuOptions::default()
    })?)
}

/// A fault of a file that was to be measured.
#[allow(clippy::needless_pass_by_value, reason = "the form that `map_err` takes")]
pub(crate) fn input(error: MeasureError) -> Failure {
    Failure::input(error.to_string())
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

/// A number with that many digits, or a dash.
pub(crate) fn known(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}
