//! The program against reference images, through `surfelcast render` only.
//!
//! Few samples suffice: the gate compares with the noise between two seeds, so a missing factor, a wrong density or a
//! missing light is detected in a noisy image. `make bench-accuracy` does the same with many samples.
#![allow(clippy::print_stdout, reason = "a test says what it measured, and why it skipped")]

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use surfelcast_measure::{Image, Mode, Point, Reference, Renderer, error_to_truth};

/// Squared error over the variance of the noise. With ten thousand pixels chance stays well below this.
const RATIO_LIMIT: f64 = 1.15;
/// Distance of the means in standard errors. Over thirty references, chance exceeds 3 one time in twelve.
const BIAS_LIMIT: f64 = 4.0;
/// Largest relative error of the mean of a furnace.
const FURNACE_LIMIT: f64 = 0.002;
/// Largest relative error of the audit, on average over a group.
const AUDIT_LIMIT: f64 = 0.15;

/// The folder of shared scenes and references, next to the repository or named by `SURFELCAST_SHARED`.
fn shared_folder() -> Option<PathBuf> {
    surfelcast_measure::shared_folder(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
}

/// Measures every reference that `belongs`; `None` if there are no references.
fn measure(samples: u32, belongs: impl Fn(&Reference) -> bool) -> Result<Option<Vec<(Reference, Point)>>> {
    let Some(shared) = shared_folder() else {
        println!("skipped: no folder of references; set SURFELCAST_SHARED to one");
        return Ok(None);
    };
    let renderer = Renderer::find("path")?;
    let mut measured = Vec::new();
    for reference in Reference::read_all(&shared)?.into_iter().filter(belongs) {
        let point = renderer.measure(&reference, samples).with_context(|| reference.name.clone())?;
        println!(
            "{}: RMSE {:.5}, ratio {:.3}, bias {:+.2} % ({:+.1} errors), audit {:.5}",
            reference.name,
            point.rmse,
            point.ratio(reference.noise_rmse),
            100.0 * point.bias,
            point.bias_in_errors,
            point.audited_rmse
        );
        measured.push((reference, point));
    }
    ensure!(!measured.is_empty(), "no reference belongs to this group any more");
    Ok(Some(measured))
}

/// Every reference of a group differs by noise only, and the audit estimates it.
fn check(samples: u32, belongs: impl Fn(&Reference) -> bool) -> Result<()> {
    let Some(measured) = measure(samples, belongs)? else { return Ok(()) };
    let mut faults = Vec::new();
    let (mut audited, mut real) = (0.0, 0.0);
    for (reference, point) in &measured {
        let ratio = point.ratio(reference.noise_rmse);
        if ratio.is_nan() || ratio > RATIO_LIMIT {
            faults.push(format!("{}: squared error is {ratio:.3} times what noise explains", reference.name));
        }
        if point.bias_in_errors.is_nan() || point.bias_in_errors.abs() > BIAS_LIMIT {
            faults.push(format!(
                "{}: the mean is off by {:+.2} %, {:+.1} standard errors",
                reference.name,
                100.0 * point.bias,
                point.bias_in_errors
            ));
        }
        if point.non_finite > 0 {
            faults.push(format!("{}: {} pixels are not finite", reference.name, point.non_finite));
        }
        // Logarithms, so that a dark scene counts as much as a bright one.
        let truth = point.rmse_to_truth(reference.noise_rmse);
        if reference.mode != Mode::Indirect && point.audited_rmse > 0.0 && truth > reference.noise_rmse {
            audited += point.audited_rmse.ln();
            real += truth.ln();
        } else if reference.mode != Mode::Indirect && point.audited_rmse <= 0.0 {
            faults.push(format!("{}: the statistics state no audited error", reference.name));
        }
    }
    let audit_ratio = ((audited - real) / measured.len() as f64).exp();
    if (audit_ratio - 1.0).abs() > AUDIT_LIMIT {
        faults.push(format!("the audit states {audit_ratio:.2} times the measured error, on average"));
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

fn is_furnace(reference: &Reference) -> bool {
    reference.name.starts_with("furnace")
}

#[test]
fn furnaces_are_white() -> Result<()> {
    let Some(measured) = measure(64, is_furnace)? else { return Ok(()) };
    for (reference, point) in measured {
        ensure!(!reference.expected.colors.is_empty(), "{} states no analytic colour", reference.name);
        ensure!(
            point.analytic_error <= FURNACE_LIMIT,
            "{}: the mean misses its analytic colour by {:.2} %",
            reference.name,
            100.0 * point.analytic_error
        );
        ensure!(point.non_finite == 0, "{}: {} pixels are not finite", reference.name, point.non_finite);
    }
    Ok(())
}

#[test]
fn lambert_scenes_match_their_references() -> Result<()> {
    check(16, |reference| {
        reference.mode == Mode::Lambert && !is_furnace(reference) && !reference.name.starts_with("khr_")
    })
}

#[test]
fn lambert_conformance_assets_match_their_references() -> Result<()> {
    check(16, |reference| reference.mode == Mode::Lambert && reference.name.starts_with("khr_"))
}

#[test]
fn metallic_roughness_matches_its_references() -> Result<()> {
    check(16, |reference| reference.mode == Mode::Pbr)
}

/// The image from the cache after 16 frames is within the error that the gates allow a converged one. One seed
/// suffices: the limits include its noise.
#[test]
fn the_surfel_cache_matches_its_references() -> Result<()> {
    const LIMITS: [(&str, f64); 6] = [
        ("cornell_box_main_lambert", 0.02),
        ("cornell_box_main_indirect", 0.02),
        ("bars_main_lambert", 0.03),
        ("classroom_main_lambert", 0.03),
        ("maze_small_near_lambert", 0.03),
        ("sponza_atrium_lambert", 0.03),
    ];
    let Some(shared) = shared_folder() else {
        println!("skipped: no folder of references; set SURFELCAST_SHARED to one");
        return Ok(());
    };
    let renderer = Renderer::find("surfel")?;
    let mut faults = Vec::new();
    for reference in Reference::read_all(&shared)? {
        let Some((_, limit)) = LIMITS.iter().find(|(name, _)| *name == reference.name) else { continue };
        let (picture, _) = renderer.image(&reference, 16, 1)?;
        let non_finite = picture.non_finite_count();
        let truth = Image::read_exr(&reference.image)?;
        let rmse = error_to_truth(&reference, &picture, &truth, reference.noise_rmse.powi(2));
        println!("{}: RMSE {rmse:.5}", reference.name);
        if rmse > *limit || non_finite > 0 {
            faults.push(format!("{}: RMSE {rmse:.4}, {non_finite} not finite", reference.name));
        }
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

#[test]
fn demodulated_indirect_light_matches_its_references() -> Result<()> {
    check(16, |reference| reference.mode == Mode::Indirect)
}
