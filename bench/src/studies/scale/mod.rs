//! `surfelcast-bench scale`: cost against size.
//!
//! Four series of measurements in the same room: more triangles, more capacity of the cache, smaller surfels, more
//! cameras that have been there before. Then what a second camera adds on a converged session. A frame's time is the
//! median over several, since a software GPU shares its cores.

mod measure;
mod report;
mod scene;
mod second_camera;

use std::collections::BTreeMap;

use clap::Args;
use serde::{Deserialize, Serialize};
use surfelcast::Failure;
use surfelcast::args::parse_size;
use surfelcast_render_api::Settings;
use surfelcast_scene::Scene;
use surfelcast_techniques::surfel::{ENTRY, SurfelSettings};

use crate::report::{Measured, Origin, OutputArgs, Page, Table, progress_bar};
use measure::Point;
use scene::tessellated_room;

pub(super) const PAGE: Page = Page { name: "scale", template: include_str!("../../../pages/scale.md.in") };

#[derive(Debug, Args)]
pub(crate) struct ScaleArgs {
    /// Triangles of the room.
    #[arg(long, value_name = "N,...", value_delimiter = ',',
          default_values_t = [10_000, 30_000, 100_000, 300_000, 1_000_000],
          value_parser = clap::value_parser!(u32).range(1_000..=16_000_000))]
    triangles: Vec<u32>,
    /// Capacities of the cache, as powers of two.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [16, 17, 18, 19, 20, 21, 22],
          value_parser = clap::value_parser!(u32).range(16..=22))]
    capacities: Vec<u32>,
    /// Radii of surfels, pixels: the smaller, the more surfels.
    #[arg(long, value_name = "R,...", value_delimiter = ',', default_values_t = [16.0, 11.0, 8.0, 5.0, 3.0, 2.0, 1.5],
          value_parser = parse_radius)]
    radii: Vec<f32>,
    /// Cameras that have rendered the room before.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [0, 1, 2, 4, 8, 16],
          value_parser = clap::value_parser!(u32).range(0..=256))]
    cameras: Vec<u32>,
    /// Triangles of the room in all series but the first.
    #[arg(long, value_name = "N", default_value_t = 100_000,
          value_parser = clap::value_parser!(u32).range(1_000..=16_000_000))]
    room: u32,
    /// Image size.
    #[arg(long, value_name = "WxH", default_value = "256x192", value_parser = parse_size)]
    size: [u32; 2],
    /// Frames that are timed.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    #[command(flatten)]
    output: OutputArgs,
}

fn parse_radius(text: &str) -> Result<f32, String> {
    let mut settings = Settings::default();
    let set = settings.set_text(ENTRY.description.settings, &format!("radius={text}"));
    set.map(|()| SurfelSettings::from(&settings).radius_pixels).map_err(|fault| fault.to_string())
}

/// One measurement: under which conditions, and the results by name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
    origin: Origin,
    values: BTreeMap<String, f64>,
    /// Why there are no values.
    refusal: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Key {
    series: String,
    at: String,
    triangles: u32,
    size: [u32; 2],
    frames: u32,
}

impl Measured for Row {
    type Key = Key;

    fn key(&self) -> &Key {
        &self.key
    }

    fn origin(&self) -> &Origin {
        &self.origin
    }

    /// One line a value.
    fn table(rows: &[Self]) -> Table {
        let columns =
            ["series", "at", "triangles", "width", "height", "frames", "quantity", "value", "commit", "device"];
        let mut table = Table::new(columns);
        for Self { key, origin, values, .. } in rows {
            for (name, value) in values {
                table.push([
                    key.series.clone(),
                    key.at.clone(),
                    key.triangles.to_string(),
                    key.size[0].to_string(),
                    key.size[1].to_string(),
                    key.frames.to_string(),
                    name.clone(),
                    format!("{value:.6e}"),
                    origin.commit.clone(),
                    origin.device.clone(),
                ]);
            }
        }
        table
    }
}

pub(crate) fn run(args: &ScaleArgs) -> Result<(), Failure> {
    let mut record = args.output.record::<Row>(PAGE.name)?;
    let gpu = args.output.gpu()?;
    let origin = Origin::of(&gpu);
    let points: Vec<Point> = (args.triangles.iter().map(|&count| Point::Triangles(count)))
        .chain(args.capacities.iter().map(|&power| Point::Capacity(power)))
        .chain(args.radii.iter().map(|&radius| Point::Radius(radius)))
        .chain(args.cameras.iter().map(|&count| Point::Cameras(count)))
        .chain([Point::SecondCamera])
        .collect();
    let bar = progress_bar(points.len() as u64);
    let mut rows: Vec<Row> = Vec::new();
    // Most points share one room, which is made once.
    let mut held: Option<(u32, Scene)> = None;
    for point in points {
        let triangles = if let Point::Triangles(count) = point { count } else { args.room };
        let key =
            Key { series: point.series().to_owned(), at: point.at(), triangles, size: args.size, frames: args.frames };
        bar.set_message(format!("{} {}", key.series, key.at));
        let row = record.find_or_measure(&key, &origin, || {
            let scene = match held.take() {
                Some((count, scene)) if count == triangles => scene,
                _ => tessellated_room(triangles)?,
            };
            let outcome = measure::measure(&gpu, &scene, args.size, args.frames, point);
            held = Some((triangles, scene));
            let (values, refusal) = match (point, outcome) {
                // A cache may be larger than what this device binds at once: that is a result too.
                (Point::Capacity(_), Err(Failure::Input(reason))) => (BTreeMap::new(), Some(reason)),
                (_, outcome) => (outcome?, None),
            };
            Ok(Row { key: key.clone(), origin: origin.clone(), values, refusal })
        })?;
        rows.push(row.clone());
        bar.inc(1);
    }
    bar.finish_and_clear();
    report::charts(&rows, &args.output.out)?;
    args.output.publish(&PAGE, &[(PAGE.name, report::markdown(&rows, args))])
}
