//! The surfel cache against references and against path tracing at equal rays, measured with the finished program.
//!
//! The cache is measured alone: images do not converge to the path-traced one (`settling=off`).

mod measure;
mod report;

use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use surfelcast::Failure;
use surfelcast_measure::{Mode, Point, Reference};

use crate::report::{Measured, Origin, OutputArgs, Page, Record, Table, input};
use crate::studies::references;
use measure::Programs;

pub(super) const PAGE: Page = Page { name: "surfels", template: include_str!("../../../pages/surfels.md.in") };

/// References of the gates, each with its limit of the tone-mapped RMSE once converged.
const GATES: [(&str, f64); 5] = [
    ("cornell_box_main_lambert", 0.02),
    ("bars_main_lambert", 0.03),
    ("classroom_main_lambert", 0.03),
    ("maze_small_near_lambert", 0.03),
    ("sponza_atrium_lambert", 0.03),
];
/// Radii in pixels whose cost and error are compared, on one reference.
const RADII: [f32; 4] = [2.0, 3.0, 5.0, 8.0];
const RADII_REFERENCE: &str = "bars_main_lambert";

/// One table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
enum Part {
    /// The references of the gates.
    Gates,
    /// Radii of surfels.
    Radii,
    /// Indirect light at every reference.
    Indirect,
}

#[derive(Debug, Args)]
pub(crate) struct SurfelsArgs {
    /// Table to measure; all by default.
    #[arg(long = "part", value_enum)]
    parts: Vec<Part>,
    /// References whose names contain this.
    #[arg(long, value_name = "NAME-PART")]
    only: Option<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// One row of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    result: Outcome,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Key {
    part: Part,
    /// The reference, or the radius.
    at: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Outcome {
    /// The cache after few and after many frames, and path tracing with the rays of the former.
    Gate { gate: f64, noise: f64, early: Point, late: Point, path: Point },
    /// The cache after few and after many frames.
    Radius { noise: f64, early: Point, late: Point },
    /// Errors at equal rays: image size, the cache, path tracing and its samples per pixel.
    Indirect { is_indirect: bool, size: [u32; 2], ours: f64, theirs: f64, samples: u32 },
}

impl Measured for Row {
    type Key = Key;

    fn key(&self) -> &Key {
        &self.key
    }

    fn origin(&self) -> &Origin {
        &self.origin
    }

    fn table(rows: &[Self]) -> Table {
        report::rows(rows)
    }
}

pub(crate) fn run(args: &SurfelsArgs) -> Result<(), Failure> {
    if args.only.is_some() {
        args.output.refuse_page_of_part("--only")?;
    }
    if !args.parts.is_empty() {
        args.output.refuse_page_of_part("--part")?;
    }
    let parts = if args.parts.is_empty() { Part::value_variants() } else { &args.parts };
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let origin = Origin::of(&args.output.gpu()?);
    let programs = Programs::find(&args.output.device_words())?;
    let references = references()?;
    let mut published = Vec::new();
    for &part in parts {
        let rows = places(part, &references)
            .into_iter()
            .filter(|(reference, _)| args.only.as_ref().is_none_or(|only| reference.name.contains(only)))
            .map(|(reference, at)| measure_row(&mut record, &origin, &programs, &Key { part, at }, reference))
            .collect::<Result<Vec<_>, Failure>>()?;
        published.push((report::name(part), report::markdown(part, &rows)));
    }
    args.output.publish(&PAGE, &published)
}

/// The rows of a table: the reference, and its place in the key.
fn places(part: Part, references: &[Reference]) -> Vec<(&Reference, String)> {
    let of_name = |name: &str| references.iter().find(|one| one.name == name);
    match part {
        Part::Gates => GATES.iter().filter_map(|(name, _)| Some((of_name(name)?, (*name).to_owned()))).collect(),
        Part::Radii => {
            let reference = of_name(RADII_REFERENCE);
            RADII.iter().filter_map(|radius| Some((reference?, radius.to_string()))).collect()
        }
        Part::Indirect => {
            let whole = references.iter().filter(|one| one.mode != Mode::Indirect);
            whole.map(|one| (one, one.name.clone())).collect()
        }
    }
}

#[allow(clippy::print_stderr, reason = "a study says how far it is")]
fn measure_row(
    record: &mut Record<Row>,
    origin: &Origin,
    programs: &Programs,
    key: &Key,
    reference: &Reference,
) -> Result<Row, Failure> {
    let row = record.find_or_measure(key, origin, || {
        let result = match key.part {
            Part::Gates => programs.gate(reference),
            Part::Radii => programs.radius(reference, &key.at),
            Part::Indirect => programs.indirect(reference),
        };
        Ok(Row { key: key.clone(), origin: origin.clone(), result: result.map_err(input)? })
    })?;
    eprintln!("{}: {:?}", row.key.at, row.result);
    Ok(row.clone())
}
