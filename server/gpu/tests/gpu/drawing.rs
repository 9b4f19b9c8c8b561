//! Triangles blended additively in targets.

use surfelcast_gpu::{Gpu, GpuOptions, MemoryKind, PassTiming};
use surfelcast_shaders::Features;

use crate::{floats, from_bytes, gpu, open};

/// Draws `count` squares over the image's left half, the i-th adding 2^i; back faces only.
const SQUARES: &str = "
@group(0) @binding(0) var<storage, read> powers: array<f32>;
struct Corner { @builtin(position) clip: vec4f, @location(0) @interpolate(flat) square: u32 }
@vertex
fn squares_vertex(@builtin(vertex_index) index: u32) -> Corner {
    let triangle_corner = index % 6u;
    let x = f32(triangle_corner == 2u || triangle_corner >= 4u);
    let y = f32(triangle_corner == 1u || triangle_corner == 2u || triangle_corner == 4u);
    let clip = vec4f(x - 1.0, y * 2.0 - 1.0, 0.5, 1.0);
    return Corner(clip, index / 6u);
}
@fragment
fn squares_fragment(corner: Corner) -> @location(0) vec4f {
    return vec4f(powers[corner.square], 1.0, 0.0, 0.5);
}";

const TEXELS: &str = "
@group(0) @binding(0) var drawn: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> result: array<vec4f>;
@compute @workgroup_size(64)
fn texels(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(drawn);
    if id.x < size.x * size.y {
        result[id.x] = textureLoad(drawn, vec2u(id.x % size.x, id.x / size.x), 0);
    }
}";

#[test]
fn triangles_add_up_in_targets_that_other_kernels_read() {
    for timing in [PassTiming::WallClock, PassTiming::Timestamps] {
        draw_squares(&open(&GpuOptions { pass_timing: Some(timing), ..GpuOptions::default() }));
    }
}

fn draw_squares(gpu: &Gpu) {
    if let Err(reason) = gpu.can_draw() {
        assert!(reason.to_string().contains("cannot draw"), "{reason}");
        return;
    }
    let squares = gpu.kernel_from_source("squares", SQUARES, Features::NONE).expect("compiles");
    let texels = gpu.kernel_from_source("texels", TEXELS, Features::NONE).expect("compiles");
    let powers = gpu.buffer("powers", MemoryKind::Scene, 16).expect("fits");
    gpu.upload(&powers, 0, &floats(&[1.0, 2.0, 4.0, 8.0])).expect("uploads");
    let before = gpu.memory().view_bytes;
    let target = gpu.target("sums", MemoryKind::View, [6, 2]).expect("fits");
    assert_eq!(gpu.memory().view_bytes - before, if gpu.draws_full_floats() { 192 } else { 96 });
    let result = gpu.buffer("result", MemoryKind::View, 192).expect("fits");

    let mut graph = gpu.graph("unread");
    let unread = graph.pass(&texels).texture("drawn", &target).read_write("result", &result).dispatch([1, 1, 1]);
    assert!(unread.expect_err("recorded").to_string().contains("ever drawn"));
    let dispatched = graph.pass(&squares).read("powers", &powers).dispatch([1, 1, 1]);
    assert!(dispatched.expect_err("recorded").to_string().contains("raster kernel"));
    let drawn = graph.pass(&squares).read("powers", &powers).draw(6, &[]);
    assert!(drawn.expect_err("recorded").to_string().contains("0 targets"));
    let twice = graph.pass(&squares).read("powers", &powers).draw(6, &[&target, &target]);
    assert!(twice.expect_err("recorded").to_string().contains("2 targets"));
    assert!(gpu.target("none", MemoryKind::View, [0, 4]).is_err());

    for count in [3_u32, 2] {
        let mut graph = gpu.graph("squares");
        graph.pass(&squares).read("powers", &powers).draw(count * 6, &[&target]).expect("records");
        graph
            .pass(&texels)
            .texture("drawn", &target)
            .read_write("result", &result)
            .dispatch([1, 1, 1])
            .expect("records");
        let ticket = graph.read_back(&result, 0..192).expect("records");
        let mut report = graph.submit().expect("submits").wait().expect("runs");
        let names: Vec<&str> = report.passes.iter().map(|pass| pass.name.as_str()).collect();
        assert_eq!(names, ["squares", "texels"]);
        let values = from_bytes(&report.take(ticket).expect("there"));
        for (index, value) in values.chunks_exact(4).enumerate() {
            let n = count as f32;
            let expected = if index % 6 < 3 { [(2.0_f32).powi(count as i32) - 1.0, n, 0.0, n * 0.5] } else { [0.0; 4] };
            assert_eq!(value, expected, "pixel {index} of {count} squares");
        }
    }
    assert_eq!(gpu.errors(), []);
}

#[test]
fn raster_kernels_are_named_after_their_file_and_write_targets_only() {
    let gpu = gpu();
    let renamed = SQUARES.replace("fn squares_fragment", "fn other_fragment");
    let error = gpu.kernel_from_source("squares", &renamed, Features::NONE).expect_err("compiled").to_string();
    assert!(error.contains("squares_fragment") && error.contains("other_fragment"), "{error}");
    let writing = SQUARES.replace("<storage, read>", "<storage, read_write>");
    let error = gpu.kernel_from_source("squares", &writing, Features::NONE).expect_err("compiled").to_string();
    assert!(error.contains("may not write `powers`"), "{error}");
}
