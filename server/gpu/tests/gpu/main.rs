//! The device on any adapter of this machine; software rendering suffices.

mod drawing;

use std::time::{Duration, Instant};

use surfelcast_gpu::{Buffer, Gpu, GpuError, GpuOptions, Kernel, MemoryKind, PassTiming, adapters};
use surfelcast_shaders::Features;

const DOUBLE: &str = "
import package::constants::WORKGROUP_SIZE;
struct Params { count: u32, factor: f32, offset: f32, unused: u32 }
@group(0) @binding(0) var<storage, read> source: array<f32>;
@group(0) @binding(1) var<storage, read_write> result: array<f32>;
@group(1) @binding(0) var<uniform> params: Params;
@compute @workgroup_size(WORKGROUP_SIZE)
fn double(@builtin(global_invocation_id) id: vec3u) {
    if (id.x >= params.count) { return; }
    var value = source[id.x] * params.factor + params.offset;
    @if(unlit) { value = -value; }
    result[id.x] = value;
}";

const COUNT: usize = 1000;

fn gpu() -> Gpu {
    open(&GpuOptions::default())
}

fn open(options: &GpuOptions) -> Gpu {
    Gpu::open(options).unwrap_or_else(|error| panic!("{error}"))
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn from_bytes(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().expect("four bytes"))).collect()
}

fn params(factor: f32, offset: f32) -> Vec<u8> {
    let mut bytes = (COUNT as u32).to_le_bytes().to_vec();
    bytes.extend(floats(&[factor, offset, 0.0]));
    bytes
}

struct Setup {
    gpu: Gpu,
    kernel: Kernel,
    source: Buffer,
    result: Buffer,
}

fn setup() -> Setup {
    setup_on(gpu())
}

fn setup_on(gpu: Gpu) -> Setup {
    let kernel = gpu.kernel_from_source("double", DOUBLE, Features::NONE).expect("compiles");
    let source = gpu.buffer("source", MemoryKind::Scene, COUNT as u64 * 4).expect("fits");
    let values: Vec<f32> = (0..COUNT).map(|index| index as f32).collect();
    gpu.upload(&source, 0, &floats(&values)).expect("uploads");
    let result = gpu.buffer("result", MemoryKind::View, COUNT as u64 * 4).expect("fits");
    Setup { gpu, kernel, source, result }
}

impl Setup {
    fn run(&self, factor: f32) -> Result<Vec<f32>, GpuError> {
        let mut graph = self.gpu.graph("frame");
        graph
            .pass(&self.kernel)
            .read("source", &self.source)
            .read_write("result", &self.result)
            .uniform("params", &params(factor, 1.0))
            .dispatch([16, 1, 1])?;
        let ticket = graph.read_back(&self.result, 0..COUNT as u64 * 4)?;
        let mut report = graph.submit()?.wait()?;
        assert_eq!(report.passes.len(), 1);
        assert!(report.passes[0].gpu_ms > 0.0 && report.wall_ms >= 0.0, "{report:?}");
        Ok(from_bytes(&report.take(ticket)?))
    }
}

fn binding_problem(result: Result<(), GpuError>, expected_name: &str) -> String {
    match result {
        Err(GpuError::Binding { pass, name, problem }) => {
            assert_eq!((pass.as_str(), name.as_str()), ("double", expected_name), "{problem}");
            problem
        }
        other => panic!("expected a binding error, got {other:?}"),
    }
}

#[test]
fn an_adapter_is_reported_with_its_limits() {
    let found = adapters();
    assert!(found.iter().any(|report| report.unusable.is_none()), "{found:?}");
    assert!(found.iter().all(|report| !report.name.is_empty() && report.limits.buffer_bytes > 0));
}

#[test]
fn an_unknown_adapter_is_refused_with_the_list() {
    let options = GpuOptions { adapter: Some("no such card".to_owned()), ..GpuOptions::default() };
    let error = Gpu::open(&options).expect_err("opened").to_string();
    assert!(error.contains("no such card") && error.contains(&gpu().info().name), "{error}");
}

#[test]
fn a_pass_runs_and_its_bytes_come_back() {
    let setup = setup();
    let result = setup.run(2.0).expect("runs");
    assert!(result.iter().enumerate().all(|(index, &value)| value == index as f32 * 2.0 + 1.0));
    let again = setup.run(3.0).expect("runs");
    assert_eq!(again[10], 31.0);
    assert_eq!(setup.gpu.errors(), []);
}

#[test]
fn passes_see_each_other_and_each_its_own_uniforms() {
    // One submission a pass as on CPU devices, and one for all passes as on graphics cards.
    for timing in [PassTiming::WallClock, PassTiming::Timestamps] {
        chain_passes(open(&GpuOptions { pass_timing: Some(timing), ..GpuOptions::default() }));
    }
}

fn chain_passes(gpu: Gpu) {
    let Setup { gpu, kernel, source, result } = setup_on(gpu);
    let second = gpu.buffer("second", MemoryKind::View, COUNT as u64 * 4).expect("fits");
    let mut graph = gpu.graph("chain");
    let mut between = Vec::new();
    for (from, to, factor) in [(&source, &result, 2.0), (&result, &second, 10.0)] {
        graph
            .pass(&kernel)
            .read("source", from)
            .read_write("result", to)
            .uniform("params", &params(factor, 0.0))
            .dispatch([16, 1, 1])
            .expect("records");
        between.push(graph.read_back(&result, 12..16).expect("records"));
    }
    graph.clear(&result).expect("records");
    let cleared = graph.read_back(&result, 5..7).expect("records");
    let ticket = graph.read_back(&second, 12..16).expect("records");
    let mut report = graph.submit().expect("submits").wait().expect("runs");
    assert_eq!(report.passes.len(), 1, "dispatches of one kernel are summed");
    assert_eq!(report.passes[0].dispatches, 2);
    assert!(report.passes[0].gpu_ms >= 0.0 && report.gpu_ms() < 60_000.0, "{report:?}");
    assert_eq!(from_bytes(&report.take(ticket).expect("there")), [60.0]);
    assert_eq!(report.take(cleared).expect("there"), [0, 0], "cleared after the passes");
    for earlier in between {
        assert_eq!(from_bytes(&report.take(earlier).expect("there")), [6.0], "later steps do not show");
    }
    assert!(report.take(ticket).is_err(), "bytes are taken once");
    assert_eq!(gpu.errors(), []);
}

#[test]
fn many_graphs_can_be_on_their_way() {
    let setup = setup_on(open(&GpuOptions { pass_timing: Some(PassTiming::Timestamps), ..GpuOptions::default() }));
    let submissions: Vec<_> = (0..20)
        .map(|factor| {
            let mut graph = setup.gpu.graph("in flight");
            graph
                .pass(&setup.kernel)
                .read("source", &setup.source)
                .read_write("result", &setup.result)
                .uniform("params", &params(factor as f32, 0.0))
                .dispatch([16, 1, 1])
                .expect("records");
            let ticket = graph.read_back(&setup.result, 4..8).expect("records");
            (factor, ticket, graph.submit().expect("submits"))
        })
        .collect();
    assert!(setup.gpu.memory().staging_bytes > 0);
    // Waited for in reverse order.
    for (factor, ticket, submission) in submissions.into_iter().rev() {
        let mut report = submission.wait().expect("runs");
        assert_eq!(from_bytes(&report.take(ticket).expect("there")), [factor as f32]);
    }
}

#[test]
fn features_choose_the_variant_and_equal_texts_share_a_pipeline() {
    let setup = setup();
    let negative = setup.gpu.kernel_from_source("double", DOUBLE, Features::UNLIT).expect("compiles");
    let flipped = Setup { kernel: negative, ..setup };
    assert_eq!(flipped.run(2.0).expect("runs")[3], -7.0);
}

#[test]
fn wrong_bindings_are_named() {
    let Setup { gpu, kernel, source, result } = setup();
    let bytes = params(1.0, 0.0);
    let mut graph = gpu.graph("wrong");

    let missing = graph.pass(&kernel).read("source", &source).uniform("params", &bytes).dispatch([1, 1, 1]);
    assert!(binding_problem(missing, "result").contains("the pass does not"));

    let surplus = graph.pass(&kernel).read("extra", &source).dispatch([1, 1, 1]);
    assert!(binding_problem(surplus, "extra").contains("source, result, params"));

    let access = graph.pass(&kernel).read("source", &source).read("result", &result).dispatch([1, 1, 1]);
    assert!(binding_problem(access, "result").contains("read_write"));
    let access = graph.pass(&kernel).read_write("source", &source).dispatch([1, 1, 1]);
    assert!(binding_problem(access, "source").contains("`read`"));
    let access = graph.pass(&kernel).read("params", &source).dispatch([1, 1, 1]);
    assert!(binding_problem(access, "params").contains("`uniform`"));

    let alias = graph.pass(&kernel).read("source", &source).read_write("result", &source).dispatch([1, 1, 1]);
    assert!(binding_problem(alias, "result").contains("`source`"));
    let twice = graph.pass(&kernel).read("source", &source).read("source", &source).dispatch([1, 1, 1]);
    assert!(binding_problem(twice, "source").contains("twice"));

    let short = graph.pass(&kernel).uniform("params", &bytes[..12]).dispatch([1, 1, 1]);
    assert!(binding_problem(short, "params").contains("12 bytes"));
}

#[test]
fn reading_what_nothing_wrote_is_an_error() {
    let Setup { gpu, kernel, result, .. } = setup();
    let empty = gpu.buffer("empty", MemoryKind::Scene, COUNT as u64 * 4).expect("fits");
    let mut graph = gpu.graph("unwritten");
    let read = graph.pass(&kernel).read("source", &empty).read_write("result", &result).dispatch([1, 1, 1]);
    assert!(binding_problem(read, "source").contains("nothing was ever written"));
    assert!(graph.read_back(&empty, 0..4).is_err());
    graph.clear(&empty).expect("records");
    let read = graph
        .pass(&kernel)
        .read("source", &empty)
        .read_write("result", &result)
        .uniform("params", &params(1.0, 0.0))
        .dispatch([1, 1, 1]);
    assert_eq!(read, Ok(()));
    // A graph that was never submitted has written nothing.
    drop(graph);
    assert!(gpu.graph("later").read_back(&empty, 0..4).is_err());
}

#[test]
fn the_first_bytes_are_cleared_and_no_others() {
    let Setup { gpu, source, .. } = setup();
    gpu.upload(&source, 0, &[7; 16]).expect("fits");
    let mut graph = gpu.graph("part");
    graph.clear_first(&source, 8).expect("records");
    let ticket = graph.read_back(&source, 0..16).expect("records");
    let mut report = graph.submit().expect("submits").wait().expect("runs");
    assert_eq!(report.take(ticket).expect("there"), [[0; 8], [7; 8]].concat());
    for bytes in [6, source.size_bytes() + 4] {
        assert!(gpu.graph("wrong").clear_first(&source, bytes).is_err(), "{bytes}");
    }
}

#[test]
fn graph_misuse_is_refused() {
    let Setup { gpu, kernel, source, result } = setup();
    let mut graph = gpu.graph("misuse");
    assert!(graph.read_back(&source, 0..COUNT as u64 * 4 + 64).is_err());
    assert!(graph.read_back(&source, 8..8).is_err());
    let too_many = graph
        .pass(&kernel)
        .read("source", &source)
        .read_write("result", &result)
        .uniform("params", &params(1.0, 0.0))
        .dispatch([u32::MAX, 1, 1])
        .expect_err("recorded")
        .to_string();
    assert!(too_many.contains("4294967295") && too_many.contains("double"), "{too_many}");
    assert!(gpu.upload(&source, 2, &[0; 4]).is_err());
    assert!(gpu.upload(&source, 0, &[0; 3]).is_err());
    assert!(gpu.upload(&source, u64::MAX - 3, &[0; 4]).is_err());
    assert!(gpu.upload(&source, source.size_bytes(), &[0; 4]).is_err());

    let other = setup_on(self::gpu());
    let foreign = graph.pass(&kernel).read("source", &other.source).dispatch([1, 1, 1]);
    assert!(binding_problem(foreign, "source").contains("another device"));
    assert!(graph.clear(&other.source).is_err() && gpu.upload(&other.source, 0, &[0; 4]).is_err());
}

const SIZES: &str = "
@group(0) @binding(0) var<storage, read_write> sizes: array<u32>;
@compute @workgroup_size(1)
fn sizes_of() { sizes[0] = 2u; sizes[1] = 1u; sizes[2] = 1u; }";

#[test]
fn a_dispatch_takes_its_size_from_a_buffer_the_gpu_wrote() {
    let Setup { gpu, kernel, source, result } = setup();
    let sizes_of = gpu.kernel_from_source("sizes_of", SIZES, Features::NONE).expect("compiles");
    let sizes = gpu.indirect_buffer("sizes", MemoryKind::View, 12).expect("fits");
    let bytes = params(1.0, 1.0);
    let mut graph = gpu.graph("indirect");
    let early = graph.pass(&kernel).dispatch_indirect(&sizes, 0).expect_err("recorded").to_string();
    assert!(early.contains("nothing was ever written"), "{early}");
    graph.pass(&sizes_of).read_write("sizes", &sizes).dispatch([1, 1, 1]).expect("records");
    graph.clear(&result).expect("records");
    let plain = graph.pass(&kernel).dispatch_indirect(&source, 0).expect_err("recorded").to_string();
    assert!(plain.contains("indirect_buffer"), "{plain}");
    graph
        .pass(&kernel)
        .read("source", &source)
        .read_write("result", &result)
        .uniform("params", &bytes)
        .dispatch_indirect(&sizes, 0)
        .expect("records");
    let ticket = graph.read_back(&result, 0..COUNT as u64 * 4).expect("records");
    let mut report = graph.submit().expect("submits").wait().expect("runs");
    let values = from_bytes(&report.take(ticket).expect("there"));
    assert_eq!((values[127], values[128]), (128.0, 0.0), "two workgroups of 64");
}

#[test]
fn memory_is_admitted_by_budget_and_limits_and_given_back() {
    let gpu = open(&GpuOptions { memory_budget_bytes: Some(1 << 20), ..GpuOptions::default() });
    let first = gpu.buffer("first", MemoryKind::Scene, 600 << 10).expect("fits");
    assert_eq!(gpu.memory().scene_bytes, 600 << 10);
    let error = gpu.buffer("second", MemoryKind::View, 600 << 10).expect_err("admitted");
    assert!(matches!(&error, GpuError::OutOfMemory { field, .. } if field == "second"), "{error}");
    let copy = first.clone();
    drop(first);
    assert_eq!(gpu.memory().scene_bytes, 600 << 10, "a clone holds it");
    drop(copy);
    assert_eq!(gpu.memory().total_bytes(), 0);
    let limit = gpu.limits().storage_binding_bytes.min(gpu.limits().buffer_bytes);
    for size in [limit + 1, u64::MAX] {
        let error = gpu.buffer("huge", MemoryKind::Scene, size).expect_err("admitted");
        assert!(matches!(error, GpuError::TooLarge { needed, .. } if needed == size), "{error}");
    }
    assert_eq!(gpu.buffer("empty", MemoryKind::Scene, 0).expect("fits").size_bytes(), 16);
}

#[test]
fn a_new_buffer_is_zero_even_where_an_old_one_lay() {
    let Setup { gpu, kernel, source, .. } = setup();
    for round in 0..4 {
        let result = gpu.buffer("result", MemoryKind::View, COUNT as u64 * 4).expect("fits");
        let mut graph = gpu.graph("zero");
        graph
            .pass(&kernel)
            .read("source", &source)
            .read_write("result", &result)
            .uniform("params", &params(1.0, 5.0))
            .dispatch([1, 1, 1])
            .expect("records");
        let ticket = graph.read_back(&result, 256..COUNT as u64 * 4).expect("records");
        let mut report = graph.submit().expect("submits").wait().expect("runs");
        assert!(report.take(ticket).expect("there").iter().all(|&byte| byte == 0), "round {round}");
        gpu.upload(&result, 0, &vec![0xff; COUNT * 4]).expect("uploads");
    }
}

#[test]
fn a_large_upload_arrives_whole() {
    let gpu = gpu();
    let words: Vec<u8> = (0..10_000_000_u32).flat_map(u32::to_le_bytes).collect();
    let buffer = gpu.buffer("large", MemoryKind::Scene, words.len() as u64).expect("fits");
    gpu.upload(&buffer, 0, &words).expect("uploads");
    let mut graph = gpu.graph("large");
    let ticket = graph.read_back(&buffer, 0..words.len() as u64).expect("records");
    let mut report = graph.submit().expect("submits").wait().expect("runs");
    assert!(report.take(ticket).expect("there") == words);
}

#[test]
fn a_kernel_that_does_not_compile_says_why() {
    let gpu = gpu();
    let text = DOUBLE.replace("result[id.x] = value;", "result[id.x] = vec2u(1);");
    let error = gpu.kernel_from_source("double", &text, Features::NONE).expect_err("compiles");
    assert!(matches!(&error, GpuError::Pipeline { kernel, .. } if kernel == "double"), "{error}");
    assert!(matches!(gpu.kernel("no_such_kernel", Features::NONE), Err(GpuError::Pipeline { .. })));
    let wide = DOUBLE.replace("@workgroup_size(WORKGROUP_SIZE)", "@workgroup_size(1024, 64)");
    let error = gpu.kernel_from_source("double", &wide, Features::NONE).expect_err("compiles").to_string();
    assert!(error.contains("workgroup_invocations"), "{error}");
}

#[test]
fn a_failed_preparation_is_never_ready_and_its_error_is_returned() {
    let gpu = gpu();
    gpu.prepare("no_such_kernel", Features::ALL);
    let error = gpu.kernel("no_such_kernel", Features::ALL).expect_err("compiled");
    assert!(error.to_string().contains("no_such_kernel"), "{error}");
    assert!(gpu.kernel_if_ready("no_such_kernel", Features::ALL).is_none());
}

#[test]
fn a_kernel_is_prepared_in_the_background() {
    let Some(info) = surfelcast_shaders::kernels().first() else { return };
    let gpu = gpu();
    assert!(gpu.kernel_if_ready(&info.name, Features::NONE).is_none());
    gpu.prepare(&info.name, Features::NONE);
    gpu.prepare(&info.name, Features::NONE);
    let begin = Instant::now();
    while gpu.kernel_if_ready(&info.name, Features::NONE).is_none() {
        assert!(begin.elapsed() < Duration::from_mins(2), "never ready");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(gpu.kernel(&info.name, Features::NONE).expect("compiles").name(), info.name);
}

#[test]
fn losing_the_device_is_an_error_everywhere_and_a_panic_nowhere() {
    let options = GpuOptions { allow_forced_loss: true, ..GpuOptions::default() };
    let setup = setup_on(open(&options));
    setup.run(1.0).expect("runs");
    let mut recorded = setup.gpu.graph("recorded before");
    recorded.clear(&setup.result).expect("records");
    let ticket = recorded.read_back(&setup.result, 0..16).expect("records");
    let mut other = setup.gpu.graph("submitted before");
    other.clear(&setup.result).expect("records");
    other.read_back(&setup.result, 0..16).expect("records");
    let on_its_way = other.submit().expect("submits");

    setup.gpu.force_loss().expect("allowed");
    assert!(setup.gpu.is_lost());
    let lost = |error: Option<GpuError>| {
        assert!(error.as_ref().is_some_and(GpuError::is_device_lost), "{error:?}");
    };
    lost(on_its_way.wait().err());
    lost(recorded.submit().err());
    let _ = ticket;
    lost(setup.run(1.0).err());
    lost(setup.gpu.buffer("late", MemoryKind::Scene, 64).err());
    lost(setup.gpu.upload(&setup.source, 0, &[0; 4]).err());
    lost(setup.gpu.kernel("anything", Features::NONE).err());
    lost(setup.gpu.kernel_from_source("double", DOUBLE, Features::NONE).err());
    setup.gpu.prepare("anything", Features::NONE);
    assert!(setup.gpu.force_loss().is_ok(), "twice does no harm");

    // A new device works while objects of the old one still exist.
    let rebuilt = setup_on(open(&options));
    assert_eq!(rebuilt.run(2.0).expect("runs")[1], 3.0);
    drop(setup);
    assert_eq!(rebuilt.run(2.0).expect("runs")[1], 3.0);
}

const SLOW: &str = "
@group(0) @binding(0) var<storage, read_write> result: array<u32>;
@compute @workgroup_size(64)
fn slow(@builtin(global_invocation_id) id: vec3u) {
    var value = id.x;
    for (var i = 0u; i < 20000u; i++) { value = value * 1664525u + 1013904223u; }
    result[id.x % 64u] = value;
}";

#[test]
fn work_that_does_not_end_in_time_counts_as_a_loss() {
    let gpu = open(&GpuOptions { submission_limit: Some(Duration::from_millis(1)), ..GpuOptions::default() });
    let kernel = gpu.kernel_from_source("slow", SLOW, Features::NONE).expect("compiles");
    let result = gpu.buffer("result", MemoryKind::View, 256).expect("fits");
    let mut graph = gpu.graph("hanging");
    graph.pass(&kernel).read_write("result", &result).dispatch([1024, 1, 1]).expect("records");
    let error = graph.submit().and_then(surfelcast_gpu::Submission::wait).expect_err("in time");
    assert!(matches!(&error, GpuError::Timeout { graph, .. } if graph == "hanging"), "{error}");
    assert!(gpu.is_lost() && error.is_device_lost());
    assert!(matches!(gpu.buffer("late", MemoryKind::View, 16), Err(GpuError::DeviceLost { .. })));
}

#[test]
fn losing_the_device_on_purpose_must_be_allowed() {
    let gpu = gpu();
    assert_eq!(gpu.force_loss(), Err(GpuError::ForcedLossNotAllowed));
    assert!(!gpu.is_lost());
}

#[test]
fn the_pipeline_cache_is_written_read_and_not_trusted() {
    let directory = tempfile::tempdir().expect("a temporary folder");
    let options = GpuOptions { cache_dir: Some(directory.path().to_owned()), ..GpuOptions::default() };
    let files = || -> Vec<std::path::PathBuf> {
        let entries = std::fs::read_dir(directory.path()).expect("readable");
        entries.map(|entry| entry.expect("readable").path()).collect()
    };
    setup_on(open(&options)).run(2.0).expect("runs");
    let written = files();
    assert_eq!(written.len(), 1, "{written:?}");
    setup_on(open(&options)).run(2.0).expect("runs with the cache");
    for damage in [b"nonsense".to_vec(), Vec::new(), vec![0xff; 4096]] {
        std::fs::write(&written[0], &damage).expect("writable");
        setup_on(open(&options)).run(2.0).expect("runs with a damaged cache");
        assert_ne!(std::fs::read(&written[0]).expect("readable"), damage, "the damaged file is replaced");
    }
}

#[test]
fn a_submission_can_be_waited_for_in_slices() {
    let Setup { gpu, kernel, source, result } = setup();
    let mut graph = gpu.graph("slices");
    graph
        .pass(&kernel)
        .read("source", &source)
        .read_write("result", &result)
        .uniform("params", &params(2.0, 0.0))
        .dispatch([16, 1, 1])
        .expect("records");
    let ticket = graph.read_back(&result, 4..8).expect("records");
    let mut submission = graph.submit().expect("submits");
    let mut report = loop {
        match submission.try_wait(Duration::from_millis(1)).expect("runs") {
            Ok(report) => break report,
            Err(waiting) => submission = waiting,
        }
    };
    assert_eq!(from_bytes(&report.take(ticket).expect("there")), [2.0]);
}

#[test]
fn threads_share_a_device() {
    let setup = setup();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let setup = &setup;
            scope.spawn(move || {
                let result = setup.gpu.buffer("own", MemoryKind::View, COUNT as u64 * 4).expect("fits");
                let own = Setup {
                    gpu: setup.gpu.clone(),
                    kernel: setup.kernel.clone(),
                    source: setup.source.clone(),
                    result,
                };
                for round in 0..10 {
                    let factor = (thread * 100 + round) as f32;
                    assert_eq!(own.run(factor).expect("runs")[1], factor + 1.0);
                }
            });
        }
    });
}
