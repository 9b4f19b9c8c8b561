//! House rules that are cheaper to check than to remember. Each fault names the file, the rule and the remedy.

mod sources;
mod words;

use std::collections::BTreeSet;
use std::fs;

use anyhow::{Context as _, Result, ensure};

use crate::sources::{CODE, root, sources};

/// Files of code aim at 500 lines; past this many, a file must be split or stand in [`LONG_FILES`].
const LINE_LIMIT: usize = 700;

/// Long files that are one idea all the same: (path, reason).
const LONG_FILES: &[(&str, &str)] = &[];

fn report(faults: &[String]) -> Result<()> {
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

#[test]
fn files_stay_readable() -> Result<()> {
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.is(CODE)) {
        let lines = source.text.lines().count();
        match LONG_FILES.iter().find(|(path, _)| *path == source.path) {
            None if lines > LINE_LIMIT => faults.push(format!(
                "{}: {lines} lines, the limit is {LINE_LIMIT}; split it, or list it in LONG_FILES with a reason",
                source.path
            )),
            Some(_) if lines <= LINE_LIMIT => {
                faults.push(format!("{}: only {lines} lines; take it off LONG_FILES", source.path));
            }
            _ => {}
        }
    }
    for (path, _) in LONG_FILES.iter().filter(|(path, _)| !root().join(path).is_file()) {
        faults.push(format!("{path}: in LONG_FILES, but no such file"));
    }
    report(&faults)
}

#[test]
fn nothing_is_left_unfinished() -> Result<()> {
    // Written in halves so that this file passes its own rule.
    let marks = [
        ["to", "do!("],
        ["unimpl", "emented!("],
        ["#[ig", "nore"],
        ["FIX", "ME"],
        ["XX", "X:"],
        ["test.on", "ly("],
        ["test.sk", "ip("],
        ["describe.on", "ly("],
    ]
    .map(|halves| halves.concat());
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.is(CODE)) {
        for (number, line) in source.text.lines().enumerate() {
            for mark in marks.iter().filter(|mark| line.contains(mark.as_str())) {
                faults.push(format!(
                    "{}:{}: {mark} is unfinished work; finish it or take it out",
                    source.path,
                    number + 1
                ));
            }
        }
    }
    report(&faults)
}

#[test]
fn kernel_folders_explain_themselves() -> Result<()> {
    let techniques = root().join("shaders/techniques");
    let mut faults = Vec::new();
    if techniques.is_dir() {
        for entry in fs::read_dir(techniques)? {
            let folder = entry?.path();
            if folder.is_dir() && !folder.join("README.md").is_file() {
                let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
                faults.push(format!(
                    "shaders/techniques/{name} has no README.md: say what it computes, from which papers, with which \
                     buffers, and whether it is biased"
                ));
            }
        }
    }
    faults.sort();
    report(&faults)
}

#[test]
fn crates_share_lints_and_version() -> Result<()> {
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.path.ends_with("/Cargo.toml")) {
        let manifest: toml::Table = source.text.parse().with_context(|| format!("{} is not TOML", source.path))?;
        // A fuzz target is a workspace of its own, with nightly-only tools.
        if manifest.contains_key("workspace") {
            continue;
        }
        let inherits = |value: Option<&toml::Value>| {
            value.and_then(|value| value.get("workspace")).and_then(toml::Value::as_bool) == Some(true)
        };
        if !inherits(manifest.get("lints")) {
            faults.push(format!("{}: write `[lints] workspace = true`", source.path));
        }
        for field in ["version", "edition", "license", "publish"] {
            if !inherits(manifest.get("package").and_then(|package| package.get(field))) {
                faults.push(format!("{}: write `{field}.workspace = true`", source.path));
            }
        }
        for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let dependencies = manifest.get(section).and_then(toml::Value::as_table);
            for (name, value) in dependencies.into_iter().flatten().filter(|(_, value)| !inherits(Some(value))) {
                faults
                    .push(format!("{}: {name} = {value:?}: state versions once, in the root Cargo.toml", source.path));
            }
        }
    }
    report(&faults)
}

/// Clippy reads the nearest clippy.toml only, so the one of server/gpu repeats the root's but for the bans it is exempt
/// from.
#[test]
fn both_lint_tables_agree() -> Result<()> {
    let read = |path: &str| -> Result<toml::Table> { Ok(fs::read_to_string(root().join(path))?.parse()?) };
    let (mut all, here) = (read("clippy.toml")?, read("server/gpu/clippy.toml")?);
    let bans =
        all.get_mut("disallowed-methods").and_then(toml::Value::as_array_mut).context("no disallowed-methods")?;
    let count = bans.len();
    bans.retain(|ban| {
        !ban.get("path").and_then(toml::Value::as_str).is_some_and(|path| path.starts_with("wgpu::Device::create_"))
    });
    ensure!(bans.len() < count, "clippy.toml no longer bans wgpu::Device::create_*");
    ensure!(
        all == here,
        "server/gpu/clippy.toml differs from clippy.toml by more than the bans on wgpu::Device::create_*"
    );
    Ok(())
}

/// Name that a heading is linked by, as code hosts form it.
fn anchor(heading: &str) -> String {
    heading
        .trim()
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
        .map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() })
        .collect()
}

/// Text with fenced code blocks left out: what looks like a link or a heading there is neither.
fn without_code_blocks(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

fn anchors(text: &str) -> BTreeSet<String> {
    without_code_blocks(text)
        .filter(|line| line.starts_with('#'))
        .map(|line| anchor(line.trim_start_matches('#')))
        .collect()
}

#[test]
fn links_in_documents_lead_somewhere() -> Result<()> {
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.is(&["md"])) {
        let folder = root().join(&source.path).parent().context("a file has a folder")?.to_owned();
        for line in without_code_blocks(&source.text) {
            // A link is `](target)`; the label before it does not matter.
            for rest in line.split("](").skip(1) {
                let Some(target) = rest.split([')', ' ']).next() else { continue };
                if target.contains("://") || target.starts_with("mailto:") {
                    continue;
                }
                let (file, fragment) = target.split_once('#').unwrap_or((target, ""));
                let path = if file.is_empty() { root().join(&source.path) } else { folder.join(file) };
                if !path.exists() {
                    faults.push(format!("{}: link to {target}: no such file", source.path));
                } else if !fragment.is_empty()
                    && path.extension().is_some_and(|extension| extension == "md")
                    && !anchors(&fs::read_to_string(&path)?).contains(fragment)
                {
                    faults.push(format!("{}: link to {target}: no such heading", source.path));
                }
            }
        }
    }
    report(&faults)
}

/// Code in a document: the lines of its blocks, and what stands between backquotes.
fn code_snippets(text: &str) -> Vec<&str> {
    let mut is_code = false;
    let mut snippets = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if is_code {
            snippets.push(line);
        } else {
            snippets.extend(line.split('`').skip(1).step_by(2));
        }
    }
    snippets
}

#[test]
fn documented_commands_exist() -> Result<()> {
    let makefile = fs::read_to_string(root().join("Makefile"))?;
    let targets: BTreeSet<&str> = makefile
        .lines()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()))
        .filter_map(|line| line.split_once(": ").or_else(|| line.split_once(':')).map(|(target, _)| target))
        .collect();
    let mut faults = Vec::new();
    for source in sources()?.iter().filter(|source| source.is(&["md"])) {
        for code in code_snippets(&source.text) {
            let Some(arguments) = code.trim_start_matches(['$', ' ']).strip_prefix("make ") else { continue };
            let target = arguments.split_whitespace().find(|word| !word.contains('='));
            if let Some(target) = target.filter(|target| !targets.contains(target)) {
                faults.push(format!("{}: `make {target}` is not in the Makefile", source.path));
            }
        }
    }
    for line in makefile.lines().filter(|line| line.starts_with(".PHONY: ")) {
        let target = line.trim_start_matches(".PHONY: ");
        if !makefile.lines().any(|line| line.starts_with(&format!("{target}:")) && line.contains("## ")) {
            faults.push(format!("Makefile: {target} has no `## explanation`, so `make help` does not show it"));
        }
    }
    report(&faults)
}

#[test]
fn nothing_names_a_developers_folder() -> Result<()> {
    let folders = ["home", "Users", "root", "work", "workspace"].map(|name| format!("/{name}/"));
    let mut faults = Vec::new();
    for source in sources()? {
        for (number, line) in source.text.lines().enumerate() {
            for folder in &folders {
                // `a/home/b` is a relative path or part of an address; only a path that starts there is meant.
                let starts_there = line.match_indices(folder.as_str()).any(|(at, _)| {
                    !line[..at]
                        .ends_with(|c: char| c.is_alphanumeric() || matches!(c, '.' | '_' | '-' | '}' | ')' | '*'))
                });
                if starts_there {
                    faults.push(format!("{}:{}: {folder} is a folder of one machine", source.path, number + 1));
                }
            }
        }
    }
    report(&faults)
}
