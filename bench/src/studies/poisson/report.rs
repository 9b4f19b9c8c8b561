//! Tables and plots of the three studies.

use std::path::Path;

use surfelcast::Failure;

use crate::report::chart::{Chart, ChartPoint, Series};
use crate::report::{Table, describe, known};
use crate::studies::poisson::measure::{BLURS, FIXED, GOAL, SOLVERS};
use crate::studies::poisson::{Observed, Studies};

/// Solvers of all records, for CSV.
pub(super) fn solver_table(all: &[Studies]) -> Table {
    let mut table = Table::new([
        "solver",
        "width",
        "height",
        "screen",
        "iterations_to_goal",
        "ms_to_goal",
        "error_left",
        "ms_an_iteration",
        "attainable",
        "commit",
        "device",
    ]);
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.6e}"));
    for studies in all {
        for one in &studies.solvers {
            table.push([
                one.solver.clone(),
                one.size[0].to_string(),
                one.size[1].to_string(),
                one.screen.to_string(),
                one.iterations.map_or_else(String::new, |count| count.to_string()),
                number(one.ms),
                number(one.error_left),
                number(Some(one.ms_an_iteration)),
                number(Some(one.attainable)),
                studies.origin.commit.clone(),
                studies.origin.device.clone(),
            ]);
        }
    }
    table
}

/// Images of the blur and path studies, for CSV.
pub(super) fn image_table(images: &[Observed]) -> Table {
    let mut table = Table::new(["study", "method", "at", "rmse"]);
    for one in images {
        table.push([one.study.clone(), one.method.clone(), one.at.to_string(), format!("{:.6e}", one.rmse)]);
    }
    table
}

/// RMSE curves of a study.
fn curves(images: &[Observed], study: &str) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for one in images.iter().filter(|one| one.study == study) {
        // A logarithmic axis has no zero: the start is shown at 0.5.
        let point = ChartPoint { x: f64::from(one.at).max(0.5), y: one.rmse, std_error: 0.0 };
        match series.iter_mut().find(|known| known.label == one.method) {
            Some(known) => known.points.push(point),
            None => series.push(Series { label: one.method.clone(), points: vec![point] }),
        }
    }
    series
}

pub(super) fn charts(studies: &Studies, folder: &Path) -> Result<(), Failure> {
    let chart = |file: &str, title: String, x_label: &str, y_label: &str, series: Vec<Series>| {
        Chart {
            title,
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            series,
            level: None,
            shows_front: false,
            shows_agreement: false,
        }
        .write(&folder.join(file))
    };
    for &[width, height] in &studies.key.sizes {
        for &screen in &studies.key.screens {
            let of_problem = studies.solvers.iter().filter(|one| one.size == [width, height] && one.screen == screen);
            let series = of_problem
                .map(|one| Series {
                    label: one.solver.clone(),
                    points: (one.residuals.iter().enumerate().skip(1))
                        .filter(|(i, _)| *i < 32 || i.is_power_of_two() || i % (i.ilog2() as usize * 4) == 0)
                        .map(|(i, &y)| ChartPoint { x: i as f64, y, std_error: 0.0 })
                        .collect(),
                })
                .collect();
            chart(
                &format!("poisson_residual_{width}x{height}_{screen}.svg"),
                format!("{width} x {height}, screen {screen}"),
                "iterations",
                "residual of V = 1",
                series,
            )?;
        }
    }
    for &screen in &studies.key.screens {
        let series = SOLVERS
            .iter()
            .map(|(name, _)| Series {
                label: (*name).to_owned(),
                points: studies
                    .solvers
                    .iter()
                    .filter(|one| one.solver == *name && one.screen == screen)
                    .filter_map(|one| {
                        let pixels = f64::from(one.size[0]) * f64::from(one.size[1]);
                        Some(ChartPoint { x: pixels, y: one.ms?, std_error: 0.0 })
                    })
                    .collect(),
            })
            .collect();
        let title = format!("Time to a residual of {GOAL}, screen {screen}");
        chart(&format!("poisson_time_{screen}.svg"), title, "pixels", "ms", series)?;
    }
    for sigma in BLURS {
        let title = format!("An image blurred by {sigma} pixels and its true differences");
        let study = format!("blur_{sigma}");
        chart(&format!("poisson_{study}.svg"), title, "iterations", "RMSE", curves(&studies.images, &study))?;
    }
    for iterations in FIXED {
        let title = format!("Gradient-domain path tracing, {iterations} iterations");
        let study = format!("paths_{iterations}");
        let series = curves(&studies.images, &study);
        chart(&format!("poisson_{study}.svg"), title, "samples per pixel", "tone-mapped RMSE", series)?;
    }
    Ok(())
}

pub(super) fn markdown(studies: &Studies) -> String {
    let mut solvers =
        Table::new(["image", "screen", "solver", "iterations", "ms", "ms each", "error left", "least residual"]);
    for one in &studies.solvers {
        let ran_out = || format!("> {}", one.residuals.len() - 1);
        solvers.push([
            format!("{} x {}", one.size[0], one.size[1]),
            one.screen.to_string(),
            one.solver.clone(),
            one.iterations.map_or_else(ran_out, |count| count.to_string()),
            known(one.ms, 1),
            format!("{:.2}", one.ms_an_iteration),
            known(one.error_left, 3),
            format!("{:.0e}", one.attainable),
        ]);
    }
    let text = format!(
        "{}Iterations to a residual of {GOAL} (that of V is 1), ms until then, the share of the error of V that is left, \
         and the least residual found: the limit of `f32`, unless the iterations ran out before (`>`).\n\n{}",
        describe(std::iter::once(&studies.origin), &[]),
        solvers.markdown()
    );
    let blurs = BLURS.map(|sigma| {
        let [width, height] = studies.key.blur_size;
        let table = rmse_table(&studies.images, &format!("blur_{sigma}"), "iterations").markdown();
        let image = format!("a {width} x {height} image blurred by {sigma} pixels");
        format!("\nRMSE of {image}, with its true differences:\n\n{table}")
    });
    let paths = FIXED.map(|iterations| {
        let [width, height] = studies.key.path_size;
        let table = rmse_table(&studies.images, &format!("paths_{iterations}"), "samples per pixel").markdown();
        let image = format!("still life of the demo interior, {width} x {height}, {iterations} iterations");
        format!("\nTone-mapped RMSE of gradient-domain path tracing, {image}:\n\n{table}")
    });
    text + &blurs.concat() + &paths.concat()
}

/// Methods down, iterations or samples across.
fn rmse_table(images: &[Observed], study: &str, unit: &str) -> Table {
    let mut places: Vec<u32> = images.iter().filter(|one| one.study == study).map(|one| one.at).collect();
    places.sort_unstable();
    places.dedup();
    let mut table = Table::new([unit.to_owned()].into_iter().chain(places.iter().map(u32::to_string)));
    for curve in curves(images, study) {
        let cells = places.iter().map(|&at| {
            let is_it = |one: &&Observed| one.study == study && one.method == curve.label && one.at == at;
            known(images.iter().find(is_it).map(|one| one.rmse), 4)
        });
        table.push([curve.label.clone()].into_iter().chain(cells));
    }
    table
}
