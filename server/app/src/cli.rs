//! The command line. What it offers of techniques comes from the catalogue.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use surfelcast_render_api::Catalogue;

use crate::args::{
    DeviceArgs, Materials, output_names, parse_error, parse_exposure, parse_secs, parse_size, preset_names,
    reconstruction_names, technique_ids,
};

/// Headless render server with global illumination.
#[derive(Debug, Parser)]
#[command(name = "surfelcast", version, about, propagate_version = true)]
pub struct Cli {
    /// Say more (twice: debug).
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Serve scenes to browsers and pictures over HTTP.
    Serve(ServeArgs),
    /// Render one picture of a scene file.
    Render(Box<RenderArgs>),
    /// List the settings, presets and outputs of techniques, with units, defaults and ranges.
    Settings(SettingsArgs),
    /// List adapters and limits, and say what is missing and how to get it.
    Doctor,
}

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Address to listen on; port 0 picks a free one.
    #[arg(long, default_value = "127.0.0.1:8080")]
    pub bind: SocketAddr,
    /// Folder for uploaded scenes and compiled pipelines.
    #[arg(long, default_value = "data")]
    pub data: PathBuf,
    /// Scene file to serve; may be given several times. Without it, the built-in demo scenes.
    #[arg(long = "scene", value_name = "FILE")]
    pub scenes: Vec<PathBuf>,
    /// Host name under which the server is reached, beside localhost and IP addresses; may be given several times.
    #[arg(long = "host", value_name = "NAME")]
    pub hosts: Vec<String>,
    /// Origin of pages that may connect, beside the server's own; may be given several times.
    #[arg(long = "allow-origin", value_name = "ORIGIN")]
    pub origins: Vec<String>,
    /// Device.
    #[command(flatten)]
    pub device: DeviceArgs,
}

/// Arguments of `settings`.
#[derive(Debug, Args)]
pub struct SettingsArgs {
    /// Technique; all by default.
    pub technique: Option<String>,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene file, .glb or .gltf, or a built-in one: `demo:cornell_box`, `demo:interior`.
    pub scene: PathBuf,
    /// Picture to write; the ending chooses the format: png, jpg, webp or exr (linear, unexposed).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// View file with cameras, environment, exposure and instant; by default the .json beside the scene.
    #[arg(long, value_name = "FILE")]
    pub view: Option<PathBuf>,
    /// Camera by name; the first by default.
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Picture size; by default the camera's own, else 1280x720.
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Environment image, .hdr or .exr, equirectangular; replaces the view file's environment.
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,
    /// Technique.
    #[arg(long)]
    pub technique: Option<String>,
    /// Values of the technique's settings to start from.
    #[arg(long)]
    pub preset: Option<String>,
    /// The setting of this name, over the preset.
    #[arg(long)]
    pub reconstruction: Option<String>,
    /// Setting of the technique, over the preset, such as radius=3; may be given several times. `surfelcast settings`
    /// lists them.
    #[arg(long = "set", alias = "surfel", value_name = "NAME=VALUE")]
    pub settings: Vec<String>,
    /// Samples a pixel; 64 where no stop rule is given.
    #[arg(long, alias = "frames", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub spp: Option<u32>,
    /// Stop at this tone-mapped RMSE, as audited; in (0, 1].
    #[arg(long, value_name = "RMSE", value_parser = parse_error)]
    pub max_error: Option<f32>,
    /// Stop after this many seconds of rendering.
    #[arg(long, value_name = "SECS", value_parser = parse_secs)]
    pub time_limit: Option<f64>,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = surfelcast_render_api::resolve::DEFAULT_SEED)]
    pub seed: u64,
    /// Materials.
    #[arg(long, value_enum, default_value_t = Materials::Pbr)]
    pub materials: Materials,
    /// Exposure (linear factor) of display formats and of the error metric; by default the view file's, else 1.
    #[arg(long, value_parser = parse_exposure)]
    pub exposure: Option<f32>,
    /// Write this instead of radiance.
    #[arg(long, value_name = "NAME")]
    pub aov: Option<String>,
    /// Write what the technique exports here, such as a PLY point cloud; see `surfelcast settings`.
    #[arg(long, alias = "export-surfels", value_name = "FILE")]
    pub export: Option<PathBuf>,
    /// Write statistics here as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Device.
    #[command(flatten)]
    pub device: DeviceArgs,
}

/// The command line with what a catalogue offers.
pub fn command(catalogue: &Catalogue) -> clap::Command {
    Cli::command()
        .mut_subcommand("render", |render| {
            render
                .mut_arg("technique", |arg| {
                    arg.value_parser(technique_ids(catalogue)).default_value(catalogue.default_technique)
                })
                .mut_arg("preset", |arg| arg.value_parser(preset_names(catalogue)))
                .mut_arg("reconstruction", |arg| arg.value_parser(reconstruction_names(catalogue)))
                .mut_arg("aov", |arg| arg.value_parser(output_names(catalogue)))
        })
        .mut_subcommand("settings", |settings| {
            settings.mut_arg("technique", |arg| arg.value_parser(technique_ids(catalogue)))
        })
}

impl Cli {
    /// Reads the program's arguments; ends the program where they are wrong or ask for help.
    pub fn read(catalogue: &Catalogue) -> Self {
        let matches = command(catalogue).get_matches();
        Self::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
    }
}

#[cfg(test)]
mod tests {
    use surfelcast_techniques::{TECHNIQUES, registry};

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        command(&registry::catalogue(TECHNIQUES)).debug_assert();
    }

    #[test]
    fn earlier_names_of_options_are_understood() {
        let words = ["surfelcast", "render", "demo:cornell_box", "-o", "x.png", "--surfel", "radius=3"];
        let words = words.into_iter().chain(["--export-surfels", "x.ply", "--aov", "surfel_b"]);
        let matches = command(&registry::catalogue(TECHNIQUES)).get_matches_from(words);
        let Command::Render(args) = Cli::from_arg_matches(&matches).expect("valid").command else {
            panic!("another command");
        };
        assert_eq!((args.settings, args.export), (vec!["radius=3".to_owned()], Some("x.ply".into())));
        assert_eq!((args.aov.as_deref(), args.technique.as_deref()), (Some("surfel_b"), Some("path")));
    }
}
