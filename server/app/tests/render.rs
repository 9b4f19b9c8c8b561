//! `surfelcast render` as a user types it.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::process::Command;

/// What a technique would ignore is refused before anything is rendered, by its name.
#[test]
fn options_that_a_technique_lacks_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("picture.png");
    for (options, names) in [
        (
            vec!["--technique", "path", "--preset", "high"],
            "--preset high: technique path has no presets; leave it out, or take a technique that has: surfel",
        ),
        (
            vec!["--technique", "gradient", "--surfel", "radius=3"],
            "--set radius=3: technique gradient has no such setting",
        ),
        (vec!["--technique", "surfel", "--set", "radius=1000"], "--set radius=1000: must be within 1.5 to 32"),
        (vec!["--technique", "surfel", "--set", "radius"], "expected NAME=VALUE"),
        (vec!["--technique", "surfel", "--set", "size=3"], "--set size=3: no such setting; there are capacity, radius"),
        (vec!["--technique", "path", "--aov", "surfel_rays"], "--aov surfel_rays: technique path has no surfel_rays"),
        (vec!["--technique", "path", "--reconstruction", "poisson"], "--reconstruction poisson"),
        (vec!["--technique", "path", "--export-surfels", "surfels.ply"], "--export: technique path exports nothing"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_surfelcast"))
            .args(["render", "demo:cornell_box", "--size", "8x8", "--spp", "1", "--output"])
            .arg(&picture)
            .args(&options)
            .output()
            .unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{options:?}: {message}");
        assert!(message.contains(names), "{message}");
        assert!(!picture.exists());
    }
}
