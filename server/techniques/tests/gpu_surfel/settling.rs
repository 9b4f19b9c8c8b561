//! An image at rest converges to the path-traced truth, and is never much worse than the better of the two images that
//! it blends.

use surfelcast_gpu::Gpu;
use surfelcast_passes::step::StepBudget;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::FrameView;
use surfelcast_techniques::surfel::{Estimator, Reconstruction, SurfelSettings};
use surfelcast_techniques::technique::{Change, Technique};

use crate::reconstruction::room;
use crate::rig::{Rig, camera, gpu, tone_mapped_rmse};
use crate::scenes::{Paint, inside_of_box, scene};

const SIZE: [u32; 2] = [48, 36];
/// The multiscale estimator never converges and nothing is reconstructed from it, so that the cache keeps a large error
/// and the test need not run long. Rays are the least number that an update traces: if that were above the configured
/// one, frames would take more samples per pixel.
const COARSE: SurfelSettings = SurfelSettings {
    rays_per_pixel: 2.4,
    estimator: Estimator::Multiscale,
    reconstruction: Reconstruction::None,
    shares: false,
    ..SurfelSettings::BALANCED
};
const TRUTH_SAMPLES: u32 = 2048;

fn view() -> Camera {
    camera([0.0, 0.0, 0.95], [0.0, -0.2, 0.0])
}

fn rig<'a>(gpu: &'a Gpu, scene: &'a Scene, settings: SurfelSettings) -> Rig<'a> {
    let mut rig = Rig::new(gpu, scene, settings, SIZE);
    rig.is_split = false;
    rig
}

/// Renders until an image has `samples` samples per pixel. Returns its number of rays.
fn render(rig: &Rig<'_>, picture: &mut dyn Technique, samples: u32, paths: u64) -> u64 {
    let view = FrameView { camera: view(), size: SIZE, exposure: 1.0 };
    let mut rays = 0;
    while picture.samples() < samples {
        let budget = StepBudget { max_paths: paths, until_samples: samples, max_batch: 64 };
        let step = picture.step(rig.gpu, &rig.buffers, &rig.lights, &view, budget).unwrap();
        assert_eq!(step.non_finite, 0);
        rays += step.rays.iter().sum::<u64>();
    }
    rays
}

/// A path-traced image and its number of rays.
fn path(rig: &Rig<'_>, samples: u32, seed: u64) -> (Vec<f32>, u64) {
    let mut picture = rig.picture_by("path", seed);
    let rays = render(rig, picture.as_mut(), samples, u64::MAX);
    (rig.values(picture.as_ref()), rays)
}

fn mse(values: &[f32], truth: &[f32]) -> f64 {
    tone_mapped_rmse(values, truth).powi(2)
}

#[test]
fn an_image_at_rest_converges_to_the_truth_and_is_never_worse_than_what_it_blends() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let settling = rig(&gpu, &scene, COARSE);
    let (truth, _) = path(&settling, TRUTH_SAMPLES, 77);
    let (noisy, path_rays) = path(&settling, 64, 78);
    // Error of a path-traced image by its cost, and the noise left in the truth.
    let path_cost = mse(&noisy, &truth) * path_rays as f64;
    let floor = path_cost / (path_rays as f64 / 64.0 * f64::from(TRUTH_SAMPLES));

    let cache_alone = rig(&gpu, &scene, SurfelSettings { settles: false, ..COARSE });
    let (mut alone, mut alone_rays) = (cache_alone.picture(), 0);
    let mut of_cache = Vec::new();
    for samples in [1, 2, 4, 8, 16, 32, 64] {
        alone_rays += render(&cache_alone, alone.as_mut(), samples, u64::MAX);
        of_cache.push((alone_rays, mse(&cache_alone.values(alone.as_ref()), &truth)));
    }
    let (mut picture, mut rays) = (settling.picture(), 0);
    let mut last = (0.0, 0.0, 0.0);
    for samples in [1, 4, 8, 12, 16, 24, 32, 64, 128, 256, 512] {
        rays += render(&settling, picture.as_mut(), samples, u64::MAX);
        let error = mse(&settling.values(picture.as_ref()), &truth) - floor;
        // The best of the cache's images that cost no more.
        let cheaper = of_cache.iter().filter(|(cost, _)| *cost <= rays).map(|(_, error)| *error - floor);
        let cache = cheaper.fold(f64::INFINITY, f64::min);
        let paths = path_cost / rays as f64;
        println!(
            "{samples:5} samples, {:7.1} krays: RMSE {:.5}, cache alone {:.5}, paths {:.5}",
            rays as f64 / 1e3,
            error.max(0.0).sqrt(),
            cache.sqrt(),
            paths.sqrt()
        );
        assert!(error.max(0.0).sqrt() <= 1.1 * cache.min(paths).sqrt() + 2e-4, "{samples} samples");
        last = (error, cache, paths);
    }
    let (error, cache, _) = last;
    assert!(error < 0.35 * cache, "the image does not converge: {error} {cache}");
}

#[test]
fn settling_gives_the_same_bytes_in_any_pieces() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let values = |paths| {
        let rig = rig(&gpu, &scene, COARSE);
        let mut picture = rig.picture();
        render(&rig, picture.as_mut(), 40, paths);
        rig.read(picture.picture())
    };
    assert!(values(u64::MAX) == values(5000), "pieces change the image");
}

#[test]
fn motion_returns_to_the_cache_at_once() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let settling = rig(&gpu, &scene, COARSE);
    let mut picture = settling.picture();
    render(&settling, picture.as_mut(), 64, u64::MAX);
    let settled = settling.read(picture.picture());
    picture.invalidate(Change::Camera);
    let rays = render(&settling, picture.as_mut(), 1, u64::MAX);
    assert_eq!(picture.samples(), 1);
    assert!(settling.read(picture.picture()) != settled, "the old image is still shown");
    assert!(rays < 12 * u64::from(SIZE[0] * SIZE[1]), "{rays} rays in a frame of the cache");
}

#[test]
fn a_few_frames_cost_no_path() {
    let gpu = gpu();
    let scene = scene(&room(), 0.0);
    let rays = |settles| {
        let rig = rig(&gpu, &scene, SurfelSettings { settles, ..COARSE });
        let mut picture = rig.picture();
        render(&rig, picture.as_mut(), 8, u64::MAX)
    };
    assert_eq!(rays(true), rays(false));
}

/// Where every pixel is exact already, the blend changes nothing.
#[test]
fn a_furnace_stays_white() {
    let gpu = gpu();
    let cube = inside_of_box([-1.0; 3], [1.0; 3], Paint { albedo: 0.5, emission: 0.5, is_unlit: false });
    let scene = scene(&cube, 0.0);
    let rig = rig(&gpu, &scene, SurfelSettings::BALANCED);
    let mut picture = rig.picture();
    render(&rig, picture.as_mut(), 64, u64::MAX);
    let values = rig.values(picture.as_ref());
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64;
    assert!((mean - 1.0).abs() < 0.002, "{mean}");
    assert!(values.iter().all(|value| (value - 1.0).abs() < 0.1), "{values:?}");
}
