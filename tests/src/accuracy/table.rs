//! The table in BENCHMARKS.md.

use std::fmt::Write as _;

use anyhow::{Context as _, Result};

use crate::accuracy::Measurement;

/// Measurements as a Markdown table; the last point of each decides the columns that are not about slope.
pub fn markdown(measurements: &[Measurement]) -> String {
    let mut text = String::from(
        "| reference | spp | RMSE | reference noise | own noise | ratio | slope | audit / RMSE | bias | bias in errors | furnace | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for measurement in measurements {
        let Some(point) = measurement.points.last() else { continue };
        let noise = measurement.reference_noise;
        let slope = match measurement.slope() {
            Some(slope) => format!("{slope:.2}"),
            // Several sample counts, but the reference is too noisy to see the error fall.
            None if measurement.points.len() > 1 => "at floor".to_owned(),
            None => "-".to_owned(),
        };
        let truth = point.rmse_to_truth(noise);
        // An error far below the reference's noise cannot be read off the difference.
        let audit = if point.audited_rmse > 0.0 && truth > 0.5 * noise {
            format!("{:.2}", point.audited_rmse / truth)
        } else {
            "-".to_owned()
        };
        let furnace =
            if point.analytic_error > 0.0 { format!("{:.2} %", 100.0 * point.analytic_error) } else { "-".to_owned() };
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| {} | {} | {:.5} | {:.5} | {:.5} | {:.3} | {slope} | {audit} | {:+.2} % | {:+.1} | {furnace} | {:.1} |",
            measurement.name,
            point.samples,
            point.rmse,
            noise,
            point.own_noise,
            point.ratio(noise),
            100.0 * point.bias,
            point.bias_in_errors,
            point.render_secs,
        );
    }
    text
}

/// Replaces what stands between `<!-- name: begin -->` and `<!-- name: end -->`.
pub fn replace_between_markers(document: &str, name: &str, content: &str) -> Result<String> {
    let (begin, end) = (format!("<!-- {name}: begin -->"), format!("<!-- {name}: end -->"));
    let (head, rest) = document.split_once(&begin).with_context(|| format!("the document has no {begin}"))?;
    let (_, tail) = rest.split_once(&end).with_context(|| format!("the document has no {end}"))?;
    Ok(format!("{head}{begin}\n{content}{end}{tail}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markers_enclose_what_is_replaced() -> Result<()> {
        let document = "a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n";
        let once = replace_between_markers(document, "x", "new\n")?;
        assert_eq!(once, "a\n<!-- x: begin -->\nnew\n<!-- x: end -->\nb\n");
        assert_eq!(replace_between_markers(&once, "x", "new\n")?, once);
        assert!(replace_between_markers(document, "y", "").is_err());
        Ok(())
    }
}
