//! Plots with two logarithmic axes, as SVG.

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::combinators::BindKeyPoints;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use surfelcast::Failure;

/// Width and height of the drawing, and the width of the legend on its right, pixels.
const SIZE: (u32, u32) = (900, 560);
const LEGEND_WIDTH: u32 = 250;
const FONT: &str = "sans-serif";
/// Colours that most colour-blind people can tell apart (Okabe and Ito).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];
const MARKER: i32 = 4;

/// A point with the standard error of its y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChartPoint {
    /// Positive, or it is not shown.
    pub(crate) x: f64,
    /// Positive, or it is not shown.
    pub(crate) y: f64,
    /// Half the length of the bar; 0 or NaN for none.
    pub(crate) std_error: f64,
}

/// A curve.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Name in the legend.
    pub(crate) label: String,
    /// In the order in which they are joined.
    pub(crate) points: Vec<ChartPoint>,
}

/// What is drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// Above the plot.
    pub(crate) title: String,
    /// Below the axis.
    pub(crate) x_label: String,
    /// Left of the axis.
    pub(crate) y_label: String,
    /// Curves.
    pub(crate) series: Vec<Series>,
    /// A level that is marked, such as a noise floor.
    pub(crate) level: Option<(f64, String)>,
    /// The Pareto front of all curves, as a step line: at each x the least y up to there.
    pub(crate) shows_front: bool,
    /// The line x = y, dashed.
    pub(crate) shows_agreement: bool,
}

impl Chart {
    /// Writes the plot as SVG. Without a visible point nothing is written.
    pub(crate) fn write(&self, path: &Path) -> Result<(), Failure> {
        let points = || self.series.iter().flat_map(|series| &series.points).filter(|point| is_shown(point));
        let Some(x) = range(points().map(|point| point.x)) else { return Ok(()) };
        let level = self.level.iter().map(|(level, _)| *level).filter(|level| *level > 0.0);
        let Some(y) = range(points().map(|point| point.y).chain(level)) else { return Ok(()) };
        let root = SVGBackend::new(path, SIZE).into_drawing_area();
        self.draw(&root, x, y)
            .map_err(|error| Failure::runtime(format!("{}: the plot could not be drawn: {error}", path.display())))
    }

    fn draw(
        &self,
        root: &DrawingArea<SVGBackend<'_>, Shift>,
        x: (f64, f64),
        y: (f64, f64),
    ) -> Result<(), Box<dyn std::error::Error>> {
        root.fill(&WHITE)?;
        let (left, right) = root.split_horizontally(SIZE.0 - LEGEND_WIDTH);
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, (FONT, 18))
            .margin(12)
            .x_label_area_size(46)
            .y_label_area_size(70)
            .build_cartesian_2d(
                (x.0..x.1).log_scale().with_key_points(ticks(x)),
                (y.0..y.1).log_scale().with_key_points(ticks(y)),
            )?;
        chart
            .configure_mesh()
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(TRANSPARENT)
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .axis_desc_style((FONT, 15))
            .label_style((FONT, 13))
            .x_label_formatter(&|value| label(*value))
            .y_label_formatter(&|value| label(*value))
            .draw()?;
        let grey = RGBColor(130, 130, 130);
        let mut lines = vec![];
        if let Some((level, name)) = self.level.as_ref().filter(|(level, _)| *level > 0.0) {
            chart.draw_series(DashedLineSeries::new([(x.0, *level), (x.1, *level)], 3, 3, grey.stroke_width(1)))?;
            lines.push((Mark::Dashes, grey, name.clone()));
        }
        let (low, high) = (x.0.max(y.0), x.1.min(y.1));
        if self.shows_agreement && low < high {
            chart.draw_series(DashedLineSeries::new([(low, low), (high, high)], 3, 3, grey.stroke_width(1)))?;
            lines.push((Mark::Dashes, grey, "agreement".to_owned()));
        }
        if self.shows_front {
            let pale = RGBColor(200, 200, 200);
            chart.draw_series(LineSeries::new(front_steps(&self.series, x.1), pale.stroke_width(6)))?;
            lines.push((Mark::Line, pale, "best of all".to_owned()));
        }
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            let shown: Vec<_> = series.points.iter().filter(|point| is_shown(point)).collect();
            chart.draw_series(LineSeries::new(shown.iter().map(|p| (p.x, p.y)), color.stroke_width(2)))?;
            let mark = [Mark::Circle, Mark::Triangle, Mark::Cross][(index / COLORS.len()).min(2)];
            for point in &shown {
                if point.std_error > 0.0 {
                    let ends = [-1.0, 1.0].map(|sign| (point.x, (point.y + sign * point.std_error).clamp(y.0, y.1)));
                    chart.draw_series([PathElement::new(ends, color.stroke_width(1))])?;
                }
                let place = EmptyElement::at((point.x, point.y));
                match mark {
                    Mark::Triangle => chart.draw_series([place + triangle((0, 0), color)])?,
                    Mark::Cross => chart.draw_series([place + cross((0, 0), color)])?,
                    _ => chart.draw_series([place + circle((0, 0), color)])?,
                };
            }
            lines.push((mark, color, series.label.clone()));
        }
        for (row, (mark, color, name)) in lines.into_iter().enumerate() {
            let middle = 52 + 22 * row as i32;
            let dashes: &[(i32, i32)] = if mark == Mark::Dashes { &[(6, 12), (17, 23), (28, 34)] } else { &[(6, 34)] };
            for &(from, to) in dashes {
                right.draw(&PathElement::new([(from, middle), (to, middle)], color.stroke_width(2)))?;
            }
            match mark {
                Mark::Circle => right.draw(&circle((20, middle), color))?,
                Mark::Triangle => right.draw(&triangle((20, middle), color))?,
                Mark::Cross => right.draw(&cross((20, middle), color))?,
                Mark::Line | Mark::Dashes => {}
            }
            let style = TextStyle::from((FONT, 13).into_font()).pos(Pos::new(HPos::Left, VPos::Center));
            right.draw(&Text::new(name, (42, middle), style))?;
        }
        root.present()?;
        Ok(())
    }
}

/// The look of a curve in the legend. Curves of the same colour differ by their marker.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    Line,
    Dashes,
    Circle,
    Triangle,
    Cross,
}

fn circle(at: (i32, i32), color: RGBColor) -> Circle<(i32, i32), i32> {
    Circle::new(at, MARKER, color.filled())
}

fn triangle(at: (i32, i32), color: RGBColor) -> TriangleMarker<(i32, i32), i32> {
    TriangleMarker::new(at, MARKER + 2, color.filled())
}

fn cross(at: (i32, i32), color: RGBColor) -> Cross<(i32, i32), i32> {
    Cross::new(at, MARKER, color.stroke_width(2))
}

fn is_shown(point: &ChartPoint) -> bool {
    point.x > 0.0 && point.y > 0.0 && point.x.is_finite() && point.y.is_finite()
}

/// Corners of the step line of the least y at each x, to the right edge.
fn front_steps(series: &[Series], right: f64) -> Vec<(f64, f64)> {
    let mut points: Vec<_> =
        series.iter().flat_map(|one| &one.points).filter(|point| is_shown(point)).map(|p| (p.x, p.y)).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for (x, y) in points {
        match steps.last() {
            Some(&(_, least)) if y >= least => {}
            Some(&(_, least)) => steps.extend([(x, least), (x, y)]),
            None => steps.push((x, y)),
        }
    }
    if let Some(&(_, least)) = steps.last() {
        steps.push((right, least));
    }
    steps
}

/// Least and largest of positive values, with a margin; `None` without a value.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (least, most) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    (most > 0.0).then(|| (least / 1.25, most * 1.25))
}

/// Round numbers in a range: powers of ten, and steps between them as space allows.
fn ticks((least, most): (f64, f64)) -> Vec<f64> {
    let decades = (least.log10().floor() as i32)..=(most.log10().ceil() as i32);
    let steps: &[f64] = match (most / least).log10() {
        span if span > 4.0 => &[1.0],
        span if span > 1.0 => &[1.0, 2.0, 5.0],
        _ => &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
    };
    decades
        .flat_map(|decade| steps.iter().map(move |step| step * 10_f64.powi(decade)))
        .filter(|tick| (least..=most).contains(tick))
        .collect()
}

/// Short form of a tick.
fn label(value: f64) -> String {
    let exponent = value.log10().floor() as i32;
    match exponent {
        -4..=-1 => format!("{value:.digits$}", digits = -exponent as usize),
        0..=3 => format!("{value:.0}"),
        4..=5 => format!("{:.0}k", value / 1e3),
        6..=8 => format!("{:.0}M", value / 1e6),
        9..=11 => format!("{:.0}G", value / 1e9),
        _ => format!("{value:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, y: f64) -> ChartPoint {
        ChartPoint { x, y, std_error: 0.0 }
    }

    #[test]
    fn ticks_are_round_and_short() {
        assert_eq!(ticks((0.9, 11.0)).iter().map(|t| label(*t)).collect::<Vec<_>>(), ["1", "2", "5", "10"]);
        assert_eq!(
            ticks((0.035, 0.072)).iter().map(|t| label(*t)).collect::<Vec<_>>(),
            ["0.04", "0.05", "0.06", "0.07"]
        );
        let wide = ticks((1e-3, 2e7)).iter().map(|t| label(*t)).collect::<Vec<_>>();
        assert_eq!(wide.first().map(String::as_str), Some("0.001"));
        assert_eq!(wide.last().map(String::as_str), Some("10M"));
    }

    #[test]
    fn the_front_keeps_what_nothing_beats() {
        let series = |points: &[(f64, f64)]| Series {
            label: String::new(),
            points: points.iter().map(|&(x, y)| point(x, y)).collect(),
        };
        let steps = front_steps(&[series(&[(1.0, 8.0), (4.0, 2.0)]), series(&[(2.0, 9.0), (3.0, 4.0)])], 5.0);
        assert_eq!(steps, [(1.0, 8.0), (3.0, 8.0), (3.0, 4.0), (4.0, 4.0), (4.0, 2.0), (5.0, 2.0)]);
    }

    #[test]
    fn a_plot_names_its_curves() {
        let folder = std::env::temp_dir().join(format!("surfelcast-chart-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder for the plot");
        let path = folder.join("chart.svg");
        let series = vec![Series { label: "one <curve>".to_owned(), points: vec![point(1.0, 0.1), point(4.0, 0.05)] }];
        let mut chart = Chart {
            title: "title".to_owned(),
            x_label: "x".to_owned(),
            y_label: "y".to_owned(),
            series,
            level: Some((0.02, "floor".to_owned())),
            shows_front: true,
            shows_agreement: true,
        };
        chart.write(&path).expect("a plot");
        let text = std::fs::read_to_string(&path).expect("the plot");
        assert!(text.contains("one &lt;curve&gt;") && text.contains("floor") && text.ends_with("</svg>\n"), "{text}");
        chart.series[0].points = vec![point(0.0, 1.0), point(1.0, f64::NAN)];
        chart.write(&folder.join("nothing.svg")).expect("nothing to draw is no error");
        assert!(!folder.join("nothing.svg").exists());
        std::fs::remove_dir_all(&folder).expect("the folder goes");
    }
}
