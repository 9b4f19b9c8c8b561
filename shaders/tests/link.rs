//! Linking: imports, conditions, constants, reflection and messages, on small kernels of the test; then every kernel
//! of the project in every checked variant.

use std::collections::BTreeSet;

use surfelcast_shaders::naga::valid::Capabilities;
use surfelcast_shaders::{Access, Features, LinkError, LinkedKernel, kernels, layout, link, link_source, validate};

fn linked(text: &str, features: Features) -> LinkedKernel {
    link_source("probe", text, features).unwrap_or_else(|error| panic!("{error}"))
}

const PROBE: &str = "
import package::constants::WORKGROUP_SIZE;
struct Item { position: vec3f, weight: f32, id: u32 }
@group(0) @binding(0) var<storage, read> items: array<Item>;
@group(0) @binding(1) var<storage, read_write> result: array<f32>;
@if(textures) @group(0) @binding(2) var<storage, read> texels: array<u32>;
@group(1) @binding(0) var<uniform> scale: vec4f;
@compute @workgroup_size(WORKGROUP_SIZE)
fn probe(@builtin(global_invocation_id) id: vec3u) {
    var value = items[id.x].weight * scale.x;
    @if(textures) { value += f32(texels[id.x]); }
    result[id.x] = value;
}";

#[test]
fn a_kernel_is_linked_and_reflected() {
    let kernel = linked(PROBE, Features::NONE);
    assert_eq!(kernel.reflection.workgroup_size, [64, 1, 1]);
    let names: Vec<&str> = kernel.reflection.bindings.iter().map(|binding| binding.name.as_str()).collect();
    assert_eq!(names, ["items", "result", "scale"]);
    let items = &kernel.reflection.bindings[0];
    assert_eq!((items.access, items.array_stride, items.min_size), (Access::StorageRead, Some(32), 32));
    assert_eq!(items.type_name, "array<Item>");
    assert_eq!(kernel.reflection.bindings[1].access, Access::StorageReadWrite);
    assert_eq!(kernel.reflection.bindings[2].access, Access::Uniform);
    let item = &kernel.reflection.structs["Item"];
    let offsets: Vec<u32> = item.members.iter().map(|member| member.offset).collect();
    assert_eq!((item.size, item.align, offsets), (32, 16, vec![0, 12, 16]));
}

#[test]
fn a_feature_adds_its_binding_and_changes_the_hash() {
    let plain = linked(PROBE, Features::NONE);
    let textured = linked(PROBE, Features::TEXTURES);
    let unrelated = linked(PROBE, Features::UNLIT);
    assert_eq!(textured.reflection.bindings.len(), plain.reflection.bindings.len() + 1);
    assert_ne!(plain.hash, textured.hash);
    assert_eq!(plain.hash, unrelated.hash, "a feature the kernel does not mention must not make a new variant");
}

#[test]
fn an_unknown_condition_is_an_error() {
    let text = PROBE.replace("@if(textures) @group", "@if(texturez) @group");
    let error = link_source("probe", &text, Features::NONE).expect_err("links");
    assert!(matches!(error, LinkError::Link { .. }), "{error}");
    assert!(error.to_string().contains("texturez"), "{error}");
}

#[test]
fn an_unknown_import_says_where_files_are_looked_for() {
    let text = PROBE.replace("package::constants::WORKGROUP_SIZE;", "package::lib::nowhere::WORKGROUP_SIZE;");
    let error = link_source("probe", &text, Features::NONE).expect_err("links").to_string();
    assert!(error.contains("nowhere") && error.contains("package::lib::"), "{error}");
}

#[test]
fn a_syntax_error_names_file_and_line() {
    let text = PROBE.replace("result[id.x] = value;", "result[id.x] = = value;");
    let error = link_source("probe", &text, Features::NONE).expect_err("links").to_string();
    assert!(error.contains("probe.wesl:12"), "{error}");
}

#[test]
fn a_type_error_names_file_line_and_declaration() {
    let text = PROBE.replace("result[id.x] = value;", "result[id.x] = vec2u(1);");
    let features = Features::NONE;
    let error = match link_source("probe", &text, features) {
        Ok(kernel) => validate(&kernel, features, Capabilities::default()).expect_err("valid").to_string(),
        Err(error) => error.to_string(),
    };
    assert!(error.contains("probe.wesl") && error.contains("`probe`"), "{error}");
}

#[test]
fn the_entry_point_is_named_like_the_file() {
    let text = PROBE.replace("fn probe", "fn other");
    let error = link_source("probe", &text, Features::NONE).expect_err("links").to_string();
    assert!(error.contains("`other`") && error.contains("`probe`"), "{error}");
}

const RASTER: &str = "
@group(0) @binding(0) var<storage, read> places: array<vec4f>;
@group(0) @binding(1) var seen: texture_2d<f32>;
struct Sums { @location(0) a: vec4f, @location(1) b: vec4f }
@vertex fn probe_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f { return places[index]; }
@fragment fn probe_fragment(@builtin(position) at: vec4f) -> Sums {
    return Sums(textureLoad(seen, vec2u(at.xy), 0), vec4f(1.0));
}";

#[test]
fn a_raster_kernel_has_two_entry_points_targets_and_textures() {
    let kernel = linked(RASTER, Features::NONE);
    assert_eq!((kernel.reflection.entry_point.as_str(), kernel.reflection.target_count), ("probe", 2));
    let access: Vec<Access> = kernel.reflection.bindings.iter().map(|binding| binding.access).collect();
    assert_eq!(access, [Access::StorageRead, Access::Texture]);
    assert_eq!(linked(PROBE, Features::NONE).reflection.target_count, 0);
    for (from, to, named) in [
        ("probe_vertex", "other_vertex", "other_vertex"),
        ("probe_fragment", "other_fragment", "other_fragment"),
        ("<storage, read>", "<storage, read_write>", "places"),
        ("texture_2d<f32>", "texture_2d_array<f32>", "seen"),
    ] {
        let text = RASTER.replace(from, to);
        let text = if named == "seen" { text.replace("(at.xy), 0)", "(at.xy), 0, 0)") } else { text };
        let error = link_source("probe", &text, Features::NONE).expect_err("links").to_string();
        assert!(error.contains(named), "{error}");
    }
}

#[test]
fn an_unknown_kernel_lists_the_known_ones() {
    let error = link("no_such_kernel", Features::NONE).expect_err("links").to_string();
    for kernel in kernels() {
        assert!(error.contains(&kernel.name), "{error}");
    }
}

mod probe_structs {
    surfelcast_shaders::gpu_structs! {
        /// As in the probe.
        pub struct Item {
            /// Metres.
            pub position: [f32; 3],
            /// Weight.
            pub weight: f32,
            /// Id.
            pub id: u32,
            /// Up to the alignment of the position.
            pub padding: [u32; 3],
        }
    }
}

mod wrong_structs {
    surfelcast_shaders::gpu_structs! {
        /// Weight and id swapped, no padding.
        pub struct Item {
            /// Metres.
            pub position: [f32; 3],
            /// Id.
            pub id: u32,
            /// Weight.
            pub weight: f32,
        }
    }
}

#[test]
fn a_layout_that_agrees_passes_and_one_that_does_not_is_named() {
    let kernel = linked(PROBE, Features::NONE);
    assert_eq!(layout::differences(&probe_structs::structs(), &kernel.reflection), [""; 0]);
    let wrong = layout::differences(&wrong_structs::structs(), &kernel.reflection).join("\n");
    assert!(wrong.contains("Item.weight: at byte 12 in WGSL and 16 in Rust"), "{wrong}");
    assert!(wrong.contains("binding `items`"), "{wrong}");
}

/// The capabilities of every device that the project supports: the WebGPU core and compute subgroups.
fn capabilities() -> Capabilities {
    Capabilities::default() | Capabilities::SUBGROUP | Capabilities::SHADER_FLOAT16_IN_FLOAT32
}

#[test]
fn every_kernel_is_valid_in_every_checked_variant() {
    let names: BTreeSet<&str> = kernels().iter().map(|kernel| kernel.name.as_str()).collect();
    assert_eq!(names.len(), kernels().len(), "two kernels share a file name");
    let mut failures = Vec::new();
    let mut checked = BTreeSet::new();
    for kernel in kernels() {
        for features in Features::checked_variants() {
            let result = link(&kernel.name, features).and_then(|linked| {
                if checked.insert(linked.hash) {
                    validate(&linked, features, capabilities())?;
                    let differences = layout::differences(
                        &[layout::structs(), surfelcast_shaders::records::structs()].concat(),
                        &linked.reflection,
                    );
                    if !differences.is_empty() {
                        failures.push(format!("{} [{features}]: {}", kernel.name, differences.join("; ")));
                    }
                }
                Ok(())
            });
            if let Err(error) = result {
                failures.push(error.to_string());
            }
        }
    }
    assert!(failures.is_empty(), "{} failures, the first:\n{}", failures.len(), failures[0]);
    println!("{} kernels, {} distinct variants", kernels().len(), checked.len());
}
