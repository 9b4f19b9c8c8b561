//! Tables and plots of the series.

use std::path::Path;

use surfelcast::Failure;
use surfelcast_measure::fit::exponent;

use crate::report::chart::{Chart, ChartPoint, Series};
use crate::report::{Table, describe};
use crate::studies::scale::measure::FRAMES_BEFORE;
use crate::studies::scale::{PAGE, Row, ScaleArgs, second_camera};

/// Points (x, y) of a series.
fn pairs(rows: &[Row], series: &str, x: &str, y: &str) -> Vec<(f64, f64)> {
    rows.iter()
        .filter(|row| row.key.series == series)
        .filter_map(|row| Some((*row.values.get(x)?, *row.values.get(y)?)))
        .collect()
}

/// The exponent of y = a x^b over a series.
fn growth(rows: &[Row], series: &str, x: &str, y: &str) -> String {
    exponent(&pairs(rows, series, x, y)).map_or_else(|| "-".to_owned(), |exponent| format!("{exponent:.2}"))
}

/// The rows of a series under named columns: (title, value, digits). A column without a value states the point.
fn table(rows: &[Row], series: &str, columns: &[(&str, &str, usize)]) -> String {
    let mut table = Table::new(columns.iter().map(|(title, ..)| *title));
    let mut refusals = String::new();
    for row in rows.iter().filter(|row| row.key.series == series) {
        if let Some(reason) = &row.refusal {
            refusals.extend(["\n", &row.key.at, ": ", reason, ".\n"]);
            continue;
        }
        table.push(columns.iter().map(|(_, name, digits)| match row.values.get(*name) {
            Some(value) => format!("{value:.digits$}"),
            None => row.key.at.clone(),
        }));
    }
    table.markdown() + &refusals
}

/// The table of a series whose scene stays the same.
fn cache_table(rows: &[Row], series: &str, title: &str) -> String {
    let columns = [
        (title, "", 0),
        ("surfels", "surfels", 0),
        ("ms a frame", "frame_ms", 1),
        ("of that GPU", "gpu_ms", 1),
        ("lookup, ns a pixel", "lookup_ns_a_pixel", 0),
        ("rays of the cache", "cache_rays", 0),
        ("session, MiB", "session_mib", 1),
    ];
    table(rows, series, &columns)
}

pub(super) fn markdown(rows: &[Row], args: &ScaleArgs) -> String {
    let [width, height] = args.size;
    let conditions = [
        format!("{width} x {height}, `balanced`"),
        format!("medians of {} frames after {FRAMES_BEFORE}", args.frames),
        format!("in all tables but the first the room has {} triangles", args.room),
    ];
    let triangles = [
        ("triangles", "triangles", 0),
        ("surfels", "surfels", 0),
        ("ms a frame", "frame_ms", 1),
        ("of that GPU", "gpu_ms", 1),
        ("`path`, ms a sample", "path_ms", 1),
        ("lookup, ns a pixel", "lookup_ns_a_pixel", 0),
        ("scene, MiB", "scene_mib", 1),
        ("hierarchy, s", "build_secs", 2),
    ];
    let parts = [
        describe(rows.iter().map(|row| &row.origin), &conditions),
        format!(
            "Triangles. The time of a frame grows with their number to the power of {} (`path`: {}); below 1 is \
             required.\n\n",
            growth(rows, "triangles", "triangles", "frame_ms"),
            growth(rows, "triangles", "triangles", "path_ms"),
        ),
        table(rows, "triangles", &triangles),
        "\nCapacity, at the same number of surfels.\n\n".to_owned(),
        cache_table(rows, "capacity", "capacity"),
        format!(
            "\nSurfels, by their radius. The time of a frame grows with their number to the power of {}, the lookup of \
             a pixel to that of {}; at most 1 is required.\n\n",
            growth(rows, "radius", "surfels", "frame_ms"),
            growth(rows, "radius", "surfels", "lookup_ns_a_pixel"),
        ),
        cache_table(rows, "radius", "radius, pixels"),
        format!(
            "\nSurfels, by the number of cameras before. Powers of a frame and of a lookup: {} and {}.\n\n",
            growth(rows, "cameras", "surfels", "frame_ms"),
            growth(rows, "cameras", "surfels", "lookup_ns_a_pixel"),
        ),
        cache_table(rows, "cameras", "cameras before"),
    ];
    let second = rows.iter().find(|row| row.key.series == "second_camera");
    parts.concat() + &second.map_or_else(String::new, |row| second_camera::markdown(&row.values, args.frames))
}

pub(super) fn charts(rows: &[Row], folder: &Path) -> Result<(), Failure> {
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
        .write(&folder.join(format!("{}-{file}.svg", PAGE.name)))
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
        "Capacity of the cache",
        "capacity, surfels",
        "MiB, ms",
        vec![series("session memory, MiB", memory), series("a frame, ms", frames)],
    )?;
    Ok(())
}
