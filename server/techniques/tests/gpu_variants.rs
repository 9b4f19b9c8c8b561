//! A kernel variant without what a scene does not need renders the same as the general one: random dimensions do not
//! depend on the variant.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use surfelcast_gpu::{Buffer, Gpu, GpuOptions};
use surfelcast_passes::step::StepBudget;
use surfelcast_render_api::Settings;
use surfelcast_scene::{LoadOptions, Scene, ViewFile, demo, load_bytes};
use surfelcast_shaders::layout::bytemuck;
use surfelcast_techniques::technique::{Technique, TechniqueOptions};
use surfelcast_techniques::{
    FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, path, registry,
};

const SIZE: [u32; 2] = [40, 30];

fn read(gpu: &Gpu, buffer: &Buffer) -> Vec<[f32; 4]> {
    let mut graph = gpu.graph("read");
    let ticket = graph.read_back(buffer, 0..buffer.size_bytes()).unwrap();
    let mut report = graph.submit().unwrap().wait().unwrap();
    bytemuck::pod_collect_to_vec(&report.take(ticket).unwrap())
}

fn picture(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    scene: &SceneBuffers,
    lights: &LightBuffers,
    view: &FrameView,
) -> Vec<[f32; 4]> {
    while technique.samples() < 4 {
        let budget = StepBudget { max_paths: 4096, until_samples: 4, max_batch: 64 };
        let step = technique.step(gpu, scene, lights, view, budget).unwrap();
        assert_eq!(step.non_finite, 0);
    }
    read(gpu, technique.picture())
}

fn compare(gpu: &Gpu, scene: &Scene, materials: MaterialMode) {
    let buffers = SceneBuffers::new(gpu, scene).unwrap();
    let lights = LightBuffers::new(gpu, scene, &LightState::of_scene(scene)).unwrap();
    let options = TechniqueOptions {
        size: SIZE,
        full_size: SIZE,
        materials,
        is_split: false,
        seed: 3,
        waits_for_kernels: true,
        settings: Settings::default(),
    };
    for named in &scene.cameras {
        let view = FrameView { camera: named.camera, size: SIZE, exposure: 1.0 };
        let entry = registry::by_id("path").unwrap();
        let session = SessionState::default();
        let mut special = entry.start(gpu, &buffers, &lights, &session, options.clone()).unwrap();
        let mut general = path::create_general(gpu, options.clone()).unwrap();
        assert_ne!(special.features(), general.features());
        let special = picture(gpu, special.as_mut(), &buffers, &lights, &view);
        let general = picture(gpu, general.as_mut(), &buffers, &lights, &view);
        // A different rounding of the last bit may change a path; nearly all pixels must agree.
        let is_same =
            |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).all(|i| (a[i] - b[i]).abs() <= 1e-3 * a[i].abs().max(0.01));
        let same = special.iter().zip(&general).filter(is_same).count();
        assert!(same * 100 >= special.len() * 97, "{}: {same} of {} pixels agree", named.name, special.len());
        assert!(special.iter().any(|c| c[0] > 0.0), "{} is black", named.name);
    }
}

#[test]
fn special_kernels_render_the_same_as_the_general_one() {
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    for demo in demo::scenes() {
        let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
        let scene =
            load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() }).unwrap();
        compare(&gpu, &scene, MaterialMode::Pbr);
        compare(&gpu, &scene, MaterialMode::Lambert);
    }
}
