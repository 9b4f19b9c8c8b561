//! `surfelcast-bench scale`: cost against size.
//!
//! Four rows of measurements in the same room: more triangles, more room for surfels, smaller surfels, more cameras that
//! have been there before. Then what a second camera adds on a session that has converged. A frame's time is the median
//! over several, since a software GPU shares its cores.

mod scene;
mod second_camera;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::report::chart::{Chart, ChartPoint, Series};
use clap::Args;
use serde::{Deserialize, Serialize};
use surfelcast_gpu::Gpu;
use surfelcast_measure::Mode;
use surfelcast_measure::fit::exponent;
use surfelcast_scene::Scene;
use surfelcast_techniques::{SessionState, SurfelSettings};

use crate::report::{OutputArgs, device_name, progress_bar, read_record, write_record};
use crate::stage::{Cost, Shot, Stage};
use crate::studies::scale::scene::{camera, tessellated_room};
use surfelcast::Failure;
use surfelcast::args::parse_size;

/// The technique under test, and the one that is compared with it where triangles grow.
pub(super) const SURFEL: &str = "surfel";
const PATH: &str = "path";
/// The pass that looks surfels up for pixels.
const LOOKUP_PASS: &str = "surfel_shade";
/// Frames before those that are timed: the first ones spawn.
const FRAMES_BEFORE: u32 = 8;
/// Frames of each camera that has been there before.
const FRAMES_OF_OTHERS: u32 = 4;
pub(super) const SEED: u64 = 1;
/// Name of the markers and of the record.
const NAME: &str = "scale";

#[derive(Debug, Args)]
pub(crate) struct ScaleArgs {
    /// Triangles of the room.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [10_000, 30_000, 100_000, 300_000, 1_000_000],
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
    /// Cameras that have been in the room before.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [0, 1, 2, 4, 8, 16],
          value_parser = clap::value_parser!(u32).range(0..=256))]
    cameras: Vec<u32>,
    /// Triangles of the room in all rows but the first.
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(1_000..=16_000_000))]
    room: u32,
    /// Picture size.
    #[arg(long, value_name = "WxH", default_value = "256x192", value_parser = parse_size)]
    size: [u32; 2],
    /// Frames that are timed.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
    #[command(flatten)]
    output: OutputArgs,
}

fn parse_radius(text: &str) -> Result<f32, String> {
    let mut settings = SurfelSettings::BALANCED;
    settings.turn(&format!("radius={text}")).map(|()| settings.radius_pixels)
}

/// One measurement: where it stands in its row, under which conditions, and what came out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Row {
    key: Key,
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
    device: String,
    version: String,
}

/// What is measured, with its value.
#[derive(Clone, Copy)]
enum Point {
    Triangles(u32),
    Capacity(u32),
    Radius(f32),
    Cameras(u32),
    SecondCamera,
}

impl Point {
    fn series(self) -> &'static str {
        match self {
            Self::Triangles(_) => "triangles",
            Self::Capacity(_) => "capacity",
            Self::Radius(_) => "radius",
            Self::Cameras(_) => "cameras",
            Self::SecondCamera => "second_camera",
        }
    }

    fn at(self) -> String {
        match self {
            Self::Triangles(count) | Self::Cameras(count) => count.to_string(),
            Self::Capacity(power) => (1_u32 << power).to_string(),
            Self::Radius(radius) => radius.to_string(),
            Self::SecondCamera => "1".to_owned(),
        }
    }

    fn measure(self, stage: &Stage<'_>, frames: u32) -> Result<BTreeMap<String, f64>, Failure> {
        let settings = SurfelSettings::default();
        match self {
            Self::SecondCamera => second_camera::measure(stage, frames),
            Self::Triangles(_) => {
                let mut values = measure_surfels(stage, settings, 0, frames)?;
                let mut shot = stage.shot(PATH, settings, camera(0), SEED, &SessionState::default())?;
                values.insert("path_ms".to_owned(), median_frame(&mut shot, 1, frames)?.secs * 1e3);
                values.insert("triangles".to_owned(), f64::from(stage.scene.summary.triangle_count));
                values.insert("build_secs".to_owned(), stage.scene.build_secs);
                Ok(values)
            }
            Self::Capacity(power) => {
                measure_surfels(stage, SurfelSettings { capacity: 1 << power, ..settings }, 0, frames)
            }
            Self::Radius(radius) => {
                measure_surfels(stage, SurfelSettings { radius_pixels: radius, ..settings }, 0, frames)
            }
            Self::Cameras(others) => measure_surfels(stage, settings, others, frames),
        }
    }
}

/// Cost of a frame.
fn between(before: &Cost, after: &Cost) -> Cost {
    let pass_ms = |cost: &Cost, name: &str| cost.passes.iter().find(|pass| pass.name == name).map_or(0.0, |p| p.gpu_ms);
    Cost {
        secs: after.secs - before.secs,
        gpu_secs: after.gpu_secs - before.gpu_secs,
        rays: [0, 1, 2].map(|i| after.rays[i] - before.rays[i]),
        non_finite: after.non_finite - before.non_finite,
        passes: after
            .passes
            .iter()
            .map(|pass| {
                let mut pass = pass.clone();
                pass.gpu_ms -= pass_ms(before, &pass.name);
                pass
            })
            .collect(),
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Renders so many frames and then so many more; medians over the latter.
fn median_frame(shot: &mut Shot<'_>, before: u32, frames: u32) -> Result<Cost, Failure> {
    let mut costs = Vec::new();
    shot.render(before, f64::INFINITY)?;
    for frame in 1..=frames {
        let cost = shot.cost.clone();
        shot.render(before + frame, f64::INFINITY)?;
        costs.push(between(&cost, &shot.cost));
    }
    let over = |value: &dyn Fn(&Cost) -> f64| median(costs.iter().map(value).collect());
    let names = costs.last().map(|cost| cost.passes.clone()).unwrap_or_default();
    Ok(Cost {
        secs: over(&|cost| cost.secs),
        gpu_secs: over(&|cost| cost.gpu_secs),
        rays: [0, 1, 2].map(|i| over(&|cost| cost.rays[i] as f64) as u64),
        non_finite: costs.iter().map(|cost| cost.non_finite).sum(),
        passes: names
            .into_iter()
            .map(|mut pass| {
                let of = |cost: &Cost| cost.passes.iter().find(|one| one.name == pass.name).map_or(0.0, |p| p.gpu_ms);
                pass.gpu_ms = median(costs.iter().map(of).collect());
                pass
            })
            .collect(),
    })
}

/// Time and memory of frames on a session that other cameras have used before.
fn measure_surfels(
    stage: &Stage<'_>,
    settings: SurfelSettings,
    others: u32,
    frames: u32,
) -> Result<BTreeMap<String, f64>, Failure> {
    let session = SessionState::default();
    for other in 1..=others {
        let mut shot = stage.shot(SURFEL, settings, camera(other), SEED, &session)?;
        shot.render(FRAMES_OF_OTHERS, f64::INFINITY)?;
    }
    let mut shot = stage.shot(SURFEL, settings, camera(0), SEED, &session)?;
    let cost = median_frame(&mut shot, FRAMES_BEFORE, frames)?;
    let lookup_ms = cost.passes.iter().find(|pass| pass.name == LOOKUP_PASS).map_or(0.0, |pass| pass.gpu_ms);
    let pixels = f64::from(stage.size[0]) * f64::from(stage.size[1]);
    let memory = stage.gpu.memory();
    let values = [
        ("frame_ms", cost.secs * 1e3),
        ("gpu_ms", cost.gpu_secs * 1e3),
        ("lookup_ns_a_pixel", lookup_ms * 1e6 / pixels),
        ("cache_rays", cost.rays[1] as f64),
        ("surfels", f64::from(shot.surfels().unwrap_or(0))),
        ("scene_mib", memory.scene_bytes as f64 / f64::from(1 << 20)),
        ("session_mib", memory.session_bytes as f64 / f64::from(1 << 20)),
    ];
    Ok(values.map(|(name, value)| (name.to_owned(), value)).into())
}

pub(crate) fn run(args: &ScaleArgs) -> Result<(), Failure> {
    args.output.table.check(NAME)?;
    let gpu = args.output.gpu()?;
    let path = args.output.out.join(NAME).with_extension("json");
    let mut rows: Vec<Row> = read_record(&path)?;
    let points: Vec<Point> = (args.triangles.iter().map(|&count| Point::Triangles(count)))
        .chain(args.capacities.iter().map(|&power| Point::Capacity(power)))
        .chain(args.radii.iter().map(|&radius| Point::Radius(radius)))
        .chain(args.cameras.iter().map(|&count| Point::Cameras(count)))
        .chain([Point::SecondCamera])
        .collect();
    let bar = progress_bar(points.len() as u64);
    let mut current: Vec<Row> = Vec::new();
    // The room of most points is made once.
    let mut held: Option<(u32, Scene)> = None;
    for point in points {
        let triangles = if let Point::Triangles(count) = point { count } else { args.room };
        let key = Key {
            series: point.series().to_owned(),
            at: point.at(),
            triangles,
            size: args.size,
            frames: args.frames,
            device: device_name(&gpu),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        bar.set_message(format!("{} {}", key.series, key.at));
        if !rows.iter().any(|row| row.key == key) {
            if held.as_ref().is_none_or(|(count, _)| *count != triangles) {
                held = Some((triangles, tessellated_room(triangles)?));
            }
            if let Some((_, scene)) = &held {
                let (values, refusal) = match (point, measure(&gpu, scene, args, point)) {
                    // A cache may be larger than what this device binds at once: that is a result too.
                    (Point::Capacity(_), Err(Failure::Input(reason))) => (BTreeMap::new(), Some(reason)),
                    (_, outcome) => (outcome?, None),
                };
                rows.push(Row { key: key.clone(), values, refusal });
                write_record(&path, &rows, &csv(&rows))?;
            }
        }
        current.extend(rows.iter().find(|row| row.key == key).cloned());
        bar.inc(1);
    }
    bar.finish_and_clear();
    charts(&current, args)?;
    args.output.table.publish(NAME, &markdown(&current, args))
}

/// A stage of its own for each point, so that nothing of the one before is still held.
fn measure(gpu: &Gpu, scene: &Scene, args: &ScaleArgs, point: Point) -> Result<BTreeMap<String, f64>, Failure> {
    let stage = Stage::new(gpu, scene, Mode::Lambert, args.size, 1.0)?;
    // Compiles what will run.
    stage
        .shot(SURFEL, SurfelSettings::default(), camera(0), SEED, &SessionState::default())?
        .render(1, f64::INFINITY)?;
    point.measure(&stage, args.frames)
}

/// One line a value.
fn csv(rows: &[Row]) -> String {
    let mut text = "series,at,triangles,width,height,frames,quantity,value,device,version\n".to_owned();
    for Row { key, values, .. } in rows {
        for (name, value) in values {
            let [width, height] = key.size;
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{},{},{},{width},{height},{},{name},{value:.6e},\"{}\",{}",
                key.series, key.at, key.triangles, key.frames, key.device, key.version
            );
        }
    }
    text
}

/// Points (x, y) of a row of measurements.
fn pairs(rows: &[Row], series: &str, x: &str, y: &str) -> Vec<(f64, f64)> {
    rows.iter()
        .filter(|row| row.key.series == series)
        .filter_map(|row| Some((*row.values.get(x)?, *row.values.get(y)?)))
        .collect()
}

/// The exponent of y = a x^b over a row.
fn growth(rows: &[Row], series: &str, x: &str, y: &str) -> String {
    exponent(&pairs(rows, series, x, y)).map_or_else(|| "-".to_owned(), |exponent| format!("{exponent:.2}"))
}

fn markdown(rows: &[Row], args: &ScaleArgs) -> String {
    let [width, height] = args.size;
    let device = rows.first().map(|row| row.key.device.as_str()).unwrap_or_default();
    let mut text = format!(
        "{device}; {width} x {height}, `balanced`; medians of {} frames after {FRAMES_BEFORE}; in all tables but the first the \
         room has {} triangles.\n",
        args.frames, args.room
    );
    let mut table = |title: String, series: &str, columns: &[(&str, &str, usize)]| {
        let heads: Vec<_> = columns.iter().map(|(head, ..)| *head).collect();
        let _ = writeln!(text, "\n{title}\n\n| {} |\n|{}", heads.join(" | "), "---|".repeat(heads.len()));
        let mut refusals = Vec::new();
        for row in rows.iter().filter(|row| row.key.series == series) {
            if let Some(reason) = &row.refusal {
                refusals.push(format!("\n{}: {reason}.\n", row.key.at));
                continue;
            }
            let cells: Vec<_> = columns
                .iter()
                .map(|(_, name, digits)| match row.values.get(*name) {
                    Some(value) => format!("{value:.digits$}"),
                    None => row.key.at.clone(),
                })
                .collect();
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text += &refusals.concat();
    };
    table(
        format!(
            "Triangles. A frame's time grows with their number to the power of {} (`path`: {}); below 1 is asked.",
            growth(rows, "triangles", "triangles", "frame_ms"),
            growth(rows, "triangles", "triangles", "path_ms"),
        ),
        "triangles",
        &[
            ("triangles", "triangles", 0),
            ("surfels", "surfels", 0),
            ("ms a frame", "frame_ms", 1),
            ("of that GPU", "gpu_ms", 1),
            ("`path`, ms a sample", "path_ms", 1),
            ("lookup, ns a pixel", "lookup_ns_a_pixel", 0),
            ("scene, MiB", "scene_mib", 1),
            ("hierarchy, s", "build_secs", 2),
        ],
    );
    let cache = |first: (&'static str, &'static str)| {
        [
            (first.0, first.1, 0),
            ("surfels", "surfels", 0),
            ("ms a frame", "frame_ms", 1),
            ("of that GPU", "gpu_ms", 1),
            ("lookup, ns a pixel", "lookup_ns_a_pixel", 0),
            ("rays of the cache", "cache_rays", 0),
            ("session, MiB", "session_mib", 1),
        ]
    };
    table("Capacity, at the same number of surfels.".to_owned(), "capacity", &cache(("capacity", "")));
    table(
        format!(
            "Surfels, by their radius. With their number a frame's time grows to the power of {}, the lookup of a pixel to \
             that of {}; at most 1 is asked.",
            growth(rows, "radius", "surfels", "frame_ms"),
            growth(rows, "radius", "surfels", "lookup_ns_a_pixel"),
        ),
        "radius",
        &cache(("radius, pixels", "")),
    );
    table(
        format!(
            "Surfels, by cameras that have been there before. Powers of a frame and of a lookup: {} and {}.",
            growth(rows, "cameras", "surfels", "frame_ms"),
            growth(rows, "cameras", "surfels", "lookup_ns_a_pixel"),
        ),
        "cameras",
        &cache(("cameras before", "")),
    );
    if let Some(row) = rows.iter().find(|row| row.key.series == "second_camera") {
        text += &second_camera::markdown(&row.values, args.frames);
    }
    text
}

fn charts(rows: &[Row], args: &ScaleArgs) -> Result<(), Failure> {
    let series = |label: &str, points: Vec<(f64, f64)>| Series {
        label: label.to_owned(),
        points: points.into_iter().map(|(x, y)| ChartPoint { x, y, std_error: 0.0 }).collect(),
    };
    let chart = |file: &str, title: &str, x_label: &str, y_label: &str, series: Vec<Series>| {
        Chart {
            title: title.to_owned(),
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            series,
            level: None,
            shows_front: false,
            shows_agreement: false,
        }
        .write(&args.output.out.join(format!("{NAME}-{file}.svg")))
    };
    chart(
        "triangles",
        "Time against triangles",
        "triangles",
        "ms",
        vec![
            series("surfel, a frame", pairs(rows, "triangles", "triangles", "frame_ms")),
            series("path, a sample", pairs(rows, "triangles", "triangles", "path_ms")),
        ],
    )?;
    chart(
        "frame",
        "Frame time against surfels",
        "surfels",
        "ms a frame",
        vec![
            series("by radius", pairs(rows, "radius", "surfels", "frame_ms")),
            series("by cameras before", pairs(rows, "cameras", "surfels", "frame_ms")),
        ],
    )?;
    chart(
        "lookup",
        "Lookup of a pixel against surfels",
        "surfels",
        "ns a pixel",
        vec![
            series("by radius", pairs(rows, "radius", "surfels", "lookup_ns_a_pixel")),
            series("by cameras before", pairs(rows, "cameras", "surfels", "lookup_ns_a_pixel")),
        ],
    )?;
    let memory = rows
        .iter()
        .filter(|row| row.key.series == "capacity")
        .filter_map(|row| Some((row.key.at.parse().ok()?, *row.values.get("session_mib")?)))
        .collect();
    let frames = rows
        .iter()
        .filter(|row| row.key.series == "capacity")
        .filter_map(|row| Some((row.key.at.parse().ok()?, *row.values.get("frame_ms")?)))
        .collect();
    chart(
        "capacity",
        "Room for surfels",
        "surfels that fit",
        "MiB, ms",
        vec![series("session memory, MiB", memory), series("a frame, ms", frames)],
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_what_lies_between() {
        let cost = |secs: f64, ms: f64, rays: u64| Cost {
            secs,
            gpu_secs: secs / 2.0,
            rays: [rays; 3],
            non_finite: 0,
            passes: vec![surfelcast_gpu::PassTime { name: LOOKUP_PASS.to_owned(), gpu_ms: ms, dispatches: 1 }],
        };
        let frame = between(&cost(1.0, 10.0, 5), &cost(1.5, 30.0, 9));
        assert!((frame.secs - 0.5).abs() < 1e-12 && frame.rays == [4; 3]);
        assert!((frame.passes[0].gpu_ms - 20.0).abs() < 1e-12);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
    }
}
