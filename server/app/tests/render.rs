//! `surfelcast render` as a user types it.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::process::Command;

/// What a technique would ignore is refused before anything is rendered, by its name.
#[test]
fn options_for_surfels_are_refused_where_there_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("picture.png");
    for (options, names) in [
        (vec!["--technique", "path", "--preset", "high"], "--preset high: technique path has no surfels"),
        (vec!["--technique", "gradient", "--surfel", "radius=3"], "--surfel radius=3"),
        (vec!["--technique", "path", "--reconstruction", "poisson"], "--reconstruction poisson"),
        (vec!["--technique", "path", "--export-surfels", "surfels.ply"], "--export-surfels"),
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
