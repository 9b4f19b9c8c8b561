//! Direct light reused from the frame before: less noise while the camera moves, no lasting effect.

use surfelcast_gpu::Gpu;
use surfelcast_scene::{Camera, Scene};
use surfelcast_techniques::surfel::SurfelSettings;
use surfelcast_techniques::technique::Technique;
use surfelcast_techniques::{Change, LightBuffers, LightState};

use crate::rig::{Rig, camera, gpu, mean, rmse};
use crate::scenes::{Paint, inside_of_box, lamp, many_lamps, scene, upright};

const SIZE: [u32; 2] = [64, 48];

/// The camera after `step` steps of an orbit, each of about a pixel. It looks down, since lamps in view would have an
/// error of their own: the one sample per pixel hits them or not.
fn orbit(step: u32) -> Camera {
    let angle = f64::from(step) * 0.015;
    camera([1.6 * angle.sin(), 0.6, 1.6 * angle.cos()], [0.0, -0.9, 0.0])
}

fn rig<'a>(gpu: &'a Gpu, scene: &'a Scene, reuses_direct: bool) -> Rig<'a> {
    // The least number of rays that an update traces: if it were above the configured one, frames would take more
    // samples per pixel.
    let settings = SurfelSettings { reuses_direct, rays_per_pixel: 2.0, ..SurfelSettings::BALANCED };
    Rig { is_split: false, ..Rig::new(gpu, scene, settings, SIZE) }
}

fn one_frame(rig: &Rig<'_>, picture: &mut dyn Technique, at: Camera) -> Vec<f32> {
    picture.invalidate(Change::Camera);
    rig.frames(picture, at, 1);
    rig.values(picture)
}

/// The converged image, from other samples than images that have not moved.
fn converged(gpu: &Gpu, scene: &Scene, at: Camera) -> Vec<f32> {
    let rig = rig(gpu, scene, true);
    let mut picture = rig.picture();
    rig.frames(picture.as_mut(), at, 1);
    picture.invalidate(Change::Camera);
    rig.frames(picture.as_mut(), at, 256);
    rig.values(picture.as_ref())
}

#[test]
fn an_orbit_under_many_lamps_loses_most_of_its_noise_and_ends_without_bias() {
    let gpu = gpu();
    let scene = many_lamps();
    let looked_at = [14, 20, 26];
    let truths: Vec<Vec<f32>> = looked_at.iter().map(|&step| converged(&gpu, &scene, orbit(step))).collect();
    let walk = |reuses_direct: bool| {
        let rig = rig(&gpu, &scene, reuses_direct);
        let mut picture = rig.picture();
        rig.frames(picture.as_mut(), orbit(0), 32);
        let frames: Vec<_> = (1..=looked_at[2]).map(|step| one_frame(&rig, picture.as_mut(), orbit(step))).collect();
        let errors = looked_at.iter().zip(&truths).map(|(&step, truth)| rmse(&frames[step as usize - 1], truth));
        let moving = errors.sum::<f64>() / looked_at.len() as f64;
        let resting: Vec<f64> = [2, 4, 8, 16, 24, 32, 64]
            .iter()
            .map(|&frames| {
                rig.frames(picture.as_mut(), orbit(looked_at[2]), frames);
                rmse(&rig.values(picture.as_ref()), &truths[2])
            })
            .collect();
        (moving, resting, mean(&rig.values(picture.as_ref())))
    };
    let (plain, plain_rest, plain_mean) = walk(false);
    let (reused, reused_rest, reused_mean) = walk(true);
    println!("error while moving: {reused:.4} with, {plain:.4} without: {:.2}", reused / plain);
    println!("at rest with    {reused_rest:.4?}\nat rest without {plain_rest:.4?}");
    assert!(reused < 0.6 * plain);
    // After a stop the error is never above that of a fresh start, and in the end it is the same.
    assert!(reused_rest.iter().zip(&plain_rest).all(|(with, without)| *with < 1.1 * without));
    assert!(reused_rest.windows(2).all(|pair| pair[1] < 1.1 * pair[0]), "noise rises");
    assert!((reused_rest[6] / plain_rest[6] - 1.0).abs() < 0.1);
    assert!((reused_mean / plain_mean - 1.0).abs() < 0.002, "{reused_mean} and {plain_mean}");
}

#[test]
fn the_first_frame_after_a_lighting_change_is_that_of_a_fresh_start() {
    let gpu = gpu();
    let scene = many_lamps();
    let mut rig = rig(&gpu, &scene, true);
    let mut picture = rig.picture();
    for step in 0..8 {
        one_frame(&rig, picture.as_mut(), orbit(step));
    }
    for emissive_strength in [0.5, 0.0, 1.0] {
        let state = LightState { emissive_strength, ..LightState::of_scene(&scene) };
        rig.lights = LightBuffers::new(&gpu, &scene, &state).unwrap();
        rig.session.invalidate(Change::Lights);
        picture.invalidate(Change::Lights);
        // The renderer calls this for every new image.
        picture.invalidate(Change::Camera);
        rig.frames(picture.as_mut(), orbit(9), 1);
        // An image without a history, with the same state of the cache.
        let mut fresh = rig.picture();
        rig.frames(fresh.as_mut(), orbit(9), 1);
        assert!(rig.read(picture.picture()) == rig.read(fresh.picture()), "strength {emissive_strength}");
        drop(fresh);
        let moved = one_frame(&rig, picture.as_mut(), orbit(10));
        println!("strength {emissive_strength}: mean {:.5}", mean(&moved));
    }
}

#[test]
fn an_edge_that_moves_over_a_bright_wall_leaves_no_ghost() {
    let gpu = gpu();
    // A dark wall before a bright one, under lamps on both sides of it; small and far, so that there is hardly any
    // noise.
    let mut faces = inside_of_box([-2.0, -1.0, -2.0], [2.0, 1.0, 2.0], Paint::matte(0.7));
    faces.push(upright([-0.4, 0.4], [-1.0, 1.0], 0.0, Paint::matte(0.02)));
    faces.push(lamp(0.0, -1.2, 0.02, 400.0));
    faces.push(lamp(0.0, 1.2, 0.02, 40.0));
    let scene = scene(&faces, 0.0);
    let aside = |step: u32| {
        let x = -0.6 + 0.05 * f64::from(step);
        camera([x, 0.0, 1.5], [x, 0.0, 0.0])
    };
    let walk = |reuses_direct: bool| {
        let rig = rig(&gpu, &scene, reuses_direct);
        let mut picture = rig.picture();
        rig.frames(picture.as_mut(), aside(0), 48);
        (1..=12).map(|step| one_frame(&rig, picture.as_mut(), aside(step))).collect::<Vec<_>>()
    };
    let [with, without] = [walk(true), walk(false)];
    let truth = converged(&gpu, &scene, aside(12));
    // Rows below the lamps.
    let by_column = |picture: &[f32]| -> Vec<f64> {
        let of = |column| mean(&(24..44).map(|row| picture[(row * SIZE[0] + column) as usize]).collect::<Vec<_>>());
        (0..SIZE[0]).map(of).collect()
    };
    let [with, without, truth] = [&with[11], &without[11], &truth].map(|picture| by_column(picture));
    let contrast = truth.iter().copied().fold(0.0, f64::max) - truth.iter().copied().fold(f64::MAX, f64::min);
    // A ghost would be dark on the bright wall next to the dark one, or bright on the dark one.
    let more_wrong = (0..truth.len()).map(|i| (with[i] - truth[i]).abs() - (without[i] - truth[i]).abs());
    let worst = more_wrong.fold(0.0, f64::max) / contrast;
    println!("worst column: {worst:.4} of the contrast of {contrast:.3} more with reuse than without");
    // Shadows at the wall's edge become a little softer; a ghost of the dark wall would be four times as large.
    assert!(worst < 0.05);
}

#[test]
fn a_sharper_image_starts_from_the_frame_of_a_coarse_one() {
    let gpu = gpu();
    let scene = many_lamps();
    let truth = converged(&gpu, &scene, orbit(8));
    let mut rig = rig(&gpu, &scene, true);
    // The filter would remove the same noise from both.
    rig.settings.filters_direct = false;
    let gesture = |rig: &mut Rig<'_>| {
        rig.size = [SIZE[0] / 2, SIZE[1] / 2];
        let mut coarse = rig.picture();
        for step in 0..=8 {
            one_frame(rig, coarse.as_mut(), orbit(step));
        }
        rig.size = SIZE;
        coarse
    };
    let mut errors = Vec::new();
    for takes_frame in [false, true] {
        let mut coarse = gesture(&mut rig);
        let mut sharp = rig.picture();
        if takes_frame {
            sharp.take_frame(coarse.leave_frame().unwrap());
        }
        drop(coarse);
        let errors_at = [1, 4, 32].map(|frames| {
            rig.frames(sharp.as_mut(), orbit(8), frames);
            rmse(&rig.values(sharp.as_ref()), &truth)
        });
        errors.push(errors_at);
    }
    println!("after 1, 4 and 32 frames: without {:.4?}, with {:.4?}", errors[0], errors[1]);
    assert!(errors[1][0] < 0.7 * errors[0][0] && (errors[1][2] / errors[0][2] - 1.0).abs() < 0.15);
    // Under other lights there is no frame to hand on.
    let mut coarse = gesture(&mut rig);
    coarse.invalidate(Change::Lights);
    assert!(coarse.leave_frame().is_none());
}

#[test]
fn a_walk_with_reuse_repeats_to_the_bit_in_pieces_of_any_size() {
    let gpu = gpu();
    let scene = many_lamps();
    let walk = |paths: u64| {
        let rig = rig(&gpu, &scene, true);
        let mut picture = rig.picture();
        let mut pictures = Vec::new();
        for step in 0..12 {
            picture.invalidate(Change::Camera);
            rig.frames_in_pieces(picture.as_mut(), orbit(step), 1 + step % 3, paths);
            pictures.push(rig.read(picture.picture()));
        }
        pictures
    };
    assert!(walk(u64::MAX) == walk(700));
}
