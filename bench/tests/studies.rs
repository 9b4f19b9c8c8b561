//! The laboratory as a user runs it.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// Runs `surfelcast-bench error` on tiny images.
fn bench_error(out: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfelcast-bench"));
    command.args(["error", "--scene", "demo:cornell_box", "--size", "24x18", "--truth-spp", "256"]);
    command.args(["--technique", "path", "--technique", "surfel", "--samples", "4", "--replicates", "2"]);
    // No time limit may decide how far a replicate goes here.
    command.args(["--time-limit", "3600", "--out"]).arg(out).args(more);
    command.output().unwrap()
}

fn curves(out: &Path) -> Vec<Value> {
    serde_json::from_slice(&fs::read(out.join("error.json")).unwrap()).unwrap()
}

/// Errors by curve and budget, which do not depend on the load of the machine.
fn errors(out: &Path) -> Vec<Vec<Value>> {
    let points = |curve: &Value| curve["points"].as_array().unwrap().iter().map(|p| p["rmse"].clone()).collect();
    curves(out).iter().map(points).collect()
}

#[test]
fn error_falls_is_written_down_and_is_not_measured_twice() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("first");
    let docs = folder.path().join("docs");

    let output = bench_error(&out, &["--docs", docs.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Quiet in a pipe.
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(docs.join("error.md")).unwrap();
    assert!(page.starts_with("# Error against cost") && page.contains("| path |"), "{page}");
    // Stated are commit, device and command, without folders of this machine.
    assert!(page.contains("Measured at ") && page.contains("`surfelcast-bench error --scene"), "{page}");
    assert!(!page.contains(folder.path().to_str().unwrap()), "{page}");
    assert!(docs.join("error-pareto.svg").is_file(), "the page shows it");
    for file in ["error.csv", "error-pareto.svg", "error-cornell_box_front_lambert-seconds.svg"] {
        assert!(out.join(file).is_file(), "{file}");
    }
    let measured = curves(&out);
    assert!(measured.len() >= 2);
    for curve in &measured {
        let points = curve["points"].as_array().unwrap();
        let of = |index: usize, name: &str| points[index][name].as_f64().unwrap();
        assert_eq!(points.len(), 3, "1, 2 and 4 samples");
        assert!(of(2, "error") < of(0, "error") && of(2, "secs") > of(0, "secs"), "{curve}");
        assert!(of(2, "rays_primary") > 0.0 && of(2, "rays_shadow") > 0.0 && of(2, "non_finite") == 0.0, "{curve}");
        // Measured square = bias square + variance + the truth's noise square.
        let parts = of(2, "bias_squared") + of(2, "variance") + curve["truth_noise"].as_f64().unwrap().powi(2);
        assert!((parts / of(2, "rmse").powi(2) - 1.0).abs() < 1e-4, "{curve}");
    }

    // Times differ whenever something is rendered, so equal bytes mean that nothing was.
    let before = fs::read(out.join("error.json")).unwrap();
    assert!(bench_error(&out, &[]).status.success());
    assert_eq!(fs::read(out.join("error.json")).unwrap(), before);

    // The same request elsewhere gives the same errors, another seed others.
    let (again, other) = (folder.path().join("again"), folder.path().join("other"));
    assert!(bench_error(&again, &[]).status.success());
    assert!(bench_error(&other, &["--seed", "7"]).status.success());
    assert_eq!(errors(&again), errors(&out));
    assert_ne!(errors(&other), errors(&out));
}

/// Most devices cannot bind the largest cache; whether this one can or not, the page says so.
#[test]
fn a_cache_too_large_for_the_device_does_not_end_a_study() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfelcast-bench"));
    command.args(["densities", "--scene", "demo:cornell_box", "--size", "16x12"]);
    command.args(["--set", "capacity=4194304,65536", "--set", "radius=6"]);
    command.args(["--samples", "1", "--replicates", "1", "--truth-spp", "16"]);
    command.arg("--docs").arg(folder.path()).arg("--out").arg(folder.path());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(folder.path().join("densities.md")).unwrap();
    let says_largest = page.contains("capacity=4194304") || page.contains("2^22 surfels");
    assert!(says_largest && page.contains("2^16 surfels") && page.contains("| 6 |"), "{page}");
}

#[test]
fn bad_requests_end_with_two_before_anything_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    for (bad, names) in [
        (["--set", "radius=99"], "--set radius=99"),
        (["--reconstruction", "magic"], "--reconstruction magic"),
        (["--reference", "nowhere.exr"], "nowhere.exr"),
    ] {
        let output = bench_error(folder.path(), &bad);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{bad:?}: {message}");
        assert!(message.contains(names), "{message}");
        assert!(!folder.path().join("error.json").exists());
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_surfelcast-bench"));
    let output = command.args(["peers", "--peers", "nowhere.csv", "--out"]).arg(folder.path()).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && message.contains("nowhere.csv"), "{message}");
}
