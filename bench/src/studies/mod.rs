//! What is measured, one study a module.

mod accuracy;
mod apply;
mod error;
mod locality;
mod poisson;
mod rays;
mod scale;
mod strips;
mod surfels;

use std::path::Path;

use clap::Subcommand;
use surfelcast::Failure;
use surfelcast_measure::{Reference, shared_folder};

use crate::report::input;

/// One measurement.
#[derive(Debug, Subcommand)]
pub(crate) enum Study {
    /// Error of every reference image at rising sample counts, and what the audit says of it.
    Accuracy(accuracy::AccuracyArgs),
    /// Error of the surfel cache against references and against path tracing at equal rays.
    Surfels(surfels::SurfelsArgs),
    /// Error against seconds and rays, of every technique at growing budgets.
    Error(Box<error::ErrorArgs>),
    /// Time and memory against the size of scene and cache, and what a second camera adds.
    Scale(scale::ScaleArgs),
    /// Convergence of image-space Poisson solvers.
    Poisson(Box<poisson::PoissonArgs>),
    /// Time of gathering surfels and of drawing them, for the surfel counts of Noack 2022, Table 6.2.
    Apply(apply::ApplyArgs),
    /// Distance in memory between the surfels of neighbouring pixels, by where the first surfels are placed.
    Locality(locality::LocalityArgs),
    /// Rays per second on the GPU and by the CPU traversal of the same hierarchy.
    Rays(rays::RaysArgs),
    /// Frames of the surfel cache in motion, as contact sheets.
    Strips(strips::StripsArgs),
}

impl Study {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        match self {
            Self::Accuracy(args) => accuracy::run(args),
            Self::Surfels(args) => surfels::run(args),
            Self::Error(args) => error::run(args),
            Self::Scale(args) => scale::run(args),
            Self::Poisson(args) => poisson::run(args),
            Self::Apply(args) => apply::run(args),
            Self::Locality(args) => locality::run(args),
            Self::Rays(args) => rays::run(args),
            Self::Strips(args) => strips::run(args),
        }
    }
}

/// Every reference image.
fn references() -> Result<Vec<Reference>, Failure> {
    let shared = shared_folder(Path::new("..")).ok_or_else(|| {
        Failure::input(
            "there are no references here; set SURFELCAST_SHARED to a folder with references/ and scenes/, or put it \
             beside the repository as shared/",
        )
    })?;
    Reference::read_all(&shared).map_err(input)
}
