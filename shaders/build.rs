//! Rebuilds the crate when a shader file is added or removed; changes of known files are seen by the embedding itself.

#![allow(clippy::print_stdout, reason = "a build script speaks to cargo through its standard output")]

fn main() {
    println!("cargo::rerun-if-changed=lib");
    println!("cargo::rerun-if-changed=techniques");
}
