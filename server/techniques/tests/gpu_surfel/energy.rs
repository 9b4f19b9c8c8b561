//! Furnaces, guiding, rare light: no setting may add or remove energy.

use surfelcast_gpu::Gpu;
use surfelcast_techniques::surfel::{Estimator, Reconstruction, SurfelSettings, cache_of};

use crate::rig::{Rig, blocks, camera, gpu, mean};
use crate::scenes::{Face, Paint, inside_of_box, inside_of_tetrahedron, scene};

const SIZE: [u32; 2] = [32, 32];
/// Frames after which noise is well below the bounds.
const FRAMES: u32 = 40;

/// A closed room that emits 1 - albedo and reflects albedo has radiance 1 everywhere.
fn furnace(albedo: f32) -> Paint {
    Paint { albedo, emission: 1.0 - albedo, is_unlit: false }
}

/// Worst distances from 1: of the mean, and of any square of 8x8 pixels.
fn distances(gpu: &Gpu, faces: &[Face], settings: SurfelSettings, frames: u32) -> [f64; 2] {
    let scene = scene(faces, 0.0);
    let rig = Rig::new(gpu, &scene, settings, SIZE);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), camera([0.1, 0.05, 0.2], [0.9, 0.2, -0.6]), frames);
    let values = rig.values(picture.as_ref());
    let worst = blocks(&values, SIZE, 8).into_iter().map(|block| (block - 1.0).abs()).fold(0.0, f64::max);
    [(mean(&values) - 1.0).abs(), worst]
}

fn check(gpu: &Gpu, name: &str, faces: &[Face], settings: SurfelSettings) {
    let [of_mean, of_block] = distances(gpu, faces, settings, FRAMES);
    println!("{name}: mean off by {:.2} %, blocks by {:.2} %", 100.0 * of_mean, 100.0 * of_block);
    assert!(of_mean <= 0.01 && of_block <= 0.02, "{name}: {of_mean} {of_block}");
}

fn settings() -> SurfelSettings {
    // Four times the rays that an image of this size would get, so that noise cannot be the cause of a failure.
    SurfelSettings { rays_per_pixel: 16.0, target_error: 0.0, ..SurfelSettings::BALANCED }
}

#[test]
fn furnaces_are_white_at_every_albedo_and_share_of_guiding() {
    let gpu = gpu();
    for albedo in [0.2, 0.5, 0.8, 0.95] {
        for guided_share in [0.0, 0.5, 0.9] {
            let faces = inside_of_box([-1.0; 3], [1.0; 3], furnace(albedo));
            check(
                &gpu,
                &format!("albedo {albedo}, guiding {guided_share}"),
                &faces,
                SurfelSettings { guided_share, ..settings() },
            );
        }
    }
}

#[test]
fn furnaces_are_white_whatever_the_sharing_feedback_and_depth() {
    let gpu = gpu();
    let faces = inside_of_box([-1.0; 3], [1.0; 3], furnace(0.8));
    let plain = SurfelSettings { reconstruction: Reconstruction::None, ..settings() };
    check(&gpu, "no reconstruction, sharing", &faces, plain);
    check(&gpu, "no reconstruction, no sharing", &faces, SurfelSettings { shares: false, ..plain });
    check(&gpu, "regression", &faces, SurfelSettings { reconstruction: Reconstruction::Regression, ..settings() });
    check(&gpu, "in the image", &faces, SurfelSettings { reconstruction: Reconstruction::Image, ..settings() });
    check(&gpu, "no feedback", &faces, SurfelSettings { feeds_back: false, ..settings() });
    check(&gpu, "no depth", &faces, SurfelSettings { respects_depth: false, ..settings() });
    // The multiscale estimator never averages longer than its window, so its blocks stay noisy; only its mean is
    // checked.
    let [of_mean, of_block] =
        distances(&gpu, &faces, SurfelSettings { estimator: Estimator::Multiscale, ..settings() }, FRAMES);
    println!("multiscale estimator: mean off by {:.2} %, blocks by {:.2} %", 100.0 * of_mean, 100.0 * of_block);
    assert!(of_mean <= 0.01, "{of_mean}");
}

/// Four lights are all sampled, of twelve one is chosen by resampling: both find all the light.
#[test]
fn furnaces_are_white_with_few_lights_and_with_many() {
    let gpu = gpu();
    for albedo in [0.2, 0.8] {
        check(&gpu, &format!("few lights, albedo {albedo}"), &inside_of_tetrahedron(furnace(albedo)), settings());
    }
}

/// Under a uniform sky guiding cannot help, and must not change the mean of what surfels measure. (Reconstruction
/// weights values by variances and has a bound of its own.)
#[test]
fn guided_rays_leave_a_uniform_sky_unchanged() {
    let gpu = gpu();
    let floor = (vec![[-4.0, 0.0, -4.0], [-4.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, -4.0]], Paint::matte(0.5));
    let wall = (vec![[-4.0, 0.0, -4.0], [4.0, 0.0, -4.0], [4.0, 3.0, -4.0], [-4.0, 3.0, -4.0]], Paint::matte(0.0));
    let scene = scene(&[floor, wall], 1.0);
    let view = camera([0.0, 2.0, 3.0], [0.0, 0.0, 0.0]);
    let means = [0.0, 0.5, 0.9].map(|guided_share| {
        let rig = Rig::new(
            &gpu,
            &scene,
            SurfelSettings { guided_share, reconstruction: Reconstruction::None, ..settings() },
            SIZE,
        );
        let mut picture = rig.picture();
        rig.frames(picture.as_mut(), view, 96);
        mean(&rig.values(picture.as_ref()))
    });
    println!("cosine {:.5}, guided {:.5} and {:.5}", means[0], means[1], means[2]);
    for guided in &means[1..] {
        assert!((guided / means[0] - 1.0).abs() < 0.004, "{means:?}");
    }
}

/// A bright panel that only about one ray in two hundred hits. It is unlit, so light sampling does not sample it.
fn rare_panel(gpu: &Gpu, settings: SurfelSettings, frames: u32) -> [f64; 2] {
    let half = 0.0886; // pi half^2 / (pi 1^2) would be 0.8 %; a square at distance 1.25 subtends half a percent of cosine
    let floor = (vec![[-2.0, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0]], Paint::matte(1.0));
    let panel = (
        vec![[-half, 1.25, -half], [half, 1.25, -half], [half, 1.25, half], [-half, 1.25, half]],
        Paint { albedo: 1.0, emission: 0.0, is_unlit: true },
    );
    let scene = scene(&[floor, panel], 0.0);
    let mut rig = Rig::new(gpu, &scene, settings, SIZE);
    rig.materials = surfelcast_techniques::MaterialMode::Pbr;
    let mut picture = rig.picture();
    // From above, close enough that every pixel is well under the panel.
    rig.frames(picture.as_mut(), camera([0.15, 0.5, 0.15], [0.05, 0.0, 0.0]), frames);
    let cache = cache_of(&rig.session).unwrap();
    let surfels = cache.lock().export(gpu).unwrap();
    // Truth by the closed form of a small lamp: L cos cos A / (pi d^2).
    let mut measured = 0.0;
    let mut expected = 0.0;
    for surfel in &surfels {
        let [x, y, z] = surfel.record.position.map(f64::from);
        // By age, not by rays: surfels that hit the panel early get more of those.
        if surfel.light.age < 100.0 {
            continue;
        }
        let origin = scene.origin;
        let to = [origin.x + x, 1.25 - (origin.y + y), origin.z + z];
        let d2 = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
        let area = f64::from(4.0 * half * half);
        expected += to[1] * to[1] * area / (std::f64::consts::PI * d2 * d2);
        measured += f64::from(surfel.light.direct[0]);
    }
    assert!(expected > 0.0, "no surfel is old enough");
    [measured / expected, expected]
}

#[test]
fn rare_light_keeps_its_energy() {
    let gpu = gpu();
    for guided_share in [0.0, 0.5] {
        let [ratio, _] = rare_panel(&gpu, SurfelSettings { guided_share, ..settings() }, 160);
        println!("guiding {guided_share}: {:.2} % of the panel's energy", 100.0 * ratio);
        assert!((0.97..=1.03).contains(&ratio), "{ratio}");
    }
    // For comparison with the exact mean: the clamp of the multiscale estimator removes rare light.
    let [ratio, _] = rare_panel(&gpu, SurfelSettings { estimator: Estimator::Multiscale, ..settings() }, 160);
    println!("multiscale: {:.2} %", 100.0 * ratio);
}
