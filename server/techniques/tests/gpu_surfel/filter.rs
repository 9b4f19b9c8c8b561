//! Direct light filtered over neighbouring pixels: less noise, shadows as sharp as without, no lasting effect.

use surfelcast_gpu::Gpu;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::surfel::SurfelSettings;

use crate::rig::{Rig, camera, gpu, mean, rmse};
use crate::scenes::{Paint, inside_of_box, lamp, many_lamps, scene, upright};

const SIZE: [u32; 2] = [64, 48];
/// Frames after which images are compared.
const LOOKS: [u32; 4] = [1, 2, 4, 16];
/// Frames after which the filter has faded out: 128 samples per pixel.
const UNFILTERED: u32 = 128;

fn rig<'a>(gpu: &'a Gpu, scene: &'a Scene, filters_direct: bool) -> Rig<'a> {
    // As many configured rays per pixel as new surfels request, so that frames take as many samples as in a large
    // image.
    let settings = SurfelSettings { filters_direct, settles: false, rays_per_pixel: 8.0, ..SurfelSettings::BALANCED };
    Rig { is_split: false, ..Rig::new(gpu, scene, settings, SIZE) }
}

struct Walk {
    /// Images after each of [`LOOKS`].
    looks: Vec<Vec<f32>>,
    /// The image once the filter has faded out.
    end: Vec<[f32; 4]>,
}

/// Without and with the filter.
fn both(gpu: &Gpu, scene: &Scene, at: Camera) -> [Walk; 2] {
    [false, true].map(|filters_direct| {
        let rig = rig(gpu, scene, filters_direct);
        let mut picture = rig.picture();
        let looks = LOOKS
            .iter()
            .map(|&frames| {
                rig.frames(picture.as_mut(), at, frames);
                rig.values(picture.as_ref())
            })
            .collect();
        rig.frames(picture.as_mut(), at, UNFILTERED);
        Walk { looks, end: rig.read(picture.picture()) }
    })
}

/// The same view with other random numbers.
fn truth(gpu: &Gpu, scene: &Scene, at: Camera) -> Vec<f32> {
    let rig = rig(gpu, scene, false);
    let mut picture = rig.picture_by("surfel", 99);
    rig.frames(picture.as_mut(), at, 256);
    rig.values(picture.as_ref())
}

#[test]
fn noise_under_many_lamps_is_filtered_and_the_image_ends_as_without() {
    let gpu = gpu();
    let scene = many_lamps();
    let at = camera([1.2, 0.6, 1.0], [0.0, -0.9, 0.0]);
    let truth = truth(&gpu, &scene, at);
    let [plain, filtered] = both(&gpu, &scene, at);
    for (index, frames) in LOOKS.iter().enumerate() {
        let [without, with] = [&plain.looks[index], &filtered.looks[index]].map(|picture| rmse(picture, &truth));
        let gain = mean(&filtered.looks[index]) / mean(&plain.looks[index]) - 1.0;
        println!(
            "{frames} frames: {without:.4} without, {with:.4} with: {:.2}; light {:+.2} %",
            with / without,
            gain * 100.0
        );
        assert!(with < 0.75 * without);
        assert!(gain.abs() < 0.01);
    }
    assert!(plain.end == filtered.end, "the filter has a lasting effect");
}

#[test]
fn borders_of_shadows_stay_sharp() {
    let gpu = gpu();
    // A board before a wall, under a lamp as small as a point: light with a sharp border and no noise.
    let mut faces = inside_of_box([-2.0, -1.0, -2.0], [2.0, 1.0, 2.0], Paint::matte(0.2));
    faces.push(upright([-0.4, 0.4], [-1.0, 0.2], 0.0, Paint::matte(0.7)));
    faces.push(lamp(0.3, 1.2, 0.005, 40_000.0));
    let scene = scene(&faces, 0.0);
    let at = camera([1.2, 0.6, 1.0], [0.0, -0.9, -0.5]);
    let truth = truth(&gpu, &scene, at);
    let [plain, filtered] = both(&gpu, &scene, at);
    for (index, frames) in LOOKS.iter().enumerate().skip(1) {
        let [without, with] = [&plain.looks[index], &filtered.looks[index]].map(|picture| rmse(picture, &truth));
        println!("{frames} frames: {without:.4} without, {with:.4} with: {:.2}", with / without);
        assert!(with < 1.05 * without);
    }
}
