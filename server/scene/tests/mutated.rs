//! Broken and hostile files: whatever the bytes, loading ends with a scene that keeps its promises or with an error.
//!
//! 5,000 mutated files by default; `SURFELCAST_FUZZ_CASES=100000` for the full run.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::disallowed_methods,
    clippy::needless_for_each,
    clippy::unreadable_literal,
    clippy::trivially_copy_pass_by_ref,
    reason = "a test may stop at the first surprise and talk to its terminal"
)]

#[path = "../fuzz/fuzz_targets/body/mod.rs"]
mod fuzz;
mod support;

use std::path::Path;
use std::sync::OnceLock;

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, FileFailurePersistence, TestRunner};
use serde_json::{Value, json};
use surfelcast_scene::{AnimationRef, Instant, LoadOptions, glb, load_bytes};

/// One change to a file.
#[derive(Clone, Debug)]
enum Mutation {
    /// Overwrite a byte of the file.
    Byte(Index, u8),
    /// Flip a bit of the binary chunk.
    BinaryBit(Index, u8),
    /// Cut the file.
    Truncate(Index),
    /// Lie in one of the header's or chunks' length words.
    Length(u8, u32),
    /// Change a JSON value: which, how, with what.
    Json(Index, u8, Index),
    /// Copy one JSON value over another.
    Swap(Index, Index),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let index = any::<Index>;
    prop_oneof![
        2 => (index(), any::<u8>()).prop_map(|(at, byte)| Mutation::Byte(at, byte)),
        2 => (index(), 0u8..8).prop_map(|(at, bit)| Mutation::BinaryBit(at, bit)),
        1 => index().prop_map(Mutation::Truncate),
        1 => (0u8..4, any::<u32>()).prop_map(|(word, value)| Mutation::Length(word, value)),
        8 => (index(), any::<u8>(), index()).prop_map(|(at, how, with)| Mutation::Json(at, how, with)),
        3 => (index(), index()).prop_map(|(from, to)| Mutation::Swap(from, to)),
    ]
}

struct Seed {
    json: Value,
    binary: Vec<u8>,
    /// JSON pointers to every value but the root.
    pointers: Vec<String>,
    is_glb: bool,
}

impl Seed {
    fn new(bytes: &[u8]) -> Self {
        let is_glb = bytes.starts_with(b"glTF");
        let (json, binary) =
            if is_glb { support::unpack(bytes) } else { (serde_json::from_slice(bytes).unwrap(), Vec::new()) };
        let mut pointers = Vec::new();
        list_pointers(&json, "", &mut pointers);
        Self { json, binary, pointers, is_glb }
    }

    fn mutate(&self, mutations: &[Mutation]) -> Vec<u8> {
        let (mut json, mut binary) = (self.json.clone(), self.binary.clone());
        for mutation in mutations {
            match mutation {
                Mutation::Json(at, how, with) => change(json.pointer_mut(at.get::<String>(&self.pointers)), *how, with),
                Mutation::Swap(from, to) => {
                    let copied = json.pointer(from.get::<String>(&self.pointers)).cloned();
                    if let (Some(copied), Some(slot)) = (copied, json.pointer_mut(to.get::<String>(&self.pointers))) {
                        *slot = copied;
                    }
                }
                Mutation::BinaryBit(at, bit) if !binary.is_empty() => {
                    let at = at.index(binary.len());
                    binary[at] ^= 1 << bit;
                }
                _ => {}
            }
        }
        let text = json.to_string().into_bytes();
        let mut bytes = if self.is_glb { glb::pack(&text, &binary) } else { text.clone() };
        for mutation in mutations {
            match mutation {
                Mutation::Byte(at, byte) if !bytes.is_empty() => {
                    let at = at.index(bytes.len());
                    bytes[at] = *byte;
                }
                Mutation::Truncate(at) => bytes.truncate(at.index(bytes.len() + 1)),
                Mutation::Length(word, value) if self.is_glb => {
                    let at = [4, 8, 12, 20 + text.len().next_multiple_of(4)][usize::from(*word)];
                    if let Some(slot) = bytes.get_mut(at..at + 4) {
                        slot.copy_from_slice(&value.to_le_bytes());
                    }
                }
                _ => {}
            }
        }
        bytes
    }
}

fn list_pointers(value: &Value, prefix: &str, out: &mut Vec<String>) {
    let mut visit = |key: &str, child: &Value| {
        let pointer = format!("{prefix}/{}", key.replace('~', "~0").replace('/', "~1"));
        list_pointers(child, &pointer, out);
        out.push(pointer);
    };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, child)| visit(key, child)),
        Value::Array(list) => list.iter().enumerate().for_each(|(k, child)| visit(&k.to_string(), child)),
        _ => {}
    }
}

fn change(slot: Option<&mut Value>, how: u8, with: &Index) {
    let Some(slot) = slot else { return };
    let extremes = [
        json!(0),
        json!(1),
        json!(2),
        json!(3),
        json!(-1),
        json!(255),
        json!(65_535),
        json!(4_294_967_295u64),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(1e-320),
        json!(1e38),
        json!(1e300),
        json!(-1e300),
        json!(0.5),
        json!(5125),
        json!(5126),
        json!(null),
        json!(""),
        json!("MAT4"),
        json!("SCALAR"),
        json!("../../etc/passwd"),
        json!("data:;base64,AAAA"),
        json!("https://example.org/a.bin"),
        json!([]),
        json!({}),
        json!([[[[]]]]),
        json!(true),
    ];
    match (how % 4, &mut *slot) {
        (0, Value::Array(list)) => list.truncate(with.index(list.len() + 1)),
        (1, Value::Array(list)) if !list.is_empty() => {
            let copy = with.get(list).clone();
            list.extend(std::iter::repeat_n(copy, 1 + usize::from(how) / 4));
        }
        (2, Value::Object(map)) if !map.is_empty() => {
            let key = map.keys().nth(with.index(map.len())).cloned();
            key.map(|key| map.remove(&key));
        }
        (3, Value::Number(number)) => {
            *slot = json!(number.as_i64().unwrap_or(0).wrapping_add(i64::from(how as i8)));
        }
        _ => *slot = with.get(&extremes).clone(),
    }
}

fn seeds() -> &'static [Seed] {
    static SEEDS: OnceLock<Vec<Seed>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let everything = support::everything();
        let mut files = vec![everything.clone(), everything.clone(), support::as_json(&everything)];
        let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
        let shared = std::env::var_os("SURFELCAST_SHARED").map_or(beside, Into::into).join("scenes");
        for name in ["cornell_box", "feature_alpha", "khr_animated_morph_cube", "khr_texture_settings"] {
            match std::fs::read(shared.join(format!("{name}.glb"))) {
                Ok(bytes) => files.push(bytes),
                Err(_) => eprintln!("without {name}: {} is absent", shared.display()),
            }
        }
        files.iter().map(|bytes| Seed::new(bytes)).collect()
    })
}

fn options() -> LoadOptions {
    let limits = fuzz::limits();
    let instant = Instant { animation: AnimationRef::Index(0), time_secs: 0.7 };
    LoadOptions { limits, instant: Some(instant), ..LoadOptions::default() }
}

/// Peak resident memory of this process, bytes, where the system tells it.
fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}

#[test]
fn the_seed_loads_with_all_its_features() {
    let scene = load_bytes(&support::everything(), "everything", &options()).unwrap();
    support::check(&scene);
    let summary = scene.summary;
    assert_eq!(summary.triangle_count, 2 + 2 * 5 + 1);
    assert_eq!(summary.texture_count, 3);
    assert_eq!((scene.punctual_lights.len(), scene.emissive_triangles.len(), scene.cameras.len()), (2, 2, 1));
    assert!(summary.has_alpha && summary.has_transmission && summary.has_unlit && summary.has_animation);
    assert!(summary.has_normal_maps && summary.has_vertex_colors);
    assert!(scene.warnings.iter().any(|warning| warning.contains("EXT_unheard_of")), "{:?}", scene.warnings);
    assert!(scene.warnings.iter().any(|warning| warning.contains("points and lines")), "{:?}", scene.warnings);
    let from_json = load_bytes(&support::as_json(&support::everything()), "everything", &options()).unwrap();
    assert_eq!(from_json.summary, summary);
    assert_eq!(from_json.geometry.vertices, scene.geometry.vertices);
}

#[test]
fn mutated_files_never_panic() {
    let cases = std::env::var("SURFELCAST_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(5000);
    let config = Config {
        cases,
        failure_persistence: Some(Box::new(FileFailurePersistence::Off)),
        max_shrink_iters: 2000,
        ..Config::default()
    };
    let (loaded, refused) = (std::cell::Cell::new(0u32), std::cell::Cell::new(0u32));
    let strategy = (any::<Index>(), prop::collection::vec(mutation(), 1..5));
    let started = std::time::Instant::now();
    TestRunner::new(config)
        .run(&strategy, |(seed, mutations)| {
            let seed = seed.get(seeds());
            let mut options = options();
            // most shared scenes have no animation, and asking for one would refuse them all alike
            options.instant = options.instant.filter(|_| seed.json.get("animations").is_some());
            match load_bytes(&seed.mutate(&mutations), "mutated", &options) {
                Ok(scene) => {
                    support::check(&scene);
                    loaded.set(loaded.get() + 1);
                }
                Err(error) => {
                    prop_assert!(!error.to_string().is_empty() && error.to_string().len() < 1000);
                    refused.set(refused.get() + 1);
                }
            }
            Ok(())
        })
        .unwrap();
    let peak = peak_bytes();
    let seconds = started.elapsed().as_secs_f64();
    println!("{} loaded, {} refused in {seconds:.1} s; peak {peak:?} bytes", loaded.get(), refused.get());
    assert!(loaded.get() > cases / 20 && refused.get() > cases / 20, "the mutations test one side only");
    assert!(peak.is_none_or(|bytes| bytes < 512 << 20), "peak memory {peak:?}");
}

/// The fuzz target itself, without the fuzzer: its seeds, and bytes changed and cut at random.
#[test]
fn the_fuzz_target_survives_mutated_bytes() {
    let view = br#"{"cameras": [{"name": "a", "eye": [0, 1, 2], "target": [0, 0, 0], "vfov_deg": 40}], "exposure": 2}"#;
    let environment = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x10\x20\x30\x81";
    let inputs = [support::everything(), view.to_vec(), environment.to_vec()];
    inputs.iter().for_each(|bytes| fuzz::load(bytes));
    let config = Config { cases: 2000, failure_persistence: None, ..Config::default() };
    let change = (any::<Index>(), any::<u8>());
    let strategy = (any::<Index>(), prop::collection::vec(change, 1..8), any::<Option<Index>>());
    TestRunner::new(config)
        .run(&strategy, |(input, changes, cut)| {
            let mut bytes = input.get(&inputs).clone();
            for (at, byte) in changes {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len() + 1));
            }
            fuzz::load(&bytes);
            Ok(())
        })
        .unwrap();
}
