//! Renders every reference camera at rising sample counts and writes the table of errors into a document.
//!
//! `accuracy-table DOCUMENT [--spp 16,64,256] [--only NAME-PART] [--technique path]`; `-` as document prints the table.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a command talks to its terminal")]

use std::fs;
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail, ensure};
use surfelcast_tests::accuracy::{Measurement, Reference, Renderer, markdown, replace_between_markers, shared_folder};

struct Arguments {
    document: String,
    samples: Vec<u32>,
    only: String,
    technique: String,
}

fn arguments() -> Result<Arguments> {
    let mut parsed = Arguments {
        document: String::new(),
        samples: vec![16, 64, 256],
        only: String::new(),
        technique: "path".to_owned(),
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().with_context(|| format!("{word} needs a value"));
        match word.as_str() {
            "--spp" => {
                let list: Result<Vec<u32>, _> = value()?.split(',').map(str::parse).collect();
                parsed.samples = list.context("--spp takes whole numbers with commas between them")?;
            }
            "--only" => parsed.only = value()?,
            "--technique" => parsed.technique = value()?,
            _ if parsed.document.is_empty() && !word.starts_with("--") => parsed.document = word,
            _ => bail!("{word} is unknown"),
        }
    }
    ensure!(
        !parsed.document.is_empty(),
        "usage: accuracy-table DOCUMENT [--spp 16,64,256] [--only NAME-PART] [--technique ID]"
    );
    Ok(parsed)
}

fn run() -> Result<()> {
    let arguments = arguments()?;
    let shared = shared_folder().context(
        "no references: set SURFELCAST_SHARED to a folder with references/ and scenes/, or put it beside the repository as shared/",
    )?;
    let renderer = Renderer::find(&arguments.technique)?;
    let mut measurements = Vec::new();
    for reference in Reference::read_all(&shared)?.iter().filter(|one| one.name.contains(&arguments.only)) {
        let mut points = Vec::new();
        for &samples in &arguments.samples {
            let point = renderer.measure(reference, samples).with_context(|| reference.name.clone())?;
            eprintln!(
                "{} {samples} spp: RMSE {:.5}, ratio {:.3}, bias {:+.2} % ({:+.1} errors), {:.1} s",
                reference.name,
                point.rmse,
                point.ratio(reference.noise_rmse),
                100.0 * point.bias,
                point.bias_in_errors,
                point.render_secs
            );
            points.push(point);
        }
        measurements.push(Measurement { name: reference.name.clone(), reference_noise: reference.noise_rmse, points });
    }
    ensure!(!measurements.is_empty(), "no reference's name contains {:?}", arguments.only);
    let table = markdown(&measurements);
    if arguments.document == "-" {
        print!("{table}");
    } else {
        let document = fs::read_to_string(&arguments.document)?;
        fs::write(&arguments.document, replace_between_markers(&document, "accuracy", &table)?)?;
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("accuracy-table: {error:#}");
            ExitCode::from(2)
        }
    }
}
