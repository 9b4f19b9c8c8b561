//! Who may import whom, held against `cargo metadata`, the shaders' imports and ARCHITECTURE.md.
//!
//! The table below is the one place where the rule is written; ARCHITECTURE.md shows a copy, which a test compares.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use cargo_metadata::{DependencyKind, Metadata, MetadataCommand};

/// One crate, its folder, and the crates of ours it may import.
struct Room {
    name: &'static str,
    folder: &'static str,
    may_import: &'static [&'static str],
    why: &'static str,
}

/// All crates but `bench` and `tests`, which stand above them.
const EVERYTHING: &[&str] = &[
    "app",
    "gpu",
    "measure",
    "passes",
    "protocol",
    "render-api",
    "renderer",
    "review",
    "scene",
    "service",
    "shaders",
    "store",
    "stream",
    "techniques",
];

const ROOMS: &[Room] = &[
    Room { name: "protocol", folder: "protocol", may_import: &[], why: "what crosses the wire stands alone" },
    Room { name: "shaders", folder: "shaders", may_import: &[], why: "kernels and their checks run without a GPU" },
    Room {
        name: "scene",
        folder: "server/scene",
        may_import: &[],
        why: "glTF in, validated scene out; no GPU, no async",
    },
    Room {
        name: "render-api",
        folder: "server/render-api",
        may_import: &["scene"],
        why: "requests, settings and results, as callers and the renderer exchange them; no GPU, no async",
    },
    Room { name: "stream", folder: "server/stream", may_import: &[], why: "pixels to bytes; no GPU, no async" },
    Room { name: "gpu", folder: "server/gpu", may_import: &["shaders"], why: "device and frame graph; knows no light" },
    Room {
        name: "passes",
        folder: "server/passes",
        may_import: &["gpu", "render-api", "scene", "shaders"],
        why: "passes that any technique may use; knows no technique",
    },
    Room {
        name: "techniques",
        folder: "server/techniques",
        may_import: &["gpu", "passes", "render-api", "scene", "shaders"],
        why: "one folder per way of rendering",
    },
    Room {
        name: "renderer",
        folder: "server/renderer",
        may_import: &["gpu", "passes", "render-api", "scene", "shaders", "techniques"],
        why: "the render actor: commands in, frames out",
    },
    Room {
        name: "review",
        folder: "server/review",
        may_import: &["protocol"],
        why: "the domain: sessions, edits, checks; no async, no clock, no I/O",
    },
    Room {
        name: "store",
        folder: "server/store",
        may_import: &[],
        why: "what is kept, bounded: scene files, finished renders, keys; knows bytes, not meanings",
    },
    Room {
        name: "service",
        folder: "server/service",
        may_import: &["protocol", "render-api", "renderer", "review", "store", "stream"],
        why: "HTTP and WebSocket; sees the renderer through its handle",
    },
    Room {
        name: "app",
        folder: "server/app",
        may_import: &[
            "gpu",
            "passes",
            "protocol",
            "render-api",
            "renderer",
            "review",
            "scene",
            "service",
            "shaders",
            "store",
            "stream",
            "techniques",
        ],
        why: "the binary wires everything; the laboratory shares its arguments",
    },
    Room {
        name: "measure",
        folder: "bench/measure",
        may_import: &[],
        why: "error metrics and references; judges pixels alone",
    },
    Room {
        name: "bench",
        folder: "bench",
        may_import: EVERYTHING,
        why: "the laboratory: measures everything, is never shipped; imported by nothing",
    },
    Room { name: "tests", folder: "tests", may_import: EVERYTHING, why: "end-to-end suites; imported by nothing" },
];

/// Outside crates that belong to one side of a wall: (crate, rooms that may name it, why).
const WALLS: &[(&str, &[&str], &str)] = &[
    ("wgpu", &["gpu"], "GPU objects are created where they are counted and their errors are caught"),
    ("wesl", &["shaders"], "one room knows the shader linker"),
    ("naga", &["shaders", "gpu"], "reflection is the shaders' business, pipelines the GPU's"),
    ("axum", &["service"], "one room speaks HTTP"),
    ("gltf", &["scene"], "one room reads glTF"),
    ("anyhow", &["tests"], "libraries and programs name their errors; only tests may blur them"),
];

/// Rooms without an async runtime: they are called from blocking threads or from the render thread.
const WITHOUT_ASYNC: &[&str] = &[
    "protocol",
    "shaders",
    "scene",
    "render-api",
    "stream",
    "measure",
    "gpu",
    "passes",
    "techniques",
    "review",
    "store",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests folder lies in the workspace")
}

fn metadata() -> Result<Metadata> {
    MetadataCommand::new().manifest_path(root().join("Cargo.toml")).no_deps().exec().context("cargo metadata failed")
}

/// `surfelcast-gpu` -> `gpu`; the binary `surfelcast` is the room `app`; anything else is not ours.
fn room_name(package: &str) -> Option<&str> {
    if package == "surfelcast" { Some("app") } else { package.strip_prefix("surfelcast-") }
}

fn markdown_table() -> String {
    let mut table = String::from("| room | folder | may import | because |\n|---|---|---|---|\n");
    for Room { name, folder, may_import, why } in ROOMS {
        let imports = if may_import.is_empty() { "none of ours".to_owned() } else { may_import.join(", ") };
        // Writing to a string cannot fail.
        let _ = writeln!(table, "| {name} | `{folder}` | {imports} | {why} |");
    }
    table
}

#[test]
fn crates_import_only_what_the_table_allows() -> Result<()> {
    let metadata = metadata()?;
    let mut seen = BTreeSet::new();
    let mut faults = Vec::new();
    for package in metadata.workspace_packages() {
        let Some(name) = room_name(&package.name) else {
            faults.push(format!("{}: a workspace crate is named surfelcast-<room>", package.name));
            continue;
        };
        let Some(room) = ROOMS.iter().find(|room| room.name == name) else {
            faults.push(format!("{name}: not in the import table; add it there and to ARCHITECTURE.md"));
            continue;
        };
        seen.insert(room.name);
        let folder = root().join(room.folder).join("Cargo.toml");
        if fs::canonicalize(&folder).ok() != fs::canonicalize(&package.manifest_path).ok() {
            faults.push(format!("{name}: lies at {}, the table says {}", package.manifest_path, room.folder));
        }
        for dependency in &package.dependencies {
            if let Some(imported) = room_name(&dependency.name).filter(|_| dependency.path.is_some())
                && !room.may_import.contains(&imported)
            {
                faults.push(format!("{name} must not import {imported} ({:?} dependency)", dependency.kind));
            }
        }
    }
    for room in ROOMS.iter().filter(|room| !seen.contains(room.name)) {
        faults.push(format!("{}: in the import table, but no crate of the workspace", room.name));
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

#[test]
fn outside_crates_stay_on_their_side_of_the_walls() -> Result<()> {
    let mut faults = Vec::new();
    for package in metadata()?.workspace_packages() {
        let Some(name) = room_name(&package.name) else { continue };
        // Tests may use any tool, in the crate of end-to-end suites and as development dependencies.
        let shipped = package.dependencies.iter().filter(|dependency| dependency.kind != DependencyKind::Development);
        for dependency in shipped.filter(|_| name != "tests") {
            if let Some((_, rooms, why)) = WALLS.iter().find(|(outside, ..)| *outside == dependency.name)
                && !rooms.contains(&name)
            {
                faults.push(format!("{name} must not depend on {}: {why}", dependency.name));
            }
            if dependency.name == "tokio" && WITHOUT_ASYNC.contains(&name) {
                faults.push(format!("{name} must not depend on tokio: it is called from blocking threads"));
            }
        }
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

#[test]
fn table_has_no_way_back() -> Result<()> {
    // Imports are closed: what a room reaches through an import it may also name, or the wall would separate nothing.
    // `service` is the exception on purpose: it reaches the GPU only through the renderer's handle.
    let rooms: BTreeMap<_, _> = ROOMS.iter().map(|room| (room.name, room)).collect();
    for room in ROOMS {
        for imported in room.may_import {
            let Some(below) = rooms.get(imported) else { bail!("{}: unknown room {imported} in the table", room.name) };
            ensure!(!below.may_import.contains(&room.name), "{} and {imported} import each other", room.name);
            if room.name != "service" {
                for deeper in below.may_import {
                    ensure!(room.may_import.contains(deeper), "{} reaches {deeper} through {imported}", room.name);
                }
            }
        }
    }
    Ok(())
}

#[test]
fn architecture_shows_the_same_table() -> Result<()> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md"))?;
    let table = markdown_table();
    ensure!(text.contains(&table), "ARCHITECTURE.md must show this table as it is:\n\n{table}");
    Ok(())
}

/// Position of a library folder in `core <- scene <- bsdf <- gi`.
fn library_rank(folder: &str) -> Option<usize> {
    ["core", "scene", "bsdf", "gi"].iter().position(|name| *name == folder)
}

/// The same arrow inside the shaders: a library folder imports its own kind and those before it, never a technique;
/// a technique imports the library, itself and `common`.
#[test]
fn shader_modules_import_one_way() -> Result<()> {
    let base = root().join("shaders");
    let mut files = Vec::new();
    for folder in ["lib", "techniques"] {
        collect(&base.join(folder), &mut files)?;
    }
    let mut faults = Vec::new();
    for file in files {
        let place = file.strip_prefix(&base)?.to_string_lossy().replace('\\', "/");
        let mut parts = place.split('/');
        let (side, folder) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        for import in fs::read_to_string(&file)?.split("package::").skip(1) {
            let mut path = import.split("::");
            let (to_side, to_folder) = (path.next().unwrap_or_default(), path.next().unwrap_or_default());
            let allowed = match (side, to_side) {
                (_, "constants") => true,
                ("lib", "lib") => match (library_rank(folder), library_rank(to_folder)) {
                    (Some(from), Some(to)) => to <= from,
                    _ => false,
                },
                ("techniques", "lib") => library_rank(to_folder).is_some(),
                ("techniques", "techniques") => to_folder == folder || to_folder == "common" || folder == "testing",
                _ => false,
            };
            if !allowed {
                faults.push(format!("{place}: must not import package::{to_side}::{to_folder}"));
            }
        }
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(())
}

/// All shader files below a folder, in a fixed order; none if there is no such folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    let mut entries = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    entries.sort();
    for entry in entries {
        if entry.is_dir() {
            collect(&entry, files)?;
        } else if entry.extension().is_some_and(|extension| extension == "wesl" || extension == "wgsl") {
            files.push(entry);
        }
    }
    Ok(())
}
