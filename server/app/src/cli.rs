//! The command line.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use surfelcast::args::{
    DeviceArgs, Materials, parse_error, parse_exposure, parse_secs, parse_size, preset_names, technique_ids,
};
use surfelcast_renderer::SurfelSettings;

/// Headless render server with global illumination.
#[derive(Debug, Parser)]
#[command(name = "surfelcast", version, about, propagate_version = true)]
pub(crate) struct Cli {
    /// Say more (twice: debug).
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub(crate) verbose: u8,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Serve scenes to browsers and pictures over HTTP.
    Serve(ServeArgs),
    /// Render one picture of a scene file.
    Render(Box<RenderArgs>),
    /// List adapters and limits, and say what is missing and how to get it.
    Doctor,
}

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Address to listen on; port 0 picks a free one.
    #[arg(long, default_value = "127.0.0.1:8080")]
    pub(crate) bind: SocketAddr,
    /// Folder for uploaded scenes and compiled pipelines.
    #[arg(long, default_value = "data")]
    pub(crate) data: PathBuf,
    /// Scene file to serve; may be given several times. Without it, the built-in demo scenes.
    #[arg(long = "scene", value_name = "FILE")]
    pub(crate) scenes: Vec<PathBuf>,
    /// Host name under which the server is reached, beside localhost and IP addresses; may be given several times.
    #[arg(long = "host", value_name = "NAME")]
    pub(crate) hosts: Vec<String>,
    /// Origin of pages that may connect, beside the server's own; may be given several times.
    #[arg(long = "allow-origin", value_name = "ORIGIN")]
    pub(crate) origins: Vec<String>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// Scene file, .glb or .gltf, or a built-in one: `demo:cornell_box`, `demo:interior`.
    pub(crate) scene: PathBuf,
    /// Picture to write; the ending chooses the format: png, jpg, webp or exr (linear, unexposed).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// View file with cameras, environment, exposure and instant; by default the .json beside the scene.
    #[arg(long, value_name = "FILE")]
    pub(crate) view: Option<PathBuf>,
    /// Camera by name; the first by default.
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,
    /// Picture size; by default the camera's own, else 1280x720.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Environment image, .hdr or .exr, equirectangular; replaces the view file's environment.
    #[arg(long, value_name = "FILE")]
    pub(crate) environment: Option<PathBuf>,
    /// Technique.
    #[arg(long, default_value = surfelcast_techniques::registry::DEFAULT_OF_JOBS, value_parser = technique_ids())]
    pub(crate) technique: String,
    /// Settings of the surfel cache; balanced by default.
    #[arg(long, value_parser = preset_names())]
    pub(crate) preset: Option<String>,
    /// How light is made of what surfels measured; the preset's by default.
    #[arg(long, value_parser = reconstruction_names())]
    pub(crate) reconstruction: Option<String>,
    /// Knob of the surfel cache as NAME=VALUE, such as radius=3; may be given several times. `surfelcast knobs` lists them.
    #[arg(long = "surfel", value_name = "NAME=VALUE", value_parser = parse_knob)]
    pub(crate) knobs: Vec<String>,
    /// Samples a pixel.
    #[arg(long, alias = "frames", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub(crate) spp: Option<u32>,
    /// Stop at this tone-mapped RMSE, as audited; in (0, 1].
    #[arg(long, value_name = "RMSE", value_parser = parse_error)]
    pub(crate) max_error: Option<f32>,
    /// Stop after this many seconds of rendering.
    #[arg(long, value_name = "SECS", value_parser = parse_secs)]
    pub(crate) time_limit: Option<f64>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Materials.
    #[arg(long, value_enum, default_value_t = Materials::Pbr)]
    pub(crate) materials: Materials,
    /// Exposure (linear factor) of display formats and of the error metric; by default the view file's, else 1.
    #[arg(long, value_parser = parse_exposure)]
    pub(crate) exposure: Option<f32>,
    /// Write this instead of radiance.
    #[arg(long, value_name = "NAME", value_parser = aov_names())]
    pub(crate) aov: Option<String>,
    /// Write the surfel cache here as a PLY point cloud: position, normal, radius, B, rays, variance.
    #[arg(long, value_name = "FILE.ply")]
    pub(crate) export_surfels: Option<PathBuf>,
    /// Write statistics here as JSON.
    #[arg(long, value_name = "FILE")]
    pub(crate) stats: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

fn reconstruction_names() -> clap::builder::PossibleValuesParser {
    surfelcast_techniques::Reconstruction::names().into()
}

fn parse_knob(text: &str) -> Result<String, String> {
    let mut settings = SurfelSettings::BALANCED;
    settings.turn(text).map(|()| text.to_owned())
}

fn aov_names() -> clap::builder::PossibleValuesParser {
    surfelcast_renderer::Aov::ALL.iter().map(|(name, _)| *name).collect::<Vec<_>>().into()
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
