//! Every dependency has a licence that deny.toml allows. Needs neither cargo-deny nor a network.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use cargo_metadata::{MetadataCommand, Package};
use spdx::{Expression, Licensee, ParseMode};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests folder lies in the workspace")
}

/// The list under `[licenses] allow` of deny.toml.
fn allowed() -> Result<Vec<Licensee>> {
    let text = fs::read_to_string(root().join("deny.toml"))?;
    let table: toml::Table = text.parse().context("deny.toml is not TOML")?;
    let list = table.get("licenses").and_then(|licenses| licenses.get("allow")).and_then(toml::Value::as_array);
    let list = list.context("deny.toml has no [licenses] allow")?;
    ensure!(!list.is_empty(), "deny.toml allows no licence");
    list.iter()
        .map(|name| {
            let name = name.as_str().context("[licenses] allow holds something that is no string")?;
            Licensee::parse(name).with_context(|| format!("deny.toml: {name} is no SPDX licence"))
        })
        .collect()
}

/// Why the licence of a package is refused, if it is.
fn fault(package: &Package, allowed: &[Licensee]) -> Option<String> {
    let name = format!("{} {}", package.name, package.version);
    let Some(licence) = &package.license else {
        return Some(format!("{name}: states no licence expression"));
    };
    // Old manifests write `MIT/Apache-2.0`; the lax mode reads it as OR, as crates.io does.
    match Expression::parse_mode(licence, ParseMode::LAX) {
        Err(error) => Some(format!("{name}: cannot read the licence {licence:?}: {}", error.reason)),
        Ok(expression) => {
            let accepted = expression.evaluate(|requirement| allowed.iter().any(|one| one.satisfies(requirement)));
            (!accepted).then(|| format!("{name}: {licence} is not covered by [licenses] allow in deny.toml"))
        }
    }
}

#[test]
fn every_dependency_has_an_allowed_licence() -> Result<()> {
    let allowed = allowed()?;
    // Only crates that are compiled here: those for other platforms need not have been fetched.
    let host = format!("--filter-platform={}", host_target()?);
    let metadata = MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .other_options(vec!["--locked".to_owned(), host])
        .exec()
        .context("cargo metadata failed")?;
    let ours: BTreeSet<_> = metadata.workspace_members.iter().collect();
    let dependencies: Vec<_> = metadata.packages.iter().filter(|package| !ours.contains(&package.id)).collect();
    ensure!(
        dependencies.len() > 50,
        "only {} dependencies seen: the test looks in the wrong place",
        dependencies.len()
    );

    let faults: Vec<_> = dependencies.into_iter().filter_map(|package| fault(package, &allowed)).collect();
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

/// The platform of the compiler, such as `x86_64-unknown-linux-gnu`.
fn host_target() -> Result<String> {
    let output = std::process::Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()))
        .arg("-vV")
        .output()
        .context("rustc -vV failed")?;
    let text = String::from_utf8(output.stdout)?;
    let host = text.lines().find_map(|line| line.strip_prefix("host: ")).context("rustc -vV names no host")?;
    Ok(host.to_owned())
}
