//! What is measured, one study a module.

mod accuracy;
mod apply;
mod curves;
mod densities;
mod error;
mod image;
mod locality;
mod peers;
mod poisson;
mod presets;
mod rays;
mod reconstructions;
mod scale;
mod settling;
mod strips;
mod surfels;

use std::path::Path;

use clap::Subcommand;
use surfelcast::Failure;
use surfelcast_measure::{Reference, shared_folder};

use crate::report::input;
use curves::CurvesArgs;

/// The pages of docs/bench.
#[cfg(test)]
pub(crate) const PAGES: [crate::report::Page; 15] = [
    accuracy::PAGE,
    apply::PAGE,
    densities::QUESTION.page,
    error::QUESTION.page,
    image::QUESTION.page,
    locality::PAGE,
    peers::QUESTION.page,
    poisson::PAGE,
    presets::QUESTION.page,
    rays::PAGE,
    reconstructions::QUESTION.page,
    scale::PAGE,
    settling::QUESTION.page,
    settling::SMALL.page,
    surfels::PAGE,
];

/// One measurement.
#[derive(Debug, Subcommand)]
pub(crate) enum Study {
    /// Error of every reference image at rising sample counts, and of the audit.
    Accuracy(Box<accuracy::AccuracyArgs>),
    /// Error of the surfel cache against references and against path tracing at equal rays.
    Surfels(Box<surfels::SurfelsArgs>),
    /// Error against seconds and rays, of every technique and reconstruction.
    Error(Box<CurvesArgs>),
    /// Error and time of the presets of the surfel cache.
    Presets(Box<CurvesArgs>),
    /// Error by capacity and density of surfels, as in table 6.1 of Noack 2022.
    Densities(Box<CurvesArgs>),
    /// Seconds to an error next to other renderers, from an empty cache and from a warm one.
    Peers(Box<peers::PeersArgs>),
    /// Error of an image that converges to the path-traced one, next to the cache alone and path tracing.
    Settling(Box<CurvesArgs>),
    /// The same in images 32 pixels wide, for every reference.
    SettlingSmall(Box<CurvesArgs>),
    /// Error of indirect light by each reconstruction and by path tracing, at equal rays.
    Reconstructions(Box<CurvesArgs>),
    /// Error of indirect light reconstructed in the image, from the published scheme to ours.
    Image(Box<CurvesArgs>),
    /// Time and memory against the size of scene and cache, and what a second camera adds.
    Scale(Box<scale::ScaleArgs>),
    /// Convergence of image-space Poisson solvers.
    Poisson(Box<poisson::PoissonArgs>),
    /// Time of gathering surfels and of drawing them, for the surfel counts of Noack 2022, Table 6.2.
    Apply(Box<apply::ApplyArgs>),
    /// Distance in memory between the surfels of neighbouring pixels, by where the first surfels are placed.
    Locality(Box<locality::LocalityArgs>),
    /// Rays per second on the GPU and by the CPU traversal of the same hierarchy.
    Rays(Box<rays::RaysArgs>),
    /// Frames of the surfel cache in motion, as contact sheets.
    Strips(strips::StripsArgs),
}

impl Study {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        match self {
            Self::Accuracy(args) => accuracy::run(args),
            Self::Surfels(args) => surfels::run(args),
            Self::Error(args) => error::run(args),
            Self::Presets(args) => presets::run(args),
            Self::Densities(args) => densities::run(args),
            Self::Peers(args) => peers::run(args),
            Self::Settling(args) => settling::run(args),
            Self::SettlingSmall(args) => settling::run_small(args),
            Self::Reconstructions(args) => reconstructions::run(args),
            Self::Image(args) => image::run(args),
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
             next to the repository as shared/",
        )
    })?;
    Reference::read_all(&shared).map_err(input)
}
